/*
 * The line set of a generation that no push makes.
 *
 * The model: a change that finds that a line set must be made gives up its turn. It waits for memory, for disk space, and until
 * the catalogue has a row as that of a merge; others are not kept waiting meanwhile. Then it takes its turn again, and a worker
 * makes the line set, its places, and a segment of its vertices. All of them are durable before the manifest that names them.
 * Until the catalogue names that manifest nothing has changed: the files are removed, now or by the next start, which finds the
 * row. There may be more lines by then than the memory was taken for. In that case the change starts again.
 */
#include "dataset_lines.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io.h"
#include "log.h"

/* ---- worker: an earlier line set ---- */

/* The live source of line vertices, and one that was made of lines with that content: the live one, or the latest. */
static void find_sets(struct grid_manifest *m, struct digest content, uint64_t pruned, struct grid_source **now,
		      struct grid_source **then)
{
	for (size_t i = 0; i < m->nsources; i++) {
		struct grid_source *s = &m->sources[i];

		if (s->kind != GRID_LINE_VERTICES)
			continue;
		if (!s->removed)
			*now = s;
		if (digest_equal(s->lines->content, content) && (!*then || (*then)->removed) &&
		    (!s->removed || s->removed > pruned))
			*then = s;
	}
}

/* ---- worker: a new line set ---- */

static int lack(struct dataset_lines *l, uint64_t bytes, bool exact, struct err *err)
{
	l->lacks = true;
	l->want = bytes;
	l->exact = exact;
	return err_set(err, ERR_BUSY, "no memory for the line set of the dataset %s", l->dataset->name);
}

/* Makes the line set of n sources. */
static int make(struct dataset_lines *l, struct grid_manifest *m, const struct grid_source *const *lines, size_t n,
		struct err *err)
{
	const struct breaklines_params p = {
		.dirfd = l->dataset->dirfd, .lines = lines, .nlines = n, .id = l->id, .memory = l->have, .lattice = &m->lattice};
	uint64_t vertices = 0;
	int r;

	for (size_t i = 0; i < n; i++)
		vertices += lines[i]->lines->vertices;
	if (!l->have || vertices > l->vertices) {
		l->vertices = vertices;
		/* Since the start nobody may have asked for a number. */
		for (size_t i = 0; i < m->nsources; i++)
			l->free_id = m->sources[i].id >= l->free_id ? m->sources[i].id + 1 : l->free_id;
		return lack(l, breaklines_memory(vertices), false, err);
	}
	l->stays = true;
	r = breaklines_build(&p, &l->made, err);
	if (r == -ERR_LIMIT && err->need > p.memory)
		return lack(l, err->need, true, err);
	if (!r)
		breaklines_put(&l->made, l->id, l->added, l->removed, m);
	return r;
}

/* Of the n sources of lines of that generation; it counts in those from l->added to l->removed. */
static int make_of_live(struct dataset_lines *l, struct grid_manifest *m, uint64_t generation, size_t n, struct err *err)
{
	const struct grid_source **lines = calloc(n, sizeof *lines);
	int r;

	if (!lines)
		return err_set(err, ERR_NOMEM, "no memory for the lines of a dataset");
	n = 0;
	for (size_t i = 0; i < m->nsources; i++)
		if (m->sources[i].kind == GRID_LINES && grid_source_live(&m->sources[i], generation))
			lines[n++] = &m->sources[i];
	r = make(l, m, lines, n, err);
	free(lines);
	return r;
}

int dataset_lines_put(struct dataset_lines *l, struct grid_manifest *m, uint64_t pruned, struct grid_span *lives, struct err *err)
{
	struct grid_source *now = NULL, *then = NULL;
	struct digest content;
	size_t n = grid_manifest_lines(m, m->generation, &content);

	if (n)
		find_sets(m, content, pruned, &now, &then);
	else
		find_sets(m, (struct digest){0, 0}, UINT64_MAX, &now, &then);
	if (n && now == then && now)
		return 0;
	if (now)
		now->removed = m->generation;
	if (!n)
		return 0;
	l->added = m->generation;
	l->removed = 0;
	return then ? grid_source_restore(then, m->generation, lives, err) : make_of_live(l, m, m->generation, n, err);
}

/* The lines of that generation are those, and nothing has their line set. */
static bool same_lines(const struct grid_manifest *m, uint64_t generation, size_t n, struct digest content)
{
	struct digest other;

	return grid_manifest_lines(m, generation, &other) == n && digest_equal(other, content) &&
	       !grid_manifest_line_vertices(m, generation);
}

int dataset_lines_put_at(struct dataset_lines *l, struct grid_manifest *m, uint64_t generation, struct err *err)
{
	uint64_t oldest = grid_manifest_oldest(m), last = generation;
	struct digest content;
	size_t n = grid_manifest_lines(m, generation, &content);

	l->added = generation;
	while (l->added > oldest && same_lines(m, l->added - 1, n, content))
		l->added--;
	while (last < m->generation && same_lines(m, last + 1, n, content))
		last++;
	l->removed = last < m->generation ? last + 1 : 0;
	return make_of_live(l, m, generation, n, err);
}

void dataset_lines_undo(struct dataset_lines *l)
{
	const struct grid_source set = {.id = l->id, .kind = GRID_LINE_VERTICES};
	struct err err = ERR_INIT;
	int r;

	if (!l->stays)
		return;
	r = breaklines_remove(l->dataset->dirfd, &set, &err);
	if (!r)
		r = io_sync(l->dataset->dirfd, "the folder of a dataset", &err);
	l->stays = r != 0;
	if (r)
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "a line set that nothing names stays until the next start", &err);
}

/* ---- loop: memory, disk, row ---- */

bool dataset_lines_lacks(const struct dataset_lines *l)
{
	return l->lacks;
}

/* Runs, the segment and the line set. */
static uint64_t disk_bytes(uint64_t vertices)
{
	return 2 * datasets_points_bytes(3 * vertices);
}

/* Any thread. */
static void give_disk(struct dataset_lines *l)
{
	struct core *core = l->dataset->datasets->core;

	if (!l->disk)
		return;
	space_add_unwritten(core->space, SPACE_MERGES, -(int64_t)l->disk);
	space_give(core->space, SPACE_MERGES, l->disk);
	limit_disk_give(core, l->uid, l->disk);
	l->disk = 0;
}

static void give(struct dataset_lines *l)
{
	struct datasets *ds = l->dataset->datasets;

	give_disk(l);
	if (l->have) {
		sched_give(ds->core->p.sched, LEDGER_STAGE, l->have);
		admission_add_rewrite(ds->admission, -(int64_t)l->have);
	}
	l->have = 0;
}

static void finish(struct dataset_lines *l)
{
	core_background_done(l->dataset->datasets->core);
	l->ready(l, l->err.code ? &l->err : NULL);
}

static void row_written(void *ctx, int r, const struct err *why)
{
	struct dataset_lines *l = ctx;

	l->has_row = !r;
	if (r)
		l->err = *why;
	finish(l);
}

static void put_row(struct dataset_lines *l)
{
	struct core *core = l->dataset->datasets->core;
	/* The time 0 distinguishes it from the row of a push (rewrite_owns_row). */
	struct catalogue_push row = {.dataset = l->dataset->id, .uid = l->dataset->uid};

	row.id = l->row_id = ++core->last_push;
	if (catalogue_put_push(core->p.catalogue, &row, row_written, l, &l->err))
		finish(l);
}

/* Worker: reserving disk space may evict. */
static void take_run(struct sched_task *t)
{
	struct dataset_lines *l = (struct dataset_lines *)t;
	struct core *core = l->dataset->datasets->core;
	uint64_t bytes = disk_bytes(l->vertices);

	if (limit_disk_take(core, l->uid, l->peer.admin, bytes, l->what, &l->err))
		return;
	if (space_take(core->space, SPACE_MERGES, bytes, SPACE_MUST, l->what, &l->err)) {
		limit_disk_give(core, l->uid, bytes);
		return;
	}
	space_add_unwritten(core->space, SPACE_MERGES, (int64_t)bytes);
	l->disk = bytes;
}

static void take_out(struct dataset_lines *l)
{
	struct dataset_lines **at;

	for (at = &l->dataset->datasets->lines; *at != l; at = &(*at)->next)
		;
	*at = l->next;
}

static void take_done(struct sched_task *t)
{
	struct dataset_lines *l = (struct dataset_lines *)t;

	take_out(l);
	if (t->ran) {
		l->have = l->want;
	} else {
		admission_add_rewrite(l->dataset->datasets->admission, -(int64_t)l->want);
		err_set(&l->err, ERR_CANCELLED, "the daemon is stopping");
	}
	dataset_sources_from(l->dataset, l->free_id);
	l->id = dataset_next_source(l->dataset);
	if (l->err.code || l->has_row)
		finish(l);
	else
		put_row(l);
}

static void take_start(struct dataset_lines *l)
{
	struct datasets *ds = l->dataset->datasets;

	l->taking = true;
	admission_add_rewrite(ds->admission, (int64_t)l->want);
	l->uid = l->dataset->uid;
	l->task = (struct sched_task){.run = take_run,
				      .done = take_done,
				      .owner = {.uid = l->peer.uid, .flow = ++ds->core->last_flow},
				      .priority = SCHED_FIRST,
				      .name = LEDGER_STAGE,
				      .bytes = l->want};
	sched_submit(ds->core->p.sched, &l->task);
}

static void stop(struct dataset_lines *l)
{
	if (l->taking) {
		sched_cancel(l->dataset->datasets->core->p.sched, &l->task);
		return;
	}
	take_out(l);
	err_set(&l->err, ERR_BUSY, "the daemon is stopping");
	finish(l);
}

void dataset_lines_settle(struct datasets *ds)
{
	struct dataset_lines *l, *next;

	for (l = ds->lines; l; l = next) {
		next = l->next;
		if (ds->core->stopping)
			stop(l);
		else if (!l->taking && admission_stage_available(ds->admission, l->want))
			take_start(l);
	}
}

/* An estimate may be more than it takes: then as much as can be had. */
static void limit_want(struct dataset_lines *l)
{
	uint64_t all = admission_alone_bytes(l->dataset->datasets->admission),
		 least = breaklines_memory(0) + admission_plan_min();

	if (!l->exact && all >= least && l->want > all - admission_plan_min())
		l->want = all - admission_plan_min();
}

void dataset_lines_wait(struct dataset_lines *l)
{
	struct datasets *ds = l->dataset->datasets;
	const struct sched_owner owner = {.uid = l->peer.uid};
	struct dataset_lines **at;

	THREAD_LOOP_ONLY();
	give(l);
	l->lacks = l->taking = false;
	l->err = ERR_INIT;
	ds->core->background++;
	limit_want(l);
	if (admission_check_size(ds->admission, l->want + admission_plan_min(),
				 "making the line set of the dataset, beside a mesh,", &l->err) ||
	    admission_user_check_size(ds->admission, &owner, l->want, "making the line set of the dataset", &l->err)) {
		finish(l);
		return;
	}
	for (at = &ds->lines; *at; at = &(*at)->next)
		;
	*at = l;
	l->next = NULL;
	dataset_lines_settle(ds);
}

void dataset_lines_end(struct dataset_lines *l, bool committed)
{
	give(l);
	if (l->has_row && (committed || !l->stays))
		dataset_drop_row(l->dataset, l->row_id);
	if (l->has_row && committed)
		datasets_count(l->dataset->datasets);
}
