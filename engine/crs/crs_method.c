/*
 * From the parameters of a record to a method, or to none: everything that a method needs must be said, once or
 * alike, and nothing that it does not know (EPSG Guidance Note 7-2 names what each needs).
 */
#include <math.h>
#include <string.h>

#include "crs_parts.h"

void crs_param_set(struct crs_params *p, enum crs_role role, double value)
{
	if (!isfinite(value))
		p->bad = true;
	if (p->said[role] && fabs(p->value[role] - value) > 1e-9 * (1 + fabs(value)))
		p->bad = true;
	p->said[role] = true;
	p->value[role] = value;
}

static bool have(const struct crs_params *p, unsigned roles)
{
	for (unsigned i = 0; i < CRS_ROLES; i++)
		if ((roles >> i & 1) && !p->said[i])
			return false;
	return true;
}

#define BIT(role) (1u << (role))
#define PLACE (BIT(CRS_LON0) | BIT(CRS_X0) | BIT(CRS_Y0))

static bool is_pole(double lat)
{
	return fabs(fabs(lat) - 90) < 1e-9;
}

/* The scale where a method has none of its own: not said, 1, or the 0 that some writers fill in. */
static bool no_scale(const struct crs_params *p)
{
	return !p->said[CRS_K0] || p->value[CRS_K0] == 1 || p->value[CRS_K0] == 0;
}

static bool settle_conic(struct crs_system *s, enum crs_way way, const struct crs_params *p)
{
	const double *v = p->value;
	bool two =
		way == CRS_WAY_LCC_2SP || way == CRS_WAY_ALBERS || (way == CRS_WAY_LCC && p->said[CRS_LAT1] && p->said[CRS_LAT2]);

	if (!have(p, PLACE | BIT(CRS_LAT0)))
		return false;
	if (two) {
		if (!have(p, BIT(CRS_LAT1) | BIT(CRS_LAT2)) || !no_scale(p))
			return false;
		s->lat1 = v[CRS_LAT1];
		s->lat2 = v[CRS_LAT2];
		s->k0 = 1;
	} else {
		if (p->said[CRS_LAT2] || !p->said[CRS_K0] || (p->said[CRS_LAT1] && v[CRS_LAT1] != v[CRS_LAT0]))
			return false;
		s->lat1 = s->lat2 = v[CRS_LAT0];
		s->k0 = v[CRS_K0];
	}
	s->lat0 = v[CRS_LAT0];
	s->method = way == CRS_WAY_ALBERS ? CRS_METHOD_ALBERS : CRS_METHOD_LAMBERT_CONIC;
	/* a cone has a top, and the equator between mirrored parallels has none */
	return !is_pole(s->lat1) && !is_pole(s->lat2) && fabs(s->lat1 + s->lat2) > 1e-9;
}

static bool settle_polar(struct crs_system *s, enum crs_way way, const struct crs_params *p)
{
	const double *v = p->value;
	double truth;

	if (!have(p, PLACE))
		return false;
	if (way == CRS_WAY_POLAR_A || (way == CRS_WAY_POLAR && p->said[CRS_LAT0] && is_pole(v[CRS_LAT0]))) {
		if (!have(p, BIT(CRS_LAT0) | BIT(CRS_K0)) || !is_pole(v[CRS_LAT0]) || p->said[CRS_LAT1])
			return false;
		s->lat0 = s->lat1 = v[CRS_LAT0] > 0 ? 90 : -90;
		s->k0 = v[CRS_K0];
	} else {
		enum crs_role at = way == CRS_WAY_POLAR ? CRS_LAT0 : CRS_LAT1;

		if (!p->said[at] || !no_scale(p))
			return false;
		truth = v[at];
		if (truth == 0 || (way == CRS_WAY_POLAR_NORTH && truth < 0) || (way == CRS_WAY_POLAR_SOUTH && truth > 0))
			return false;
		s->lat0 = truth > 0 ? 90 : -90;
		s->lat1 = truth;
		s->k0 = 1;
	}
	s->method = CRS_METHOD_POLAR_STEREOGRAPHIC;
	return true;
}

static bool settle_tm(struct crs_system *s, const struct crs_params *p)
{
	if (!have(p, PLACE | BIT(CRS_LAT0) | BIT(CRS_K0)) || p->said[CRS_LAT1] || p->said[CRS_LAT2])
		return false;
	s->method = CRS_METHOD_TRANSVERSE_MERCATOR;
	s->lat0 = p->value[CRS_LAT0];
	s->k0 = p->value[CRS_K0];
	return true;
}

static bool sane(const struct crs_system *s)
{
	return fabs(s->lat0) <= 90 && fabs(s->lat1) <= 90 && fabs(s->lat2) <= 90 && fabs(s->lon0) <= 360 && s->k0 > 0.5 &&
	       s->k0 < 2 && fabs(s->x0) < 1e9 && fabs(s->y0) < 1e9;
}

void crs_method_settle(struct crs_system *s, enum crs_way way, const struct crs_params *p)
{
	struct crs_system made = *s;
	bool good = false;

	if (p->bad)
		return;
	switch (way) {
	case CRS_WAY_NONE:
	case CRS_WAY_OTHER:
		break;
	case CRS_WAY_TM:
		good = settle_tm(&made, p);
		break;
	case CRS_WAY_LCC_1SP:
	case CRS_WAY_LCC_2SP:
	case CRS_WAY_LCC:
	case CRS_WAY_ALBERS:
		good = settle_conic(&made, way, p);
		break;
	case CRS_WAY_POLAR:
	case CRS_WAY_POLAR_A:
	case CRS_WAY_POLAR_B:
	case CRS_WAY_POLAR_NORTH:
	case CRS_WAY_POLAR_SOUTH:
		good = settle_polar(&made, way, p);
		break;
	}
	if (!good)
		return;
	made.lon0 = remainder(p->value[CRS_LON0], 360);
	made.x0 = p->value[CRS_X0];
	made.y0 = p->value[CRS_Y0];
	if (sane(&made) && fabs(p->value[CRS_LON0]) <= 360)
		*s = made;
}

static bool near(double a, double b, double tolerance)
{
	return fabs(a - b) <= tolerance;
}

/* Tolerances of 0.1 mm on the ground; 1e-3 of the ellipsoid's axis is what seven decimals of a foot give. */
bool crs_system_same(const struct crs_system *a, const struct crs_system *b)
{
	bool parallels = (near(a->lat1, b->lat1, 1e-9) && near(a->lat2, b->lat2, 1e-9)) ||
			 (near(a->lat1, b->lat2, 1e-9) && near(a->lat2, b->lat1, 1e-9));

	return a->method == b->method && near(a->a, b->a, 1e-3) && near(a->inverse_flattening, b->inverse_flattening, 1e-7) &&
	       near(a->lat0, b->lat0, 1e-9) && near(remainder(a->lon0 - b->lon0, 360), 0, 1e-9) && parallels &&
	       near(a->k0, b->k0, 1e-10) && near(a->x0, b->x0, 1e-4) && near(a->y0, b->y0, 1e-4);
}
