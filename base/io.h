/*
 * The one table of file calls. All file I/O of daemon and engine goes through `io`, so that tests can
 * make any call fail. Helpers above it loop over short transfers and EINTR and fill in struct err;
 * `name` is what messages call the file.
 */
#ifndef IO_H
#define IO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/types.h>

struct err;
struct statfs;

struct io_table {
	int (*openat)(int dirfd, const char *path, int flags, mode_t mode);
	int (*close)(int fd);
	ssize_t (*read)(int fd, void *buf, size_t n);
	ssize_t (*pread)(int fd, void *buf, size_t n, off_t off);
	ssize_t (*pwrite)(int fd, const void *buf, size_t n, off_t off);
	int (*fsync)(int fd);
	int (*renameat)(int olddir, const char *old, int newdir, const char *name);
	int (*unlinkat)(int dirfd, const char *path, int flags);
	int (*ftruncate)(int fd, off_t size);
	int (*fstat)(int fd, struct stat *st);
	int (*fstatfs)(int fd, struct statfs *fs);
	int (*mkdirat)(int dirfd, const char *path, mode_t mode);
	int (*punch)(int fd, off_t from, off_t n); /* these bytes need no space any more; NULL: they keep it */
	int (*fstatat)(int dirfd, const char *path, struct stat *st, int flags);
	int (*faccessat)(int dirfd, const char *path, int mode, int flags);
	int (*linkat)(int olddir, const char *old, int newdir, const char *name, int flags);
	int (*utimensat)(int dirfd, const char *path, const struct timespec times[2], int flags);
	int (*futimens)(int fd, const struct timespec times[2]);
	int (*fstatvfs)(int fd, struct statvfs *vfs);
	struct dirent *(*readdir)(void *dir); /* a DIR; NULL and errno as before: the end */
	ssize_t (*copy_file_range)(int in, off_t *in_off, int out, off_t *out_off, size_t n, unsigned flags);
	int (*flock)(int fd, int operation);
};

extern const struct io_table io_system;
extern const struct io_table *io; /* io_system, unless a test says otherwise */

/* The first thing that a program does: descriptors 0 to 2 that it was started without are taken, so that no file that it opens
 * gets one of these numbers, and what is written to standard error with it. Reading and writing them fails as before, with EBADF.
 */
void io_take_standard(void);
/* Always O_CLOEXEC. *ret_fd untouched on failure. */
int io_open(int dirfd, const char *path, int flags, mode_t mode, int *ret_fd, struct err *err);
/* All n bytes; the end of the file before that is -ERR_TRUNCATED. */
int io_read_at(int fd, void *buf, size_t n, uint64_t off, const char *name, struct err *err);
/* Up to n bytes, until the end of the file. */
int io_read_some(int fd, void *buf, size_t n, uint64_t off, const char *name, size_t *ret_n, struct err *err);
int io_write_at(int fd, const void *buf, size_t n, uint64_t off, const char *name, struct err *err);
int io_sync(int fd, const char *name, struct err *err);
/* fsync(fd), rename temp to name, fsync(dirfd). On failure the temp file is removed. Does not close. */
int io_publish(int dirfd, int fd, const char *temp, const char *name, struct err *err);
/* The file or folder was removed since it was opened, as the kernel knows: the file system, which may not answer, is not asked.
 */
bool io_is_gone(int fd);
int io_remove(int dirfd, const char *path, struct err *err); /* absent is success */
/* io_folder.c: a file, or a folder with everything in it; absent is success. Everything in a folder. The entries of a folder
 * whose names begin with `prefix`. */
int io_folder_remove(int dirfd, const char *name, struct err *err);
int io_folder_empty(int dirfd, struct err *err);
int io_folder_sweep(int dirfd, const char *prefix, struct err *err);
int io_make_dir(int dirfd, const char *path, mode_t mode, struct err *err); /* present is success */
/* Calls `each` for every entry but "." and "..", until it returns non-zero, which is returned. What `each` removes is
 * not met again. A folder that cannot be read to its end is an error. */
int io_list(int dirfd, const char *path, int (*each)(void *ctx, const struct dirent *, struct err *err), void *ctx,
	    struct err *err);
/* Closes if fd >= 0; returns -1, so that `fd = io_close(fd)`. */
int io_close(int fd);
/* The thread that calls this must not wait: what it closes from now on and can take long (files) is closed by another one, soon.
 */
int io_close_aside(struct err *err);
void io_close_waits(void); /* it may wait again */
/* Whose it is that this thread closes so from now on (0: nobody's); returns whose it was. One owner's are closed one after the
 * other, those of others beside them. */
uint32_t io_close_whose(uint32_t owner);
void io_close_owned(int fd, uint32_t owner); /* this descriptor is his until it is closed, whoever does that */
/* So many of his (at least 1), or more, are not closed yet: he is to bring no more. *ret_since_ns is then when the close of the
 * first of them began, or when it came here if no thread is free for it (clock_mono_ns). */
bool io_close_behind(uint32_t owner, size_t most, uint64_t *ret_since_ns);

#endif
