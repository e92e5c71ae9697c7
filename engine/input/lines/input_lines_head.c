/*
 * The rows of a text of lines that stand before its features: coordinate system, units, and what shall be done with all lines.
 *
 * Model: they are read while the input is opened, into its info. Reading it again for the vertices skips them.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "input_lines_parts.h"

static int twice(struct input *in, const struct input_lines_row *row, struct err *err)
{
	return input_lines_bad(in, row, "it stands there already", "leave one of the two rows out", err);
}

static int read_crs(struct input *in, const struct input_lines_row *row, struct err *err)
{
	struct input_lines_state *s = input_lines_of(in);
	size_t n = (size_t)(row->rest.end - row->rest.at);
	struct crs_info units = in->info.crs;
	struct err why = ERR_INIT;

	if (s->has_crs)
		return twice(in, row, err);
	s->has_crs = true;
	if (crs_assume_text(row->rest.at, n, &in->info.crs, &why))
		return input_lines_bad(in, row, why.message, why.hint[0] ? why.hint : "as --assume-crs: EPSG:25832, or a WKT",
				       err);
	if ((s->has_xy && strcmp(in->info.crs.unit_xy, "unknown") && strcmp(in->info.crs.unit_xy, units.unit_xy)) ||
	    (s->has_z && strcmp(in->info.crs.unit_z, "unknown") && strcmp(in->info.crs.unit_z, units.unit_z)))
		return input_lines_bad(in, row, "it has other units than those above", "leave the units out", err);
	if (s->has_xy)
		memcpy(in->info.crs.unit_xy, units.unit_xy, sizeof units.unit_xy);
	if (s->has_z)
		memcpy(in->info.crs.unit_z, units.unit_z, sizeof units.unit_z);
	in->wkt = malloc(CRS_WKT_MAX + 1);
	if (!in->wkt) {
		err_set(err, ERR_NOMEM, "no memory for a coordinate system");
		return err_add_file(err, in->name);
	}
	if (n > CRS_WKT_MAX || !crs_wkt_normal(row->rest.at, n, in->wkt))
		*in->wkt = 0;
	return 0;
}

static int read_unit(struct input *in, const struct input_lines_row *row, bool *has, char ret[CRS_UNIT_SIZE], struct err *err)
{
	char text[32];
	const char *unit;

	if (*has)
		return twice(in, row, err);
	*has = true;
	snprintf(text, sizeof text, "%.*s", (int)(row->rest.end - row->rest.at < 31 ? row->rest.end - row->rest.at : 31),
		 row->rest.at);
	unit = crs_assume_unit(text);
	if (!unit)
		return input_lines_bad(in, row, "this is no unit", "m, ft or ftUS", err);
	if (strcmp(ret, "unknown") && strcmp(ret, unit))
		return input_lines_bad(in, row, "the coordinate system above has another unit", "leave the unit out", err);
	snprintf(ret, CRS_UNIT_SIZE, "%s", unit);
	return 0;
}

static int read_densify(struct input *in, const struct input_lines_row *row, struct err *err)
{
	struct input_lines *lines = &in->info.lines;
	const char *p = row->rest.at;
	struct input_number n;
	char text[32];
	const char *unit;

	if (lines->densify.mantissa)
		return twice(in, row, err);
	if (input_number_read(&p, row->rest.end, &n) != INPUT_NUMBER_OK || n.deep || n.mantissa <= 0)
		return input_lines_bad(in, row, "this is no length", "a number above 0, perhaps with a unit: densify 5 m", err);
	while (p < row->rest.end && (*p == ' ' || *p == '\t'))
		p++;
	snprintf(text, sizeof text, "%.*s", (int)(row->rest.end - p < 31 ? row->rest.end - p : 31), p);
	unit = *text ? crs_assume_unit(text) : "";
	if (!unit || (*unit && !crs_unit_metres(unit)))
		return input_lines_bad(in, row, "this is no length", "m, ft or ftUS behind the number", err);
	lines->densify = (struct decimal){n.mantissa, n.exponent};
	snprintf(lines->densify_unit, sizeof lines->densify_unit, "%s", unit);
	return 0;
}

static int read_level(struct input *in, const struct input_lines_row *row, struct err *err)
{
	struct input_lines *lines = &in->info.lines;

	if (lines->level != INPUT_LEVEL_NONE)
		return twice(in, row, err);
	if (input_lines_is(row->rest, "min"))
		lines->level = INPUT_LEVEL_MIN;
	else if (input_lines_is(row->rest, "max"))
		lines->level = INPUT_LEVEL_MAX;
	else if (input_lines_is(row->rest, "mean"))
		lines->level = INPUT_LEVEL_MEAN;
	else
		return input_lines_bad(in, row, "this is no level of lakes", "min, max or mean", err);
	return 0;
}

int input_lines_head(struct input *in, const struct input_lines_row *row, bool *ret_known, struct err *err)
{
	struct input_lines_state *s = input_lines_of(in);
	enum { CRS, UNIT, UNIT_Z, DENSIFY, LEVEL, WORDS } word = 0;
	static const char *const words[WORDS] = {"crs", "unit", "unit-z", "densify", "lake-level"};

	while (word < WORDS && !input_lines_is(row->word, words[word]))
		word++;
	*ret_known = word < WORDS;
	if (*ret_known && s->feature_row)
		return input_lines_bad(in, row, "it stands behind the first feature", "it belongs before all features", err);
	if (!*ret_known || !s->probing)
		return 0;
	switch (word) {
	case CRS:
		return read_crs(in, row, err);
	case UNIT:
		return read_unit(in, row, &s->has_xy, in->info.crs.unit_xy, err);
	case UNIT_Z:
		return read_unit(in, row, &s->has_z, in->info.crs.unit_z, err);
	case DENSIFY:
		return read_densify(in, row, err);
	case LEVEL:
		return read_level(in, row, err);
	default:
		return 0;
	}
}

void input_lines_head_end(struct input *in)
{
	crs_info_settle(&in->info.crs);
}
