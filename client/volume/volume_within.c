/*
 * Polygons of --within: the part of a convex polygon of a pair that is inside.
 *
 * Inside is where the rings wind around once, shells counter-clockwise and holes clockwise. Over the box B of a pair this is a
 * sum of few terms: how often the rings wind around the lower left corner of B, exactly; plus, for each edge that crosses the
 * left side of B, what of B is above that place; minus or plus, for each edge in B, what of B is beside it on its right. Each
 * term is the pair's polygon cut by three lines at most. An edge counts where its own box meets B, found in a tree of boxes; most
 * pairs meet none, and are inside or outside as a whole.
 *
 * The corner counts as moved to greater x and, much less, to greater y, so it is on no edge. Corners of rings are rounded to
 * parts of a lattice step, and are twice as many of them here, so that the middle of an edge has a place. Rings that cross each
 * other or overlap are refused when they are read: there the sum would count twice.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grow.h"
#include "volume_priv.h"

enum { LEAF = 8, PART = 2 * VOLUME_CORNER_PART };
#define FAR (INT64_C(1) << 42) /* of a corner from the middle of the lattice */

/* A ring is a chain of edges; nodes are the halves of its leaves, in the order of a walk from the root. */
struct ring {
	size_t first, n, box, leaves;
};

struct volume_area {
	struct ring *ring;
	size_t nring;
	int64_t (*corner)[2];
	int64_t (*box)[4];
	size_t ncorner, nbox;
	int64_t bounds[4];
};

static const int64_t *corner_of(const struct volume_area *a, const struct ring *r, size_t i)
{
	return a->corner[r->first + (i < r->n ? i : 0)];
}

static bool boxes_meet(const int64_t a[4], const int64_t b[4])
{
	return a[0] <= b[2] && b[0] <= a[2] && a[1] <= b[3] && b[1] <= a[3];
}

static void box_add(int64_t box[4], const int64_t p[2])
{
	for (int k = 0; k < 2; k++) {
		box[k] = p[k] < box[k] ? p[k] : box[k];
		box[2 + k] = p[k] > box[2 + k] ? p[k] : box[2 + k];
	}
}

static void edges_of(const struct ring *r, struct volume_node n, size_t *from, size_t *to)
{
	*from = n.low * LEAF;
	*to = n.high * LEAF < r->n ? n.high * LEAF : r->n;
}

static void make_boxes(struct volume_area *a, const struct ring *r, struct volume_node n)
{
	int64_t *box = a->box[n.box];
	size_t from, to;

	edges_of(r, n, &from, &to);
	memcpy(box, corner_of(a, r, from), 2 * sizeof(*box));
	memcpy(box + 2, box, 2 * sizeof(*box));
	for (size_t i = from; i <= to; i++)
		box_add(box, corner_of(a, r, i));
	for (int k = 0; k < 2 && n.high - n.low > 1; k++)
		make_boxes(a, r, volume_half(n, k));
}

/* ---- how often the rings wind around a place ---- */

/* Left of (x, y), moved as above, on the height of y: what the edge adds. */
static int winds(const int64_t p[2], const int64_t q[2], const int64_t at[2])
{
	bool up = q[1] > at[1];
	volume_i128 turn;

	if (up == (p[1] > at[1]))
		return 0;
	turn = (volume_i128)(q[0] - p[0]) * (at[1] - p[1]) - (volume_i128)(at[0] - p[0]) * (q[1] - p[1]);
	return up ? -(turn <= 0) : turn >= 0;
}

static int winding_of(const struct volume_area *a, const struct ring *r, struct volume_node n, const int64_t at[2])
{
	const int64_t *box = a->box[n.box];
	size_t from, to;
	int sum = 0;

	if (box[1] > at[1] || box[3] <= at[1] || box[0] > at[0])
		return 0;
	edges_of(r, n, &from, &to);
	if (box[2] <= at[0]) /* all of it is to the left: only where it begins and ends counts */
		return (corner_of(a, r, from)[1] > at[1]) - (corner_of(a, r, to)[1] > at[1]);
	if (n.high - n.low > 1)
		return winding_of(a, r, volume_half(n, false), at) + winding_of(a, r, volume_half(n, true), at);
	for (size_t i = from; i < to; i++)
		sum += winds(corner_of(a, r, i), corner_of(a, r, i + 1), at);
	return sum;
}

static int winding(const struct volume_area *a, const int64_t at[2])
{
	int sum = 0;

	for (size_t i = 0; i < a->nring; i++)
		sum += winding_of(a, &a->ring[i], (struct volume_node){a->ring[i].box, 0, a->ring[i].leaves}, at);
	return sum;
}

/* ---- edges near a box ---- */

/* Calls `each` for the edges whose boxes meet it; until it returns false. */
struct visit {
	const struct volume_area *area;
	int64_t box[4];
	bool (*each)(void *ctx, const int64_t p[2], const int64_t q[2]);
	void *ctx;
};

static bool visit_node(const struct visit *v, const struct ring *r, struct volume_node n)
{
	size_t from, to;

	if (!boxes_meet(v->area->box[n.box], v->box))
		return true;
	if (n.high - n.low > 1)
		return visit_node(v, r, volume_half(n, false)) && visit_node(v, r, volume_half(n, true));
	edges_of(r, n, &from, &to);
	for (size_t i = from; i < to; i++) {
		const int64_t *p = corner_of(v->area, r, i), *q = corner_of(v->area, r, i + 1);
		int64_t box[4] = {p[0], p[1], p[0], p[1]};

		box_add(box, q);
		if (boxes_meet(box, v->box) && !v->each(v->ctx, p, q))
			return false;
	}
	return true;
}

static bool visit(const struct visit *v)
{
	for (size_t i = 0; i < v->area->nring; i++)
		if (!visit_node(v, &v->area->ring[i], (struct volume_node){v->area->ring[i].box, 0, v->area->ring[i].leaves}))
			return false;
	return true;
}

/* ---- rings that cannot be used ---- */

static int turn_of(const int64_t a[2], const int64_t b[2], const int64_t c[2])
{
	volume_i128 v = (volume_i128)(b[0] - a[0]) * (c[1] - a[1]) - (volume_i128)(b[1] - a[1]) * (c[0] - a[0]);

	return (v > 0) - (v < 0);
}

struct edge {
	const int64_t *p, *q;
};

static bool does_not_cross(void *ctx, const int64_t p[2], const int64_t q[2])
{
	const struct edge *e = ctx;

	return turn_of(e->p, e->q, p) * turn_of(e->p, e->q, q) >= 0 || turn_of(p, q, e->p) * turn_of(p, q, e->q) >= 0;
}

/* Once around what is left of the edge; where the middle, moved, is right of it, not less than none and not more than once. */
static bool is_border(const struct volume_area *a, const struct edge *e)
{
	const int64_t middle[2] = {(e->p[0] + e->q[0]) / 2, (e->p[1] + e->q[1]) / 2};
	int n = winding(a, middle);
	bool left = e->q[1] < e->p[1] || (e->q[1] == e->p[1] && e->q[0] > e->p[0]);

	return left ? n == 1 : n == 0 || n == 1;
}

static int check(const struct volume_area *a, const struct volume_frame *f, struct err *err)
{
	for (size_t i = 0; i < a->nring; i++)
		for (size_t k = 0; k < a->ring[i].n; k++) {
			struct edge e = {corner_of(a, &a->ring[i], k), corner_of(a, &a->ring[i], k + 1)};
			struct visit v = {a, {e.p[0], e.p[1], e.p[0], e.p[1]}, does_not_cross, &e};
			double step = decimal_double(f->step[0]);

			box_add(v.box, e.q);
			if (visit(&v) && is_border(a, &e))
				continue;
			err_set(err, ERR_INPUT, "rings of a polygon cross or overlap near %.3f %.3f",
				((double)e.p[0] / PART + (double)f->k[0]) * step,
				((double)e.p[1] / PART + (double)f->k[1]) * step);
			return err_add_hint(err, "mend it: ogr2ogr -makevalid OUT.geojson FILE");
		}
	return 0;
}

/* ---- from the file ---- */

static int place(const struct volume_frame *f, int axis, struct decimal d, int64_t *ret, struct err *err)
{
	volume_i128 at = (volume_i128)volume_frame_corner(f, d) - (volume_i128)f->k[axis] * VOLUME_CORNER_PART;

	if (at < FAR && at > -FAR) {
		*ret = 2 * (int64_t)at;
		return 0;
	}
	err_set(err, ERR_USAGE, "the polygon reaches too far out for the lattice of the mesh");
	return err_add_hint(err, "give its corners in the coordinates of the mesh");
}

static void turn_around(int64_t (*corner)[2], size_t n)
{
	for (size_t i = 0; i < n / 2; i++)
		for (int k = 0; k < 2; k++) {
			int64_t hold = corner[i][k];

			corner[i][k] = corner[n - 1 - i][k];
			corner[n - 1 - i][k] = hold;
		}
}

/* Corners that repeat the one before go; a ring that is flat, too. Shells run counter-clockwise, holes clockwise. */
static void ring_end(struct volume_area *a, struct ring *r, bool shell)
{
	int64_t(*c)[2] = a->corner + r->first;
	volume_i128 area = 0;
	bool flat = true;
	size_t n = 0;

	for (size_t i = 0; i < r->n; i++)
		if (!n || memcmp(c[i], c[n - 1], sizeof(*c)) != 0)
			memmove(c[n++], c[i], sizeof(*c));
	while (n > 1 && !memcmp(c[0], c[n - 1], sizeof(*c)))
		n--;
	for (size_t i = 1; i + 1 < n; i++) {
		volume_i128 part = (volume_i128)(c[i][0] - c[0][0]) * (c[i + 1][1] - c[0][1]) -
				   (volume_i128)(c[i][1] - c[0][1]) * (c[i + 1][0] - c[0][0]);

		area += part;
		flat &= part == 0;
	}
	r->n = flat ? 0 : n;
	a->ncorner = r->first + r->n;
	if (area && (area > 0) != shell)
		turn_around(c, n);
}

static int read_rings(struct volume_area *a, const struct volume_frame *f, const struct ctl_area *from, size_t first, size_t end,
		      struct err *err)
{
	int r = 0;

	for (size_t i = first; i < end && !r; i++) {
		struct ring *ring = &a->ring[a->nring];
		size_t n = ctl_area_corners(from, i);

		*ring = (struct ring){.first = a->ncorner, .n = n};
		for (size_t k = 0; k < n && !r; k++)
			for (int axis = 0; axis < 2 && !r; axis++)
				r = place(f, axis, from->corner[from->ring[i].first + k][axis], &a->corner[ring->first + k][axis],
					  err);
		if (r)
			break;
		ring_end(a, ring, from->ring[i].shell);
		ring->leaves = (ring->n + LEAF - 1) / LEAF;
		ring->box = a->nbox;
		a->nbox += ring->leaves ? 2 * ring->leaves - 1 : 0;
		a->nring += ring->n > 0;
	}
	return r;
}

static int finish(struct volume_area *a, const struct volume_frame *f, struct err *err)
{
	a->box = calloc(a->nbox + 1, sizeof(*a->box));
	if (!a->box)
		return err_set(err, ERR_NOMEM, "no memory for a polygon");
	for (size_t i = 0; i < a->nring; i++) {
		const int64_t *box = a->box[a->ring[i].box];

		make_boxes(a, &a->ring[i], (struct volume_node){a->ring[i].box, 0, a->ring[i].leaves});
		if (!i)
			memcpy(a->bounds, box, sizeof(a->bounds));
		box_add(a->bounds, box);
		box_add(a->bounds, box + 2);
	}
	return check(a, f, err);
}

int volume_area_new(const struct volume_frame *f, const struct ctl_area *from, size_t feature, struct volume_area **ret,
		    struct err *err)
{
	size_t first = from->feature[feature].ring;
	size_t end = feature + 1 < from->nfeature ? from->feature[feature + 1].ring : from->nring;
	size_t last = end < from->nring ? from->ring[end].first : from->ncorner;
	size_t n = first < from->nring ? last - from->ring[first].first : 0;
	struct volume_area *a = calloc(1, sizeof(*a));
	int r = 0;

	if (a) {
		a->ring = calloc(end - first + 1, sizeof(*a->ring));
		a->corner = calloc(n + 1, sizeof(*a->corner));
	}
	if (!a || !a->ring || !a->corner)
		r = err_set(err, ERR_NOMEM, "no memory for a polygon");
	if (!r)
		r = read_rings(a, f, from, first, end, err);
	if (!r)
		r = finish(a, f, err);
	if (r)
		volume_area_free(a);
	else
		*ret = a;
	return r;
}

struct volume_area *volume_area_free(struct volume_area *a)
{
	if (a) {
		free(a->ring);
		free(a->corner);
		free(a->box);
	}
	free(a);
	return NULL;
}

void volume_area_box(const struct volume_area *a, int64_t ret[4])
{
	for (int i = 0; i < 4; i++)
		ret[i] = a->bounds[i] / PART + (i < 2 ? -1 : 1);
}

/* ---- cutting ---- */

/* Where a * x + b * y + c >= 0. */
struct line {
	double a, b, c;
};

static void cut(const struct volume_polygon *p, const struct line *l, struct volume_polygon *ret)
{
	double s[VOLUME_CORNERS];
	unsigned n = 0;

	for (unsigned i = 0; i < p->n; i++)
		s[i] = l->a * p->x[i] + l->b * p->y[i] + l->c;
	for (unsigned i = 0; i < p->n; i++) {
		unsigned k = i + 1 == p->n ? 0 : i + 1;

		if (s[i] >= 0 && n < VOLUME_CORNERS) {
			ret->x[n] = p->x[i];
			ret->y[n] = p->y[i];
			ret->f[n++] = p->f[i];
		}
		if (((s[i] > 0 && s[k] < 0) || (s[i] < 0 && s[k] > 0)) && n < VOLUME_CORNERS) {
			/* from the same end, whichever way the edge runs */
			unsigned from = s[i] > 0 ? i : k, to = s[i] > 0 ? k : i;
			double t = s[from] / (s[from] - s[to]);

			ret->x[n] = p->x[from] + t * (p->x[to] - p->x[from]);
			ret->y[n] = p->y[from] + t * (p->y[to] - p->y[from]);
			ret->f[n++] = p->f[from] + t * (p->f[to] - p->f[from]);
		}
	}
	ret->n = n;
}

/* A polygon over its box, and what the edges near it add. */
struct inside {
	const struct volume_polygon *p;
	struct volume_sums *sums;
	int64_t corner[2]; /* the lower left one of the box */
};

static void add_part(const struct inside *in, const struct line *line, unsigned n, double reach, int sign)
{
	struct volume_polygon part[2];
	const struct volume_cuts cuts = {n, reach, sign};

	part[0] = *in->p;
	part[1] = *in->p;
	for (unsigned i = 0; i < n && part[i & 1].n > 2; i++)
		cut(&part[i & 1], &line[i], &part[(i + 1) & 1]);
	for (unsigned i = 0; i < 2; i++) /* a polygon that is gone stays gone */
		if (part[i].n < 3)
			return;
	volume_add(&part[n & 1], &cuts, in->sums);
}

/* Above the lower left corner of the box, where the edge crosses the line through it? */
static bool crosses_above(const int64_t p[2], const int64_t q[2], const int64_t at[2])
{
	int64_t dx = q[0] - p[0], dy = q[1] - p[1];
	volume_i128 v = (volume_i128)(p[1] - at[1]) * dx + (volume_i128)dy * (at[0] - p[0]);

	if (dx < 0) {
		v = -v;
		dy = -dy;
	}
	return v > 0 || (v == 0 && dy > 0);
}

static bool add_edge(void *ctx, const int64_t p[2], const int64_t q[2])
{
	const struct inside *in = ctx;
	bool left = p[0] <= in->corner[0], to_left = q[0] <= in->corner[0];
	double x = (double)(p[0] - in->corner[0]) / PART, y = (double)(p[1] - in->corner[1]) / PART;
	double dx = (double)(q[0] - p[0]) / PART, dy = (double)(q[1] - p[1]) / PART, low = y, high = y + dy, hold;
	double reach = in->p->extent + fmax(fabs(x), fabs(y)) + fmax(fabs(dx), fabs(dy));
	struct line line[3];

	if (left && to_left)
		return true;
	if (left != to_left) {
		double at = y - x * dy / dx;

		low = left ? at : low;
		high = left ? high : at;
		if (crosses_above(p, q, in->corner))
			add_part(in, &(struct line){0, 1, -at}, 1, reach, left ? 1 : -1);
	}
	if (p[1] == q[1])
		return true;
	if (dy < 0) {
		hold = low;
		low = high;
		high = hold;
	}
	line[0] = (struct line){0, 1, -low};
	line[1] = (struct line){0, -1, high};
	line[2] = dy > 0 ? (struct line){dy, -dx, y * dx - x * dy} : (struct line){-dy, dx, x * dy - y * dx};
	add_part(in, line, 3, reach, dy > 0 ? -1 : 1);
	return true;
}

void volume_area_add(const struct volume_area *a, const struct volume_polygon *p, struct volume_sums *sums)
{
	struct inside in = {p, sums, {p->box[0] * PART, p->box[1] * PART}};
	struct visit v = {a, {p->box[0] * PART, p->box[1] * PART, p->box[2] * PART, p->box[3] * PART}, add_edge, &in};

	if (!a->nring || !boxes_meet(a->bounds, v.box))
		return;
	if (winding(a, in.corner))
		volume_add(p, NULL, sums);
	visit(&v);
}
