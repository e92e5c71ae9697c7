/*
 * How files are read, and whether a file that the dataset has was read as this push would read it.
 *
 * The model: the same bytes give other points with another format, other columns, or another coordinate system. So the manifest
 * records how each source was read: its reading (format.md), the system that its records said if that was overridden, and how
 * many lines were left out. Only what affects a file is compared: columns matter for texts only, and an assumed or overridden
 * system only has to be the one that the file has in the dataset. A source of an older manifest counts as read by default, with
 * unknown format and system.
 */
#include <stdio.h>
#include <string.h>

#include "push_priv.h"

#define COLUMNS_MOST 100 /* letters that are recorded */
#define SYSTEM_MOST 400  /* characters of a system's text that are recorded */

struct system {
	char text[SYSTEM_MOST + 1], unit_xy[CRS_UNIT_SIZE], unit_z[CRS_UNIT_SIZE];
};

/* GRID_SOURCE_READING in parts. */
struct reading {
	char format[16], columns[COLUMNS_MOST + 1];
	bool decimal_comma;
	bool has_system;
	struct system system;
};

/* The difference in words: of the source, of the push. */
enum { DIFFERENCE_SIZE = 600 };
struct difference {
	char was[DIFFERENCE_SIZE], is[DIFFERENCE_SIZE];
};

static bool is_text(const char *format)
{
	return !strcmp(format, "xyz");
}

/* ---- the recorded text ---- */

/* After a projection, or a shift by a geoid, the dataset's system is not the file's. */
static bool needs_system(const struct push *p, const struct crs_info *crs)
{
	return crs->plane == CRS_PLANE_GEOGRAPHIC || *p->plane.geoid;
}

void push_reading_text(const struct push *p, const struct push_request *rq, char ret[GRID_SOURCE_READING])
{
	const struct crs_info *crs = &rq->info.crs;
	bool text = is_text(rq->info.format);
	int n = snprintf(ret, GRID_SOURCE_READING, "%.15s", rq->info.format);

	if (text && *rq->columns)
		n += snprintf(ret + n, GRID_SOURCE_READING - (size_t)n, " columns=%.*s", COLUMNS_MOST, rq->columns);
	if (text && rq->decimal_comma)
		n += snprintf(ret + n, GRID_SOURCE_READING - (size_t)n, " decimal-comma");
	if (needs_system(p, crs))
		snprintf(ret + n, GRID_SOURCE_READING - (size_t)n, " of %.*s, x and y in %s, z in %s", SYSTEM_MOST, crs->text,
			 crs->unit_xy, crs->unit_z);
}

static void parse_system(const char *text, struct system *ret)
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
static void reading_parse(const char *text, struct reading *ret)
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

/* ---- format and columns ---- */

static bool letters_differ(const struct push *p, const struct push_request *rq, const struct grid_source *s,
			   const struct reading *r, struct difference *ret)
{
	const char *was = *s->reading ? "the columns that it says itself" :
					"the columns that it says itself (an older acut kept no others)";
	bool text = is_text(r->format) || !*r->format;

	if (*rq->format && *r->format && strcmp(rq->format, r->format)) {
		snprintf(ret->was, sizeof ret->was, "format %s", r->format);
		snprintf(ret->is, sizeof ret->is, "--input-format %.15s", rq->format);
	} else if (text && strncmp(rq->columns, r->columns, COLUMNS_MOST)) {
		snprintf(ret->was, sizeof ret->was, "%s%s", *r->columns ? "--columns " : was, r->columns);
		snprintf(ret->is, sizeof ret->is, "%s%.*s", *rq->columns ? "--columns " : "the columns that it says itself",
			 COLUMNS_MOST, rq->columns);
	} else if (text && rq->decimal_comma != r->decimal_comma) {
		snprintf(ret->was, sizeof ret->was, "decimal %s", r->decimal_comma ? "commas" : "points");
		snprintf(ret->is, sizeof ret->is, "decimal %s", rq->decimal_comma ? "commas" : "points");
	} else if (p->strict && s->left_out) {
		snprintf(ret->was, sizeof ret->was, "%llu of its lines left out", (unsigned long long)s->left_out);
		snprintf(ret->is, sizeof ret->is, "--strict, which leaves none out");
	} else {
		return false;
	}
	return true;
}

/* ---- coordinate system ---- */

static void describe(const struct system *s, const char *how, char ret[DIFFERENCE_SIZE])
{
	snprintf(ret, DIFFERENCE_SIZE, "the system %s, x and y in %s, z in %s%s", s->text, s->unit_xy, s->unit_z, how);
}

static void set_system(struct system *s, const char *text, const char *unit_xy, const char *unit_z)
{
	snprintf(s->text, sizeof s->text, "%.*s", SYSTEM_MOST, text);
	snprintf(s->unit_xy, sizeof s->unit_xy, "%.*s", CRS_UNIT_SIZE - 1, unit_xy);
	snprintf(s->unit_z, sizeof s->unit_z, "%.*s", CRS_UNIT_SIZE - 1, unit_z);
}

static bool texts_same(const char *a, const char *b)
{
	return push_crs_known(a) == push_crs_known(b) && (!push_crs_known(a) || !strcmp(a, b));
}

/* The assumed system is the one that the file already has. */
static bool is_consistent(const char *said, const char *has)
{
	return !push_crs_known(said) || !strcmp(said, has);
}

static bool halves_hold(const char *said, const char *has)
{
	char planes[2][CRS_TEXT_SIZE];
	const char *heights[2] = {crs_text_heights(said), crs_text_heights(has)};

	crs_text_plane(said, planes[0]);
	crs_text_plane(has, planes[1]);
	return is_consistent(planes[0], planes[1]) && is_consistent(heights[0] ? heights[0] : "", heights[1] ? heights[1] : "");
}

/* With this push's assumptions or overrides the file would have the system that it has. */
static bool system_holds(const struct push *p, const struct system *said, const struct system *has)
{
	if (p->overrides && push_crs_known(said->text))
		return texts_same(said->text, has->text) && texts_same(said->unit_xy, has->unit_xy) &&
		       texts_same(said->unit_z, has->unit_z);
	return halves_hold(said->text, has->text) && is_consistent(said->unit_xy, has->unit_xy) &&
	       is_consistent(said->unit_z, has->unit_z);
}

static bool system_differs(const struct push *p, const struct grid_source *s, const struct reading *r, struct difference *ret)
{
	struct system said, has = r->system;

	/* Older manifests do not record the system of degrees. */
	if (!*s->reading && (*p->plane.geoid || p->assume.plane == CRS_PLANE_GEOGRAPHIC))
		return false;
	set_system(&said, p->assume.text, p->assume.unit_xy, p->assume.unit_z);
	if (!r->has_system)
		set_system(&has, p->crs, p->unit_xy, p->unit_z);
	describe(&has, "", ret->was);
	if (*s->overridden && !p->overrides) {
		snprintf(ret->is, sizeof ret->is, "what it says itself (%.500s)", s->overridden);
		return true;
	}
	describe(&said, p->overrides ? ", in place of what it says itself" : ", assumed where it says nothing", ret->is);
	return (p->overrides || p->assumes) && !system_holds(p, &said, &has);
}

/* Degrees were projected, and --planar would not project them. */
static bool plane_differs(const struct push *p, const struct reading *r, struct difference *ret)
{
	char planes[2][CRS_TEXT_SIZE];

	crs_text_plane(r->system.text, planes[0]);
	crs_text_plane(p->crs, planes[1]);
	if (!p->planar || strcmp(r->system.unit_xy, "degree") || !strcmp(planes[0], planes[1]))
		return false;
	snprintf(ret->was, sizeof ret->was, "its degrees projected");
	snprintf(ret->is, sizeof ret->is, "--planar");
	return true;
}

static bool differs(const struct push *p, const struct push_request *rq, const struct grid_source *s, struct difference *ret)
{
	struct reading r;

	reading_parse(s->reading, &r);
	return letters_differ(p, rq, s, &r, ret) || plane_differs(p, &r, ret) || system_differs(p, s, &r, ret);
}

bool push_reading_same(const struct push *p, const struct push_request *rq, const struct grid_source *s)
{
	struct difference unused;

	return !differs(p, rq, s, &unused);
}

int push_reading_refuse(const struct push *p, struct push_request *rq, const struct grid_source *s)
{
	struct difference d = {"", ""};

	differs(p, rq, s, &d);
	err_set(&rq->err, ERR_INPUT,
		"the dataset %s has this file already, as %.100s, read with %.125s; this push would read it with %.125s",
		p->dataset->name, s->name, d.was, d.is);
	err_add_place(&rq->err, ERR_NO_OFFSET, "reading");
	return err_add_hint(
		&rq->err,
		"--replace reads it again, in place of the old one%s; --add takes it beside the old one; otherwise push it with the "
		"options that it was read with",
		strcmp(s->path, rq->path) ? " of its path" : "");
}

/* ---- the reading of a pending push ---- */

/* The reading of one file, from the parameters of its request. */
static void reading_text(const struct push_request *rq, char ret[PUSH_READING_SIZE])
{
	snprintf(ret, PUSH_READING_SIZE, "%.16s:%.40s%s%s", rq->format, rq->columns, rq->decimal_comma ? ":," : "",
		 rq->push->strict ? ":!" : "");
}

void push_note_reading(struct push *p, const struct push_request *rq)
{
	char text[PUSH_READING_SIZE];

	reading_text(rq, text);
	if (!*p->reading)
		memcpy(p->reading, text, sizeof text);
	else if (strcmp(p->reading, text))
		snprintf(p->reading, sizeof p->reading, "several"); /* matches no file */
}

bool push_same_reading(const struct push *p, const struct push_request *rq)
{
	char text[PUSH_READING_SIZE];

	reading_text(rq, text);
	return !strcmp(p->reading, text);
}
