/*
 * Where the pixels are on the lattice.
 *
 * The grid is that of all multiples of the cell: neighbouring rasters of one cell fit, and a window has the pixels of the whole.
 * The side of a pixel over the lattice's scale is a fraction p / q in lowest terms, so everything times 2q is whole numbers.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dem_priv.h"
#include "err.h"
#include "wide.h"

#define LATTICE_MOST ((dem_i128)1 << 62)
#define Q_MOST (1 << 20)       /* so that the numbers of one triangle fit 127 bits (dem_plane.c) */
#define P_MOST (1ll << 58)     /* and its places 61 */
#define PIXEL_MOST (1ll << 52) /* absolute numbers of pixels are exact as doubles */

static void reduce(dem_i128 *p, dem_i128 *q)
{
	dem_i128 g = wide_gcd(*p, *q);

	*p /= g;
	*q /= g;
}

/* cell * num / den / scale; false: it does not fit. */
static bool ratio(const struct dem_options *o, struct decimal scale, int64_t *ret_p, int64_t *ret_q)
{
	dem_i128 p = (dem_i128)o->cell.mantissa * o->cell_num, q = (dem_i128)scale.mantissa * o->cell_den;
	int e = o->cell.exponent - scale.exponent;

	reduce(&p, &q);
	for (; e && p < (dem_i128)1 << 120 && q<(dem_i128)1 << 120; e -= e> 0 ? 1 : -1) {
		*(e > 0 ? &p : &q) *= 10;
		reduce(&p, &q);
	}
	*ret_p = (int64_t)p;
	*ret_q = (int64_t)q;
	return !e && p < P_MOST && q < Q_MOST;
}

/* The pixel that has this lattice number; its first one if it is on a border. */
static dem_i128 pixel_of(const struct dem_grid *g, dem_i128 number)
{
	return wide_floor(number * g->q, g->p);
}

static int64_t into(dem_i128 v, int64_t most)
{
	return v < -1 ? -1 : v > most ? most : (int64_t)v;
}

/* A centre on the border of the box is drawn if it is inside when it is moved a little to the east and, much less, to the south,
 * as with edges of triangles: boxes side by side share no pixel. */
void dem_grid_clip(struct dem_grid *g, const int64_t box[4])
{
	for (int i = 0; i < 2; i++) {
		dem_i128 side = (dem_i128)g->p * g->part, d = 2 * side;
		dem_i128 low = 2 * (dem_i128)g->q * box[i] - side, high = 2 * (dem_i128)g->q * box[i + 2] - side;
		dem_i128 from = i ? wide_floor(low, d) + 1 : -wide_floor(-low, d);
		dem_i128 to = i ? wide_floor(high, d) : -wide_floor(-high, d) - 1;

		from -= g->first[i];
		to -= g->first[i];
		g->clip[i][0] = from > 0 ? into(from, g->count[i]) : 0;
		g->clip[i][1] = into(to, g->count[i] - 1);
	}
}

/* Pixels of the window "box:X1,Y1,X2,Y2" (absolute lattice numbers), or of the box of its polygons. */
static int clip_window(struct dem_grid *g, const char *view, struct err *err)
{
	const char *at = strstr(view ? view : "", " window=");
	long long n[4];
	int64_t b[4];

	for (int i = 0; i < 2; i++) {
		g->clip[i][0] = 0;
		g->clip[i][1] = g->count[i] - 1;
	}
	if (!at)
		return 0;
	if (!strncmp(at, " window=area:", 13)) {
		if (dem_clip_init(g, at + 13, b, err))
			return -(int)err->code;
	} else if (sscanf(at, " window=box:%lld,%lld,%lld,%lld", &n[0], &n[1], &n[2], &n[3]) == 4) {
		for (int i = 0; i < 4; i++)
			b[i] = n[i];
	} else {
		return err_set(err, ERR_PROTO, "the window of the stream's view is none");
	}
	dem_grid_clip(g, b);
	return 0;
}

static int init_ratio(struct dem_grid *g, const char *scale_xy, const struct dem_options *opt, struct err *err)
{
	if (!decimal_parse(scale_xy, &g->scale) || g->scale.mantissa <= 0 || abs(g->scale.exponent) > 40)
		return err_set(err, ERR_PROTO, "the stream's xy scale is not a number above zero");
	if (opt->cell.mantissa <= 0)
		return err_set(err, ERR_USAGE, "--cell is not a length above zero");
	if (ratio(opt, g->scale, &g->p, &g->q))
		return 0;
	err_set(err, ERR_USAGE, "--cell is too large, or has too many digits beside the scale %s", scale_xy);
	return err_add_hint(err, "give --cell with fewer digits, or a multiple of the scale");
}

int dem_check_cell(const char *scale_xy, const struct dem_options *opt, struct err *err)
{
	struct dem_grid g;

	return init_ratio(&g, scale_xy, opt, err);
}

int dem_grid_init(struct dem_grid *g, const struct acut_mesh_head *head, const struct dem_options *opt, struct err *err)
{
	memset(g, 0, sizeof(*g));
	g->part = 1;
	if (init_ratio(g, head->scale_xy, opt, err))
		return -(int)err->code;
	for (int i = 0; i < 2; i++) {
		dem_i128 low = (dem_i128)head->box[i] + head->k[i], high = (dem_i128)head->box[i + 3] + head->k[i], first, last;

		if (low < -LATTICE_MOST || high > LATTICE_MOST || low > high)
			return err_set(err, ERR_PROTO, "the stream's box is none");
		first = pixel_of(g, low);
		last = pixel_of(g, high);
		if (first < -PIXEL_MOST || last > PIXEL_MOST || last - first > 1ll << 39) {
			err_set(err, ERR_USAGE, "--cell is too small: the numbers of the pixels are too large");
			return err_add_hint(err, "give a larger --cell");
		}
		g->base[i] = head->box[i];
		g->zero[i] = head->k[i];
		g->first[i] = (int64_t)first;
		g->count[i] = (int64_t)(last - first) + 1;
		g->off[i] = (int64_t)(2 * (dem_i128)g->q * low - (2 * first + 1) * g->p);
	}
	return clip_window(g, head->view, err);
}

struct dem_rect dem_grid_rect(const struct dem_grid *g, const int32_t box[6])
{
	int64_t from[2] = {0, 0}, to[2] = {0, 0};

	for (int i = 0; i < 2 && box; i++) {
		/* low borders of pixels are at odd multiples of p before centre 0 */
		from[i] = dem_div_down((dem_i128)dem_place(g, i, box[i]) + g->p, 2 * (dem_i128)g->p);
		to[i] = dem_div_up((dem_i128)dem_place(g, i, box[i + 3]) + g->p, 2 * (dem_i128)g->p) - 1;
		from[i] = from[i] < g->clip[i][0] ? g->clip[i][0] : from[i];
		to[i] = to[i] > g->clip[i][1] ? g->clip[i][1] : to[i];
		from[i] = from[i] > g->count[i] - 1 ? g->count[i] - 1 : from[i];
		to[i] = to[i] < from[i] ? from[i] : to[i];
	}
	return (struct dem_rect){from[0], from[1], (uint64_t)(to[0] - from[0]) + 1, (uint64_t)(to[1] - from[1]) + 1};
}

double dem_grid_side(const struct dem_grid *g)
{
	return dem_big_double((dem_i128)g->p * g->scale.mantissa, g->scale.exponent, (uint64_t)g->q);
}

/* Half pixels from absolute 0, as a coordinate. */
static double coordinate(const struct dem_grid *g, dem_i128 halves)
{
	/* below 2^55 times p below 2^58; the scale's digits come apart so that all fits */
	struct decimal s = g->scale;
	dem_i128 n = halves * g->p;

	if (s.mantissa == 1)
		return dem_big_double(n, s.exponent, 2 * (uint64_t)g->q);
	if (n > -((dem_i128)1 << 63) && n < (dem_i128)1 << 63)
		return dem_big_double(n * s.mantissa, s.exponent, 2 * (uint64_t)g->q);
	return dem_big_double(n, s.exponent, 2 * (uint64_t)g->q) * (double)s.mantissa;
}

double dem_grid_line(const struct dem_grid *g, int axis, int64_t local)
{
	return coordinate(g, 2 * (dem_i128)(g->first[axis] + local));
}

double dem_grid_centre(const struct dem_grid *g, int axis, int64_t local)
{
	return coordinate(g, 2 * (dem_i128)(g->first[axis] + local) + 1);
}
