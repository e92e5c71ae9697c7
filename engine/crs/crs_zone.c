/*
 * UTM and UPS zones as coordinate systems (crs_geo.h): their names, their parameters, which one a set of boxes
 * gets, and on which datums they stand.
 *
 * Model: a zone on a datum is the datum's ellipsoid and five numbers; where EPSG has a number for it, that is
 * its text, else the datum's name and the zone's. Not here: any shift from one datum to another.
 */
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "crs_geo.h"
#include "crs_geo_parts.h"
#include "crs_parts.h"
#include "err.h"

/* ---- names ---- */

bool crs_zone_parse(const char *text, struct crs_zone *ret)
{
	int number = 0;
	size_t n = 0;

	if (!strncasecmp(text, "ups", 3)) {
		n = 3;
		n += text[n] == '-';
	} else {
		for (; isdigit((unsigned char)text[n]) && n < 2; n++)
			number = number * 10 + (text[n] - '0');
		if (!n)
			return false;
	}
	if (number > 60 || (text[n] != 'N' && text[n] != 'n' && text[n] != 'S' && text[n] != 's') || text[n + 1])
		return false;
	*ret = (struct crs_zone){.number = number, .north = text[n] == 'N' || text[n] == 'n'};
	return true;
}

char *crs_zone_text(struct crs_zone z, char buf[8])
{
	if (z.number)
		snprintf(buf, 8, "%d%c", z.number % 100, z.north ? 'N' : 'S');
	else
		snprintf(buf, 8, "UPS-%c", z.north ? 'N' : 'S');
	return buf;
}

/* ---- datums ---- */

/* Geographic systems by number and name, and EPSG's numbers of the zones on them: zone `first` north has the
 * number `north`; `last` is the last one that has. Source: the EPSG data set. */
struct zones {
	int first, last;
	unsigned number;
};

static const struct datum {
	const char *name;
	unsigned geographic[3];
	struct zones north[2], south[1];
} datums[] = {
	{"WGS 84", {4326, 4979}, {{1, 60, 32601}}, {{1, 60, 32701}}},
	{"ETRS89", {4258, 4937}, {{28, 38, 25828}}, {{0}}},
	{"NAD83", {4269}, {{1, 23, 26901}}, {{0}}},
	{"NAD83(2011)", {6318, 6319}, {{59, 60, 6328}, {1, 19, 6330}}, {{0}}},
	{"GDA94", {4283, 4939}, {{0}}, {{48, 58, 28348}}},
	{"GDA2020", {7844, 7843}, {{0}}, {{46, 59, 7846}}},
	{"SIRGAS 2000", {4674, 4989}, {{11, 22, 31965}}, {{17, 25, 31977}}},
	{"JGD2011", {6668, 6667}, {{51, 55, 6688}}, {{0}}},
};

static const struct datum *datum_find(const struct crs_system *s)
{
	size_t i, k;

	for (i = 0; i < sizeof datums / sizeof *datums; i++) {
		if (!s->epsg && !strcasecmp(s->datum, datums[i].name))
			return &datums[i];
		for (k = 0; s->epsg && k < 3; k++)
			if (datums[i].geographic[k] == s->epsg)
				return &datums[i];
	}
	return NULL;
}

static unsigned datum_zone(const struct datum *d, struct crs_zone z)
{
	const struct zones *table = z.north ? d->north : d->south;
	size_t i, n = z.north ? 2 : 1;

	if (!z.number)
		return d == &datums[0] ? (z.north ? 5041 : 5042) : 0;
	for (i = 0; i < n; i++)
		if (table[i].number && z.number >= table[i].first && z.number <= table[i].last)
			return table[i].number + (unsigned)(z.number - table[i].first);
	return 0;
}

int crs_zone_datum(const struct crs_info *g, struct err *err)
{
	const struct crs_system *s = &g->system;

	if (g->plane != CRS_PLANE_GEOGRAPHIC) {
		err_set(err, ERR_UNSUPPORTED, "its coordinates are not known to be degrees");
	} else if (!(s->a > 0) || (!*s->datum && !s->epsg)) {
		err_set(err, ERR_UNSUPPORTED, "its coordinates are degrees (%.200s), but of which datum is not known", g->text);
	} else if (s->unit > 0 && fabs(s->unit - 1) > 1e-12) {
		err_set(err, ERR_UNSUPPORTED, "its coordinates are angles, but not degrees (%.200s)", g->text);
	} else if (s->a != 6378137.0 ||
		   (fabs(s->inverse_flattening - 298.257223563) > 1e-6 && fabs(s->inverse_flattening - 298.257222101) > 1e-6)) {
		char ellipsoid[CRS_ELLIPSOID_TEXT];

		err_set(err, ERR_UNSUPPORTED, "its datum (%.60s) stands on %s; only WGS 84 and GRS 80 are projected",
			*s->datum ? s->datum : g->text, crs_ellipsoid_text(s, ellipsoid));
	} else {
		return 0;
	}
	return err_add_hint(err, "say what the degrees are with %s (as EPSG:4326), or triangulate them as they are with --planar",
			    crs_is_unknown(g->text) ? "--assume-crs" : "--override-crs");
}

/* ---- systems ---- */

static void zone_parameters(struct crs_zone z, struct crs_system *s)
{
	s->lat1 = s->lat2 = 0;
	s->unit = 1;
	if (z.number) {
		s->method = CRS_METHOD_TRANSVERSE_MERCATOR;
		s->lat0 = 0;
		s->lon0 = 6 * z.number - 183;
		s->k0 = 0.9996;
		s->x0 = 500000;
		s->y0 = z.north ? 0 : 10000000;
	} else {
		s->method = CRS_METHOD_POLAR_STEREOGRAPHIC;
		s->lat0 = s->lat1 = z.north ? 90 : -90;
		s->lon0 = 0;
		s->k0 = 0.994;
		s->x0 = s->y0 = 2000000;
	}
}

int crs_zone_system(const struct crs_info *geographic, struct crs_zone zone, struct crs_info *ret, struct err *err)
{
	const struct crs_system *from = &geographic->system;
	const struct datum *datum = datum_find(from);
	struct crs_info to = *geographic;
	const char *heights = crs_text_heights(geographic->text);
	char name[CRS_TEXT_SIZE], which[16];
	unsigned number = datum ? datum_zone(datum, zone) : 0;
	int r = crs_zone_datum(geographic, err);

	if (r)
		return r;
	to.plane = CRS_PLANE_PROJECTED;
	to.system.epsg = number;
	zone_parameters(zone, &to.system);
	/* the number that a file in that zone gives itself */
	if (!number)
		number = to.system.epsg = crs_epsg_of_system(&to.system);
	snprintf(to.unit_xy, sizeof to.unit_xy, "metre");
	if (number) {
		snprintf(name, sizeof name, "EPSG:%u", number);
	} else {
		snprintf(which, sizeof which, zone.number ? "%d%c" : "", zone.number, zone.north ? 'N' : 'S');
		snprintf(name, sizeof name, "%.60s / %s%s",
			 datum        ? datum->name :
			 *from->datum ? from->datum :
					geographic->text,
			 zone.number ? "UTM zone " :
			 zone.north  ? "UPS North" :
				       "UPS South",
			 which);
	}
	snprintf(to.text, sizeof to.text, "%.100s%.300s", name, heights ? heights : "");
	*ret = to;
	return 0;
}

bool crs_zone_of_text(const struct crs_info *geographic, const char *text, struct crs_zone *ret)
{
	struct err err = ERR_INIT;
	struct crs_info to;
	int i;

	for (i = 0; i < 2 * 61; i++) {
		struct crs_zone z = {.number = i / 2, .north = i % 2};

		if (crs_zone_system(geographic, z, &to, &err))
			return false;
		if (!strcmp(to.text, text)) {
			*ret = z;
			return true;
		}
	}
	return false;
}

/* ---- which zone ---- */

static bool box_is_good(const struct lattice_input *b)
{
	return isfinite(b->min[0]) && isfinite(b->max[0]) && isfinite(b->min[1]) && isfinite(b->max[1]) &&
	       b->min[0] <= b->max[0] && b->min[1] <= b->max[1];
}

static int not_degrees(const struct lattice_input *b, struct err *err)
{
	bool swapped = fabs(b->min[0]) <= 90 && fabs(b->max[0]) <= 90 && b->min[1] >= -180 && b->max[1] <= 360;

	err_set(err, ERR_INPUT, "its coordinates should be degrees, but x runs from %.10g to %.10g and y from %.10g to %.10g",
		b->min[0], b->max[0], b->min[1], b->max[1]);
	err_add_hint(err, swapped ? "x must be the longitude and y the latitude: they seem to be swapped" :
				    "name its real coordinate system with --override-crs, or take x and y as they are with "
				    "--planar");
	return err_add_file(err, b->name ? b->name : "");
}

struct range {
	double min, max;
};

static void range_add(struct range *r, double min, double max)
{
	r->min = fmin(r->min, min);
	r->max = fmax(r->max, max);
}

int crs_zone_choose(const struct lattice_input *boxes, size_t n, struct crs_zone *ret, struct err *err)
{
	struct range lat = {INFINITY, -INFINITY}, lon[2] = {lat, lat};
	double middle;
	size_t i;
	int k;

	for (i = 0; i < n; i++) {
		const struct lattice_input *b = &boxes[i];

		if (!box_is_good(b))
			continue;
		if (b->min[1] < -90 || b->max[1] > 90 || b->min[0] < -180 || b->max[0] > 360 || b->max[0] - b->min[0] > 360)
			return not_degrees(b, err);
		range_add(&lat, b->min[1], b->max[1]);
		/* Once with longitudes that begin at -180, once at 0; the narrower range is the one meant. */
		for (k = 0; k < 2; k++) {
			double from = b->min[0], low = k ? 0 : -180;

			if (from < low)
				from += 360;
			else if (from >= low + 360)
				from -= 360;
			range_add(&lon[k], from, from + (b->max[0] - b->min[0]));
		}
	}
	if (!(lat.min <= lat.max)) {
		err_set(err, ERR_INPUT, "no header says where the degrees lie");
		return err_add_hint(err, "name the zone with --utm, as in --utm 32N");
	}
	k = lon[1].max - lon[1].min < lon[0].max - lon[0].min;
	middle = lon[k].min / 2 + lon[k].max / 2;
	return crs_zone_of(lat.min / 2 + lat.max / 2, middle > 360 ? middle - 360 : middle, ret, err);
}
