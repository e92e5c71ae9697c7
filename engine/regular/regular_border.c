/*
 * The border of the region. Along it the least power of all loaded positions is linear in pieces. It changes where an edge
 * between two cells meets the border; at the corners, and towards infinite ends, the pieces end. A position that is not loaded
 * has less power somewhere on the border if and only if it has less at one of these places.
 *
 * On the border across `axis`, with u along it (doubled), a position has at t the power (h - 2 t u + t^2) / 4, where h is its
 * height. So comparisons of powers are turns of three (u, h), below 2^102. All are closed, and exact.
 */
#include "regular_priv.h"

static geom_i128 height(const struct regular_border *b, struct geom_weighted p)
{
	geom_i128 x = 2 * (int64_t)p.at[b->axis] - b->c2, u = 2 * (int64_t)p.at[!b->axis];

	return x * x + u * u - 4 * (geom_i128)p.w;
}

static geom_i128 corner_power(const struct regular_corner *c, struct geom_weighted p)
{
	geom_i128 x = 2 * (int64_t)p.at[0] - c->at[0], y = 2 * (int64_t)p.at[1] - c->at[1];

	return x * x + y * y - 4 * (geom_i128)p.w;
}

void regular_border_init(struct regular_work *w)
{
	w->nborder = w->ncorner = 0;
	for (unsigned side = 0; side < 4; side++) {
		struct regular_border *b = &w->border[w->nborder];

		if (w->box[side] == INT64_MIN || w->box[side] == INT64_MAX)
			continue;
		*b = (struct regular_border){.axis = side & 1, .c2 = w->box[side]};
		b->t[0] = w->box[!b->axis];
		b->t[1] = w->box[2 + !b->axis];
		w->nborder++;
	}
	for (unsigned i = 0; i < 4; i++) {
		const int64_t x = w->box[i & 1 ? 2 : 0], y = w->box[i & 2 ? 3 : 1];

		if (x == INT64_MIN || x == INT64_MAX || y == INT64_MIN || y == INT64_MAX)
			continue;
		w->corner[w->ncorner++] = (struct regular_corner){.at = {x, y}};
	}
}

void regular_border_survey(struct regular_work *w)
{
	for (uint32_t v = 0; v < w->r.nvertex; v++) {
		struct geom_weighted p = regular_vertex(w, v);

		for (unsigned i = 0; i < w->ncorner; i++) {
			geom_i128 power = corner_power(&w->corner[i], p);

			if (v && power >= w->corner[i].least)
				continue;
			w->corner[i].least = power;
			w->corner[i].vertex = v;
		}
		for (unsigned i = 0; i < w->nborder; i++)
			for (unsigned end = 0; end < 2; end++) {
				struct regular_border *b = &w->border[i];
				int32_t u = p.at[!b->axis];
				geom_i128 h;

				if (b->t[end] != (end ? INT64_MAX : INT64_MIN) || (v && (end ? u < b->most[1] : u > b->most[0])))
					continue;
				h = height(b, p);
				if (v && u == b->most[end] && h >= b->least[end])
					continue;
				b->most[end] = u;
				b->least[end] = h;
			}
	}
}

/* In doubles: a height, and the sum of the absolute values in it, of which its error is less than 2^-50. */
static double rough(const struct regular_border *b, struct geom_weighted p, double *ret_sum)
{
	double x = 2.0 * p.at[b->axis] - (double)b->c2, u = 2.0 * p.at[!b->axis], w = 4.0 * (double)p.w;

	*ret_sum = x * x + u * u + w;
	return x * x + u * u - w;
}

/* The sign: 1 if c is above the line from p to q, where p is before q. */
static int turn(const struct regular_border *b, struct geom_weighted p, struct geom_weighted q, struct geom_weighted c)
{
	int64_t pu = p.at[!b->axis];
	int64_t qu = q.at[!b->axis] - pu, cu = c.at[!b->axis] - pu;
	double sum[3], hp = rough(b, p, &sum[0]), hq = rough(b, q, &sum[1]), hc = rough(b, c, &sum[2]);
	double value = (double)qu * (hc - hp) - (double)cu * (hq - hp);
	geom_i128 h;

	if (fabs(value) > 0x1p-46 * (fabs((double)qu) * (sum[2] + sum[0]) + fabs((double)cu) * (sum[1] + sum[0])))
		return value > 0 ? 1 : -1;
	h = height(b, p);
	return geom_sign128(qu * (height(b, c) - h) - cu * (height(b, q) - h));
}

/* In their order along the border; false: they are at one place. */
static bool order(const struct regular_work *w, const struct regular_border *b, uint32_t a, uint32_t c,
		  struct geom_weighted ret[2])
{
	const struct geom_weighted p = regular_vertex(w, a), q = regular_vertex(w, c);
	bool swap = p.at[!b->axis] > q.at[!b->axis];

	ret[0] = swap ? q : p;
	ret[1] = swap ? p : q;
	return p.at[!b->axis] != q.at[!b->axis];
}

bool regular_border_meets(const struct regular_work *w, unsigned i, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
	const struct regular_border *border = &w->border[i];
	struct geom_weighted v[2];
	geom_i128 step, rise;

	if (!order(w, border, a, b, v))
		return false;
	/* They have the same power at t = rise / (2 step), with u doubled. */
	step = 4 * ((geom_i128)v[1].at[!border->axis] - v[0].at[!border->axis]);
	rise = height(border, v[1]) - height(border, v[0]);
	if ((border->t[0] != INT64_MIN && rise < step * border->t[0]) ||
	    (border->t[1] != INT64_MAX && rise > step * border->t[1]))
		return false;
	return (c == TRI_GHOST || turn(border, v[0], v[1], regular_vertex(w, c)) >= 0) &&
	       (d == TRI_GHOST || turn(border, v[0], v[1], regular_vertex(w, d)) >= 0);
}

/* From a, the place of the edge. */
static void place(const struct regular_work *w, unsigned i, uint32_t a, uint32_t b, double ret[2])
{
	const struct regular_border *border = &w->border[i];
	struct geom_weighted p = regular_vertex(w, a), q = regular_vertex(w, b);
	int64_t along = (int64_t)q.at[!border->axis] - p.at[!border->axis],
		across = (int64_t)q.at[border->axis] - p.at[border->axis];
	int64_t off = border->c2 - 2 * (int64_t)p.at[border->axis];

	/* From a, the place u has |b|^2 - 2 u b = wb - wa. */
	ret[border->axis] = (double)off / 2;
	ret[!border->axis] = (double)(geom_power_lift(along, across, q.w - p.w) - (geom_i128)off * across) / (2 * (double)along);
}

_Static_assert(TRI_MAX_POINTS <= 1u << 30, "a number of a vertex leaves room for the side");

static uint64_t key_of(unsigned i, int32_t along)
{
	return (uint64_t)i << 32 | ((uint32_t)along ^ 0x80000000u);
}

static uint64_t key(const struct regular_cross *c)
{
	return key_of(c->side_a & 3, c->at);
}

int regular_border_add(struct regular_work *w, unsigned i, uint32_t a, uint32_t b)
{
	unsigned along = !w->border[i].axis;
	bool swap = w->r.xy[a][along] > w->r.xy[b][along];
	uint32_t first = swap ? b : a;
	double u[2];

	place(w, i, a, b, u);
	regular_disc_add(w, a, u);
	w->cross[w->ncross++] = (struct regular_cross){w->r.xy[first][along], first << 2 | i, swap ? a : b};
	return w->ncross == w->mostcross ? regular_read(w) : 0;
}

static void sift(struct regular_cross *c, uint32_t n, uint32_t at)
{
	struct regular_cross moved = c[at];

	for (uint32_t child = 2 * at + 1; child < n; child = 2 * at + 1) {
		child += child + 1 < n && key(&c[child + 1]) > key(&c[child]);
		if (key(&c[child]) <= key(&moved))
			break;
		c[at] = c[child];
		at = child;
	}
	c[at] = moved;
}

/* The edges from `from` on that are below the key are before the returned one. */
static uint32_t first_at(const struct regular_work *w, uint32_t from, uint64_t from_key)
{
	uint32_t low = from, high = w->ncross;

	while (low < high) {
		uint32_t middle = low + (high - low) / 2;

		if (key(&w->cross[middle]) < from_key)
			low = middle + 1;
		else
			high = middle;
	}
	return low;
}

void regular_border_sort(struct regular_work *w)
{
	for (uint32_t i = w->ncross / 2; i-- > 0;)
		sift(w->cross, w->ncross, i);
	for (uint32_t n = w->ncross; n-- > 1;) {
		struct regular_cross last = w->cross[n];

		w->cross[n] = w->cross[0];
		w->cross[0] = last;
		sift(w->cross, n, 0);
	}
	w->side[0] = 0;
	for (unsigned i = 1; i <= w->nborder; i++)
		w->side[i] = first_at(w, w->side[i - 1], key_of(i, INT32_MIN));
}

/*
 * Along a side the power of a position less the least one is convex: its slope is that of u of the cell that is there, less u of
 * the position. So it is least at the last edge that begins before the position's u, or at an end of the side. Equal beginnings
 * are at one place. Of the edges that are read at one time any can be that edge; the other ones are not below.
 */
bool regular_border_below(const struct regular_work *w, struct geom_weighted p)
{
	for (unsigned i = 0; i < w->nborder; i++) {
		int32_t along = p.at[!w->border[i].axis];
		uint32_t end = first_at(w, w->side[i], key_of(i, along));
		const struct regular_cross *c = &w->cross[end - 1];

		if (end > w->side[i] && turn(&w->border[i], regular_vertex(w, c->side_a >> 2), regular_vertex(w, c->b), p) <= 0)
			return true;
	}
	return false;
}

bool regular_border_ends(const struct regular_work *w, struct geom_weighted p)
{
	for (unsigned i = 0; i < w->ncorner; i++)
		if (corner_power(&w->corner[i], p) <= w->corner[i].least)
			return true;
	for (unsigned i = 0; !w->c->no_hull && i < w->nborder; i++)
		for (unsigned end = 0; end < 2; end++) {
			const struct regular_border *b = &w->border[i];
			int32_t u = p.at[!b->axis];

			if (b->t[end] != (end ? INT64_MAX : INT64_MIN))
				continue;
			if (end ? u > b->most[1] : u < b->most[0])
				return true;
			if (u == b->most[end] && height(b, p) <= b->least[end])
				return true;
		}
	return false;
}

bool regular_border_ends_box(const struct regular_work *w, const int32_t box[4])
{
	for (unsigned i = 0; !w->c->no_hull && i < w->nborder; i++) {
		const struct regular_border *b = &w->border[i];

		if ((b->t[0] == INT64_MIN && box[!b->axis] <= b->most[0]) ||
		    (b->t[1] == INT64_MAX && box[2 + !b->axis] >= b->most[1]))
			return true;
	}
	return false;
}

/* As cut_region_owns_hull, but for the place of the ray. */
bool regular_owns_hull(const struct regular_work *w, uint32_t i, unsigned ghost)
{
	const uint32_t *c = w->r.triangle[i].corner;
	const struct geom_weighted a = regular_vertex(w, c[(ghost + 1) % 3]), b = regular_vertex(w, c[(ghost + 2) % 3]);
	int64_t to[2] = {(int64_t)a.at[1] - b.at[1], (int64_t)b.at[0] - a.at[0]};

	for (unsigned axis = 0; axis < 2; axis++) {
		int64_t lower = w->box[axis], upper = w->box[axis + 2], far = (int64_t)b.at[axis] - a.at[axis];
		geom_i128 rise;

		if (to[axis] > 0 ? upper != INT64_MAX : to[axis] < 0 && lower != INT64_MIN)
			return false;
		if (to[axis])
			continue;
		/* The ray is at a + rise / (2 far). */
		rise = (geom_i128)far * far - b.w + a.w;
		rise += 2 * (geom_i128)far * a.at[axis];
		if (far < 0) {
			rise = -rise;
			far = -far;
		}
		if ((lower != INT64_MIN && rise <= (geom_i128)lower * far) ||
		    (upper != INT64_MAX && rise > (geom_i128)upper * far))
			return false;
	}
	return true;
}
