/*
 * What the house keeps in mind: datasets, jobs, pushes, walks, and the views of these. Each is small, but their
 * number is the users' business: all of it is charged before it is kept, and refused, with a sentence, when the part
 * of the memory for it is used up.
 *
 * What lasts, datasets and jobs, is not given all of that part: with no room left for walks and pushes no job would ever end,
 * and none of it go. Of jobs that are over those of the user give way who has most of them, the oldest first.
 */
#include <stdlib.h>
#include <string.h>

#include "job_priv.h"

static int full(struct jobs *j, const char *what, struct err *err)
{
	err_set(err, ERR_BUSY, "no memory is left for %s: %llu KiB are held for datasets, jobs and pushes", what,
		(unsigned long long)ledger_held(j->p.ledger, LEDGER_JOBS) >> 10);
	return err_add_hint(err, "remove datasets and jobs that nobody needs (acutctl rm), or give acutd more memory");
}

/* Of a view whose text has n bytes with its end. */
static uint64_t view_bytes(uint64_t n, unsigned areas)
{
	/* Two copies of the text; of an area a corner for each four bytes at most: itself (with what a growing array
	 * has in hand), its edge, its place in lists of edges, and 40 KiB of cells and strips (view_area.c). */
	const uint64_t corner = 32 + 40 + 16, fixed = 40 << 10;

	return 2 * n + (areas ? n / 4 * corner + areas * fixed : 0);
}

/* What stays for what comes and goes: a quarter, or a walk by the largest view with its window, if that is not more than half. */
static uint64_t passing_part(uint64_t most)
{
	uint64_t view = view_bytes(VIEW_TEXT_MAX, 2), part = most / 4 > view ? most / 4 : view;

	return part < most / 2 ? part : most / 2;
}

int house_take(struct jobs *j, uint64_t bytes, const char *what, struct err *err)
{
	return ledger_take(j->p.ledger, LEDGER_JOBS, bytes) ? 0 : full(j, what, err);
}

int house_take_lasting(struct jobs *j, uint32_t uid, uint64_t bytes, const char *what, struct err *err)
{
	uint64_t most = ledger_most(j->p.ledger, LEDGER_JOBS);

	most -= passing_part(most);
	while (ledger_held(j->p.ledger, LEDGER_JOBS) + bytes > most || !ledger_take(j->p.ledger, LEDGER_JOBS, bytes))
		if (!jobs_forget_one(j, PAST_BYTES, uid, bytes))
			/* What a start finds is there already. */
			return j->loading ? house_take(j, bytes, what, err) : full(j, what, err);
	return 0;
}

void house_give(struct jobs *j, uint64_t bytes)
{
	if (bytes)
		ledger_give(j->p.ledger, LEDGER_JOBS, bytes);
}

uint64_t house_view_bytes(const char *text, unsigned areas)
{
	return view_bytes(strlen(text) + 1, areas);
}

struct pending *pending_new(struct jobs *j, uint32_t uid, struct err *err)
{
	struct pending *q;

	if (house_take_lasting(j, uid, PENDING_BYTES, "another push", err))
		return NULL;
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
