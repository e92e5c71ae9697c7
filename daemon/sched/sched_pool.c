/*
 * The scheduler: worker threads on one queue (sched_queue.c), and one list of tasks that are over.
 *
 * The model: a task waits, or runs, or is over, or is its submitter's. The mutex guards all of it. A worker takes
 * the task that the queue says is next; memory is taken from the ledger under the same mutex, so that the first in
 * the queue cannot lose a race for bytes that were just given back. The loop hears of ends and of starvation
 * through an eventfd. Sched never waits for memory while holding some.
 *
 * Tasks are not interrupted. Where all workers are busy with lengthy ones (a file that is read, a segment that is
 * sealed), a few spare threads take what is short, and one task of each user who has no worker: the machine shares
 * its cores between them then, which is better than waiting for hours.
 */
#include "sched_pool.h"

#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "clock.h"
#include "err.h"
#include "ledger.h"
#include "lock.h"
#include "sched_queue.h"
#include "thread.h"

enum { SPARES = 2 };

/* Tasks do not recurse: what of a stack is ever touched is less than half of it (the largest frames are some tens of
 * kilobytes). A sanitizer's are many times that, and not the product's. */
#if defined __SANITIZE_ADDRESS__ || defined __SANITIZE_THREAD__
enum { STACK_BYTES = 8 << 20 };
#else
enum { STACK_BYTES = 256 << 10 };
#endif
enum { STACK_TOUCHED = 128 << 10, BUFFER_BYTES = 64 << 10 };

struct sched {
	struct lock lock;
	pthread_cond_t wake, wake_spare;
	struct ledger *ledger;
	struct sched_queue *queue;
	struct sched_task *over, **over_end;
	pthread_t *thread;
	unsigned threads, started; /* started: with spares, which come after the others */
	unsigned lengthy;          /* workers that are not spare and have such a task */
	unsigned busy;
	uint64_t starved;
	int event;
	bool stop;
};

struct worker {
	struct sched *sched;
	bool spare;
	bool tells; /* the loop, what it has not been told yet */
};

static void notify(struct sched *s)
{
	uint64_t one = 1;

	/* The counter cannot overflow; a full one is readable anyway. */
	if (write(s->event, &one, sizeof one) < 0)
		return;
}

/* The loop is told by whoever calls, once the lock is open. */
static void over_add(struct sched *s, struct sched_task *t)
{
	t->next = NULL;
	*s->over_end = t;
	s->over_end = &t->next;
}

/* Unlocks, then wakes regular and spare workers. */
static void leave_waking_all(struct sched *s)
{
	bool spare = s->lengthy == s->threads;

	lock_give(&s->lock);
	pthread_cond_broadcast(&s->wake);
	if (spare)
		pthread_cond_broadcast(&s->wake_spare);
}

static struct sched_task *take(struct worker *w)
{
	struct sched *s = w->sched;
	struct sched_task *t;
	uint64_t starved;

	if (w->spare && s->lengthy < s->threads && !s->stop)
		return NULL;
	t = sched_queue_take(s->queue, w->spare && !s->stop);
	starved = sched_queue_starved(s->queue);
	w->tells |= starved && s->starved != starved;
	s->starved = starved;
	return t;
}

/* Opens the lock. Whoever is woken wants it first of all. */
static void leave(struct worker *w)
{
	lock_give(&w->sched->lock);
	if (w->tells)
		notify(w->sched);
	w->tells = false;
}

static void run(struct worker *w, struct sched_task *t)
{
	struct sched *s = w->sched;
	bool lengthy = t->lengthy && !w->spare, spare;
	uint64_t begun;

	s->lengthy += lengthy;
	spare = lengthy && s->lengthy == s->threads;
	leave(w);
	if (spare)
		pthread_cond_broadcast(&s->wake_spare);
	begun = clock_mono_ns();
	t->ran = true;
	t->run(t);
	lock_take(&s->lock);
	s->lengthy -= lengthy;
	sched_queue_over(s->queue, t, clock_mono_ns() - begun);
	over_add(s, t);
	w->tells = true;
}

static void *work(void *arg)
{
	struct worker w = *(struct worker *)arg;
	struct sched *s = w.sched;

	free(arg);
	thread_mark_helper();
	lock_take(&s->lock);
	for (;;) {
		struct sched_task *t = take(&w);

		if (t) {
			run(&w, t);
		} else if (w.tells) {
			/* Before it sleeps; something may have come meanwhile. */
			leave(&w);
			lock_take(&s->lock);
		} else if (s->stop && sched_queue_empty(s->queue)) {
			break;
		} else {
			lock_wait(&s->lock, w.spare ? &s->wake_spare : &s->wake);
		}
	}
	lock_give(&s->lock);
	return NULL;
}

uint64_t sched_thread_bytes(unsigned threads)
{
	return (uint64_t)(threads + SPARES) * (STACK_TOUCHED + BUFFER_BYTES);
}

/* Signals are the loop's: workers are started with all of them blocked. */
static int start(struct sched *s, struct err *err)
{
	pthread_attr_t attr;
	sigset_t all, old;
	int r = 0;

	pthread_attr_init(&attr);
	pthread_attr_setstacksize(&attr, STACK_BYTES);
	sigfillset(&all);
	pthread_sigmask(SIG_SETMASK, &all, &old);
	while (s->started < s->threads + SPARES) {
		struct worker *w = malloc(sizeof *w);

		if (!w) {
			r = ENOMEM;
			break;
		}
		*w = (struct worker){.sched = s, .spare = s->started >= s->threads};
		r = pthread_create(&s->thread[s->started], &attr, work, w);
		if (r) {
			free(w);
			break;
		}
		s->started++;
	}
	pthread_sigmask(SIG_SETMASK, &old, NULL);
	pthread_attr_destroy(&attr);
	if (!r)
		return 0;
	err_sys(err, r, "cannot start a worker thread, the %u. of %u", s->started + 1, s->threads + SPARES);
	return r == EAGAIN ? err_add_hint(err, "give fewer --threads, or allow more tasks (TasksMax= of the unit, ulimit -u)") :
			     -(int)err->code;
}

int sched_new(struct ledger *ledger, unsigned threads, struct sched **ret, struct err *err)
{
	struct sched *s = calloc(1, sizeof *s);
	int r;

	if (!s)
		return err_set(err, ERR_NOMEM, "no memory for the scheduler");
	lock_init(&s->lock, LOCK_SCHED);
	pthread_cond_init(&s->wake, NULL);
	pthread_cond_init(&s->wake_spare, NULL);
	s->ledger = ledger;
	s->over_end = &s->over;
	s->threads = threads;
	s->thread = calloc(threads + SPARES, sizeof *s->thread);
	s->queue = sched_queue_new(ledger);
	s->event = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (!s->thread || !s->queue)
		r = err_set(err, ERR_NOMEM, "no memory for %u threads", threads);
	else if (s->event < 0)
		r = err_sys(err, errno, "cannot make an eventfd");
	else
		r = start(s, err);
	if (r) {
		sched_free(s);
		return r;
	}
	*ret = s;
	return 0;
}

static void cancel_all(struct sched *s)
{
	struct sched_task *t;

	lock_take(&s->lock);
	while ((t = sched_queue_first(s->queue))) {
		sched_queue_remove(s->queue, t);
		atomic_store(&t->cancel, true);
		over_add(s, t);
	}
	for (t = sched_queue_running(s->queue); t; t = t->next)
		atomic_store(&t->cancel, true);
	lock_give(&s->lock);
	notify(s);
}

struct sched *sched_free(struct sched *s)
{
	unsigned i;

	if (!s)
		return NULL;
	if (s->queue)
		cancel_all(s);
	lock_take(&s->lock);
	s->stop = true;
	pthread_cond_broadcast(&s->wake);
	pthread_cond_broadcast(&s->wake_spare);
	lock_give(&s->lock);
	for (i = 0; i < s->started; i++)
		pthread_join(s->thread[i], NULL);
	if (s->event >= 0) {
		sched_dispatch(s);
		close(s->event);
	}
	pthread_cond_destroy(&s->wake);
	pthread_cond_destroy(&s->wake_spare);
	lock_done(&s->lock);
	free(s->thread);
	sched_queue_free(s->queue);
	free(s);
	return NULL;
}

void sched_submit(struct sched *s, struct sched_task *t)
{
	bool over, spare;

	lock_take(&s->lock);
	t->ran = t->took = false;
	s->busy++;
	over = s->stop || atomic_load(&t->cancel);
	spare = s->lengthy == s->threads;
	if (over)
		over_add(s, t);
	else
		sched_queue_add(s->queue, t);
	lock_give(&s->lock);
	if (over) {
		notify(s);
		return;
	}
	pthread_cond_signal(&s->wake);
	if (spare)
		pthread_cond_signal(&s->wake_spare);
}

void sched_cancel(struct sched *s, struct sched_task *t)
{
	bool waited;

	lock_take(&s->lock);
	atomic_store(&t->cancel, true);
	waited = sched_queue_remove(s->queue, t);
	if (!waited) {
		lock_give(&s->lock);
		return;
	}
	over_add(s, t);
	/* Others may have waited behind it. */
	leave_waking_all(s);
	notify(s);
}

int sched_fd(const struct sched *s)
{
	return s->event;
}

unsigned sched_dispatch(struct sched *s)
{
	unsigned n = 0;
	uint64_t count;

	if (read(s->event, &count, sizeof count) < 0)
		count = 0;
	for (;;) {
		struct sched_task *t;

		lock_take(&s->lock);
		t = s->over;
		if (t) {
			s->over = t->next;
			if (!s->over)
				s->over_end = &s->over;
			s->busy--;
		}
		lock_give(&s->lock);
		if (!t)
			return n;
		t->took = false;
		t->done(t);
		n++;
	}
}

uint64_t sched_taken(struct sched *s, const struct sched_task *t)
{
	uint64_t bytes;

	lock_take(&s->lock);
	bytes = t->took ? t->bytes : 0;
	lock_give(&s->lock);
	return bytes;
}

void sched_give(struct sched *s, enum ledger_name name, uint64_t bytes)
{
	lock_take(&s->lock);
	if (bytes)
		ledger_give(s->ledger, name, bytes);
	leave_waking_all(s);
}

uint64_t sched_starved(struct sched *s)
{
	uint64_t starved;

	lock_take(&s->lock);
	starved = s->starved;
	lock_give(&s->lock);
	return starved;
}

int64_t sched_service(struct sched *s, uint32_t uid)
{
	int64_t service;

	lock_take(&s->lock);
	service = sched_queue_service(s->queue, uid);
	lock_give(&s->lock);
	return service;
}

void sched_flow(struct sched *s, uint64_t flow, struct sched_flow *ret)
{
	lock_take(&s->lock);
	sched_queue_flow(s->queue, flow, ret);
	lock_give(&s->lock);
}

unsigned sched_threads(const struct sched *s)
{
	return s->threads;
}

bool sched_others_wait(struct sched *s, uint64_t flow)
{
	bool wait;

	lock_take(&s->lock);
	wait = sched_queue_others_wait(s->queue, flow);
	lock_give(&s->lock);
	return wait;
}

unsigned sched_busy(struct sched *s)
{
	unsigned busy;

	lock_take(&s->lock);
	busy = s->busy;
	lock_give(&s->lock);
	return busy;
}
