/*
 * Inspection: statistics of an input, from all of its records.
 *
 * One pass over the records counts, and stages their positions into a temporary segment, whose index knows the number
 * of distinct positions; pipe_inner.c searches it. The hull of the positions is a convex polygon on the lattice: the
 * hull of each batch is merged into it. Memory is that of a batch, of the hull (limited; a larger one is thinned and
 * reported as such) and of the stage. The projection of the coordinate system is ignored.
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_stage.h"
#include "io.h"
#include "pipe.h"
#include "pipe_inner.h"

enum { BATCH = 8192, HULL = PIPE_HULL_MOST, INDEX = 1 << 20 };

struct place {
	int32_t x, y;
};

struct inspection {
	int64_t raw[BATCH][3];
	int32_t at[BATCH][3];
	struct point point[BATCH];
	uint8_t cls[BATCH], ret[BATCH], flags[BATCH];
	struct place sort[BATCH + HULL], chain[2 * (BATCH + HULL) + 2], hull[HULL];
	size_t nhull;
	int64_t lo[3], hi[3]; /* raw */
};

size_t pipe_inspect_bytes(void)
{
	return sizeof(struct inspection) + pipe_inner_bytes() + INDEX;
}

/* ---- the hull ---- */

static int by_place(const void *a, const void *b)
{
	const struct place *p = a, *q = b;

	return p->x != q->x ? (p->x < q->x ? -1 : 1) : p->y != q->y ? (p->y < q->y ? -1 : 1) : 0;
}

/* Positive: c is left of the line from a to b. */
static bool left_of(const struct place *a, const struct place *b, const struct place *c)
{
	return ((__int128)b->x - a->x) * ((__int128)c->y - a->y) > ((__int128)b->y - a->y) * ((__int128)c->x - a->x);
}

/* Monotone chain over the n sorted positions in `sort`; writes the hull, counter-clockwise, to `hull`. */
static void hull_make(struct inspection *s, size_t n, bool *ret_thinned)
{
	struct place *h = s->chain;
	size_t k = 0, low, step;

	for (size_t i = 0; i < n; i++) {
		while (k >= 2 && !left_of(&h[k - 2], &h[k - 1], &s->sort[i]))
			k--;
		h[k++] = s->sort[i];
	}
	low = k + 1;
	for (size_t i = n - 1; i-- > 0;) {
		while (k >= low && !left_of(&h[k - 2], &h[k - 1], &s->sort[i]))
			k--;
		h[k++] = s->sort[i];
	}
	k -= n > 1; /* the first corner again */
	step = (k + HULL - 1) / HULL;
	*ret_thinned |= step > 1;
	s->nhull = 0;
	for (size_t i = 0; i < k; i += step)
		s->hull[s->nhull++] = h[i];
}

/* Points inside the box of four corners of the hull cannot extend it; that excludes most points of a batch. */
static void hull_add(struct inspection *s, size_t n, bool *ret_thinned)
{
	const struct place *h = s->hull;
	size_t m = 0, used = 0;

	for (size_t i = 0; i < n; i++) {
		struct place p = {s->at[i][0], s->at[i][1]};
		bool inside = s->nhull >= 4;

		for (size_t k = 0; inside && k < 4; k++)
			inside = left_of(&h[k * s->nhull / 4], &h[(k + 1) % 4 * s->nhull / 4], &p);
		if (!inside)
			s->sort[m++] = p;
	}
	if (!m)
		return;
	memcpy(s->sort + m, s->hull, s->nhull * sizeof *s->hull);
	m += s->nhull;
	qsort(s->sort, m, sizeof *s->sort, by_place);
	for (size_t i = 0; i < m; i++)
		if (!used || by_place(&s->sort[used - 1], &s->sort[i]))
			s->sort[used++] = s->sort[i];
	hull_make(s, used, ret_thinned);
}

/* ---- the pass ---- */

static void count_records(struct inspection *s, size_t n, struct pipe_inspected *in)
{
	for (size_t i = 0; i < n; i++) {
		in->classes[s->cls[i]]++;
		in->returns[s->ret[i] & 15]++;
		in->return_counts[s->ret[i] >> 4]++;
		for (int k = 0; k < 4; k++)
			in->flags[k] += s->flags[i] >> k & 1;
		for (int k = 0; k < 3; k++) {
			if ((!in->points && !i) || s->raw[i][k] < s->lo[k])
				s->lo[k] = s->raw[i][k];
			if ((!in->points && !i) || s->raw[i][k] > s->hi[k])
				s->hi[k] = s->raw[i][k];
		}
		s->point[i] = (struct point){.x = s->at[i][0], .y = s->at[i][1], .z = s->at[i][2]};
	}
}

static int read_records(struct input *input, const struct pipe_inspect_params *p, struct inspection *s, struct pipe_inspected *in,
			struct err *err)
{
	struct input_points pts = {.raw = s->raw, .cls = s->cls, .ret = s->ret, .flags = s->flags, .cap = BATCH};
	struct lattice_map map;
	double shift[3] = {0};
	uint64_t moved = 0;
	size_t bad;
	int r = lattice_map_init(&map, p->lattice, &input_info(input)->coords, err);

	while (!r) {
		r = input_read(input, &pts, err);
		if (r || !pts.n)
			break;
		r = lattice_map_apply(&map, (const int64_t(*)[3])s->raw, pts.n, s->at, &moved, shift, &bad, err);
		if (r)
			break;
		count_records(s, pts.n, in);
		hull_add(s, pts.n, &in->hull_thinned);
		r = grid_stage_add(p->stage, s->point, pts.n, err);
		in->points += pts.n;
		if (!r && p->progress && p->progress(p->ctx, in->points))
			r = err_set(err, ERR_CANCELLED, "cancelled after %llu points", (unsigned long long)in->points);
	}
	return r;
}

static void set_results(const struct input *input, const struct pipe_inspect_params *p, const struct inspection *s,
			struct pipe_inspected *in)
{
	const struct lattice_input *c = &input_info(input)->coords;
	double scale = decimal_double(p->lattice->scale_xy), twice = 0;

	for (int k = 0; k < 3 && in->points; k++) {
		double offset = c->has_offset ? decimal_double(c->offset[k]) : 0;

		in->min[k] = (double)s->lo[k] * decimal_double(c->scale[k]) + offset;
		in->max[k] = (double)s->hi[k] * decimal_double(c->scale[k]) + offset;
	}
	in->nhull = s->nhull;
	for (size_t i = 0; i < s->nhull; i++) {
		const struct place *a = &s->hull[i], *b = &s->hull[(i + 1) % s->nhull], *o = &s->hull[0];

		twice += ((double)a->x - o->x) * ((double)b->y - o->y) - ((double)b->x - o->x) * ((double)a->y - o->y);
		in->hull[i][0] = ((double)a->x + (double)p->lattice->k[0]) * scale;
		in->hull[i][1] = ((double)a->y + (double)p->lattice->k[1]) * scale;
	}
	in->hull_area = twice / 2 * scale * scale;
}

/* ---- distinct positions, from the index of the segment ---- */

static bool sum_subtree(void *ctx, const struct grid_cell *subtree)
{
	*(uint64_t *)ctx += subtree->distinct;
	return false;
}

static int sum_cell(void *ctx, const struct grid_cell *cell)
{
	*(uint64_t *)ctx += cell->distinct;
	return 0;
}

static int read_index(const struct pipe_inspect_params *p, const char *manifest, struct pipe_inspected *in, struct err *err)
{
	const struct grid_visitor visitor = {&in->distinct, sum_subtree, sum_cell};
	struct grid_reader *reader = NULL;
	struct grid *grid = NULL;
	void *memory = NULL;
	int r = grid_open(p->dirfd, manifest, GRID_NEWEST, NULL, INDEX / 2, &grid, err);

	if (r)
		return r; /* it has no lines */
	memory = malloc(grid_reader_bytes(grid));
	r = memory ? grid_reader_new(grid, memory, grid_reader_bytes(grid), &reader, err) :
		     err_set(err, ERR_NOMEM, "no memory to count positions");
	if (!r)
		r = grid_walk(reader, 0, UINT64_MAX, &visitor, err);
	if (!r)
		r = pipe_inner(reader, p, in, err);
	grid_reader_free(reader);
	free(memory);
	grid_close(grid);
	return r;
}

static int seal_segment(const struct pipe_inspect_params *p, struct pipe_inspected *in, struct err *err)
{
	struct grid_segment_info segment = {0};
	struct grid_source source = {.id = 1, .added = 1, .points = in->points, .name = "inspected", .path = ""};
	struct grid_manifest m = {.lattice = *p->lattice,
				  .crs = "unknown",
				  .generation = 1,
				  .segments = &segment,
				  .nsegments = 1,
				  .sources = &source,
				  .nsources = 1};
	char manifest[80];
	int r = grid_stage_seal(p->stage, &segment, err);

	if (r)
		return r;
	snprintf(manifest, sizeof manifest, "%.60s.manifest", p->name);
	r = grid_manifest_write(p->dirfd, manifest, &m, err);
	if (!r)
		r = read_index(p, manifest, in, err);
	io->unlinkat(p->dirfd, manifest, 0);
	io->unlinkat(p->dirfd, segment.file, 0);
	return r;
}

int pipe_inspect(struct input *input, const struct pipe_inspect_params *p, struct pipe_inspected *ret, struct err *err)
{
	struct inspection *s = calloc(1, sizeof *s);
	int r;

	if (!s)
		return err_set(err, ERR_NOMEM, "no memory to read %s", input_info(input)->coords.name);
	memset(ret, 0, sizeof *ret);
	r = grid_stage_source(p->stage, 1, err);
	if (!r)
		r = read_records(input, p, s, ret, err);
	if (!r)
		set_results(input, p, s, ret);
	free(s);
	if (!r && ret->points)
		r = seal_segment(p, ret, err);
	return r ? err_add_file(err, input_info(input)->coords.name) : 0;
}
