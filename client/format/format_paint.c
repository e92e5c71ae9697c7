/*
 * Heights to colours.
 *
 * Hillshade: Lambert's law with the light from azimuth 315, altitude 45, on the surface that the heights of
 * neighbouring pixels span; level ground is 180 of 255. Slopes need both lengths in one unit: units are
 * converted where both are known, a degree of longitude and latitude counts as 111320 m (good enough to look
 * at, never to measure), and unknown units are taken as equal. Elevation: a ramp from the second to the
 * ninety-eighth percentile, so that a few stray points do not flatten it, dimmed by the hillshade. Domains: a
 * hue for each region, likewise dimmed. Lines, if they are asked for, are red. Pixels that no triangle covers are transparent.
 */
#include <math.h>
#include <string.h>

#include "format_dem.h"
#include "format_raster.h"

#define BINS 4096

/* The z that a part `share` of the covered pixels is below. */
static float percentile(const uint64_t bin[BINS], uint64_t n, double share, float low, float high)
{
	uint64_t seen = 0;

	for (unsigned i = 0; i < BINS; i++) {
		seen += bin[i];
		if ((double)seen >= share * (double)n)
			return low + (high - low) * ((float)i + 0.5f) / BINS;
	}
	return high;
}

static void paint_range(struct format_paint *p)
{
	const struct format_raster *r = p->raster;
	size_t n = (size_t)r->w * r->h, covered = 0;
	float low = INFINITY, high = -INFINITY;
	uint64_t bin[BINS] = {0};

	for (size_t i = 0; i < n; i++) {
		if (isnan(r->z[i]))
			continue;
		covered++;
		low = r->z[i] < low ? r->z[i] : low;
		high = r->z[i] > high ? r->z[i] : high;
	}
	if (!covered || !(high > low)) {
		p->low = p->high = covered ? low : 0;
		return;
	}
	for (size_t i = 0; i < n; i++) {
		if (!isnan(r->z[i])) {
			unsigned k = (unsigned)((r->z[i] - low) / (high - low) * BINS);
			bin[k < BINS ? k : BINS - 1]++;
		}
	}
	p->low = percentile(bin, covered, 0.02, low, high);
	p->high = percentile(bin, covered, 0.98, low, high);
}

void format_paint_init(struct format_paint *p, const struct format_raster *r, const struct acut_mesh_head *head,
		       enum format_color color)
{
	struct decimal xy = {1, 0}, z = {1, 0};

	memset(p, 0, sizeof(*p));
	p->raster = r;
	p->color = color;
	decimal_parse(head->scale_xy, &xy);
	decimal_parse(head->scale_z, &z);
	p->cell = r->factor > 0 ? FORMAT_SUBPIXEL / r->factor * decimal_double(xy) : 1;
	p->height = format_dem_steep(head, decimal_double(z));
	if (color == FORMAT_ELEVATION)
		paint_range(p);
}

/* Difference quotient along one axis at pixel i, from the neighbours that are covered. */
static double slope(const struct format_paint *p, size_t i, bool before, bool after, size_t stride)
{
	const float *z = p->raster->z;
	double run = 0, rise = 0;

	if (before && !isnan(z[i - stride])) {
		run += p->cell;
		rise += (double)z[i] - z[i - stride];
	}
	if (after && !isnan(z[i + stride])) {
		run += p->cell;
		rise += (double)z[i + stride] - z[i];
	}
	return run > 0 ? rise * p->height / run : 0;
}

/* 0 to 1; the light is in the north-west, 45 degrees high. */
static double shade(const struct format_paint *p, uint32_t x, uint32_t y)
{
	const struct format_raster *r = p->raster;
	size_t i = (size_t)y * r->w + x;
	double east = slope(p, i, x > 0, x + 1 < r->w, 1);
	double north = -slope(p, i, y > 0, y + 1 < r->h, r->w);
	/* normal (-east, -north, 1); light (-1/2, 1/2, 1/sqrt 2) */
	double s = (0.5 * east - 0.5 * north + M_SQRT1_2) / sqrt(1 + east * east + north * north);

	return s < 0 ? 0 : s;
}

static void hue(double h, double v, uint8_t rgb[3])
{
	for (int i = 0; i < 3; i++) {
		double t = fabs(fmod(h * 6 + (i == 0 ? 3 : i == 1 ? 1 : 5), 6) - 3) - 1;
		t = t < 0 ? 0 : t > 1 ? 1 : t;
		rgb[i] = (uint8_t)lrint(255 * v * (0.35 + 0.65 * t));
	}
}

/* Lowland green over tan and brown to white. */
static void ramp(double t, double v, uint8_t rgb[3])
{
	static const uint8_t stop[][3] = {{34, 102, 60}, {126, 166, 88}, {222, 208, 142}, {168, 118, 78}, {250, 250, 250}};
	unsigned i;

	t = t < 0 ? 0 : t > 1 ? 4 : t * 4;
	i = t >= 4 ? 3 : (unsigned)t;
	for (int j = 0; j < 3; j++) {
		double c = stop[i][j] + (t - i) * (stop[i + 1][j] - stop[i][j]);
		rgb[j] = (uint8_t)lrint(c * v);
	}
}

void format_paint_row(const struct format_paint *p, uint32_t y, uint32_t x0, uint32_t x1, uint8_t *ret)
{
	static const uint8_t line[3] = {200, 30, 30};
	const struct format_raster *r = p->raster;

	for (uint32_t x = x0; x < x1; x++, ret += 4) {
		size_t i = (size_t)y * r->w + x;
		double s, dim;

		if (isnan(r->z[i])) {
			memset(ret, 0, 4);
			continue;
		}
		s = shade(p, x, y);
		dim = fmin(1, 0.45 + 0.55 * s / M_SQRT1_2);
		if (p->color == FORMAT_HILLSHADE)
			ret[0] = ret[1] = ret[2] = (uint8_t)lrint(255 * s);
		else if (p->color == FORMAT_DOMAIN)
			hue((r->domain[i] & 0xffff) / 65536.0, dim, ret);
		else
			ramp(p->high > p->low ? (r->z[i] - p->low) / (p->high - p->low) : 0.5, dim, ret);
		if (r->line && r->line[i])
			memcpy(ret, line, sizeof line);
		ret[3] = 255;
	}
}
