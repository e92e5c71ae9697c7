/*
 * Merging: few segments instead of many.
 *
 * The model: a segment belongs to a class by its number of points, each class four times the one below (the first has
 * all below 4,096). Where a class has four, all of its segments become one, which is of a higher class, but for the
 * first. So of n points there are at most three segments a class, 3 log4 n, and a point is written once a class, log4 n
 * times, plus, while its segment is small, a few times at less than what a segment takes beside its points. One merge at a time
 * in the service, when workers have nothing else to do; it is given up where others wait for memory, unless
 * there are so many segments that reading suffers. The generation stays, and so does every sum.
 */
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "dataset_rewrite.h"
#include "log.h"

enum {
	SMALLEST = 4096, /* points: what is smaller is of one class */
	CLASSES = 32,
	ENOUGH = 4, /* of a class: they are merged */
	FAN = 32,   /* at most at once */
	MANY = 40,  /* segments: merging gives way to nobody */
};

/* After one that was given up; where there was no space, twice as long each time. */
#define AGAIN_SECONDS 1.0
#define LONGEST_SECONDS 64.0

struct merge {
	struct dataset_rewrite rewrite;
	uint64_t begun_ns;
};

static unsigned class_of(const struct grid_segment_info *s)
{
	unsigned c = 0;

	for (uint64_t n = s->points / SMALLEST; n; n /= 4)
		c++;
	return c;
}

/* The lowest class with enough; CLASSES: there is none. */
static unsigned class_due(const struct grid_manifest *m)
{
	unsigned count[CLASSES] = {0}, c = 0;

	for (size_t i = 0; i < m->nsegments; i++)
		count[class_of(&m->segments[i])]++;
	while (c < CLASSES && count[c] < ENOUGH)
		c++;
	return c;
}

bool merge_due(const struct grid_manifest *m)
{
	return class_due(m) < CLASSES;
}

bool merge_due_likely(uint32_t segments)
{
	return segments >= 2 * ENOUGH;
}

/* ---- one ---- */

static int choose(struct dataset_rewrite *w, const struct grid_manifest *m, struct err *err)
{
	const struct grid_segment_info *some[FAN];
	unsigned c = class_due(m);
	size_t n = 0;

	for (size_t i = 0; i < m->nsegments && n < FAN; i++)
		if (c < CLASSES && class_of(&m->segments[i]) == c)
			some[n++] = &m->segments[i];
	for (; n >= ENOUGH; n--) {
		int r = rewrite_add(w, some, n, false, err);

		if (r || rewrite_bytes(w) <= w->most)
			return r;
		rewrite_drop_last(w);
	}
	return 0;
}

static void say(const struct merge *g)
{
	const struct dataset_rewrite *w = &g->rewrite;

	log_debug("%s: %zu segments merged into one of %llu points in %.2f s, %llu bytes read, %llu written, %u left",
		  w->dataset->name, w->nold, (unsigned long long)w->made[0].points, clock_since(g->begun_ns),
		  (unsigned long long)w->read, (unsigned long long)w->written, w->dataset->segments);
}

/* For the time being: memory, disk, somebody waits, or it was cut short. */
static bool passes(const struct err *why)
{
	return why->code == ERR_BUSY || why->code == ERR_CANCELLED || why->code == ERR_NOSPACE || why->code == ERR_NOMEM;
}

static void put_off(struct datasets *ds, const struct err *why)
{
	double seconds = AGAIN_SECONDS;

	if (why && why->code == ERR_NOSPACE) {
		seconds = ds->merge_wait > 0 ? 2 * ds->merge_wait : AGAIN_SECONDS;
		seconds = seconds < LONGEST_SECONDS ? seconds : LONGEST_SECONDS;
		ds->merge_wait = seconds;
	}
	ds->merge_after_ns = clock_mono_ns() + (uint64_t)(seconds * 1e9);
}

static void merge_over(struct dataset_rewrite *w, const struct err *why)
{
	struct merge *g = (struct merge *)w;
	struct datasets *ds = w->datasets;
	struct dataset *d = w->dataset;

	ds->merge = NULL;
	if (!why && w->nunits) {
		say(g);
		ds->merge_wait = 0;
		ds->core->tally.merges++;
		ds->core->tally.merged_bytes += w->written;
	} else if (!why) {
		d->merge_due = false; /* not with this memory */
	} else if (passes(why)) {
		log_debug("%s: no merge now: %s", d->name, why->message);
		put_off(ds, why);
	} else {
		log_event_err(LOG_EVENT_MERGE_FAILED, ABOUT_DATASET(d), "segments cannot be merged", why);
		d->merge_due = false;
	}
	dataset_rewrite_clear(w);
	uncharge(ds->core, sizeof *g);
	free(g);
}

static void start(struct datasets *ds, struct dataset *d)
{
	struct err err = ERR_INIT;
	struct merge *g = NULL;

	if (!charge(ds->core, sizeof *g, "a merge", &err) && !(g = calloc(1, sizeof *g)))
		uncharge(ds->core, sizeof *g);
	if (!g) {
		put_off(ds, NULL);
		return;
	}
	g->begun_ns = clock_mono_ns();
	g->rewrite.dataset = d;
	g->rewrite.peer = rights_of_user(d->uid, 0);
	g->rewrite.what = "a merge";
	g->rewrite.choose = choose;
	g->rewrite.over = merge_over;
	g->rewrite.priority = d->segments < MANY ? SCHED_LAST : SCHED_NORMAL;
	ds->merge = &g->rewrite;
	dataset_rewrite_start(&g->rewrite);
}

/* ---- when ---- */

/* Looked for in every round of the loop: where no dataset has anything, they are not gone through. */
static struct dataset *due(struct datasets *ds)
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
		if (admission_memory_is_awaited(ds->admission) && ds->merge->dataset->segments < MANY)
			dataset_rewrite_cancel(ds->merge);
		else
			dataset_rewrite_settle(ds->merge);
		return;
	}
	if (ds->core->stopping || ds->prunes || admission_memory_is_awaited(ds->admission) ||
	    clock_mono_ns() < ds->merge_after_ns)
		return;
	d = due(ds);
	if (d)
		start(ds, d);
}

bool merge_at_work(const struct dataset *d)
{
	return d->datasets->merge && d->datasets->merge->dataset == d;
}
