/*
 * The table of output formats. A new format is one file and one row here (HACKING.md); everything else,
 * the help text, `acutctl formats` and the contract tests included, reads this table.
 */
#include <string.h>
#include <strings.h>

#include "format.h"

extern const struct format format_ply, format_obj, format_landxml, format_dxf, format_glb, format_stl, format_html, format_png,
	format_tif, format_gpkg, format_geojson, format_dxf_contours, format_null;

static const struct format *const row[] = {&format_ply,     &format_obj,          &format_landxml, &format_dxf, &format_glb,
					   &format_stl,     &format_html,         &format_png,     &format_tif, &format_gpkg,
					   &format_geojson, &format_dxf_contours, &format_null};

const struct format *const *format_rows(size_t *ret_n)
{
	*ret_n = sizeof(row) / sizeof(row[0]);
	return row;
}

const struct format *format_find(const char *name)
{
	for (size_t i = 0; i < sizeof(row) / sizeof(row[0]); i++)
		if (!strcasecmp(row[i]->name, name))
			return row[i];
	return NULL;
}

bool format_has_extension(const char *list, const char *ext)
{
	size_t n = strlen(ext);

	for (const char *at = list; *at; at += strspn(at, " ")) {
		size_t m = strcspn(at, " ");
		if (m == n && !strncasecmp(at, ext, n))
			return true;
		at += m;
	}
	return false;
}

const char *format_extension(const char *path)
{
	const char *base = strrchr(path, '/');

	return strrchr(base ? base : path, '.');
}

const struct format *format_by_path(const char *path)
{
	const char *dot = format_extension(path);

	if (!dot)
		return NULL;
	for (size_t i = 0; i < sizeof(row) / sizeof(row[0]); i++)
		if (format_has_extension(row[i]->extensions, dot))
			return row[i];
	return NULL;
}

bool format_parse_color(const char *text, enum format_color *ret, bool *ret_lines)
{
	static const char *const name[] = {"hillshade", "elevation", "domain"};
	const char *plus = strchr(text, '+');
	size_t n = plus ? (size_t)(plus - text) : strlen(text);

	for (unsigned i = 0; i < 3; i++) {
		if (strlen(name[i]) == n && !memcmp(text, name[i], n) && (!plus || !strcmp(plus, "+lines"))) {
			*ret = (enum format_color)i;
			*ret_lines = plus;
			return true;
		}
	}
	return false;
}

bool format_parse_raster(const char *text, enum format_rasters *ret)
{
	static const char *const name[] = {"elevation", "slope", "hillshade"};

	for (unsigned i = 0; i < 3; i++) {
		if (!strcmp(text, name[i])) {
			*ret = (enum format_rasters)i;
			return true;
		}
	}
	return false;
}

unsigned format_options_given(const struct format_options *opt)
{
	return (opt->canonical ? FORMAT_CANONICAL : 0) | (opt->has_origin || opt->origin_auto ? FORMAT_ORIGIN : 0) |
	       (opt->z_unit ? FORMAT_Z_UNIT : 0) | (opt->width ? FORMAT_SIZED : 0) | (opt->color ? FORMAT_COLORED : 0) |
	       (opt->polyface ? FORMAT_POLYFACE : 0) | (opt->cell.mantissa ? FORMAT_CELL : 0) |
	       (opt->raster ? FORMAT_RASTERED : 0) | (opt->interval.mantissa ? FORMAT_INTERVAL : 0) |
	       (opt->has_base ? FORMAT_BASE : 0) | (opt->has_index ? FORMAT_INDEX : 0) |
	       (opt->simplify.mantissa ? FORMAT_SIMPLIFY : 0);
}

const char *format_option_name(unsigned options)
{
	static const char *const name[] = {"canonical", "origin", "z-unit",   "width", "color", "polyface",
					   "cell",      "raster", "interval", "base",  "index", "simplify"};

	return options ? name[__builtin_ctz(options)] : NULL;
}
