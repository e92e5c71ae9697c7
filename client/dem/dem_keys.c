/*
 * GeoKeys: what the mesh says of its system ("EPSG:2154", "EPSG:2154 + EPSG:5720", a name, "unknown") and of its units.
 *
 * A number is written only where it is certain: the plane's kind follows from its unit, and the vertical number is that of the
 * heights as they are written. All else is a citation, with the units that are known. The directory is that of GeoTIFF 1.1: GDAL
 * reads vertical systems of no earlier one.
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
	LINEAR_UNITS = 3076,
	VERTICAL = 4096,
	VERTICAL_UNITS = 4099,
	USER_DEFINED = 32767,
	ASCII_TAG = 34737,
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

void dem_keys_make(struct dem_keys *k, const struct dem *d)
{
	const char *plus = strstr(d->crs, " + ");
	size_t n = plus ? (size_t)(plus - d->crs) : strlen(d->crs);
	unsigned unit = unit_number(d->unit_xy), unit_z = unit_number(d->unit_z), system = unit ? epsg_of(d->crs, n) : 0;
	bool heights = d->opt.kind == DEM_ELEVATION && !d->opt.z_converted;
	unsigned vertical = heights && plus && system ? epsg_of(plus + 3, strlen(plus + 3)) : 0;
	bool degrees = unit == 9102;

	*k = (struct dem_keys){.key = {1, 1, 1, 0}, .n = 4};
	snprintf(k->text, sizeof(k->text), "%s|", *d->crs ? d->crs : "unknown");
	for (char *at = k->text; at[1]; at++)
		*at = *at == '|' ? '/' : *at;
	put(k, MODEL_TYPE, 0, 1, system ? (degrees ? 2 : 1) : USER_DEFINED);
	put(k, RASTER_TYPE, 0, 1, 1);
	put(k, CITATION, ASCII_TAG, (unsigned)strlen(k->text), 0);
	if (system && degrees)
		put(k, GEOGRAPHIC, 0, 1, system);
	if (degrees)
		put(k, ANGULAR_UNITS, 0, 1, unit);
	if (system && !degrees)
		put(k, PROJECTED, 0, 1, system);
	if (unit && !degrees)
		put(k, LINEAR_UNITS, 0, 1, unit);
	if (vertical)
		put(k, VERTICAL, 0, 1, vertical);
	if (vertical && unit_z)
		put(k, VERTICAL_UNITS, 0, 1, unit_z);
}
