/*
 * The report of a job: made from the totals of its run, and kept in the catalogue as lines of "name value", without those that
 * are zero or empty. Names are only added, never changed; unknown names are ignored, missing ones are zero.
 */
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "job_priv.h"
#include "lattice.h"
#include "process.h"
#include "simplify.h"
#include "parse.h"

enum kind { NUMBER, SECONDS, TEXT };

static const struct {
	const char *name;
	size_t length;
	enum kind kind;
	size_t offset, size;
} fields[] = {
#define FIELD(name, kind)                                                                                                \
	{                                                                                                                \
#name, sizeof #name - 1, kind, offsetof(struct job_report, name), sizeof(((struct job_report *)0)->name) \
	}
	FIELD(points, NUMBER),
	FIELD(used, NUMBER),
	FIELD(vertices, NUMBER),
	FIELD(triangles, NUMBER),
	FIELD(hull, NUMBER),
	FIELD(domains, NUMBER),
	FIELD(halo, NUMBER),
	FIELD(digest, TEXT),
	FIELD(vertex_digest, TEXT),
	FIELD(seconds, SECONDS),
	FIELD(stage_seconds, SECONDS),
	FIELD(first_triangle_seconds, SECONDS),
	FIELD(points_read, NUMBER),
	FIELD(cells_read, NUMBER),
	FIELD(seal_seconds, SECONDS),
	FIELD(plan_seconds, SECONDS),
	FIELD(domains_seconds, SECONDS),
	FIELD(worked_seconds, SECONDS),
	FIELD(peak_rss, NUMBER),
	FIELD(note, TEXT),
	FIELD(domains_reused, NUMBER),
	FIELD(window, NUMBER),
	FIELD(most, TEXT),
	FIELD(all_out, NUMBER),
	FIELD(positions, NUMBER),
	FIELD(kept, NUMBER),
	FIELD(rounds, NUMBER),
	FIELD(attempts, NUMBER),
	FIELD(max_error, TEXT),
	FIELD(largest_error, TEXT),
#undef FIELD
};

enum { FIELDS = sizeof fields / sizeof fields[0] };
#define REMOVED "removed-" /* and the name of a rule */

static bool is_zero(const char *place, enum kind kind)
{
	uint64_t first;

	if (kind == TEXT)
		return !*place;
	memcpy(&first, place, sizeof first);
	return !first;
}

char *report_text(const struct job_report *r, char *buf, size_t size)
{
	size_t at = 0, i;

	*buf = 0;
	for (i = 0; i < FIELDS && at < size; i++) {
		const char *place = (const char *)r + fields[i].offset;

		if (is_zero(place, fields[i].kind))
			continue;
		if (fields[i].kind == NUMBER)
			at += (size_t)snprintf(buf + at, size - at, "%s %llu\n", fields[i].name,
					       (unsigned long long)*(const uint64_t *)place);
		else if (fields[i].kind == SECONDS)
			at += (size_t)snprintf(buf + at, size - at, "%s %.6f\n", fields[i].name, *(const double *)place);
		else
			at += (size_t)snprintf(buf + at, size - at, "%s %s\n", fields[i].name, place);
	}
	for (i = 0; i < VIEW_RULES && at < size; i++)
		if (r->removed[i])
			at += (size_t)snprintf(buf + at, size - at, REMOVED "%s %llu\n", view_rule_text((enum view_rule)i),
					       (unsigned long long)r->removed[i]);
	return buf;
}

/* ---- parsing: each start parses thousands of reports, so nothing is copied and each byte is read once ---- */

/* The value in a line that begins with this name (n bytes) and a space; NULL: it begins otherwise. */
static inline const char *after_name(const char *line, const char *name, size_t n)
{
	return *line == *name && !strncmp(line, name, n) && line[n] == ' ' ? line + n + 1 : NULL;
}

/* Appends digits to *v. Returns the end; the caller checks how many there were. */
static const char *more_digits(const char *at, uint64_t *v)
{
	uint64_t n = *v;

	for (unsigned digit; (digit = (unsigned)*at - '0') < 10; at++)
		n = n * 10 + digit;
	*v = n;
	return at;
}

/* Parses a number, or (`seconds`) a decimal with six digits after the point, in millionths, as report_text writes it. Returns the
 * end of the line; NULL: another format, or so many digits that they may overflow. */
static const char *get_digits(const char *value, bool seconds, uint64_t *ret)
{
	uint64_t v = 0;
	const char *at = more_digits(value, &v), *point = at;

	if (seconds && *point == '.')
		at = more_digits(point + 1, &v);
	if (at == value || *at != '\n' || at - value > (seconds ? 16 : 18) || (seconds && at - point != 7))
		return NULL;
	*ret = v;
	return at;
}

/* Parses a value. Returns the end of its line. Up to 2^53 millionths, the division rounds exactly as strtod does. */
static const char *get_value(const char *value, enum kind kind, char *place, size_t size)
{
	uint64_t number = 0;
	const char *end = kind == TEXT ? NULL : get_digits(value, kind == SECONDS, &number);
	char *copy;
	size_t n;

	if (end && kind == SECONDS)
		*(double *)place = (double)number / 1e6;
	else if (end)
		*(uint64_t *)place = number;
	if (end)
		return end;
	end = strchrnul(value, '\n');
	n = (size_t)(end - value);
	if (kind == TEXT) {
		*(char *)mempcpy(place, value, n < size ? n : size - 1) = 0;
		return end;
	}
	copy = strndup(value, n);
	if (copy && kind == NUMBER)
		parse_u64(copy, (uint64_t *)place);
	else if (copy)
		parse_double(copy, (double *)place);
	free(copy);
	return end;
}

/* `at`: where to continue in the table, the order of which reports have. Returns the end of the line; NULL: its name is unknown.
 */
static const char *get_removed(const char *line, size_t *at, struct job_report *ret)
{
	for (size_t left = VIEW_RULES; left; left--) {
		const char *rule = view_rule_text((enum view_rule) * at), *value = after_name(line, rule, strlen(rule));
		uint64_t *place = &ret->removed[*at];

		*at = *at + 1 < VIEW_RULES ? *at + 1 : 0;
		if (value)
			return get_value(value, NUMBER, (char *)place, sizeof *place);
	}
	return NULL;
}

static const char *get_field(const char *line, size_t *at, struct job_report *ret)
{
	for (size_t left = FIELDS; left; left--) {
		size_t i = *at;
		const char *value = after_name(line, fields[i].name, fields[i].length);

		*at = i + 1 < FIELDS ? i + 1 : 0;
		if (value)
			return get_value(value, fields[i].kind, (char *)ret + fields[i].offset, fields[i].size);
	}
	return NULL;
}

void report_parse(const char *text, struct job_report *ret)
{
	const size_t removed = sizeof REMOVED - 1;
	size_t at = 0, at_rule = 0;

	memset(ret, 0, sizeof *ret);
	while (*text) {
		bool rule = *text == *REMOVED && !strncmp(text, REMOVED, removed);
		const char *end = rule ? get_removed(text + removed, &at_rule, ret) : get_field(text, &at, ret);

		text = end ? end : strchrnul(text, '\n');
		text += *text != 0;
	}
}

void report_window(struct job_report *r)
{
	r->window = 1;
	*r->note = *r->most = 0;
	if (!r->triangles)
		snprintf(r->note, sizeof r->note, "no triangle of the mesh meets the area (is it in the dataset's coordinates?)");
}

void report_simplified(struct job_report *r, const struct run *run)
{
	const struct simplify_report *s = run_simplified(run);
	struct lattice lattice;

	if (!s || !lattice_parse(run_dataset(run)->lattice, &lattice))
		return;
	r->positions = s->points;
	r->kept = s->kept;
	r->rounds = s->rounds;
	r->attempts = s->attempts;
	decimal_scaled_text(lattice.scale_z, s->max_error, r->max_error);
	lattice.scale_z.exponent -= 3; /* thousandths */
	decimal_scaled_text(lattice.scale_z, (int64_t)s->largest, r->largest_error);
}

bool report_without_flat(const struct job_report *r)
{
	return r->used && !r->vertices && !r->window && !r->all_out;
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
	ret->peak_rss = process_peak_rss();
	if (t->counts.most.points)
		snprintf(ret->most, sizeof ret->most, "%llu %.17g %.17g", (unsigned long long)t->counts.most.points,
			 t->most_at[0], t->most_at[1]);
	if (t->triangles)
		return;
	ret->all_out = t->counts.used && !t->vertices;
	if (ret->all_out)
		snprintf(ret->note, sizeof ret->note,
			 "all triangles are outside of the boundary or in holes, so the mesh has none");
	else if (!t->counts.points)
		snprintf(ret->note, sizeof ret->note, "the dataset has no points, so the mesh has no triangles");
	else if (!t->counts.used && t->counts.removed[VIEW_BY_AREA])
		snprintf(
			ret->note, sizeof ret->note,
			"all points that the view takes are outside of the boundary, in holes or in lakes, so the mesh has none");
	else if (!t->counts.used && t->counts.removed[VIEW_BY_CROP])
		snprintf(ret->note, sizeof ret->note,
			 "the area of crop holds no point that the view takes (is it in the dataset's coordinates?); "
			 "fewer than three positions make no triangles");
	else if (t->counts.used < 3)
		snprintf(ret->note, sizeof ret->note,
			 "the view leaves %llu distinct position%s, fewer than three: the mesh has vertices and no triangles",
			 (unsigned long long)t->counts.used, t->counts.used == 1 ? "" : "s");
	else
		snprintf(ret->note, sizeof ret->note,
			 "all %llu positions lie on one line: the mesh has vertices and no triangles",
			 (unsigned long long)t->counts.used);
}
