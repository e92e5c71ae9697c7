/*
 * The report of a job: made from the totals of its walk, and kept in the catalogue as lines of "name value".
 * Names are only ever added; unknown ones are ignored, missing ones are zero.
 */
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "job_priv.h"
#include "parse.h"

enum kind { NUMBER, SECONDS, TEXT };

static const struct {
	const char *name;
	enum kind kind;
	size_t offset, size;
} fields[] = {
#define FIELD(name, kind)                                                                                    \
	{                                                                                                    \
#name, kind, offsetof(struct job_report, name), sizeof(((struct job_report *)0)->name)       \
	}
	FIELD(points, NUMBER),         FIELD(used, NUMBER),
	FIELD(vertices, NUMBER),       FIELD(triangles, NUMBER),
	FIELD(hull, NUMBER),           FIELD(domains, NUMBER),
	FIELD(halo, NUMBER),           FIELD(digest, TEXT),
	FIELD(vertex_digest, TEXT),    FIELD(seconds, SECONDS),
	FIELD(stage_seconds, SECONDS), FIELD(first_triangle_seconds, SECONDS),
	FIELD(points_read, NUMBER),    FIELD(cells_read, NUMBER),
	FIELD(seal_seconds, SECONDS),  FIELD(plan_seconds, SECONDS),
	FIELD(domains_seconds, SECONDS), FIELD(worked_seconds, SECONDS),
	FIELD(peak_rss, NUMBER),       FIELD(note, TEXT),
	FIELD(domains_reused, NUMBER),  FIELD(window, NUMBER),
#undef FIELD
};

enum { FIELDS = sizeof fields / sizeof fields[0] };

char *report_text(const struct job_report *r, char *buf, size_t size)
{
	size_t at = 0, i;

	*buf = 0;
	for (i = 0; i < FIELDS && at < size; i++) {
		const char *place = (const char *)r + fields[i].offset;

		if (fields[i].kind == NUMBER)
			at += (size_t)snprintf(buf + at, size - at, "%s %llu\n", fields[i].name,
					       (unsigned long long)*(const uint64_t *)place);
		else if (fields[i].kind == SECONDS)
			at += (size_t)snprintf(buf + at, size - at, "%s %.6f\n", fields[i].name,
					       *(const double *)place);
		else
			at += (size_t)snprintf(buf + at, size - at, "%s %s\n", fields[i].name, place);
	}
	for (i = 0; i < VIEW_RULES && at < size; i++)
		at += (size_t)snprintf(buf + at, size - at, "removed-%s %llu\n",
				       view_rule_text((enum view_rule)i), (unsigned long long)r->removed[i]);
	return buf;
}

/* `at`: where the field before it was found; they stand in the order of the table. */
static void parse_field(const char *name, const char *value, size_t *at, struct job_report *ret)
{
	uint64_t n;
	size_t i, k;

	if (!strncmp(name, "removed-", 8)) {
		for (i = 0; i < VIEW_RULES; i++)
			if (!strcmp(name + 8, view_rule_text((enum view_rule)i)) && parse_u64(value, &n))
				ret->removed[i] = n;
		return;
	}
	for (k = 0; k < FIELDS; k++) {
		char *place;

		i = (*at + k) % FIELDS;
		place = (char *)ret + fields[i].offset;

		if (strcmp(name, fields[i].name))
			continue;
		if (fields[i].kind == NUMBER)
			parse_u64(value, (uint64_t *)place);
		else if (fields[i].kind == SECONDS)
			parse_double(value, (double *)place);
		else
			snprintf(place, fields[i].size, "%s", value);
		*at = i + 1;
		return;
	}
}

bool report_parse(const char *text, struct job_report *ret)
{
	char *copy = strdup(text), *save = NULL, *line;
	size_t at = 0;

	if (!copy)
		return false;
	memset(ret, 0, sizeof *ret);
	for (line = strtok_r(copy, "\n", &save); line; line = strtok_r(NULL, "\n", &save)) {
		char *value = strchr(line, ' ');

		if (value) {
			*value++ = 0;
			parse_field(line, value, &at, ret);
		}
	}
	free(copy);
	return true;
}

void report_window(struct job_report *r)
{
	r->window = 1;
	*r->note = 0;
	if (!r->triangles)
		snprintf(r->note, sizeof r->note,
			 "no triangle of the mesh meets the area (is it in the dataset's coordinates?)");
}

void report_make(const struct pipe_totals *t, struct job_report *ret)
{
	size_t i;

	memset(ret, 0, sizeof *ret);
	ret->points = t->counts.points;
	ret->used = t->counts.used;
	ret->halo = t->counts.halo;
	ret->points_read = t->counts.points_read;
	ret->cells_read = t->counts.cells_read;
	ret->vertices = t->vertices;
	ret->triangles = t->triangles;
	ret->hull = t->hull;
	ret->domains = t->domains;
	for (i = 0; i < VIEW_RULES; i++)
		ret->removed[i] = t->counts.removed[i];
	digest_hex(t->digest, ret->digest);
	digest_hex(t->vertex_digest, ret->vertex_digest);
	ret->peak_rss = jobs_peak_rss();
	if (t->triangles)
		return;
	if (!t->counts.points)
		snprintf(ret->note, sizeof ret->note,
			 "the dataset has no points, so the mesh has no triangles");
	else if (!t->counts.used && t->counts.removed[VIEW_BY_CROP])
		snprintf(ret->note, sizeof ret->note,
			 "the area of crop holds no point that the view takes (is it in the dataset's coordinates?); "
			 "fewer than three positions make no triangles");
	else if (t->counts.used < 3)
		snprintf(ret->note, sizeof ret->note,
			 "the view leaves %llu distinct position(s), fewer than three, so the mesh has no "
			 "triangles",
			 (unsigned long long)t->counts.used);
	else
		snprintf(ret->note, sizeof ret->note,
			 "all %llu positions lie on one line, so the mesh has no triangles",
			 (unsigned long long)t->counts.used);
}
