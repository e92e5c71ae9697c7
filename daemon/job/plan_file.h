/*
 * The plan of a job, kept in a file (FORMAT.md, "Plans"): which regions its mesh is made of, in which order, and
 * the cap that decides whether a region is split. With the same plan and cap every walk of the job gives the same
 * blocks. Also a list, in memory, of the splits of this run, for walks that follow another one.
 */
#ifndef PLAN_FILE_H
#define PLAN_FILE_H

#include <stdbool.h>
#include <stdint.h>

#include "cut.h"
#include "digest.h"

struct err;
struct ledger;
struct plan_file;

struct plan_kept {
	uint32_t load, cap; /* of the budget that it was made for */
	struct digest base; /* stands for the plan before any split, and the cap */
};

/* In `dirfd` (borrowed), under the job's number. `durable`: a write returns when it outlives a crash. No file is
 * touched. What it keeps in memory is taken from the ledger (borrowed; LEDGER_PLAN). NULL: no memory. */
struct plan_file *plan_file_new(int dirfd, uint64_t job, uint64_t generation, bool durable, struct ledger *);
/* Of a job that is new: a file that is there was left by one that a crash ended before it had a row, and goes. */
void plan_file_fresh(struct plan_file *);
struct plan_file *plan_file_free(struct plan_file *); /* the file stays; NULL is fine, gives NULL */

/* These five may be called by any thread. */
/* The plan with all its splits, and how many of this run's splits are in it; a durable one outlives a crash from then on.
 * PLAN_FILE_ABSENT: there is none, or it is damaged (then it is told in the log, and a new one will be written). */
enum { PLAN_FILE_ABSENT = 1 };
int plan_file_read(struct plan_file *, struct cut_plan *ret, struct plan_kept *ret_kept, size_t *ret_seen, struct err *err);
/* Takes the place of what was kept. Sets kept->base. Later: of this walk no block leaves, so that a durable one, and its
 * splits, need not outlive a crash before somebody reads it. */
int plan_file_write(struct plan_file *, const struct cut_plan *, struct plan_kept *kept, struct err *err);
int plan_file_write_later(struct plan_file *, const struct cut_plan *, struct plan_kept *kept, struct err *err);
/* `whole` became the two halves. One that is there already changes nothing. */
int plan_file_split(struct plan_file *, const struct cut_region *whole, const struct cut_leaf half[2], struct err *err);
/* Splits of this run from *seen on go into the plan, those of leaf `least` or later. */
int plan_file_follow(struct plan_file *, size_t *seen, size_t least, struct cut_plan *, struct err *err);

/*
 * Finished domains of the job: which files of the store its blocks are, and what they sum up to. Told as domains get
 * there, in any order, the same region again where it was made again (the last one counts). A help, never needed to go
 * on: what a crash left of the last ones is not there.
 */
struct plan_done {
	struct cut_region region;
	struct digest base, list;  /* the name of the stored file (store.h) */
	struct digest digest;      /* of its triangles */
	uint64_t payload;          /* checksum of all that the domain is: counts and arrays (store.h) */
	uint64_t triangles, bytes; /* bytes of the file */
};
int plan_file_done(struct plan_file *, const struct plan_done *, size_t n, struct err *err);
/* Of any job whose plan is in that folder; `fn` in the order in which they were told; non-zero from it ends the call
 * and is returned. A plan that is absent or damaged has none. */
int plan_file_each_done(int plansfd, uint64_t job, int (*fn)(void *ctx, const struct plan_done *, struct err *), void *ctx,
			struct err *err);

/* Reads all of a job's plan in that folder. -ERR_CORRUPT: something in it is damaged, other than a last split or domain
 * that was cut short. *ret_bytes: of the file. */
int plan_file_check(int plansfd, uint64_t job, uint64_t *ret_bytes, struct err *err);
/* Removes the file. Worker. */
int plan_file_remove(struct plan_file *, struct err *err);
/* Removes the plans of jobs up to `last` that are not there, and what writes left that were cut short; whoever writes a durable
 * plan waits for it. Reads the folder. */
int plan_file_sweep(int plansfd, uint64_t last, bool (*there)(void *ctx, uint64_t job), void *ctx, struct err *err);
/* Whose plan a file of that name is; 0: it is none. */
uint64_t plan_file_job(const char *name);

#endif
