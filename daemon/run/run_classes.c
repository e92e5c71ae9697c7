/*
 * How many points of the generation are of the ground, and how many are not, for the note in a job's report.
 *
 * Segments count their points by class, sources do not. A segment that also has records of other generations gives only lower
 * bounds, which may be none. Where that leaves the question open whether both kinds are there, some cells of these segments
 * are read, those at the beginning of each: few are enough where there are both, and small segments are read whole.
 */
#include <stdlib.h>

#include "run_priv.h"

enum { CELLS = 256, ENOUGH = 1 }; /* of a segment that are read; cells of records that end it */

struct look {
	struct run *run;
	struct grid_reader *reader;
	size_t segment;
	unsigned cells;
	uint64_t ground, key, other; /* key: class 8 */
};

static bool is_noise(const struct run *w, unsigned cls)
{
	return (cls == 7 || cls == 18) && !w->view.keep_noise;
}

static int add_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct look *l = ctx;

	for (size_t i = 0; i < n; i++) {
		if (pts[i].tag & POINT_LINE)
			continue;
		l->ground += pts[i].cls == 2;
		l->key += pts[i].cls == 8;
		l->other += pts[i].cls != 2 && !is_noise(l->run, pts[i].cls);
	}
	return 0;
}

static bool this_segment(void *ctx, const struct grid_cell *whole)
{
	return whole->segment == ((const struct look *)ctx)->segment;
}

static int read_cell(void *ctx, const struct grid_cell *cell)
{
	struct look *l = ctx;
	struct err ignored = ERR_INIT;

	if (l->cells++ == CELLS)
		return ENOUGH;
	return grid_cell_read(l->reader, cell, add_points, l, &ignored);
}

/* Live records of a segment. 0: these are all; ENOUGH: there are more. Failures are for those who need the records. */
static int look_into(struct run *w, size_t segment, struct look *ret)
{
	const struct grid_visitor visitor = {.ctx = ret, .cell = read_cell, .segment = this_segment};
	struct ledger *ledger = w->runs->core->p.ledger;
	size_t size = grid_reader_bytes(w->grid);
	struct err ignored = ERR_INIT;
	void *memory;
	int r = -ERR_BUSY;

	*ret = (struct look){.run = w, .segment = segment};
	if (!ledger_take(ledger, LEDGER_MANIFEST, size))
		return r;
	memory = malloc(size);
	if (memory && !grid_reader_new(w->grid, memory, size, &ret->reader, &ignored))
		r = grid_walk(ret->reader, 0, UINT64_MAX, &visitor, &ignored);
	ret->reader = grid_reader_free(ret->reader);
	free(memory);
	ledger_give(ledger, LEDGER_MANIFEST, size);
	return r;
}

/* A lower bound: `dead` of the records are not of this generation, and may be any of them. */
static uint64_t at_least(uint64_t points, uint64_t dead)
{
	return points > dead ? points - dead : 0;
}

static uint64_t most(uint64_t a, uint64_t b)
{
	return a > b ? a : b;
}

enum { LEFT_OUT, WEIGHTED, PLAIN };

struct weights {
	bool by_class;   /* the view has radii of classes */
	uint8_t of[256]; /* what it does with points of each class */
	uint64_t taken;  /* points of classes that it takes, at most */
	uint64_t raw;    /* of classes 0 and 1 without a radius, at least */
	bool weighted;   /* there may be points of a class with a radius */
};

static void weights_of(const struct view *v, struct weights *ret)
{
	struct view kind = *v;

	*ret = (struct weights){.by_class = false};
	for (unsigned i = 0; i < v->nweight; i++)
		ret->by_class |= !v->weight[i].slot && v->weight[i].radius;
	if (!ret->by_class)
		return;
	kind.crop = VIEW_CROP_NONE;
	kind.has_zmin = kind.has_zmax = false;
	kind.every = 0;
	for (unsigned cls = 0; cls < 256; cls++) {
		const struct point p = {.cls = (uint8_t)cls, .ret = 0x11};

		if (view_judge(&kind, &p) == VIEW_KEPT)
			ret->of[cls] = view_weight_of(v, &p) ? WEIGHTED : PLAIN;
	}
}

/* One segment. `others`: records that are not live, or of lines. */
static void count_weights(const struct run *w, size_t segment, uint64_t others, struct weights *ret)
{
	const uint64_t *points = grid_manifest(w->grid)->segments[segment].classes;

	others += grid_segment_slotted(w->grid, segment);
	for (unsigned cls = 0; cls < 256 && ret->by_class; cls++) {
		ret->taken += ret->of[cls] == LEFT_OUT ? 0 : points[cls];
		ret->weighted |= ret->of[cls] == WEIGHTED && points[cls];
		if (cls < 2 && ret->of[cls] == PLAIN)
			ret->raw += at_least(points[cls], others);
	}
}

/* A few points without a class are in most data that is classified. */
static bool is_unweighted(const struct weights *a)
{
	return a->raw && (!a->weighted || a->raw > a->taken / 2);
}

/* look: also by reading. *ret_more: where that could tell more. */
static void count(struct run *w, bool look, bool *ret_more)
{
	const struct grid_manifest *m = grid_manifest(w->grid);
	const struct grid_source *lines = grid_lines_source(w->grid);
	struct weights weights;

	weights_of(&w->view, &weights);
	w->ground = w->other = 0;
	w->unclassified = w->classes_exact = true;
	*ret_more = false;
	for (size_t i = 0; i < m->nsegments; i++) {
		const uint64_t *points = m->segments[i].classes;
		uint64_t live = grid_segment_points(w->grid, i), dead = m->segments[i].points - live, other = 0;
		bool ground = points[2] || points[8];
		struct look found = {0};

		if (!live)
			continue;
		for (unsigned c = 0; c < 256; c++)
			other += c == 2 || is_noise(w, c) ? 0 : points[c];
		*ret_more |= dead && ground;
		if (look && dead && ground && look_into(w, i, &found) == 0) {
			ground = found.ground || found.key;
			dead = 0;
			other = found.other;
			w->ground += found.ground;
		} else {
			w->ground += most(at_least(points[2], dead), found.ground);
		}
		w->classes_exact = w->classes_exact && !dead;
		w->other += most(at_least(other, dead), found.other);
		w->unclassified &= !ground;
		/* Vertices of lines may be any of them. */
		count_weights(w, i, m->segments[i].points - live + (lines ? lines->points : 0), &weights);
	}
	w->unweighted = is_unweighted(&weights);
	/* Vertices of lines have class 0, and are not chosen by class. */
	if (lines)
		w->other = at_least(w->other, lines->points);
}

void run_count_classes(struct run *w)
{
	bool more;

	count(w, false, &more);
	if (more && (w->view.ground || !w->ground || !w->other))
		count(w, true, &more);
}
