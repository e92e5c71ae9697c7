/*
 * All jobs by number, and those that are over as they are kept: small.
 *
 * Jobs at work are in jobs->jobs. One that is over, and that nobody reads, is packed here; who looks for it gets a
 * guest, a job to be read that is gone with the next round of the loop, and past_awake makes it one of those at work.
 */
#ifndef PAST_H
#define PAST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct dataset;
struct err;
struct job;
struct jobs;
struct past;

/* What users share here. */
enum past_kind {
	PAST_JOBS,  /* all of a user */
	PAST_VIEWS, /* bytes of the texts of their views */
	PAST_BYTES, /* that are charged for those that are kept */
	PAST_KINDS
};

/* A new job, at work; it has room afterwards to be kept. */
int past_add(struct job *, struct err *err);
/* A job that goes: its number is not there any more. */
void past_remove(struct job *);
/* Keeps a job that is over, if it can be: frees it. */
bool past_keep(struct job *);
/* A guest's job among those at work: itself if it is one already. -ERR_BUSY, -ERR_NOMEM. */
int past_awake(struct job *, struct job **ret, struct err *err);
/* A guest's job is gone, and with it what was kept of it. */
void past_drop(struct job *guest);
/* NULL: there is none. `of`: jobs of this dataset only, NULL: of any. */
struct job *past_find(struct jobs *, uint64_t id);
struct job *past_next(struct jobs *, const struct dataset *of, uint64_t after);
struct job *past_before(struct jobs *, uint64_t id);
/* The oldest job that is kept here, and is not younger than that; NULL: there is none. */
struct job *past_oldest(struct jobs *, int64_t finished_us);
/* The oldest job that is kept here of the user who has most of that, `more` added to what this one has; of users who have
 * nothing here there is none. NULL: nothing is kept. */
struct job *past_of_most(struct jobs *, enum past_kind, uint32_t uid, uint64_t more);
bool past_has(const struct jobs *, uint64_t id);
/* The dataset is about to go: jobs that are kept use it no more. */
void past_forget_dataset(struct jobs *, struct dataset *);
size_t past_count(const struct jobs *);                /* all jobs */
uint64_t past_bytes(const struct jobs *);              /* that are charged for those that are kept */
void past_numbers(const struct jobs *, uint64_t *ret); /* of all jobs, ascending */
/* Their numbers, first those whose dataset is there: gives how many these are. */
size_t past_list(const struct jobs *, uint64_t *ret);
struct past_views { /* bytes of views' texts: of all, and of one user; `busy`: of jobs that are not kept, and so cannot go */
	uint64_t all, busy, own, own_busy;
};
void past_views(const struct jobs *, uint32_t uid, struct past_views *ret);
void past_round(struct jobs *); /* guests are gone; what they lay in with the first round that has none */
void past_free(struct jobs *);

#endif
