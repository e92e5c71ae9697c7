/*
 * The table of file calls. All file I/O of daemon and engine goes through `io`, so that tests can make any call fail.
 * The helpers continue after short transfers and EINTR, and fill in struct err; `name` is the file's name in messages.
 */
#ifndef IO_H
#define IO_H

#include <stdatomic.h>
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
	int (*punch)(int fd, off_t from, off_t n); /* frees the space of these bytes; NULL: not supported */
	int (*fstatat)(int dirfd, const char *path, struct stat *st, int flags);
	int (*faccessat)(int dirfd, const char *path, int mode, int flags);
	int (*linkat)(int olddir, const char *old, int newdir, const char *name, int flags);
	int (*utimensat)(int dirfd, const char *path, const struct timespec times[2], int flags);
	int (*futimens)(int fd, const struct timespec times[2]);
	int (*fstatvfs)(int fd, struct statvfs *vfs);
	struct dirent *(*readdir)(void *dir); /* a DIR; NULL with errno unchanged at the end */
	ssize_t (*copy_file_range)(int in, off_t *in_off, int out, off_t *out_off, size_t n, unsigned flags);
	int (*flock)(int fd, int operation);
};

extern const struct io_table io_system;
extern const struct io_table *io; /* io_system, except in tests */

/* Call it first in every program: occupies those of descriptors 0 to 2 that are closed, so that no file gets such a
 * number and then what is written to standard error. Reading and writing them still fails with EBADF. */
void io_reserve_standard(void);
/* Always O_CLOEXEC. *ret_fd untouched on failure. */
int io_open(int dirfd, const char *path, int flags, mode_t mode, int *ret_fd, struct err *err);
/* Reads n bytes; if the file ends before: -ERR_TRUNCATED. */
int io_read_at(int fd, void *buf, size_t n, uint64_t off, const char *name, struct err *err);
/* Reads up to n bytes, or to the end of the file. */
int io_read_some(int fd, void *buf, size_t n, uint64_t off, const char *name, size_t *ret_n, struct err *err);
int io_write_at(int fd, const void *buf, size_t n, uint64_t off, const char *name, struct err *err);
int io_sync(int fd, const char *name, struct err *err);
/* fsync(fd), rename temp to name, fsync(dirfd). On failure the temporary file is removed. Does not close. */
int io_publish(int dirfd, int fd, const char *temp, const char *name, struct err *err);
/* Whether the file or folder was removed since it was opened. Asks only the kernel, not the file system, which may not
 * answer. */
bool io_is_gone(int fd);
int io_remove(int dirfd, const char *path, struct err *err); /* success if it does not exist */
/* io_folder.c: removes a file, or a folder with everything in it (success if it does not exist); everything in a
 * folder; the entries of a folder whose names begin with `prefix`. */
int io_folder_remove(int dirfd, const char *name, struct err *err);
int io_folder_empty(int dirfd, struct err *err);
int io_folder_sweep(int dirfd, const char *prefix, struct err *err);
/* The same, until another thread sets *stop: -ERR_CANCELLED. */
int io_folder_sweep_until(int dirfd, const char *prefix, const atomic_bool *stop, struct err *err);
int io_make_dir(int dirfd, const char *path, mode_t mode, struct err *err); /* success if it exists */
/* Calls `each` for every entry except "." and "..", until it returns non-zero, which is returned. `each` may remove
 * entries. A folder that cannot be read to its end is an error. */
int io_list(int dirfd, const char *path, int (*each)(void *ctx, const struct dirent *, struct err *err), void *ctx,
	    struct err *err);
/* Closes if fd >= 0; returns -1, so that `fd = io_close(fd)`. */
int io_close(int fd);
/* From now on this thread must not wait: files that it closes, which can take long, are closed soon by another thread. */
int io_close_background(struct err *err);
void io_close_foreground(void); /* the thread may wait again */
/* Sets the owner of what this thread closes in the background (0: none); returns the previous owner. The files of one
 * owner are closed one after the other, in parallel with those of other owners. */
uint32_t io_close_owner(uint32_t owner);
void io_close_assign(int fd, uint32_t owner); /* assigns this descriptor to an owner until it is closed, by any thread */
/* Whether at least `most` (>= 1) descriptors of an owner are not closed yet, so that no more should be accepted from
 * it. *ret_since_ns (clock_mono_ns): when the close of the first of them began, or when it was queued if no thread is
 * free. */
bool io_close_backlog(uint32_t owner, size_t most, uint64_t *ret_since_ns);

#endif
