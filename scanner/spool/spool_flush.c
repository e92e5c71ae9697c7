/*
 * Making records durable: fsync, by the caller or by the writer's own thread, so that a disk that takes seconds does
 * not stop the appending. Only one fsync runs at a time. After a failed fsync there is no other, because the kernel
 * reports a lost page only once, and a second fsync that succeeds would mean nothing.
 */
#include <errno.h>
#include <string.h>
#include <time.h>

#include "clock.h"
#include "io.h"
#include "spool_priv.h"

enum { FULL = 4 }; /* times the batch: beyond that, appending waits */

int spool_flush_init(struct spool_writer *w, struct err *err)
{
	pthread_condattr_t attr;

	if (pthread_condattr_init(&attr))
		return err_set(err, ERR_NOMEM, "no memory to write a spool");
	pthread_condattr_setclock(&attr, CLOCK_MONOTONIC);
	pthread_mutex_init(&w->lock, NULL);
	pthread_mutex_init(&w->syncing, NULL);
	pthread_cond_init(&w->changed, &attr);
	pthread_condattr_destroy(&attr);
	return 0;
}

static int report_failure(const struct err *why, struct err *err)
{
	*err = *why;
	return -(int)err->code;
}

int spool_sync(struct spool_writer *w, struct err *err)
{
	struct err e = ERR_INIT;
	uint64_t written;
	bool failed, dirty;
	int r = 0;

	pthread_mutex_lock(&w->syncing);
	pthread_mutex_lock(&w->lock);
	failed = w->flush_failed;
	dirty = w->dirty;
	w->dirty = false;
	written = w->written;
	pthread_mutex_unlock(&w->lock);
	if (!failed && dirty)
		r = io_sync(w->fd, w->path, &e);
	pthread_mutex_lock(&w->lock);
	if (r) {
		w->flush_failed = true;
		w->flush_why = e;
	} else if (!failed) {
		w->durable = written;
	}
	failed = w->flush_failed;
	pthread_cond_broadcast(&w->changed);
	pthread_mutex_unlock(&w->lock);
	pthread_mutex_unlock(&w->syncing);
	return failed ? report_failure(&w->flush_why, err) : 0;
}

static void *flusher(void *of)
{
	struct spool_writer *w = of;
	struct err ignored = ERR_INIT; /* it is in flush_why */

	pthread_mutex_lock(&w->lock);
	while (!w->quit && !w->flush_failed) {
		uint64_t now = clock_mono_ns();
		struct timespec until;

		if (!w->dirty) {
			pthread_cond_wait(&w->changed, &w->lock);
		} else if (now < w->due_ns && w->written - w->durable < w->batch) {
			until = (struct timespec){.tv_sec = (time_t)(w->due_ns / 1000000000),
						  .tv_nsec = (long)(w->due_ns % 1000000000)};
			pthread_cond_timedwait(&w->changed, &w->lock, &until);
		} else {
			pthread_mutex_unlock(&w->lock);
			spool_sync(w, &ignored);
			pthread_mutex_lock(&w->lock);
		}
	}
	pthread_mutex_unlock(&w->lock);
	return NULL;
}

int spool_flush_start(struct spool_writer *w, double seconds, uint64_t bytes, struct err *err)
{
	int sys;

	w->every_ns = (uint64_t)(seconds * 1e9);
	w->batch = bytes;
	sys = pthread_create(&w->thread, NULL, flusher, w);
	if (sys)
		return err_sys(err, sys, "cannot start the thread that brings a spool to disk");
	w->running = true;
	return 0;
}

void spool_flush_stop(struct spool_writer *w)
{
	if (!w->running)
		return;
	pthread_mutex_lock(&w->lock);
	w->quit = true;
	pthread_cond_broadcast(&w->changed);
	pthread_mutex_unlock(&w->lock);
	pthread_join(w->thread, NULL);
	w->running = false;
}

int spool_flush_appended(struct spool_writer *w, size_t data, struct err *err)
{
	uint64_t began = 0;
	bool failed, wake;

	pthread_mutex_lock(&w->lock);
	wake = !w->dirty;
	if (!w->dirty)
		w->due_ns = clock_mono_ns() + w->every_ns;
	w->dirty = true;
	w->written += data;
	if (w->running && (wake || w->written - w->durable >= w->batch))
		pthread_cond_broadcast(&w->changed);
	while (w->running && !w->flush_failed && w->written - w->durable > FULL * w->batch) {
		if (!began) {
			began = clock_mono_ns();
			w->totals.waits++;
		}
		pthread_cond_wait(&w->changed, &w->lock);
	}
	if (began)
		w->totals.wait_ns += clock_mono_ns() - began;
	failed = w->flush_failed;
	pthread_mutex_unlock(&w->lock);
	return failed ? report_failure(&w->flush_why, err) : 0;
}
