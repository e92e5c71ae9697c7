/*
 * Geoid grids (crs_geo.h): GeographicLib's reader of its PGM files, behind C.
 *
 * Model: the file stays on disk; GeographicLib reads the twelve pixels around a place and keeps the cell that
 * they make. So one object takes a file buffer and a few hundred bytes, whatever the size of the grid; it is
 * never asked to cache an area. Not here: whether the file is sound (crs_geoid_check.c).
 */
#include <cmath>
#include <cstring>
#include <memory>
#include <string>

#include <GeographicLib/Geoid.hpp>

extern "C" {
#include "crs_geo.h"
#include "crs_geo_parts.h"
#include "err.h"
}

namespace G = GeographicLib;

struct crs_geoid {
	G::Geoid grid;
	crs_geoid(const std::string &name, const std::string &folder) : grid(name, folder, true, false) {}
};

int crs_geoid_open(const char *path, struct crs_geoid **ret, struct err *err)
{
	static const char ending[] = ".pgm";
	const char *slash = std::strrchr(path, '/'), *base = slash ? slash + 1 : path;
	size_t n = std::strlen(base), end = sizeof ending - 1;

	if (n <= end || std::strcmp(base + n - end, ending)) {
		err_set(err, ERR_USAGE, "a geoid grid has a name that ends in .pgm");
		return err_add_file(err, path);
	}
	try {
		std::string folder = slash ? std::string(path, slash == path ? 1 : slash - path) : std::string(".");

		*ret = new crs_geoid(std::string(base, n - end), folder);
		return 0;
	} catch (...) {
		crs_geo_caught(err, "the geoid grid");
		return err_add_file(err, path);
	}
}

struct crs_geoid *crs_geoid_close(struct crs_geoid *g)
{
	delete g;
	return NULL;
}

int crs_geoid_height(struct crs_geoid *g, double lat, double lon, double *ret, struct err *err)
{
	double h;

	if (!(std::fabs(lat) <= 90) || !(lon >= -360 && lon <= 360))
		return err_set(err, ERR_INPUT, "latitude %.10g, longitude %.10g is no place on the earth", lat, lon);
	try {
		h = g->grid(lat, lon);
	} catch (...) {
		return crs_geo_caught(err, "reading the geoid grid");
	}
	if (!std::isfinite(h))
		return err_set(err, ERR_INTERNAL, "the geoid has no height at latitude %.10g, longitude %.10g", lat,
			       lon);
	*ret = h;
	return 0;
}
