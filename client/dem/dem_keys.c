/*
 * GeoKeys: what the mesh says of its system ("EPSG:2154", "EPSG:2154 + EPSG:5720", a name, "unknown") and of its units.
 *
 * A number is written only where it is certain: the plane's kind follows from its unit, and the vertical number is that of the
 * heights as they are written. All else is a citation, with the units that are known. Heights above an ellipsoid have no number
 * beside a projected system, so they are a citation, too. A plane without a number is written as WKT in a citation, as ESRI
 * does and GDAL reads it. The directory is that of GeoTIFF 1.1: GDAL reads vertical systems of no earlier one.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dem_priv.h"

enum {
	MODEL_TYPE = 1024,
	RASTER_TYPE = 1025,
	CITATION = 1026,
	GEOGRAPHIC = 2048,
	ANGULAR_UNITS = 2054,
	PROJECTED = 3072,
	PROJECTED_CITATION = 3073,
	LINEAR_UNITS = 3076,
	VERTICAL = 4096,
	VERTICAL_CITATION = 4097,
	VERTICAL_UNITS = 4099,
	USER_DEFINED = 32767,
	ASCII_TAG = 34737,
	WKT_MOST = 2300, /* GDAL reads 2,400 bytes of a citation */
};

static unsigned unit_number(const char *name)
{
	return !strcmp(name, "metre")          ? 9001 :
	       !strcmp(name, "foot")           ? 9002 :
	       !strcmp(name, "us-survey-foot") ? 9003 :
	       !strcmp(name, "degree")         ? 9102 :
						 0;
}

/* "EPSG:n" of n bytes; 0: it is none that a key can have. */
static unsigned epsg_of(const char *text, size_t n)
{
	char *end;
	unsigned long v;

	if (n < 6 || strncmp(text, "EPSG:", 5))
		return 0;
	v = strtoul(text + 5, &end, 10);
	return end == text + n && v > 1000 && v < USER_DEFINED ? (unsigned)v : 0;
}

static void put(struct dem_keys *k, unsigned key, unsigned tag, unsigned count, unsigned value)
{
	const unsigned row[4] = {key, tag, count, value};

	for (int i = 0; i < 4; i++)
		k->key[k->n++] = (uint16_t)row[i];
	k->key[3]++;
}

unsigned dem_keys_epsg(const struct dem *d)
{
	const char *plus = strstr(d->crs, " + ");

	return epsg_of(d->crs, plus ? (size_t)(plus - d->crs) : strlen(d->crs));
}

static void cite(struct dem_keys *k, unsigned key, const char *head, const char *text)
{
	size_t at = strlen(k->text);

	snprintf(k->text + at, sizeof(k->text) - at, "%s%s|", head, text);
	for (char *c = k->text + at; c[1]; c++)
		*c = *c == '|' ? '/' : *c;
	put(k, key, ASCII_TAG, (unsigned)strlen(k->text + at), (unsigned)at);
}

/* EPSG's numbers from 5001 to 5035 are those of ellipsoids in GeoTIFF 1.0, and no vertical systems of EPSG. */
static bool is_ellipsoidal(const char *heights)
{
	unsigned number = epsg_of(heights, strlen(heights));

	return (number >= 5001 && number <= 5035) || strcasestr(heights, "ellips");
}

static void put_heights(struct dem_keys *k, const char *heights, const char *unit)
{
	bool ellipsoidal = is_ellipsoidal(heights);
	unsigned number = ellipsoidal ? 0 : epsg_of(heights, strlen(heights)), unit_z = unit_number(unit);

	if (!ellipsoidal)
		put(k, VERTICAL, 0, 1, number ? number : USER_DEFINED);
	if (!number)
		cite(k, VERTICAL_CITATION, "", heights);
	if (unit_z)
		put(k, VERTICAL_UNITS, 0, 1, unit_z);
}

/* It may speak of heights, which the pixels then must be. */
static bool wkt_fits(const struct dem *d, bool heights, bool vertical)
{
	return d->wkt && strlen(d->wkt) < WKT_MOST && !strchr(d->wkt, '|') && (heights || !vertical);
}

const char *dem_keys_wkt(const struct dem *d)
{
	return wkt_fits(d, false, strstr(d->crs, " + ") != NULL) ? d->wkt : NULL;
}

void dem_keys_make(struct dem_keys *k, const struct dem *d)
{
	const char *plus = strstr(d->crs, " + ");
	size_t n = plus ? (size_t)(plus - d->crs) : strlen(d->crs);
	unsigned unit = unit_number(d->unit_xy), system = unit ? epsg_of(d->crs, n) : 0;
	bool heights = d->opt.kind == DEM_ELEVATION && !d->opt.z_converted;
	bool degrees = unit == 9102;

	*k = (struct dem_keys){.key = {1, 1, 1, 0}, .n = 4};
	put(k, MODEL_TYPE, 0, 1, system ? (degrees ? 2 : 1) : USER_DEFINED);
	put(k, RASTER_TYPE, 0, 1, 1);
	cite(k, CITATION, "", *d->crs ? d->crs : "unknown");
	if (system && degrees)
		put(k, GEOGRAPHIC, 0, 1, system);
	if (degrees)
		put(k, ANGULAR_UNITS, 0, 1, unit);
	if (system && !degrees)
		put(k, PROJECTED, 0, 1, system);
	else if (!system && wkt_fits(d, heights, plus != NULL))
		cite(k, PROJECTED_CITATION, "ESRI PE String = ", d->wkt);
	if (unit && !degrees)
		put(k, LINEAR_UNITS, 0, 1, unit);
	if (heights && plus && system)
		put_heights(k, plus + 3, d->unit_z);
}
