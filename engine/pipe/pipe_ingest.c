/*
 * Ingest: raw points of an input, converted to the dataset's lattice, into a stage. Reads batch by batch and keeps only
 * one batch.
 */
#include "pipe_lines.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_stage.h"

enum { BATCH = 8192 };

struct batch {
	int64_t raw[BATCH][3];
	int32_t at[BATCH][3];
	struct point point[BATCH];
	uint8_t cls[BATCH], ret[BATCH], flags[BATCH];
	struct input_vertex vertex[BATCH];
};

size_t pipe_ingest_bytes(void)
{
	return sizeof(struct batch) + pipe_lines_bytes() + input_bytes() + crs_step_bytes();
}

static void batch_points(struct batch *b, size_t n)
{
	size_t i;

	for (i = 0; i < n; i++)
		b->point[i] = (struct point){
			.x = b->at[i][0],
			.y = b->at[i][1],
			.z = b->at[i][2],
			.cls = b->cls[i],
			.ret = b->ret[i],
			.tag = b->flags[i] & POINT_FLAGS,
		};
}

/* Counts what headers may state incorrectly. */
static void count_batch(const struct batch *b, size_t n, struct pipe_ingested *in)
{
	for (size_t i = 0; i < n; i++)
		in->returns[b->ret[i] & 15]++;
	for (int k = 0; k < 3; k++) {
		int64_t low = in->points ? in->low[k] : b->raw[0][k], high = in->points ? in->high[k] : b->raw[0][k];

		for (size_t i = 0; i < n; i++) {
			low = b->raw[i][k] < low ? b->raw[i][k] : low;
			high = b->raw[i][k] > high ? b->raw[i][k] : high;
		}
		in->low[k] = low;
		in->high[k] = high;
	}
}

static int stage_batch(const struct pipe_ingest_params *p, struct pipe_lines *lines, struct batch *b, size_t n, struct err *err)
{
	if (lines)
		return pipe_lines_add(lines, (const int32_t(*)[3])b->at, b->vertex, n, err);
	batch_points(b, n);
	return p->split ? grid_stage_share(p->stage, b->point, n, err) : grid_stage_add(p->stage, b->point, n, err);
}

/* The conversion from the file's numbers to the lattice's: a map, or a step if a map is not sufficient. */
struct conversion {
	struct lattice_map map;
	struct crs_step *step;
};

static int conversion_init(struct conversion *w, const struct input_info *info, const struct pipe_ingest_params *p,
			   struct err *err)
{
	struct crs_step_params step;

	w->step = NULL;
	if (!p->step)
		return lattice_map_init(&w->map, p->lattice, &info->coords, err);
	step = *p->step;
	step.lattice = p->lattice;
	step.coords = &info->coords;
	return crs_step_new(&step, &w->step, err);
}

static int ingest_batches(struct input *input, const struct conversion *w, const struct pipe_ingest_params *p,
			  struct pipe_lines *lines, struct batch *b, struct pipe_ingested *in, struct err *err)
{
	struct input_points pts = {
		.raw = b->raw, .cls = b->cls, .ret = b->ret, .flags = b->flags, .cap = BATCH, .vertex = b->vertex};
	const struct input_info *info = input_info(input);
	size_t bad = 0;
	int r;

	for (;;) {
		r = input_read(input, &pts, err);
		if (r || !pts.n)
			return r ? r : input_dry(input) ? PIPE_E_DRY : 0;
		r = w->step ? crs_step_apply(w->step, (const int64_t(*)[3])b->raw, pts.n, b->at, &bad, err) :
			      lattice_map_apply(&w->map, (const int64_t(*)[3])b->raw, pts.n, b->at, &in->moved, in->max_shift,
						&bad, err);
		if (r) {
			char field[64];

			if (lines)
				snprintf(field, sizeof field, "feature %u", b->vertex[bad].feature);
			else
				snprintf(field, sizeof field, "point %llu",
					 (unsigned long long)(p->before + info->first_point + in->points + bad));
			return err_add_place(err, ERR_NO_OFFSET, field);
		}
		r = stage_batch(p, lines, b, pts.n, err);
		if (r)
			return r;
		count_batch(b, pts.n, in);
		in->points += pts.n;
		if (lines)
			pipe_lines_counts(lines, in);
		if (p->progress && p->progress(p->ctx, in->points + in->vertices_added))
			return err_set(err, ERR_CANCELLED, "cancelled after %llu points", (unsigned long long)in->points);
	}
}

int pipe_ingest(struct input *input, const struct pipe_ingest_params *p, struct pipe_ingested *ret, struct err *err)
{
	const struct input_info *info = input_info(input);
	struct pipe_ingested in = {0};
	struct pipe_lines *lines = NULL;
	struct conversion w;
	struct batch *b;
	int r;

	if (info->lines.are && pipe_lines_new(p, info, &lines, err))
		return err_add_file(err, info->coords.name);
	r = conversion_init(&w, info, p, err);
	if (r) {
		pipe_lines_free(lines);
		return err_add_file(err, info->coords.name);
	}
	b = malloc(sizeof *b);
	r = b ? ingest_batches(input, &w, p, lines, b, &in, err) :
		err_set(err, ERR_NOMEM, "no memory to read %s", info->coords.name);
	free(b);
	if (!r && lines)
		r = pipe_lines_end(lines, err);
	if (lines)
		pipe_lines_counts(lines, &in);
	pipe_lines_free(lines);
	if (w.step)
		in.shift = crs_step_shift(w.step);
	crs_step_free(w.step);
	if (r < 0)
		return err_add_file(err, info->coords.name);
	in.bytes_read = input_bytes_read(input);
	in.bytes = info->bytes;
	in.partial = info->partial;
	in.left_out = info->left_out;
	in.left_out_line = info->left_out_line;
	snprintf(in.warning, sizeof in.warning, "%s", info->warning);
	*ret = in;
	return r;
}

void pipe_ingested_add(struct pipe_ingested *sum, const struct pipe_ingested *part)
{
	for (int k = 0; k < 3 && part->points; k++) {
		if (!sum->points || part->low[k] < sum->low[k])
			sum->low[k] = part->low[k];
		if (!sum->points || part->high[k] > sum->high[k])
			sum->high[k] = part->high[k];
	}
	for (int i = 0; i < 16; i++)
		sum->returns[i] += part->returns[i];
	sum->points += part->points;
	sum->moved += part->moved;
	sum->bytes_read += part->bytes_read;
	sum->bytes = part->bytes;
	sum->partial = part->partial;
	if (part->left_out > sum->left_out) { /* the largest so far */
		sum->left_out = part->left_out;
		sum->left_out_line = part->left_out_line;
	}
	for (int i = 0; i < 3; i++)
		if (part->max_shift[i] > sum->max_shift[i])
			sum->max_shift[i] = part->max_shift[i];
	crs_shift_add(&sum->shift, &part->shift);
	if (strlen(part->warning) > strlen(sum->warning)) /* the longer warning includes the shorter one */
		memcpy(sum->warning, part->warning, sizeof sum->warning);
}

__attribute__((format(printf, 2, 3))) static void warn(struct pipe_ingested *in, const char *fmt, ...)
{
	size_t n = strlen(in->warning);
	va_list ap;

	if (n && n + 3 < sizeof in->warning)
		n += (size_t)snprintf(in->warning + n, sizeof in->warning - n, "; ");
	va_start(ap, fmt);
	vsnprintf(in->warning + n, sizeof in->warning - n, fmt, ap);
	va_end(ap);
}

static long double exact(struct decimal d)
{
	long double power = 1;

	for (int e = d.exponent < 0 ? -d.exponent : d.exponent; e > 0; e--)
		power *= 10;
	return d.exponent < 0 ? (long double)d.mantissa / power : (long double)d.mantissa * power;
}

/* A bound of the header in units of the scale; the offset is the decimal that it stands for. */
static long double raw_of(const struct lattice_input *c, int k, double bound)
{
	struct decimal d;

	return !isfinite(bound) || !decimal_from_double(bound, &d) ?
		       NAN :
		       (exact(d) - (c->has_offset ? exact(c->offset[k]) : 0)) / exact(c->scale[k]);
}

/* Reports points outside the header's box. Points inside a box that is too large are correct, and an invalid box was reported
 * with the header. Less than a unit is the rounding of a writer that keeps its own bounds and cuts off what the records do not
 * hold. Text has no header; its box is that of its points. */
static void compare_box(struct pipe_ingested *in, const struct lattice_input *c)
{
	static const long double unit = 1 - 1e-6L;

	for (int k = 0; k < 3; k++) {
		long double low = raw_of(c, k, c->min[k]) - in->low[k], high = raw_of(c, k, c->max[k]) - in->high[k];

		if (!(c->min[k] <= c->max[k]) || (low <= unit && high >= -unit))
			continue;
		warn(in, "the header's box is wrong: %c %.10g to %.10g, its points %.10g to %.10g", "xyz"[k], c -> min[k],
		     c -> max[k], (double)(in->low[k] * exact(c->scale[k]) + exact(c->offset[k])),
		     (double)(in->high[k] * exact(c->scale[k]) + exact(c->offset[k])));
		return;
	}
}

void pipe_ingested_compare(struct pipe_ingested *in, const struct input_info *info)
{
	if (info->has_trailing && info->trailing)
		warn(in, "%llu bytes behind the last point belong to nothing", (unsigned long long)info->trailing);
	/* Points that were skipped are unknown. */
	if (!in->points || info->partial || !info->coords.has_offset || in->points != info->claimed)
		return;
	compare_box(in, &info->coords);
	for (int i = 1; info->has_returns && !info->miscounted && i < 16; i++) {
		if (info->returns[i] == in->returns[i])
			continue;
		warn(in, "the header counts %llu points of return %d, there are %llu", (unsigned long long)info->returns[i], i,
		     (unsigned long long)in->returns[i]);
		return;
	}
}
