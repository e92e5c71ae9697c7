/*
 * Locks on folders and sockets, by flock: they go with the process, however it ends. Lock files stay where
 * they are, since one that is removed could be locked twice.
 */
#include "place.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "err.h"
#include "io.h"

static int make_dirs(const char *path, struct err *err)
{
	char part[512];
	char *at;
	int r;

	if (strlen(path) >= sizeof part)
		return err_set(err, ERR_USAGE, "the path is longer than %zu bytes", sizeof part - 1);
	strcpy(part, path);
	for (at = part + 1; (at = strchr(at, '/')); at++) {
		*at = 0;
		r = io_make_dir(AT_FDCWD, part, 0755, err);
		*at = '/';
		if (r)
			return r;
	}
	return io_make_dir(AT_FDCWD, part, 0700, err);
}

static long holder_of(int fd)
{
	char text[32] = "";
	ssize_t n = pread(fd, text, sizeof text - 1, 0);

	return n > 0 ? strtol(text, NULL, 10) : 0;
}

static int lock_file(int dirfd, const char *name, int *ret_lock, struct err *err)
{
	char text[32];
	int fd, r, n;

	r = io_open(dirfd, name, O_RDWR | O_CREAT | O_NOFOLLOW, 0600, &fd, err);
	if (r)
		return r;
	if (flock(fd, LOCK_EX | LOCK_NB) != 0) {
		if (errno == EWOULDBLOCK)
			r = err_set(err, ERR_BUSY, "another acutd (pid %ld) runs here", holder_of(fd));
		else
			r = err_sys(err, errno, "cannot lock");
		io_close(fd);
		return r;
	}
	n = snprintf(text, sizeof text, "%ld\n", (long)getpid());
	if (ftruncate(fd, 0) != 0 || pwrite(fd, text, (size_t)n, 0) != n) {
		r = err_sys(err, errno, "cannot write the lock");
		io_close(fd);
		return r;
	}
	*ret_lock = fd;
	return 0;
}

int place_folder(const char *path, int *ret_fd, int *ret_lock, struct err *err)
{
	int fd = -1, lock, r = make_dirs(path, err);

	if (!r)
		r = io_open(AT_FDCWD, path, O_RDONLY | O_DIRECTORY, 0, &fd, err);
	if (!r)
		r = lock_file(fd, "lock", &lock, err);
	if (r) {
		io_close(fd);
		if (err->code == ERR_BUSY)
			err_add_hint(err,
				     "end that daemon, or give this one other folders (--state, --cache)");
		return err_add_file(err, path);
	}
	*ret_fd = fd;
	*ret_lock = lock;
	return 0;
}

/* ---- sockets ---- */

static int address_of(const char *path, struct sockaddr_un *ret, struct err *err)
{
	*ret = (struct sockaddr_un){.sun_family = AF_UNIX};
	if (strlen(path) >= sizeof ret->sun_path) {
		err_set(err, ERR_USAGE, "a socket's path has at most %zu bytes", sizeof ret->sun_path - 1);
		return err_add_file(err, path);
	}
	strcpy(ret->sun_path, path);
	return 0;
}

static int bind_at(int fd, const struct sockaddr_un *a, struct err *err)
{
	struct stat st;
	mode_t mask;
	int r;

	/* Nobody holds the lock, so whoever made it is gone. Only a socket is ever removed. */
	if (lstat(a->sun_path, &st) == 0 && S_ISSOCK(st.st_mode) && unlink(a->sun_path) != 0)
		return err_sys(err, errno, "cannot remove the stale socket");
	mask = umask(0117); /* 0660 from the first moment */
	r = bind(fd, (const struct sockaddr *)a, sizeof *a);
	umask(mask);
	if (r != 0)
		return err_sys(err, errno, "cannot bind the socket");
	return listen(fd, SOMAXCONN) != 0 ? err_sys(err, errno, "cannot listen") : 0;
}

static int lock_of(const char *path, int *ret_lock, struct err *err)
{
	char name[sizeof(struct sockaddr_un) + 8];

	snprintf(name, sizeof name, "%s.lock", path);
	return lock_file(AT_FDCWD, name, ret_lock, err);
}

int place_bind(const char *path, int *ret_fd, int *ret_lock, struct err *err)
{
	struct sockaddr_un a;
	int lock = -1, fd = -1, r = address_of(path, &a, err);

	if (!r)
		r = lock_of(path, &lock, err);
	if (!r) {
		fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
		r = fd < 0 ? err_sys(err, errno, "cannot make a socket") : bind_at(fd, &a, err);
	}
	if (r) {
		io_close(fd);
		io_close(lock);
		return err_add_file(err, path);
	}
	*ret_fd = fd;
	*ret_lock = lock;
	return 0;
}

static bool name_of(int fd, char *path, size_t size)
{
	struct sockaddr_un a = {0};
	socklen_t n = sizeof a;

	if (getsockname(fd, (struct sockaddr *)&a, &n) != 0 || a.sun_family != AF_UNIX || !a.sun_path[0])
		return false;
	snprintf(path, size, "%s", a.sun_path);
	return true;
}

bool place_lock_socket(int fd, int *ret_lock)
{
	char path[sizeof(struct sockaddr_un)];
	struct err err = ERR_INIT;

	*ret_lock = -1;
	return !name_of(fd, path, sizeof path) || lock_of(path, ret_lock, &err) == 0;
}

void place_unbind(int fd)
{
	char path[sizeof(struct sockaddr_un)];

	if (name_of(fd, path, sizeof path))
		unlink(path);
}
