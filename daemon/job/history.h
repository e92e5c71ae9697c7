/*
 * The history: all jobs by number, finished ones packed.
 *
 * Active jobs are in jobs->jobs: those that are not finished, are being read, or are about to be removed. A finished job that
 * nobody reads is packed here, into about 260 bytes. A search for it gives a copy (job->unpacked): it may be read until the next
 * round of the loop, and history_activate makes an active job of it. Loop.
 */
#ifndef HISTORY_H
#define HISTORY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct dataset;
struct err;
struct job;
struct jobs;
struct history;

/* What users share here. */
enum history_kind {
	HISTORY_JOBS,  /* number of jobs */
	HISTORY_VIEWS, /* bytes of the texts of their views */
	HISTORY_BYTES, /* bytes that are charged for packed jobs */
	HISTORY_KINDS
};

/* Adds a new, active job; it can be packed later without more memory for the index. -ERR_NOMEM. */
int history_add(struct job *, struct err *err);
void history_remove(struct job *); /* an active job ends */
/* Packs a finished job, and frees it. False: no memory; nothing changed. */
bool history_pack(struct job *);
/* The active job of a copy; of an active job itself. -ERR_BUSY, -ERR_NOMEM, -ERR_NOTFOUND. */
int history_activate(struct job *, struct job **ret, struct err *err);
void history_delete(struct job *copy); /* removes the packed job with all that it owns, and its plan's file */

/* ---- searching; NULL: there is none ---- */

struct job *history_find(struct jobs *, uint64_t id);
/* The first job after that number; `of`: only jobs of this dataset; NULL: of any. */
struct job *history_next(struct jobs *, const struct dataset *of, uint64_t after);
struct job *history_before(struct jobs *, uint64_t id); /* the last job before that number */
bool history_has(const struct jobs *, uint64_t id);
/* The first packed job that finished until then. */
struct job *history_oldest(struct jobs *, int64_t finished_us);
/* The first packed job of the user who has most of `kind`, with `more` added for `uid`. Users without packed jobs do not count.
 */
struct job *history_oldest_of_largest(struct jobs *, enum history_kind, uint32_t uid, uint64_t more);

size_t history_count(const struct jobs *);                /* all jobs */
uint64_t history_bytes(const struct jobs *);              /* charged for packed jobs */
void history_numbers(const struct jobs *, uint64_t *ret); /* of all jobs, ascending */
/* The numbers of all jobs, those with a dataset first. Returns how many have one. */
size_t history_list(const struct jobs *, uint64_t *ret);
/* Bytes of the texts of views: of all users, of one user; busy: of active jobs, which cannot be dropped. */
struct history_views {
	uint64_t all, busy, own, own_busy;
};
void history_views(const struct jobs *, uint32_t uid, struct history_views *ret);

void history_forget_dataset(struct jobs *, struct dataset *); /* packed jobs drop their reference to it */
void history_round(struct jobs *);                            /* copies end; their memory goes with the first round without one */
void history_free(struct jobs *);

#endif
