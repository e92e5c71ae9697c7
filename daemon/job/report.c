/*
 * The report of a job: made from the totals of its run, and kept in the catalogue as lines of "name value". Names are only added,
 * never changed; unknown names are ignored, missing ones are zero.
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
			at += (size_t)snprintf(buf + at, size - at, "%s %.6f\n", fields[i].name, *(const double *)place);
		else
			at += (size_t)snprintf(buf + at, size - at, "%s %s\n", fields[i].name, place);
	}
	for (i = 0; i < VIEW_RULES && at < size; i++)
		at += (size_t)snprintf(buf + at, size - at, "removed-%s %llu\n", view_rule_text((enum view_rule)i),
				       (unsigned long long)r->removed[i]);
	return buf;
}

/* ---- parsing: each start parses thousands of reports, so nothing is copied and the usual format is read directly ---- */

/* A part of the text. */
struct part {
	const char *at;
	size_t n;
};

static bool is(const struct part *p, const char *name)
{
	return !strncmp(p->at, name, p->n) && !name[p->n];
}

/* Digits only, few enough not to overflow. */
static bool few_digits(const char *at, size_t n, uint64_t *ret)
{
	uint64_t v = 0;

	for (size_t i = 0; i < n; i++) {
		if (at[i] < '0' || at[i] > '9')
			return false;
		v = v * 10 + (uint64_t)(at[i] - '0');
	}
	*ret = v;
	return n > 0;
}

/* The value in a line that begins with `name` (n bytes) and a space; NULL: it begins otherwise. */
static const char *after_name(const char *line, const char *name, size_t n)
{
	return strncmp(line, name, n) || line[n] != ' ' ? NULL : line + n + 1;
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
 * next line; NULL: another format, or so many digits that they may overflow. */
static const char *number_line(const char *value, bool seconds, uint64_t *ret)
{
	uint64_t v = 0;
	const char *at = more_digits(value, &v), *point = at;

	if (at == value)
		return NULL;
	if (seconds) {
		if (*point != '.')
			return NULL;
		at = more_digits(point + 1, &v);
		if (at - point != 7)
			return NULL;
	}
	if (*at != '\n' || at - value > (seconds ? 16 : 18))
		return NULL;
	*ret = v;
	return at + 1;
}

/* As much of it as fits. */
static const char *text_line(const char *value, char *place, size_t size)
{
	const char *end = strchrnul(value, '\n');
	size_t n = (size_t)(end - value);

	*(char *)mempcpy(place, value, n < size ? n : size - 1) = 0;
	return *end ? end + 1 : end;
}

static void get_number(const struct part *value, uint64_t *ret)
{
	char *copy;

	if (value->n < 19) {
		few_digits(value->at, value->n, ret);
		return;
	}
	copy = strndup(value->at, value->n);
	if (copy)
		parse_u64(copy, ret);
	free(copy);
}

/* Six digits after the point. Up to 2^53 millionths, the division rounds exactly as strtod does. */
static void get_seconds(const struct part *value, double *ret)
{
	uint64_t whole, millionths;
	char *copy;

	if (value->n > 7 && value->n <= 16 && value->at[value->n - 7] == '.' && few_digits(value->at, value->n - 7, &whole) &&
	    few_digits(value->at + value->n - 6, 6, &millionths)) {
		*ret = (double)(whole * 1000000 + millionths) / 1e6;
		return;
	}
	copy = strndup(value->at, value->n);
	if (copy)
		parse_double(copy, ret);
	free(copy);
}

static void get_removed(const struct part *rule, const struct part *value, size_t *at, struct job_report *ret)
{
	for (size_t k = 0; k < VIEW_RULES; k++) {
		size_t i = (*at + k) % VIEW_RULES;

		if (!is(rule, view_rule_text((enum view_rule)i)))
			continue;
		get_number(value, &ret->removed[i]);
		*at = i + 1;
		return;
	}
}

/* `at`, `at_rule`: where to continue in the tables; reports have the order of the tables. */
static void get_field(const struct part *name, const struct part *value, size_t *at, size_t *at_rule, struct job_report *ret)
{
	if (name->n > 8 && !memcmp(name->at, "removed-", 8)) {
		get_removed(&(struct part){name->at + 8, name->n - 8}, value, at_rule, ret);
		return;
	}
	for (size_t k = 0; k < FIELDS; k++) {
		size_t i = (*at + k) % FIELDS, n;
		char *place = (char *)ret + fields[i].offset;

		if (!is(name, fields[i].name))
			continue;
		n = value->n < fields[i].size ? value->n : fields[i].size - 1;
		if (fields[i].kind == NUMBER)
			get_number(value, (uint64_t *)place);
		else if (fields[i].kind == SECONDS)
			get_seconds(value, (double *)place);
		else
			*(char *)mempcpy(place, value->at, n) = 0;
		*at = i + 1;
		return;
	}
}

static const char *next_rule(const char *text, size_t *at_rule, struct job_report *ret)
{
	const char *rule, *value, *end;

	if (*at_rule == VIEW_RULES || strncmp(text, "removed-", 8))
		return NULL;
	rule = view_rule_text((enum view_rule) * at_rule);
	value = after_name(text + 8, rule, strlen(rule));
	end = value ? number_line(value, false, &ret->removed[*at_rule]) : NULL;
	*at_rule += end != NULL;
	return end;
}

/* The line that follows if this version wrote the report. NULL: another line, or another format. */
static const char *next_line(const char *text, size_t *at, size_t *at_rule, struct job_report *ret)
{
	const char *value = *at < FIELDS ? after_name(text, fields[*at].name, fields[*at].length) : NULL, *end;
	char *place;
	uint64_t n;

	if (!value)
		return next_rule(text, at_rule, ret);
	place = (char *)ret + fields[*at].offset;
	if (fields[*at].kind == TEXT)
		return text_line(value, place, fields[(*at)++].size);
	end = number_line(value, fields[*at].kind == SECONDS, &n);
	if (!end)
		return NULL;
	if (fields[(*at)++].kind == SECONDS)
		*(double *)place = (double)n / 1e6;
	else
		*(uint64_t *)place = n;
	return end;
}

void report_parse(const char *text, struct job_report *ret)
{
	size_t at = 0, at_rule = 0;

	memset(ret, 0, sizeof *ret);
	while (*text) {
		const char *end = next_line(text, &at, &at_rule, ret), *space;

		if (end) {
			text = end;
			continue;
		}
		end = strchrnul(text, '\n');
		space = memchr(text, ' ', (size_t)(end - text));

		if (space)
			get_field(&(struct part){text, (size_t)(space - text)},
				  &(struct part){space + 1, (size_t)(end - space - 1)}, &at, &at_rule, ret);
		text = *end ? end + 1 : end;
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
