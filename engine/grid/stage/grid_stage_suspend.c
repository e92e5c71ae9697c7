/*
 * Suspending and resuming stages, and dropping sources (grid_stage.h).
 *
 * A state file (grid_state.h) names the runs that hold everything added so far. A run that it names is removed only
 * after a newer state file was written, or with the stage. Records of a dropped source are removed from memory at once;
 * those in runs are omitted when the segment is made. They stay in the runs, also when runs are merged, so the state file
 * names their source, too: whoever resumes the stage drops it again, or uses it.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_run_old.h"
#include "grid_stage_priv.h"
#include "grid_state.h"
#include "io.h"
#include "order.h"

/* ---- dropping ---- */

/* Removes the records of sources that do not stay, by their index, from memory. */
static void remove_sources(struct grid_stage *s, const bool stays[POINT_SOURCES])
{
	size_t kept = 0;

	for (size_t i = 0; i < s->lane[0].n; i++)
		if (stays[point_source(&s->pts[i])])
			s->pts[kept++] = s->pts[i];
	s->lane[0].n = kept;
}

int grid_stage_keep(struct grid_stage *s, bool (*keeps)(void *ctx, uint32_t id), void *ctx, struct err *err)
{
	bool stays[POINT_SOURCES], all = true;
	uint32_t kept = 0;
	int rc = grid_stage_usable(s, err);

	if (rc)
		return rc;
	for (uint32_t i = 0; i < s->ntable; i++) {
		stays[i] = keeps(ctx, s->table[i]);
		all &= stays[i];
	}
	if (!all)
		remove_sources(s, stays);
	for (uint32_t i = 0; rc == 0 && i < s->nall; i++) {
		if (keeps(ctx, s->all[i]))
			s->all[kept++] = s->all[i];
		else if (s->nruns)
			rc = grid_stage_insert(&s->dropped, &s->ndropped, &s->droppedcap, s->all[i], err);
	}
	s->nall = kept;
	return grid_stage_fail(s, rc);
}

size_t grid_stage_filter_dropped(const struct grid_stage *s, struct point *pts, uint32_t *ids, size_t n)
{
	size_t kept = 0;

	if (!s->ndropped)
		return n;
	for (size_t i = 0; i < n; i++) {
		if (bsearch(&ids[i], s->dropped, s->ndropped, sizeof *s->dropped, order_u32))
			continue;
		pts[kept] = pts[i];
		ids[kept++] = ids[i];
	}
	return kept;
}

/* ---- suspending ---- */

/* Every source that may have records in runs, ascending; s->nall + s->ndropped numbers. NULL: no memory. */
static uint32_t *sources_of_runs(const struct grid_stage *s)
{
	uint32_t *ret = malloc((s->nall + s->ndropped + 1) * sizeof *ret);
	size_t n = 0;

	for (uint32_t i = 0, k = 0; ret && (i < s->nall || k < s->ndropped);)
		ret[n++] = k == s->ndropped || (i < s->nall && s->all[i] < s->dropped[k]) ? s->all[i++] : s->dropped[k++];
	return ret;
}

int grid_stage_write_state(struct grid_stage *s, size_t gone, struct err *err)
{
	uint32_t *sources = sources_of_runs(s);
	const struct grid_state state = {
		.next_run = s->next_run,
		.runs = s->runs + gone,
		.nruns = s->nruns - gone,
		.sources = sources,
		.nsources = s->nall + s->ndropped,
	};
	int rc = sources ? grid_state_write(s->dirfd, s->stem, &state, s->durable, err) :
			   err_set(err, ERR_NOMEM, "no memory for the state of a stage");

	free(sources);
	if (rc)
		return rc;
	s->suspended = true;
	s->state_next = s->next_run;
	return 0;
}

int grid_stage_suspend(struct grid_stage *s, struct err *err)
{
	int rc = grid_stage_usable(s, err);

	if (rc)
		return rc;
	rc = grid_stage_spill(s, err);
	if (rc == 0 && s->unsynced && s->durable)
		rc = io_sync(s->dirfd, s->stem, err);
	s->unsynced = s->unsynced && (rc || !s->durable);
	if (rc == 0)
		rc = grid_stage_write_state(s, 0, err);
	return grid_stage_fail(s, rc);
}

/* Converts runs of an older version, under new numbers. The old runs count until the state names the new ones; after a crash
 * the conversion begins again. */
static int convert_runs(struct grid_stage *s, struct err *err)
{
	char name[GRID_NAME_MAX], to[GRID_NAME_MAX];
	uint64_t bytes;
	bool older = false;
	int rc = 0;

	for (size_t i = 0; rc == 0 && i < s->nruns; i++) {
		grid_run_name(s->stem, s->runs[i], name);
		rc = grid_run_check(s->dirfd, name, &older, &bytes, err);
		if (rc || !older)
			continue;
		grid_run_name(s->stem, s->next_run, to);
		rc = grid_run_convert(s->dirfd, name, to, s->durable, err);
		if (rc == 0)
			s->runs[i] = s->next_run++;
	}
	if (rc == 0)
		rc = grid_stage_write_state(s, 0, err);
	if (rc == 0) {
		const struct grid_state state = {.next_run = s->next_run, .runs = s->runs, .nruns = s->nruns};

		rc = grid_state_trim(s->dirfd, s->stem, &state, err);
	}
	return rc;
}

int grid_stage_resume(const struct grid_stage_params *params, struct grid_stage **ret, struct err *err)
{
	struct grid_state state;
	struct grid_stage *s;
	int rc = grid_state_read(params->dirfd, params->name, &state, err);

	if (rc)
		return rc;
	rc = grid_stage_new(params, &s, err);
	if (rc == 0) {
		s->all = malloc((state.nsources + 1) * sizeof *s->all);
		s->runs = malloc((state.nruns + 1) * sizeof *s->runs);
		s->allcap = (uint32_t)state.nsources + 1;
		s->runcap = state.nruns + 1;
		s->next_run = s->state_next = state.next_run;
		s->suspended = true;
		if (!s->all || !s->runs)
			rc = err_set(err, ERR_NOMEM, "no memory for the state of a stage");
		else
			rc = grid_state_trim(s->dirfd, s->stem, &state, err);
		if (rc)
			grid_stage_detach(s);
	}
	if (rc == 0) {
		memcpy(s->all, state.sources, state.nsources * sizeof *s->all);
		memcpy(s->runs, state.runs, state.nruns * sizeof *s->runs);
		s->nall = (uint32_t)state.nsources;
		s->nruns = state.nruns;
		rc = state.older ? convert_runs(s, err) : 0;
		if (rc)
			grid_stage_detach(s);
		else
			*ret = s;
	}
	grid_state_free(&state);
	return rc;
}

int grid_stage_check(int dirfd, const char *name, uint32_t *ret_last, uint64_t *ret_bytes, struct err *err)
{
	struct grid_state state;
	int rc = grid_state_read(dirfd, name, &state, err);

	if (rc)
		return rc;
	*ret_last = state.nsources ? state.sources[state.nsources - 1] : 0;
	*ret_bytes = state.bytes;
	grid_state_free(&state);
	return 0;
}

struct grid_stage *grid_stage_detach(struct grid_stage *s)
{
	if (!s || !s->suspended)
		return grid_stage_free(s);
	for (size_t i = 0; i < s->nruns; i++)
		if (s->runs[i] >= s->state_next)
			grid_stage_remove_run(s, s->runs[i]);
	return grid_stage_release(s);
}

int grid_stage_discard(int dirfd, const char *name, struct err *err)
{
	struct err ignored = ERR_INIT;
	struct grid_state state = {0};
	char file[GRID_NAME_MAX];
	int rc = 0;

	grid_state_name(name, file);
	/* If the state is damaged, its runs are unknown: counting finds most of them, and a sweep of the folder the rest. */
	if (grid_state_read(dirfd, name, &state, &ignored))
		state = (struct grid_state){0};
	rc = io_remove(dirfd, file, err);
	state.nruns = 0;
	if (rc == 0)
		rc = grid_state_trim(dirfd, name, &state, err);
	grid_state_free(&state);
	return rc;
}
