/*
 * The parts of the exact signs that are not worth inlining: ties of the in-circle test, and the side of a cut on which
 * a circumcentre lies.
 *
 * Floating point is used only once, in a filter with a proven bound before the 128-bit computation; a fused product
 * would be at least as accurate as the bound assumes.
 */
#include "geom.h"

#include <math.h>

/* Four distinct positions on one circle. The lexicographically largest one is lifted infinitely more than the others,
 * and its cofactor, an orientation of the other three, is never zero (algorithm.md 1). */
int geom_incircle_tie(const int32_t a[2], const int32_t b[2], const int32_t c[2], const int32_t d[2])
{
	const int32_t *largest = geom_less(a, b) ? b : a;

	if (geom_less(largest, c))
		largest = c;
	if (geom_less(largest, d))
		return -1;
	if (largest == c)
		return geom_orient(a, b, d);
	if (largest == b)
		return geom_orient(a, d, c);
	return geom_orient(d, b, c);
}

/* The circumcentre is exactly on the cut. It moves with the lifted heights; the vertex of highest rank whose height
 * moves it across the cut decides. At most one coefficient of three non-collinear vertices is zero, so two steps
 * suffice. */
int geom_cut_tie(const int32_t a[2], const int32_t b[2], const int32_t c[2], bool vertical)
{
	const int32_t *v[3] = {a, b, c};
	int along = vertical ? 1 : 0, largest = geom_less(a, b) ? 1 : 0;

	if (geom_less(v[largest], c))
		largest = 2;
	for (int step = 0; step < 2; step++) {
		const int32_t *next = v[(largest + 1) % 3], *last = v[(largest + 2) % 3];
		int64_t move = (int64_t)next[along] - last[along];

		if (move)
			return vertical ? geom_sign64(move) : geom_sign64(-move);
		largest = geom_less(next, last) ? (largest + 2) % 3 : (largest + 1) % 3;
	}
	return 0;
}

/*
 * With u = 2^-53 and integer differences below 2^32 (exact): each height has an error of 2u of itself, each product
 * with it 3u; the area has an error of 2u of the sum of its absolute products, its product 3u (the factor is exact);
 * the last two additions add 2u of everything. In all at most 5u + O(u^2) of the sum of the absolute products. 4e-15 is
 * 36u.
 */
int geom_cut_side(const int32_t a[2], const int32_t b[2], const int32_t c[2], int64_t c2, bool vertical)
{
	int64_t bx = (int64_t)b[0] - a[0], by = (int64_t)b[1] - a[1];
	int64_t cx = (int64_t)c[0] - a[0], cy = (int64_t)c[1] - a[1];
	int64_t bv = vertical ? by : bx, cv = vertical ? cy : cx;
	int32_t at = vertical ? a[0] : a[1];

	double fbx = (double)bx, fby = (double)by, fcx = (double)cx, fcy = (double)cy;
	double far = (double)(2 * (int64_t)at - c2);
	double p = (fbx * fbx + fby * fby) * (double)cv, q = (fcx * fcx + fcy * fcy) * (double)bv;
	double l = fbx * fcy, r = fby * fcx;
	double value = (vertical ? p - q : q - p) + (l - r) * far;
	double bound = 4e-15 * (fabs(p) + fabs(q) + (fabs(l) + fabs(r)) * fabs(far));

	if (value > bound)
		return 1;
	if (value < -bound)
		return -1;

	geom_i128 area = (geom_i128)bx * cy - (geom_i128)by * cx;
	geom_i128 bz = (geom_i128)geom_lift(bx, by), cz = (geom_i128)geom_lift(cx, cy);
	geom_i128 exact = geom_cut_value(at, bv, bz, cv, cz, area, c2, vertical);

	return exact ? geom_sign128(exact) : geom_cut_tie(a, b, c, vertical);
}
