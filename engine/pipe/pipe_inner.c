/*
 * Finds where most points of an input are: the box that contains 99.9 % of them, and the position with the most points.
 *
 * At most n / 6,000 (rounded down) of n points are beyond each of the six sides; a side is the outermost coordinate for which
 * this holds. So the box contains at least 99.9 % of the points, each side is the coordinate of a point,
 * and for up to 5,999 points it is the box of all. Each pass over the points counts those of an interval in buckets,
 * and the bucket that contains the wanted point is the next interval, for all sides at once. At most three passes, in
 * the memory of the buckets. Heights count like x and y, because a bird is as much an outlier as a point at 0,0.
 */
#include "pipe_inner.h"

#include <stdlib.h>
#include <string.h>

#include "decimal.h"
#include "err.h"
#include "parse.h"

enum { SIDES = 6, BUCKET_BITS = 12, BUCKETS = 1 << BUCKET_BITS, PART = 6000 };

/* Searched from below: numbers of an upper side are negated. */
struct side {
	int64_t low; /* of the interval, whose width is BUCKETS << shift; `before` points are below it */
	unsigned shift;
	uint64_t before;
	bool found; /* the side is `low` */
};

struct inner {
	struct side side[SIDES];
	uint64_t bucket[SIDES][BUCKETS];
	uint64_t points, here;
	struct point last;
	struct mesh_most *most;
	pipe_progress_fn progress;
	void *ctx;
	bool first; /* this pass also finds the position with the most points */
};

size_t pipe_inner_bytes(void)
{
	return sizeof(struct inner);
}

static int64_t number_of(const struct point *p, unsigned side)
{
	int64_t v = side % 3 == 0 ? p->x : side % 3 == 1 ? p->y : p->z;

	return side < 3 ? v : -v;
}

static void count_sides(struct inner *n, const struct point *p)
{
	for (unsigned i = 0; i < SIDES; i++) {
		const struct side *s = &n->side[i];
		uint64_t at = (uint64_t)(number_of(p, i) - s->low) >> s->shift;

		/* Below the interval the difference wraps to a huge number. */
		if (!s->found && at < BUCKETS)
			n->bucket[i][at]++;
	}
}

static int count_points(void *ctx, const struct point *pts, size_t count, struct err *err)
{
	struct inner *n = ctx;

	for (size_t i = 0; i < count; i++) {
		const struct point *p = &pts[i];

		if (n->first) {
			bool same = n->here && p->x == n->last.x && p->y == n->last.y;

			n->here = same ? n->here + 1 : 1;
			n->last = *p;
			if (same)
				mesh_most_add(n->most, n->here, p->x, p->y);
		}
		count_sides(n, p);
	}
	if (n->progress && n->progress(n->ctx, n->points))
		return err_set(err, ERR_CANCELLED, "cancelled after %llu points", (unsigned long long)n->points);
	return 0;
}

/* The bucket that contains the point with `beyond` points before it becomes the interval. */
static void narrow(struct side *s, const uint64_t *bucket, uint64_t beyond)
{
	unsigned i = 0;

	if (s->found)
		return;
	while (i < BUCKETS - 1 && s->before + bucket[i] <= beyond)
		s->before += bucket[i++];
	s->low += (int64_t)i << s->shift;
	s->found = s->shift == 0;
	s->shift = s->shift > BUCKET_BITS ? s->shift - BUCKET_BITS : 0;
}

static double coordinate(struct decimal scale, int64_t number)
{
	char text[DECIMAL_TEXT_SIZE];
	double v = 0;

	parse_double(decimal_scaled_text(scale, number, text), &v);
	return v;
}

static void set_results(const struct inner *n, const struct lattice *l, struct pipe_inspected *in)
{
	for (unsigned k = 0; k < 3; k++) {
		struct decimal scale = k < 2 ? l->scale_xy : l->scale_z;

		in->inner_min[k] = coordinate(scale, n->side[k].low + l->k[k]);
		in->inner_max[k] = coordinate(scale, -n->side[3 + k].low + l->k[k]);
	}
	if (!in->most.points)
		return;
	in->most_at[0] = coordinate(l->scale_xy, in->most.x + l->k[0]);
	in->most_at[1] = coordinate(l->scale_xy, in->most.y + l->k[1]);
}

int pipe_inner(struct grid_reader *reader, const struct pipe_inspect_params *p, struct pipe_inspected *in, struct err *err)
{
	struct inner *n = calloc(1, sizeof *n);
	bool all = false;
	int r = 0;

	if (!n)
		return err_set(err, ERR_NOMEM, "no memory to look for the box of most points");
	n->points = in->points;
	n->most = &in->most;
	n->progress = p->progress;
	n->ctx = p->ctx;
	n->first = true;
	/* All numbers, negated ones too, fit 33 bits. */
	for (unsigned i = 0; i < SIDES; i++)
		n->side[i] = (struct side){.low = INT32_MIN, .shift = 33 - BUCKET_BITS};
	while (!r && !all) {
		r = grid_scan(reader, 0, UINT64_MAX, count_points, n, err);
		all = true;
		for (unsigned i = 0; i < SIDES; i++) {
			narrow(&n->side[i], n->bucket[i], in->points / PART);
			all = all && n->side[i].found;
		}
		memset(n->bucket, 0, sizeof n->bucket);
		n->first = false;
	}
	if (!r)
		set_results(n, p->lattice, in);
	free(n);
	return r;
}
