/*
 * Exact signs with weights: the general forms, and ties. Heights of positions on one line need not be strictly convex, so a
 * coefficient in a tie can be zero, and the next position in rank decides.
 */
#include "geom_power.h"

/* Ranks of n positions, the highest first. */
static void sort_ranks(const struct geom_weighted *v, unsigned n, unsigned order[4])
{
	for (unsigned i = 0; i < n; i++) {
		unsigned at = i;

		for (; at > 0 && geom_less(v[order[at - 1]].at, v[i].at); at--)
			order[at] = order[at - 1];
		order[at] = i;
	}
}

/* The position of highest rank that has an influence decides. That of d is the area of a, b, c, so it ends there. */
static int power_tie(const struct geom_weighted v[4])
{
	const int32_t *a = v[0].at, *b = v[1].at, *c = v[2].at, *d = v[3].at;
	unsigned order[4];

	sort_ranks(v, 4, order);
	for (unsigned i = 0; order[i] != 3; i++) {
		int turn = order[i] == 0 ? geom_orient(d, b, c) : order[i] == 1 ? geom_orient(a, d, c) : geom_orient(a, b, d);

		if (turn)
			return turn;
	}
	return -1;
}

/* All in [-2^30, 2^30): areas are at most 2^61, lifts below 2^62. */
static bool is_narrow(int64_t ax, int64_t ay, int64_t bx, int64_t by, int64_t cx, int64_t cy)
{
	const uint64_t bias = UINT64_C(1) << 30;

	return !((((uint64_t)ax + bias) | ((uint64_t)ay + bias) | ((uint64_t)bx + bias) | ((uint64_t)by + bias) |
		  ((uint64_t)cx + bias) | ((uint64_t)cy + bias)) >>
		 31);
}

int geom_power(struct geom_weighted a, struct geom_weighted b, struct geom_weighted c, struct geom_weighted d)
{
	int64_t ax = (int64_t)a.at[0] - d.at[0], ay = (int64_t)a.at[1] - d.at[1];
	int64_t bx = (int64_t)b.at[0] - d.at[0], by = (int64_t)b.at[1] - d.at[1];
	int64_t cx = (int64_t)c.at[0] - d.at[0], cy = (int64_t)c.at[1] - d.at[1];
	int sign;

	if (is_narrow(ax, ay, bx, by, cx, cy)) {
		int64_t az = ax * ax + ay * ay - (a.w - d.w), bz = bx * bx + by * by - (b.w - d.w);
		int64_t cz = cx * cx + cy * cy - (c.w - d.w);

		sign = geom_sign128((geom_i128)az * (bx * cy - by * cx) + (geom_i128)bz * (cx * ay - cy * ax) +
				    (geom_i128)cz * (ax * by - ay * bx));
	} else {
		sign = geom_power_det(ax, ay, geom_power_lift(ax, ay, a.w - d.w), bx, by, geom_power_lift(bx, by, b.w - d.w), cx,
				      cy, geom_power_lift(cx, cy, c.w - d.w));
	}
	return sign ? sign : power_tie((const struct geom_weighted[4]){a, b, c, d});
}

/* Along the axis on which the line is not constant: t is a position's distance to p along it, and the rest of the height, across,
 * is linear in t. Of three positions on one line all have an influence, so the highest decides. */
int geom_power_line(struct geom_weighted a, struct geom_weighted b, struct geom_weighted p)
{
	unsigned axis = a.at[0] == b.at[0];
	int64_t ta = (int64_t)a.at[axis] - p.at[axis], tb = (int64_t)b.at[axis] - p.at[axis];
	geom_i128 za = geom_power_lift(ta, (int64_t)a.at[!axis] - p.at[!axis], a.w - p.w);
	geom_i128 zb = geom_power_lift(tb, (int64_t)b.at[!axis] - p.at[!axis], b.w - p.w);
	/* The height of the line at p is (za tb - zb ta) / (tb - ta). */
	geom_i128 height = za * tb - zb * ta;
	int sign = geom_sign128(tb > ta ? height : -height);
	const int32_t *largest = geom_less(a.at, b.at) ? b.at : a.at;

	if (sign)
		return sign;
	if (geom_less(largest, p.at))
		return -1;
	/* The line is lifted at its higher end, turning about the other one. */
	if (largest == b.at)
		return geom_less(a.at, p.at) ? 1 : -1;
	return geom_less(b.at, p.at) ? 1 : -1;
}

int geom_power_side(struct geom_weighted a, struct geom_weighted b, struct geom_weighted c, int64_t c2, bool vertical)
{
	int64_t bx = (int64_t)b.at[0] - a.at[0], by = (int64_t)b.at[1] - a.at[1];
	int64_t cx = (int64_t)c.at[0] - a.at[0], cy = (int64_t)c.at[1] - a.at[1];
	geom_i128 area = (geom_i128)bx * cy - (geom_i128)by * cx;
	geom_i128 bz = geom_power_lift(bx, by, b.w - a.w), cz = geom_power_lift(cx, cy, c.w - a.w);
	geom_i128 exact =
		geom_cut_value(vertical ? a.at[0] : a.at[1], vertical ? by : bx, bz, vertical ? cy : cx, cz, area, c2, vertical);

	return exact ? geom_sign128(exact) : geom_cut_tie(a.at, b.at, c.at, vertical);
}
