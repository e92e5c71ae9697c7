/*
 * The scheduler: worker threads on one queue (sched_queue.c), and one list of tasks that have ended.
 *
 * The model: a task belongs to its submitter, or it waits, runs, or has ended. One lock guards these states. A worker takes the
 * task that the queue says is next. Memory is taken from the ledger under the same lock, so the first task in the queue cannot
 * lose a race for bytes that just came free. An eventfd wakes the loop when a task ends or lacks memory. The scheduler never
 * waits for memory while holding some.
 *
 * Tasks are not interrupted. If all workers run lengthy tasks (reading a file, sealing a segment), a few spare threads run short
 * tasks, and one task of each user without a running one. The machine then shares its cores, which is better than waiting for
 * hours.
 *
 * A task that reads a client's file may hang for ever. When the loop says so (sched_hold), a new thread takes the place of its
 * thread, which ends with the task. If the file gives something after all (sched_release), the task has its place again, and the
 * next thread without a task ends.
 */
#include "sched_pool.h"

#include <assert.h>
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

/* Tasks do not recurse, and touch less than half of their stack (the largest frames have some tens of kilobytes). Frames of a
 * sanitizer are many times as large. */
#if defined __SANITIZE_ADDRESS__ || defined __SANITIZE_THREAD__
enum { STACK_BYTES = 8 << 20 };
#else
enum { STACK_BYTES = 256 << 10 };
#endif
enum { STACK_TOUCHED = 128 << 10, BUFFER_BYTES = 64 << 10, THREAD_BYTES = STACK_TOUCHED + BUFFER_BYTES };

struct place {
	pthread_t thread;
	enum { PLACE_EMPTY, PLACE_TAKEN, PLACE_LEFT } state; /* left: its thread is ending */
};

struct sched {
	struct lock lock;
	pthread_cond_t wake, wake_spare;
	struct ledger *ledger;
	struct sched_queue *queue;
	struct sched_task *ended, **ended_end;
	struct place *place; /* of threads: regular and spare ones, and those of held tasks */
	unsigned threads;
	unsigned lengthy;  /* regular workers that run a lengthy task, and have their place */
	unsigned held;     /* tasks */
	unsigned extra[2]; /* regular and spare threads that are to end, since the tasks have their places again */
	unsigned busy;
	uint64_t starved;
	int event;
	bool stop;
};

struct worker {
	struct sched *sched;
	struct place *place;
	bool spare;
	bool pending_notice; /* something that the loop is not yet notified of */
};

static void notify_loop(struct sched *s)
{
	uint64_t one = 1;

	/* The counter cannot overflow; a full one is readable anyway. */
	if (write(s->event, &one, sizeof one) < 0)
		return;
}

/* The caller notifies the loop when it has released the lock. */
static void add_ended(struct sched *s, struct sched_task *t)
{
	assert(lock_held(LOCK_SCHED) && (t->state == SCHED_TASK_WAITING || t->state == SCHED_TASK_RUNNING));
	t->state = SCHED_TASK_ENDED;
	t->next = NULL;
	*s->ended_end = t;
	s->ended_end = &t->next;
}

/* Releases the lock, then wakes regular and spare workers. */
static void unlock_and_wake_all(struct sched *s)
{
	bool spare = s->lengthy >= s->threads;

	lock_give(&s->lock);
	pthread_cond_broadcast(&s->wake);
	if (spare)
		pthread_cond_broadcast(&s->wake_spare);
}

static struct sched_task *take_task(struct worker *w)
{
	struct sched *s = w->sched;
	struct sched_task *t;
	uint64_t starved;

	if (w->spare && s->lengthy < s->threads && !s->stop)
		return NULL;
	t = sched_queue_take(s->queue, w->spare && !s->stop);
	starved = sched_queue_starved(s->queue);
	w->pending_notice |= starved && s->starved != starved;
	s->starved = starved;
	return t;
}

/* Releases the lock before it wakes the loop, which takes it first. */
static void unlock_and_notify(struct worker *w)
{
	lock_give(&w->sched->lock);
	if (w->pending_notice)
		notify_loop(w->sched);
	w->pending_notice = false;
}

/* False: its place was taken meanwhile. */
static bool run_task(struct worker *w, struct sched_task *t)
{
	struct sched *s = w->sched;
	bool lengthy = t->lengthy && !w->spare, spare, held;
	uint64_t begun;

	assert(t->state == SCHED_TASK_WAITING);
	t->state = SCHED_TASK_RUNNING;
	t->seen_ns = clock_mono_ns();
	t->spare = w->spare;
	s->lengthy += lengthy;
	spare = lengthy && s->lengthy >= s->threads;
	unlock_and_notify(w);
	if (spare)
		pthread_cond_broadcast(&s->wake_spare);
	begun = clock_mono_ns();
	t->ran = true;
	t->run(t);
	lock_take(&s->lock);
	held = t->held;
	s->held -= held;
	s->lengthy -= lengthy && !held;
	/* The time in which it was held was nobody's. */
	sched_queue_over(s->queue, t, (held ? t->held_ns : clock_mono_ns()) - begun - t->nobodys_ns);
	add_ended(s, t);
	w->pending_notice = true;
	return !held;
}

/* The thread of a task that was held ends, or one too many. */
static void leave(struct worker *w)
{
	struct sched *s = w->sched;

	assert(lock_held(LOCK_SCHED));
	w->place->state = PLACE_LEFT;
	ledger_give(s->ledger, LEDGER_THREAD, THREAD_BYTES);
	/* Others may have waited for these bytes, or for the end of this task. */
	pthread_cond_broadcast(&s->wake);
	pthread_cond_broadcast(&s->wake_spare);
	unlock_and_notify(w);
}

static void *worker_main(void *arg)
{
	struct worker w = *(struct worker *)arg;
	struct sched *s = w.sched;

	free(arg);
	thread_mark_helper();
	lock_take(&s->lock);
	for (;;) {
		struct sched_task *t = s->extra[w.spare] ? NULL : take_task(&w);

		if (t && run_task(&w, t))
			continue;
		if (t || s->extra[w.spare]) {
			s->extra[w.spare] -= !t;
			leave(&w);
			return NULL;
		}
		if (w.pending_notice) {
			/* Notify before sleeping; a task may have come meanwhile, so look again. */
			unlock_and_notify(&w);
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
	return (uint64_t)(threads + SPARES) * THREAD_BYTES;
}

static struct place *free_place(struct sched *s)
{
	for (struct place *at = s->place; at < s->place + s->threads + SPARES + SCHED_HELD_MAX; at++) {
		if (at->state == PLACE_LEFT) {
			pthread_join(at->thread, NULL); /* it needs nothing any more */
			at->state = PLACE_EMPTY;
		}
		if (at->state == PLACE_EMPTY)
			return at;
	}
	return NULL;
}

/* Returns an errno. Workers block all signals, so the loop gets them. */
static int start_thread(struct sched *s, bool spare)
{
	struct place *place = free_place(s);
	struct worker *w = place ? malloc(sizeof *w) : NULL;
	pthread_attr_t attr;
	sigset_t all, old;
	int r;

	if (!w)
		return ENOMEM;
	*w = (struct worker){.sched = s, .place = place, .spare = spare};
	pthread_attr_init(&attr);
	pthread_attr_setstacksize(&attr, STACK_BYTES);
	sigfillset(&all);
	pthread_sigmask(SIG_SETMASK, &all, &old);
	r = pthread_create(&place->thread, &attr, worker_main, w);
	pthread_sigmask(SIG_SETMASK, &old, NULL);
	pthread_attr_destroy(&attr);
	if (r)
		free(w);
	else
		place->state = PLACE_TAKEN;
	return r;
}

static int start_threads(struct sched *s, struct err *err)
{
	unsigned n = 0;
	int r = 0;

	lock_take(&s->lock);
	while (!r && n < s->threads + SPARES) {
		r = start_thread(s, n >= s->threads);
		n += !r;
	}
	lock_give(&s->lock);
	if (!r)
		return 0;
	err_sys(err, r, "cannot start a worker thread, the %u. of %u", n + 1, s->threads + SPARES);
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
	s->ended_end = &s->ended;
	s->threads = threads;
	s->place = calloc(threads + SPARES + SCHED_HELD_MAX, sizeof *s->place);
	s->queue = sched_queue_new(ledger);
	s->event = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (!s->place || !s->queue)
		r = err_set(err, ERR_NOMEM, "no memory for %u threads", threads);
	else if (s->event < 0)
		r = err_sys(err, errno, "cannot make an eventfd");
	else
		r = start_threads(s, err);
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
		add_ended(s, t);
	}
	for (t = sched_queue_running(s->queue); t; t = t->next)
		atomic_store(&t->cancel, true);
	lock_give(&s->lock);
	notify_loop(s);
}

struct sched *sched_free(struct sched *s)
{
	unsigned i;

	THREAD_LOOP_ONLY();
	if (!s)
		return NULL;
	if (s->queue)
		cancel_all(s);
	lock_take(&s->lock);
	s->stop = true;
	pthread_cond_broadcast(&s->wake);
	pthread_cond_broadcast(&s->wake_spare);
	lock_give(&s->lock);
	for (i = 0; s->place && i < s->threads + SPARES + SCHED_HELD_MAX; i++)
		if (s->place[i].state != PLACE_EMPTY)
			pthread_join(s->place[i].thread, NULL);
	if (s->event >= 0) {
		sched_dispatch(s);
		close(s->event);
	}
	pthread_cond_destroy(&s->wake);
	pthread_cond_destroy(&s->wake_spare);
	lock_done(&s->lock);
	free(s->place);
	sched_queue_free(s->queue);
	free(s);
	return NULL;
}

void sched_submit(struct sched *s, struct sched_task *t)
{
	bool refused, spare;

	lock_take(&s->lock);
	assert(t->state == SCHED_TASK_IDLE);
	t->state = SCHED_TASK_WAITING;
	t->ran = t->took = t->held = false;
	t->nobodys_ns = 0;
	t->beats_seen = 0;
	atomic_store(&t->beats, 0);
	s->busy++;
	refused = s->stop || atomic_load(&t->cancel);
	spare = s->lengthy >= s->threads;
	if (refused)
		add_ended(s, t);
	else
		sched_queue_add(s->queue, t);
	lock_give(&s->lock);
	if (refused) {
		notify_loop(s);
		return;
	}
	pthread_cond_signal(&s->wake);
	if (spare)
		pthread_cond_signal(&s->wake_spare);
}

void sched_cancel(struct sched *s, struct sched_task *t)
{
	bool waited;

	THREAD_LOOP_ONLY();
	lock_take(&s->lock);
	atomic_store(&t->cancel, true);
	waited = sched_queue_remove(s->queue, t);
	if (!waited) {
		lock_give(&s->lock);
		return;
	}
	add_ended(s, t);
	/* Tasks may have waited behind it. */
	unlock_and_wake_all(s);
	notify_loop(s);
}

int sched_fd(const struct sched *s)
{
	return s->event;
}

unsigned sched_dispatch(struct sched *s)
{
	unsigned n = 0;
	uint64_t count;

	THREAD_LOOP_ONLY();
	if (read(s->event, &count, sizeof count) < 0)
		count = 0;
	for (;;) {
		struct sched_task *t;

		lock_take(&s->lock);
		t = s->ended;
		if (t) {
			s->ended = t->next;
			if (!s->ended)
				s->ended_end = &s->ended;
			s->busy--;
			assert(t->state == SCHED_TASK_ENDED);
			t->state = SCHED_TASK_IDLE;
		}
		lock_give(&s->lock);
		if (!t)
			return n;
		t->took = false;
		t->done(t);
		n++;
	}
}

/* One that was to end stays. */
static bool another_thread(struct sched *s, bool spare)
{
	if (s->extra[spare]) {
		s->extra[spare]--;
		return true;
	}
	if (s->held + s->extra[0] + s->extra[1] >= SCHED_HELD_MAX || !ledger_take(s->ledger, LEDGER_THREAD, THREAD_BYTES))
		return false;
	if (!start_thread(s, spare))
		return true;
	ledger_give(s->ledger, LEDGER_THREAD, THREAD_BYTES);
	return false;
}

/* Under the lock. */
static void hold_task(struct sched *s, struct sched_task *t)
{
	if (!another_thread(s, t->spare))
		return;
	t->held = true;
	t->held_ns = clock_mono_ns();
	s->held++;
	s->lengthy -= t->lengthy && !t->spare;
}

unsigned sched_hold(struct sched *s, uint64_t flow)
{
	const struct sched_task *first = NULL;
	unsigned n = 0;
	bool may;

	THREAD_LOOP_ONLY();
	lock_take(&s->lock);
	for (struct sched_task *t = sched_queue_running(s->queue); t && !first; t = t->next)
		first = t->owner.flow == flow ? t : NULL;
	may = first && (first->held || !sched_queue_hangs(s->queue, &first->owner));
	for (struct sched_task *t = sched_queue_running(s->queue); t; t = t->next) {
		if (t->owner.flow != flow || !t->reads)
			continue;
		if (!t->held && may)
			hold_task(s, t);
		n += t->held;
	}
	lock_give(&s->lock);
	return n;
}

/* Under the lock. */
static void release_task(struct sched *s, struct sched_task *t)
{
	t->held = false;
	t->nobodys_ns += clock_mono_ns() - t->held_ns;
	s->held--;
	s->extra[t->spare]++;
	s->lengthy += t->lengthy && !t->spare;
}

/* For the threads that are to end, and tasks that may start now. */
static void unlock_and_wake_every(struct sched *s)
{
	lock_give(&s->lock);
	pthread_cond_broadcast(&s->wake);
	pthread_cond_broadcast(&s->wake_spare);
}

void sched_release(struct sched *s, uint64_t flow)
{
	THREAD_LOOP_ONLY();
	lock_take(&s->lock);
	for (struct sched_task *t = sched_queue_running(s->queue); t; t = t->next)
		if (t->owner.flow == flow && t->held)
			release_task(s, t);
	unlock_and_wake_every(s);
}

void sched_watch(struct sched *s, double seconds)
{
	bool released = false;

	THREAD_LOOP_ONLY();
	lock_take(&s->lock);
	for (struct sched_task *t = sched_queue_running(s->queue); t; t = t->next) {
		unsigned beats = atomic_load(&t->beats);

		if (t->watched && beats != t->beats_seen) {
			t->beats_seen = beats;
			t->seen_ns = clock_mono_ns();
			released |= t->held;
			if (t->held)
				release_task(s, t);
		} else if (t->watched && !t->held && clock_since(t->seen_ns) >= seconds &&
			   !sched_queue_hangs(s->queue, &t->owner)) {
			hold_task(s, t);
		}
	}
	if (released)
		unlock_and_wake_every(s);
	else
		lock_give(&s->lock);
}

unsigned sched_hanging(struct sched *s, const struct sched_owner *owner)
{
	unsigned n;

	lock_take(&s->lock);
	n = sched_queue_hanging(s->queue, owner);
	lock_give(&s->lock);
	return n;
}

unsigned sched_extra_threads(struct sched *s)
{
	unsigned n;

	lock_take(&s->lock);
	n = s->held + s->extra[0] + s->extra[1];
	lock_give(&s->lock);
	return n;
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
	unlock_and_wake_all(s);
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

	THREAD_LOOP_ONLY();
	lock_take(&s->lock);
	service = sched_queue_service(s->queue, uid);
	lock_give(&s->lock);
	return service;
}

void sched_flow(struct sched *s, uint64_t flow, struct sched_flow *ret)
{
	THREAD_LOOP_ONLY();
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
