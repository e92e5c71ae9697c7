/*
 * The commit of a push: what was staged becomes a segment, a manifest that names it, and a row of the
 * catalogue, in this order, each durable before the next. Commits into one dataset take turns; each builds on
 * the newest manifest.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "io.h"
#include "push_priv.h"

static int by_id(const void *a, const void *b)
{
	uint32_t x = ((const struct grid_source *)a)->id, y = ((const struct grid_source *)b)->id;

	return x < y ? -1 : x > y;
}

/* Numbers are given upwards, so both lists are in their order. */
static bool is_live(const struct push *p, uint32_t id)
{
	const struct grid_source key = {.id = id}, *hit = NULL;

	if (p->nsources && bsearch(&key, p->sources, p->nsources, sizeof key, by_id))
		return true;
	if (p->adopt && p->adopt->nsources)
		hit = bsearch(&key, p->adopt->sources, p->adopt->nsources, sizeof key, by_id);
	return hit && p->adopt_taken[hit - p->adopt->sources];
}

/* What the stage holds of files of the interrupted push that nobody asked for again, or that it had not read
 * whole, goes. */
static int drop_others(struct push *p, struct err *err)
{
	size_t n, i = 0;
	const uint32_t *ids = grid_stage_sources(p->stage, &n);
	int r = 0;

	while (!r && i < n) {
		if (is_live(p, ids[i])) {
			i++;
			continue;
		}
		r = grid_stage_drop(p->stage, ids[i], err);
		ids = grid_stage_sources(p->stage, &n);
	}
	return r;
}

/* Nothing would come and nothing go: a generation of a named dataset is what differs from the one before. A mesh of one step
 * has to have one, if only to say that it is empty. */
static bool changes_nothing(const struct push *p)
{
	uint64_t points = p->dataset->onestep || p->ngone ? 1 : 0;

	for (size_t i = 0; i < p->nsources; i++)
		points |= p->sources[i].points;
	for (size_t i = 0; p->adopt && i < p->adopt->nsources; i++)
		points |= p->adopt_taken[i] ? p->adopt->sources[i].points : 0;
	return !points;
}

int push_commit_start(struct push *p, struct push_ask *a, struct err *err)
{
	struct dataset *d = p->dataset;

	if (!p->commit_ns)
		p->commit_ns = clock_mono_ns();
	if (!p->nsources && !p->ntaken)
		return d->generation ? PUSH_NOW : err_set(err, ERR_INPUT, "no file was staged: there is nothing to commit");
	if (changes_nothing(p))
		return PUSH_NOW;
	if (d->committer && d->committer != p)
		return PUSH_WAIT;
	if (!p->stage)
		return push_ask_new(p, PUSH_STAGE, NULL, true) ? 0 : err_set(err, ERR_NOMEM, "no memory for a request");
	dataset_commit_begin(d, p);
	memcpy(p->base_name, d->manifest, sizeof p->base_name);
	/* No other push ever has this name: who fails removes only what is its own. */
	snprintf(p->made_name, sizeof p->made_name, "manifest-%llu-%llu", (unsigned long long)d->generation + 1,
		 (unsigned long long)p->id);
	return 0;
}

/* ---- what another push has committed since this one began ---- */

static int meanwhile(struct push *p, const char *what, struct err *err)
{
	err_set(err, ERR_BUSY, "another push has meanwhile given the dataset %s %s", p->dataset->name, what);
	return err_add_hint(err, "push again: what is there already is then skipped");
}

/* Sources of its commits. */
static int newer_paths(const struct push *p, struct names *ret, struct err *err)
{
	const struct grid_manifest *m = p->base;
	int r = 0;

	for (size_t i = 0; !r && i < m->nsources; i++)
		if (m->sources[i].added > p->base_generation && !m->sources[i].removed && *m->sources[i].path)
			r = names_put(ret, m->sources[i].path, (uint32_t)i, err);
	return r;
}

static bool is_there(const struct names *paths, const struct grid_source *s)
{
	size_t at = NAMES_START;
	uint32_t i;

	return *s->path && names_next(paths, s->path, &at, &i);
}

/* All that was asked of the base at the beginning is asked again: a file that is there, the lattice, and what
 * coordinates and heights are. */
static int check_newer(struct push *p, struct err *err)
{
	const struct grid_manifest *m = p->base;
	struct names paths = {0};
	const struct grid_source *twice = NULL;
	struct err ignored = ERR_INIT;
	int r;

	if (!m || m->generation == p->base_generation)
		return 0;
	if (!lattice_equal(&m->lattice, &p->lattice))
		return meanwhile(p, "another lattice", err);
	if (!push_crs_is(p, m))
		return meanwhile(p, "another coordinate system", err);
	if (push_plane_heights(p, &ignored))
		return meanwhile(p, "heights of another geoid", err);
	r = newer_paths(p, &paths, err);
	for (size_t i = 0; !r && !twice && i < p->nsources; i++)
		twice = is_there(&paths, &p->sources[i]) ? &p->sources[i] : NULL;
	for (size_t i = 0; !r && !twice && p->adopt && i < p->adopt->nsources; i++)
		twice = p->adopt_taken[i] && is_there(&paths, &p->adopt->sources[i]) ? &p->adopt->sources[i] : NULL;
	names_free(&paths);
	if (!twice)
		return r;
	meanwhile(p, "this file", err);
	return err_add_file(err, twice->path);
}

/* The newest manifest, one segment and this push's sources more. */
static int commit_manifest(struct push *p, const struct grid_segment_info *segment, struct err *err)
{
	size_t nseg = p->base ? p->base->nsegments : 0, nsrc = p->base ? p->base->nsources : 0, i, at = nsrc;
	uint64_t generation = (p->base ? p->base->generation : 0) + 1;
	struct grid_manifest m = {
		.lattice = p->lattice,
		.generation = generation,
		.nsegments = nseg + 1,
		.nsources = nsrc + p->nsources + p->ntaken,
	};
	int r;

	m.segments = calloc(m.nsegments, sizeof *m.segments);
	m.sources = calloc(m.nsources, sizeof *m.sources);
	if (!m.segments || !m.sources) {
		r = err_set(err, ERR_NOMEM, "no memory for a manifest");
	} else {
		if (nseg)
			memcpy(m.segments, p->base->segments, nseg * sizeof *m.segments);
		if (nsrc)
			memcpy(m.sources, p->base->sources, nsrc * sizeof *m.sources);
		m.segments[nseg] = *segment;
		for (i = 0; p->adopt && i < p->adopt->nsources; i++)
			if (p->adopt_taken[i])
				m.sources[at++] = p->adopt->sources[i];
		for (i = 0; i < p->nsources; i++)
			m.sources[at++] = p->sources[i];
		for (i = nsrc; i < at; i++)
			m.sources[i].added = generation;
		r = push_replace_apply(p, &m, err);
		m.oldest = p->base ? p->base->oldest : 0;
		snprintf(m.crs, sizeof m.crs, "%s", p->crs);
		memcpy(m.geoid, p->plane.geoid, sizeof m.geoid);
		snprintf(m.unit_xy, sizeof m.unit_xy, "%s", p->unit_xy);
		snprintf(m.unit_z, sizeof m.unit_z, "%s", p->unit_z);
		if (!r)
			r = dataset_note_generation(&m, p->base, &p->peer, p->ngone ? GRID_REPLACE : GRID_PUSH, 0, err);
		if (!r)
			r = grid_manifest_write(p->dataset->dirfd, p->made_name, &m, err);
		if (!r)
			r = grid_manifest_read(p->dataset->dirfd, p->made_name, &p->made, err);
	}
	free(m.segments);
	free(m.sources);
	free(m.generations);
	return r;
}

/* First what is there to be sealed. */
static void seal_begin(struct push *p, struct push_ask *a)
{
	dataset_tidy(p->dataset, p->base_name);
	/* Another push may have committed since this one began. */
	p->base = grid_manifest_free(p->base);
	if (*p->base_name)
		a->r = grid_manifest_read(p->dataset->dirfd, p->base_name, &p->base, &a->err);
	if (!a->r)
		a->r = check_newer(p, &a->err);
	if (a->r)
		return;
	a->r = drop_others(p, &a->err);
	if (!a->r) {
		p->sealing = push_sealing_new(p, &a->err);
		a->r = -(int)a->err.code;
	}
	if (a->r)
		p->stage = grid_stage_detach(p->stage);
}

/* Then, with helpers, the rest. */
static void seal_finish(struct push *p, struct push_ask *a)
{
	struct grid_segment_info segment = {0};

	a->r = push_sealing_finish(p->sealing, &segment, &a->err);
	/* What was promised lies there until the catalogue has the commit. */
	p->stage = grid_stage_detach(p->stage);
	if (a->r)
		return;
	a->r = commit_manifest(p, &segment, &a->err);
	if (a->r)
		io->unlinkat(p->dataset->dirfd, segment.file, 0);
}

void push_commit_run(struct push *p, struct push_ask *a)
{
	seal_begin(p, a);
}

static void deferred_run(struct sched_task *t)
{
	struct push *p = (struct push *)((char *)t - offsetof(struct push, task));

	seal_finish(p, p->asks);
}

static void deferred_done(struct sched_task *t)
{
	struct push *p = (struct push *)((char *)t - offsetof(struct push, task));

	if (!t->ran)
		p->asks->r = err_set(&p->asks->err, ERR_CANCELLED, "the push was ended");
	push_sealing_end(p->sealing);
}

/* Loop: what the commit's task began goes on by as many as there are. */
static void seal_rest(struct push *p)
{
	p->task = (struct sched_task){
		.run = deferred_run, .done = deferred_done, .owner = p->owner, .priority = SCHED_NORMAL, .lengthy = true};
	sched_submit(p->pushes->core->p.sched, &p->task);
	push_sealing_start(p->sealing);
}

/* The dataset shows the new generation from here on. What is durable counts: nothing of this fails. */
static void commit_answer(struct push *p, const struct err *why)
{
	struct dataset *d = p->dataset;
	struct push_committed done = {.dataset = d};
	struct err err = ERR_INIT;
	void *token = p->asks->token;

	if (!why && p->made) {
		dataset_set_seconds(d, clock_since(p->begun_ns), p->commit_ns ? clock_since(p->commit_ns) : 0);
		p->old_goes = !dataset_is_read(d);
		dataset_next_install(d, &p->becomes, !p->old_goes && *p->base_name);
	}
	p->committed = !why;
	if (!why)
		push_space_end(p); /* the dataset's bytes count now */
	dataset_commit_end(d, p);
	dataset_plan_end(d, p);
	if (why)
		push_break(p, why);
	if (!why && p->made)
		push_tell_committed(p);
	if (!why && !d->onestep && p->durable < p->files) {
		p->durable = p->files;
		p->calls.durable(p->ctx, p->durable);
	}
	done.generation = d->generation;
	done.points = d->points;
	done.unchanged = !p->made;
	/* The reason may be of the ask, which goes first. */
	if (why)
		err = *why;
	push_ask_over(p);
	p->calls.committed(token, why ? &err : NULL, why ? NULL : &done);
}

static void commit_row_done(void *ctx, int r, const struct err *why)
{
	struct push *p = ctx;

	p->waiting_row = false;
	dataset_row_written(p->dataset);
	commit_answer(p, r ? why : NULL);
	push_pump(p);
}

bool push_commit_done(struct push *p, struct push_ask *a, const struct err *why)
{
	struct err err = ERR_INIT;

	if (p->sealing && !a->sealing) {
		a->sealing = true;
		seal_rest(p);
		return false;
	}
	p->sealing = push_sealing_free(p->sealing);
	if (!p->stage)
		push_stage_give(p);
	if (!why && p->made && dataset_next_make(p->dataset, p->made, p->made_name, clock_real_us(), &p->becomes, &err))
		why = &err;
	if (!why && p->made && !p->dataset->onestep) {
		if (!dataset_next_put(p->dataset, &p->becomes, 0, commit_row_done, p, &err)) {
			p->waiting_row = true;
			return false;
		}
		why = &err;
	}
	commit_answer(p, why);
	return false;
}
