/*
 * The catalogue on SQLite.
 *
 * The model: before catalogue_start the calling thread owns the database, afterwards only the catalogue's
 * thread does. A change is a row of the statement table with its values copied, so that a caller's texts may
 * go at once. Changes are made in the order in which they were queued; each is a transaction and is on disk
 * when its `done` is called. The heap of SQLite is bounded, and charged whole; the catalogue never caches for
 * readers. Changes that wait are charged too: who queues more than there is room for waits for the disk.
 */
#include "catalogue.h"

#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <sqlite3.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "catalogue_sql.h"
#include "err.h"
#include "ledger.h"

enum { VALUES = 17, MALLOC_OVERHEAD = 24 };

struct value {
	enum { VALUE_NUMBER, VALUE_TEXT } kind;
	int64_t number;
	char *text;
};

struct change {
	enum catalogue_sql sql;
	unsigned n;
	uint64_t drop_push; /* of put_dataset */
	catalogue_done_fn done;
	void *ctx;
	int r;
	struct err *err; /* if r; NULL: not even memory for that */
	size_t charged;
	struct change *next;
	struct value value[VALUES];
};

struct catalogue {
	sqlite3 *db;
	sqlite3_stmt *stmt[CATALOGUE_SQLS];
	pthread_mutex_t lock;
	pthread_cond_t wake, room; /* for the thread; for who waits to queue */
	pthread_t thread;
	struct ledger *ledger;
	bool heap; /* charged */
	bool started, stop, writing;
	struct change *todo, **todo_end, *over, **over_end;
	unsigned busy;
	int event;
};

static int failed(struct catalogue *c, struct err *err, const char *what)
{
	int code = sqlite3_extended_errcode(c->db) & 0xff;
	enum err_code as = code == SQLITE_FULL                               ? ERR_NOSPACE
			   : code == SQLITE_CORRUPT || code == SQLITE_NOTADB ? ERR_CORRUPT
			   : code == SQLITE_NOMEM                            ? ERR_NOMEM
			   : code == SQLITE_BUSY || code == SQLITE_LOCKED    ? ERR_BUSY
			   : code == SQLITE_PERM || code == SQLITE_READONLY  ? ERR_PERM
									     : ERR_IO;

	return err_set(err, as, "%s: %s", what, sqlite3_errmsg(c->db));
}

static int run_sql(struct catalogue *c, const char *sql, struct err *err)
{
	if (sqlite3_exec(c->db, sql, NULL, NULL, NULL) != SQLITE_OK)
		return failed(c, err, "the catalogue");
	return 0;
}

static int user_version(struct catalogue *c, int *ret, struct err *err)
{
	sqlite3_stmt *s;
	int r = sqlite3_prepare_v2(c->db, "PRAGMA user_version", -1, &s, NULL);

	if (r != SQLITE_OK || sqlite3_step(s) != SQLITE_ROW) {
		sqlite3_finalize(s);
		return failed(c, err, "the catalogue cannot be read");
	}
	*ret = sqlite3_column_int(s, 0);
	sqlite3_finalize(s);
	return 0;
}

static int open_db(struct catalogue *c, const char *path, struct err *err)
{
	int r, version = 0;

	/* Cached pages go before the heap is full; statements and texts of one change need far less than the rest. */
	sqlite3_soft_heap_limit64(CATALOGUE_HEAP - (CATALOGUE_HEAP >> 2));
	sqlite3_hard_heap_limit64(CATALOGUE_HEAP);
	if (sqlite3_open_v2(path, &c->db, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX,
			    NULL) != SQLITE_OK)
		return c->db ? failed(c, err, "the catalogue cannot be opened")
			     : err_set(err, ERR_NOMEM, "no memory for the catalogue");
	sqlite3_busy_timeout(c->db, 2000);
	r = user_version(c, &version, err);
	if (r)
		return r;
	if (version > CATALOGUE_VERSION) {
		err_set(err, ERR_VERSION, "the catalogue was written by a newer acutd: it has version %d, this one (%s) knows up to %d",
			version, ACUT_VERSION, CATALOGUE_VERSION);
		return err_add_hint(err, "use that acutd, or another state folder (--state; of private daemons XDG_STATE_HOME)");
	}
	r = run_sql(c, catalogue_sql_setup, err);
	if (!r && version == 1)
		r = run_sql(c, catalogue_sql_to_2, err);
	if (!r)
		r = run_sql(c, catalogue_sql_schema, err);
	for (int i = 0; !r && i < CATALOGUE_SQLS; i++)
		if (sqlite3_prepare_v3(c->db, catalogue_sql_text[i], -1, SQLITE_PREPARE_PERSISTENT,
				       &c->stmt[i], NULL) != SQLITE_OK)
			r = failed(c, err, "the catalogue");
	return r;
}

static int take_heap(struct catalogue *c, struct err *err)
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
	pthread_mutex_init(&c->lock, NULL);
	pthread_cond_init(&c->wake, NULL);
	pthread_cond_init(&c->room, NULL);
	c->ledger = ledger;
	c->todo_end = &c->todo;
	c->over_end = &c->over;
	c->event = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (c->event < 0)
		r = err_sys(err, errno, "cannot make an eventfd");
	else
		r = take_heap(c, err);
	if (!r)
		r = open_db(c, path, err);
	if (r) {
		err_add_file(err, path);
		catalogue_free(c);
		return r;
	}
	*ret = c;
	return 0;
}

struct catalogue *catalogue_free(struct catalogue *c)
{
	if (!c)
		return NULL;
	if (c->started) {
		pthread_mutex_lock(&c->lock);
		c->stop = true;
		pthread_cond_signal(&c->wake);
		pthread_mutex_unlock(&c->lock);
		pthread_join(c->thread, NULL);
		catalogue_dispatch(c);
	}
	for (int i = 0; i < CATALOGUE_SQLS; i++)
		sqlite3_finalize(c->stmt[i]);
	sqlite3_close(c->db);
	if (c->event >= 0)
		close(c->event);
	if (c->heap)
		ledger_give(c->ledger, LEDGER_CATALOGUE, CATALOGUE_HEAP);
	pthread_cond_destroy(&c->wake);
	pthread_cond_destroy(&c->room);
	pthread_mutex_destroy(&c->lock);
	free(c);
	return NULL;
}

/* ---- reading, before the start ---- */

static const char *text(sqlite3_stmt *s, int i)
{
	const char *t = (const char *)sqlite3_column_text(s, i);

	return t ? t : "";
}

static int read_dataset(sqlite3_stmt *s, const struct catalogue_reader *to, struct err *err)
{
	struct catalogue_dataset d = {
		.id = (uint64_t)sqlite3_column_int64(s, 0),
		.name = text(s, 1),
		.uid = (uint32_t)sqlite3_column_int64(s, 2),
		.created_us = sqlite3_column_int64(s, 3),
		.pushed_us = sqlite3_column_int64(s, 4),
		.manifest = text(s, 5),
		.generation = (uint64_t)sqlite3_column_int64(s, 6),
		.points = (uint64_t)sqlite3_column_int64(s, 7),
		.bytes = (uint64_t)sqlite3_column_int64(s, 8),
		.files = (uint32_t)sqlite3_column_int64(s, 9),
		.lattice = text(s, 10),
		.crs = text(s, 11),
		.unit_xy = text(s, 12),
		.unit_z = text(s, 13),
		.box = {(int32_t)(sqlite3_column_int64(s, 14) >> 32), (int32_t)sqlite3_column_int64(s, 14),
			(int32_t)(sqlite3_column_int64(s, 15) >> 32), (int32_t)sqlite3_column_int64(s, 15)},
	};

	return to->dataset(to->ctx, &d, err);
}

static int read_job(sqlite3_stmt *s, const struct catalogue_reader *to, struct err *err)
{
	struct catalogue_job j = {
		.id = (uint64_t)sqlite3_column_int64(s, 0),
		.dataset = (uint64_t)sqlite3_column_int64(s, 1),
		.generation = (uint64_t)sqlite3_column_int64(s, 2),
		.view = text(s, 3),
		.state = text(s, 4),
		.uid = (uint32_t)sqlite3_column_int64(s, 5),
		.pid = (uint32_t)sqlite3_column_int64(s, 6),
		.submitted_us = sqlite3_column_int64(s, 7),
		.finished_us = sqlite3_column_int64(s, 8),
		.report = text(s, 9),
		.error_code = text(s, 10),
		.error_message = text(s, 11),
		.error_file = text(s, 12),
		.error_field = text(s, 13),
		.error_hint = text(s, 14),
		.error_offset = sqlite3_column_int64(s, 15),
		.priority = (uint32_t)sqlite3_column_int64(s, 16),
	};

	return to->job(to->ctx, &j, err);
}

static int read_push(sqlite3_stmt *s, const struct catalogue_reader *to, struct err *err)
{
	struct catalogue_push p = {
		.id = (uint64_t)sqlite3_column_int64(s, 0),
		.dataset = (uint64_t)sqlite3_column_int64(s, 1),
		.uid = (uint32_t)sqlite3_column_int64(s, 2),
		.files = (uint32_t)sqlite3_column_int64(s, 3),
		.begun_us = sqlite3_column_int64(s, 4),
	};

	return to->push(to->ctx, &p, err);
}

static int read_last(sqlite3_stmt *s, const struct catalogue_reader *to, struct err *err)
{
	static const char *const names[3] = {"dataset", "job", "push"};
	uint64_t *last = to->ctx;

	for (int i = 0; i < 3; i++)
		if (!strcmp(text(s, 0), names[i]))
			last[i] = (uint64_t)sqlite3_column_int64(s, 1);
	return 0;
}

static int read_all(struct catalogue *c, const char *sql,
		    int (*row)(sqlite3_stmt *, const struct catalogue_reader *, struct err *),
		    const struct catalogue_reader *to, struct err *err)
{
	sqlite3_stmt *s;
	int r = 0, step;

	if (sqlite3_prepare_v2(c->db, sql, -1, &s, NULL) != SQLITE_OK)
		return failed(c, err, "the catalogue cannot be read");
	while (!r && (step = sqlite3_step(s)) != SQLITE_DONE)
		r = step == SQLITE_ROW ? row(s, to, err) : failed(c, err, "the catalogue cannot be read");
	sqlite3_finalize(s);
	return r;
}

int catalogue_load(struct catalogue *c, const struct catalogue_reader *to, uint64_t ret_last[3],
		   struct err *err)
{
	struct catalogue_reader last = {.ctx = ret_last};
	int r;

	ret_last[0] = ret_last[1] = ret_last[2] = 0;
	r = read_all(c, "SELECT name, seq FROM sqlite_sequence", read_last, &last, err);
	if (!r)
		r = read_all(c, catalogue_sql_datasets, read_dataset, to, err);
	if (!r)
		r = read_all(c, catalogue_sql_jobs, read_job, to, err);
	if (!r)
		r = read_all(c, catalogue_sql_pushes, read_push, to, err);
	return r;
}

/* ---- the thread ---- */

static int bind_and_step(struct catalogue *c, sqlite3_stmt *s, const struct value *v, unsigned n,
			 struct err *err)
{
	int r = SQLITE_OK;

	for (unsigned i = 0; i < n && r == SQLITE_OK; i++)
		r = v[i].kind == VALUE_TEXT ? sqlite3_bind_text(s, (int)i + 1, v[i].text, -1, SQLITE_STATIC)
					    : sqlite3_bind_int64(s, (int)i + 1, v[i].number);
	if (r == SQLITE_OK)
		r = sqlite3_step(s);
	if (r != SQLITE_DONE) {
		r = failed(c, err, "the catalogue cannot be written");
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

	if (!ch->drop_push)
		return bind_and_step(c, c->stmt[ch->sql], ch->value, ch->n, err);
	r = run_sql(c, "BEGIN IMMEDIATE", err);
	if (r)
		return r;
	r = bind_and_step(c, c->stmt[ch->sql], ch->value, ch->n, err);
	if (!r)
		r = bind_and_step(c, c->stmt[CATALOGUE_DROP_PUSH], &push, 1, err);
	if (!r)
		r = run_sql(c, "COMMIT", err);
	if (r)
		sqlite3_exec(c->db, "ROLLBACK", NULL, NULL, NULL);
	return r;
}

/* What was written needs its texts no more: only the answer waits for the loop. */
static void written(struct catalogue *c, struct change *ch, const struct err *why)
{
	for (unsigned i = 0; i < ch->n; i++)
		free(ch->value[i].text);
	ch->n = 0;
	if (ch->r && (ch->err = malloc(sizeof *ch->err)))
		*ch->err = *why;
	if (ch->charged)
		ledger_give(c->ledger, LEDGER_CATALOGUE, ch->charged);
}

static void *work(void *arg)
{
	struct catalogue *c = arg;

	pthread_mutex_lock(&c->lock);
	for (;;) {
		struct change *ch = c->todo;
		uint64_t one = 1;

		if (!ch) {
			if (c->stop)
				break;
			pthread_cond_wait(&c->wake, &c->lock);
			continue;
		}
		c->todo = ch->next;
		if (!c->todo)
			c->todo_end = &c->todo;
		c->writing = true;
		pthread_mutex_unlock(&c->lock);
		struct err why = ERR_INIT;

		ch->r = make_change(c, ch, &why);
		written(c, ch, &why);
		pthread_mutex_lock(&c->lock);
		c->writing = false;
		pthread_cond_signal(&c->room);
		ch->next = NULL;
		*c->over_end = ch;
		c->over_end = &ch->next;
		/* A full counter is readable anyway. */
		if (write(c->event, &one, sizeof one) < 0)
			continue;
	}
	pthread_mutex_unlock(&c->lock);
	return NULL;
}

int catalogue_start(struct catalogue *c, struct err *err)
{
	sigset_t all, old;
	int r;

	sigfillset(&all);
	pthread_sigmask(SIG_SETMASK, &all, &old);
	r = pthread_create(&c->thread, NULL, work, c);
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

static void change_free(struct change *ch)
{
	for (unsigned i = 0; i < ch->n; i++)
		free(ch->value[i].text);
	free(ch->err);
	free(ch);
}

unsigned catalogue_dispatch(struct catalogue *c)
{
	struct err nomem = ERR_INIT;
	unsigned n = 0;
	uint64_t count;

	err_set(&nomem, ERR_NOMEM, "the catalogue cannot be written, and there is no memory to say why");
	if (read(c->event, &count, sizeof count) < 0)
		count = 0;
	for (;;) {
		struct change *ch;

		pthread_mutex_lock(&c->lock);
		ch = c->over;
		if (ch) {
			c->over = ch->next;
			if (!c->over)
				c->over_end = &c->over;
			c->busy--;
		}
		pthread_mutex_unlock(&c->lock);
		if (!ch)
			return n;
		if (ch->done)
			ch->done(ch->ctx, ch->r, ch->err ? ch->err : &nomem);
		change_free(ch);
		n++;
	}
}

unsigned catalogue_busy(struct catalogue *c)
{
	unsigned busy;

	pthread_mutex_lock(&c->lock);
	busy = c->busy;
	pthread_mutex_unlock(&c->lock);
	return busy;
}

/* ---- changes ---- */

static struct change *change_new(enum catalogue_sql sql, catalogue_done_fn done, void *ctx)
{
	struct change *ch = calloc(1, sizeof *ch);

	if (ch) {
		ch->sql = sql;
		ch->done = done;
		ch->ctx = ctx;
	}
	return ch;
}

static void add_number(struct change *ch, int64_t number)
{
	if (ch)
		ch->value[ch->n++] = (struct value){.kind = VALUE_NUMBER, .number = number};
}

/* A text without memory leaves the change unusable: change_queue looks for it. */
static void add_text(struct change *ch, const char *t)
{
	if (ch)
		ch->value[ch->n++] = (struct value){.kind = VALUE_TEXT, .text = strdup(t ? t : "")};
}

/* Room among those that wait for the disk; locked. It comes when some are written: a slow disk slows down who asks
 * for more than it carries. */
static bool take_room(struct catalogue *c, struct change *ch)
{
	size_t bytes = sizeof *ch;

	if (!c->ledger)
		return true;
	for (unsigned i = 0; i < ch->n; i++)
		bytes += ch->value[i].kind == VALUE_TEXT ? strlen(ch->value[i].text) + MALLOC_OVERHEAD : 0;
	while (!ledger_take(c->ledger, LEDGER_CATALOGUE, bytes)) {
		if (!c->started || (!c->todo && !c->writing))
			return false;
		pthread_cond_wait(&c->room, &c->lock);
	}
	ch->charged = bytes;
	return true;
}

static int change_queue(struct catalogue *c, struct change *ch, struct err *err)
{
	if (!ch)
		return err_set(err, ERR_NOMEM, "no memory for a change of the catalogue");
	for (unsigned i = 0; i < ch->n; i++)
		if (ch->value[i].kind == VALUE_TEXT && !ch->value[i].text) {
			change_free(ch);
			return err_set(err, ERR_NOMEM, "no memory for a change of the catalogue");
		}
	pthread_mutex_lock(&c->lock);
	if (!take_room(c, ch)) {
		pthread_mutex_unlock(&c->lock);
		change_free(ch);
		return err_set(err, ERR_BUSY, "the memory has no room for a change of the catalogue");
	}
	*c->todo_end = ch;
	c->todo_end = &ch->next;
	c->busy++;
	pthread_cond_signal(&c->wake);
	pthread_mutex_unlock(&c->lock);
	return 0;
}

int catalogue_put_dataset(struct catalogue *c, const struct catalogue_dataset *d, uint64_t push,
			  catalogue_done_fn done, void *ctx, struct err *err)
{
	struct change *ch = change_new(CATALOGUE_PUT_DATASET, done, ctx);

	add_number(ch, (int64_t)d->id);
	add_text(ch, d->name);
	add_number(ch, d->uid);
	add_number(ch, d->created_us);
	add_number(ch, d->pushed_us);
	add_text(ch, d->manifest);
	add_number(ch, (int64_t)d->generation);
	add_number(ch, (int64_t)d->points);
	add_number(ch, (int64_t)d->bytes);
	add_number(ch, d->files);
	add_text(ch, d->lattice);
	add_text(ch, d->crs);
	add_text(ch, d->unit_xy);
	add_text(ch, d->unit_z);
	add_number(ch, (int64_t)((uint64_t)(uint32_t)d->box[0] << 32 | (uint32_t)d->box[1]));
	add_number(ch, (int64_t)((uint64_t)(uint32_t)d->box[2] << 32 | (uint32_t)d->box[3]));
	if (ch)
		ch->drop_push = push;
	return change_queue(c, ch, err);
}

int catalogue_put_job(struct catalogue *c, const struct catalogue_job *j, catalogue_done_fn done, void *ctx,
		      struct err *err)
{
	struct change *ch = change_new(CATALOGUE_PUT_JOB, done, ctx);

	add_number(ch, (int64_t)j->id);
	add_number(ch, (int64_t)j->dataset);
	add_number(ch, (int64_t)j->generation);
	add_text(ch, j->view);
	add_text(ch, j->state);
	add_number(ch, j->uid);
	add_number(ch, j->pid);
	add_number(ch, j->submitted_us);
	add_number(ch, j->finished_us);
	add_text(ch, j->report);
	add_text(ch, j->error_code);
	add_text(ch, j->error_message);
	add_text(ch, j->error_file);
	add_text(ch, j->error_field);
	add_text(ch, j->error_hint);
	add_number(ch, j->error_offset);
	add_number(ch, j->priority);
	return change_queue(c, ch, err);
}

int catalogue_put_push(struct catalogue *c, const struct catalogue_push *p, catalogue_done_fn done, void *ctx,
		       struct err *err)
{
	struct change *ch = change_new(CATALOGUE_PUT_PUSH, done, ctx);

	add_number(ch, (int64_t)p->id);
	add_number(ch, (int64_t)p->dataset);
	add_number(ch, p->uid);
	add_number(ch, p->files);
	add_number(ch, p->begun_us);
	return change_queue(c, ch, err);
}

static int drop(struct catalogue *c, enum catalogue_sql sql, uint64_t id, catalogue_done_fn done, void *ctx,
		struct err *err)
{
	struct change *ch = change_new(sql, done, ctx);

	add_number(ch, (int64_t)id);
	return change_queue(c, ch, err);
}

int catalogue_drop_dataset(struct catalogue *c, uint64_t id, catalogue_done_fn done, void *ctx,
			   struct err *err)
{
	return drop(c, CATALOGUE_DROP_DATASET, id, done, ctx, err);
}

int catalogue_drop_job(struct catalogue *c, uint64_t id, catalogue_done_fn done, void *ctx, struct err *err)
{
	return drop(c, CATALOGUE_DROP_JOB, id, done, ctx, err);
}

int catalogue_drop_push(struct catalogue *c, uint64_t id, catalogue_done_fn done, void *ctx, struct err *err)
{
	return drop(c, CATALOGUE_DROP_PUSH, id, done, ctx, err);
}
