/*
 * The thread that writes full buffers of one output past the page cache, so that its format goes on while the disk works.
 *
 * The model: a ring of buffers, which are written in order. A format hands over a full buffer and gets an empty one; it waits
 * only if all are full. The file and its flags are the thread's until outfile_behind_wait has returned. After an error nothing is
 * written any more, and every wait tells it.
 */
#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "err.h"
#include "outfile_priv.h"

/* With 4, 8 or 16 no mesh came sooner. */
enum { RING = 2 };

struct outfile_behind {
	struct outfile *o; /* whose file it is */
	pthread_t thread;
	sem_t full, empty; /* buffers to be written; the others */
	struct piece {
		uint8_t *buf;
		size_t n; /* 0: the thread ends */
		uint64_t at;
	} ring[RING];
	unsigned next; /* that is handed over */
	atomic_bool failed;
	struct err err;
};

static void take(sem_t *s)
{
	while (sem_wait(s))
		; /* a signal came */
}

static void *write_behind(void *arg)
{
	struct outfile_behind *b = arg;

	for (unsigned i = 0;; i = (i + 1) % RING) {
		const struct piece *p = &b->ring[i];

		take(&b->full);
		if (!p->n)
			return NULL;
		if (!b->failed && outfile_put_at(b->o, p->buf, p->n, p->at, &b->err))
			b->failed = true;
		sem_post(&b->empty);
	}
}

/* Signals are the caller's. */
static bool start(struct outfile_behind *b)
{
	sigset_t all, was;
	bool started;

	sigfillset(&all);
	pthread_sigmask(SIG_SETMASK, &all, &was);
	started = !pthread_create(&b->thread, NULL, write_behind, b);
	pthread_sigmask(SIG_SETMASK, &was, NULL);
	return started;
}

static void behind_free(struct outfile_behind *b)
{
	for (unsigned i = 0; i < RING; i++)
		free(b->ring[i].buf);
	sem_destroy(&b->full);
	sem_destroy(&b->empty);
	free(b);
}

void outfile_behind_begin(struct outfile *o)
{
	struct outfile_behind *b = calloc(1, sizeof(*b));
	bool whole = b != NULL;

	if (!b)
		return;
	b->o = o;
	b->err = ERR_INIT;
	sem_init(&b->full, 0, 0);
	sem_init(&b->empty, 0, RING);
	for (unsigned i = 0; i < RING; i++)
		whole &= (b->ring[i].buf = outfile_buffer()) != NULL;
	if (whole && start(b))
		o->behind = b;
	else
		behind_free(b);
}

int outfile_behind_wait(const struct outfile *o, struct err *err)
{
	struct outfile_behind *b = o->behind;

	for (unsigned i = 0; b && i < RING; i++)
		take(&b->empty);
	for (unsigned i = 0; b && i < RING; i++)
		sem_post(&b->empty);
	if (!b || !b->failed)
		return 0;
	*err = b->err;
	return -(int)err->code;
}

int outfile_behind_put(const struct outfile *o, uint8_t **buf, size_t n, uint64_t at, struct err *err)
{
	struct outfile_behind *b = o->behind;
	struct piece *p = &b->ring[b->next];
	uint8_t *empty;

	if (b->failed)
		return outfile_behind_wait(o, err);
	take(&b->empty);
	empty = p->buf;
	*p = (struct piece){*buf, n, at};
	*buf = empty;
	b->next = (b->next + 1) % RING;
	sem_post(&b->full);
	return 0;
}

void outfile_behind_end(struct outfile *o)
{
	struct outfile_behind *b = o->behind;

	if (!b)
		return;
	b->failed = true; /* what is not written by now was not published */
	take(&b->empty);
	b->ring[b->next].n = 0;
	sem_post(&b->full);
	pthread_join(b->thread, NULL);
	behind_free(b);
	o->behind = NULL;
}
