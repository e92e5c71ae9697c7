/*
 * What the house keeps in mind: datasets, jobs, pushes, walks, and the views of these. Each is small, but their
 * number is the users' business: all of it is charged before it is kept, and refused, with a sentence, when the part
 * of the memory for it is used up. Of jobs that are over those of the user give way who has most of them, the oldest first.
 */
#include <stdlib.h>
#include <string.h>

#include "job_priv.h"

int house_take(struct jobs *j, uint64_t bytes, const char *what, struct err *err)
{
	if (ledger_take(j->p.ledger, LEDGER_JOBS, bytes))
		return 0;
	err_set(err, ERR_BUSY, "no memory is left for %s: %llu KiB are held for datasets, jobs and pushes", what,
		(unsigned long long)ledger_held(j->p.ledger, LEDGER_JOBS) >> 10);
	return err_add_hint(err, "remove datasets and jobs that nobody needs (acutctl rm), or give acutd more memory");
}

void house_give(struct jobs *j, uint64_t bytes)
{
	if (bytes)
		ledger_give(j->p.ledger, LEDGER_JOBS, bytes);
}

int house_take_job(struct jobs *j, uint32_t uid, uint64_t bytes, struct err *err)
{
	struct err why = ERR_INIT;

	while (house_take(j, bytes, "another job", &why))
		if (!jobs_forget_one(j, PAST_BYTES, uid, bytes)) {
			*err = why;
			return -(int)err->code;
		}
	return 0;
}

uint64_t house_view_bytes(const char *text, unsigned areas)
{
	/* Two copies of the text; of an area a corner for each four bytes at most: itself (with what a growing array
	 * has in hand), its edge, its place in lists of edges, and 40 KiB of cells and strips (view_area.c). */
	const uint64_t corner = 32 + 40 + 16, fixed = 40 << 10;
	uint64_t n = strlen(text) + 1;

	return 2 * n + (areas ? n / 4 * corner + areas * fixed : 0);
}

struct pending *pending_new(struct jobs *j, struct err *err)
{
	struct pending *q = NULL;
	struct err why = ERR_INIT;

	/* What a start finds is there already: jobs that are over give way to it. */
	while (house_take(j, PENDING_BYTES, "another push", &why))
		if (!j->loading || !jobs_forget_one(j, PAST_BYTES, 0, 0)) {
			*err = why;
			return NULL;
		}
	q = calloc(1, sizeof *q);
	if (!q) {
		house_give(j, PENDING_BYTES);
		err_set(err, ERR_NOMEM, "no memory for a push");
	}
	return q;
}

struct pending *pending_free(struct jobs *j, struct pending *q)
{
	if (q)
		house_give(j, PENDING_BYTES);
	free(q);
	return NULL;
}

void jobs_work(const struct jobs *j, struct jobs_work *ret)
{
	struct jobs_work work = {0};

	jobs_count(j, &work.running, &work.waiting);
	for (struct push *p = j->pushes; p; p = push_next(p))
		work.pushes++;
	for (const struct job *job = j->jobs; job; job = job->next) {
		uint64_t points, all, done, total;

		if (!job->walk)
			continue;
		walk_progress(job->walk, &points, &all, &done, &total);
		work.domains_done += done;
		work.domains_total += total;
	}
	*ret = work;
}
