/*
 * The verifier's own exact sign for positions with weights (docs/design/weights.md), with the arithmetic of verify.c.
 *
 * The determinant with weights is the one without them, D, and W = the sum of (w of d - w of corner i) times area i. |D| < 2^127
 * and is computed modulo 2^128. Weights are below 2^61 and areas at most 2^64, so |W| < 2^127. The sum may not fit, but D and -W
 * can be compared. If they are equal, the heights are raised a little: that of the highest rank by far the most. The corner i
 * then counts as area i does, and d against it.
 */
#include "verify.h"
#include "verify_place.h"

static bool comes_later(const int32_t *a, const int32_t *b)
{
	return a[0] > b[0] || (a[0] == b[0] && a[1] > b[1]);
}

/* Of the corners that are later than d the last one whose area is not zero decides. */
static int tie(const int32_t *const p[3], const __int128 area[3], const int32_t *d)
{
	const int32_t *last = d;
	int sign = -1;

	for (unsigned i = 0; i < 3; i++) {
		if (!area[i] || !comes_later(p[i], last))
			continue;
		last = p[i];
		sign = area[i] > 0 ? 1 : -1;
	}
	return sign;
}

int verify_power(const int32_t *const p[4], const int64_t w[4], bool *ret_tie)
{
	typedef unsigned __int128 u;
	const int32_t *d = p[3];
	__int128 x[3], y[3], area[3], circle, more = 0;
	u det = 0;

	for (unsigned i = 0; i < 3; i++) {
		x[i] = (int64_t)p[i][0] - d[0];
		y[i] = (int64_t)p[i][1] - d[1];
	}
	for (unsigned i = 0; i < 3; i++) {
		unsigned j = (i + 1) % 3, k = (i + 2) % 3;

		area[i] = x[j] * y[k] - x[k] * y[j];
		det += (u)(x[i] * x[i] + y[i] * y[i]) * (u)area[i];
		more += (w[3] - w[i]) * area[i];
	}
	circle = (__int128)det;
	*ret_tie = circle == -more;
	return *ret_tie ? tie(p, area, d) : circle > -more ? 1 : -1;
}
