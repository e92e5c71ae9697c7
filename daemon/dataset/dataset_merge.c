/*
 * Merging: keeps the number of segments small.
 *
 * The model: a segment belongs to a class by its number of points. Each class is four times the one below; the first has all
 * below 4,096 points. Where a class has four segments, all of them become one segment, which belongs to a higher class (or, in
 * the first class, perhaps to the same one). So n points have at most three segments a class, 3 log4 n, and a point is rewritten
 * once a class, log4 n times. In the first class a point may be rewritten a few times more, which costs less than the fixed part
 * of a segment.
 *
 * One merge runs at a time, when workers have nothing else to do. It is given up when others wait for memory, unless there are so
 * many segments that reading suffers. Generation and content sums stay. Segments of line vertices are not merged: they go when
 * lines change (dataset_prune.c).
 */
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "dataset_rewrite.h"
#include "log.h"

enum {
	SMALL_POINTS = 4096, /* smaller segments are all in the first class */
	CLASSES = 32,
	MERGE_LEAST = 4,      /* segments of a class */
	MERGE_MOST = 32,      /* segments at once */
	SEGMENTS_URGENT = 40, /* segments: a merge is not given up for others any more */
};

/* Delay after a merge that was given up; doubled each time that there is no disk space. */
#define DELAY_SECONDS 1.0
#define DELAY_SECONDS_MAX 64.0

struct merge {
	struct dataset_rewrite rewrite;
	uint64_t begun_ns;
};

static unsigned class_of(const struct grid_segment_info *s)
{
	unsigned c = 0;

	for (uint64_t n = s->points / SMALL_POINTS; n; n /= 4)
		c++;
	return c;
}

/* The lowest class that is full; CLASSES: none is. */
static unsigned class_due(const struct grid_manifest *m)
{
	unsigned count[CLASSES] = {0}, c = 0;

	for (size_t i = 0; i < m->nsegments; i++)
		if (!grid_is_line_segment(m->segments[i].file))
			count[class_of(&m->segments[i])]++;
	while (c < CLASSES && count[c] < MERGE_LEAST)
		c++;
	return c;
}

bool merge_due(const struct grid_manifest *m)
{
	return class_due(m) < CLASSES;
}

bool merge_due_likely(uint32_t segments)
{
	return segments >= 2 * MERGE_LEAST;
}

/* ---- one merge ---- */

static int merge_choose(struct dataset_rewrite *w, const struct grid_manifest *m, struct err *err)
{
	const struct grid_segment_info *some[MERGE_MOST];
	unsigned c = class_due(m);
	size_t n = 0;

	for (size_t i = 0; i < m->nsegments && n < MERGE_MOST; i++)
		if (c < CLASSES && class_of(&m->segments[i]) == c && !grid_is_line_segment(m->segments[i].file))
			some[n++] = &m->segments[i];
	for (; n >= MERGE_LEAST; n--) {
		int r = rewrite_add(w, some, n, false, err);

		if (r || rewrite_bytes(w) <= w->memory_max)
			return r;
		rewrite_drop_last(w);
	}
	return 0;
}

static void log_merge(const struct merge *g)
{
	const struct dataset_rewrite *w = &g->rewrite;

	log_debug("%s: %zu segments merged into one of %llu points in %.2f s, %llu bytes read, %llu written, %u left",
		  w->dataset->name, w->nold, (unsigned long long)w->made[0].points, clock_since(g->begun_ns),
		  (unsigned long long)w->read, (unsigned long long)w->written, w->dataset->segments);
}

/* The reason may pass: no memory or disk now, others wait, or it was cancelled. */
static bool is_temporary(const struct err *why)
{
	return why->code == ERR_BUSY || why->code == ERR_CANCELLED || why->code == ERR_NOSPACE || why->code == ERR_NOMEM;
}

static void postpone(struct datasets *ds, const struct err *why)
{
	double seconds = DELAY_SECONDS;

	if (why && why->code == ERR_NOSPACE) {
		seconds = ds->merge_delay > 0 ? 2 * ds->merge_delay : DELAY_SECONDS;
		seconds = seconds < DELAY_SECONDS_MAX ? seconds : DELAY_SECONDS_MAX;
		ds->merge_delay = seconds;
	}
	ds->merge_after_ns = clock_mono_ns() + (uint64_t)(seconds * 1e9);
}

static void merge_done(struct dataset_rewrite *w, const struct err *why)
{
	struct merge *g = (struct merge *)w;
	struct datasets *ds = w->datasets;
	struct dataset *d = w->dataset;

	ds->merge = NULL;
	if (!why && w->nunits) {
		log_merge(g);
		ds->merge_delay = 0;
		ds->core->tally.merges++;
		ds->core->tally.merged_bytes += w->written;
	} else if (!why) {
		d->merge_due = false; /* impossible with this memory */
	} else if (is_temporary(why)) {
		log_debug("%s: no merge now: %s", d->name, why->message);
		postpone(ds, why);
	} else {
		log_event_err(LOG_EVENT_MERGE_FAILED, ABOUT_DATASET(d), "segments cannot be merged", why);
		d->merge_due = false;
	}
	dataset_rewrite_clear(w);
	uncharge(ds->core, sizeof *g);
	free(g);
}

static void merge_start(struct datasets *ds, struct dataset *d)
{
	struct err err = ERR_INIT;
	struct merge *g = NULL;

	if (!charge(ds->core, sizeof *g, "a merge", &err) && !(g = calloc(1, sizeof *g)))
		uncharge(ds->core, sizeof *g);
	if (!g) {
		postpone(ds, NULL);
		return;
	}
	g->begun_ns = clock_mono_ns();
	g->rewrite.dataset = d;
	g->rewrite.peer = rights_of_user(d->uid, 0);
	g->rewrite.what = "a merge";
	g->rewrite.choose = merge_choose;
	g->rewrite.done = merge_done;
	g->rewrite.priority = d->segments < SEGMENTS_URGENT ? SCHED_LAST : SCHED_NORMAL;
	ds->merge = &g->rewrite;
	dataset_rewrite_start(&g->rewrite);
}

/* ---- scheduling ---- */

/* Called in every round of the loop, so it is cheap where no dataset has anything to merge. */
static struct dataset *most_segments_due(struct datasets *ds)
{
	struct dataset *d, *most = NULL;
	bool any = false;

	if (!ds->merges_due)
		return NULL;
	for (d = ds->first; d && !d->onestep; d = d->next) {
		any |= d->merge_due;
		if (d->merge_due && d->generation && !d->removed_us && (!most || d->segments > most->segments))
			most = d;
	}
	ds->merges_due = any;
	return most;
}

void dataset_merge_settle(struct datasets *ds)
{
	struct dataset *d;

	if (ds->merge) {
		if (admission_memory_is_awaited(ds->admission) && ds->merge->dataset->segments < SEGMENTS_URGENT)
			dataset_rewrite_cancel(ds->merge);
		else
			dataset_rewrite_settle(ds->merge);
		return;
	}
	if (ds->core->stopping || ds->prunes || admission_memory_is_awaited(ds->admission) ||
	    clock_mono_ns() < ds->merge_after_ns)
		return;
	d = most_segments_due(ds);
	if (d)
		merge_start(ds, d);
}

bool merge_at_work(const struct dataset *d)
{
	return d->datasets->merge && d->datasets->merge->dataset == d;
}

bool merge_commits(const struct dataset *d)
{
	return merge_at_work(d) && d->committer == &d->datasets->merge->change;
}
