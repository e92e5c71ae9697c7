/*
 * From a request to a view of one dataset (view.h). A request is "ask 1" and words like those of the canonical text, in
 * any order, with exact decimals for positions and heights. These become lattice numbers here, rounded once, floor(v +
 * 1/2), in rationals of 128 bits. The rounding is monotone, like that of points. So a point that is in the requested
 * area or range before both are rounded is in the rounded one.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "decimal.h"
#include "err.h"
#include "lattice.h"
#include "view.h"
#include "view_area.h"
#include "view_word.h"

struct request {
	const struct lattice *lattice;
	const char *unit_xy, *unit_z;
	struct view *view;
	int32_t exponent;       /* of the corners of an area */
	struct view_area *area; /* the area that is being read */
	const char *option;
	uint64_t weighted[4]; /* classes that --weight has named */
	struct err *err;
};

enum { DECIMAL_MOST = 64 }; /* characters of a number */

static int bad_number(struct view_word w, const char *what, struct err *err)
{
	err_set(err, ERR_USAGE, "%s: \"%.*s\" is not a number that can be kept exactly", what, (int)(w.n < 60 ? w.n : 60), w.at);
	return err_add_hint(err, "give a decimal of at most 18 digits, as in 1250.75");
}

static bool to_decimal(struct view_word w, struct decimal *ret)
{
	char text[DECIMAL_MOST + 1];

	if (w.n > DECIMAL_MOST)
		return false;
	memcpy(text, w.at, w.n);
	text[w.n] = '\0';
	return decimal_parse(text, ret);
}

static int parse_height(struct request *q, struct view_word w, const struct view_word_row *row)
{
	char option[DECIMAL_MOST];
	struct decimal d;

	snprintf(option, sizeof option, "--%.*s", (int)strlen(row->word) - 1, row->word);
	if (!to_decimal(w, &d))
		return bad_number(w, option, q->err);
	decimal_steps(d.mantissa, d.exponent, 1, 1, q->lattice->scale_z, view_word_height(q->view, row));
	*view_word_flag(q->view, row->has) = true;
	return 0;
}

/* ---- areas ---- */

static int parse_box(struct request *q, struct view_word w, int64_t box[4])
{
	struct decimal d[4];
	struct view_word part;

	for (unsigned i = 0; i < 4; i++) {
		if (!view_word_part(&w, ',', &part))
			return 1;
		if (!to_decimal(part, &d[i]))
			return bad_number(part, q->option, q->err);
		decimal_steps(d[i].mantissa, d[i].exponent, 1, 1, q->lattice->scale_xy, &box[i]);
	}
	return w.n != 0;
}

static int area_ring(void *ctx, bool shell)
{
	struct request *q = ctx;

	return view_area_ring(q->area, shell, q->err);
}

static int area_corner(void *ctx, __int128 x, __int128 y)
{
	struct request *q = ctx;
	struct decimal scale = q->lattice->scale_xy;
	int64_t at[2];

	/* A number out of range fails in view_area_end. */
	decimal_steps(x, q->exponent, 1, 1, scale, &at[0]);
	decimal_steps(y, q->exponent, 1, 1, scale, &at[1]);
	return view_area_corner(q->area, at[0], at[1], q->err);
}

/* *area belongs to the view from the start, which frees it if this fails. */
static int parse_area(struct request *q, struct view_word w, uint8_t *kind, int64_t box[4], struct view_area **area)
{
	struct view_rings to = {area_ring, area_corner, q};
	struct view_word exponent;
	int64_t e;
	int r;

	if (!view_word_part(&w, ':', &exponent) || !view_word_i64(exponent, &e) || e < -40 || e > 40)
		return 1;
	q->exponent = (int32_t)e;
	*area = q->area = view_area_new();
	if (!*area)
		return err_set(q->err, ERR_NOMEM, "no memory for the area of a view");
	if ((r = view_word_rings(w, &to)) || (r = view_area_end(*area, q->err)))
		return r;
	view_area_bounds(*area, box);
	if (view_area_is_box(*area)) {
		view_area_free(*area);
		*area = NULL;
		*kind = VIEW_CROP_BOX;
	}
	return 0;
}

/* For a crop or a window. */
static int parse_place(struct request *q, struct view_word w, uint8_t *kind, int64_t box[4], struct view_area **area)
{
	*kind = VIEW_CROP_AREA;
	if (view_word_after(&w, "area@"))
		return parse_area(q, w, kind, box, area);
	*kind = VIEW_CROP_BOX;
	return view_word_after(&w, "box:") ? parse_box(q, w, box) : 1;
}

static int take_window(struct request *q, struct view_word w)
{
	q->option = "--bbox";
	return parse_place(q, w, &q->view->window, q->view->window_box, &q->view->window_area);
}

/* ---- lengths ---- */

/* Metres in one unit, as a fraction. US survey foot: 39.37 inches are a metre (1893). */
static const struct unit {
	const char *suffix, *name;
	int64_t up, down;
} units[] = {
	{"ftUS", "us-survey-foot", 1200, 3937},
	{"ft", "foot", 3048, 10000},
	{"m", "metre", 1, 1},
};

/* The unit at the end of a length, which is taken off; NULL: it has none. */
static const struct unit *take_unit(struct view_word *w)
{
	for (unsigned i = 0; i < sizeof units / sizeof *units; i++) {
		size_t n = strlen(units[i].suffix);

		if (w->n > n && !memcmp(w->at + w->n - n, units[i].suffix, n)) {
			w->n -= n;
			return &units[i];
		}
	}
	return NULL;
}

/* `option`: "--thin". */
static int no_unit(struct request *q, struct view_word w, const char *option, bool degrees, bool heights)
{
	int n = (int)(w.n < 60 ? w.n : 60);

	if (degrees) {
		err_set(q->err, ERR_INPUT, "a length of %.*s has no meaning in a plane of degrees", n, w.at);
		return err_add_hint(q->err, "project the points, or give %s a bare number of degrees", option);
	}
	err_set(q->err, ERR_INPUT, "a length of %.*s cannot be converted: the unit of %s is unknown", n, w.at,
		heights ? "the heights" : "the dataset");
	return err_add_hint(q->err, "give %s a bare number in the units of the files, or push with --assume-units%s", option,
			    heights ? " XY,Z" : "");
}

/* The factor from the length's unit to `unit` of the dataset; 1 without a suffix. */
static int parse_unit(struct request *q, struct view_word *w, const char *option, const char *unit, int64_t *up, int64_t *down)
{
	struct view_word whole = *w;
	const struct unit *of, *to = NULL;

	*up = *down = 1;
	of = take_unit(w);
	for (unsigned i = 0; i < sizeof units / sizeof *units; i++)
		if (!strcmp(unit, units[i].name))
			to = &units[i];
	if (!of)
		return 0;
	if (!to)
		return no_unit(q, whole, option, !strcmp(unit, "degree"), unit == q->unit_z);
	if (of != to) {
		*up = of->up * to->down;
		*down = of->down * to->up;
	}
	return 0;
}

bool view_same_length(const char *a_text, size_t a_size, const char *b_text, size_t b_size)
{
	enum { TENS_MOST = 12 }; /* equal numbers have no more between them, as mantissas do not end with zeros */
	struct view_word a = {a_text, a_size}, b = {b_text, b_size};
	const struct unit *ua = take_unit(&a), *ub = take_unit(&b);
	struct decimal da, db;
	__int128 va, vb;

	if (!ua != !ub || !to_decimal(a, &da) || !to_decimal(b, &db))
		return false;
	if (!da.mantissa || !db.mantissa)
		return da.mantissa == db.mantissa;
	va = ua != ub ? (__int128)da.mantissa * ua->up * ub->down : da.mantissa;
	vb = ua != ub ? (__int128)db.mantissa * ub->up * ua->down : db.mantissa;
	if (da.exponent > db.exponent + TENS_MOST || db.exponent > da.exponent + TENS_MOST)
		return false;
	for (; da.exponent > db.exponent; da.exponent--)
		va *= 10;
	for (; db.exponent > da.exponent; db.exponent--)
		vb *= 10;
	return va == vb;
}

static int parse_pick(struct view *v, struct view_word w)
{
	static const char *const pick[] = {"lowest", "highest", "median"};

	for (unsigned i = 0; i < sizeof pick / sizeof *pick; i++) {
		if (!view_word_is(w, pick[i]))
			continue;
		v->thin.pick = (uint8_t)i;
		return 0;
	}
	return 1;
}

/* A length that is not negative, and its factor to lattice numbers. */
struct length {
	struct decimal d;
	int64_t up, down;
};

static int read_length(struct request *q, struct view_word length, const char *option, const char *unit, bool zero,
		       struct length *ret)
{
	struct view_word number = length;
	struct decimal d;
	int r = parse_unit(q, &number, option, unit, &ret->up, &ret->down);

	if (r)
		return r;
	if (!to_decimal(number, &d) || d.mantissa < 0 || (!d.mantissa && !zero)) {
		err_set(q->err, ERR_USAGE, "%s: \"%.*s\" is not a length", option, (int)(length.n < 60 ? length.n : 60),
			length.at);
		return err_add_hint(q->err, "give a number in the units of the files, or with m, ft or ftUS");
	}
	ret->d = d;
	return 0;
}

/* In lattice numbers, rounded once; *ret_fits: it is not larger than any dataset. */
static int parse_length(struct request *q, struct view_word length, const char *option, bool zero, int64_t *ret, bool *ret_fits)
{
	struct length l;
	int r = read_length(q, length, option, q->unit_xy, zero, &l);

	if (!r)
		*ret_fits = decimal_steps(l.d.mantissa, l.d.exponent, l.up, l.down, q->lattice->scale_xy, ret);
	return r;
}

static int parse_thin(struct request *q, struct view_word w)
{
	struct view_word length;
	char scale[DECIMAL_TEXT_SIZE];
	bool fits;
	int r;

	if (!view_word_part(&w, ':', &length))
		return 1;
	r = parse_length(q, length, "--thin", false, &q->view->thin.cell, &fits);
	if (r)
		return r;
	if (!fits) {
		err_set(q->err, ERR_USAGE, "a cell of %.*s is larger than any dataset", (int)(length.n < 60 ? length.n : 60),
			length.at);
		return err_add_hint(q->err, "give --thin a smaller cell");
	}
	if (!q->view->thin.cell) {
		err_set(q->err, ERR_USAGE, "a cell of %.*s is less than half a step of the lattice (%s)",
			(int)(length.n < 60 ? length.n : 60), length.at, decimal_text(q->lattice->scale_xy, scale));
		return err_add_hint(q->err, "give --thin a larger cell, or leave it out");
	}
	return parse_pick(q->view, w);
}

static int parse_clear(struct request *q, struct view_word w)
{
	bool fits;
	int r = parse_length(q, w, "--breakline-clear", true, &q->view->breakline_clear, &fits);

	if (r || (fits && q->view->breakline_clear <= VIEW_CLEAR_MOST))
		return r;
	err_set(q->err, ERR_USAGE, "%.*s is more than any dataset is wide", (int)(w.n < 60 ? w.n : 60), w.at);
	return err_add_hint(q->err, "give --breakline-clear a smaller length");
}

static int bad_weight(struct request *q, struct view_word w, const char *what)
{
	char text[61];
	int n = snprintf(text, sizeof text, "%.*s", (int)(w.n < 60 ? w.n : 60), w.at);

	/* As the user wrote it. */
	for (char *colon = memchr(text, ':', (size_t)n); colon; colon = NULL)
		*colon = '=';
	err_set(q->err, ERR_USAGE, "--weight: %s: \"%s\"", what, text);
	return err_add_hint(q->err,
			    "give a class and a radius, as in --weight 2=1.5 or --weight 2=1.5m, each class once, at most %d",
			    VIEW_CLASS_WEIGHTS);
}

/* "@NAME": only who knows the files of the dataset can say which numbers it has (job_source.c). */
static int unknown_files(struct request *q, struct view_word w)
{
	err_set(q->err, ERR_USAGE, "--weight: which files \"%.*s\" names is known in the dataset only",
		(int)(w.n < 60 ? w.n : 60), w.at + 1);
	return err_add_hint(q->err, "give the canonical text of the view, which has their numbers");
}

static int parse_weight(struct request *q, struct view_word one, struct slots_list *sources)
{
	struct view_word radius = one, of;
	int64_t steps;
	unsigned c = 0;
	bool fits, files;
	int r;

	if (!view_word_part(&radius, ':', &of) || !radius.n)
		return bad_weight(q, one, "it is no class with a radius");
	if (of.n && *of.at == '@')
		return unknown_files(q, of);
	files = view_word_after(&of, "#");
	if (!files && !view_word_class(of, &c))
		return bad_weight(q, one, "it is no class with a radius");
	r = parse_length(q, radius, "--weight", true, &steps, &fits);
	if (r)
		return r;
	if (!fits || steps > VIEW_RADIUS_MOST)
		return bad_weight(q, one, "the radius is more than 2^30 steps of the lattice");
	if (files) {
		r = view_word_sources(of, (int32_t)steps, sources);
		return r < 0 ? err_set(q->err, ERR_NOMEM, "no memory for a view") : r;
	}
	if (q->weighted[c >> 6] >> (c & 63) & 1)
		return bad_weight(q, one, "the class is named twice");
	q->weighted[c >> 6] |= UINT64_C(1) << (c & 63);
	if (!view_weight_set(q->view, (uint8_t)c, (int32_t)steps))
		return bad_weight(q, one, "too many classes have a radius");
	return 0;
}

/* "2:1.5,9:30ft,#1-3+7:2": a radius that rounds to zero is none. */
static int parse_weights(struct request *q, struct view_word all)
{
	struct slots_list sources = {NULL, 0, 0};
	struct view_word one;
	int r = !all.n || all.at[all.n - 1] == ',';

	while (!r && view_word_part(&all, ',', &one))
		r = parse_weight(q, one, &sources);
	if (!r)
		r = view_weight_sources(q->view, &sources, q->err);
	slots_list_free(&sources);
	return r;
}

/* Zero keeps nearly all points, so it is no bound for one who asks for more. */
static int no_bound(struct request *q, struct view_word w)
{
	char scale[DECIMAL_TEXT_SIZE];
	const char *step = decimal_text(q->lattice->scale_z, scale);

	err_set(q->err, ERR_USAGE, "an error of %.*s is less than a step of the heights' lattice (%s)",
		(int)(w.n < 60 ? w.n : 60), w.at, step);
	return err_add_hint(q->err, "give --max-error at least %s, or 0, which leaves out what the mesh shows exactly", step);
}

/* Rounded down, so that what is within the bound in steps of the lattice is within the length. */
static int parse_error(struct request *q, struct view_word w)
{
	struct length l;
	int r = read_length(q, w, "--max-error", q->unit_z, true, &l);
	bool fits;

	if (r)
		return r;
	fits = decimal_steps_down(l.d.mantissa, l.d.exponent, l.up, l.down, q->lattice->scale_z, &q->view->max_error);
	q->view->has_max_error = true;
	if (l.d.mantissa && !q->view->max_error)
		return no_bound(q, w);
	if (fits && q->view->max_error <= VIEW_ERROR_MOST)
		return 0;
	err_set(q->err, ERR_USAGE, "an error of %.*s is higher than any dataset", (int)(w.n < 60 ? w.n : 60), w.at);
	return err_add_hint(q->err, "give --max-error a smaller length");
}

/* ---- words ---- */

static int parse_word(struct request *q, enum view_word_id id, struct view_word w)
{
	struct view *v = q->view;

	if (id == VIEW_WORD_crop) {
		q->option = "--crop";
		return parse_place(q, w, &v->crop, v->crop_box, &v->area);
	}
	if (id == VIEW_WORD_window)
		return take_window(q, w);
	if (id == VIEW_WORD_thin)
		return parse_thin(q, w);
	if (id == VIEW_WORD_weight)
		return parse_weights(q, w);
	if (id == VIEW_WORD_breakline_clear)
		return parse_clear(q, w);
	if (id == VIEW_WORD_max_error)
		return parse_error(q, w);
	if (view_word_rows[id].kind == VIEW_KIND_HEIGHT)
		return parse_height(q, w, &view_word_rows[id]);
	return !view_word_plain(v, id, w);
}

static int parse_words(struct request *q, struct view_word all)
{
	struct view_seen seen = {0};

	while (all.n) {
		struct view_word w;
		int r;

		if (!view_word_after(&all, " ") || !all.n)
			return 1;
		w = (struct view_word){all.at, strcspn(all.at, " ")};
		all.at += w.n;
		all.n -= w.n;
		enum view_word_id id = view_word_next(&seen, &w);

		if (id == VIEW_WORDS)
			return 1;
		r = parse_word(q, id, w);
		if (r)
			return r;
	}
	return 0;
}

static size_t corners_of(const struct view_area *a)
{
	size_t corners = 0;

	for (size_t i = 0; a && i < view_area_rings(a); i++) {
		const int64_t(*corner)[2];
		bool shell;

		corners += view_area_ring_at(a, i, &shell, &corner);
	}
	return corners;
}

static int too_long(const struct view *v, struct err *err)
{
	if (!v->area && !v->window_area) {
		err_set(err, ERR_LIMIT, "the files that --weight names have too many numbers for a view");
		return err_add_hint(err, "push files that shall have the same weight together, so that their numbers follow");
	}
	err_set(err, ERR_LIMIT, "the area of --crop or --polygon has %zu corners, more than fit into a view",
		corners_of(v->area) + corners_of(v->window_area));
	return err_add_hint(err, "simplify it, for example with ogr2ogr -simplify, or give its box");
}

static int long_request(size_t n, struct err *err)
{
	err_set(err, ERR_LIMIT, "a view of %zu bytes is too long: %d fit", n, VIEW_TEXT_MAX);
	return err_add_hint(err, "give --weight fewer items, or simplify the area, for example with ogr2ogr -simplify");
}

int view_resolve(const char *text, const struct lattice *lattice, const char *unit_xy, const char *unit_z, struct view *ret,
		 struct err *err)
{
	return view_resolve_window(text, "", lattice, unit_xy, unit_z, ret, err);
}

int view_resolve_window(const char *text, const char *window, const struct lattice *lattice, const char *unit_xy,
			const char *unit_z, struct view *ret, struct err *err)
{
	struct view v = VIEW_INIT;
	struct request q = {.lattice = lattice, .unit_xy = unit_xy, .unit_z = unit_z, .view = &v, .err = err, .option = "--crop"};
	struct view_word all = {text, strlen(text)};
	int r = 0;

	if (view_word_after(&all, "ask 1"))
		r = all.n > VIEW_TEXT_MAX ? long_request(all.n, err) : parse_words(&q, all);
	else if (all.n)
		r = view_parse(text, &v, err);
	if (!r && *window) {
		view_area_free(v.window_area);
		v.window_area = NULL;
		r = strlen(window) > VIEW_TEXT_MAX ? 1 : take_window(&q, (struct view_word){window, strlen(window)});
		text = window;
	}
	if (r == 1)
		r = err_set(err, ERR_PROTO, "\"%.200s\" is not a view that can be asked for", text);
	if (!r)
		r = view_check(&v, err);
	if (!r && view_text_size(&v) > VIEW_TEXT_MAX)
		r = too_long(&v, err);
	if (r)
		view_done(&v);
	else
		*ret = v;
	return r;
}
