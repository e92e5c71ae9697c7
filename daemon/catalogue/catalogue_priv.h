/* Shared by the files of this room. */
#ifndef CATALOGUE_PRIV_H
#define CATALOGUE_PRIV_H

#include <sqlite3.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>

#include "catalogue.h"
#include "catalogue_sql.h"
#include "err.h"
#include "lock.h"

/* Values of one change, at most: the columns of the widest table. */
enum { VALUES = 22 };
/* Rows that could not be removed and are tried again, at most. */
enum { FAILED_DROPS = 256 };

struct value {
	enum { VALUE_NUMBER, VALUE_TEXT } kind;
	int64_t number;
	char *text;
};

struct change {
	enum catalogue_sql sql;
	unsigned n;
	uint64_t drop_push; /* with the row of a dataset: this push goes with the same change */
	catalogue_done_fn done;
	void *ctx;
	int r;
	struct err *err; /* if r is not 0; NULL: there was no memory for it */
	size_t charged;
	struct change *next;
	struct value value[VALUES];
};

struct catalogue {
	sqlite3 *db; /* NULL: closed, after an error of the disk */
	char *path;
	int index;      /* a descriptor of the index of the log, plus 1; 0: none */
	bool io_failed; /* of the thread: a change was interrupted by an error since the database was opened */
	atomic_bool uncertain;
	sqlite3_stmt *stmt[CATALOGUE_SQLS];
	struct lock lock;
	pthread_cond_t wake, written; /* for the thread; for callers that wait for memory */
	pthread_t thread;
	struct ledger *ledger;
	bool heap; /* it is charged */
	bool started, stop, writing;
	bool starting;                 /* it is opened for the first time */
	struct catalogue_check *check; /* the pages are being checked; NULL: not beside the reading */
	bool check_due;                /* before catalogue_load returns */
	struct change *queued, **queued_end, *ended, **ended_end;
	unsigned busy;
	int event;
	struct failed_drop {
		enum catalogue_sql sql;
		int64_t id;
	} failed_drop[FAILED_DROPS]; /* of the thread */
	unsigned nfailed_drops;
};

/* catalogue_open.c: the database. All but catalogue_open are for its owner. */
int catalogue_open(struct catalogue *, const char *path, struct err *err);
void catalogue_close(struct catalogue *);
enum err_code catalogue_err_code(int sqlite_code);
/* Sets the last error of SQLite. */
int catalogue_failed(struct catalogue *, struct err *err, const char *what);
int catalogue_verify(struct catalogue *, struct err *err); /* -ERR_CORRUPT, with the first finding */
int catalogue_run(struct catalogue *, const char *sql, struct err *err);

/* catalogue_check.c */
/* Finds pages with inconsistent cells: rows on them would not be found, and be taken for absent. -ERR_CORRUPT. */
int catalogue_check_pages(struct catalogue *, struct err *err);
void catalogue_check_begin(struct catalogue *);        /* on a thread, if there can be one */
bool catalogue_check_failed(const struct catalogue *); /* catalogue_check_end will return an error */
/* Waits for it. After catalogue_check_begin; otherwise 0. */
int catalogue_check_end(struct catalogue *, struct err *err);

/* catalogue_sum.c: the checksum in the last column of a row, of the values before it. */
int64_t catalogue_sum(const struct value *, unsigned n);
/* Defines row_sum(column, ...) for the steps from older versions. */
int catalogue_sum_function(struct catalogue *, struct err *err);
/* A value of a row that was read, as a number and as a text. */
struct column {
	int type; /* SQLITE_INTEGER, ... */
	size_t bytes;
	int64_t number;
	const char *text; /* borrowed, until the next row; NULL: a number */
};
/* Checks a row whose last column is its checksum. -ERR_CORRUPT. */
int catalogue_sum_check(const struct column *, unsigned n, const char *table, struct err *err);

/* catalogue_io.c, of the thread: after a disk error, and before a change. Sets `ch->r` to the result of the change. */
void catalogue_after_error(struct catalogue *, struct change *ch, struct err *why);
int catalogue_reopen(struct catalogue *, struct err *err); /* opens the database if it is closed */

void catalogue_change_free(struct change *);

#endif
