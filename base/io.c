/*
 * File calls (io.h): the table, and helpers. A transfer is continued only where nothing was lost (short counts, EINTR).
 * A failed fsync is never tried again, because the kernel may have dropped the dirty pages and marked them clean.
 */
#include "io.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <sys/vfs.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "err.h"
#include "io_closer.h"
#include "progress.h"

static int system_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	return openat(dirfd, path, flags, mode);
}

static int system_fstatat(int dirfd, const char *path, struct stat *st, int flags)
{
	return fstatat(dirfd, path, st, flags);
}

static struct dirent *system_readdir(void *dir)
{
	return readdir(dir);
}

static int system_punch(int fd, off_t from, off_t n)
{
	return fallocate(fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, from, n);
}

const struct io_table io_system = {
	.openat = system_openat,
	.close = close,
	.read = read,
	.pread = pread,
	.pwrite = pwrite,
	.fsync = fsync,
	.renameat = renameat,
	.unlinkat = unlinkat,
	.ftruncate = ftruncate,
	.fstat = fstat,
	.fstatfs = fstatfs,
	.mkdirat = mkdirat,
	.punch = system_punch,
	.fstatat = system_fstatat,
	.faccessat = faccessat,
	.linkat = linkat,
	.utimensat = utimensat,
	.futimens = futimens,
	.fstatvfs = fstatvfs,
	.readdir = system_readdir,
	.copy_file_range = copy_file_range,
	.flock = flock,
};

const struct io_table *io = &io_system;

enum { TRANSFER_MAX = 1 << 30 }; /* the kernel's limit is just below 2^31 */

int io_open(int dirfd, const char *path, int flags, mode_t mode, int *ret_fd, struct err *err)
{
	int fd;

	do
		fd = io->openat(dirfd, path, flags | O_CLOEXEC, mode);
	while (fd < 0 && errno == EINTR);
	if (fd < 0) {
		err_sys(err, errno, "cannot open");
		return err_add_file(err, path);
	}
	*ret_fd = fd;
	return 0;
}

int io_read_some(int fd, void *buf, size_t n, uint64_t off, const char *name, size_t *ret_n, struct err *err)
{
	size_t done = 0;

	if (off > INT64_MAX || n > INT64_MAX - off) {
		err_set(err, ERR_INTERNAL, "a read beyond the largest file");
		return err_add_file(err, name);
	}
	while (done < n) {
		size_t want = n - done < TRANSFER_MAX ? n - done : TRANSFER_MAX;
		ssize_t got = io->pread(fd, (char *)buf + done, want, (off_t)(off + done));

		if (got == 0)
			break;
		if (got < 0 && errno == EINTR)
			continue;
		if (got < 0) {
			err_sys(err, errno, "cannot read");
			err_add_place(err, off + done, NULL);
			return err_add_file(err, name);
		}
		done += (size_t)got;
		progress_step();
	}
	*ret_n = done;
	return 0;
}

int io_read_at(int fd, void *buf, size_t n, uint64_t off, const char *name, struct err *err)
{
	size_t got = 0;
	int rc = io_read_some(fd, buf, n, off, name, &got, err);

	if (rc)
		return rc;
	if (got < n) {
		err_set(err, ERR_TRUNCATED, "the file ends %zu bytes too early", n - got);
		err_add_place(err, off + got, NULL);
		return err_add_file(err, name);
	}
	return 0;
}

int io_write_at(int fd, const void *buf, size_t n, uint64_t off, const char *name, struct err *err)
{
	size_t done = 0;

	while (done < n) {
		size_t want = n - done < TRANSFER_MAX ? n - done : TRANSFER_MAX;
		ssize_t put = io->pwrite(fd, (const char *)buf + done, want, (off_t)(off + done));

		if (put < 0 && errno == EINTR)
			continue;
		if (put <= 0) {
			err_sys(err, put < 0 ? errno : EIO, "cannot write");
			err_add_place(err, off + done, NULL);
			return err_add_file(err, name);
		}
		done += (size_t)put;
	}
	return 0;
}

int io_sync(int fd, const char *name, struct err *err)
{
	if (io->fsync(fd) == 0) {
		progress_step();
		return 0;
	}
	err_sys(err, errno, "cannot fsync");
	return err_add_file(err, name);
}

int io_publish(int dirfd, int fd, const char *temp, const char *name, struct err *err)
{
	int rc = io_sync(fd, name, err);

	if (rc == 0 && io->renameat(dirfd, temp, dirfd, name) != 0) {
		err_sys(err, errno, "cannot rename %s", temp);
		rc = err_add_file(err, name);
	}
	if (rc) {
		io->unlinkat(dirfd, temp, 0); /* best effort: the first error is the one to report */
		return rc;
	}
	return io_sync(dirfd, name, err);
}

bool io_is_gone(int fd)
{
	struct statx st;

	return statx(fd, "", AT_EMPTY_PATH | AT_STATX_DONT_SYNC, STATX_NLINK, &st) == 0 && (st.stx_mask & STATX_NLINK) &&
	       !st.stx_nlink;
}

int io_remove(int dirfd, const char *path, struct err *err)
{
	if (io->unlinkat(dirfd, path, 0) == 0 || errno == ENOENT)
		return 0;
	err_sys(err, errno, "cannot remove");
	return err_add_file(err, path);
}

int io_make_dir(int dirfd, const char *path, mode_t mode, struct err *err)
{
	if (io->mkdirat(dirfd, path, mode) == 0 || errno == EEXIST)
		return 0;
	err_sys(err, errno, "cannot make the folder");
	return err_add_file(err, path);
}

int io_list(int dirfd, const char *path, int (*each)(void *ctx, const struct dirent *, struct err *err), void *ctx,
	    struct err *err)
{
	const struct dirent *e;
	int fd, r = io_open(dirfd, path, O_RDONLY | O_DIRECTORY, 0, &fd, err);
	DIR *dir;

	if (r)
		return r;
	dir = fdopendir(fd);
	if (!dir) {
		r = err_sys(err, errno, "cannot list a folder");
		io_close(fd);
		return err_add_file(err, path);
	}
	while (!r && (errno = 0, e = io->readdir(dir)))
		if (strcmp(e->d_name, ".") && strcmp(e->d_name, "..")) {
			r = each(ctx, e, err);
			progress_step();
		}
	if (!r && errno) {
		r = err_sys(err, errno, "cannot list a folder");
		err_add_file(err, path);
	}
	closedir(dir);
	return r;
}

void io_reserve_standard(void)
{
	for (int fd = STDIN_FILENO; fd <= STDERR_FILENO; fd++)
		/* it may be open for the other direction only; open() takes the lowest free number, which is this one */
		if (fcntl(fd, F_GETFD) < 0)
			open("/dev/null", fd == STDIN_FILENO ? O_WRONLY : O_RDONLY);
}

int io_close(int fd)
{
	if (fd >= 0 && !io_closer(fd))
		io->close(fd); /* the number is free afterwards, even on an error; what matters was synced before */
	return -1;
}
