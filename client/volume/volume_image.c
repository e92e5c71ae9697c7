/*
 * Images of the difference: a GeoTIFF with its values, a PNG with its colours. The room dem draws and keeps the pixels.
 *
 * The range of the colours is that of 98 per cent of the plane that changed, rounded up to 1, 2, 3 or 5 times a power of ten of
 * the unit of the results: one crane does not make all else white.
 *
 * With polygons an image has the pixels whose centres are in one of them, and their box, so that it does not depend on which
 * triangles came, and images of polygons side by side fit each other.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dem.h"
#include "err.h"
#include "format_axis.h"
#include "format_png_file.h"
#include "outfile.h"
#include "volume_priv.h"

enum { IMAGES = 4, OCTAVE = 8, BINS = 64 * OCTAVE }; /* bins of differences from 2^-16 steps on */

struct image {
	const struct volume_image *is;
	struct outfile *out, *world; /* NULL: none */
	struct dem *dem;
	struct volume_images *all;
	/* of the picture that is written */
	struct dem_frame frame;
	struct format_png_file file;
};

struct volume_images {
	struct image image[IMAGES];
	unsigned n;
	const struct volume_options *opt;
	struct dem_options dem;
	int64_t box[4]; /* of the polygons, in absolute parts of the lattice */
	volume_i128 bin[BINS];
	double step; /* of z */
	double range;
};

/* ---- files ---- */

static int open_world(struct image *m, struct err *err)
{
	const char *path = m->is->path, *slash = strrchr(path, '/'), *dot = strrchr(slash ? slash : path, '.');
	char *name;
	int r;

	if (!outfile_base(m->out))
		return 0;
	if (asprintf(&name, "%.*s.pgw", dot ? (int)(dot - path) : (int)strlen(path), path) < 0)
		return err_set(err, ERR_NOMEM, "no memory for images");
	r = outfile_new(name, m->is->no_clobber, &m->world, err);
	free(name);
	return r;
}

/* Of this many lattice steps; `slack`: it may be so much less. */
static int check_size(const struct volume_images *all, const struct volume_frame *f, const double size[2], double slack,
		      struct err *err)
{
	const struct volume_options *opt = all->opt;
	double side =
		decimal_double(opt->cell) * (double)all->dem.cell_num / (double)all->dem.cell_den / decimal_double(f->step[0]);
	double w = size[0] / side, h = size[1] / side;

	for (size_t i = 0; i < opt->nimage; i++) {
		if (opt->image[i].tif ? w / slack / DEM_TILE * (h / slack / DEM_TILE) <= DEM_TILES_MAX :
					w / slack <= DEM_ROW_MOST / 2)
			continue;
		err_set(err, ERR_USAGE, "%s would have %.0f x %.0f pixels, which is too many", opt->image[i].path, w, h);
		return err_add_hint(err, opt->areas ? "give a larger --cell, or smaller polygons" : "give a larger --cell");
	}
	return 0;
}

static int check_areas(struct volume_images *all, const struct volume_frame *f, struct err *err)
{
	const struct ctl_area *a = all->opt->areas;
	int64_t *box = all->box;

	for (size_t i = 0; i < a->ncorner; i++)
		for (int k = 0; k < 2; k++) {
			int64_t at = volume_frame_corner(f, a->corner[i][k]);

			box[k] = !i || at < box[k] ? at : box[k];
			box[2 + k] = !i || at > box[2 + k] ? at : box[2 + k];
		}
	return check_size(all, f,
			  (const double[]){((double)box[2] - (double)box[0]) / DEM_CLIP_PART,
					   ((double)box[3] - (double)box[1]) / DEM_CLIP_PART},
			  1, err);
}

_Static_assert((int)DEM_CLIP_PART == (int)VOLUME_CORNER_PART, "corners have one lattice");

/* What is known of them before the meshes. */
static int check(struct volume_images *all, const struct volume_frame *f, struct err *err)
{
	const struct volume_options *opt = all->opt;
	const char *unit = opt->side[0].unit_xy;
	char scale[DECIMAL_TEXT_SIZE];

	if (opt->nimage > IMAGES)
		return err_set(err, ERR_USAGE, "there are at most %d images of one comparison", IMAGES);
	if (opt->cell.mantissa <= 0) {
		err_set(err, ERR_USAGE, "an image needs the side of a pixel: --cell");
		return err_add_hint(err, "give it in the units of the meshes, or with m, ft or ftUS, as in --cell 1m");
	}
	all->dem = (struct dem_options){.kind = DEM_DIFFERENCE,
					.cell = opt->cell,
					.cell_num = 1,
					.cell_den = 1,
					.z_num = 1,
					.z_den = 1,
					.steep = 1,
					.cache = opt->nimage > 1 ? DEM_CACHE / (unsigned)opt->nimage : 0,
					.interrupted = opt->interrupted,
					.ctx = opt->ctx};
	if (opt->cell_unit && !format_unit_ratio(opt->cell_unit, unit, &all->dem.cell_num, &all->dem.cell_den))
		return err_set(err, ERR_USAGE, "--cell is in %s, but the unit of x and y is %.30s", opt->cell_unit,
			       unit && *unit ? unit : "unknown");
	if (dem_check_cell(decimal_text(f->step[0], scale), &all->dem, err))
		return -(int)err->code;
	return opt->areas ? check_areas(all, f, err) : 0;
}

int volume_images_new(const struct volume_options *opt, const struct volume_frame *f, struct volume_images **ret, struct err *err)
{
	struct volume_images *all = calloc(1, sizeof(*all));
	int r = 0;

	if (!all)
		return err_set(err, ERR_NOMEM, "no memory for images");
	all->opt = opt;
	if (opt->nimage)
		r = check(all, f, err);
	for (size_t i = 0; i < opt->nimage && !r; i++) {
		struct image *m = &all->image[all->n++];

		m->is = &opt->image[i];
		m->all = all;
		r = outfile_new(m->is->path, m->is->no_clobber, &m->out, err);
		if (!r)
			r = dem_new(m->out, &m->dem, err);
		if (!r && !m->is->tif)
			r = open_world(m, err);
	}
	if (r)
		volume_images_free(all);
	else
		*ret = all;
	return r;
}

struct volume_images *volume_images_free(struct volume_images *all)
{
	for (unsigned i = 0; all && i < all->n; i++) {
		struct image *m = &all->image[i];

		format_png_done(&m->file);
		dem_free(m->dem);
		outfile_free(m->out);
		outfile_free(m->world);
	}
	free(all);
	return NULL;
}

const struct outfile *volume_images_file(const struct volume_images *all)
{
	return all->n ? all->image[0].out : NULL;
}

/* ---- pixels ---- */

/* Those of the polygons' box, so that images of polygons side by side fit each other whatever the meshes have there. */
static int areas_box(const struct volume_images *all, const struct volume_frame *f, int32_t box[6], struct err *err)
{
	for (int i = 0; i < 4; i++) {
		volume_i128 at = (volume_i128)all->box[i] - (volume_i128)f->k[i % 2] * DEM_CLIP_PART, down = at / DEM_CLIP_PART;

		down -= down * DEM_CLIP_PART > at;
		down += i > 1 && down * DEM_CLIP_PART < at;
		if (down < INT32_MIN || down > INT32_MAX) {
			err_set(err, ERR_USAGE, "the polygons reach too far out for an image on the lattice of the mesh");
			return err_add_hint(err, "give its corners in the coordinates of the mesh");
		}
		box[i < 2 ? i : i + 1] = (int32_t)down;
	}
	return 0;
}

static int clip(const struct volume_images *all, struct dem *d, const struct volume_frame *f, struct err *err)
{
	const struct ctl_area *a = all->opt->areas;
	int r = 0;

	for (size_t i = 0; i < a->nring && !r; i++) {
		r = dem_clip_ring(d, a->ring[i].shell, err);
		for (size_t k = 0; k < ctl_area_corners(a, i) && !r; k++) {
			const struct decimal *at = a->corner[a->ring[i].first + k];

			r = dem_clip_corner(d, volume_frame_corner(f, at[0]), volume_frame_corner(f, at[1]), err);
		}
	}
	return r ? r : dem_clip_end(d, err);
}

int volume_images_head(struct volume_images *all, const struct volume_frame *f, const struct acut_mesh_head *of, struct err *err)
{
	char scale_xy[DECIMAL_TEXT_SIZE], scale_z[DECIMAL_TEXT_SIZE];
	struct acut_mesh_head head = *of;
	struct dem_options to = all->dem;
	int r = 0;

	to.unit_xy = of->unit_xy;
	to.unit_z = of->unit_z;
	head.scale_xy = decimal_text(f->step[0], scale_xy);
	head.scale_z = decimal_text(f->step[1], scale_z);
	head.view = "";
	memcpy(head.k, f->k, sizeof(head.k));
	if (all->opt->has_level)
		to.less = ((double)f->level + f->level_part) * decimal_double(f->step[1]);
	for (int i = 0; i < 2 && !r; i++)
		if (!volume_frame_point(f, 0, of->box + 3 * i, head.box + 3 * i))
			r = err_set(err, ERR_LIMIT, "the mesh does not fit the common lattice");
	if (!r && all->n && all->opt->areas)
		r = areas_box(all, f, head.box, err);
	all->step = decimal_double(f->step[1]);
	for (unsigned i = 0; i < all->n && !r; i++) {
		r = dem_head(all->image[i].dem, &head, &to, err);
		if (!r && all->opt->areas)
			r = clip(all, all->image[i].dem, f, err);
		if (!r)
			r = dem_describe(all->image[i].dem, "acut-volume difference of heights: fill above 0, cut below 0", err);
	}
	return r;
}

static void count(struct volume_images *all, const struct volume_polygon *p, volume_i128 area)
{
	double most = 0;
	int bin;

	for (unsigned i = 0; i < p->n; i++)
		most = fmax(most, fabs(p->f[i]));
	if (!most || area <= 0)
		return;
	bin = (int)ceil((log2(most) + 16) * OCTAVE);
	bin = bin < 0 ? 0 : bin >= BINS ? BINS - 1 : bin;
	all->bin[bin] += area;
}

int volume_images_check(const struct volume_images *all, const struct volume_frame *f, const int32_t box[6], double slack,
			struct err *err)
{
	double size[2];

	if (!all->n || all->opt->areas) /* else it is known already */
		return 0;
	for (int k = 0; k < 2; k++)
		size[k] = (double)box[3 + k] - box[k];
	return check_size(all, f, size, slack, err);
}

int volume_images_pair(struct volume_images *all, const struct volume_triangle *a, const struct volume_triangle *b,
		       const struct volume_polygon *p, volume_i128 area, struct err *err)
{
	int r = 0;

	if (all->n)
		count(all, p, area);
	for (unsigned i = 0; i < all->n && !r; i++)
		r = dem_difference(all->image[i].dem, a->at, b->at, err);
	return r;
}

/* ---- colours ---- */

static double nice(double v)
{
	double ten = pow(10, floor(log10(v) + 1e-9)), of = v / ten;

	return (of <= 1.0001 ? 1 : of <= 2.0001 ? 2 : of <= 3.0001 ? 3 : of <= 5.0001 ? 5 : 10) * ten;
}

/* In units of z; round in those that are printed, of which `unit` are in one. */
static double range_of(const struct volume_images *all, double unit)
{
	volume_i128 sum = 0, below = 0;
	int i;

	for (i = 0; i < BINS; i++)
		sum += all->bin[i];
	if (!sum)
		return nice(all->step * unit);
	for (i = 0; i < BINS && below < sum / 100 * 98; i++)
		below += all->bin[i];
	return nice(exp2((double)i / OCTAVE - 16) * all->step * unit);
}

/* White at none, blue where it was filled, red where it was cut; paler colours between. */
static void color(void *ctx, float value, uint8_t ret[3])
{
	static const double stop[2][3][3] = {{{255, 255, 255}, {146, 197, 222}, {5, 48, 97}},
					     {{255, 255, 255}, {244, 165, 130}, {103, 0, 31}}};
	const struct image *m = ctx;
	double at = fmin(fabs((double)value) / m->all->range, 1) * 2;
	int i = at >= 1;

	for (int k = 0; k < 3; k++) {
		double from = stop[value < 0][i][k], to = stop[value < 0][i + 1][k];

		ret[k] = (uint8_t)rint(from + (at - i) * (to - from));
	}
}

/* ---- the picture ---- */

static int begin(void *ctx, const struct dem_frame *frame, struct err *err)
{
	struct image *m = ctx;

	m->frame = *frame;
	return format_png_begin(&m->file, m->out, frame->width, frame->height, true, err);
}

static int put_row(void *ctx, const uint8_t *row, struct err *err)
{
	return format_png_row(&((struct image *)ctx)->file, row, err);
}

static int end(void *ctx, struct err *err)
{
	return format_png_end(&((struct image *)ctx)->file, err);
}

static int put_world(struct image *m, struct err *err)
{
	char text[256];
	int n = snprintf(text, sizeof(text), "%.17g\n0\n0\n%.17g\n%.17g\n%.17g\n", m->frame.side, -m->frame.side, m->frame.left,
			 m->frame.top);
	int r = outfile_write(m->world, text, (size_t)n, err);

	return r ? r : outfile_publish(m->world, err);
}

int volume_images_finish(struct volume_images *all, const struct volume_frame *f, const int32_t common[6], double unit,
			 double *ret_range, struct err *err)
{
	double range = range_of(all, unit);
	const int32_t *box = common;
	int32_t areas[6] = {0};
	int r = 0;

	all->range = range / unit;
	*ret_range = 0;
	if (all->n && all->opt->areas) {
		r = areas_box(all, f, areas, err);
		box = areas;
	}
	for (unsigned i = 0; i < all->n && !r; i++) {
		struct image *m = &all->image[i];
		const struct dem_rows rows = {begin, put_row, end, m, color};

		r = m->is->tif ? dem_finish(m->dem, box, err) : dem_finish_rows(m->dem, box, &rows, err);
		m->dem = dem_free(m->dem);
		if (!m->is->tif)
			*ret_range = range;
	}
	for (unsigned i = 0; i < all->n && !r; i++) {
		if (all->image[i].world)
			r = put_world(&all->image[i], err);
		if (!r)
			r = outfile_publish(all->image[i].out, err);
	}
	return r;
}
