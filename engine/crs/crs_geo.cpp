/*
 * The earth under a plane (crs_geo.h): projections, geodesic areas and MGRS by GeographicLib.
 *
 * Model: one object holds the one projection that the system's method asks for, the offset of its natural
 * origin, and the system's unit. Every door catches everything that C++ may throw. Not here: which system a
 * file has (crs.h), grids (crs_geoid.cpp), millions of points (crs_step.c).
 */
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>
#include <memory>
#include <new>
#include <string>

#include <GeographicLib/AlbersEqualArea.hpp>
#include <GeographicLib/Geodesic.hpp>
#include <GeographicLib/LambertConformalConic.hpp>
#include <GeographicLib/MGRS.hpp>
#include <GeographicLib/Math.hpp>
#include <GeographicLib/PolarStereographic.hpp>
#include <GeographicLib/PolygonArea.hpp>
#include <GeographicLib/TransverseMercator.hpp>
#include <GeographicLib/UTMUPS.hpp>

extern "C" {
#include "crs_geo.h"
#include "crs_geo_parts.h"
#include "err.h"
}

namespace G = GeographicLib;

/* The series of the transverse Mercator is good to nanometres within 35 degrees of the meridian and useless
 * near 90. */
static const double tm_most = 45;
/* What comes back from a plane position must lead there again, to so many metres. */
static const double there_and_back = 1e-3;

struct crs_geo {
	crs_system system;
	double unit;
	double x0, y0; /* metres; of the projection's own origin */
	bool north;
	std::unique_ptr<G::TransverseMercator> tm;
	std::unique_ptr<G::LambertConformalConic> lambert;
	std::unique_ptr<G::AlbersEqualArea> albers;
	std::unique_ptr<G::PolarStereographic> polar;

	void forward(double lat, double lon, double &x, double &y) const
	{
		const crs_system &s = system;

		switch (s.method) {
		case CRS_METHOD_TRANSVERSE_MERCATOR:
			tm->Forward(s.lon0, lat, lon, x, y);
			break;
		case CRS_METHOD_LAMBERT_CONIC:
			lambert->Forward(s.lon0, lat, lon, x, y);
			break;
		case CRS_METHOD_ALBERS:
			albers->Forward(s.lon0, lat, lon, x, y);
			break;
		case CRS_METHOD_POLAR_STEREOGRAPHIC:
			polar->Forward(north, lat, G::Math::AngDiff(s.lon0, lon), x, y);
			break;
		default:
			x = lon;
			y = lat;
		}
	}

	void reverse(double x, double y, double &lat, double &lon) const
	{
		const crs_system &s = system;

		switch (s.method) {
		case CRS_METHOD_TRANSVERSE_MERCATOR:
			tm->Reverse(s.lon0, x, y, lat, lon);
			break;
		case CRS_METHOD_LAMBERT_CONIC:
			lambert->Reverse(s.lon0, x, y, lat, lon);
			break;
		case CRS_METHOD_ALBERS:
			albers->Reverse(s.lon0, x, y, lat, lon);
			break;
		case CRS_METHOD_POLAR_STEREOGRAPHIC:
			polar->Reverse(north, x, y, lat, lon);
			lon = G::Math::AngNormalize(lon + s.lon0);
			break;
		default:
			lat = y;
			lon = x;
		}
	}
};

int crs_geo_caught(struct err *err, const char *what)
{
	try {
		throw;
	} catch (const std::bad_alloc &) {
		return err_set(err, ERR_NOMEM, "no memory for %s", what);
	} catch (const std::exception &e) {
		return err_set(err, ERR_INPUT, "%s: %.300s", what, e.what());
	} catch (...) {
		return err_set(err, ERR_INTERNAL, "%s failed", what);
	}
}

/* ---- new ---- */

static int check_system(const crs_system &s, err *err)
{
	static const char hint[] = "say what it is with --assume-crs, or use a system that acut can compute with";

	if (s.method == CRS_METHOD_UNKNOWN)
		err_set(err, ERR_UNSUPPORTED, "how the coordinate system lies on the earth is not known");
	else if (!(s.a > 0) || !std::isfinite(s.a))
		err_set(err, ERR_UNSUPPORTED, "the ellipsoid of the coordinate system is not known");
	else if (!std::isfinite(s.inverse_flattening) || (s.inverse_flattening && s.inverse_flattening < 50))
		err_set(err, ERR_UNSUPPORTED, "the ellipsoid of the coordinate system has no proper flattening");
	else if (!(s.unit > 0) || !std::isfinite(s.unit))
		err_set(err, ERR_UNSUPPORTED, "the horizontal unit of the coordinate system is not known");
	else
		return 0;
	return err_add_hint(err, "%s", hint);
}

/* A system of one standard parallel has it in lat0, with its scale; one of two in lat1 and lat2. */
static void make_conic(crs_geo &g, double f)
{
	const crs_system &s = g.system;
	bool two = s.lat1 != 0 || s.lat2 != 0;
	double lat1 = two ? s.lat1 : s.lat0, lat2 = two ? s.lat2 : s.lat0, k = s.k0 > 0 ? s.k0 : 1;

	if (s.method == CRS_METHOD_LAMBERT_CONIC)
		g.lambert.reset(new G::LambertConformalConic(s.a, f, lat1, lat2, k));
	else
		g.albers.reset(new G::AlbersEqualArea(s.a, f, lat1, lat2, k));
}

/* Variant A: scale k0 at the pole lat0; variant B: true scale at the parallel lat1. */
static void make_polar(crs_geo &g, double f)
{
	const crs_system &s = g.system;
	double k = s.k0 > 0 ? s.k0 : 1;

	g.north = (s.lat0 ? s.lat0 : s.lat1) > 0;
	g.polar.reset(new G::PolarStereographic(s.a, f, k));
	if (s.lat1 && std::fabs(s.lat1) < 90)
		g.polar->SetScale(std::fabs(s.lat1), k);
}

static void make(crs_geo &g, const crs_system &s)
{
	double f = s.inverse_flattening ? 1 / s.inverse_flattening : 0;

	g.system = s;
	g.unit = s.unit;
	g.x0 = g.y0 = 0;
	if (s.method == CRS_METHOD_TRANSVERSE_MERCATOR)
		g.tm.reset(new G::TransverseMercator(s.a, f, s.k0 > 0 ? s.k0 : 1));
	else if (s.method == CRS_METHOD_POLAR_STEREOGRAPHIC)
		make_polar(g, f);
	else if (s.method != CRS_METHOD_GEOGRAPHIC)
		make_conic(g, f);
	else
		return;
	if (s.method != CRS_METHOD_POLAR_STEREOGRAPHIC)
		g.forward(s.lat0, s.lon0, g.x0, g.y0);
	g.x0 -= s.x0;
	g.y0 -= s.y0;
}

int crs_geo_new(const struct crs_system *system, struct crs_geo **ret, struct err *err)
{
	int r = check_system(*system, err);

	if (r)
		return r;
	try {
		std::unique_ptr<crs_geo> g(new crs_geo());

		make(*g, *system);
		if (!std::isfinite(g->x0) || !std::isfinite(g->y0))
			return err_set(err, ERR_UNSUPPORTED, "the parameters of the coordinate system make no projection");
		*ret = g.release();
		return 0;
	} catch (...) {
		r = crs_geo_caught(err, "the coordinate system");
		return r;
	}
}

struct crs_geo *crs_geo_free(struct crs_geo *g)
{
	delete g;
	return NULL;
}

/* ---- there and back ---- */

static int check_place(double lat, double lon, err *err)
{
	if (std::fabs(lat) <= 90 && lon >= -180 && lon <= 360)
		return 0;
	err_set(err, ERR_INPUT, "latitude %.10g, longitude %.10g is no place on the earth", lat, lon);
	return err_add_hint(err, "x must be the longitude (-180 to 360) and y the latitude (-90 to 90): "
				 "they may be swapped, or not be degrees");
}

static int outside(err *err)
{
	return err_set(err, ERR_INPUT, "the place lies outside of what the projection can do");
}

int crs_geo_forward(const struct crs_geo *g, double lat, double lon, double *ret_x, double *ret_y,
		    struct err *err)
{
	double x, y;
	int r = check_place(lat, lon, err);

	if (r)
		return r;
	try {
		if (g->tm && std::fabs(G::Math::AngDiff(g->system.lon0, lon)) > tm_most)
			return outside(err);
		g->forward(lat, lon, x, y);
	} catch (...) {
		return crs_geo_caught(err, "projecting");
	}
	if (!std::isfinite(x) || !std::isfinite(y) || std::fabs(x) > 1e9 || std::fabs(y) > 1e9)
		return outside(err);
	*ret_x = (x - g->x0) / g->unit;
	*ret_y = (y - g->y0) / g->unit;
	return 0;
}

int crs_geo_reverse(const struct crs_geo *g, double x, double y, double *ret_lat, double *ret_lon,
		    struct err *err)
{
	double east = x * g->unit + g->x0, north = y * g->unit + g->y0, lat, lon, xx, yy;
	bool degrees = g->system.method == CRS_METHOD_GEOGRAPHIC;

	if (!std::isfinite(x) || !std::isfinite(y))
		return outside(err);
	try {
		g->reverse(east, north, lat, lon);
		if (degrees) {
			int r = check_place(lat, lon, err);

			if (r)
				return r;
			lon = G::Math::AngNormalize(lon);
		} else {
			/* A projection answers also where it has no answer; the way back tells. */
			g->forward(lat, lon, xx, yy);
			if (!(std::fabs(xx - east) < there_and_back && std::fabs(yy - north) < there_and_back) ||
			    (g->tm && std::fabs(G::Math::AngDiff(g->system.lon0, lon)) > tm_most))
				return outside(err);
		}
	} catch (...) {
		return crs_geo_caught(err, "finding the place on the earth");
	}
	*ret_lat = lat;
	*ret_lon = lon;
	return 0;
}

int crs_geo_area(const struct crs_geo *g, const double (*xy)[2], size_t n, double *ret_area,
		 double *ret_perimeter, struct err *err)
{
	double area, perimeter, f = g->system.inverse_flattening ? 1 / g->system.inverse_flattening : 0;

	try {
		G::Geodesic geodesic(g->system.a, f);
		G::PolygonArea polygon(geodesic);

		for (size_t i = 0; i < n; i++) {
			double lat, lon;
			int r = crs_geo_reverse(g, xy[i][0], xy[i][1], &lat, &lon, err);

			if (r)
				return r;
			polygon.AddPoint(lat, lon);
		}
		polygon.Compute(false, true, perimeter, area);
	} catch (...) {
		return crs_geo_caught(err, "the geodesic area");
	}
	*ret_area = std::fabs(area);
	*ret_perimeter = perimeter;
	return 0;
}

/* ---- zones and squares ---- */

int crs_geo_mgrs(double lat, double lon, int digits, char *buf, size_t size, struct err *err)
{
	int r = check_place(lat, lon, err);

	if (r)
		return r;
	if (digits < 0 || digits > 5)
		return err_set(err, ERR_USAGE, "an MGRS square has 0 to 5 digits an axis, not %d", digits);
	try {
		int zone;
		bool north;
		double x, y;
		std::string text;

		G::UTMUPS::Forward(lat, lon, zone, north, x, y);
		G::MGRS::Forward(zone, north, x, y, lat, digits, text);
		if (text.size() >= size)
			return err_set(err, ERR_INTERNAL, "no room for an MGRS square of %zu letters", text.size());
		std::memcpy(buf, text.c_str(), text.size() + 1);
		return 0;
	} catch (...) {
		return crs_geo_caught(err, "the MGRS square");
	}
}

int crs_zone_of(double lat, double lon, struct crs_zone *ret, struct err *err)
{
	int r = check_place(lat, lon, err);

	if (r)
		return r;
	try {
		ret->number = G::UTMUPS::StandardZone(lat, lon);
		ret->north = lat >= 0;
		return 0;
	} catch (...) {
		return crs_geo_caught(err, "the zone of a place");
	}
}

double crs_geo_angle(double from, double to)
{
	return G::Math::AngDiff(from, to);
}
