/*
 * The check of the catalogue's pages at a start, beside the reading of its rows.
 *
 * Pages with inconsistent cells would hide rows, which would be taken for absent, and files of theirs be deleted. So nothing may
 * be decided before all pages are checked. But reading ten thousand rows and passing them on takes longer than the check, and no
 * row has an effect outside of memory before catalogue_load returns. So a thread checks the pages meanwhile, with a connection of
 * its own, and catalogue_load ends with its result.
 */
#include "catalogue_priv.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "progress.h"
#include "thread.h"

struct catalogue_check {
	struct catalogue side; /* its db and path */
	pthread_t thread;
	atomic_uint steps;  /* of progress */
	atomic_bool failed; /* for good: see needs_another */
	int r;
	struct err err;
};

/* Instructions of the database between two steps of progress. */
enum { STEP_INSTRUCTIONS = 100000 };

int catalogue_check_pages(struct catalogue *c, struct err *err)
{
	const char *answer = "";
	sqlite3_stmt *s;
	int r = 0;

	if (sqlite3_prepare_v2(c->db, "PRAGMA quick_check(1)", -1, &s, NULL) != SQLITE_OK || sqlite3_step(s) != SQLITE_ROW)
		r = catalogue_failed(c, err, "the catalogue cannot be read");
	else
		answer = (const char *)sqlite3_column_text(s, 0);
	if (!r && (!answer || strcmp(answer, "ok"))) {
		err_set(err, ERR_CORRUPT, "the catalogue is damaged: %.200s", answer ? answer : "");
		r = err_add_hint(err, "take the state from a backup");
	}
	sqlite3_finalize(s);
	return r;
}

/* The check ended without a result. The two connections share one heap, so it may succeed when the rows are read. */
static bool needs_another(int r)
{
	return r == -ERR_NOMEM || r == -ERR_BUSY;
}

static int on_instructions(void *ctx)
{
	atomic_fetch_add(&((struct catalogue_check *)ctx)->steps, 1);
	return 0; /* continue */
}

static int check(struct catalogue_check *k)
{
	struct catalogue *c = &k->side;

	if (sqlite3_open_v2(c->path, &c->db, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX, NULL) != SQLITE_OK)
		return c->db ? catalogue_failed(c, &k->err, "the catalogue cannot be opened") :
			       err_set(&k->err, ERR_NOMEM, "no memory for the catalogue");
	sqlite3_busy_timeout(c->db, 2000);
	sqlite3_progress_handler(c->db, STEP_INSTRUCTIONS, on_instructions, k);
	k->r = catalogue_run(c, "PRAGMA mmap_size = 0; PRAGMA cache_size = -64;", &k->err);
	return k->r ? k->r : catalogue_check_pages(c, &k->err);
}

static void *check_main(void *arg)
{
	struct catalogue_check *k = arg;

	thread_mark_helper();
	k->r = check(k);
	sqlite3_close(k->side.db);
	atomic_store(&k->failed, k->r && !needs_another(k->r));
	return NULL;
}

void catalogue_check_begin(struct catalogue *c)
{
	struct catalogue_check *k = calloc(1, sizeof *k);
	sigset_t all, old;
	int r;

	c->check_due = true;
	if (!k)
		return;
	k->side.path = c->path;
	k->err = ERR_INIT;
	sigfillset(&all);
	pthread_sigmask(SIG_SETMASK, &all, &old);
	r = pthread_create(&k->thread, NULL, check_main, k);
	pthread_sigmask(SIG_SETMASK, &old, NULL);
	if (r)
		free(k);
	else
		c->check = k;
}

bool catalogue_check_failed(const struct catalogue *c)
{
	return c->check && atomic_load(&c->check->failed);
}

/* The service manager waits as long as the thread makes progress. */
static void wait_for(struct catalogue_check *k)
{
	unsigned seen = 0;
	struct timespec until;

	for (;;) {
		unsigned steps = atomic_load(&k->steps);

		clock_gettime(CLOCK_REALTIME, &until);
		until.tv_sec++;
		if (!pthread_timedjoin_np(k->thread, NULL, &until))
			return;
		if (steps != seen)
			progress_step();
		seen = steps;
	}
}

int catalogue_check_end(struct catalogue *c, struct err *err)
{
	struct catalogue_check *k = c->check;
	int r = 0;

	if (k) {
		wait_for(k);
		r = k->r;
		if (r)
			*err = k->err;
		c->check_due = needs_another(r);
		free(k);
		c->check = NULL;
	}
	if (!c->check_due)
		return r;
	c->check_due = false;
	*err = ERR_INIT;
	return catalogue_check_pages(c, err);
}
