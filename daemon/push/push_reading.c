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

#include "agree_reading.h"
#include "push_priv.h"

/* The difference in words: of the source, of the push. */
enum { DIFFERENCE_SIZE = 600 };
struct difference {
	char was[DIFFERENCE_SIZE], is[DIFFERENCE_SIZE];
};

/* ---- format and columns ---- */

static bool letters_differ(const struct push *p, const struct push_request *rq, const struct grid_source *s,
			   const struct agree_reading *r, struct difference *ret)
{
	const char *was = *s->reading ? "the columns that it says itself" :
					"the columns that it says itself (an older acut kept no others)";
	bool text = agree_reading_is_text(r->format) || !*r->format;

	if (*rq->format && *r->format && strcmp(rq->format, r->format)) {
		snprintf(ret->was, sizeof ret->was, "format %s", r->format);
		snprintf(ret->is, sizeof ret->is, "--input-format %.15s", rq->format);
	} else if (text && strncmp(rq->columns, r->columns, AGREE_COLUMNS_MOST)) {
		snprintf(ret->was, sizeof ret->was, "%s%s", *r->columns ? "--columns " : was, r->columns);
		snprintf(ret->is, sizeof ret->is, "%s%.*s", *rq->columns ? "--columns " : "the columns that it says itself",
			 AGREE_COLUMNS_MOST, rq->columns);
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

static void describe(const struct agree_system *s, const char *how, char ret[DIFFERENCE_SIZE])
{
	snprintf(ret, DIFFERENCE_SIZE, "the system %s, x and y in %s, z in %s%s", s->text, s->unit_xy, s->unit_z, how);
}

static bool system_differs(const struct push *p, const struct grid_source *s, const struct agree_reading *r,
			   struct difference *ret)
{
	struct agree_system said, has = r->system;

	/* Older manifests do not record the system of degrees. */
	if (!*s->reading && (*p->agree.geoid_text || p->agree.said.plane == CRS_PLANE_GEOGRAPHIC))
		return false;
	agree_system_set(&said, p->agree.said.text, p->agree.said.unit_xy, p->agree.said.unit_z);
	if (!r->has_system)
		agree_system_set(&has, p->agree.crs, p->agree.unit_xy, p->agree.unit_z);
	describe(&has, "", ret->was);
	if (*s->overridden && !p->agree.overrides) {
		snprintf(ret->is, sizeof ret->is, "what it says itself (%.500s)", s->overridden);
		return true;
	}
	describe(&said, p->agree.overrides ? ", in place of what it says itself" : ", assumed where it says nothing", ret->is);
	return (p->agree.overrides || p->agree.assumes) && !agree_system_holds(&said, p->agree.overrides, &has);
}

/* Degrees were projected, and --planar would not project them. */
static bool plane_differs(const struct push *p, const struct agree_reading *r, struct difference *ret)
{
	char planes[2][CRS_TEXT_SIZE];

	crs_text_plane(r->system.text, planes[0]);
	crs_text_plane(p->agree.crs, planes[1]);
	if (!p->agree.planar || strcmp(r->system.unit_xy, "degree") || !strcmp(planes[0], planes[1]))
		return false;
	snprintf(ret->was, sizeof ret->was, "its degrees projected");
	snprintf(ret->is, sizeof ret->is, "--planar");
	return true;
}

static bool differs(const struct push *p, const struct push_request *rq, const struct grid_source *s, struct difference *ret)
{
	struct agree_reading r;

	agree_reading_parse(s->reading, &r);
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

bool push_same_reading(const struct push_offer *o, const struct push_request *rq)
{
	char text[PUSH_READING_SIZE];

	reading_text(rq, text);
	return !strcmp(o->reading, text);
}
