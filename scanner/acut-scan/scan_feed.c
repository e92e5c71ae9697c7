/*
 * Writes the bytes of a source into the daemon's pipe, in a thread for each, while calls wait for the daemon's answers.
 *
 * The model: a thread writes until its source ends, the daemon closes its side, or it is stopped; it never blocks in a write,
 * so that it can be stopped. Sources on the ground share the poses: such a thread writes the head, which is all that a probe
 * needs, and waits for its turn.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <unistd.h>

#include "err.h"
#include "scan_source.h"

enum { CLOSED = 2, WAIT_MS = 50 };

struct scan_feed {
	const struct scan_source *source;
	int fd;
	pthread_t thread;
	sem_t go;
	bool waits;
	atomic_bool stop;
	int r;
	struct err err;
};

static int put(void *ctx, const void *bytes, size_t n)
{
	struct scan_feed *f = ctx;
	const uint8_t *at = bytes;

	while (n) {
		struct pollfd to = {.fd = f->fd, .events = POLLOUT};
		ssize_t k;

		if (atomic_load(&f->stop))
			return CLOSED;
		if (poll(&to, 1, WAIT_MS) <= 0)
			continue;
		if (to.revents & POLLERR)
			return CLOSED;
		k = write(f->fd, at, n);
		if (k < 0 && errno != EINTR && errno != EAGAIN)
			return CLOSED;
		if (k > 0) {
			at += k;
			n -= (size_t)k;
		}
	}
	/* The head is out: the rest takes the poses. */
	if (f->waits) {
		f->waits = false;
		while (sem_wait(&f->go) && errno == EINTR)
			;
		if (atomic_load(&f->stop))
			return CLOSED;
	}
	return 0;
}

static bool stops(void *ctx)
{
	struct scan_feed *f = ctx;

	return atomic_load(&f->stop);
}

/* The head is written on its own. */
static void *run(void *ctx)
{
	struct scan_feed *f = ctx;

	f->r = scan_source_write(f->source, put, stops, f, &f->err);
	close(f->fd);
	f->fd = -1;
	return NULL;
}

int scan_feed_new(const struct scan_source *s, int fd, struct scan_feed **ret, struct err *err)
{
	struct scan_feed *f = calloc(1, sizeof *f);
	int sys;

	if (!f) {
		close(fd);
		return err_set(err, ERR_NOMEM, "no memory to send points");
	}
	f->source = s;
	f->fd = fd;
	f->waits = s->kind == SCAN_GROUND;
	f->err = ERR_INIT;
	fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK);
	sem_init(&f->go, 0, 0);
	sys = pthread_create(&f->thread, NULL, run, f);
	if (sys) {
		close(fd);
		sem_destroy(&f->go);
		free(f);
		return err_sys(err, sys, "no thread to send points");
	}
	*ret = f;
	return 0;
}

void scan_feed_go(struct scan_feed *f)
{
	sem_post(&f->go);
}

int scan_feed_free(struct scan_feed *f, bool stop, struct err *err)
{
	int r;

	if (!f)
		return 0;
	if (stop) {
		atomic_store(&f->stop, true);
		sem_post(&f->go);
	}
	pthread_join(f->thread, NULL);
	r = f->r < 0 && !atomic_load(&f->stop) ? f->r : 0;
	if (r && !err->code)
		*err = f->err;
	sem_destroy(&f->go);
	free(f);
	return r;
}
