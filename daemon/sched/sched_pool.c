/*
 * The scheduler: one sorted queue, worker threads, one list of tasks that are over.
 *
 * The model: a task is in the queue, or runs, or is over, or is its submitter's. The mutex guards the three
 * lists. A worker takes the first task that may start; memory is taken from the ledger under the same mutex,
 * so that the first in the queue cannot lose a race for bytes that were just given back. The loop hears of
 * ends and of starvation through an eventfd. Sched never waits for memory while holding some.
 */
#include "sched_pool.h"

#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "err.h"
#include "ledger.h"

struct sched {
	pthread_mutex_t lock;
	pthread_cond_t wake;
	struct ledger *ledger;
	struct sched_task *queue; /* by priority, then order */
	struct sched_task *over, **over_end;
	struct sched_task **running; /* one place a thread, NULL: idle */
	pthread_t *thread;
	unsigned threads, started;
	unsigned busy;
	uint64_t order;
	uint64_t starved;
	int event;
	bool stop;
};

struct worker {
	struct sched *sched;
	unsigned place;
};

static void notify(struct sched *s)
{
	uint64_t one = 1;

	/* The counter cannot overflow; a full one is readable anyway. */
	if (write(s->event, &one, sizeof one) < 0)
		return;
}

static void over_add(struct sched *s, struct sched_task *t)
{
	t->next = NULL;
	*s->over_end = t;
	s->over_end = &t->next;
	notify(s);
}

/* The first task that may start, taken out of the queue with its memory; NULL if there is none. */
static struct sched_task *take(struct sched *s)
{
	struct sched_task **at;
	uint64_t starved = 0;

	for (at = &s->queue; *at; at = &(*at)->next) {
		struct sched_task *t = *at;

		if (t->bytes) {
			if (starved)
				continue;
			if (!ledger_take(s->ledger, t->name, t->bytes)) {
				starved = t->bytes;
				continue;
			}
		}
		*at = t->next;
		t->took = true;
		if (!starved)
			s->starved = 0;
		return t;
	}
	if (starved && s->starved != starved)
		notify(s);
	s->starved = starved;
	return NULL;
}

static void *work(void *arg)
{
	struct worker w = *(struct worker *)arg;
	struct sched *s = w.sched;

	free(arg);
	pthread_mutex_lock(&s->lock);
	for (;;) {
		struct sched_task *t = take(s);

		if (!t) {
			if (s->stop && !s->queue)
				break;
			pthread_cond_wait(&s->wake, &s->lock);
			continue;
		}
		s->running[w.place] = t;
		pthread_mutex_unlock(&s->lock);
		t->ran = true;
		t->run(t);
		pthread_mutex_lock(&s->lock);
		s->running[w.place] = NULL;
		over_add(s, t);
	}
	pthread_mutex_unlock(&s->lock);
	return NULL;
}

/* Signals are the loop's: workers are started with all of them blocked. */
static int start(struct sched *s, struct err *err)
{
	sigset_t all, old;
	int r = 0;

	sigfillset(&all);
	pthread_sigmask(SIG_SETMASK, &all, &old);
	while (s->started < s->threads) {
		struct worker *w = malloc(sizeof *w);

		if (!w) {
			r = ENOMEM;
			break;
		}
		*w = (struct worker){.sched = s, .place = s->started};
		r = pthread_create(&s->thread[s->started], NULL, work, w);
		if (r) {
			free(w);
			break;
		}
		s->started++;
	}
	pthread_sigmask(SIG_SETMASK, &old, NULL);
	return r ? err_sys(err, r, "cannot start a worker thread") : 0;
}

int sched_new(struct ledger *ledger, unsigned threads, struct sched **ret, struct err *err)
{
	struct sched *s = calloc(1, sizeof *s);
	int r;

	if (!s)
		return err_set(err, ERR_NOMEM, "no memory for the scheduler");
	pthread_mutex_init(&s->lock, NULL);
	pthread_cond_init(&s->wake, NULL);
	s->ledger = ledger;
	s->over_end = &s->over;
	s->threads = threads;
	s->thread = calloc(threads, sizeof *s->thread);
	s->running = calloc(threads, sizeof *s->running);
	s->event = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (!s->thread || !s->running)
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

struct sched *sched_free(struct sched *s)
{
	unsigned i;

	if (!s)
		return NULL;
	sched_cancel_all(s);
	pthread_mutex_lock(&s->lock);
	s->stop = true;
	pthread_cond_broadcast(&s->wake);
	pthread_mutex_unlock(&s->lock);
	for (i = 0; i < s->started; i++)
		pthread_join(s->thread[i], NULL);
	if (s->event >= 0) {
		sched_dispatch(s);
		close(s->event);
	}
	pthread_cond_destroy(&s->wake);
	pthread_mutex_destroy(&s->lock);
	free(s->thread);
	free(s->running);
	free(s);
	return NULL;
}

void sched_submit(struct sched *s, struct sched_task *t)
{
	struct sched_task **at;

	pthread_mutex_lock(&s->lock);
	t->ran = t->took = false;
	t->order = s->order++;
	s->busy++;
	if (s->stop || atomic_load(&t->cancel)) {
		over_add(s, t);
	} else {
		for (at = &s->queue; *at && (*at)->priority <= t->priority; at = &(*at)->next)
			;
		t->next = *at;
		*at = t;
		pthread_cond_signal(&s->wake);
	}
	pthread_mutex_unlock(&s->lock);
}

void sched_cancel(struct sched *s, struct sched_task *t)
{
	struct sched_task **at;

	pthread_mutex_lock(&s->lock);
	atomic_store(&t->cancel, true);
	for (at = &s->queue; *at; at = &(*at)->next)
		if (*at == t) {
			*at = t->next;
			over_add(s, t);
			/* Others may have waited behind it. */
			pthread_cond_broadcast(&s->wake);
			break;
		}
	pthread_mutex_unlock(&s->lock);
}

void sched_cancel_all(struct sched *s)
{
	unsigned i;

	pthread_mutex_lock(&s->lock);
	while (s->queue) {
		struct sched_task *t = s->queue;

		s->queue = t->next;
		atomic_store(&t->cancel, true);
		over_add(s, t);
	}
	for (i = 0; i < s->threads && s->running; i++)
		if (s->running[i])
			atomic_store(&s->running[i]->cancel, true);
	pthread_mutex_unlock(&s->lock);
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

		pthread_mutex_lock(&s->lock);
		t = s->over;
		if (t) {
			s->over = t->next;
			if (!s->over)
				s->over_end = &s->over;
			s->busy--;
		}
		pthread_mutex_unlock(&s->lock);
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

	pthread_mutex_lock(&s->lock);
	bytes = t->took ? t->bytes : 0;
	pthread_mutex_unlock(&s->lock);
	return bytes;
}

void sched_give(struct sched *s, enum ledger_name name, uint64_t bytes)
{
	pthread_mutex_lock(&s->lock);
	if (bytes)
		ledger_give(s->ledger, name, bytes);
	pthread_cond_broadcast(&s->wake);
	pthread_mutex_unlock(&s->lock);
}

uint64_t sched_starved(struct sched *s)
{
	uint64_t starved;

	pthread_mutex_lock(&s->lock);
	starved = s->starved;
	pthread_mutex_unlock(&s->lock);
	return starved;
}

unsigned sched_threads(const struct sched *s)
{
	return s->threads;
}

unsigned sched_busy(struct sched *s)
{
	unsigned busy;

	pthread_mutex_lock(&s->lock);
	busy = s->busy;
	pthread_mutex_unlock(&s->lock);
	return busy;
}
