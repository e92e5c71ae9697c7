/* What the files of this room share. */
#ifndef CATALOGUE_PRIV_H
#define CATALOGUE_PRIV_H

#include <sqlite3.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>

#include "catalogue.h"
#include "catalogue_sql.h"
#include "lock.h"

/* values of one change, at most: columns of the widest table */
enum { VALUES = 22 };
/* Rows that could not be removed, which are remembered. */
enum { OWED = 256 };

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
	sqlite3 *db; /* NULL: closed, after an error of the disk */
	char *path;
	bool io_failed; /* since it was opened a change ended in the middle; of the thread */
	atomic_bool unsure;
	sqlite3_stmt *stmt[CATALOGUE_SQLS];
	struct lock lock;
	pthread_cond_t wake, room; /* for the thread; for who waits to queue */
	pthread_t thread;
	struct ledger *ledger;
	bool heap; /* charged */
	bool started, stop, writing;
	struct change *todo, **todo_end, *over, **over_end;
	unsigned busy;
	int event;
	struct owed {
		enum catalogue_sql sql;
		int64_t id;
	} owed[OWED]; /* the thread's */
	unsigned nowed;
};

/* catalogue_open.c: the database. */
int catalogue_open(struct catalogue *, const char *path, struct err *err);
void catalogue_close(struct catalogue *);
/* Raises what SQLite said last. */
int catalogue_failed(struct catalogue *, struct err *err, const char *what);
int catalogue_verify(struct catalogue *, struct err *err); /* -ERR_CORRUPT: what is wrong first */
int catalogue_run(struct catalogue *, const char *sql, struct err *err);

/* catalogue_sum.c: what the last column of a row is, from those before it. */
int64_t catalogue_sum(const struct value *, unsigned n);
/* For the steps from older versions: row_sum(column, ...). */
int catalogue_sum_function(struct catalogue *, struct err *err);
/* A value of a row that was read: as a number and as a text, whatever it is. */
struct column {
	int type; /* SQLITE_INTEGER, ... */
	size_t bytes;
	int64_t number;
	const char *text; /* borrowed, up to the next row; of a number: NULL */
};
/* A row, its last column the sum. -ERR_CORRUPT: it is not what was written. */
int catalogue_sum_check(const struct column *, unsigned n, const char *table, struct err *err);

/* catalogue_io.c, the thread's: after an error of the disk, and before a change. `ch->r` is what became of it. */
void catalogue_after_error(struct catalogue *, struct change *ch, struct err *why);
int catalogue_again(struct catalogue *, struct err *err); /* it is open, or cannot be */

void catalogue_change_free(struct change *);

#endif
