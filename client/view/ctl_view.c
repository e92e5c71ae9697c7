/*
 * The view options as a request (protocol.md, "Views"): "ask 1", then a word for each option. Errors that can be found
 * without the dataset are found here, before a daemon is asked. Numbers are sent as they were typed, as exact decimals: only
 * the daemon knows the lattice and the unit of the dataset.
 */
#include <stdlib.h>
#include <string.h>

#include "area_code.h"
#include "ctl_area.h"
#include "ctl_view.h"
#include "ctl_view_weight.h"
#include "decimal.h"
#include "err.h"
#include "parse.h"

/* "2,8" or "2-5,9": false for rubbish. */
static bool good_classes(const char *text)
{
	for (;;) {
		unsigned long first, last;
		char *end;

		if (*text < '0' || *text > '9')
			return false;
		first = last = strtoul(text, &end, 10);
		if (*end == '-') {
			text = end + 1;
			if (*text < '0' || *text > '9')
				return false;
			last = strtoul(text, &end, 10);
		}
		if (first > last || last > 255)
			return false;
		if (!*end)
			return true;
		if (*end != ',')
			return false;
		text = end + 1;
	}
}

static int check_classes(const char *text, struct err *err)
{
	if (!text || good_classes(text))
		return 0;
	err_set(err, ERR_USAGE, "\"%s\" is not a list of classes", text);
	return err_add_hint(err, "give numbers from 0 to 255, as in 2,8 or 2-5,9");
}

/* "3,1,10" */
static bool metric_of(const char *text, int64_t ret[3])
{
	char part[32];

	for (int i = 0; i < 3; i++) {
		size_t n = strcspn(text, ",");

		if (n >= sizeof(part) || (text[n] == ',') != (i < 2))
			return false;
		memcpy(part, text, n);
		part[n] = '\0';
		if (!parse_i64(part, &ret[i]))
			return false;
		text += n + (i < 2);
	}
	return true;
}

static bool is(const char *text, const char *word)
{
	return text && !strcmp(text, word);
}

static int check_words(const struct ctl_view_options *a, struct err *err)
{
	if (a->thin_pick && !a->thin) {
		err_set(err, ERR_USAGE, "--thin-pick chooses the point of a cell, and there are no cells");
		return err_add_hint(err, "give --thin CELL too");
	}
	return 0;
}

/* A number, alone or with the name of a unit of length. `least`: the least mantissa. */
static bool good_length(const char *text, size_t n, int least)
{
	static const char *const units[] = {"ftUS", "ft", "m"};
	char number[DECIMAL_TEXT_SIZE];
	struct decimal d;

	for (int i = 0; i < 3; i++) {
		size_t m = strlen(units[i]);

		if (n > m && !memcmp(text + n - m, units[i], m)) {
			n -= m;
			break;
		}
	}
	snprintf(number, sizeof(number), "%.*s", (int)n, text);
	return n < sizeof(number) && decimal_parse(number, &d) && d.mantissa >= least;
}

/* Without options whose values change nothing, so that these contradict nothing. All values are good. */
static struct ctl_view_options without_idle(const struct ctl_view_options *a)
{
	struct ctl_view_options b = *a;
	int64_t metric[3];

	if (b.metric && metric_of(b.metric, metric) && metric[2] == 1)
		b.metric = NULL;
	if (b.breakline_clear && !good_length(b.breakline_clear, strlen(b.breakline_clear), 1))
		b.breakline_clear = NULL;
	return b;
}

/* Options that contradict each other are a usage error. */
static int check_sense(const struct ctl_view_options *a, struct err *err)
{
	bool highest = is(a->duplicates, "highest");

	if (a->ground && a->surface) {
		err_set(err, ERR_USAGE, "a mesh cannot be of the ground and of the surface at once");
		return err_add_hint(err, "submit two jobs on one dataset: they share its points");
	}
	if (a->surface && is(a->returns, "last")) {
		err_set(err, ERR_USAGE, "the surface is made of first returns, not of last ones");
		return err_add_hint(err, "leave out one of --surface and --returns last");
	}
	if (a->surface && a->duplicates && !highest) {
		err_set(err, ERR_USAGE, "the surface is the highest of several points of one position");
		return err_add_hint(err, "use --returns first --duplicates lowest");
	}
	if (a->ground && highest) {
		err_set(err, ERR_USAGE, "the ground is the lowest of several points of one position");
		return err_add_hint(err, "use --class 2,8 --duplicates highest");
	}
	if (a->no_breaklines && a->breakline_clear) {
		err_set(err, ERR_USAGE, "without lines no point is near one");
		return err_add_hint(err, "leave out one of --no-breaklines and --breakline-clear");
	}
	if (a->max_error && a->max_points) {
		err_set(err, ERR_USAGE, "--max-points looks for the bound that --max-error gives");
		return err_add_hint(err, "leave out one of them");
	}
	if ((a->max_error || a->max_points) && a->metric) {
		err_set(err, ERR_USAGE, "a metric has no bound of errors");
		return err_add_hint(err, "leave out --metric, or --max-error and --max-points");
	}
	return 0;
}

static int check_heights(const struct ctl_view_options *a, struct err *err)
{
	struct decimal low, high, any;

#define VIEW_HEIGHT(field, word, ...)                                                                \
	if (a->field && !decimal_parse(a->field, &any)) {                                            \
		err_set(err, ERR_USAGE, "--" word " is not a height: \"%s\"", a->field);             \
		return err_add_hint(err, "give a decimal in the units of the files, as in 1250.75"); \
	}
#include "view_option.def"
	if (a->zmin && a->zmax && decimal_parse(a->zmin, &low) && decimal_parse(a->zmax, &high) &&
	    decimal_compare(low, high) > 0) {
		err_set(err, ERR_USAGE, "--zmin %s is above --zmax %s: no height is left", a->zmin, a->zmax);
		return err_add_hint(err, "swap them");
	}
	return 0;
}

static int check_length(const char *option, const char *text, int least, struct err *err)
{
	if (!text || good_length(text, strlen(text), least))
		return 0;
	err_set(err, ERR_USAGE, "%s is not a length: \"%s\"", option, text);
	return err_add_hint(err, "give a number in the units of the files, or with m, ft or ftUS, as in 10m");
}

static bool radius(const char *text, size_t n)
{
	return n && good_length(text, n, 0);
}

static int check_weights(const struct ctl_view_options *a, struct err *err)
{
	return ctl_view_weight_check(a->weight, radius, err);
}

static int check_metric(const char *text, struct err *err)
{
	int64_t n[3];

	if (!text)
		return 0;
	if (!metric_of(text, n))
		err_set(err, ERR_USAGE, "--metric is not P,Q,K: \"%s\"", text);
	else if (!n[0] && !n[1])
		err_set(err, ERR_USAGE, "--metric: 0,0 is no direction");
	else if (n[2] < 1)
		err_set(err, ERR_USAGE, "--metric: K is %lld; it must be at least 1", (long long)n[2]);
	else
		return 0;
	return err_add_hint(err, "give whole numbers: the direction P,Q, and how often distances across it count, as in 3,1,10");
}

static int check(const struct ctl_view_options *a, struct err *err)
{
	const struct ctl_view_options what = without_idle(a);
	int r;

	if ((r = check_words(a, err)) || (r = check_classes(a->classes, err)) || (r = check_classes(a->not_classes, err)) ||
	    (r = check_heights(a, err)) || (r = check_length("--thin", a->thin, 1, err)) ||
	    (r = check_length("--breakline-clear", a->breakline_clear, 0, err)) ||
	    (r = check_length("--max-error", a->max_error, 0, err)) || (r = check_metric(a->metric, err)) ||
	    (r = check_weights(a, err)))
		return r;
	return check_sense(&what, err);
}

/* Four decimals with commas between: 1. Something else: 0. */
static int box_of(const char *text, struct decimal ret[4])
{
	char part[DECIMAL_TEXT_SIZE];

	for (int i = 0; i < 4; i++) {
		size_t n = strcspn(text, ",");

		if (n >= sizeof(part) || (text[n] == ',') != (i < 3))
			return 0;
		memcpy(part, text, n);
		part[n] = '\0';
		if (!decimal_parse(part, &ret[i]))
			return 0;
		text += n + (i < 3);
	}
	return 1;
}

/* Bounds of n corners. */
static void bounds(struct decimal (*corner)[2], size_t n, double ret[4])
{
	for (size_t i = 0; i < n; i++)
		for (int k = 0; k < 2; k++) {
			double v = decimal_double(corner[i][k]);

			ret[k] = i && ret[k] < v ? ret[k] : v;
			ret[2 + k] = i && ret[2 + k] > v ? ret[2 + k] : v;
		}
}

static int put_box(const char *option, const char *text, const struct decimal d[4], FILE *out, double ret_box[4], struct err *err)
{
	for (int i = 0; i < 4; i++)
		ret_box[i] = decimal_double(d[i]);
	fprintf(out, "box:%s", text);
	if (decimal_compare(d[0], d[2]) <= 0 && decimal_compare(d[1], d[3]) <= 0)
		return 0;
	err_set(err, ERR_USAGE, "the box of --%s is empty: \"%s\"", option, text);
	return err_add_hint(err, "give X1,Y1,X2,Y2: the smallest x and y, then the largest");
}

static int put_file(const char *file, FILE *out, double ret_box[4], struct err *err)
{
	struct ctl_area area;
	int r = ctl_area_read(file, &area, err);

	if (r)
		return r;
	r = ctl_area_print(&area, out, err);
	bounds(area.corner, area.ncorner, ret_box);
	ctl_area_done(&area);
	return r ? err_add_file(err, file) : 0;
}

static int put_crop(const char *crop, FILE *out, double ret_box[4], struct err *err)
{
	struct decimal d[4];

	fputs(" crop=", out);
	if (box_of(crop, d))
		return put_box("crop", crop, d, out, ret_box, err);
	if (!strcmp(crop, "") || (strspn(crop, "+-.,0123456789eE ") == strlen(crop) && strchr(crop, ','))) {
		err_set(err, ERR_USAGE, "--crop is not X1,Y1,X2,Y2: \"%s\"", crop);
		return err_add_hint(err, "give four decimals, or a file of GeoJSON or WKT");
	}
	return put_file(crop, out, ret_box, err);
}

/* There is one. */
static int put_window(const struct ctl_view_options *a, FILE *out, struct err *err)
{
	struct decimal d[4];
	double box[4];

	if (a->bbox && a->polygon)
		return err_set(err, ERR_USAGE, "--bbox and --polygon are two areas, and one can be asked for");
	if (a->polygon)
		return put_file(a->polygon, out, box, err);
	if (box_of(a->bbox, d))
		return put_box("bbox", a->bbox, d, out, box, err);
	err_set(err, ERR_USAGE, "--bbox is not X1,Y1,X2,Y2: \"%s\"", a->bbox);
	return err_add_hint(err, "give four decimals; --polygon takes a file of GeoJSON or WKT");
}

int ctl_view_window(const struct ctl_view_options *a, char **ret, struct err *err)
{
	char *text = NULL;
	size_t size = 0;
	FILE *out;
	int r;

	*ret = NULL;
	if (!a->bbox && !a->polygon)
		return 0;
	out = open_memstream(&text, &size);
	if (!out)
		return err_set(err, ERR_NOMEM, "no memory for an area");
	r = put_window(a, out, err);
	if (fclose(out) && !r)
		r = err_set(err, ERR_NOMEM, "no memory for an area");
	if (r)
		free(text);
	else
		*ret = text;
	return r;
}

static void put_words(const struct ctl_view_options *a, FILE *out)
{
	bool first = a->surface || is(a->returns, "first");
	int64_t n[3];

	fputs("ask 1", out);
	if (a->classes)
		fprintf(out, " class=%s", a->classes);
	if (a->not_classes)
		fprintf(out, " not-class=%s", a->not_classes);
	fprintf(out, "%s%s%s", a->ground ? " ground" : "", first ? " returns=first" : "",
		is(a->returns, "last") ? " returns=last" : "");
#define VIEW_FLAG(field, word, ...) \
	if (a->field)               \
		fputs(" " word, out);
#define VIEW_COUNT(field, word, ...) \
	if (a->field)                \
		fprintf(out, " " word "=%llu", (unsigned long long)a->field);
#define VIEW_HEIGHT(field, word, ...) \
	if (a->field)                 \
		fprintf(out, " " word "=%s", a->field);
#include "view_option.def"
	/* Unless --thin-pick is given, a cell keeps the point that a position would keep. */
	if (a->thin)
		fprintf(out, " thin=%s:%s", a->thin,
			a->thin_pick                               ? a->thin_pick :
			a->surface || is(a->duplicates, "highest") ? "highest" :
								     "lowest");
	if (a->surface || is(a->duplicates, "highest"))
		fputs(" duplicates=highest", out);
	if (a->breakline_clear)
		fprintf(out, " breakline-clear=%s", a->breakline_clear);
	if (a->max_error)
		fprintf(out, " max-error=%s", a->max_error);
	if (a->metric && metric_of(a->metric, n))
		fprintf(out, " metric=%lld,%lld,%lld", (long long)n[0], (long long)n[1], (long long)n[2]);
	if (a->weight)
		fputs(" weight=", out);
	ctl_view_weight_put(a->weight, out);
}

int ctl_view_text(const struct ctl_view_options *a, char **ret, struct err *err)
{
	bool cropped;
	double box[4];

	return ctl_view_box(a, ret, &cropped, box, err);
}

int ctl_view_box(const struct ctl_view_options *a, char **ret, bool *ret_cropped, double ret_box[4], struct err *err)
{
	char *text = NULL;
	size_t size = 0;
	FILE *out;
	int r = check(a, err);

	if (r)
		return r;
	out = open_memstream(&text, &size);
	if (!out)
		return err_set(err, ERR_NOMEM, "no memory for a view");
	put_words(a, out);
	*ret_cropped = a->crop;
	if (a->crop)
		r = put_crop(a->crop, out, ret_box, err);
	if (!r && (a->bbox || a->polygon)) {
		fputs(" window=", out);
		r = put_window(a, out, err);
	}
	if (fclose(out) && !r)
		r = err_set(err, ERR_NOMEM, "no memory for a view");
	if (!r && size > AREA_TEXT_MAX)
		r = err_set(err, ERR_LIMIT, "the view takes %zu bytes, more than the %d that fit", size, AREA_TEXT_MAX);
	if (r)
		free(text);
	else
		*ret = text;
	return r;
}
