/*
 * Chains (cut_chain.h has the model). The functions that decide which points belong to the halo (add, flush) are exact: h < 2^67,
 * hull orientations < 2^102; doubles are used first where they are certain. What decides which cells to read (hit,
 * limit, reach, peak) is in doubles and errs towards reading: on edges E(U) - U^2 is a sum of non-negative terms, so
 * nothing cancels.
 */
#include "cut_chain.h"

#include <math.h>
#include <string.h>

#include "cut.h"
#include "cut_order.h"

__extension__ typedef __int128 i128;

/* Rounding of a few operations, and the loss from an integer place beside the true extremum. */
#define SLACK_REL 1e-12
#define SLACK_ABS 1e-3
#define TURN_SLACK 1e-14

enum { RIPE_MIN = 1024 };

static i128 height(const struct cut_chain *c, const struct point *p)
{
	i128 x = cut_chain_x(c, p), u = cut_chain_u(c, p);

	return x * x + u * u;
}

/*
 * Chooses when the batch is merged: soon while the chain is short, so that it gets low early and rejects more; at a
 * quarter of its length when it is long (convex position), so that n points cost O(n log n) and not a merge for every
 * few of them.
 */
static void set_batch_size(struct cut_chain *c)
{
	uint32_t ripe = c->n / 4 > RIPE_MIN ? c->n / 4 : RIPE_MIN;

	c->ripe = ripe < c->batch_cap ? ripe : c->batch_cap;
}

void cut_chain_init(struct cut_chain *c, bool vertical, int64_t c2, int64_t t0, int64_t t1, struct point *pt, uint32_t cap,
		    struct point *batch, uint32_t batch_cap)
{
	*c = (struct cut_chain){.vertical = vertical,
				.c2 = c2,
				.t0 = t0,
				.t1 = t1,
				.pt = pt,
				.cap = cap,
				.batch = batch,
				.batch_cap = batch_cap,
				.reach = INFINITY};
	set_batch_size(c);
}

/* Number of entries with a U of at most u. */
static uint32_t count_upto(const struct cut_chain *c, int64_t u)
{
	uint32_t lo = 0, hi = c->n;

	while (lo < hi) {
		uint32_t mid = lo + (hi - lo) / 2;

		if (cut_chain_u(c, &c->pt[mid]) <= u)
			lo = mid + 1;
		else
			hi = mid;
	}
	return lo;
}

static double square(double v)
{
	return v * v;
}

/*
 * The sign of (hb - ha)(u - ua) - (h - ha)(ub - ua): positive if b is above the line from a to p and between them. With
 * U relative to ua, the squares of U cancel except for du dub (dub - du). In doubles the sum is certain unless it is
 * small compared with its terms: each has at most five roundings of 2^-53.
 */
static int turn(const struct cut_chain *c, const struct point *a, const struct point *b, const struct point *p)
{
	int64_t ua = cut_chain_u(c, a);
	double du = (double)(cut_chain_u(c, p) - ua), dub = (double)(cut_chain_u(c, b) - ua);
	double xa = square((double)cut_chain_x(c, a)), xb = square((double)cut_chain_x(c, b)),
	       x = square((double)cut_chain_x(c, p));
	double most = (xa + xb) * fabs(du) + (xa + x) * fabs(dub) + fabs(du * dub) * (fabs(du) + fabs(dub));
	double sum = (xb - xa) * du - (x - xa) * dub + du * dub * (dub - du);
	i128 left, right, ha;

	if (sum > TURN_SLACK * most)
		return 1;
	if (sum < -TURN_SLACK * most)
		return -1;
	ha = height(c, a);
	left = (height(c, b) - ha) * (cut_chain_u(c, p) - ua);
	right = (height(c, p) - ha) * (cut_chain_u(c, b) - ua);
	return (left > right) - (left < right);
}

/* Whether p is above the ray of slope 2t from the chain's end. An infinite end has no ray: +infinity. */
static bool above_ray(const struct cut_chain *c, const struct point *end, int64_t t, i128 h, int64_t u)
{
	if (t == INT64_MIN || t == INT64_MAX)
		return false;
	return h - height(c, end) > (i128)(2 * t) * (u - cut_chain_u(c, end));
}

bool cut_chain_above(const struct cut_chain *c, const struct point *p)
{
	int64_t u = cut_chain_u(c, p), x = cut_chain_x(c, p);
	const struct point *a;
	uint32_t k;

	if (c->n == 0)
		return false;
	if ((double)x > c->reach)
		return true;
	k = count_upto(c, u);
	if (k == 0)
		return above_ray(c, &c->pt[0], c->t0, height(c, p), u);
	a = &c->pt[k - 1];
	if (cut_chain_u(c, a) == u)
		return x > cut_chain_x(c, a);
	if (k == c->n)
		return above_ray(c, a, c->t1, height(c, p), u);
	return turn(c, a, p, &c->pt[k]) > 0;
}

void cut_chain_batch(struct cut_chain *c, struct point *batch, uint32_t batch_cap)
{
	c->batch = batch;
	c->batch_cap = batch_cap;
	set_batch_size(c);
}

int cut_chain_add(struct cut_chain *c, const struct view *view, const struct point *p)
{
	if (cut_chain_above(c, p))
		return 0;
	if (c->nbatch >= c->ripe) {
		int rc = cut_chain_flush(c, view);

		if (rc)
			return rc;
		if (cut_chain_above(c, p))
			return 0;
	}
	c->batch[c->nbatch++] = *p;
	return 0;
}

/* By U, then by distance, then by the side of the line: points with the same position become neighbours. */
static bool chain_less(const void *ctx, const struct point *a, const struct point *b)
{
	const struct cut_chain *c = ctx;
	int64_t ua = cut_chain_u(c, a), ub = cut_chain_u(c, b), xa, xb;

	if (ua != ub)
		return ua < ub;
	xa = cut_chain_x(c, a);
	xb = cut_chain_x(c, b);
	if (xa != xb)
		return xa < xb;
	return c->vertical ? a->x < b->x : a->y < b->y;
}

static bool same_position(const struct point *a, const struct point *b)
{
	return a->x == b->x && a->y == b->y;
}

/* The first entry of the group with the same U that ends at k - 1. */
static uint32_t group_start(const struct cut_chain *c, uint32_t k)
{
	return k >= 2 && cut_chain_u(c, &c->pt[k - 2]) == cut_chain_u(c, &c->pt[k - 1]) ? k - 2 : k - 1;
}

/* Removes from the stack of k entries the groups that are strictly above the line to p; ties stay. */
static uint32_t pop_above(const struct cut_chain *c, uint32_t k, const struct point *p)
{
	while (k > 0) {
		uint32_t g = group_start(c, k);

		if (g == 0 || turn(c, &c->pt[g - 1], &c->pt[g], p) <= 0)
			break;
		k = g;
	}
	return k;
}

/* Trims the ends to slopes 2 t0 .. 2 t1. An edge with exactly that slope stays, because its ends are equally near. */
static void trim_ends(struct cut_chain *c)
{
	uint32_t first = 0;

	while (c->t1 != INT64_MAX && c->n > 0) {
		uint32_t g = group_start(c, c->n);
		const struct point *a, *b = &c->pt[g];

		if (g == 0)
			break;
		a = &c->pt[g - 1];
		if (height(c, b) - height(c, a) <= (i128)(2 * c->t1) * (cut_chain_u(c, b) - cut_chain_u(c, a)))
			break;
		c->n = g;
	}
	while (c->t0 != INT64_MIN) {
		uint32_t next = first + 1;
		const struct point *a = &c->pt[first];

		if (next < c->n && cut_chain_u(c, &c->pt[next]) == cut_chain_u(c, a))
			next++;
		if (next >= c->n)
			break;
		if (height(c, &c->pt[next]) - height(c, a) >=
		    (i128)(2 * c->t0) * (cut_chain_u(c, &c->pt[next]) - cut_chain_u(c, a)))
			break;
		first = next;
	}
	c->n -= first;
	memmove(c->pt, c->pt + first, c->n * sizeof(*c->pt));
}

/* Where the cells of a and b (ua < ub) meet on the border: half the slope of their edge. */
static double parting(double ua, double xa, double ub, double xb)
{
	return (xb - xa) * (xb + xa) / (2 * (ub - ua)) + (ua + ub) / 2;
}

static double larger(double a, double b)
{
	return a > b ? a : b;
}

/* Upper bound of E(U) - U^2 on an edge: the larger end of its chord, plus the chord's gap to U^2. */
static double edge_bound(double ua, double xa, double ub, double xb)
{
	return (square(larger(xa, xb)) + square(ub - ua) / 4) * (1 + SLACK_REL);
}

/* Computes reach and peaks, bounds that avoid visiting every edge. */
void cut_chain_survey(struct cut_chain *c)
{
	double far = 0, u = 0, x = 0;

	for (c->peak_shift = 0; c->n >> c->peak_shift >= CUT_CHAIN_PEAKS;)
		c->peak_shift++;
	for (uint32_t i = 0; i < CUT_CHAIN_PEAKS; i++)
		c->peak[i] = 0;
	for (uint32_t i = 0; i < c->n; i++) {
		double un = (double)cut_chain_u(c, &c->pt[i]), xn = (double)cut_chain_x(c, &c->pt[i]);

		if (i == 0) {
			far = square(xn) + square(un - (double)c->t0);
		} else if (un != u) {
			double t = parting(u, x, un, xn), *peak = &c->peak[i >> c->peak_shift];

			far = larger(far, square(x) + square(u - t));
			*peak = larger(*peak, edge_bound(u, x, un, xn));
		}
		u = un;
		x = xn;
	}
	far = larger(far, square(x) + square(u - (double)c->t1));
	c->reach = c->n == 0 || c->t0 == INT64_MIN || c->t1 == INT64_MAX ? INFINITY : sqrt(far) * (1 + SLACK_REL) + 1;
}

void cut_chain_of(struct cut_chain *c, struct point *pt, uint32_t n)
{
	c->pt = pt;
	c->n = c->cap = n;
	c->reach = INFINITY;
	for (c->peak_shift = 0; c->n >> c->peak_shift >= CUT_CHAIN_PEAKS;)
		c->peak_shift++;
	for (unsigned i = 0; i < CUT_CHAIN_PEAKS; i++)
		c->peak[i] = INFINITY;
}

/* It often comes in order. */
static void sort_batch(struct cut_chain *c)
{
	uint32_t i = 1;

	while (i < c->nbatch && !chain_less(c, &c->batch[i], &c->batch[i - 1]))
		i++;
	if (i < c->nbatch)
		cut_order_sort(c->batch, c->nbatch, chain_less, c);
}

/* Merges the batch into the chain, from the end. *ret_first, *ret_last: entries before and after these are of the chain
 * only. */
static void merge_batch(struct cut_chain *c, uint32_t *ret_first, uint32_t *ret_last)
{
	uint32_t i = c->n, j = c->nbatch, k = i + j;

	*ret_last = 0;
	while (j > 0) {
		if (i > 0 && chain_less(c, &c->batch[j - 1], &c->pt[i - 1])) {
			c->pt[--k] = c->pt[--i];
			continue;
		}
		c->pt[--k] = c->batch[--j];
		*ret_last = *ret_last ? *ret_last : k;
	}
	*ret_first = k;
	c->nbatch = 0;
}

/* Adds a point behind the k entries of the hull so far; returns the new number. */
static uint32_t hull_add(struct cut_chain *c, const struct view *view, uint32_t k, const struct point *p)
{
	if (k > 0 && same_position(&c->pt[k - 1], p)) {
		if (view_prefers(view, p, &c->pt[k - 1]))
			c->pt[k - 1] = *p;
		return k;
	}
	if (k > 0 && cut_chain_u(c, &c->pt[k - 1]) == cut_chain_u(c, p)) {
		if (cut_chain_x(c, &c->pt[k - 1]) < cut_chain_x(c, p))
			return k;
	} else {
		k = pop_above(c, k, p);
	}
	c->pt[k++] = *p;
	return k;
}

/*
 * The chain was a hull. So it still is one up to where the batch begins; and after the batch, once two neighbouring
 * groups have stayed neighbours, the rest stays.
 */
int cut_chain_flush(struct cut_chain *c, const struct view *view)
{
	enum { STAYED = 4 /* two groups with the same U */ };
	uint32_t total = c->n + c->nbatch, first, last, k, stayed = 0;

	if (c->nbatch == 0)
		return 0;
	if (total > c->cap)
		return CUT_E_FULL;
	sort_batch(c);
	merge_batch(c, &first, &last);
	k = first;
	for (uint32_t i = first; i < total; i++) {
		const struct point p = c->pt[i];
		uint32_t to = hull_add(c, view, k, &p);

		stayed = i > last && to == k + 1 ? stayed + 1 : 0;
		k = to;
		if (stayed < STAYED)
			continue;
		memmove(c->pt + k, c->pt + i + 1, (total - i - 1) * sizeof *c->pt);
		k += total - i - 1;
		break;
	}
	c->n = k;
	trim_ends(c);
	set_batch_size(c);
	cut_chain_survey(c);
	return 0;
}

void cut_chain_span(const struct cut_chain *c, const int32_t box[4], int64_t *ret_u0, int64_t *ret_u1, int64_t *ret_x)
{
	unsigned along = c->vertical ? 1 : 0, across = 1 - along;
	int64_t v0 = 2 * (int64_t)box[across] - c->c2, v1 = 2 * (int64_t)box[across + 2] - c->c2;

	*ret_u0 = 2 * (int64_t)box[along];
	*ret_u1 = 2 * (int64_t)box[along + 2];
	*ret_x = v0 > 0 ? v0 : v1 < 0 ? -v1 : 1;
}

static int64_t clamp(double t, int64_t lo, int64_t hi)
{
	return t <= (double)lo ? lo : t >= (double)hi ? hi : (int64_t)(t < 0 ? t - 0.5 : t + 0.5);
}

/* The largest E(U) - U^2 for U in [u0, u1] on the ray of slope 2t from `end`. */
static double ray_most(const struct cut_chain *c, const struct point *end, int64_t t, int64_t u0, int64_t u1)
{
	int64_t ue = cut_chain_u(c, end), u;
	double x = (double)cut_chain_x(c, end), bow;

	if (t == INT64_MIN || t == INT64_MAX)
		return INFINITY;
	u = t < u0 ? u0 : t > u1 ? u1 : t;
	bow = (double)(u - ue) * (double)(2 * t - u - ue);
	/* Negative beyond the far side of the circle around the corner: only here the terms cancel. */
	return x * x + bow + SLACK_REL * (x * x + fabs(bow));
}

/* E(U) - U^2 on the edge from a to b. Both shares of the edge are computed from differences of U, which are exact; 1
 * minus the other share would not be. */
static double edge_at(double ua, double xa, double ub, double xb, double u)
{
	return (xa * xa * (ub - u) + xb * xb * (u - ua)) / (ub - ua) + (u - ua) * (ub - u);
}

/* The largest value for U in [u0, u1] within the edge. */
static double edge_most(const struct cut_chain *c, const struct point *a, const struct point *b, int64_t u0, int64_t u1)
{
	double ua = (double)cut_chain_u(c, a), ub = (double)cut_chain_u(c, b);
	double xa = (double)cut_chain_x(c, a), xb = (double)cut_chain_x(c, b);

	return edge_at(ua, xa, ub, xb, (double)clamp(parting(ua, xa, ub, xb), u0, u1));
}

/* Whether E(U) - U^2 is at least `need` anywhere on the edges, U in [u0, u1] between the first and the last entry. */
static bool edges_reach(const struct cut_chain *c, int64_t u0, int64_t u1, double need)
{
	for (uint32_t k = count_upto(c, u0); k < c->n;) {
		uint32_t end = ((k >> c->peak_shift) + 1) << c->peak_shift;
		bool low = c->peak[k >> c->peak_shift] < need;

		if (cut_chain_u(c, &c->pt[k - 1]) > u1)
			break;
		for (end = end < c->n ? end : c->n; k < end && !low; k++) {
			int64_t ua = cut_chain_u(c, &c->pt[k - 1]), ub = cut_chain_u(c, &c->pt[k]);

			if (ua > u1)
				return false;
			if (ua < ub && edge_most(c, &c->pt[k - 1], &c->pt[k], ua > u0 ? ua : u0, ub < u1 ? ub : u1) >= need)
				return true;
		}
		k = end;
	}
	return false;
}

bool cut_chain_hit(const struct cut_chain *c, const int32_t box[4])
{
	int64_t u0, u1, x, first, last;
	double need, end;

	cut_chain_span(c, box, &u0, &u1, &x);
	if (c->n == 0)
		return true;
	if (c->reach < INFINITY && ((double)x > c->reach || (double)(u0 - c->t1) > c->reach || (double)(c->t0 - u1) > c->reach))
		return false;
	need = (double)x * (double)x * (1 - SLACK_REL) - SLACK_ABS;
	first = cut_chain_u(c, &c->pt[0]);
	last = cut_chain_u(c, &c->pt[c->n - 1]);
	if (u0 < first && ray_most(c, &c->pt[0], c->t0, u0, u1 < first ? u1 : first) >= need)
		return true;
	if (u1 > last && ray_most(c, &c->pt[c->n - 1], c->t1, u0 > last ? u0 : last, u1) >= need)
		return true;
	u0 = u0 < first ? first : u0;
	u1 = u1 > last ? last : u1;
	if (u0 > u1)
		return false;
	end = (double)cut_chain_x(c, &c->pt[c->n - 1]);
	return (u1 == last && end * end >= need) || edges_reach(c, u0, u1, need);
}

/* E(U) - U^2. *k: number of entries with a U of at most u, from an earlier call with a smaller u. */
static double value_at(const struct cut_chain *c, int64_t u, uint32_t *k)
{
	const struct point *a, *b;

	if (c->n == 0)
		return INFINITY;
	while (*k < c->n && cut_chain_u(c, &c->pt[*k]) <= u)
		++*k;
	if (*k == 0)
		return ray_most(c, &c->pt[0], c->t0, u, u);
	a = &c->pt[*k - 1];
	if (cut_chain_u(c, a) == u)
		return square((double)cut_chain_x(c, a));
	if (*k == c->n)
		return ray_most(c, a, c->t1, u, u);
	b = &c->pt[*k];
	return edge_at((double)cut_chain_u(c, a), (double)cut_chain_x(c, a), (double)cut_chain_u(c, b), (double)cut_chain_x(c, b),
		       (double)u);
}

void cut_chain_limits(const struct cut_chain *c, int64_t u0, unsigned shift, unsigned n, int64_t *ret)
{
	uint32_t k = count_upto(c, u0);
	double w = (double)((int64_t)1 << shift), last = value_at(c, u0, &k);

	for (unsigned i = 0; i < n; i++) {
		double next = value_at(c, u0 + ((int64_t)(i + 1) << shift), &k);
		/* E is convex and so below its chord; the chord's gap to U^2 adds at most w^2 / 4. */
		double m = larger(last, next) + w * w / 4, limit = m < 0 ? -1 : sqrt(m) * (1 + SLACK_REL) + 1;

		ret[i] = limit < 0x1p40 ? (int64_t)ceil(limit) : INT64_MAX;
		last = next;
	}
}
