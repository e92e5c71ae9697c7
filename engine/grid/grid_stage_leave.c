/*
 * Stages that are left and gone on with, and sources that are dropped (grid.h).
 *
 * A state file (grid_left.c) names the runs that hold all that was added until then. No run that it names is
 * removed before another state file, or the end of all, makes it needless. A dropped source's records in memory
 * go at once; those in runs are passed over when the segment is made.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_left.h"
#include "grid_run_old.h"
#include "grid_stage_priv.h"
#include "io.h"

static int by_id(const void *a, const void *b)
{
	uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

	return x < y ? -1 : x > y;
}

/* ---- dropping ---- */

/* Its records in memory go; the others close up. */
static void forget(struct grid_stage *s, uint32_t index)
{
	size_t kept = 0;

	for (size_t i = 0; i < s->lane[0].n; i++)
		if (point_source(&s->pts[i]) != index)
			s->pts[kept++] = s->pts[i];
	s->lane[0].n = kept;
}

int grid_stage_drop(struct grid_stage *s, uint32_t id, struct err *err)
{
	int rc = grid_stage_usable(s, err);
	uint32_t *hit = NULL;

	if (rc)
		return rc;
	if (s->nall)
		hit = bsearch(&id, s->all, s->nall, sizeof *s->all, by_id);
	if (!hit)
		return 0;
	for (uint32_t i = 0; i < s->ntable; i++)
		if (s->table[i] == id)
			forget(s, i);
	if (s->nruns)
		rc = grid_stage_insert(&s->dead, &s->ndead, &s->deadcap, id, err);
	if (rc)
		return grid_stage_fail(s, rc);
	s->nall--;
	memmove(hit, hit + 1, (size_t)(s->all + s->nall - hit) * sizeof *hit);
	return 0;
}

/* Of n merged records those that nobody dropped. */
size_t grid_stage_leave_out(const struct grid_stage *s, struct point *pts, uint32_t *ids, size_t n)
{
	size_t kept = 0;

	if (!s->ndead)
		return n;
	for (size_t i = 0; i < n; i++) {
		if (bsearch(&ids[i], s->dead, s->ndead, sizeof *s->dead, by_id))
			continue;
		pts[kept] = pts[i];
		ids[kept++] = ids[i];
	}
	return kept;
}

/* ---- leaving ---- */

/* The state without the `gone` oldest runs. */
int grid_stage_write_left(struct grid_stage *s, size_t gone, struct err *err)
{
	const struct grid_left left = {
		.next_run = s->next_run,
		.runs = s->runs + gone,
		.nruns = s->nruns - gone,
		.sources = s->all,
		.nsources = s->nall,
	};
	int rc = grid_left_write(s->dirfd, s->stem, &left, s->durable, err);

	if (rc)
		return rc;
	s->left = true;
	s->left_next = s->next_run;
	return 0;
}

int grid_stage_leave(struct grid_stage *s, struct err *err)
{
	int rc = grid_stage_usable(s, err);

	if (rc)
		return rc;
	rc = grid_stage_spill(s, err);
	if (rc == 0 && s->unsynced && s->durable)
		rc = io_sync(s->dirfd, s->stem, err);
	s->unsynced = s->unsynced && (rc || !s->durable);
	if (rc == 0)
		rc = grid_stage_write_left(s, 0, err);
	return grid_stage_fail(s, rc);
}

/* Runs of an older version become runs of this one, under new numbers: until the state names those, the old ones
 * count, and whoever resumes after a crash begins again. */
static int renew_runs(struct grid_stage *s, struct err *err)
{
	char name[GRID_NAME_MAX], to[GRID_NAME_MAX];
	bool older = false, any = false;
	int rc = 0;

	for (size_t i = 0; rc == 0 && i < s->nruns; i++) {
		grid_left_run_name(s->stem, s->runs[i], name);
		rc = grid_run_version(s->dirfd, name, &older, err);
		if (rc || !older)
			continue;
		grid_left_run_name(s->stem, s->next_run, to);
		rc = grid_run_convert(s->dirfd, name, to, s->durable, err);
		if (rc == 0)
			s->runs[i] = s->next_run++;
		any = true;
	}
	if (rc || !any)
		return rc;
	rc = grid_stage_write_left(s, 0, err);
	if (rc == 0) {
		const struct grid_left left = {.next_run = s->next_run, .runs = s->runs, .nruns = s->nruns};

		rc = grid_left_trim(s->dirfd, s->stem, &left, err);
	}
	return rc;
}

int grid_stage_resume(const struct grid_stage_params *params, struct grid_stage **ret, struct err *err)
{
	struct grid_left left;
	struct grid_stage *s;
	int rc = grid_left_read(params->dirfd, params->name, &left, err);

	if (rc)
		return rc;
	rc = grid_stage_new(params, &s, err);
	if (rc == 0) {
		s->all = malloc((left.nsources + 1) * sizeof *s->all);
		s->runs = malloc((left.nruns + 1) * sizeof *s->runs);
		s->allcap = (uint32_t)left.nsources + 1;
		s->runcap = left.nruns + 1;
		s->next_run = s->left_next = left.next_run;
		s->left = true;
		if (!s->all || !s->runs)
			rc = err_set(err, ERR_NOMEM, "no memory for the state of a stage");
		else
			rc = grid_left_trim(s->dirfd, s->stem, &left, err);
		if (rc)
			grid_stage_part(s);
	}
	if (rc == 0) {
		memcpy(s->all, left.sources, left.nsources * sizeof *s->all);
		memcpy(s->runs, left.runs, left.nruns * sizeof *s->runs);
		s->nall = (uint32_t)left.nsources;
		s->nruns = left.nruns;
		rc = renew_runs(s, err);
		if (rc)
			grid_stage_part(s);
		else
			*ret = s;
	}
	grid_left_free(&left);
	return rc;
}

int grid_stage_check(int dirfd, const char *name, uint32_t *ret_last, struct err *err)
{
	struct grid_left left;
	int rc = grid_left_read(dirfd, name, &left, err);

	if (rc)
		return rc;
	*ret_last = left.nsources ? left.sources[left.nsources - 1] : 0;
	grid_left_free(&left);
	return 0;
}

const uint32_t *grid_stage_sources(const struct grid_stage *s, size_t *ret_n)
{
	*ret_n = s->nall;
	return s->all;
}

struct grid_stage *grid_stage_part(struct grid_stage *s)
{
	if (!s || !s->left)
		return grid_stage_free(s);
	for (size_t i = 0; i < s->nruns; i++)
		if (s->runs[i] >= s->left_next)
			grid_stage_remove_run(s, s->runs[i]);
	return grid_stage_release(s);
}

int grid_stage_discard(int dirfd, const char *name, struct err *err)
{
	struct err ignored = ERR_INIT;
	struct grid_left left = {0};
	char file[GRID_NAME_MAX];
	int rc = 0;

	grid_left_name(name, file);
	/* Where it is damaged its runs are not known: counting finds most of them, a sweep of the folder the rest. */
	if (grid_left_read(dirfd, name, &left, &ignored))
		left = (struct grid_left){0};
	rc = io_remove(dirfd, file, err);
	left.nruns = 0;
	if (rc == 0)
		rc = grid_left_trim(dirfd, name, &left, err);
	grid_left_free(&left);
	return rc;
}
