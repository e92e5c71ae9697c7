/*
 * Lines of an input: vertices on the lattice into a file of lines (breakline.h).
 *
 * Model: the rings of a lake are kept until its feature ends if all of its vertices get one level; all else passes through. Equal
 * vertices in a row become one, and the last one of a ring that repeats the first goes. Points are added to a segment at equal
 * divisions, counted from that end which is lower by x, y and z, so that they are the same for either direction.
 */
#include "pipe_lines.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "breakline.h"
#include "crs.h"
#include "err.h"
#include "grid_manifest.h"

enum { OUT = 4096 };
static const double parts_most = 1 << 20; /* of one segment */

_Static_assert((int)INPUT_HARD == BREAKLINE_HARD && (int)INPUT_LAKE == BREAKLINE_LAKE &&
		       (int)INPUT_BOUNDARY == BREAKLINE_BOUNDARY && (int)INPUT_HOLE == BREAKLINE_HOLE,
	       "kinds of lines have one order");
_Static_assert((int)BREAKLINE_KINDS == GRID_LINE_KINDS, "and their counts are in manifests");

struct pipe_lines {
	const struct pipe_ingest_params *p;
	const struct lattice *lattice;
	struct breakline_writer *writer;
	double step;    /* the longest segment, in lattice numbers; 0: any */
	unsigned level; /* of lakes: INPUT_LEVEL_... */
	struct breakline_vertex held, first;
	bool any; /* the line has a vertex: `held` is the last one, not written yet */
	bool ring, single;
	int32_t (*lake)[4]; /* x, y, z, bits of the vertices of a lake so far */
	size_t nlake;
	struct breakline_vertex lake_first;
	bool in_lake;
	uint64_t dropped, added;
	struct breakline_vertex out[OUT];
	size_t nout;
};

size_t pipe_lines_bytes(void)
{
	return sizeof(struct pipe_lines);
}

/* ---- the file ---- */

static int flush(struct pipe_lines *l, struct err *err)
{
	int r = l->nout ? breakline_write(l->writer, l->out, l->nout, err) : 0;

	l->nout = 0;
	return r;
}

static int put(struct pipe_lines *l, const struct breakline_vertex *v, struct err *err)
{
	l->out[l->nout++] = *v;
	return l->nout == OUT ? flush(l, err) : 0;
}

/* ---- points along a segment ---- */

static bool is_before(const struct breakline_vertex *a, const struct breakline_vertex *b)
{
	if (a->x != b->x)
		return a->x < b->x;
	return a->y != b->y ? a->y < b->y : a->z < b->z;
}

/* floor(from + (to - from) * k / n + 1/2) */
static int32_t divide(int32_t from, int32_t to, int64_t k, int64_t n)
{
	__int128 num = (__int128)((int64_t)to - from) * k * 2 + n, den = 2 * (__int128)n, q = num / den;

	return (int32_t)(from + (int64_t)(q - (num % den < 0)));
}

static int refuse(const struct breakline_vertex *v, struct err *err)
{
	char field[32];

	snprintf(field, sizeof field, "feature %u", v->number);
	return err_add_place(err, ERR_NO_OFFSET, field);
}

static int put_divisions(struct pipe_lines *l, const struct breakline_vertex *a, const struct breakline_vertex *b,
			 struct err *err)
{
	double dx = (double)b->x - a->x, dy = (double)b->y - a->y;
	double parts = l->step > 0 ? ceil(sqrt(dx * dx + dy * dy) / l->step) : 1;
	bool forwards = is_before(a, b);
	const struct breakline_vertex *from = forwards ? a : b, *to = forwards ? b : a;
	int64_t n = (int64_t)parts;

	if (parts > parts_most) {
		err_set(err, ERR_LIMIT, "it has a segment that would be divided into %.0f parts", parts);
		err_add_hint(err, "give a greater length for --densify");
		return refuse(a, err);
	}
	for (int64_t i = 1; i < n; i++) {
		int64_t k = forwards ? i : n - i;
		struct breakline_vertex v = {
			.x = divide(from->x, to->x, k, n),
			.y = divide(from->y, to->y, k, n),
			.z = divide(from->z, to->z, k, n),
			.kind = a->kind,
			.number = a->number,
		};
		int r = put(l, &v, err);

		if (r)
			return r;
		l->added++;
	}
	return 0;
}

/* ---- lines ---- */

static bool same_place(const struct breakline_vertex *a, const struct breakline_vertex *b)
{
	return a->x == b->x && a->y == b->y && a->z == b->z;
}

static int end_line(struct pipe_lines *l, struct err *err)
{
	bool closes = l->any && l->ring && !l->single;
	int r = 0;

	if (closes && same_place(&l->held, &l->first)) {
		l->dropped++; /* the segment to it is the last one */
	} else if (l->any) {
		r = put(l, &l->held, err);
		if (!r && closes)
			r = put_divisions(l, &l->held, &l->first, err);
	}
	l->any = false;
	return r;
}

static int add_vertex(struct pipe_lines *l, const struct breakline_vertex *v, struct err *err)
{
	int r = 0;

	if (v->bits & BREAKLINE_LINE) {
		r = end_line(l, err);
		l->first = *v;
		l->ring = v->bits & BREAKLINE_RING;
		l->single = true;
	} else if (same_place(v, &l->held)) {
		l->dropped++;
		return 0;
	} else {
		r = put(l, &l->held, err);
		if (!r)
			r = put_divisions(l, &l->held, v, err);
		l->single = false;
	}
	l->held = *v;
	l->any = true;
	return r;
}

/* ---- lakes ---- */

static int uneven(const struct pipe_lines *l, const struct breakline_vertex *v, int32_t z, struct err *err)
{
	err_set(err, ERR_INPUT, "it is a lake, and the z of its rings are not the same: %.10g and %.10g",
		lattice_coordinate(l->lattice, 2, l->lake_first.z), lattice_coordinate(l->lattice, 2, z));
	err_add_hint(
		err,
		"give its rings one level, or choose which one counts: --lake-level min, max or mean; several lakes are several features");
	return refuse(v, err);
}

static int32_t level_of(const struct pipe_lines *l)
{
	int64_t sum = 0, n = (int64_t)l->nlake;
	int32_t low = INT32_MAX, high = INT32_MIN;

	for (size_t i = 0; i < l->nlake; i++) {
		int32_t z = l->lake[i][2];

		low = z < low ? z : low;
		high = z > high ? z : high;
		sum += z;
	}
	if (l->level == INPUT_LEVEL_MIN)
		return low;
	if (l->level == INPUT_LEVEL_MAX)
		return high;
	sum = 2 * sum + n;
	return (int32_t)(sum / (2 * n) - (sum % (2 * n) < 0));
}

static int end_lake(struct pipe_lines *l, struct err *err)
{
	struct breakline_vertex v = l->lake_first;
	int r = 0;

	if (!l->in_lake)
		return 0;
	l->in_lake = false;
	if (l->level == INPUT_LEVEL_NONE)
		return 0;
	v.z = level_of(l);
	for (size_t i = 0; !r && i < l->nlake; i++) {
		v.x = l->lake[i][0];
		v.y = l->lake[i][1];
		v.bits = (uint8_t)l->lake[i][3];
		r = add_vertex(l, &v, err);
	}
	return r;
}

/* A vertex of a lake. *ret_kept: it is added when the ring ends. */
static int add_to_lake(struct pipe_lines *l, const struct breakline_vertex *v, bool *ret_kept, struct err *err)
{
	if (v->bits & BREAKLINE_FEATURE) {
		l->in_lake = true;
		l->lake_first = *v;
		l->nlake = 0;
	}
	*ret_kept = l->level != INPUT_LEVEL_NONE;
	if (!*ret_kept)
		return v->z == l->lake_first.z ? 0 : uneven(l, v, v->z, err);
	if (l->nlake == INPUT_RING_MOST) {
		err_set(err, ERR_LIMIT, "it has more than %d vertices, too many to choose their level", INPUT_RING_MOST);
		err_add_hint(err, "give all of its vertices one z, and leave --lake-level out");
		return refuse(v, err);
	}
	memcpy(l->lake[l->nlake++], (const int32_t[4]){v->x, v->y, v->z, v->bits}, sizeof *l->lake);
	return 0;
}

/* ---- the interface ---- */

int pipe_lines_add(struct pipe_lines *l, const int32_t (*at)[3], const struct input_vertex *of, size_t n, struct err *err)
{
	int r = 0;

	for (size_t i = 0; !r && i < n; i++) {
		bool begins = of[i].bits & INPUT_LINE_BEGINS, kept = false;
		struct breakline_vertex v = {
			.x = at[i][0],
			.y = at[i][1],
			.z = at[i][2],
			.bits = (uint8_t)((of[i].bits & INPUT_FEATURE_BEGINS ? BREAKLINE_FEATURE : 0) |
					  (begins ? BREAKLINE_LINE : 0) |
					  (begins && of[i].bits & INPUT_IN_RING ? BREAKLINE_RING : 0)),
			.kind = of[i].kind,
			.number = of[i].feature,
		};

		if (v.bits & BREAKLINE_FEATURE)
			r = end_lake(l, err);
		if (!r && v.kind == BREAKLINE_LAKE)
			r = add_to_lake(l, &v, &kept, err);
		if (!r && !kept)
			r = add_vertex(l, &v, err);
	}
	return r;
}

int pipe_lines_end(struct pipe_lines *l, struct err *err)
{
	int r = end_lake(l, err);

	if (!r)
		r = end_line(l, err);
	return r ? r : flush(l, err);
}

void pipe_lines_counts(const struct pipe_lines *l, struct pipe_ingested *ret)
{
	ret->vertices_dropped = l->dropped;
	ret->vertices_added = l->added;
}

/* The length of densify in lattice numbers. */
static int choose_step(struct pipe_lines *l, const struct input_lines *in, struct err *err)
{
	double metres = crs_unit_metres(in->densify_unit), of_dataset = l->p->unit_xy ? crs_unit_metres(l->p->unit_xy) : 0;
	double length = decimal_double(in->densify);

	if (!in->densify.mantissa)
		return 0;
	if (*in->densify_unit && of_dataset <= 0) {
		err_set(err, ERR_INPUT, "the length for --densify has a unit, and that of the dataset is not known");
		return err_add_hint(err, "give the length without a unit, or the unit of the coordinates with --assume-units");
	}
	l->step = (*in->densify_unit ? length * metres / of_dataset : length) / decimal_double(l->lattice->scale_xy);
	if (l->step >= 1)
		return 0;
	err_set(err, ERR_INPUT, "the length for --densify is below the scale of the dataset");
	return err_add_hint(err, "give a greater one");
}

int pipe_lines_new(const struct pipe_ingest_params *p, const struct input_info *info, struct pipe_lines **ret, struct err *err)
{
	struct pipe_lines *l;
	int r;

	if (!p->lines) {
		err_set(err, ERR_UNSUPPORTED, "these are lines, and no points");
		return err_add_hint(err, "push them into a dataset");
	}
	l = calloc(1, sizeof *l);
	if (!l)
		return err_set(err, ERR_NOMEM, "no memory to read lines");
	l->p = p;
	l->lattice = p->lattice;
	l->writer = p->lines;
	l->level = info->lines.level;
	if (l->level != INPUT_LEVEL_NONE)
		l->lake = calloc(INPUT_RING_MOST, sizeof *l->lake);
	if (l->level != INPUT_LEVEL_NONE && !l->lake)
		r = err_set(err, ERR_NOMEM, "no memory for the ring of a lake");
	else
		r = choose_step(l, &info->lines, err);
	if (r) {
		pipe_lines_free(l);
		return r;
	}
	*ret = l;
	return 0;
}

struct pipe_lines *pipe_lines_free(struct pipe_lines *l)
{
	if (l)
		free(l->lake);
	free(l);
	return NULL;
}
