/*
 * Poses to the plane of the points: positions by GeographicLib; headings by the direction of a northward step in the
 * plane (a finite difference of the projection: the meridian convergence for any projection); lengths unscaled, or
 * scaled like that step. Datum shifts are not supported.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "crs_geo.h"
#include "err.h"
#include "pose_parts.h"

#define DEGREE (3.14159265358979323846 / 180)
#define STEP 1e-5 /* degrees: 1.1 m; the rounding of the projection changes the direction by at most 1e-8 degrees */

enum { ELLIPSOID_WGS84 = 5030, ELLIPSOID_GRS80 = 5019 }; /* GeoTIFF codes of heights above these ellipsoids */

/* ---- the plane ---- */

static int same_datum(const struct crs_info *from, const struct crs_info *to, bool said, struct err *err)
{
	const char *mine = *from->system.datum ? from->system.datum : from->text;
	const char *theirs = *to->system.datum ? to->system.datum : to->text;

	if (from->system.a == to->system.a && !strcmp(from->system.datum, to->system.datum))
		return 0;
	err_set(err, ERR_UNSUPPORTED,
		"the degrees are of %.60s%s, the plane %.100s stands on %.60s: no shift between datums is known", mine,
		said ? "" : " (nothing else was said)", to->text, theirs);
	return err_add_hint(err,
			    said ? "bring them to the plane's datum first" :
				   "if the receiver gave them in the plane's datum, say so with --crs (as EPSG:4258 for ETRS89)");
}

/* Chooses the plane for degrees, and sets the plane's geo. */
static int choose_plane(const struct pose_params *p, const struct crs_info *from, const struct pose_box *box, const char *name,
			struct pose_plane *ret, struct err *err)
{
	const struct lattice_input one = {.name = name, .min = {box->min[0], box->min[1]}, .max = {box->max[0], box->max[1]}};
	char text[CRS_TEXT_SIZE], have[8], want[8];
	struct crs_zone zone = {0}, wanted = {0};
	struct crs_info made;
	int r;

	if (p->utm && !crs_zone_parse(p->utm, &wanted)) {
		err_set(err, ERR_USAGE, "\"%.40s\" is no zone", p->utm);
		return err_add_hint(err, "name a UTM zone as in --utm 32N, or --utm UPS-N or UPS-S");
	}
	if (p->to) {
		crs_text_plane(p->to->text, text);
		if (crs_zone_of_text(from, text, &zone)) {
			if (p->utm && strcmp(crs_zone_text(wanted, want), crs_zone_text(zone, have)))
				return err_set(err, ERR_USAGE, "the points go to zone %s, not %s", have, want);
			if (crs_zone_system(from, zone, &made, err))
				return -(int)err->code;
			made.system.epsg_z = p->to->system.epsg_z;
			ret->system.system = made.system;
			return crs_geo_new(&ret->system.system, &ret->geo, err);
		}
		if (p->to->plane != CRS_PLANE_PROJECTED) {
			err_set(err, ERR_UNSUPPORTED, "degrees cannot go to %.200s: it is no plane on the earth that is known",
				p->to->text);
			return err_add_hint(err, "use poses with easting and northing of that plane");
		}
		if (p->utm)
			return err_set(err, ERR_USAGE, "the points go to %.200s, which is no zone: --utm has no meaning",
				       p->to->text);
		r = crs_geo_new(&p->to->system, &ret->geo, err);
		return r ? r : same_datum(from, p->to, p->degrees, err);
	}
	zone = wanted;
	r = p->utm ? 0 : crs_zone_choose(&one, 1, &zone, err);
	if (!r)
		r = crs_zone_system(from, zone, &ret->system, err);
	if (!r)
		crs_zone_text(zone, ret->zone);
	return r ? r : crs_geo_new(&ret->system.system, &ret->geo, err);
}

/* Heights above the ellipsoid have their own codes. */
static int set_ellipsoidal(struct crs_info *s, struct err *err)
{
	const char *heights = crs_text_heights(s->text);
	char number[16];
	unsigned epsg = fabs(s->system.inverse_flattening - 298.257223563) < 1e-6 ? ELLIPSOID_WGS84 : ELLIPSOID_GRS80;

	snprintf(number, sizeof number, "EPSG:%u", epsg);
	if (heights && strcmp(heights + 3, number)) {
		err_set(err, ERR_INPUT, "the poses have ellipsoidal heights, the points would be in %.200s", s->text);
		return err_add_hint(
			err,
			"--geoid makes them orthometric; name the column \"height\" if its heights are of that kind already");
	}
	if (heights)
		return 0;
	if (s->system.a != 6378137.0) { /* without a code they would be confused with other heights */
		if (s->system.a > 0 || (*s->text && strcmp(s->text, "unknown")))
			err_set(err, ERR_UNSUPPORTED,
				"the poses have ellipsoidal heights, and above the ellipsoid of %.200s none are known", s->text);
		else
			err_set(err, ERR_INPUT,
				"the poses have ellipsoidal heights, and of a plane without a name nothing says above which ellipsoid");
		return err_add_hint(err, "%sname the column \"height\" if the dataset's heights are of the same kind",
				    s->system.a > 0 ? "" : "say which plane it is with --crs, or ");
	}
	snprintf(s->text + strlen(s->text), sizeof s->text - strlen(s->text), " + %s", number);
	s->system.epsg_z = epsg;
	snprintf(s->unit_z, sizeof s->unit_z, "metre");
	return 0;
}

int pose_plane_choose(const struct pose_params *p, const struct pose_form *form, const struct pose_box *box, const char *name,
		      struct pose_plane *ret, struct err *err)
{
	struct crs_info from;
	double metres;
	int r = 0;

	memset(ret, 0, sizeof *ret);
	ret->degrees = form->degrees;
	ret->grid_scale = p->grid_scale;
	ret->true_north = p->north == POSE_NORTH_TRUE || (p->north == POSE_NORTH_AS_POSED && form->degrees);
	crs_info_clear(&ret->system);
	if (p->to)
		ret->system = *p->to;
	else
		snprintf(ret->system.unit_xy, sizeof ret->system.unit_xy, "metre");
	if (form->degrees) {
		if (p->degrees)
			from = *p->degrees;
		else
			r = crs_assume_text("EPSG:4326", 9, &from, err);
		if (!r)
			r = crs_zone_datum(&from, err);
		if (!r)
			r = choose_plane(p, &from, box, name, ret, err);
	} else if (p->utm) {
		err_set(err, ERR_USAGE, "--utm is about poses in degrees, these have easting and northing");
		r = err_add_hint(err, "say which plane they are in with --crs");
	} else if (ret->true_north || ret->grid_scale) {
		r = crs_geo_new(&ret->system.system, &ret->geo, err);
		err->hint[0] = 0;
		if (r)
			err_add_hint(err, "say which plane the poses are in with --crs, or leave %s out",
				     ret->grid_scale ? "--grid-scale" : "--heading true");
	}
	if (!r && !p->to)
		snprintf(ret->system.unit_z, sizeof ret->system.unit_z, "metre");
	if (!r && form->ellipsoidal)
		r = set_ellipsoidal(&ret->system, err);
	if (r)
		return r;
	metres = crs_unit_metres(ret->system.unit_xy);
	ret->metres[0] = metres > 0 ? metres : 1;
	metres = crs_unit_metres(ret->system.unit_z);
	ret->metres[1] = metres > 0 ? metres : 1;
	crs_info_settle(&ret->system);
	return 0;
}

void pose_plane_clear(struct pose_plane *p)
{
	p->geo = crs_geo_free(p->geo);
}

/* ---- one pose ---- */

/* Metres of a step of latitude on the ellipsoid, at height h. */
static double step_metres(const struct crs_system *s, double lat, double h, double step)
{
	double f = s->inverse_flattening ? 1 / s->inverse_flattening : 0, e2 = f * (2 - f);
	double w = 1 - e2 * sin(lat * DEGREE) * sin(lat * DEGREE);

	return (s->a * (1 - e2) / (w * sqrt(w)) + h) * step * DEGREE;
}

/* A northward step in the plane: its direction from grid north, clockwise, in degrees; its length relative to that on
 * the ground. */
static int north_of(const struct pose_plane *p, double lat, double lon, double x, double y, double h, double *ret_angle,
		    double *ret_scale, struct err *err)
{
	double step = lat + STEP > 90 ? -STEP : STEP, x2, y2;
	int r = crs_geo_forward(p->geo, lat + step, lon, &x2, &y2, err);

	if (r)
		return r;
	x2 = step < 0 ? x - x2 : x2 - x;
	y2 = step < 0 ? y - y2 : y2 - y;
	*ret_angle = atan2(x2, y2) / DEGREE;
	*ret_scale = hypot(x2, y2) * p->metres[0] / step_metres(&p->system.system, lat, h, STEP);
	return 0;
}

int pose_plane_put(const struct pose_plane *p, const struct pose_row *row, struct pose_node *ret, struct err *err)
{
	double angle[3] = {row->angle[0], row->angle[1], row->angle[2]}, turn = 0, scale = 1;
	double lat = row->at[1], lon = row->at[0], h = p->degrees ? row->at[2] : row->at[2] * p->metres[1];
	int r = 0;

	ret->time = row->time;
	ret->at[0] = row->at[0];
	ret->at[1] = row->at[1];
	ret->at[2] = h / p->metres[1];
	if (p->degrees)
		r = crs_geo_forward(p->geo, lat, lon, &ret->at[0], &ret->at[1], err);
	else if (p->geo)
		r = crs_geo_reverse(p->geo, row->at[0], row->at[1], &lat, &lon, err);
	if (!r && p->geo && (p->true_north || p->grid_scale))
		r = north_of(p, lat, lon, ret->at[0], ret->at[1], h, &turn, &scale, err);
	if (r)
		return r;
	if (p->true_north)
		angle[2] += turn;
	ret->scale = p->grid_scale ? scale : 1;
	pose_turn_of(angle, ret->turn);
	return 0;
}
