/*
 * The catalogue: what must outlive the daemon about datasets, jobs and pushes that are not committed. SQLite
 * (WAL, synchronous=FULL) on a thread of its own: the loop queues a change and is told when it is on disk.
 * Nothing is read after the start: the loop keeps what it was told.
 */
#ifndef CATALOGUE_H
#define CATALOGUE_H

#include <stdbool.h>
#include <stdint.h>

struct err;
struct catalogue;
struct ledger;

/* What it takes of the ledger (LEDGER_CATALOGUE): all that SQLite may ever have, and changes that wait for the disk.
 * Set that much aside; who queues more waits until some of it is written. */
enum { CATALOGUE_HEAP = 1 << 20, CATALOGUE_QUEUE = 512 << 10 };

/* Texts are copied by whoever receives such a struct. Times: microseconds since 1970. */
struct catalogue_dataset {
	uint64_t id;
	const char *name;
	uint32_t uid, gid, mode; /* gid UINT32_MAX: none, as of what is older than groups */
	int64_t created_us, pushed_us;
	const char *manifest; /* file name in the dataset's folder, "" if there is no generation */
	uint64_t generation, points, bytes;
	uint32_t files;
	const char *lattice, *crs, *unit_xy, *unit_z;
	int32_t box[4];
	int64_t removed_us; /* 0: it is there; names differ among those that are */
	bool pinned;
	uint64_t oldest;   /* generation that can be read; 0: 1 */
	uint32_t segments; /* 0: not known */
};

struct catalogue_job {
	uint64_t id, dataset, generation;
	const char *view, *state; /* name of the state, daemon/job/job_state.def */
	uint32_t uid, pid;
	int64_t submitted_us, finished_us;
	const char *report; /* text of job_report_text, "" if none */
	const char *error_code, *error_message, *error_file, *error_field, *error_hint;
	int64_t error_offset; /* -1: none */
	uint32_t priority;
	const char *area; /* "": all */
	bool admin;       /* of who submitted it: no limit of users holds it */
};

struct catalogue_push {
	uint64_t id, dataset;
	uint32_t uid, files; /* files: durable ones */
	int64_t begun_us;
};

/* Opens or makes `path`. `ledger` is borrowed (NULL: not charged). -ERR_VERSION: made by a newer acutd;
 * -ERR_CORRUPT: not a catalogue, damaged; -ERR_LIMIT: the ledger has no room. */
int catalogue_new(const char *path, struct ledger *ledger, struct catalogue **ret, struct err *err);
/* Ends the thread after everything queued is on disk. NULL is fine; returns NULL. */
struct catalogue *catalogue_free(struct catalogue *);

struct catalogue_reader {
	void *ctx;
	int (*dataset)(void *ctx, const struct catalogue_dataset *, struct err *err);
	int (*job)(void *ctx, const struct catalogue_job *, struct err *err);
	int (*push)(void *ctx, const struct catalogue_push *, struct err *err);
};
/* Everything, by id; before catalogue_start. ret_last: the largest id ever given: dataset, job, push. */
int catalogue_load(struct catalogue *, const struct catalogue_reader *, uint64_t ret_last[3], struct err *err);
int catalogue_start(struct catalogue *, struct err *err);

/* Readable when catalogue_dispatch has something to call. */
int catalogue_fd(const struct catalogue *);
unsigned catalogue_dispatch(struct catalogue *);
/* After an error of the disk it is not known whether some change was made: what a change that failed is about must stay
 * until the next start. */
bool catalogue_unsure(struct catalogue *);
unsigned catalogue_busy(struct catalogue *); /* changes whose `done` has not been called */

/* Changes; `done` (may be NULL) comes from catalogue_dispatch, r as functions return it. -ERR_NOMEM: not
 * queued, done is not called. put replaces the row of that id. */
typedef void (*catalogue_done_fn)(void *ctx, int r, const struct err *why);
/* push: the push that this commits, whose row goes in the same transaction; 0: none. */
int catalogue_put_dataset(struct catalogue *, const struct catalogue_dataset *, uint64_t push, catalogue_done_fn done, void *ctx,
			  struct err *err);
int catalogue_put_job(struct catalogue *, const struct catalogue_job *, catalogue_done_fn done, void *ctx, struct err *err);
int catalogue_put_push(struct catalogue *, const struct catalogue_push *, catalogue_done_fn done, void *ctx, struct err *err);
int catalogue_drop_dataset(struct catalogue *, uint64_t id, catalogue_done_fn done, void *ctx, struct err *err);
int catalogue_drop_job(struct catalogue *, uint64_t id, catalogue_done_fn done, void *ctx, struct err *err);
int catalogue_drop_push(struct catalogue *, uint64_t id, catalogue_done_fn done, void *ctx, struct err *err);

/* PRAGMA integrity_check: `done` gets -ERR_CORRUPT with what is wrong first. */
int catalogue_check(struct catalogue *, catalogue_done_fn done, void *ctx, struct err *err);

/* ---- catalogue_copy.c: any thread ---- */

/* The catalogue at the path `from`, as of one moment, into a new file `to`; pushes that are not committed are not in
 * it. Whoever owns `from` goes on meanwhile. */
int catalogue_copy(const char *from, const char *to, struct err *err);
/* The datasets that have a manifest, by id; what `each` returns ends it, if not 0. Nobody may have `path` open. */
int catalogue_manifests(const char *path, int (*each)(void *ctx, uint64_t dataset, const char *manifest, struct err *), void *ctx,
			struct err *err);

#endif
