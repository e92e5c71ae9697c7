/*
 * Files of lines as the text that acutd takes. Coordinates stay decimals: the digits of a text as they are, a double as the
 * shortest decimal that is read back as it.
 */
#include "lines_export.h"

#include <errno.h>
#include <inttypes.h>
#include <string.h>
#include <strings.h>

#include "err.h"

const char *const lines_kind_text[LINES_KINDS] = {"hard", "lake", "boundary", "hole"};

enum { SOFT = LINES_KINDS, UNKNOWN };
static const char LEVELS[][5] = {"min", "max", "mean"};

struct export
{
	const struct lines *lines;
	const struct lines_export_options *opt;
	FILE *out;
	struct lines_exported *ret;
	const struct lines_layer *layer; /* whose coordinate system was written; NULL: none yet */
};

static unsigned kind_of(const char *word)
{
	for (unsigned i = 0; i < LINES_KINDS; i++)
		if (!strcasecmp(word, lines_kind_text[i]))
			return i;
	return strcasecmp(word, "soft") ? UNKNOWN : SOFT;
}

/* "5m" to the number, and the unit behind it. */
static bool parse_length(const char *text, char number[DECIMAL_TEXT_SIZE], const char **ret_unit)
{
	static const char units[][5] = {"", "m", "ft", "ftUS"};
	size_t n = strspn(text, "0123456789.");
	struct decimal d;

	if (n >= DECIMAL_TEXT_SIZE)
		return false;
	memcpy(number, text, n);
	number[n] = 0;
	*ret_unit = text + n;
	if (!decimal_parse(number, &d) || d.mantissa <= 0)
		return false;
	for (unsigned i = 0; i < sizeof units / sizeof *units; i++)
		if (!strcmp(*ret_unit, units[i]))
			return true;
	return false;
}

int lines_export_check(const struct lines_export_options *opt, struct err *err)
{
	char number[DECIMAL_TEXT_SIZE];
	const char *unit;

	if (opt->kind && kind_of(opt->kind) == UNKNOWN)
		return err_set(err, ERR_USAGE, "\"%s\" is no kind of lines: hard, soft, lake, boundary, hole", opt->kind);
	if (opt->densify && !parse_length(opt->densify, number, &unit))
		return err_set(err, ERR_USAGE, "--densify is a length above zero, as 5, 5m, 16ft or 16ftUS: \"%s\"",
			       opt->densify);
	for (unsigned i = 0; opt->lake_level && i < sizeof LEVELS / sizeof *LEVELS; i++)
		if (!strcmp(opt->lake_level, LEVELS[i]))
			return 0;
	return opt->lake_level ? err_set(err, ERR_USAGE, "--lake-level is min, max or mean: \"%s\"", opt->lake_level) : 0;
}

/* ---- the head ---- */

/* A text in one row. */
static void put_row(FILE *out, const char *key, const char *text)
{
	fprintf(out, "%s ", key);
	for (; *text; text++)
		fputc((unsigned char)*text < ' ' ? ' ' : *text, out);
	fputc('\n', out);
}

/* Names of units as files have them. NULL: another unit. */
static const char *unit_of(const char *name)
{
	static const char *const names[][2] = {
		{"metre", "m"}, {"meter", "m"}, {"foot", "ft"}, {"us-survey-foot", "ftUS"}, {"USSurveyFoot", "ftUS"}};

	for (unsigned i = 0; i < sizeof names / sizeof *names; i++)
		if (!strcasecmp(name, names[i][0]))
			return names[i][1];
	return NULL;
}

static int put_unit(const struct export *e, const char *key, const char *name, struct err *err)
{
	const char *unit = unit_of(name);

	if (!unit) {
		err_set(err, ERR_UNSUPPORTED, "its unit is %s; coordinates are read in metres and feet", name);
		return err_add_hint(err, "convert it in the program that wrote it, or with ogr2ogr");
	}
	put_row(e->out, key, unit);
	return 0;
}

static int put_system(struct export *e, const struct lines_crs *c, struct err *err)
{
	bool known = c->epsg || *c->wkt || c->degrees;
	int r = 0;

	if (c->epsg && c->epsg_z)
		fprintf(e->out, "crs EPSG:%" PRIu32 " + EPSG:%" PRIu32 "\n", c->epsg, c->epsg_z);
	else if (c->epsg)
		fprintf(e->out, "crs EPSG:%" PRIu32 "\n", c->epsg);
	else if (*c->wkt)
		put_row(e->out, "crs", c->wkt);
	else if (*c->name)
		put_row(e->out, "crs", c->name);
	if (!known && *c->unit)
		r = put_unit(e, "unit", c->unit, err);
	if (!r && *c->unit_z && !c->epsg_z)
		r = put_unit(e, "unit-z", c->unit_z, err);
	return r;
}

static bool same_system(const struct lines_crs *a, const struct lines_crs *b)
{
	return a->epsg == b->epsg && a->epsg_z == b->epsg_z && !strcmp(a->wkt, b->wkt) && !strcmp(a->name, b->name) &&
	       !strcmp(a->unit, b->unit) && !strcmp(a->unit_z, b->unit_z) && a->degrees == b->degrees;
}

static int put_head(struct export *e, const struct lines_layer *layer, struct err *err)
{
	const struct lines_export_options *opt = e->opt;
	char number[DECIMAL_TEXT_SIZE];
	const char *unit;
	int r;

	if (e->layer == layer || (e->layer && same_system(&e->layer->crs, &layer->crs)))
		return 0;
	if (e->layer) {
		err_set(err, ERR_INPUT, "layers %s and %s have different coordinate systems", e->layer->name, layer->name);
		return err_add_hint(err, "give them one by one, with --layer");
	}
	e->layer = layer;
	r = put_system(e, &layer->crs, err);
	if (opt->densify && parse_length(opt->densify, number, &unit))
		fprintf(e->out, *unit ? "densify %s %s\n" : "densify %s\n", number, unit);
	if (opt->lake_level)
		put_row(e->out, "lake-level", opt->lake_level);
	return r;
}

/* ---- features ---- */

static int refuse(const struct lines_feature *f, struct err *err, const char *hint)
{
	char where[sizeof err->field];

	snprintf(where, sizeof where, "feature %" PRIu64, f->number);
	err_add_hint(err, "%s", hint);
	return err_add_place(err, ERR_NO_OFFSET, where);
}

static int choose_kind(const struct export *e, const struct lines_feature *f, unsigned *ret, struct err *err)
{
	const char *word = f->kind && *f->kind ? f->kind : e->opt->kind;

	if (!word) {
		err_set(err, ERR_INPUT, "it has no value in the field of kinds");
		return refuse(f, err, "give it one, or say by --lines-as what such features are");
	}
	*ret = kind_of(word);
	if (*ret != UNKNOWN)
		return 0;
	err_set(err, ERR_INPUT, "its kind is \"%.64s\"", word);
	return refuse(f, err, "kinds are hard, soft, lake, boundary and hole");
}

static bool same_place(const struct lines_feature *f, size_t a, size_t b)
{
	if (f->exact)
		return !decimal_compare(f->exact[a][0], f->exact[b][0]) && !decimal_compare(f->exact[a][1], f->exact[b][1]);
	return f->number_of[a][0] == f->number_of[b][0] && f->number_of[a][1] == f->number_of[b][1];
}

static void put_vertex(FILE *out, const struct lines_feature *f, size_t vertex)
{
	char text[DECIMAL_TEXT_SIZE];
	struct decimal d = {0, 0};

	for (unsigned k = 0; k < 3; k++) {
		if (f->exact)
			d = f->exact[vertex][k];
		else
			decimal_from_double(f->number_of[vertex][k], &d); /* the readers refuse numbers that are not finite */
		fprintf(out, k < 2 ? "%s " : "%s\n", decimal_text(d, text));
	}
}

static int put_part(struct export *e, const struct lines_feature *f, const struct lines_part *p, bool area, struct err *err)
{
	size_t n = p->n;
	bool ring = p->ring;

	if (!ring && area) {
		ring = n > 1 && same_place(f, p->first, p->first + n - 1);
		n -= ring;
	}
	if (area && (!ring || n < 3)) {
		err_set(err, ERR_INPUT,
			ring ? "it is a ring of %zu vertices" : "a line of %zu vertices does not end where it begins", n);
		return refuse(f, err, "lakes, boundaries and holes are rings of three vertices or more");
	}
	fputs(ring ? "ring\n" : "line\n", e->out);
	for (size_t i = 0; i < n; i++)
		put_vertex(e->out, f, p->first + i);
	e->ret->lines++;
	e->ret->vertices += n;
	return 0;
}

static int put_feature(struct export *e, const struct lines_feature *f, struct err *err)
{
	unsigned kind = UNKNOWN;
	int r = put_head(e, f->layer, err);

	if (!r)
		r = choose_kind(e, f, &kind, err);
	if (r)
		return r;
	e->ret->soft += kind == SOFT;
	kind = kind == SOFT ? LINES_HARD : kind;
	e->ret->features[kind]++;
	fprintf(e->out, "feature %" PRIu64 " %s\n", f->number, lines_kind_text[kind]);
	for (size_t i = 0; i < f->nparts && !r; i++)
		r = put_part(e, f, &f->part[i], kind != LINES_HARD, err);
	return r;
}

int lines_export(struct lines *l, const struct lines_export_options *opt, FILE *out, struct lines_exported *ret, struct err *err)
{
	struct export e = {.lines = l, .opt = opt, .out = out, .ret = ret};
	const struct lines_feature *f = NULL;
	int r;

	*ret = (struct lines_exported){0};
	fputs("acut-lines 1\n", out);
	while (!(r = lines_next(l, &f, err)) && f) {
		if (f->state == LINES_REFUSED)
			return lines_refusal(l, f, err);
		if (f->state != LINES_USABLE) {
			ret->left_out++;
			continue;
		}
		r = put_feature(&e, f, err);
		if (r)
			break;
		if (ferror(out))
			return err_sys(err, errno, "it cannot be written");
	}
	if (!r && !ret->lines) {
		r = err_set(err, ERR_INPUT, "it has no lines");
		err_add_hint(err, "acutctl info prints what is in it");
	}
	return r;
}
