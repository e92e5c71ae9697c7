/*
 * The catalogue: the durable state of datasets, jobs and uncommitted pushes. SQLite (WAL, synchronous=FULL) on a thread of its
 * own: the loop queues a change, and its `done` is called when the change is durable. Nothing is read after the start, since the
 * loop keeps the state in memory. Functions belong to the loop thread unless they say "any thread".
 */
#ifndef CATALOGUE_H
#define CATALOGUE_H

#include <stdbool.h>
#include <stdint.h>

struct err;
struct catalogue;
struct ledger;

/* Bytes of LEDGER_CATALOGUE: the whole heap of SQLite, and what is set aside for changes that wait for the disk. If more are
 * queued, the caller waits until some are written. */
enum { CATALOGUE_HEAP = 1 << 20, CATALOGUE_QUEUE = 512 << 10 };

/* Texts are borrowed: the receiver copies them. Times: microseconds since 1970. */
struct catalogue_dataset {
	uint64_t id;
	const char *name;
	uint32_t uid, gid, mode; /* gid UINT32_MAX: none (a dataset older than groups) */
	int64_t created_us, pushed_us;
	const char *manifest; /* file name in the dataset's folder; "": there is no generation */
	uint64_t generation, points, bytes;
	uint32_t files;
	const char *lattice, *crs, *unit_xy, *unit_z;
	int32_t box[4];
	int64_t removed_us; /* 0: not removed; the names of these datasets differ */
	bool pinned;
	uint64_t oldest;   /* oldest generation that can be read; 0: 1 */
	uint32_t segments; /* 0: unknown */
};

struct catalogue_job {
	uint64_t id, dataset, generation;
	const char *view, *state; /* name of the state, daemon/job/job_state.def */
	uint32_t uid, pid;
	int64_t submitted_us, finished_us;
	const char *report; /* report_text (report.c); "": none */
	const char *error_code, *error_message, *error_file, *error_field, *error_hint;
	int64_t error_offset; /* -1: none */
	uint32_t priority;
	const char *area; /* "": everything */
	bool admin;       /* the job's user was an administrator: has no quota */
};

struct catalogue_push {
	uint64_t id, dataset;
	uint32_t uid, files; /* files: durable */
	int64_t begun_us;
};

/* Opens the database, or makes it. `ledger` is borrowed; NULL: not charged. -ERR_VERSION: a newer acutd wrote it. -ERR_CORRUPT:
 * it is damaged, or not a catalogue. -ERR_LIMIT: the ledger has too little memory. */
int catalogue_new(const char *path, struct ledger *ledger, struct catalogue **ret, struct err *err);
/* Writes all queued changes, then ends the thread. NULL is fine; returns NULL. */
struct catalogue *catalogue_free(struct catalogue *);

struct catalogue_reader {
	void *ctx;
	int (*dataset)(void *ctx, const struct catalogue_dataset *, struct err *err);
	int (*job)(void *ctx, const struct catalogue_job *, struct err *err);
	int (*push)(void *ctx, const struct catalogue_push *, struct err *err);
};
/* Calls the reader for every row, by id; before catalogue_start. ret_last: the largest ids of a dataset, job and push that were
 * ever used; all 0 if not every row was read, which is an error. */
int catalogue_load(struct catalogue *, const struct catalogue_reader *, uint64_t ret_last[3], struct err *err);
int catalogue_start(struct catalogue *, struct err *err);

/* Readable if catalogue_dispatch has something to call. */
int catalogue_fd(const struct catalogue *);
unsigned catalogue_dispatch(struct catalogue *);
/* True: after a disk error it is unknown whether some change was made. The objects of a change that failed must stay until the
 * next start. Any thread. */
bool catalogue_is_uncertain(struct catalogue *);
unsigned catalogue_busy(struct catalogue *); /* number of changes whose `done` was not called */

/* Changes. `done` (may be NULL) is called by catalogue_dispatch, with 0 or a negative error. -ERR_NOMEM, -ERR_BUSY: the change is
 * not queued, and `done` is not called. put replaces the row with that id. Texts are copied. */
typedef void (*catalogue_done_fn)(void *ctx, int r, const struct err *why);
/* push: the row of this push is removed in the same transaction; 0: none. */
int catalogue_put_dataset(struct catalogue *, const struct catalogue_dataset *, uint64_t push, catalogue_done_fn done, void *ctx,
			  struct err *err);
int catalogue_put_job(struct catalogue *, const struct catalogue_job *, catalogue_done_fn done, void *ctx, struct err *err);
int catalogue_put_push(struct catalogue *, const struct catalogue_push *, catalogue_done_fn done, void *ctx, struct err *err);
int catalogue_drop_dataset(struct catalogue *, uint64_t id, catalogue_done_fn done, void *ctx, struct err *err);
int catalogue_drop_job(struct catalogue *, uint64_t id, catalogue_done_fn done, void *ctx, struct err *err);
int catalogue_drop_push(struct catalogue *, uint64_t id, catalogue_done_fn done, void *ctx, struct err *err);

/* PRAGMA integrity_check. `done` gets -ERR_CORRUPT with the first finding. */
int catalogue_check(struct catalogue *, catalogue_done_fn done, void *ctx, struct err *err);

/* ---- catalogue_copy.c: any thread ---- */

/* Copies the catalogue at the path `from`, as of one moment, into a new file `to`. Uncommitted pushes are left out. The catalogue
 * may be in use. */
int catalogue_copy(const char *from, const char *to, struct err *err);
/* Calls `each` for the datasets that have a manifest, by id, until it returns other than 0, and returns that. The catalogue at
 * `path` must not be in use. */
int catalogue_manifests(const char *path, int (*each)(void *ctx, uint64_t dataset, const char *manifest, struct err *), void *ctx,
			struct err *err);

#endif
