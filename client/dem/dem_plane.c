/*
 * Heights of a triangle's plane at pixel centres: the nearest float32 to the exact number.
 *
 * Doubles give the height and a bound of their error. Where both ends of that interval round to one float32, it is the one;
 * else (about one pixel in a million, and exact ties) whole numbers decide. So the result has no rounding but the last, and the
 * order of corners, triangles and pixels does not count.
 *
 * With the places of a pixel relative to the corner a, and the others as lattice vectors b and c from there,
 *
 *     Z = Z_a + (x * (b.z c.y - c.z b.y) + y * (b.x c.z - c.x b.z)) / (2q * area),  area = b.x c.y - c.x b.y
 *
 * Lattice vectors have 33 bits, so gradients and area have 67; places have 33 + 1 + 20 bits (Q_MOST), products 121.
 */
#include <math.h>
#include <string.h>

#include "dem_priv.h"

#define ERROR_BOUND 0x1p-48 /* 32 roundings; there are fewer than 16, counted along `at + dx * i + dy * j` */

void dem_plane_init(struct dem_plane *f, const struct dem_scale *scale, const struct dem_grid *g,
		    const struct dem_corner corner[3], dem_i128 area, int64_t x0, int64_t y0)
{
	const int32_t *a = corner[0].at, *b = corner[1].at, *c = corner[2].at;
	double whole, gx, gy, ex = 0, ey = 0;

	*f = (struct dem_plane){
		.scale = scale, .step = 2 * g->p, .a = corner[0], .area = area, .q2 = 2 * g->q, .x0 = x0, .y0 = y0};
	f->east = (dem_i128)((int64_t)b[2] - a[2]) * ((int64_t)c[1] - a[1]) -
		  (dem_i128)((int64_t)c[2] - a[2]) * ((int64_t)b[1] - a[1]);
	f->north = (dem_i128)((int64_t)b[0] - a[0]) * ((int64_t)c[2] - a[2]) -
		   (dem_i128)((int64_t)c[0] - a[0]) * ((int64_t)b[2] - a[2]);
	whole = (double)area * (double)f->q2;
	gx = (double)f->east / whole;
	gy = (double)f->north / whole;
	for (int i = 0; i < 3; i++) {
		ex = fmax(ex, fabs((double)(corner[i].x - f->a.x)));
		ey = fmax(ey, fabs((double)(corner[i].y - f->a.y)));
	}
	f->at = (double)(a[2] + scale->k);
	f->slack = ERROR_BOUND * (fabs(f->at) + 2 * fabs(gx) * ex + 2 * fabs(gy) * ey) * scale->factor;
	f->at += gx * (double)(x0 * f->step - f->a.x) + gy * (double)(y0 * f->step - f->a.y);
	f->at *= scale->factor;
	f->dx = gx * (double)f->step * scale->factor;
	f->dy = gy * (double)f->step * scale->factor;
}

void dem_plane_gradient(const struct dem_plane *f, double ret[2])
{
	ret[0] = (double)f->east / (double)f->area;
	ret[1] = (double)f->north / (double)f->area;
}

/* ---- the exact height ---- */

/* height = n / d */
struct height {
	struct dem_big n, d;
};

static struct height height_at(const struct dem_plane *f, int64_t x, int64_t y)
{
	const struct dem_scale *s = f->scale;
	dem_i128 whole = f->area * f->q2;
	dem_i128 rest = (x * f->step - f->a.x) * f->east + (y * f->step - f->a.y) * f->north;
	int64_t z = f->a.at[2] + s->k;
	struct dem_big more = dem_big_of(rest);
	struct height h = {dem_big_of(whole), dem_big_of(whole)};

	dem_big_times(&h.n, z < 0 ? -(uint64_t)z : (uint64_t)z);
	h.n.negative = z < 0;
	h.n = dem_big_sum(&h.n, &more);
	dem_big_times(&h.n, (uint64_t)s->z.mantissa);
	dem_big_times(&h.n, (uint64_t)s->num);
	dem_big_times(&h.d, (uint64_t)s->den);
	dem_big_ten(s->z.exponent > 0 ? &h.n : &h.d, s->z.exponent > 0 ? s->z.exponent : -s->z.exponent);
	return h;
}

static int compare(const struct height *h, double v)
{
	struct dem_big left = h->n, right = h->d;
	int e;
	int64_t m = (int64_t)ldexp(frexp(v, &e), 53);

	e -= 53;
	dem_big_times(&right, (uint64_t)(m < 0 ? -m : m));
	right.negative = m < 0;
	dem_big_shift(e < 0 ? &left : &right, (unsigned)(e < 0 ? -e : e));
	return dem_big_compare(&left, &right);
}

/* Numbers of floats, in their order. */
static int32_t number_of(float v)
{
	int32_t n;

	memcpy(&n, &v, sizeof(n));
	return n < 0 ? INT32_MIN - n : n;
}

static float float_of(int32_t n)
{
	float v;

	n = n < 0 ? INT32_MIN - n : n;
	memcpy(&v, &n, sizeof(v));
	return v;
}

/* It is one of low to high. */
static float exact(const struct dem_plane *f, int64_t x, int64_t y, float low, float high)
{
	const struct height h = height_at(f, x, y);
	int64_t from = number_of(low), to = number_of(high);

	while (from < to) {
		int64_t middle = from + (to - from) / 2;
		double border = ((double)float_of((int32_t)middle) + float_of((int32_t)(middle + 1))) / 2;
		int side = compare(&h, border);

		if (!side)
			return float_of((int32_t)(middle & 1 ? middle + 1 : middle));
		if (side < 0)
			to = middle;
		else
			from = middle + 1;
	}
	return float_of((int32_t)from);
}

void dem_plane_row(const struct dem_plane *f, int64_t x, int64_t y, uint32_t n, float *ret)
{
	double row = f->at + f->dy * (double)(y - f->y0), slack = f->slack;
	int64_t from = x - f->x0;
	unsigned unsure = 0;

	for (uint32_t i = 0; i < n; i++) {
		double v = row + f->dx * (double)(from + i);
		float low = (float)(v - slack);

		ret[i] = low + 0.0f; /* no negative zero */
		unsure |= low != (float)(v + slack);
	}
	for (uint32_t i = 0; i < n && unsure; i++) {
		double v = row + f->dx * (double)(from + i);
		float low = (float)(v - slack), high = (float)(v + slack);

		if (low != high)
			ret[i] = exact(f, x + i, y, low, high);
	}
}
