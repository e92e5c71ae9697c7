/*
 * Triangles to pixels, exactly and in bounded memory.
 *
 * Vertices are snapped to 1/256 of a pixel, each by itself, so that triangles that share an edge still share
 * it; then everything is whole numbers. A pixel belongs to the triangle that holds its centre; centres on an
 * edge go to one side by the sign of the edge's direction, as if the centres were moved by an infinitesimal
 * step, so that no two neighbours both take or both leave a pixel. Snapping may turn a thin triangle over:
 * those are left out, and the rest still covers every centre (the signed sum over all of them is one).
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "format_raster.h"

#define S FORMAT_SUBPIXEL
#define RASTER_PIXELS (1u << 26) /* at most */
#define RASTER_HIGH 4            /* at most this many times as high as wide was asked for */

int format_raster_init(struct format_raster *r, const int32_t min[2], const int32_t max[2], uint32_t width, bool domains,
		       bool lines, struct err *err)
{
	double ex = (double)max[0] - min[0], ey = (double)max[1] - min[1], high, pixels;
	size_t n;

	memset(r, 0, sizeof(*r));
	r->min[0] = min[0];
	r->min[1] = min[1];
	high = (double)RASTER_HIGH * width;
	r->factor = ex > 0 ? width / ex : 0;
	if (ey > 0 && (r->factor == 0 || ey * r->factor > high))
		r->factor = high / ey;
	pixels = ex * r->factor * (ey * r->factor);
	if (pixels > RASTER_PIXELS)
		r->factor *= sqrt(RASTER_PIXELS / pixels);
	r->w = ex * r->factor < 1 ? 1 : (uint32_t)(ex * r->factor + 0.5);
	r->h = ey * r->factor < 1 ? 1 : (uint32_t)(ey * r->factor + 0.5);
	r->factor *= S;
	n = (size_t)r->w * r->h;
	r->z = malloc(n * sizeof(*r->z));
	r->domain = domains ? calloc(n, sizeof(*r->domain)) : NULL;
	r->line = lines ? calloc(n, 1) : NULL;
	if (!r->z || (domains && !r->domain) || (lines && !r->line)) {
		format_raster_done(r);
		err_set(err, ERR_NOMEM, "no memory for a picture of %u x %u pixels", r->w, r->h);
		return err_add_hint(err, "give a smaller --width");
	}
	for (size_t i = 0; i < n; i++)
		r->z[i] = NAN;
	return 0;
}

/* Division rounded down and up; d > 0. */
static int64_t div_down(int64_t n, int64_t d)
{
	return n >= 0 ? n / d : -((-n + d - 1) / d);
}

static int64_t div_up(int64_t n, int64_t d)
{
	return -div_down(-n, d);
}

/* Centres of pixels are at 256 i + 128: the first not below, the last not above. */
static int64_t pixel_from(int64_t v)
{
	return (v + S / 2 - 1) >> 8;
}

static int64_t pixel_to(int64_t v)
{
	return (v - S / 2) >> 8;
}

struct corner {
	int64_t x, y;
};

/* Narrows [*from, *to] to the pixels of the row at `y` that lie to the left of the edge a -> b. */
static void narrow(const struct corner *a, const struct corner *b, int64_t y, int64_t *from, int64_t *to)
{
	int64_t dx = b->x - a->x, dy = b->y - a->y, c = dx * (y - a->y), least;

	/* E(x) = c - dy (x - a.x) must be > 0, or >= 0 on edges that take their centres */
	least = dy < 0 || (dy == 0 && dx < 0) ? 0 : 1;
	if (dy == 0) {
		if (c < least)
			*to = *from - 1;
	} else if (dy < 0) {
		int64_t px = pixel_from(a->x + div_up(least - c, -dy));
		*from = px > *from ? px : *from;
	} else {
		int64_t px = pixel_to(a->x + div_down(c - least, dy));
		*to = px < *to ? px : *to;
	}
}

struct plane {
	double z, gx, gy;
	float low, high;
};

/* Height over the snapped triangle, z = z_a + gx (x - a.x) + gy (y - a.y). */
static struct plane plane_of(const struct corner p[3], const int32_t *a, const int32_t *b, const int32_t *c, int64_t area)
{
	double bx = (double)(p[1].x - p[0].x), by = (double)(p[1].y - p[0].y);
	double cx = (double)(p[2].x - p[0].x), cy = (double)(p[2].y - p[0].y);
	double bz = (double)b[2] - a[2], cz = (double)c[2] - a[2];
	struct plane f = {a[2], (bz * cy - cz * by) / (double)area, (cz * bx - bz * cx) / (double)area, 0, 0};
	int32_t low = a[2] < b[2] ? a[2] : b[2], high = a[2] > b[2] ? a[2] : b[2];

	f.low = (float)(low < c[2] ? low : c[2]);
	f.high = (float)(high > c[2] ? high : c[2]);
	return f;
}

static struct corner snap(const struct format_raster *r, const int32_t *v)
{
	return (struct corner){(int64_t)(((double)v[0] - r->min[0]) * r->factor + 0.5),
			       (int64_t)(((double)v[1] - r->min[1]) * r->factor + 0.5)};
}

static int64_t min3(int64_t a, int64_t b, int64_t c)
{
	return a < b ? (a < c ? a : c) : (b < c ? b : c);
}

static int64_t max3(int64_t a, int64_t b, int64_t c)
{
	return a > b ? (a > c ? a : c) : (b > c ? b : c);
}

void format_raster_triangle(struct format_raster *r, const int32_t *a, const int32_t *b, const int32_t *c, uint32_t domain)
{
	const struct corner p[3] = {snap(r, a), snap(r, b), snap(r, c)};
	int64_t left = pixel_from(min3(p[0].x, p[1].x, p[2].x)), right = pixel_to(max3(p[0].x, p[1].x, p[2].x));
	int64_t low = pixel_from(min3(p[0].y, p[1].y, p[2].y)), high = pixel_to(max3(p[0].y, p[1].y, p[2].y));
	int64_t area;
	struct plane f;

	if (left > right || low > high)
		return;
	area = (p[1].x - p[0].x) * (p[2].y - p[0].y) - (p[2].x - p[0].x) * (p[1].y - p[0].y);
	if (area <= 0)
		return;
	left = left < 0 ? 0 : left;
	low = low < 0 ? 0 : low;
	right = right >= r->w ? r->w - 1 : right;
	high = high >= r->h ? r->h - 1 : high;
	f = plane_of(p, a, b, c, area);
	for (int64_t row = low; row <= high; row++) {
		int64_t y = row * S + S / 2, from = left, to = right;
		size_t at = (size_t)(r->h - 1 - row) * r->w;

		for (int i = 0; i < 3; i++)
			narrow(&p[i], &p[i == 2 ? 0 : i + 1], y, &from, &to);
		for (int64_t px = from; px <= to; px++) {
			double z = f.z + f.gx * (double)(px * S + S / 2 - p[0].x) + f.gy * (double)(y - p[0].y);
			float fz = (float)z;
			r->z[at + (size_t)px] = fz < f.low ? f.low : fz > f.high ? f.high : fz;
			if (r->domain)
				r->domain[at + (size_t)px] = domain;
		}
	}
}

void format_raster_line(struct format_raster *r, const int32_t *a, const int32_t *b)
{
	struct corner p = snap(r, a), q = snap(r, b);
	int64_t dx = q.x - p.x, dy = q.y - p.y, steps = (llabs(dx) > llabs(dy) ? llabs(dx) : llabs(dy)) / S + 1;

	for (int64_t i = 0; i <= steps; i++) {
		int64_t x = (p.x + dx * i / steps) / S, y = (p.y + dy * i / steps) / S;

		if (x >= 0 && y >= 0 && x < r->w && y < r->h)
			r->line[(size_t)(r->h - 1 - y) * r->w + (size_t)x] = 1;
	}
}

void format_raster_done(struct format_raster *r)
{
	free(r->z);
	free(r->domain);
	free(r->line);
	memset(r, 0, sizeof(*r));
}
