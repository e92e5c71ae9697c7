/*
 * Two triangles: the polygon that both cover, the difference of their heights over it, and its integrals.
 *
 * Whether and how they meet is exact: it follows from the signs of 18 determinants of lattice numbers. The polygon is made by
 * clipping, with corners that are names (a corner of one, a corner of the other, a crossing of two edges) and no places. Only
 * at the end each name becomes a place and two heights, in doubles: a crossing by a division of determinants of opposite signs,
 * along the shorter of its edges, a height between those of the corners. So the error of a height is a few parts in 2^53 of the
 * range of heights, however thin the triangles are; docs/design/volumes.md has the bounds.
 *
 * The two are put in an order first, and each begins with its least corner: the result does not depend on who is a and who is b,
 * but for the sign.
 */
#include <math.h>
#include <string.h>

#include "volume_priv.h"

#define UNIT 0x1p-53
/* Determinants of differences of numbers below these are exact in doubles, in 64 bits. */
#define SMALL (INT64_C(1) << 25)
#define MIDDLE (INT64_C(1) << 30)

static unsigned next(unsigned i)
{
	return i == 2 ? 0 : i + 1;
}

/* ---- triangles ---- */

volume_i128 volume_triangle_area(const struct volume_triangle *t)
{
	int64_t ux = (int64_t)t->at[1][0] - t->at[0][0], uy = (int64_t)t->at[1][1] - t->at[0][1];
	int64_t vx = (int64_t)t->at[2][0] - t->at[0][0], vy = (int64_t)t->at[2][1] - t->at[0][1];

	return (volume_i128)ux * vy - (volume_i128)uy * vx;
}

static void swap(int32_t a[3], int32_t b[3])
{
	for (int i = 0; i < 3; i++) {
		int32_t hold = a[i];

		a[i] = b[i];
		b[i] = hold;
	}
}

static bool less(const int32_t *a, const int32_t *b)
{
	return a[0] < b[0] || (a[0] == b[0] && a[1] < b[1]);
}

bool volume_triangle_normal(struct volume_triangle *t)
{
	volume_i128 area = volume_triangle_area(t);

	if (area < 0)
		swap(t->at[1], t->at[2]);
	while (less(t->at[1], t->at[0]) || less(t->at[2], t->at[0])) {
		swap(t->at[0], t->at[1]);
		swap(t->at[1], t->at[2]);
	}
	return area != 0;
}

static int compare(const struct volume_triangle *a, const struct volume_triangle *b)
{
	for (int i = 0; i < 3; i++)
		for (int k = 0; k < 3; k++)
			if (a->at[i][k] != b->at[i][k])
				return a->at[i][k] < b->at[i][k] ? -1 : 1;
	return 0;
}

/* ---- two of them ---- */

/* From the lesser corner of the box of both. */
struct side {
	const struct volume_triangle *t;
	int64_t at[3][2];
	double x[3], y[3], z[3]; /* z from the least height of both */
	double turn[3][3];       /* of an edge and a corner of the other one: its sign is exact */
};

struct pair {
	struct side s, t;
	int64_t most; /* of all numbers */
};

static double turn(const struct pair *p, const struct side *e, unsigned i, const struct side *o, unsigned k)
{
	const int64_t *a = e->at[i], *b = e->at[next(i)], *c = o->at[k];
	volume_i128 exact;

	if (p->most < SMALL)
		return (e->x[next(i)] - e->x[i]) * (o->y[k] - e->y[i]) - (e->y[next(i)] - e->y[i]) * (o->x[k] - e->x[i]);
	if (p->most < MIDDLE)
		return (double)((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
	exact = (volume_i128)(b[0] - a[0]) * (c[1] - a[1]) - (volume_i128)(b[1] - a[1]) * (c[0] - a[0]);
	return (double)exact;
}

/* False: an edge has the other triangle on its outer side. */
static bool turns(const struct pair *p, struct side *e, const struct side *o)
{
	for (unsigned i = 0; i < 3; i++) {
		bool inside = false;

		for (unsigned k = 0; k < 3; k++) {
			e->turn[i][k] = turn(p, e, i, o, k);
			inside |= e->turn[i][k] > 0;
		}
		if (!inside)
			return false;
	}
	return true;
}

static bool common_box(const struct volume_triangle *a, const struct volume_triangle *b, int64_t box[4])
{
	for (int k = 0; k < 2; k++) {
		int64_t low[2] = {INT64_MAX, INT64_MAX}, high[2] = {INT64_MIN, INT64_MIN};

		for (int i = 0; i < 3; i++) {
			int64_t v = a->at[i][k], w = b->at[i][k];

			low[0] = v < low[0] ? v : low[0];
			high[0] = v > high[0] ? v : high[0];
			low[1] = w < low[1] ? w : low[1];
			high[1] = w > high[1] ? w : high[1];
		}
		box[k] = low[0] > low[1] ? low[0] : low[1];
		box[2 + k] = high[0] < high[1] ? high[0] : high[1];
		if (box[k] >= box[2 + k])
			return false;
	}
	return true;
}

static void side_init(struct side *s, const struct volume_triangle *t, const int64_t origin[2], int64_t low, int64_t *most)
{
	s->t = t;
	for (int i = 0; i < 3; i++) {
		for (int k = 0; k < 2; k++) {
			int64_t v = t->at[i][k] - origin[k];

			s->at[i][k] = v;
			v = v < 0 ? -v : v;
			*most = v > *most ? v : *most;
		}
		s->x[i] = (double)s->at[i][0];
		s->y[i] = (double)s->at[i][1];
		s->z[i] = (double)(t->at[i][2] - low);
	}
}

/* ---- corners with names ---- */

enum kind { OF_S, OF_T, CROSSING };

/* Corner i of s, corner j of t, or where edge i of s crosses edge j of t; `edge` leaves it: 0 to 2 of s, 3 to 5 of t. */
struct corner {
	enum kind kind;
	unsigned i, j, edge;
};

static int sign_of(double v)
{
	return (v > 0) - (v < 0);
}

/* On which side of edge j of t it is, 1: inside. A corner of t is of the polygon so far, thus not outside. */
static int side_of(const struct pair *p, const struct corner *c, unsigned j)
{
	int heading;

	if (c->kind == OF_S)
		return sign_of(p->t.turn[j][c->i]);
	if (c->kind == OF_T)
		return c->j == j || c->j == next(j) ? 0 : 1;
	/* The line of edge c->j of t meets that of j in a corner of t. Seen along c->j, is the crossing before or behind it? */
	heading = p->t.turn[c->j][c->i] > 0 ? 1 : -1;
	if (j == next(c->j))
		return heading * sign_of(p->s.turn[c->i][j]);
	return -heading * sign_of(p->s.turn[c->i][c->j]);
}

/* Where the polygon's edge crosses the line of edge j of t. */
static struct corner cross(unsigned edge, unsigned j)
{
	if (edge < 3)
		return (struct corner){CROSSING, edge, j, edge};
	edge -= 3;
	return (struct corner){OF_T, 0, j == next(edge) ? j : edge, edge + 3};
}

static unsigned clip(const struct pair *p, unsigned j, const struct corner *from, unsigned n, struct corner *to)
{
	unsigned m = 0;
	int side[8];

	for (unsigned i = 0; i < n; i++)
		side[i] = side_of(p, &from[i], j);
	for (unsigned i = 0; i < n; i++) {
		int here = side[i], there = side[i + 1 == n ? 0 : i + 1];

		if (here >= 0) {
			to[m] = from[i];
			if (!here && there < 0)
				to[m].edge = 3 + j;
			m++;
		}
		if (here * there < 0) {
			to[m] = cross(from[i].edge, j);
			if (here > 0)
				to[m].edge = 3 + j;
			m++;
		}
	}
	return m;
}

/* ---- places and heights ---- */

/* Of the corner k of `o`, which is in e: between the corners of e. */
static double height_at(const struct side *e, unsigned k)
{
	double w[3] = {e->turn[1][k], e->turn[2][k], e->turn[0][k]};

	return (w[0] * e->z[0] + w[1] * e->z[1] + w[2] * e->z[2]) / (w[0] + w[1] + w[2]);
}

static double edge_size(const struct side *e, unsigned i)
{
	return fmax(fabs(e->x[next(i)] - e->x[i]), fabs(e->y[next(i)] - e->y[i]));
}

static double along(const double v[3], unsigned i, double part)
{
	return v[i] + part * (v[next(i)] - v[i]);
}

/* *edge: grows to the edge along which a crossing is. */
static double place(const struct pair *p, const struct corner *c, double *x, double *y, double *edge)
{
	const struct side *s = &p->s, *t = &p->t;
	double u, v;

	if (c->kind == OF_S) {
		*x = s->x[c->i];
		*y = s->y[c->i];
		return height_at(t, c->i) - s->z[c->i];
	}
	if (c->kind == OF_T) {
		*x = t->x[c->j];
		*y = t->y[c->j];
		return t->z[c->j] - height_at(s, c->j);
	}
	u = t->turn[c->j][c->i] / (t->turn[c->j][c->i] - t->turn[c->j][next(c->i)]);
	v = s->turn[c->i][c->j] / (s->turn[c->i][c->j] - s->turn[c->i][next(c->j)]);
	*edge = fmax(*edge, fmin(edge_size(t, c->j), edge_size(s, c->i)));
	if (edge_size(t, c->j) < edge_size(s, c->i)) {
		*x = along(t->x, c->j, v);
		*y = along(t->y, c->j, v);
	} else {
		*x = along(s->x, c->i, u);
		*y = along(s->y, c->i, u);
	}
	return along(t->z, c->j, v) - along(s->z, c->i, u);
}

/* A difference that may be none is none. */
static double clean(double f, double range)
{
	return fabs(f) <= 20 * UNIT * range ? 0 : f;
}

static bool same_plan(const struct volume_triangle *a, const struct volume_triangle *b)
{
	for (int i = 0; i < 3; i++)
		if (a->at[i][0] != b->at[i][0] || a->at[i][1] != b->at[i][1])
			return false;
	return true;
}

static void polygon_init(struct volume_polygon *ret, const int64_t box[4], double range)
{
	ret->n = 0;
	ret->exact_area = 0;
	ret->range = range;
	ret->extent = (double)(box[2] - box[0] > box[3] - box[1] ? box[2] - box[0] : box[3] - box[1]);
	ret->edge = ret->extent;
	ret->origin[0] = (int32_t)box[0];
	ret->origin[1] = (int32_t)box[1];
	memcpy(ret->box, box, sizeof(ret->box));
}

static void corners(const struct pair *p, double sign, struct volume_polygon *ret)
{
	struct corner c[2][8] = {{{OF_S, 0, 0, 0}, {OF_S, 1, 0, 1}, {OF_S, 2, 0, 2}}};
	unsigned n = 3;

	for (unsigned j = 0; j < 3; j++)
		n = clip(p, j, c[j & 1], n, c[(j + 1) & 1]);
	ret->n = n;
	for (unsigned i = 0; i < n; i++)
		ret->f[i] = sign * clean(place(p, &c[1][i], &ret->x[i], &ret->y[i], &ret->edge), ret->range);
}

static int64_t extreme_height(const struct volume_triangle *a, const struct volume_triangle *b, bool high)
{
	int64_t z = a->at[0][2];

	for (int i = 0; i < 3; i++) {
		int64_t v = a->at[i][2], w = b->at[i][2];

		z = high ? (v > z ? v : z) : (v < z ? v : z);
		z = high ? (w > z ? w : z) : (w < z ? w : z);
	}
	return z;
}

bool volume_pair(const struct volume_triangle *a, const struct volume_triangle *b, struct volume_polygon *ret)
{
	bool swapped = compare(a, b) > 0;
	const struct volume_triangle *s = swapped ? b : a, *t = swapped ? a : b;
	struct pair p;
	int64_t box[4], low;

	if (!common_box(a, b, box))
		return false;
	low = extreme_height(a, b, false);
	p.most = 0;
	side_init(&p.s, s, box, low, &p.most);
	side_init(&p.t, t, box, low, &p.most);
	if (!turns(&p, &p.s, &p.t) || !turns(&p, &p.t, &p.s))
		return false;
	polygon_init(ret, box, (double)(extreme_height(a, b, true) - low));
	if (!same_plan(s, t)) {
		corners(&p, swapped ? -1 : 1, ret);
		return ret->n > 2;
	}
	ret->n = 3;
	ret->exact_area = volume_triangle_area(s);
	for (int i = 0; i < 3; i++) {
		ret->x[i] = p.s.x[i];
		ret->y[i] = p.s.y[i];
		ret->f[i] = (swapped ? -1 : 1) * (p.t.z[i] - p.s.z[i]);
	}
	return true;
}

void volume_above(const struct volume_triangle *t, int64_t whole, double part, struct volume_polygon *ret)
{
	int64_t box[4] = {0};

	common_box(t, t, box);
	polygon_init(ret, box, 0);
	ret->n = 3;
	ret->exact_area = volume_triangle_area(t);
	for (int i = 0; i < 3; i++) {
		ret->x[i] = (double)(t->at[i][0] - box[0]);
		ret->y[i] = (double)(t->at[i][1] - box[1]);
		ret->f[i] = (double)(t->at[i][2] - whole) - part;
		ret->range = fmax(ret->range, fabs(ret->f[i]));
	}
}

/* ---- integrals ---- */

struct integral {
	double fill, cut, area, filled, lowered;
};

/* Over a triangle of which only the corner 0 is above the level: its part there. */
static void lone(double area, const double f[3], double *volume, double *place, double *other, double *other_place)
{
	double part = f[0] / (f[0] - f[1]) * (f[0] / (f[0] - f[2]));
	double mine = area * part * f[0] / 3, rest = mine - area * (f[0] + f[1] + f[2]) / 3;

	*volume += mine;
	*place += area * part;
	*other += rest > 0 ? rest : 0;
	*other_place += area - area * part;
}

static void triangle(double area, double f0, double f1, double f2, struct integral *s)
{
	const double f[3] = {f0, f1, f2};
	unsigned above = 0, below = 0, one = 0;

	s->area += area;
	for (unsigned i = 0; i < 3; i++) {
		above += f[i] > 0;
		below += f[i] < 0;
	}
	if (!below) {
		s->fill += area * (f0 + f1 + f2) / 3;
		s->filled += above ? area : 0;
	} else if (!above) {
		s->cut -= area * (f0 + f1 + f2) / 3;
		s->lowered += area;
	} else {
		/* of one above and one below the first counts, so that it is the same with the sides exchanged */
		bool up;
		double g[3];

		while (f[one] == 0 || (above > 1 && f[one] > 0) || (below > 1 && f[one] < 0))
			one++;
		up = f[one] > 0;
		for (unsigned i = 0; i < 3; i++)
			g[i] = up ? f[(one + i) % 3] : -f[(one + i) % 3];
		lone(area, g, up ? &s->fill : &s->cut, up ? &s->filled : &s->lowered, up ? &s->cut : &s->fill,
		     up ? &s->lowered : &s->filled);
	}
}

static volume_i128 rounded(double v)
{
	return (volume_i128)rint(ldexp(v, VOLUME_PART));
}

static volume_u128 above(double v)
{
	return (volume_u128)ceil(ldexp(v, VOLUME_ERROR_PART)) + 1;
}

/* The bounds of docs/design/volumes.md. */
static void add_error(const struct volume_polygon *p, const struct volume_cuts *cuts, double area, double most,
		      struct volume_sums *sums)
{
	double square = p->extent * p->edge, place = 140 * square;

	if (cuts)
		place = 652 * square + 128 * p->extent * cuts->reach;
	else if (p->exact_area)
		place = 12 * area;
	if (!p->exact_area || most > 0) /* else heights are exact, and the same */
		sums->error += above(UNIT * (place * most + (cuts ? 60 : 44) * area * p->range) + 0x1p-20);
	sums->area_error += p->exact_area && !cuts ? 0 : above(UNIT * place + 0x1p-21);
}

void volume_add(const struct volume_polygon *p, const struct volume_cuts *cuts, struct volume_sums *sums)
{
	struct integral s = {0};
	double most = 0;
	int sign = cuts ? cuts->sign : 1;

	for (unsigned i = 0; i < p->n; i++)
		most = fmax(most, fabs(p->f[i]));
	for (unsigned i = 1; i + 1 < p->n; i++) {
		double area = ((p->x[i] - p->x[0]) * (p->y[i + 1] - p->y[0]) - (p->x[i + 1] - p->x[0]) * (p->y[i] - p->y[0])) / 2;

		if (p->exact_area && !cuts) /* products of doubles lose the area of a long thin triangle */
			area = (double)p->exact_area / 2;
		if (area > 0)
			triangle(area, p->f[0], p->f[i], p->f[i + 1], &s);
	}
	sums->fill += sign * rounded(s.fill);
	sums->cut += sign * rounded(s.cut);
	if (p->exact_area && !cuts)
		sums->shared += p->exact_area << (VOLUME_PART - 1);
	else
		sums->shared += sign * rounded(s.area);
	sums->filled += sign * rounded(s.filled);
	sums->lowered += sign * rounded(s.lowered);
	add_error(p, cuts, s.area, most, sums);
}
