/* The socket: bound and removed under the lock PATH.lock. */
#include <stdio.h>
#include <string.h>
#include <fcntl.h>
#include <errno.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "place.h"
#include "place_priv.h"

static int make_address(const char *path, struct sockaddr_un *ret, struct err *err)
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

	/* Nobody holds the lock, so the process that made it has ended. Only a socket is ever removed. */
	if (lstat(a->sun_path, &st) == 0 && S_ISSOCK(st.st_mode) && unlink(a->sun_path) != 0)
		return err_sys(err, errno, "cannot remove the stale socket");
	mask = umask(0117); /* mode 0660 from the beginning */
	r = bind(fd, (const struct sockaddr *)a, sizeof *a);
	umask(mask);
	if (r != 0)
		return err_sys(err, errno, "cannot bind the socket");
	/* As in acutd.socket. Further clients wait in the kernel, in connect(). */
	return listen(fd, 1024) != 0 ? err_sys(err, errno, "cannot listen") : 0;
}

static int lock_socket(const char *path, int *ret_lock, struct err *err)
{
	char name[sizeof(struct sockaddr_un) + 8];

	snprintf(name, sizeof name, "%s.lock", path);
	return place_lock(AT_FDCWD, name, ret_lock, err);
}

int place_bind(const char *path, int *ret_fd, int *ret_lock, struct err *err)
{
	struct sockaddr_un a;
	int lock = -1, fd = -1, r = make_address(path, &a, err);

	if (!r)
		r = lock_socket(path, &lock, err);
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

static bool socket_path(int fd, char *path, size_t size)
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
	return !socket_path(fd, path, sizeof path) || lock_socket(path, ret_lock, &err) == 0;
}

void place_unbind(int fd)
{
	char path[sizeof(struct sockaddr_un)];

	if (socket_path(fd, path, sizeof path))
		unlink(path);
}
