/*
 * The step from a file's numbers to the lattice's, where it is not a map of numbers (crs_geo.h): degrees to a
 * zone's metres, and heights above or below a geoid.
 *
 * Model: three functions of two variables, each in cells of a raster that is fixed once and for all
 * (crs_cells.h): zone metres of longitude and latitude (cells of 1/4 degree), place of plane coordinates (cells
 * of about 33 km), and geoid height (cells of the grid itself, in which GeographicLib's answer is a cubic). So
 * a point's result depends on that point alone. Axes that nothing changes go through lattice_map, exactly.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "crs_cells.h"
#include "crs_geo.h"
#include "crs_geo_parts.h"
#include "err.h"

enum { LAT_CELLS = 4, PLANE_CELL = 32768 };
#define POLAR 80.0      /* beyond, meridians run together: places are not interpolated */
#define SCALE_FINEST -4 /* of projected metres, power of ten */
#define SCALE_HEIGHT -3

struct crs_step {
	struct crs_system from, to;
	bool project; /* degrees to a zone */
	struct crs_zone zone;
	struct crs_geo *plane; /* of `to` if project, else of `from` */
	struct crs_geoid *geoid;
	double sign, metre_z; /* what a geoid height adds to z: sign * N / metre_z */
	struct lattice lattice;
	struct lattice_map map; /* of the axes that nothing changes; the others are zeros */
	double scale[3], offset[3], to_scale[3];
	struct crs_cells forward, place, height;
	struct crs_shift shift;
};

size_t crs_step_bytes(void)
{
	return sizeof(struct crs_step) + CRS_GEOID_BYTES + 16 * 1024;
}

/* ---- the functions ---- */

static int forward_fn(void *ctx, double dlon, double lat, double ret[2], struct err *err)
{
	struct crs_step *s = ctx;
	double lon = s->to.lon0 + dlon;

	lon = lon < -180 ? lon + 360 : lon;
	return crs_geo_forward(s->plane, lat, lon, &ret[0], &ret[1], err);
}

static int place_fn(void *ctx, double x, double y, double ret[2], struct err *err)
{
	struct crs_step *s = ctx;

	return crs_geo_reverse(s->plane, x, y, &ret[1], &ret[0], err);
}

/* GeographicLib's cells count from the north: of two cells, a place on their border is in the southern one. */
static int height_fn(void *ctx, double lon, double south, double ret[2], struct err *err)
{
	struct crs_step *s = ctx;

	ret[1] = 0;
	return crs_geoid_height(s->geoid, -south, lon, &ret[0], err);
}

/* Latitudes near the poles, and a cell across 180 degrees, are no smooth function of the plane. */
static bool place_smooth(const double node[CRS_CELL_NODES][2])
{
	double least = INFINITY, most = -INFINITY;

	for (unsigned i = 0; i < CRS_CELL_NODES; i++) {
		if (fabs(node[i][1]) > POLAR)
			return false;
		least = fmin(least, node[i][0]);
		most = fmax(most, node[i][0]);
	}
	return most - least < 90;
}

/* ---- new ---- */

static int project_init(struct crs_step *s, const struct crs_step_params *p, struct err *err)
{
	int r = crs_zone_datum(p->from, err);

	if (r)
		return r;
	if (!crs_zone_of_text(p->from, p->to->text, &s->zone)) {
		err_set(err, ERR_UNSUPPORTED,
			"degrees of %.100s cannot be brought to the plane %.100s: it is no UTM or "
			"UPS zone of their datum",
			p->from->text, p->to->text);
		return err_add_hint(err, "project the file first, or use a dataset of its own");
	}
	s->to = p->to->system;
	s->forward = (struct crs_cells){
		.fn = forward_fn,
		.ctx = s,
		.outputs = 2,
		.per_unit = {LAT_CELLS, LAT_CELLS},
		.top = 90 * LAT_CELLS,
	};
	return crs_geo_new(&s->to, &s->plane, err);
}

static int geoid_init(struct crs_step *s, const struct crs_step_params *p, struct err *err)
{
	unsigned width, height;
	int r;

	if (!(s->from.unit_z > 0)) {
		err_set(err, ERR_UNSUPPORTED, "a geoid needs the unit of the heights, and that is not known");
		return err_add_hint(err, "say it with --assume-units, as in --assume-units ,m which is of z alone");
	}
	if (!s->project && (r = crs_geo_new(&s->from, &s->plane, err))) {
		err_add_hint(err, "a geoid needs the place on the earth: say the system with %s",
			     strcmp(p->from->text, "unknown") ? "--override-crs" : "--assume-crs");
		return r;
	}
	r = crs_geoid_open(p->geoid_path, &s->geoid, err);
	if (!r)
		r = crs_geoid_size(p->geoid_path, &width, &height, err);
	if (r)
		return r;
	s->sign = p->way == CRS_TO_ELLIPSOIDAL ? 1 : -1;
	s->metre_z = s->from.unit_z;
	s->height = (struct crs_cells){
		.fn = height_fn,
		.ctx = s,
		.outputs = 1,
		.per_unit = {width / 360.0, (height - 1) / 180.0},
		.top = (height - 1) / 2,
	};
	s->place = (struct crs_cells){
		.fn = place_fn,
		.smooth = place_smooth,
		.ctx = s,
		.outputs = 2,
		.per_unit = {s->from.unit / PLANE_CELL, s->from.unit / PLANE_CELL},
		.top = INT64_MAX / 2,
	};
	return 0;
}

/* The axes that nothing changes; the others become zeros, which always fit. */
static int map_init(struct crs_step *s, const struct crs_step_params *p, struct err *err)
{
	struct lattice_input in = *p->coords;
	int r;

	for (int i = 0; i < 3; i++) {
		bool changed = i < 2 ? s->project : s->geoid != NULL;
		struct decimal zero = {0, 0};

		s->scale[i] = decimal_double(in.scale[i]);
		s->offset[i] = in.has_offset ? decimal_double(in.offset[i]) : 0;
		s->to_scale[i] = decimal_double(i < 2 ? s->lattice.scale_xy : s->lattice.scale_z);
		if (changed) {
			in.scale[i] = i < 2 ? s->lattice.scale_xy : s->lattice.scale_z;
			in.offset[i] = zero;
		}
	}
	r = lattice_map_init(&s->map, &s->lattice, &in, err);
	for (int i = 0; !r && i < 3; i++)
		if (i < 2 ? s->project : s->geoid != NULL) {
			s->map.axis[i].a = s->map.axis[i].b = 0;
			s->map.axis[i].d = 1;
			s->map.axis[i].exact = true;
		}
	return r;
}

int crs_step_new(const struct crs_step_params *p, struct crs_step **ret, struct err *err)
{
	struct crs_step *s = calloc(1, sizeof *s);
	int r = 0;

	if (!s)
		return err_set(err, ERR_NOMEM, "no memory to project points");
	s->from = p->from->system;
	s->lattice = *p->lattice;
	s->project = p->to && p->from->plane == CRS_PLANE_GEOGRAPHIC && strcmp(p->from->text, p->to->text);
	if (s->project)
		r = project_init(s, p, err);
	if (!r && p->geoid_path)
		r = geoid_init(s, p, err);
	if (!r)
		r = map_init(s, p, err);
	if (r) {
		crs_step_free(s);
		return r;
	}
	*ret = s;
	return 0;
}

struct crs_step *crs_step_free(struct crs_step *s)
{
	if (!s)
		return NULL;
	crs_geo_free(s->plane);
	crs_geoid_close(s->geoid);
	free(s);
	return NULL;
}

/* ---- points ---- */

static int beyond(const struct crs_step *s, double lat, double lon, struct err *err)
{
	char zone[8];

	crs_zone_text(s->zone, zone);
	if (s->zone.number)
		err_set(err, ERR_INPUT, "latitude %.10g, longitude %.10g lies more than %d degrees from the meridian of zone %s",
			lat, lon, CRS_ZONE_UTM_DEGREES, zone);
	else
		err_set(err, ERR_INPUT, "latitude %.10g, longitude %.10g lies outside of %s, which begins at %d degrees", lat,
			lon, zone, CRS_ZONE_UPS_LATITUDE);
	return err_add_hint(err, "choose the zone with --utm, or use a dataset of its own");
}

static int no_place(double lat, double lon, struct err *err)
{
	err_set(err, ERR_INPUT, "x %.10g, y %.10g is no longitude and latitude", lon, lat);
	return err_add_hint(err, fabs(lon) <= 90 && lat >= -180 && lat <= 360 ?
					 "x must be the longitude and y the latitude: they seem to be swapped" :
					 "name its real coordinate system with --override-crs, or take x and y as they are "
					 "with --planar");
}

static bool zone_carries(const struct crs_step *s, double lat, double dlon)
{
	if (s->zone.number)
		return fabs(dlon) <= CRS_ZONE_UTM_DEGREES;
	return (s->zone.north ? lat : -lat) >= CRS_ZONE_UPS_LATITUDE;
}

static int project_one(struct crs_step *s, double lat, double lon, double ret[2], struct err *err)
{
	double d = lon - s->to.lon0;

	if (!(fabs(lat) <= 90) || !(lon >= -180 && lon <= 360))
		return no_place(lat, lon, err);
	d = d > 180 ? d - 360 : d < -180 ? d + 360 : d;
	if (!zone_carries(s, lat, d))
		return beyond(s, lat, lon, err);
	return crs_cells_at(&s->forward, d, lat, ret, err);
}

/* The geoid's shift of the height there, in metres. */
static int shift_one(struct crs_step *s, double lat, double lon, double *ret, struct err *err)
{
	double n[2];
	int r;

	lon = lon > 180 ? lon - 360 : lon < -180 ? lon + 360 : lon;
	r = crs_cells_at(&s->height, lon, -lat, n, err);
	if (!r)
		*ret = s->sign * n[0];
	return r;
}

static int place_one(struct crs_step *s, double x, double y, double *ret_lat, double *ret_lon, struct err *err)
{
	double place[2];
	int r;

	if (s->from.method == CRS_METHOD_GEOGRAPHIC) {
		if (!(fabs(y) <= 90) || !(x >= -180 && x <= 360))
			return no_place(y, x, err);
		*ret_lat = y;
		*ret_lon = x;
		return 0;
	}
	/* Beyond what any plane holds: not to be put into a cell's number. */
	if (fabs(x) * s->from.unit > 1e9 || fabs(y) * s->from.unit > 1e9)
		return err_set(err, ERR_INPUT, "x %.10g, y %.10g is no place on the earth", x, y);
	r = crs_cells_at(&s->place, x, y, place, err);
	if (!r) {
		*ret_lat = fmin(fmax(place[1], -90), 90);
		*ret_lon = place[0];
	}
	return r;
}

static int to_lattice(const struct crs_step *s, unsigned axis, double v, int32_t *ret, struct err *err)
{
	double n = floor(v / s->to_scale[axis] - (double)s->lattice.k[axis] + 0.5);

	if (!(n >= INT32_MIN && n <= INT32_MAX)) {
		err_set(err, ERR_LIMIT, "%c of a point lies %.6g beyond the middle of the lattice, which reaches %.6g",
			"xyz"[axis], n * s -> to_scale[axis], 0x1p31 * s -> to_scale[axis]);
		return err_add_hint(err, "use a coarser --scale, a dataset of its own, or mend the file");
	}
	*ret = (int32_t)n;
	return 0;
}

static void shift_note(struct crs_shift *s, double metres)
{
	if (!s->n || metres < s->min)
		s->min = metres;
	if (!s->n || metres > s->max)
		s->max = metres;
	s->sum_um += llround(metres * 1e6);
	s->n++;
}

static int apply_one(struct crs_step *s, const int64_t raw[3], int32_t ret[3], struct err *err)
{
	double at[3], xy[2], lat = 0, lon = 0, shift;
	int r = 0;

	for (int i = 0; i < 3; i++)
		at[i] = (double)raw[i] * s->scale[i] + s->offset[i];
	if (s->project) {
		lat = at[1];
		lon = at[0];
		r = project_one(s, lat, lon, xy, err);
		for (unsigned i = 0; !r && i < 2; i++)
			r = to_lattice(s, i, xy[i], &ret[i], err);
	} else {
		r = place_one(s, at[0], at[1], &lat, &lon, err);
	}
	if (r || !s->geoid)
		return r;
	r = shift_one(s, lat, lon, &shift, err);
	if (!r)
		r = to_lattice(s, 2, at[2] + shift / s->metre_z, &ret[2], err);
	if (!r)
		shift_note(&s->shift, shift);
	return r;
}

int crs_step_apply(struct crs_step *s, const int64_t (*raw)[3], size_t n, int32_t (*ret)[3], size_t *ret_bad, struct err *err)
{
	uint64_t moved = 0;
	double most[3] = {0};
	int r = 0;

	if (!s->project || !s->geoid)
		r = n ? lattice_map_apply(&s->map, raw, n, ret, &moved, most, ret_bad, err) : 0;
	if (!s->project && !s->geoid)
		return r;
	for (size_t i = 0; !r && i < n; i++) {
		r = apply_one(s, raw[i], ret[i], err);
		if (r)
			*ret_bad = i;
	}
	return r;
}

struct crs_shift crs_step_shift(const struct crs_step *s)
{
	return s->shift;
}

void crs_shift_add(struct crs_shift *sum, const struct crs_shift *part)
{
	if (!part->n)
		return;
	if (!sum->n || part->min < sum->min)
		sum->min = part->min;
	if (!sum->n || part->max > sum->max)
		sum->max = part->max;
	sum->sum_um += part->sum_um;
	sum->n += part->n;
}

/* ---- what a file's header becomes ---- */

/* The box of a box of degrees: its rim and inside at a raster of places, drawn into what the zone carries. A
 * header may lie, so this decides only where the lattice's zero is. */
static int project_box(struct crs_step *s, const struct lattice_input *in, struct lattice_input *out, struct err *err)
{
	enum { STEPS = 16 };
	double least = s->zone.number ? -90 : s->zone.north ? CRS_ZONE_UPS_LATITUDE : -90;
	double most = s->zone.number ? 90 : s->zone.north ? 90 : -CRS_ZONE_UPS_LATITUDE;

	for (int k = 0; k < 2; k++) {
		out->min[k] = INFINITY;
		out->max[k] = -INFINITY;
	}
	for (int i = 0; i <= STEPS; i++) {
		double lon = in->min[0] + (in->max[0] - in->min[0]) * i / STEPS, d = crs_geo_angle(s->to.lon0, lon);

		if (s->zone.number)
			d = fmin(fmax(d, -CRS_ZONE_UTM_DEGREES), CRS_ZONE_UTM_DEGREES);
		for (int j = 0; j <= STEPS; j++) {
			double lat = in->min[1] + (in->max[1] - in->min[1]) * j / STEPS, xy[2];
			int r = forward_fn(s, d, fmin(fmax(lat, least), most), xy, err);

			if (r)
				return r;
			for (int k = 0; k < 2; k++) {
				out->min[k] = fmin(out->min[k], xy[k]);
				out->max[k] = fmax(out->max[k], xy[k]);
			}
		}
	}
	return 0;
}

static struct decimal scale_of_degrees(struct decimal scale)
{
	int e = (int)floor(log10(decimal_double(scale) * 111e3)) - 1;

	return (struct decimal){1, e < SCALE_FINEST ? SCALE_FINEST : e > -2 ? -2 : e};
}

static int coords_of_degrees(struct crs_step *s, const struct crs_step_params *p, struct lattice_input *out, struct err *err)
{
	const struct lattice_input *in = p->coords;
	bool good = true;
	struct crs_zone any;
	int k, r = project_init(s, p, err);

	for (k = 0; k < 2; k++) {
		out->scale[k] = scale_of_degrees(in->scale[k]);
		out->coarsest[k] = (struct decimal){0, 0};
		out->rounds[k] = false;
		good = good && isfinite(in->min[k]) && isfinite(in->max[k]) && in->min[k] <= in->max[k];
		out->min[k] = out->max[k] = NAN;
	}
	out->has_offset = false;
	if (!r && good) {
		/* Degrees at all? */
		r = crs_zone_choose(in, 1, &any, err);
		if (!r)
			r = project_box(s, in, out, err);
	}
	s->plane = crs_geo_free(s->plane);
	return r;
}

int crs_step_coords(const struct crs_step_params *p, struct lattice_input *ret, struct err *err)
{
	struct lattice_input out = *p->coords;
	const struct decimal finest = {1, SCALE_HEIGHT};
	int r = 0;

	if (p->to && p->from->plane == CRS_PLANE_GEOGRAPHIC && strcmp(p->from->text, p->to->text)) {
		struct crs_step *s = calloc(1, sizeof *s);

		if (!s)
			return err_set(err, ERR_NOMEM, "no memory to project a box");
		r = coords_of_degrees(s, p, &out, err);
		crs_step_free(s);
	}
	if (r)
		return r;
	if (p->geoid_path && decimal_compare(out.scale[2], finest) > 0)
		out.scale[2] = finest;
	*ret = out;
	return 0;
}
