#include "brute.h"

#include <string.h>

#include "geom.h"

__extension__ typedef __int128 i128;

static bool before(const struct mesh_vertex *a, const struct mesh_vertex *b)
{
	return a->x < b->x || (a->x == b->x && a->y < b->y);
}

static bool in_circle(const struct mesh_vertex *a, const struct mesh_vertex *b, const struct mesh_vertex *c,
		      const struct mesh_vertex *d)
{
	const int32_t at[4][2] = {{a->x, a->y}, {b->x, b->y}, {c->x, c->y}, {d->x, d->y}};

	return geom_incircle(at[0], at[1], at[2], at[3]) > 0;
}

static int turn(const struct mesh_vertex *a, const struct mesh_vertex *b, const struct mesh_vertex *c)
{
	i128 v = (i128)((int64_t)b->x - a->x) * ((int64_t)c->y - a->y) - (i128)((int64_t)b->y - a->y) * ((int64_t)c->x - a->x);

	return (v > 0) - (v < 0);
}

/* From the lexicographically smallest point: the next point of the hull, counter-clockwise, the nearest first. */
static bool first_edge(const struct mesh_vertex *p, unsigned n, unsigned *ret_a, unsigned *ret_b)
{
	unsigned a = 0, b;

	for (unsigned i = 1; i < n; i++)
		if (before(&p[i], &p[a]))
			a = i;
	b = a == 0 ? 1 : 0;
	for (unsigned i = 0; i < n; i++) {
		int t;

		if (i == a || i == b)
			continue;
		t = turn(&p[a], &p[b], &p[i]);
		/* a is the smallest, so along a line the nearer point is smaller. */
		if (t < 0 || (t == 0 && before(&p[i], &p[b])))
			b = i;
	}
	*ret_a = a;
	*ret_b = b;
	return n >= 3;
}

static void put(const struct mesh_vertex *a, const struct mesh_vertex *b, const struct mesh_vertex *c, int32_t ret[6])
{
	const struct mesh_vertex *v[3] = {a, b, c};
	unsigned first = 0;

	for (unsigned i = 1; i < 3; i++)
		if (before(v[i], v[first]))
			first = i;
	for (unsigned i = 0; i < 3; i++) {
		ret[2 * i] = v[(first + i) % 3]->x;
		ret[2 * i + 1] = v[(first + i) % 3]->y;
	}
}

unsigned brute_triangles(const struct mesh_vertex *p, unsigned n, int32_t (*ret)[6])
{
	static bool done[BRUTE_POINTS][BRUTE_POINTS];
	static unsigned queue[8 * BRUTE_POINTS][2];
	unsigned head = 0, tail = 0, count = 0;

	if (!first_edge(p, n, &queue[0][0], &queue[0][1]))
		return 0;
	tail = 1;
	memset(done, 0, sizeof(done));
	while (head < tail) {
		unsigned a = queue[head][0], b = queue[head][1], c = n;

		head++;
		if (done[a][b])
			continue;
		for (unsigned i = 0; i < n; i++)
			if (i != a && i != b && turn(&p[a], &p[b], &p[i]) > 0 &&
			    (c == n || in_circle(&p[a], &p[b], &p[c], &p[i])))
				c = i;
		done[a][b] = true;
		if (c == n)
			continue;
		done[b][c] = done[c][a] = true;
		put(&p[a], &p[b], &p[c], ret[count++]);
		queue[tail][0] = c;
		queue[tail++][1] = b;
		queue[tail][0] = a;
		queue[tail++][1] = c;
		queue[tail][0] = b;
		queue[tail++][1] = a;
	}
	return count;
}

struct rational {
	i128 num, den; /* den > 0 */
};

static bool less(struct rational a, struct rational b)
{
	return a.num * b.den < b.num * a.den;
}

/* The t on the line for which p[i] is nearest are an interval: its ends are intersections of half lines. */
static bool meets_border(const struct mesh_vertex *p, unsigned n, unsigned i, bool vertical, int64_t c2, int64_t t0, int64_t t1)
{
	struct rational lo = {t0, 1}, hi = {t1, 1};
	bool has_lo = t0 != INT64_MIN, has_hi = t1 != INT64_MAX;
	int64_t u = 2 * (int64_t)(vertical ? p[i].y : p[i].x), x = 2 * (int64_t)(vertical ? p[i].x : p[i].y) - c2;

	for (unsigned k = 0; k < n; k++) {
		int64_t uk = 2 * (int64_t)(vertical ? p[k].y : p[k].x);
		int64_t xk = 2 * (int64_t)(vertical ? p[k].x : p[k].y) - c2;
		/* |(0, t) - (x, u)|^2 <= |(0, t) - (xk, uk)|^2: 2 t (uk - u) <= gap */
		i128 gap = (i128)xk * xk + (i128)uk * uk - (i128)x * x - (i128)u * u;
		struct rational at = {uk > u ? gap : -gap, 2 * (i128)(uk > u ? uk - u : u - uk)};

		if (uk == u && gap < 0)
			return false;
		if (uk > u && (!has_hi || less(at, hi))) {
			hi = at;
			has_hi = true;
		}
		if (uk < u && (!has_lo || less(lo, at))) {
			lo = at;
			has_lo = true;
		}
	}
	return !has_lo || !has_hi || !less(hi, lo);
}

bool brute_meets(const struct mesh_vertex *p, unsigned n, unsigned i, const int64_t box[4])
{
	int64_t x = 2 * (int64_t)p[i].x, y = 2 * (int64_t)p[i].y;

	if (x > box[0] && x < box[2] && y > box[1] && y < box[3])
		return true;
	for (unsigned side = 0; side < 4; side++) {
		bool vertical = side % 2 == 0;

		if (box[side] != INT64_MIN && box[side] != INT64_MAX &&
		    meets_border(p, n, i, vertical, box[side], box[vertical ? 1 : 0], box[vertical ? 3 : 2]))
			return true;
	}
	return false;
}
