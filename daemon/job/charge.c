/*
 * What the service keeps in mind: datasets, jobs, pushes, runs, and the views of these. Each is small, but their
 * number is the users' business: all of it is charged before it is kept, and refused, with a sentence, when the part
 * of the memory for it is used up.
 *
 * What lasts is not given all of that part: datasets leave some to jobs, and these to runs and pushes, or no job would ever end
 * and none of it go. Of jobs that are over those of the user give way who has most of them, the oldest first.
 */
#include <stdlib.h>
#include <string.h>

#include "job_priv.h"

enum { FORGOTTEN_MAX = 64 }; /* at a time: each is a change of the catalogue */

static int full(struct jobs *j, const char *what, struct err *err)
{
	err_set(err, ERR_BUSY, "no memory is left for %s: %llu KiB are held for datasets, jobs and pushes", what,
		(unsigned long long)ledger_held(j->p.ledger, LEDGER_JOBS) >> 10);
	return err_add_hint(err, "remove datasets and jobs that nobody needs (acutctl rm), or give acutd more memory");
}

int charge(struct jobs *j, uint64_t bytes, const char *what, struct err *err)
{
	THREAD_LOOP_ONLY();
	if (ledger_take(j->p.ledger, LEDGER_JOBS, bytes))
		return 0;
	j->lacks = bytes > j->lacks ? bytes : j->lacks;
	return full(j, what, err);
}

bool charge_make_room(struct jobs *j)
{
	uint64_t held = ledger_held(j->p.ledger, LEDGER_JOBS), most = ledger_limit(j->p.ledger, LEDGER_JOBS), lacks = j->lacks;
	unsigned n = 0;

	THREAD_LOOP_ONLY();
	/* Some at a time, as those that are too old (jobs.c). */
	if (!lacks || catalogue_busy(j->p.catalogue))
		return false;
	j->lacks = 0;
	/* Not where domains have the memory, nor where it would not be enough. */
	if (held + lacks <= most || held - history_bytes(j) + lacks > most)
		return false;
	while (n < FORGOTTEN_MAX && ledger_held(j->p.ledger, LEDGER_JOBS) + lacks > most &&
	       jobs_forget_one(j, HISTORY_BYTES, 0, 0))
		n++;
	if (n == FORGOTTEN_MAX)
		j->lacks = lacks;
	return n;
}

int charge_lasting(struct jobs *j, enum charge_lasting_kind kind, uint32_t uid, uint64_t bytes, const char *what, struct err *err)
{
	uint64_t most = ledger_limit(j->p.ledger, LEDGER_JOBS);

	THREAD_LOOP_ONLY();
	most -= most / kind;
	while (ledger_held(j->p.ledger, LEDGER_JOBS) + bytes > most || !ledger_take(j->p.ledger, LEDGER_JOBS, bytes))
		if (!jobs_forget_one(j, HISTORY_BYTES, uid, bytes))
			/* What a start finds is there already. */
			return j->loading ? charge(j, bytes, what, err) : full(j, what, err);
	return 0;
}

void uncharge(struct jobs *j, uint64_t bytes)
{
	THREAD_LOOP_ONLY();
	if (bytes)
		ledger_give(j->p.ledger, LEDGER_JOBS, bytes);
}

uint64_t charge_view_bytes(const char *text, unsigned areas)
{
	/* Two copies of the text; of an area a corner for each four bytes at most: itself (with what a growing array
	 * has in hand), its edge, its place in lists of edges, and 40 KiB of cells and strips (view_area.c). */
	const uint64_t corner = 32 + 40 + 16, fixed = 40 << 10;
	uint64_t n = strlen(text) + 1;

	return 2 * n + (areas ? n / 4 * corner + areas * fixed : 0);
}

struct pending *pending_new(struct jobs *j, uint32_t uid, struct err *err)
{
	struct pending *q;

	THREAD_LOOP_ONLY();
	if (charge_lasting(j, CHARGE_JOB, uid, PENDING_BYTES, "another push", err))
		return NULL;
	q = calloc(1, sizeof *q);
	if (!q) {
		uncharge(j, PENDING_BYTES);
		err_set(err, ERR_NOMEM, "no memory for a push");
	}
	return q;
}

struct pending *pending_free(struct jobs *j, struct pending *q)
{
	THREAD_LOOP_ONLY();
	if (q)
		uncharge(j, PENDING_BYTES);
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

		if (!job->run)
			continue;
		run_progress(job->run, &points, &all, &done, &total);
		work.domains_done += done;
		work.domains_total += total;
	}
	*ret = work;
}
