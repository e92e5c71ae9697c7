/*
 * Units and texts of coordinate systems, and the choice between the two kinds of record.
 *
 * Model: each kind of record is read alone (crs_geokeys.c, crs_wkt.c) into a crs_info that starts as all
 * unknown; here the two answers become one. Not here: any transformation.
 */
#include "crs.h"
#include "crs_parts.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

const char crs_unknown[] = "unknown";

void crs_info_clear(struct crs_info *info)
{
	memset(info, 0, sizeof *info);
	info->plane = CRS_PLANE_UNKNOWN;
	crs_set_unit(info->unit_xy, crs_unknown);
	crs_set_unit(info->unit_z, crs_unknown);
	snprintf(info->text, sizeof info->text, "%s", crs_unknown);
}

bool crs_is_unknown(const char *text)
{
	return !strcmp(text, crs_unknown);
}

/* ---- units ---- */

void crs_set_unit(char unit[CRS_UNIT_SIZE], const char *name)
{
	snprintf(unit, CRS_UNIT_SIZE, "%s", name);
}

/* Exact: *num / *den metres. */
static bool unit_ratio(const char *name, int64_t *num, int64_t *den)
{
	static const struct {
		const char *name;
		int64_t num, den;
	} table[] = {
		{"metre", 1, 1},
		{"foot", 381, 1250},
		{"us-survey-foot", 1200, 3937},
	};

	for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
		if (strcmp(name, table[i].name))
			continue;
		*num = table[i].num;
		*den = table[i].den;
		return true;
	}
	return false;
}

double crs_unit_metres(const char *name)
{
	int64_t num, den;

	return unit_ratio(name, &num, &den) ? (double)num / (double)den : 0;
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

const char *crs_unit_of_remark(const char *text, size_t size)
{
	/* EPSG ends the names of its systems so; "(ft)" is the international foot there. */
	static const struct {
		const char *ending, *unit;
	} endings[] = {
		{"(m)", "metre"},
		{"(ft)", "foot"},
		{"(ftus)", "us-survey-foot"},
	};
	static const struct {
		const char *word, *unit;
	} words[] = {
		{"ussurveyf", "us-survey-foot"},
		{"surveyfoot", "us-survey-foot"},
		{"surveyfeet", "us-survey-foot"},
		{"footus", "us-survey-foot"},
		{"feetus", "us-survey-foot"},
		{"ftus", "us-survey-foot"},
		{"usft", "us-survey-foot"},
		{"usfeet", "us-survey-foot"},
		{"usfoot", "us-survey-foot"},
		{"internationalf", "foot"},
		{"intlf", "foot"},
		{"metre", "metre"},
		{"meter", "metre"},
	};
	char plain[CRS_TEXT_SIZE];
	const char *found = NULL;

	while (size && text[size - 1] == ' ')
		size--;
	for (size_t i = 0; i < sizeof endings / sizeof *endings; i++) {
		size_t n = strlen(endings[i].ending);

		if (size >= n && !strncasecmp(text + size - n, endings[i].ending, n))
			return endings[i].unit;
	}
	crs_text_plain((struct crs_span){text, size}, plain, sizeof plain);
	for (size_t i = 0; i < sizeof words / sizeof *words; i++) {
		if (!strstr(plain, words[i].word))
			continue;
		if (found && strcmp(found, words[i].unit))
			return crs_unknown;
		found = words[i].unit;
	}
	return found ? found : crs_unknown;
}

/* ---- texts ---- */

void crs_text_append(struct crs_info *info, const char *text, size_t size)
{
	size_t n;

	if (!size)
		return;
	if (crs_is_unknown(info->text))
		info->text[0] = 0;
	n = strlen(info->text);
	if (n)
		n += (size_t)snprintf(info->text + n, sizeof info->text - n, " + ");
	for (size_t i = 0; i < size && n + 1 < sizeof info->text; i++) {
		char c = text[i] >= 0x20 && text[i] < 0x7f ? text[i] : '?';

		/* " + " tells the parts apart and must not stand in one of them */
		if (c == '+' && i && text[i - 1] == ' ')
			c = '&';
		info->text[n++] = c;
	}
	info->text[n < sizeof info->text ? n : sizeof info->text - 1] = 0;
}

void crs_text_append_epsg(struct crs_info *info, unsigned code)
{
	char text[24];

	crs_text_append(info, text, (size_t)snprintf(text, sizeof text, "EPSG:%u", code));
}

char *crs_text_plain(struct crs_span name, char *buf, size_t size)
{
	size_t n = 0;

	for (size_t i = 0; i < name.size && n + 1 < size; i++) {
		unsigned char c = (unsigned char)name.at[i];

		if (c < 0x80 && isalnum(c))
			buf[n++] = (char)tolower(c);
	}
	buf[n] = 0;
	return buf;
}

/* ---- one answer ---- */

void crs_info_settle(struct crs_info *info)
{
	struct crs_system *s = &info->system;

	if (info->plane == CRS_PLANE_GEOGRAPHIC)
		s->unit = strcmp(info->unit_xy, "degree") ? 0 : 1;
	else
		s->unit = crs_unit_metres(info->unit_xy);
	s->unit_z = crs_unit_metres(info->unit_z);
	if (s->a == 0 || (info->plane != CRS_PLANE_PROJECTED && info->plane != CRS_PLANE_GEOGRAPHIC))
		s->method = CRS_METHOD_UNKNOWN;
	if (s->method == CRS_METHOD_UNKNOWN) {
		s->lat0 = s->lon0 = s->lat1 = s->lat2 = 0;
		s->k0 = s->x0 = s->y0 = 0;
	}
}

const char *crs_text_heights(const char *text)
{
	return strstr(text, " + ");
}

void crs_text_plane(const char *text, char ret[CRS_TEXT_SIZE])
{
	const char *heights = crs_text_heights(text);

	snprintf(ret, CRS_TEXT_SIZE, "%.*s", (int)(heights ? (size_t)(heights - text) : strlen(text)), text);
}

static void fill_system(struct crs_system *s, const struct crs_system *other, bool same_name)
{
	if (!s->epsg)
		s->epsg = other->epsg;
	if (!s->datum[0])
		memcpy(s->datum, other->datum, sizeof s->datum);
	/* Only of the same system, or what the other says would be mixed with what this one says. */
	if (s->method == CRS_METHOD_UNKNOWN && (same_name || !s->a)) {
		struct crs_system mine = *s;

		*s = *other;
		s->epsg = mine.epsg;
		s->epsg_z = mine.epsg_z;
		memcpy(s->datum, mine.datum, sizeof s->datum);
	}
}

static void fill_open(struct crs_info *info, const struct crs_info *other)
{
	bool named = !crs_is_unknown(info->text), same_name = named && !strcmp(info->text, other->text);

	if (info->plane != other->plane)
		return;
	if (crs_is_unknown(info->unit_xy))
		crs_set_unit(info->unit_xy, other->unit_xy);
	if (crs_is_unknown(info->unit_z))
		crs_set_unit(info->unit_z, other->unit_z);
	if (!named || (!crs_text_heights(info->text) && crs_text_heights(other->text) &&
		       !strncmp(info->text, other->text, strlen(info->text)))) {
		memcpy(info->text, other->text, sizeof info->text);
		if (!info->system.epsg_z)
			info->system.epsg_z = other->system.epsg_z;
	}
	if (!named || same_name)
		fill_system(&info->system, &other->system, same_name);
	crs_info_settle(info);
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
