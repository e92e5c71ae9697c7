/*
 * The catalogue on SQLite.
 *
 * The model: before catalogue_start the calling thread owns the database, afterwards only the catalogue's thread does. A change
 * is a row of the statement table with copies of its values. Changes are made in the order in which they were queued. Each is a
 * transaction, and durable when its `done` is called. The heap of SQLite is bounded and charged as a whole; nothing is cached for
 * readers. A row that could not be removed is removed before the next change, since it may occupy a name. If that never succeeds,
 * the next start finds the row without any files.
 */
#include "catalogue_priv.h"

#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "err.h"
#include "ledger.h"
#include "log.h"
#include "thread.h"

static int charge_heap(struct catalogue *c, struct err *err)
{
	c->heap = c->ledger && ledger_take(c->ledger, LEDGER_CATALOGUE, CATALOGUE_HEAP);
	return !c->ledger || c->heap ? 0 : err_set(err, ERR_LIMIT, "the memory has no room for the catalogue");
}

int catalogue_new(const char *path, struct ledger *ledger, struct catalogue **ret, struct err *err)
{
	struct catalogue *c = calloc(1, sizeof *c);
	int r;

	if (!c)
		return err_set(err, ERR_NOMEM, "no memory for the catalogue");
	lock_init(&c->lock, LOCK_CATALOGUE);
	pthread_cond_init(&c->wake, NULL);
	pthread_cond_init(&c->written, NULL);
	c->ledger = ledger;
	c->path = strdup(path);
	c->queued_end = &c->queued;
	c->ended_end = &c->ended;
	c->event = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (c->event < 0)
		r = err_sys(err, errno, "cannot make an eventfd");
	else
		r = c->path ? charge_heap(c, err) : err_set(err, ERR_NOMEM, "no memory for the catalogue");
	c->starting = true;
	if (!r)
		r = catalogue_open(c, path, err);
	c->starting = false;
	if (r) {
		err_add_file(err, path);
		catalogue_free(c);
		return r;
	}
	*ret = c;
	return 0;
}

/* After a start that failed, nobody writes what was queued. */
static void discard_queued(struct catalogue *c)
{
	struct change *ch;

	while ((ch = c->queued)) {
		c->queued = ch->next;
		if (ch->charged)
			ledger_give(c->ledger, LEDGER_CATALOGUE, ch->charged);
		catalogue_change_free(ch);
	}
}

struct catalogue *catalogue_free(struct catalogue *c)
{
	struct err ignored = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (!c)
		return NULL;
	if (c->check)
		catalogue_check_end(c, &ignored);
	if (c->started) {
		lock_take(&c->lock);
		c->stop = true;
		pthread_cond_signal(&c->wake);
		lock_give(&c->lock);
		pthread_join(c->thread, NULL);
		catalogue_dispatch(c);
	}
	discard_queued(c);
	catalogue_close(c);
	if (c->event >= 0)
		close(c->event);
	if (c->heap)
		ledger_give(c->ledger, LEDGER_CATALOGUE, CATALOGUE_HEAP);
	pthread_cond_destroy(&c->wake);
	pthread_cond_destroy(&c->written);
	lock_done(&c->lock);
	free(c->path);
	free(c);
	return NULL;
}

/* ---- the thread ---- */

static int bind_and_step(struct catalogue *c, sqlite3_stmt *s, const struct value *v, unsigned n, struct err *err)
{
	int r = SQLITE_OK;

	for (unsigned i = 0; i < n && r == SQLITE_OK; i++)
		r = v[i].kind == VALUE_TEXT ? sqlite3_bind_text(s, (int)i + 1, v[i].text, -1, SQLITE_STATIC) :
					      sqlite3_bind_int64(s, (int)i + 1, v[i].number);
	if (r == SQLITE_OK && n > 1)
		r = sqlite3_bind_int64(s, (int)n + 1, catalogue_sum(v, n));
	if (r == SQLITE_OK)
		r = sqlite3_step(s);
	if (r != SQLITE_DONE) {
		r = catalogue_failed(c, err, "the catalogue cannot be written");
	} else {
		r = 0;
	}
	sqlite3_reset(s);
	sqlite3_clear_bindings(s);
	return r;
}

static int make_change(struct catalogue *c, struct change *ch, struct err *err)
{
	struct value push = {.kind = VALUE_NUMBER, .number = (int64_t)ch->drop_push};
	int r;

	if (ch->sql == CATALOGUE_CHECK)
		return catalogue_verify(c, err);
	if (!ch->drop_push)
		return bind_and_step(c, c->stmt[ch->sql], ch->value, ch->n, err);
	r = catalogue_run(c, "BEGIN IMMEDIATE", err);
	if (r)
		return r;
	r = bind_and_step(c, c->stmt[ch->sql], ch->value, ch->n, err);
	if (!r)
		r = bind_and_step(c, c->stmt[CATALOGUE_DROP_PUSH], &push, 1, err);
	if (!r)
		r = catalogue_run(c, "COMMIT", err);
	if (r)
		sqlite3_exec(c->db, "ROLLBACK", NULL, NULL, NULL);
	return r;
}

static bool is_drop(const struct change *ch)
{
	return ch->sql == CATALOGUE_DROP_DATASET || ch->sql == CATALOGUE_DROP_PUSH || ch->sql == CATALOGUE_DROP_JOB;
}

static void add_failed_drop(struct catalogue *c, const struct change *ch, const struct err *why)
{
	if (!c->nfailed_drops)
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL, "a row cannot be removed now", why);
	if (c->nfailed_drops < FAILED_DROPS)
		c->failed_drop[c->nfailed_drops++] = (struct failed_drop){ch->sql, ch->value[0].number};
}

/* Removes these rows in order, until one fails again. */
static void retry_failed_drops(struct catalogue *c)
{
	struct err ignored = ERR_INIT; /* it was logged when the row was added to the list */
	unsigned n = 0;

	while (n < c->nfailed_drops) {
		const struct value id = {.kind = VALUE_NUMBER, .number = c->failed_drop[n].id};

		if (bind_and_step(c, c->stmt[c->failed_drop[n].sql], &id, 1, &ignored))
			break;
		n++;
	}
	c->nfailed_drops -= n;
	memmove(c->failed_drop, c->failed_drop + n, c->nfailed_drops * sizeof *c->failed_drop);
}

/* Once written, a change needs no texts; only its result waits for the loop. */
static void finish_change(struct catalogue *c, struct change *ch, const struct err *why)
{
	for (unsigned i = 0; i < ch->n; i++)
		free(ch->value[i].text);
	ch->n = 0;
	if (ch->r && (ch->err = malloc(sizeof *ch->err)))
		*ch->err = *why;
	if (ch->charged)
		ledger_give(c->ledger, LEDGER_CATALOGUE, ch->charged);
}

static void *catalogue_main(void *arg)
{
	struct catalogue *c = arg;

	thread_mark_helper();
	lock_take(&c->lock);
	for (;;) {
		struct change *ch = c->queued;
		uint64_t one = 1;

		if (!ch) {
			if (c->stop)
				break;
			lock_wait(&c->lock, &c->wake);
			continue;
		}
		c->queued = ch->next;
		if (!c->queued)
			c->queued_end = &c->queued;
		c->writing = true;
		lock_give(&c->lock);
		struct err why = ERR_INIT;

		ch->r = catalogue_reopen(c, &why);
		if (!ch->r) {
			retry_failed_drops(c);
			ch->r = make_change(c, ch, &why);
			if (c->io_failed)
				catalogue_after_error(c, ch, &why);
		}
		if (ch->r && is_drop(ch))
			add_failed_drop(c, ch, &why);
		finish_change(c, ch, &why);
		lock_take(&c->lock);
		c->writing = false;
		pthread_cond_signal(&c->written);
		ch->next = NULL;
		*c->ended_end = ch;
		c->ended_end = &ch->next;
		/* If the counter is full, it is readable anyway. */
		if (write(c->event, &one, sizeof one) < 0)
			continue;
	}
	lock_give(&c->lock);
	return NULL;
}

int catalogue_start(struct catalogue *c, struct err *err)
{
	THREAD_LOOP_ONLY();
	sigset_t all, old;
	int r;

	sigfillset(&all);
	pthread_sigmask(SIG_SETMASK, &all, &old);
	r = pthread_create(&c->thread, NULL, catalogue_main, c);
	pthread_sigmask(SIG_SETMASK, &old, NULL);
	if (r)
		return err_sys(err, r, "cannot start the catalogue's thread");
	c->started = true;
	return 0;
}

int catalogue_fd(const struct catalogue *c)
{
	return c->event;
}

unsigned catalogue_dispatch(struct catalogue *c)
{
	struct err nomem = ERR_INIT;
	unsigned n = 0;
	uint64_t count;

	THREAD_LOOP_ONLY();
	err_set(&nomem, ERR_NOMEM, "the catalogue cannot be written, and there is no memory to say why");
	if (read(c->event, &count, sizeof count) < 0)
		count = 0;
	for (;;) {
		struct change *ch;

		lock_take(&c->lock);
		ch = c->ended;
		if (ch) {
			c->ended = ch->next;
			if (!c->ended)
				c->ended_end = &c->ended;
			c->busy--;
		}
		lock_give(&c->lock);
		if (!ch)
			return n;
		if (ch->done)
			ch->done(ch->ctx, ch->r, ch->err ? ch->err : &nomem);
		catalogue_change_free(ch);
		n++;
	}
}

unsigned catalogue_busy(struct catalogue *c)
{
	unsigned busy;

	lock_take(&c->lock);
	busy = c->busy;
	lock_give(&c->lock);
	return busy;
}
