/*
 * Units and texts of coordinate systems, and the choice between the two kinds of record.
 *
 * Model: each kind of record is read alone (crs_geokeys.c, crs_wkt.c) into a crs_info that starts as all
 * unknown; here the two answers become one. Not here: any transformation, any list of systems.
 */
#include "crs.h"
#include "crs_parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

const char crs_unknown[] = "unknown";

void crs_info_clear(struct crs_info *info)
{
	memset(info, 0, sizeof *info);
	info->plane = CRS_PLANE_UNKNOWN;
	crs_set_unit(info->unit_xy, crs_unknown);
	crs_set_unit(info->unit_z, crs_unknown);
	snprintf(info->text, sizeof info->text, "%s", crs_unknown);
}

void crs_set_unit(char unit[CRS_UNIT_SIZE], const char *name)
{
	snprintf(unit, CRS_UNIT_SIZE, "%s", name);
}

/* Writers print the US survey foot (1200/3937 m, EPSG 9003) with 7 to 17 digits; it differs from the
 * international foot by 6.1e-7 m, so 2e-8 tells them apart safely. */
const char *crs_unit_of_length(double factor)
{
	if (factor == 1.0)
		return "metre";
	if (fabs(factor - 0.3048) < 1e-10)
		return "foot";
	if (fabs(factor - 1200.0 / 3937.0) < 2e-8)
		return "us-survey-foot";
	return crs_unknown;
}

const char *crs_unit_of_angle(double factor)
{
	return fabs(factor - 0.017453292519943295) < 1e-12 ? "degree" : crs_unknown;
}

const char *crs_unit_of_epsg(unsigned code)
{
	switch (code) {
	case 9001:
		return "metre";
	case 9002:
		return "foot";
	case 9003:
		return "us-survey-foot";
	case 9102:
	case 9122: /* degree, representation left to the supplier */
		return "degree";
	default:
		return crs_unknown;
	}
}

/* EPSG defines these systems in metres (or in the unit said); that is a fact, not a guess. The list is
 * deliberately short: UTM of the common datums, and vertical systems seen in survey files. */
const char *crs_unit_of_system(unsigned epsg)
{
	static const struct { unsigned first, last; const char *unit; } table[] = {
		{ 2154, 2154, "metre" },    /* RGF93 / Lambert-93 */
		{ 3857, 3857, "metre" },    /* Pseudo-Mercator */
		{ 5703, 5703, "metre" },    /* NAVD88 height */
		{ 5773, 5773, "metre" },    /* EGM96 height */
		{ 6360, 6360, "us-survey-foot" }, /* NAVD88 height (ftUS) */
		{ 8228, 8228, "foot" },     /* NAVD88 height (ft) */
		{ 25828, 25838, "metre" },  /* ETRS89 / UTM */
		{ 26901, 26923, "metre" },  /* NAD83 / UTM north */
		{ 32601, 32660, "metre" },  /* WGS 84 / UTM north */
		{ 32701, 32760, "metre" },  /* WGS 84 / UTM south */
	};

	for (size_t i = 0; i < sizeof table / sizeof *table; i++)
		if (epsg >= table[i].first && epsg <= table[i].last)
			return table[i].unit;
	return crs_unknown;
}

void crs_text_append(struct crs_info *info, const char *separator, const char *text, size_t size)
{
	size_t n;

	if (!size)
		return;
	if (!strcmp(info->text, crs_unknown))
		info->text[0] = 0;
	n = strlen(info->text);
	if (n)
		n += (size_t)snprintf(info->text + n, sizeof info->text - n, "%s", separator);
	for (size_t i = 0; i < size && n + 1 < sizeof info->text; i++)
		info->text[n++] = text[i] >= 0x20 && text[i] < 0x7f ? text[i] : '?';
	info->text[n < sizeof info->text ? n : sizeof info->text - 1] = 0;
}

static void fill_open(struct crs_info *info, const struct crs_info *other)
{
	if (info->plane != other->plane)
		return;
	if (!strcmp(info->unit_xy, crs_unknown))
		crs_set_unit(info->unit_xy, other->unit_xy);
	if (!strcmp(info->unit_z, crs_unknown))
		crs_set_unit(info->unit_z, other->unit_z);
	if (!strcmp(info->text, crs_unknown))
		memcpy(info->text, other->text, sizeof info->text);
}

void crs_read(const struct crs_records *records, struct crs_info *ret)
{
	struct crs_info keys, wkt;
	bool has_keys = crs_read_geokeys(records, &keys);
	bool has_wkt = crs_read_wkt(records->wkt.at, records->wkt.size, &wkt);
	bool wkt_first = has_wkt && (records->prefer_wkt || !has_keys);
	const struct crs_info *first = wkt_first ? &wkt : &keys, *second = wkt_first ? &keys : &wkt;

	/* Keys that leave the plane open are no answer where the WKT has one, and the reverse. */
	if (first->plane == CRS_PLANE_UNKNOWN && second->plane != CRS_PLANE_UNKNOWN) {
		const struct crs_info *swap = first;

		first = second;
		second = swap;
	}
	*ret = *first;
	fill_open(ret, second);
}
