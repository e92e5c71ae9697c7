/*
 * How a file was read, as a text (GRID_SOURCE_READING, format.md), and whether a system that is said of a file is the one that it
 * has.
 *
 * Model: of a system the texts are compared, since these are what is kept; what is not said agrees with anything.
 */
#include "agree_reading.h"

#include <stdio.h>
#include <string.h>

/* ---- the text ---- */

bool agree_reading_is_text(const char *format)
{
	return !strcmp(format, "xyz");
}

void agree_reading_text(const char *format, const char *columns, bool decimal_comma, const struct crs_info *crs, char *ret,
			size_t size)
{
	bool text = agree_reading_is_text(format);
	size_t n = (size_t)snprintf(ret, size, "%.15s", format);

	if (text && *columns && n < size)
		n += (size_t)snprintf(ret + n, size - n, " columns=%.*s", AGREE_COLUMNS_MOST, columns);
	if (text && decimal_comma && n < size)
		n += (size_t)snprintf(ret + n, size - n, " decimal-comma");
	if (crs && n < size)
		snprintf(ret + n, size - n, " of %.*s, x and y in %s, z in %s", AGREE_SYSTEM_MOST, crs->text, crs->unit_xy,
			 crs->unit_z);
}

static void parse_system(const char *text, struct agree_system *ret)
{
	static const char before_xy[] = ", x and y in ", before_z[] = ", z in ";
	const char *xy = NULL, *z = NULL;

	for (const char *at = strstr(text, before_xy); at; at = strstr(at + 1, before_xy))
		xy = at;
	z = xy ? strstr(xy, before_z) : NULL;
	if (!z)
		return;
	snprintf(ret->text, sizeof ret->text, "%.*s", (int)(xy - text), text);
	xy += strlen(before_xy);
	snprintf(ret->unit_xy, sizeof ret->unit_xy, "%.*s", (int)(z - xy), xy);
	snprintf(ret->unit_z, sizeof ret->unit_z, "%s", z + strlen(before_z));
}

/* Ignores words of other versions. */
void agree_reading_parse(const char *text, struct agree_reading *ret)
{
	static const char columns[] = "columns=", comma[] = "decimal-comma", of[] = "of ";
	size_t n = strcspn(text, " ");

	memset(ret, 0, sizeof *ret);
	snprintf(ret->format, sizeof ret->format, "%.*s", (int)n, text);
	for (const char *at = text + n; *at; at += n) {
		at++;
		n = strcspn(at, " ");
		if (!strncmp(at, of, strlen(of))) {
			ret->has_system = true;
			parse_system(at + strlen(of), &ret->system);
			return;
		}
		if (!strncmp(at, columns, strlen(columns)))
			snprintf(ret->columns, sizeof ret->columns, "%.*s", (int)(n - strlen(columns)), at + strlen(columns));
		else if (n == strlen(comma) && !strncmp(at, comma, n))
			ret->decimal_comma = true;
	}
}

/* ---- systems ---- */

void agree_system_set(struct agree_system *s, const char *text, const char *unit_xy, const char *unit_z)
{
	snprintf(s->text, sizeof s->text, "%.*s", AGREE_SYSTEM_MOST, text);
	snprintf(s->unit_xy, sizeof s->unit_xy, "%.*s", CRS_UNIT_SIZE - 1, unit_xy);
	snprintf(s->unit_z, sizeof s->unit_z, "%.*s", CRS_UNIT_SIZE - 1, unit_z);
}

static bool texts_same(const char *a, const char *b)
{
	return agree_known(a) == agree_known(b) && (!agree_known(a) || !strcmp(a, b));
}

/* The assumed system is the one that the file already has. */
static bool is_consistent(const char *said, const char *has)
{
	return !agree_known(said) || !strcmp(said, has);
}

static bool halves_hold(const char *said, const char *has)
{
	char planes[2][CRS_TEXT_SIZE];
	const char *heights[2] = {crs_text_heights(said), crs_text_heights(has)};

	crs_text_plane(said, planes[0]);
	crs_text_plane(has, planes[1]);
	return is_consistent(planes[0], planes[1]) && is_consistent(heights[0] ? heights[0] : "", heights[1] ? heights[1] : "");
}

bool agree_system_holds(const struct agree_system *said, bool overrides, const struct agree_system *has)
{
	if (overrides && agree_known(said->text))
		return texts_same(said->text, has->text) && texts_same(said->unit_xy, has->unit_xy) &&
		       texts_same(said->unit_z, has->unit_z);
	return halves_hold(said->text, has->text) && is_consistent(said->unit_xy, has->unit_xy) &&
	       is_consistent(said->unit_z, has->unit_z);
}
