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

enum { CODE_DIGITS = 6 };

/* "EPSG:n", or n if that is a number too, with spaces around it; 0: it is not that. */
static unsigned code_of(const char *text, size_t size, bool bare)
{
	unsigned n = 0;
	size_t i;

	while (size && text[0] == ' ')
		text++, size--;
	while (size && text[size - 1] == ' ')
		size--;
	i = size > 5 && !strncasecmp(text, "EPSG:", 5) ? 5 : 0;
	if ((!i && !bare) || size - i > CODE_DIGITS)
		return 0;
	for (; i < size; i++) {
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

static void take_part(const char *text, size_t size, bool vertical, bool bare, struct crs_info *ret)
{
	unsigned code = code_of(text, size, bare);

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

static bool is_number(const char *text, size_t size)
{
	while (size && text[size - 1] >= '0' && text[size - 1] <= '9')
		size--;
	return !size;
}

/* Half of a text: "EPSG:25832+7837" is no name. A number that nobody knows would make a dataset in a system that nobody knows. */
static int check_half(const char *text, size_t size, bool vertical, struct err *err)
{
	unsigned code;

	while (size && text[0] == ' ')
		text++, size--;
	while (size && text[size - 1] == ' ')
		size--;
	code = code_of(text, size, true);
	if (code && !crs_epsg_known(code, vertical)) {
		err_set(err, ERR_USAGE, "EPSG:%u is no system that acut knows of EPSG", code);
		return err_add_hint(err, "check the number, or give the system as WKT, which may be in a file");
	}
	if (code || (!is_number(text, size) && (size < 5 || strncasecmp(text, "EPSG:", 5))))
		return 0;
	err_set(err, ERR_USAGE, "\"%.*s\" is not EPSG: and a number", (int)size, text);
	return err_add_hint(err, "a compound system is written \"EPSG:25832 + EPSG:7837\"");
}

static void take_halves(const char *text, size_t size, bool bare, struct crs_info *ret)
{
	const char *plus = memmem(text, size, " + ", 3);

	crs_info_clear(ret);
	take_part(text, plus ? (size_t)(plus - text) : size, false, bare, ret);
	if (plus)
		take_part(plus + 3, size - (size_t)(plus - text) - 3, true, bare, ret);
	crs_info_settle(ret);
}

int crs_assume_text(const char *text, size_t size, struct crs_info *ret, struct err *err)
{
	const char *plus;

	while (size && (text[size - 1] == ' ' || text[size - 1] == '\n' || text[size - 1] == '\r' || !text[size - 1]))
		size--;
	while (size && (*text == ' ' || *text == '\n' || *text == '\r'))
		text++, size--;
	if (!size)
		return err_set(err, ERR_USAGE, "the coordinate system that is given is empty");
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
	if (check_half(text, plus ? (size_t)(plus - text) : size, false, err) ||
	    (plus && check_half(plus + 3, size - (size_t)(plus - text) - 3, true, err)))
		return -(int)err->code;
	take_halves(text, size, true, ret);
	return 0;
}

static void fill(char unit[CRS_UNIT_SIZE], const char *other)
{
	if (!*unit || crs_is_unknown(unit))
		crs_set_unit(unit, other);
}

void crs_text_units(const char *text, char unit_xy[CRS_UNIT_SIZE], char unit_z[CRS_UNIT_SIZE])
{
	struct crs_info by_number;

	/* in one of before a number is a name */
	take_halves(text, strlen(text), false, &by_number);
	if (by_number.system.epsg)
		fill(unit_xy, by_number.unit_xy);
	if (by_number.system.epsg || by_number.system.epsg_z)
		fill(unit_z, by_number.unit_z);
}
