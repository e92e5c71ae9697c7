/*
 * Closing without waiting for it (io.h).
 *
 * The last close of a file without a name frees all that it holds, a second for some tens of gigabytes, and that of a file
 * system in user space waits for an answer from there. The loop gets descriptors from whoever connects.
 *
 * The model: a thread says once that it must not wait. What it closes from then on and is no pipe, nor a socket whose bytes are
 * all read (others may hold descriptors that were sent and never taken), goes to a list that a thread of its own goes
 * through. Nothing is asked about the file: that may wait as well. The number of the descriptor is free when it is closed.
 */
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include "err.h"
#include "io.h"
#include "io_aside.h"

static struct {
	pthread_mutex_t lock;
	pthread_cond_t wake;
	int *fd;
	size_t n, cap;
	bool there; /* the thread */
} aside = {.lock = PTHREAD_MUTEX_INITIALIZER, .wake = PTHREAD_COND_INITIALIZER};
static _Thread_local bool must_not_wait;

static void *closer(void *ctx)
{
	int fd;

	pthread_mutex_lock(&aside.lock);
	for (;;) {
		while (!aside.n)
			pthread_cond_wait(&aside.wake, &aside.lock);
		fd = aside.fd[--aside.n];
		pthread_mutex_unlock(&aside.lock);
		io->close(fd);
		pthread_mutex_lock(&aside.lock);
	}
	return NULL;
}

int io_close_aside(struct err *err)
{
	enum { STACK_BYTES = 64 << 10 };
	pthread_attr_t attr;
	pthread_t thread;
	int r = 0;

	must_not_wait = true;
	if (aside.there)
		return 0;
	pthread_attr_init(&attr);
	pthread_attr_setstacksize(&attr, STACK_BYTES);
	pthread_attr_setdetachstate(&attr, PTHREAD_CREATE_DETACHED);
	r = pthread_create(&thread, &attr, closer, NULL);
	pthread_attr_destroy(&attr);
	if (r)
		return err_sys(err, r, "cannot start a thread");
	aside.there = true;
	return 0;
}

void io_close_waits(void)
{
	must_not_wait = false;
}

static bool at_once(int fd)
{
	socklen_t size = sizeof(int);
	int type, unread;

	if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) == 0)
		return ioctl(fd, FIONREAD, &unread) != 0 || !unread;
	return fcntl(fd, F_GETPIPE_SZ) >= 0;
}

bool io_aside(int fd)
{
	size_t cap;
	int *more;
	bool kept;

	if (!must_not_wait || !aside.there || at_once(fd))
		return false;
	pthread_mutex_lock(&aside.lock);
	if (aside.n == aside.cap) {
		cap = aside.cap ? 2 * aside.cap : 16;
		more = realloc(aside.fd, cap * sizeof *more);
		if (more) {
			aside.fd = more;
			aside.cap = cap;
		}
	}
	kept = aside.n < aside.cap;
	if (kept)
		aside.fd[aside.n++] = fd;
	pthread_cond_signal(&aside.wake);
	pthread_mutex_unlock(&aside.lock);
	return kept;
}
