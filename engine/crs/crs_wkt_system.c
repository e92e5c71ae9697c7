/*
 * Interprets the keywords of a horizontal system after their brackets were read (crs_wkt.c).
 *
 * Model: the parameters of the text take precedence. If the text has an EPSG number, its definition is compared with them; if
 * they differ in more than the unit, there is no method. Lengths of WKT 1 are in the unit of the system, angles in the unit of
 * the geographic system below it. Angles must be in degrees, since writers disagree about other units. A prime meridian other
 * than Greenwich, a derived system or an unknown parameter means that there is no method.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "crs_wkt.h"

bool wkt_span_is(struct crs_span s, const char *word)
{
	return s.size == strlen(word) && !strncasecmp(s.at, word, s.size);
}

static bool span_double(struct crs_span s, double *ret)
{
	char text[40], *end;

	if (!s.size || s.size >= sizeof text)
		return false;
	for (size_t i = 0; i < s.size; i++)
		if (!strchr("0123456789+-.eE", s.at[i]) || !s.at[i])
			return false;
	memcpy(text, s.at, s.size);
	text[s.size] = 0;
	*ret = strtod(text, &end);
	return !*end && isfinite(*ret);
}

unsigned wkt_span_code(struct crs_span s)
{
	unsigned n = 0;

	if (!s.size || s.size > 6)
		return 0;
	for (size_t i = 0; i < s.size; i++) {
		if (s.at[i] < '0' || s.at[i] > '9')
			return 0;
		n = n * 10 + (unsigned)(s.at[i] - '0');
	}
	return n;
}

/* ---- units ---- */

/* The factor defines a unit. A name or number that plainly speaks of another one is a contradiction. */
void wkt_unit_read(const struct wkt_node *n, struct wkt_unit *unit)
{
	struct crs_span name = n->arg[0];
	const char *numbered = crs_unit_of_epsg(n->epsg);
	bool survey = false, international = false, metre;

	unit->name = crs_unknown;
	unit->factor = 0;
	if (!span_double(n->arg[1], &unit->factor) || unit->factor <= 0) {
		unit->factor = 0;
		return;
	}
	unit->name = unit->angle ? crs_unit_of_angle(unit->factor) : crs_unit_of_length(unit->factor);
	for (size_t i = 0; i + 6 <= name.size; i++) {
		survey |= !strncasecmp(name.at + i, "survey", 6);
		international |= !strncasecmp(name.at + i, "intern", 6);
	}
	survey |= wkt_span_is(name, "Foot_US") || wkt_span_is(name, "ftUS");
	metre = wkt_span_is(name, "metre") || wkt_span_is(name, "meter") || wkt_span_is(name, "m");
	if ((survey && strcmp(unit->name, "us-survey-foot")) || (metre && strcmp(unit->name, "metre")) ||
	    (international && !strcmp(unit->name, "us-survey-foot")) ||
	    (!crs_is_unknown(numbered) && strcmp(numbered, unit->name))) {
		unit->name = crs_unknown;
		unit->factor = 0;
		return;
	}
	/* as exact as the name is */
	if (!unit->angle && !crs_is_unknown(unit->name))
		unit->factor = crs_unit_metres(unit->name);
}

const char *wkt_unit_name(const struct wkt_unit *unit, enum wkt_kind system)
{
	bool angle = system == WKT_GEOGRAPHIC;

	if (!unit->said || (system != WKT_GEODETIC && unit->angle != angle))
		return crs_unknown;
	return unit->name;
}

/* ---- parts ---- */

static void take_ellipsoid(struct wkt_system *s, const struct wkt_node *n)
{
	double a, f;

	if (s->has_ellipsoid)
		return;
	s->has_ellipsoid = true;
	if (!span_double(n->arg[1], &a) || !span_double(n->arg[2], &f))
		return;
	if (n->unit.said)
		a *= n->unit.angle ? 0 : n->unit.factor;
	if (a > 6.3e6 && a < 6.4e6 && (f == 0 || f > 100)) {
		s->a = a;
		s->inverse_flattening = isinf(f) ? 0 : f; /* both mean a sphere */
	}
}

static void take_parameter(struct wkt_system *s, const struct wkt_node *n)
{
	double v;

	if (s->n_parameters == WKT_PARAMETERS || !span_double(n->arg[1], &v)) {
		s->odd = true;
		return;
	}
	s->parameter[s->n_parameters].name = n->arg[0];
	s->parameter[s->n_parameters].epsg = n->epsg;
	s->parameter[s->n_parameters].value = v;
	s->parameter[s->n_parameters].unit = n->unit;
	s->n_parameters++;
}

void wkt_system_part(struct wkt_system *s, const struct wkt_node *n)
{
	switch (n->kind) {
	case WKT_ELLIPSOID:
		take_ellipsoid(s, n);
		break;
	case WKT_DATUM:
		if (!s->has_datum) {
			s->datum = n->arg[0];
			s->datum_epsg = n->epsg;
		}
		s->has_datum = true;
		break;
	case WKT_MERIDIAN:
		s->has_meridian = true;
		s->meridian_unit = n->unit;
		if (!span_double(n->arg[1], &s->meridian))
			s->odd = true;
		break;
	case WKT_GEOGRAPHIC:
	case WKT_GEODETIC:
	case WKT_BASE:
		s->base = n->arg[0];
		s->base_epsg = n->epsg;
		s->base_unit = n->unit;
		break;
	case WKT_METHOD:
		s->odd |= s->has_method;
		s->has_method = true;
		s->method = n->arg[0];
		s->method_epsg = n->epsg;
		break;
	case WKT_PARAMETER:
		take_parameter(s, n);
		break;
	case WKT_DERIVING:
		s->derived = true;
		break;
	default:
		break;
	}
}

/* ---- the method ---- */

static enum crs_way way_of(const struct wkt_system *s)
{
	static const struct {
		const char *plain;
		unsigned epsg;
		enum crs_way way;
	} ways[] = {
		{"transversemercator", 9807, CRS_WAY_TM},
		{"gausskruger", 0, CRS_WAY_TM},
		{"lambertconformalconic1sp", 9801, CRS_WAY_LCC_1SP},
		{"lambertconicconformal1sp", 9801, CRS_WAY_LCC_1SP},
		{"lambertconformalconic2sp", 9802, CRS_WAY_LCC_2SP},
		{"lambertconicconformal2sp", 9802, CRS_WAY_LCC_2SP},
		{"lambertconformalconic", 0, CRS_WAY_LCC},
		{"albersconicequalarea", 9822, CRS_WAY_ALBERS},
		{"albersequalarea", 9822, CRS_WAY_ALBERS},
		{"albers", 0, CRS_WAY_ALBERS},
		{"polarstereographic", 0, CRS_WAY_POLAR},
		{"polarstereographicvarianta", 9810, CRS_WAY_POLAR_A},
		{"polarstereographicvariantb", 9829, CRS_WAY_POLAR_B},
		{"stereographicnorthpole", 0, CRS_WAY_POLAR_NORTH},
		{"stereographicsouthpole", 0, CRS_WAY_POLAR_SOUTH},
	};
	char plain[64];

	if (!s->has_method)
		return CRS_WAY_NONE;
	crs_text_plain(s->method, plain, sizeof plain);
	for (size_t i = 0; i < sizeof ways / sizeof *ways; i++)
		if (!strcmp(plain, ways[i].plain))
			return s->method_epsg && ways[i].epsg && s->method_epsg != ways[i].epsg ? CRS_WAY_OTHER : ways[i].way;
	return CRS_WAY_OTHER;
}

static bool role_of(struct crs_span name, unsigned epsg, enum crs_role *ret)
{
	static const struct {
		const char *plain;
		unsigned epsg;
		enum crs_role role;
	} roles[] = {
		{"latitudeoforigin", 0, CRS_LAT0},
		{"latitudeofnaturalorigin", 8801, CRS_LAT0},
		{"latitudeoffalseorigin", 8821, CRS_LAT0},
		{"latitudeofcenter", 0, CRS_LAT0},
		{"latitudeofcentre", 0, CRS_LAT0},
		{"centralmeridian", 0, CRS_LON0},
		{"longitudeofnaturalorigin", 8802, CRS_LON0},
		{"longitudeoffalseorigin", 8822, CRS_LON0},
		{"longitudeoforigin", 8833, CRS_LON0},
		{"longitudeofcenter", 0, CRS_LON0},
		{"longitudeofcentre", 0, CRS_LON0},
		{"standardparallel1", 0, CRS_LAT1},
		{"latitudeof1ststandardparallel", 8823, CRS_LAT1},
		{"latitudeofstandardparallel", 8832, CRS_LAT1},
		{"standardparallel2", 0, CRS_LAT2},
		{"latitudeof2ndstandardparallel", 8824, CRS_LAT2},
		{"scalefactor", 0, CRS_K0},
		{"scalefactoratnaturalorigin", 8805, CRS_K0},
		{"falseeasting", 8806, CRS_X0},
		{"eastingatfalseorigin", 8826, CRS_X0},
		{"falsenorthing", 8807, CRS_Y0},
		{"northingatfalseorigin", 8827, CRS_Y0},
	};
	char plain[64];

	crs_text_plain(name, plain, sizeof plain);
	for (size_t i = 0; i < sizeof roles / sizeof *roles; i++) {
		if (!strcmp(plain, roles[i].plain)) {
			*ret = roles[i].role;
			return !epsg || !roles[i].epsg || epsg == roles[i].epsg;
		}
	}
	return false;
}

/* Degrees of one unit of angle, 0: unknown; where nothing is said, the unit of the system under it. */
static double angle_of(const struct wkt_unit *unit, const struct wkt_unit *base)
{
	if (unit->said)
		return !unit->angle ? 0 : strcmp(unit->name, "degree") ? unit->factor * (180 / 3.141592653589793) : 1;
	return base->said && base->angle && !strcmp(base->name, "degree") ? 1 : 0;
}

static double length_of(const struct wkt_unit *unit, const struct wkt_unit *system)
{
	const struct wkt_unit *u = unit->said ? unit : system;

	return u->said && !u->angle ? u->factor : 0;
}

static void read_params(const struct wkt_system *s, const struct wkt_unit *unit, struct crs_params *ret)
{
	memset(ret, 0, sizeof *ret);
	for (unsigned i = 0; i < s->n_parameters; i++) {
		const struct wkt_unit *own = &s->parameter[i].unit;
		double v = s->parameter[i].value, factor;
		enum crs_role role;

		if (!role_of(s->parameter[i].name, s->parameter[i].epsg, &role)) {
			ret->bad = true;
			return;
		}
		factor = role == CRS_K0                   ? (own->said ? own->factor : 1) :
			 role == CRS_X0 || role == CRS_Y0 ? length_of(own, unit) :
							    angle_of(own, &s->base_unit);
		if (factor <= 0)
			ret->bad = true;
		crs_param_set(ret, role, v * factor);
	}
}

/* ---- the system ---- */

static enum crs_plane plane_of(const struct wkt_node *n)
{
	switch (n->kind) {
	case WKT_PROJECTED:
	case WKT_DERIVED:
		return CRS_PLANE_PROJECTED;
	case WKT_GEOGRAPHIC:
		return CRS_PLANE_GEOGRAPHIC;
	case WKT_GEOCENTRIC:
		return CRS_PLANE_GEOCENTRIC;
	case WKT_GEODETIC:
		return n->cartesian ? CRS_PLANE_GEOCENTRIC : n->ellipsoidal ? CRS_PLANE_GEOGRAPHIC : CRS_PLANE_UNKNOWN;
	default:
		return CRS_PLANE_UNKNOWN;
	}
}

/* WKT 1 has one UNIT for the system. WKT 2 may have one for each axis, and heights have a third. */
static void read_units(const struct wkt_node *n, struct wkt_unit *ret_xy, struct crs_info *info)
{
	const struct wkt_unit *x = &n->axis[0], *y = &n->axis[1], *z = &n->axis[2];
	enum wkt_kind kind = n->kind == WKT_GEODETIC && info->plane == CRS_PLANE_GEOGRAPHIC ? WKT_GEOGRAPHIC : n->kind;

	*ret_xy = x->said ? *x : n->unit;
	if (x->said && y->said && strcmp(x->name, y->name))
		*ret_xy = (struct wkt_unit){0};
	crs_set_unit(info->unit_xy, wkt_unit_name(ret_xy, kind));
	if (info->plane == CRS_PLANE_GEOCENTRIC)
		crs_set_unit(info->unit_z, info->unit_xy);
	else if (z->said)
		crs_set_unit(info->unit_z, wkt_unit_name(z, WKT_VERTICAL));
	else if (n->n_axes == WKT_AXES && n->cartesian && !x->said)
		crs_set_unit(info->unit_z, wkt_unit_name(&n->unit, WKT_VERTICAL));
}

static void read_datum(const struct wkt_system *s, const struct wkt_node *n, struct crs_system *ret)
{
	bool whole = n->kind == WKT_GEOGRAPHIC || n->kind == WKT_GEODETIC || n->kind == WKT_GEOCENTRIC;
	unsigned base = whole ? n->epsg : s->base_epsg;
	struct crs_info known;

	ret->a = s->a;
	ret->inverse_flattening = s->inverse_flattening;
	if (s->datum.size)
		crs_datum_of_name(ret, s->datum);
	if (!ret->datum[0])
		crs_datum_of_epsg(ret, s->datum_epsg);
	if (!ret->datum[0] && base && crs_epsg_system(base, &known))
		crs_datum_of_name(ret, (struct crs_span){known.system.datum, strlen(known.system.datum)});
	if (!ret->datum[0])
		crs_datum_of_name(ret, whole ? n->arg[0] : s->base);
}

/* Fills in properties that the EPSG number defines and the text lacks. */
static void read_number(unsigned epsg, struct crs_info *info)
{
	struct crs_system *s = &info->system;
	struct crs_info known;

	s->epsg = epsg;
	if (!crs_epsg_system(epsg, &known) || known.plane != info->plane)
		return;
	if (!s->datum[0]) {
		memcpy(s->datum, known.system.datum, sizeof s->datum);
		if (s->a == 0) {
			s->a = known.system.a;
			s->inverse_flattening = known.system.inverse_flattening;
		}
	}
	if (known.system.method == CRS_METHOD_UNKNOWN)
		return;
	if (s->method != CRS_METHOD_UNKNOWN && !crs_system_same(s, &known.system))
		s->method = CRS_METHOD_UNKNOWN;
}

static bool number_alone(const struct wkt_system *s)
{
	return !s->has_method && !s->n_parameters && !s->has_ellipsoid && !s->derived;
}

void wkt_system_settle(struct wkt_system *s, struct wkt_node *n, struct crs_info *info)
{
	struct crs_system *ret = &info->system;
	struct crs_params params;
	struct crs_info known;
	struct wkt_unit xy;

	info->plane = plane_of(n);
	read_units(n, &xy, info);
	if (number_alone(s) && crs_epsg_system(n->epsg, &known) && known.plane == info->plane) {
		/* brackets around a number: the unit of the text stays */
		*ret = known.system;
		if (!n->unit.said && !n->n_axes)
			crs_set_unit(info->unit_xy, known.unit_xy);
		return;
	}
	read_datum(s, n, ret);
	if (!s->derived && !s->odd && n->kind != WKT_DERIVED && (!s->has_meridian || s->meridian == 0)) {
		read_params(s, &xy, &params);
		if (info->plane == CRS_PLANE_PROJECTED)
			crs_method_settle(ret, way_of(s), &params);
		else if (info->plane == CRS_PLANE_GEOGRAPHIC && !s->has_method)
			ret->method = CRS_METHOD_GEOGRAPHIC;
	}
	if (n->epsg)
		read_number(n->epsg, info);
	else if (info->plane == CRS_PLANE_PROJECTED && ret->a > 0)
		ret->epsg = n->epsg = crs_epsg_of_system(ret);
}
