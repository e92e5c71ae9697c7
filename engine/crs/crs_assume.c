/*
 * Coordinate systems that the user states for a file without one.
 */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "crs_parts.h"
#include "err.h"

const char *crs_assume_unit(const char *text)
{
	static const struct {
		const char *text, *unit;
	} names[] = {
		{"m", "metre"},   {"metre", "metre"},         {"ft", "foot"},
		{"foot", "foot"}, {"ftUS", "us-survey-foot"}, {"us-survey-foot", "us-survey-foot"},
	};

	for (size_t i = 0; i < sizeof names / sizeof *names; i++)
		if (!strcasecmp(text, names[i].text))
			return names[i].unit;
	return NULL;
}

/* "EPSG:n", with spaces around it; 0: it is not that. */
static unsigned code_of(const char *text, size_t size)
{
	unsigned n = 0;

	while (size && text[0] == ' ')
		text++, size--;
	while (size && text[size - 1] == ' ')
		size--;
	if (size < 6 || size > 11 || strncasecmp(text, "EPSG:", 5))
		return 0;
	for (size_t i = 5; i < size; i++) {
		if (text[i] < '0' || text[i] > '9')
			return 0;
		n = n * 10 + (unsigned)(text[i] - '0');
	}
	return n;
}

static bool take_number(unsigned code, struct crs_info *ret)
{
	unsigned vertical = 0;

	if (!code)
		return false;
	crs_epsg_compound(code, &code, &vertical);
	if (!crs_epsg_system(code, ret)) {
		ret->system.epsg = code;
		crs_text_append_epsg(ret, code);
	}
	if (vertical) {
		ret->system.epsg_z = vertical;
		crs_text_append_epsg(ret, vertical);
		crs_set_unit(ret->unit_z, crs_epsg_height_unit(vertical));
	}
	return true;
}

static void take_part(const char *text, size_t size, bool vertical, struct crs_info *ret)
{
	unsigned code = code_of(text, size);

	if (!vertical) {
		if (!take_number(code ? code : crs_epsg_of_name(text, size), ret))
			crs_text_append(ret, text, size);
		return;
	}
	ret->system.epsg_z = code;
	if (code)
		crs_text_append_epsg(ret, code);
	else
		crs_text_append(ret, text, size);
	if (code)
		crs_set_unit(ret->unit_z, crs_epsg_height_unit(code));
	else
		crs_set_unit(ret->unit_z, crs_unit_of_remark(text, size));
}

/* As a name it would be taken, and the dataset be in a system that nobody knows. */
static bool is_number(const char *text, size_t size)
{
	while (size && text[size - 1] >= '0' && text[size - 1] <= '9')
		size--;
	return !size;
}

/* Half of a text: "EPSG:25832+7837" is no name, and nor is a number alone. */
static int check_half(const char *text, size_t size, struct err *err)
{
	while (size && text[0] == ' ')
		text++, size--;
	while (size && text[size - 1] == ' ')
		size--;
	if (is_number(text, size)) {
		err_set(err, ERR_USAGE, "\"%.*s\" is a number, not a coordinate system", (int)size, text);
		return err_add_hint(err, "an EPSG number is written EPSG:%.*s", (int)size, text);
	}
	if (size < 5 || strncasecmp(text, "EPSG:", 5) || code_of(text, size))
		return 0;
	err_set(err, ERR_USAGE, "\"%.*s\" is not EPSG: and a number", (int)size, text);
	return err_add_hint(err, "a compound system is written \"EPSG:25832 + EPSG:7837\"");
}

int crs_assume_text(const char *text, size_t size, struct crs_info *ret, struct err *err)
{
	const char *plus;
	struct crs_info made;

	while (size && (text[size - 1] == ' ' || text[size - 1] == '\n' || text[size - 1] == '\r' || !text[size - 1]))
		size--;
	while (size && (*text == ' ' || *text == '\n' || *text == '\r'))
		text++, size--;
	if (!size)
		return err_set(err, ERR_USAGE, "the coordinate system that is given is empty");
	crs_info_clear(&made);
	/* round brackets are WKT's too, but stand in names as well */
	if ((memchr(text, '[', size) || text[size - 1] == ')') && crs_read_wkt(text, size, ret))
		return 0;
	if (memchr(text, '[', size)) {
		err_set(err, ERR_USAGE, "the coordinate system that is given is no WKT that can be read");
		return err_add_hint(err, "give EPSG:n, or a file with a PROJCS, PROJCRS or COMPD_CS");
	}
	for (size_t i = 0; i < size; i++)
		if (text[i] < 0x20 || text[i] >= 0x7f)
			return err_set(err, ERR_USAGE, "the coordinate system that is given is not printable ASCII");
	if (size > 200) {
		err_set(err, ERR_USAGE, "the coordinate system that is given is neither a WKT nor a name");
		return err_add_hint(err, "give EPSG:n, or a file with a PROJCS, PROJCRS or COMPD_CS");
	}
	plus = memmem(text, size, " + ", 3);
	if (check_half(text, plus ? (size_t)(plus - text) : size, err) ||
	    (plus && check_half(plus + 3, size - (size_t)(plus - text) - 3, err)))
		return -(int)err->code;
	take_part(text, plus ? (size_t)(plus - text) : size, false, &made);
	if (plus)
		take_part(plus + 3, size - (size_t)(plus - text) - 3, true, &made);
	crs_info_settle(&made);
	*ret = made;
	return 0;
}

static void fill(char unit[CRS_UNIT_SIZE], const char *other)
{
	if (!*unit || crs_is_unknown(unit))
		crs_set_unit(unit, other);
}

void crs_text_units(const char *text, char unit_xy[CRS_UNIT_SIZE], char unit_z[CRS_UNIT_SIZE])
{
	struct err ignored = ERR_INIT;
	struct crs_info by_number;

	if (crs_assume_text(text, strlen(text), &by_number, &ignored))
		return;
	if (by_number.system.epsg)
		fill(unit_xy, by_number.unit_xy);
	if (by_number.system.epsg || by_number.system.epsg_z)
		fill(unit_z, by_number.unit_z);
}
