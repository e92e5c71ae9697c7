/*
 * All jobs by number, and those that are over as they are kept: small.
 *
 * Jobs at work are in jobs->jobs. One that is over, and that nobody reads, is packed here; who looks for it gets a
 * guest, a job to be read that is gone with the next round of the loop, and history_awake makes it one of those at work.
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
	HISTORY_JOBS,  /* all of a user */
	HISTORY_VIEWS, /* bytes of the texts of their views */
	HISTORY_BYTES, /* that are charged for those that are kept */
	HISTORY_KINDS
};

/* A new job, at work; it has room afterwards to be kept. */
int history_add(struct job *, struct err *err);
/* A job that goes: its number is not there any more. */
void history_remove(struct job *);
/* Keeps a job that is over, if it can be: frees it. */
bool history_keep(struct job *);
/* A guest's job among those at work: itself if it is one already. -ERR_BUSY, -ERR_NOMEM. */
int history_awake(struct job *, struct job **ret, struct err *err);
/* A guest's job is gone, and with it what was kept of it. */
void history_drop(struct job *guest);
/* NULL: there is none. `of`: jobs of this dataset only, NULL: of any. */
struct job *history_find(struct jobs *, uint64_t id);
struct job *history_next(struct jobs *, const struct dataset *of, uint64_t after);
struct job *history_before(struct jobs *, uint64_t id);
/* The oldest job that is kept here, and is not younger than that; NULL: there is none. */
struct job *history_oldest(struct jobs *, int64_t finished_us);
/* The oldest job that is kept here of the user who has most of that, `more` added to what this one has; of users who have
 * nothing here there is none. NULL: nothing is kept. */
struct job *history_of_most(struct jobs *, enum history_kind, uint32_t uid, uint64_t more);
bool history_has(const struct jobs *, uint64_t id);
/* The dataset is about to go: jobs that are kept use it no more. */
void history_forget_dataset(struct jobs *, struct dataset *);
size_t history_count(const struct jobs *);                /* all jobs */
uint64_t history_bytes(const struct jobs *);              /* that are charged for those that are kept */
void history_numbers(const struct jobs *, uint64_t *ret); /* of all jobs, ascending */
/* Their numbers, first those whose dataset is there: gives how many these are. */
size_t history_list(const struct jobs *, uint64_t *ret);
struct history_views { /* bytes of views' texts: of all, and of one user; `busy`: of jobs that are not kept, and so cannot go */
	uint64_t all, busy, own, own_busy;
};
void history_views(const struct jobs *, uint32_t uid, struct history_views *ret);
void history_round(struct jobs *); /* guests are gone; what they lay in with the first round that has none */
void history_free(struct jobs *);

#endif
