/*
 * The plan of a job in a file (format.md, "Plans"): the regions of its mesh, their order, and the cap that decides
 * whether a region is split. Two runs of a job with the same plan and cap emit the same blocks. A list in memory has
 * the splits made since the daemon started, for a run that follows another one.
 */
#ifndef PLAN_FILE_H
#define PLAN_FILE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "cut.h"
#include "digest.h"

struct err;
struct ledger;
struct plan_file;

struct plan_kept {
	uint32_t load, cap; /* limits of positions in a region (struct pipe_budget) */
	struct digest base; /* identifies the cap and the plan before any split */
};

/* The file is plan-JOB in `dirfd` (borrowed); this call does not touch it. `durable`: a plan that was settled or read survives
 * a crash. The list of splits is charged to the ledger (borrowed; LEDGER_PLAN; NULL: not charged). NULL: no memory. */
struct plan_file *plan_file_new(int dirfd, uint64_t job, uint64_t generation, bool durable, struct ledger *);
/* The job is new. A file of its number was left by an earlier job that had no row yet when the daemon crashed; the next
 * read removes it. */
void plan_file_fresh(struct plan_file *);
struct plan_file *plan_file_free(struct plan_file *); /* the file stays; NULL is fine, gives NULL */

/* Any thread may call the functions from here to plan_file_follow. */
/* Reads the plan with all its splits. *ret_seen: how many splits of the list in memory it contains. A durable plan survives
 * a crash from then on. PLAN_FILE_ABSENT: there is no plan, or it is damaged; damage is logged, and the caller writes anew. */
enum { PLAN_FILE_ABSENT = 1 };
int plan_file_read(struct plan_file *, struct cut_plan *ret, struct plan_kept *ret_kept, size_t *ret_seen, struct err *err);
/* Replaces the file and sets kept->base. Does not wait for the disk. */
int plan_file_write(struct plan_file *, const struct cut_plan *, struct plan_kept *kept, struct err *err);
/* To be called before each block that leaves: the first time it waits until the plan that was written survives a crash, and
 * from then on each split does when it is recorded. On failure the plan is lost. */
int plan_file_settle(struct plan_file *, struct err *err);
/* Records that `whole` was split into two halves. A known split changes nothing. */
int plan_file_split(struct plan_file *, const struct cut_region *whole, const struct cut_leaf half[2], struct err *err);
/* Applies the splits of the list in memory from *seen on to leaves from `least` on. */
int plan_file_follow(struct plan_file *, size_t *seen, size_t least, struct cut_plan *, struct err *err);

/*
 * A finished domain of the job: the stored file that has its triangles, and its sums. Domains are added as they are
 * finished, in any order; of two records of a region the last one counts. No reader depends on these records: a crash may
 * lose the last of them.
 */
struct plan_done {
	struct cut_region region;
	struct digest base, list;  /* the name of the stored file (store.h) */
	struct digest digest;      /* of its triangles */
	uint64_t payload;          /* checksum of counts and arrays (store.h) */
	uint64_t triangles, bytes; /* bytes of the file */
};
int plan_file_done(struct plan_file *, const struct plan_done *, size_t n, struct err *err);
/* Calls `fn` for each finished domain of the job's plan in that folder, in the order of the file. A non-zero result of
 * `fn` ends the call and is returned. An absent or damaged plan has no finished domains. */
int plan_file_each_done(int plansfd, uint64_t job, int (*fn)(void *ctx, const struct plan_done *, struct err *), void *ctx,
			struct err *err);

/* Verifies every record of the job's plan in that folder. -ERR_CORRUPT: damage other than an incomplete last split or
 * domain. *ret_bytes: size of the file. */
int plan_file_check(int plansfd, uint64_t job, uint64_t *ret_bytes, struct err *err);
/* Removes the file. Worker. */
int plan_file_remove(struct plan_file *, struct err *err);
/* Removes the plans of jobs up to `last` that are not `there`, and temporary files of interrupted writes. Reads the folder.
 * Writes of durable plans wait meanwhile. Until another thread sets *stop (NULL: never): -ERR_CANCELLED. */
int plan_file_sweep(int plansfd, uint64_t last, bool (*there)(void *ctx, uint64_t job), void *ctx, const atomic_bool *stop,
		    struct err *err);
/* The job whose plan has that file name; 0: it is not the name of a plan. */
uint64_t plan_file_job(const char *name);

#endif
