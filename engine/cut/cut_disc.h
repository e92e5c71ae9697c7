/*
 * The closed disc of a triangle against boxes, edges and points, in doubles; rounding errs towards meeting.
 *
 * Relative to a corner a, the centre u is N / 2D, with N and D exact before they are converted: each of its numbers has a
 * relative error below 2^-51. A point p (relative to a) is in the closed disc iff p^2 - 2 u p <= 0. A box meets the disc iff the
 * minimum of that over the box, taken axis by axis where p is nearest to u, is <= 0. |px| and |py| are exact, so the error of
 * px (px - 2 ux) is below 2^-49 |px| (|px| + 2 |ux|); taking the nearest p by a rounded u adds the square of the error of u.
 * CUT_DISC_SLACK is 2^-46. So circles of any size are precise near a, where triangles are thin.
 */
#ifndef CUT_DISC_H
#define CUT_DISC_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "geom.h"

#define CUT_DISC_SLACK 0x1p-46

struct cut_disc {
	const int32_t *a;
	double ux, uy; /* from a to the centre */
};

/* a, b, c counter-clockwise. */
static inline void cut_disc_init(struct cut_disc *d, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	int64_t bx = (int64_t)b[0] - a[0], by = (int64_t)b[1] - a[1], cx = (int64_t)c[0] - a[0], cy = (int64_t)c[1] - a[1];
	geom_i128 bz = (geom_i128)bx * bx + (geom_i128)by * by, cz = (geom_i128)cx * cx + (geom_i128)cy * cy;
	double twice = 2 * (double)geom_area(a, b, c);

	d->a = a;
	d->ux = (double)(bz * cy - cz * by) / twice;
	d->uy = (double)(cz * bx - bz * cx) / twice;
}

/* px (px - 2 ux) for the p of [low, high] that is nearest to u; adds its error bound to *slack. */
static inline double cut_disc_along(double u, double low, double high, double *slack)
{
	double p = u < low ? low : u > high ? high : u;

	*slack += fabs(p) * (fabs(p) + 2 * fabs(u));
	return p * (p - 2 * u);
}

/* p^2 - 2 u p of the point of the box that is deepest in the disc. */
static inline double cut_disc_value(const struct cut_disc *d, const int32_t box[4], double *ret_slack)
{
	double value;

	*ret_slack = 0;
	value = cut_disc_along(d->ux, (double)box[0] - d->a[0], (double)box[2] - d->a[0], ret_slack);
	return value + cut_disc_along(d->uy, (double)box[1] - d->a[1], (double)box[3] - d->a[1], ret_slack);
}

static inline bool cut_disc_meets(const struct cut_disc *d, const int32_t box[4])
{
	double slack, value = cut_disc_value(d, box, &slack);

	return value <= CUT_DISC_SLACK * slack;
}

/* Whether the closed segment from p to q meets the disc: by its point that is nearest to the centre. */
static inline bool cut_disc_meets_edge(const struct cut_disc *d, const int32_t p[2], const int32_t q[2])
{
	const double px = (double)p[0] - d->a[0], py = (double)p[1] - d->a[1];
	const double ex = (double)q[0] - p[0], ey = (double)q[1] - p[1];
	double t = ((d->ux - px) * ex + (d->uy - py) * ey) / (ex * ex + ey * ey), x, y, wide, slack;

	t = t > 0 ? t < 1 ? t : 1 : 0;
	x = px + t * ex;
	y = py + t * ey;
	/* x and y have errors of the order of the ends, whatever t is. */
	wide = fabs(px) + fabs(ex) + fabs(py) + fabs(ey);
	slack = wide * (wide + 2 * (fabs(d->ux) + fabs(d->uy)));
	return x * (x - 2 * d->ux) + y * (y - 2 * d->uy) <= CUT_DISC_SLACK * slack;
}

/* A box of lattice numbers that contains all positions in the disc. */
static inline void cut_disc_box(const struct cut_disc *d, int32_t ret[4])
{
	const double u[2] = {d->ux, d->uy}, radius = sqrt(d->ux * d->ux + d->uy * d->uy) * (1 + 0x1p-40) + 1;

	for (unsigned k = 0; k < 2; k++) {
		double low = d->a[k] + u[k] - radius, high = d->a[k] + u[k] + radius;

		ret[k] = low <= INT32_MIN ? INT32_MIN : (int32_t)low;
		ret[2 + k] = high >= INT32_MAX ? INT32_MAX : (int32_t)high;
	}
}

#endif
