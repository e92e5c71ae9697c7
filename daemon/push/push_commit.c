/*
 * The commit of a push: what was staged becomes a segment, then a manifest that names it, then a row of the catalogue; each is
 * durable before the next. Commits into one dataset take turns; each builds on the newest manifest.
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

/* Otherwise its points are dropped: of files of the pending push that were not named again, which stay there, and of files that
 * were not read whole. Both lists are sorted: numbers of sources increase. */
static bool is_committed(void *push, uint32_t id)
{
	const struct push *p = push;
	const struct grid_source key = {.id = id}, *hit = NULL;

	if (p->nsources && bsearch(&key, p->sources, p->nsources, sizeof key, by_id))
		return true;
	if (p->adopt && p->adopt->nsources)
		hit = bsearch(&key, p->adopt->sources, p->adopt->nsources, sizeof key, by_id);
	return hit && p->adopt_named[hit - p->adopt->sources];
}

/* There is nothing to add or remove, so a named dataset gets no generation. A one-step dataset needs one, even if it is empty. */
static bool changes_nothing(const struct push *p)
{
	uint64_t points = p->dataset->onestep || p->nreplaced ? 1 : 0;

	for (size_t i = 0; i < p->nsources; i++)
		points |= p->sources[i].points;
	for (size_t i = 0; p->adopt && i < p->adopt->nsources; i++)
		points |= p->adopt_named[i] ? p->adopt->sources[i].points : 0;
	return !points && !push_lines_change(p);
}

int push_commit_start(struct push *p, struct push_request *rq, struct err *err)
{
	struct dataset *d = p->dataset;

	if (!p->commit_ns)
		p->commit_ns = clock_mono_ns();
	if (!p->nsources && !p->nadopt_named)
		return d->generation ? PUSH_NOW : err_set(err, ERR_INPUT, "no file was staged: there is nothing to commit");
	if (changes_nothing(p))
		return PUSH_NOW;
	if (d->committer && d->committer != p)
		return PUSH_WAIT;
	if (push_lines_need_memory(p))
		return push_request_new(p, PUSH_PARK, NULL, true) ? 0 : err_set(err, ERR_NOMEM, "no memory for a request");
	if (!p->stage)
		return push_request_new(p, PUSH_STAGE, NULL, true) ? 0 : err_set(err, ERR_NOMEM, "no memory for a request");
	p->lines.id = push_lines_change(p) ? dataset_next_source(d) : 0;
	dataset_commit_begin(d, p);
	memcpy(p->base_name, d->manifest, sizeof p->base_name);
	/* The name is unique, so a push that fails removes only its own files. */
	snprintf(p->made_name, sizeof p->made_name, "manifest-%llu-%llu", (unsigned long long)d->generation + 1,
		 (unsigned long long)p->id);
	dataset_sources_name(p->made_name, p->sources_name);
	return 0;
}

/* ---- what other pushes have committed since this one began ---- */

static int refuse_newer(struct push *p, const char *what, struct err *err)
{
	err_set(err, ERR_BUSY, "another push has meanwhile given the dataset %s %s", p->dataset->name, what);
	return err_add_hint(err, "push again: what is there already is then skipped");
}

/* Paths of sources that were added since. */
static int newer_paths(const struct push *p, struct names *ret, struct err *err)
{
	const struct grid_manifest *m = p->base;
	int r = 0;

	for (size_t i = 0; !r && i < m->nsources; i++)
		if (m->sources[i].added > p->base_generation && !m->sources[i].removed && *m->sources[i].path)
			r = names_put(ret, m->sources[i].path, (uint32_t)i, err);
	return r;
}

static bool has_path(const struct names *paths, const struct grid_source *s)
{
	size_t at = NAMES_START;
	uint32_t i;

	return *s->path && names_next(paths, s->path, &at, &i);
}

/* Repeats the checks of the beginning against the newest manifest: paths, lattice, coordinate system, heights. */
static int check_newer(struct push *p, struct err *err)
{
	const struct grid_manifest *m = p->base;
	struct names paths = {0};
	const struct grid_source *twice = NULL;
	struct err ignored = ERR_INIT;
	int r;

	if (!m || m->generation == p->base_generation)
		return 0;
	if (!lattice_equal(&m->lattice, &p->agree.lattice))
		return refuse_newer(p, "another lattice", err);
	if (!agree_is(&p->agree, m->crs, m->unit_xy, m->unit_z))
		return refuse_newer(p, "another coordinate system", err);
	if (push_heights(p, &ignored))
		return refuse_newer(p, "heights of another geoid", err);
	r = newer_paths(p, &paths, err);
	for (size_t i = 0; !r && !twice && i < p->nsources; i++)
		twice = has_path(&paths, &p->sources[i]) ? &p->sources[i] : NULL;
	for (size_t i = 0; !r && !twice && p->adopt && i < p->adopt->nsources; i++)
		twice = p->adopt_named[i] && has_path(&paths, &p->adopt->sources[i]) ? &p->adopt->sources[i] : NULL;
	names_free(&paths);
	if (!twice)
		return r;
	refuse_newer(p, "this file", err);
	return err_add_file(err, twice->path);
}

static int write_manifest(struct push *p, const struct grid_manifest *m, struct err *err)
{
	int dirfd = p->dataset->dirfd, r;

	p->apart.name = p->sources_name;
	r = grid_manifest_write_apart(dirfd, p->made_name, &p->apart, m, err);
	if (r)
		return r;
	r = grid_manifest_read(dirfd, p->made_name, &p->made, err);
	if (r)
		dataset_remove_made(dirfd, p->made_name, &p->apart);
	return r;
}

/* The newest manifest with one more segment and the sources of this push. */
static int commit_manifest(struct push *p, const struct grid_segment_info *segment, struct err *err)
{
	size_t nseg = p->base ? p->base->nsegments : 0, nsrc = p->base ? p->base->nsources : 0, i, at = nsrc;
	uint64_t generation = (p->base ? p->base->generation : 0) + 1;
	struct grid_manifest m = {
		.lattice = p->agree.lattice,
		.generation = generation,
		.nsegments = nseg + (segment->points || !p->lines.id),
		.nsources = nsrc + p->nsources + p->nadopt_named,
	};
	char *wkt = push_wkt_put(p, &m);
	int r;

	m.segments = calloc(m.nsegments + 1, sizeof *m.segments);
	m.sources = calloc(m.nsources + 1, sizeof *m.sources);
	if (!m.segments || !m.sources) {
		r = err_set(err, ERR_NOMEM, "no memory for a manifest");
	} else {
		if (nseg)
			memcpy(m.segments, p->base->segments, nseg * sizeof *m.segments);
		if (nsrc)
			memcpy(m.sources, p->base->sources, nsrc * sizeof *m.sources);
		if (m.nsegments > nseg)
			m.segments[nseg] = *segment;
		for (i = 0; p->adopt && i < p->adopt->nsources; i++)
			if (p->adopt_named[i])
				m.sources[at++] = p->adopt->sources[i];
		for (i = 0; i < p->nsources; i++)
			m.sources[at++] = p->sources[i];
		for (i = nsrc; i < at; i++)
			m.sources[i].added = generation;
		m.files = p->base ? p->base->files : NULL;
		m.nfiles = p->base ? p->base->nfiles : 0;
		r = push_replace_apply(p, &m, err);
		push_lines_put(p, &m);
		m.oldest = p->base ? p->base->oldest : 0;
		snprintf(m.crs, sizeof m.crs, "%s", p->agree.crs);
		memcpy(m.geoid, p->agree.geoid_text, sizeof m.geoid);
		snprintf(m.unit_xy, sizeof m.unit_xy, "%s", p->agree.unit_xy);
		snprintf(m.unit_z, sizeof m.unit_z, "%s", p->agree.unit_z);
		if (!r)
			r = dataset_note_generation(&m, p->base, &p->peer, p->nreplaced ? GRID_REPLACE : GRID_PUSH, 0, err);
		if (!r)
			r = write_manifest(p, &m, err);
	}
	free(m.segments);
	free(m.sources);
	free(m.generations);
	free(wkt);
	return r;
}

/* The segment has as many points as the manifest will say, so none of a file that is not committed. */
static int check_points(const struct push *p, const struct grid_segment_info *segment, struct err *err)
{
	uint64_t points = 0;

	for (size_t i = 0; i < p->nsources; i++)
		points += p->sources[i].points;
	for (size_t i = 0; p->adopt && i < p->adopt->nsources; i++)
		points += p->adopt_named[i] ? p->adopt->sources[i].points : 0;
	if (points == segment->points)
		return 0;
	err_set(err, ERR_CORRUPT, "of %llu staged points the segment has %llu", (unsigned long long)points,
		(unsigned long long)segment->points);
	return p->dataset->onestep ? -ERR_CORRUPT :
				     err_add_hint(err, "discard what was staged (acutctl dataset discard %s), and push again",
						  p->dataset->name);
}

/* The first part, by one worker. */
static void seal_begin(struct push *p, struct push_request *rq)
{
	/* Another push may have committed since this one began. */
	p->base = grid_manifest_free(p->base);
	if (*p->base_name)
		rq->r = grid_manifest_read(p->dataset->dirfd, p->base_name, &p->base, &rq->err);
	if (!rq->r && p->base)
		dataset_tidy(p->dataset, p->base_name, p->base);
	if (!rq->r)
		rq->r = check_newer(p, &rq->err);
	if (rq->r)
		return;
	rq->r = grid_stage_keep(p->stage, is_committed, p, &rq->err);
	if (!rq->r)
		rq->r = push_lines_build(p, &rq->err);
	if (!rq->r) {
		p->sealing = push_sealing_new(p, &rq->err);
		rq->r = -(int)rq->err.code;
	}
	if (rq->r)
		push_lines_undo(p);
	if (rq->r && !push_lines_again(p, &rq->err))
		p->stage = grid_stage_detach(p->stage);
}

/* The second part, with helpers. */
static void seal_finish(struct push *p, struct push_request *rq)
{
	struct grid_segment_info segment = {0};
	struct err err = ERR_INIT;

	rq->r = push_sealing_finish(p->sealing, &segment, &rq->err);
	/* The staged files stay until the catalogue has the commit. */
	p->stage = grid_stage_detach(p->stage);
	if (rq->r) {
		push_lines_undo(p);
		return;
	}
	rq->r = check_points(p, &segment, &rq->err);
	if (!rq->r)
		rq->r = commit_manifest(p, &segment, &rq->err);
	/* Lines alone leave it empty. */
	if ((rq->r || (!segment.points && p->lines.id)) && io_remove(p->dataset->dirfd, segment.file, &err))
		dataset_left(p->dataset, &err);
	if (rq->r)
		push_lines_undo(p);
}

void push_commit_run(struct push *p, struct push_request *rq)
{
	seal_begin(p, rq);
}

static void seal_run(struct sched_task *t)
{
	struct push *p = (struct push *)((char *)t - offsetof(struct push, task));

	seal_finish(p, p->requests);
}

static void seal_done(struct sched_task *t)
{
	struct push *p = (struct push *)((char *)t - offsetof(struct push, task));

	if (!t->ran)
		p->requests->r = err_set(&p->requests->err, ERR_CANCELLED, "the push was ended");
	push_sealing_end(p->sealing);
}

/* Loop: continues the commit with helpers. */
static void seal_start(struct push *p)
{
	p->task = (struct sched_task){
		.run = seal_run, .done = seal_done, .owner = p->owner, .priority = SCHED_NORMAL, .lengthy = true};
	sched_submit(p->pushes->core->p.sched, &p->task);
	push_sealing_start(p->sealing);
}

/* The row is durable: the dataset has the new generation, and nothing here can fail. */
static void commit_answer(struct push *p, const struct err *why)
{
	struct dataset *d = p->dataset;
	struct push_committed done = {.dataset = d};
	struct err err = ERR_INIT;
	void *token = p->requests->token;

	if (!why && p->made) {
		dataset_set_seconds(d, clock_since(p->begun_ns), p->commit_ns ? clock_since(p->commit_ns) : 0);
		p->removes_old_manifest = !dataset_is_read(d);
		dataset_next_install(d, &p->new_state, !p->removes_old_manifest && *p->base_name);
	}
	p->committed = !why;
	if (!why)
		push_offers_committed(p);
	if (!why)
		push_space_end(p); /* the dataset's bytes count now */
	dataset_commit_end(d, p);
	dataset_plan_end(d, p);
	if (why)
		push_break(p, why);
	if (!why && p->made)
		push_event_committed(p);
	if (!why && !d->onestep && p->durable < p->files) {
		p->durable = p->files;
		p->calls.durable(p->ctx, p->durable);
	}
	done.generation = d->generation;
	done.points = d->points;
	done.unchanged = !p->made;
	done.lattice = &p->agree.lattice;
	done.lines = !why && p->made && p->lines.built ? &p->lines.made.counts : NULL;
	/* `why` may be in the request, which is freed first. */
	if (why)
		err = *why;
	push_request_end(p);
	p->calls.committed(token, why ? &err : NULL, why ? NULL : &done);
}

static void commit_row_written(void *ctx, int r, const struct err *why)
{
	struct push *p = ctx;

	p->commit_row_queued = false;
	dataset_row_written(p->dataset);
	commit_answer(p, r ? why : NULL);
	push_pump(p);
}

bool push_commit_done(struct push *p, struct push_request *rq, const struct err *why)
{
	struct err err = ERR_INIT;

	if (p->sealing && !rq->sealing) {
		rq->sealing = true;
		seal_start(p);
		return false;
	}
	p->sealing = push_sealing_free(p->sealing);
	if (why && !rq->sealing && p->stage && !p->broken && p->lines.want > p->lines.have) {
		/* The line set needs more memory: the commit starts again. */
		dataset_commit_end(p->dataset, p);
		rq->r = 0;
		rq->err = ERR_INIT;
		p->busy = false;
		return false;
	}
	if (!p->stage)
		push_stage_give(p);
	if (!why && p->made &&
	    dataset_next_make(p->dataset, p->made, &p->apart, p->made_name, clock_real_us(), &p->new_state, &err))
		why = &err;
	if (!why && p->made && !p->dataset->onestep) {
		if (!dataset_next_put(p->dataset, &p->new_state, 0, commit_row_written, p, &err)) {
			p->commit_row_queued = true;
			return false;
		}
		why = &err;
	}
	commit_answer(p, why);
	return false;
}
