/* See format_lines.h. The room contour finds the lines; here its options become numbers of the file's units. */
#include "format_lines.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "format_digits.h"
#include "outfile.h"

enum { DECIMALS_MORE = 6, DECIMALS_MOST = 14 }; /* of a point between lattice points */
#define LINE_LIMIT (1ull << 34)                 /* bytes that the output must have left for one line */

int format_lines_open(struct outfile *out, const struct format_options *opt, const char *name,
		      int (*write)(struct format_lines *, struct err *), void **ret, struct err *err)
{
	struct format_lines *w;
	int r;

	if (!opt->interval.mantissa) {
		err_set(err, ERR_USAGE, "%s needs the height between two contours: --interval", name);
		return err_add_hint(err, "give it in the units of the heights, or with m, ft or ftUS, as in --interval 1m");
	}
	w = calloc(1, sizeof(*w));
	if (!w)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	w->out = out;
	w->write = write;
	w->opt = *opt;
	w->index = opt->has_index ? opt->index : FORMAT_INDEX_EACH;
	r = contour_new(out, &w->contour, err);
	if (r)
		free(w);
	else
		*ret = w;
	return r;
}

void *format_lines_free(void *writer)
{
	struct format_lines *w = writer;

	if (w) {
		contour_free(w->contour);
		free(w->comments);
		free(w->wkt);
	}
	free(w);
	return NULL;
}

/* ---- the head ---- */

static int length_of(const char *option, struct decimal value, const char *unit, const char *axes, const char *to,
		     struct contour_length *ret, struct err *err)
{
	*ret = (struct contour_length){value, 1, 1};
	if (!unit || format_unit_ratio(unit, to, &ret->num, &ret->den))
		return 0;
	err_set(err, ERR_USAGE, "--%s is in %s, but the unit of %s is %.30s", option, unit, axes, format_unit_known(to));
	return err_add_hint(err, "give a bare number in the units of the files, or stage the inputs with --assume-units");
}

static int tolerance_of(const struct format_options *o, const char *unit_xy, double *ret, struct err *err)
{
	struct contour_length l;
	int r = length_of("simplify", o->simplify, o->simplify_unit, "x and y", unit_xy, &l, err);

	if (!r)
		*ret = decimal_double(l.value) * (double)l.num / (double)l.den;
	return r;
}

static int options_of(struct format_lines *w, const struct acut_mesh_head *head, struct contour_options *to, struct err *err)
{
	const struct format_options *o = &w->opt;
	struct format_axis axis[3];
	const char *unit_z = o->z_unit ? o->z_unit : head->unit_z;
	int r = format_axis_init(axis, head, o, err);

	*to = (struct contour_options){.z_num = 1,
				       .z_den = 1,
				       .interrupted = o->interrupted,
				       .ctx = o->ctx,
				       .tile_p = w->tiler.p,
				       .tile_q = w->tiler.q,
				       .tiles = w->tiler.most};
	if (!r && o->z_unit)
		format_unit_ratio(head->unit_z, o->z_unit, &to->z_num, &to->z_den);
	if (!r)
		r = length_of("interval", o->interval, o->interval_unit, "z", unit_z, &to->interval, err);
	if (!r)
		r = length_of("base", o->base, o->base_unit, "z", unit_z, &to->base, err);
	if (!r)
		r = tolerance_of(o, head->unit_xy, &to->simplify, err);
	for (int i = 0; i < 2 && !r; i++) {
		to->axis[i] = (struct contour_axis){axis[i].a, axis[i].b, axis[i].e, axis[i].whole, axis[i].scale, axis[i].k};
		w->decimals = -axis[i].scale.exponent + DECIMALS_MORE;
		w->box[i] = format_axis_value(&axis[i], head->box[i]);
		w->box[i + 2] = format_axis_value(&axis[i], head->box[i + 3]);
	}
	w->decimals = w->decimals < DECIMALS_MORE ? DECIMALS_MORE : w->decimals > DECIMALS_MOST ? DECIMALS_MOST : w->decimals;
	return r;
}

/* Lines of text that files may have; crossings are not on the lattice, and its offset depends on how the points were pushed. */
static int add_comment(void *ctx, const char *text, struct err *err)
{
	struct format_lines *w = ctx;
	char *all;

	if (!strncmp(text, "acut-lattice ", 13))
		return 0;
	if (asprintf(&all, "%s%s%s", w->comments ? w->comments : "", w->comments ? "\n" : "", text) < 0)
		return err_set(err, ERR_NOMEM, "no memory for the description of contours");
	free(w->comments);
	w->comments = all;
	return 0;
}

/* The definition is of the heights, too, where it has them: not of converted ones. */
static int system_of(struct format_lines *w, const struct acut_mesh_head *head, const struct contour_options *o, struct err *err)
{
	const char *crs = format_unit_known(head->crs);
	bool same = o->z_num == o->z_den || !head->vertical || !*head->vertical;

	snprintf(w->name, sizeof(w->name), "%.*s", (int)strcspn(crs, "\n"), crs);
	w->degrees = head->unit_xy && !strcmp(head->unit_xy, "degree");
	w->epsg = head->epsg;
	if (w->epsg || !head->wkt || !*head->wkt || !same)
		return 0;
	w->wkt = strdup(head->wkt);
	return w->wkt ? 0 : err_set(err, ERR_NOMEM, "no memory for a coordinate system");
}

static int add_tolerance(struct format_lines *w, const struct acut_mesh_head *head, struct err *err)
{
	const char *unit = w->opt.simplify_unit ? w->opt.simplify_unit : head->unit_xy;
	char text[DECIMAL_TEXT_SIZE + 64], number[DECIMAL_TEXT_SIZE];

	snprintf(text, sizeof(text), "acut-simplified %s %.30s", decimal_scaled_text(w->opt.simplify, 1, number),
		 format_unit_known(unit));
	return add_comment(w, text, err);
}

static int set_up(struct format_lines *w, const struct acut_mesh_head *head, struct contour_options *to, struct err *err)
{
	int r = options_of(w, head, to, err);

	if (!r)
		r = system_of(w, head, to, err);
	if (!r)
		r = format_comment_head(head, &w->opt, add_comment, w, err);
	return r || !w->opt.simplify.mantissa ? r : add_tolerance(w, head, err);
}

int format_lines_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	struct format_lines *w = writer;
	struct contour_options to;
	int r = set_up(w, head, &to, err);

	return r ? r : contour_head(w->contour, head, &to, err);
}

int format_lines_resume(void *writer, const struct acut_mesh_head *head, struct cursor *from, struct err *err)
{
	struct format_lines *w = writer;
	struct contour_options to;
	int r = set_up(w, head, &to, err);

	return r ? r : contour_resume(w->contour, head, &to, from, err);
}

void format_lines_save(const void *writer, struct packer *to)
{
	contour_save(((const struct format_lines *)writer)->contour, to);
}

int format_lines_block(void *writer, const struct format_block *block, struct err *err)
{
	return contour_block(((struct format_lines *)writer)->contour, block->mesh, block->position, err);
}

/* ---- the end ---- */

static int join(struct format_lines *w, const struct acut_mesh_tail *tail, struct err *err)
{
	char text[128];
	int r;

	snprintf(text, sizeof(text), "acut-digest %s %s", tail->digest, tail->vertex_digest);
	r = add_comment(w, text, err);
	return r ? r : contour_join(w->contour, err);
}

int format_lines_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	struct format_lines *w = writer;
	int r = join(w, tail, err);

	if (!r)
		r = w->write(w, err);
	return r ? r : contour_done(w->contour, err);
}

void format_lines_tile(void *writer, const struct format_tiler *tiler)
{
	((struct format_lines *)writer)->tiler = *tiler;
}

int format_lines_tiles(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	struct format_lines *w = writer;
	const struct format_tiler *t = &w->tiler;
	struct outfile *mine = w->out;
	int64_t at[2];
	bool any;
	int r = join(w, tail, err);

	while (!r && !(r = contour_next_tile(w->contour, at, &any, err)) && any) {
		r = t->begin(t->ctx, at, &w->out, err);
		if (r)
			break;
		w->lines = 0;
		r = w->write(w, err);
		if (r)
			outfile_free(w->out);
		else
			r = t->end(t->ctx, at, w->out, w->lines_box, w->lines, err);
	}
	w->out = mine;
	return r ? r : contour_done(w->contour, err);
}

int format_lines_next(struct format_lines *w, struct contour_line *ret, struct err *err)
{
	int r = contour_next(w->contour, ret, err);

	if (r || !ret->points)
		return r;
	for (int i = 0; i < 4; i++)
		if (!w->lines || (i < 2 ? ret->box[i] < w->lines_box[i] : ret->box[i] > w->lines_box[i]))
			w->lines_box[i] = ret->box[i];
	w->lines++;
	return 0;
}

uint64_t format_lines_count(const void *writer)
{
	return ((const struct format_lines *)writer)->lines;
}

struct format_simplified format_lines_simplified(const void *writer)
{
	struct contour_simplified s = contour_simplified(((const struct format_lines *)writer)->contour);

	return (struct format_simplified){s.vertices, s.left_out};
}

bool format_lines_is_index(const struct format_lines *w, int64_t level)
{
	return w->index && level % (int64_t)w->index == 0;
}

int format_lines_room(const struct format_lines *w, struct err *err)
{
	if (outfile_size(w->out) < OUTFILE_ANNEX_AT - LINE_LIMIT)
		return 0;
	err_set(err, ERR_LIMIT, "a file of contours cannot be more than 112 GiB");
	return err_add_hint(err, "give a larger --interval, or a part with --bbox");
}

char *format_lines_text(const struct format_lines *w, double v, char *at)
{
	static const double ten[] = {1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14};
	double size = fabs(v), whole = floor(size);
	int decimals = w->decimals;
	uint64_t rest;

	if (size >= 1e15)
		return at + sprintf(at, "%.17g", v);
	rest = (uint64_t)llrint((size - whole) * ten[decimals]);
	if ((double)rest >= ten[decimals]) {
		rest = 0;
		whole++;
	}
	if (v < 0 && (rest || whole > 0))
		*at++ = '-';
	at = format_digits_put((uint64_t)whole, at);
	for (; decimals && rest % 10 == 0; decimals--)
		rest /= 10;
	if (!decimals)
		return at;
	*at++ = '.';
	if (decimals > 8) {
		at = format_digits_last((uint32_t)(rest / 100000000), decimals - 8, at);
		return format_digits_last((uint32_t)(rest % 100000000), 8, at);
	}
	return format_digits_last((uint32_t)rest, decimals, at);
}
