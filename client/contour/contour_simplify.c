/*
 * Lines with fewer vertices; docs/design/contours.md, "Simplified lines".
 *
 * All vertices of all lines are sorted by their places. Squares of a quadtree that have few enough of them follow each other
 * then, and each is simplified by itself (contour_cell.c): what leaves there depends on the vertices of that square alone. The
 * vertices that stay are sorted back into the order of their lines, and these are in two nameless files: a record a line, and
 * points.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "contour_priv.h"
#include "contour_simplify.h"
#include "err.h"
#include "morton.h"
#include "outfile.h"
#include "sort.h"

#define SORT_MEMORY (8ull << 20)
#define KEPT_MEMORY (2ull << 20)
#define AXIS_MOST 0x1p62
enum {
	VERTEX_WORDS = sizeof(struct contour_vertex) / sizeof(uint64_t),
	VERTEX_KEYS = 3,
	KEPT_WORDS = 3, /* number, x, y */
	DIGITS = 64,    /* of a key, of two bits each */
	FINER = 4,      /* bits of a key that a step of the lattice has */
	LINES = 64,     /* records that are read at once */
};

struct contour_simple {
	struct contour *c;
	int unit; /* keys count places in steps of 2^unit */
	struct sort *vertices, *kept;
	struct contour_cell *cell;
	struct contour_vertex *buffer; /* one more than a cell has: in the order of keys */
	size_t most, have;             /* vertices of a cell; in the buffer */
	bool ended;
	uint64_t before[2]; /* the last key of the cell before */
	bool any;
	/* Of the lines as they were, then of those with fewer vertices. */
	struct outfile *lines, *points;
	struct contour_line line[LINES];
	unsigned nline, next_line;
	uint64_t at_line, at_point, left; /* in the files; points of the line that are not read */
	uint64_t taken, written;          /* vertices */
	double (*point)[2];
};

static struct contour_simple *simple_free(struct contour_simple *s)
{
	if (s) {
		sort_free(s->vertices);
		sort_free(s->kept);
		contour_cell_free(s->cell);
		free(s->buffer);
		outfile_free(s->lines);
		outfile_free(s->points);
		free(s->point);
	}
	free(s);
	return NULL;
}

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory to simplify contours");
}

static int interrupted(const struct contour_simple *s, struct err *err)
{
	return contour_interrupted(s->c) ? err_set(err, ERR_CANCELLED, "interrupted") : 0;
}

/* ---- all vertices, by their places ---- */

/* What is less has no greater number, however it is rounded: so the places of a square are a rectangle. */
static uint64_t axis_of(const struct contour_simple *s, double v)
{
	double at = floor(ldexp(v, -s->unit));

	at = at > AXIS_MOST ? AXIS_MOST : at < -AXIS_MOST ? -AXIS_MOST : at;
	return (uint64_t)(int64_t)at ^ 1ull << 63;
}

static int add_vertex(struct contour_simple *s, const double at[2], unsigned marks, struct err *err)
{
	uint64_t x = axis_of(s, at[0]), y = axis_of(s, at[1]), rec[VERTEX_WORDS];
	struct contour_vertex v = {
		.key = {morton_code((uint32_t)(x >> 32), (uint32_t)(y >> 32)), morton_code((uint32_t)x, (uint32_t)y)},
		.number = s->taken++ * CONTOUR_MARKS + marks,
		.at = {at[0], at[1]}};

	memcpy(rec, &v, sizeof(rec));
	return sort_add(s->vertices, rec, err);
}

static int add_line(struct contour_simple *s, const struct contour_line *line, struct err *err)
{
	const double(*point)[2];
	uint64_t done = 0;
	size_t n;
	int r = outfile_write(s->lines, line, sizeof(*line), err);

	while (!r && !(r = contour_points(s->c, &point, &n, err)) && n) {
		for (size_t i = 0; i < n && !r; i++, done++)
			r = add_vertex(s, point[i],
				       (done ? 0 : CONTOUR_FIRST) | (done + 1 == line->points ? CONTOUR_LAST : 0) |
					       (line->closed ? CONTOUR_RING : 0),
				       err);
		if (!r)
			r = interrupted(s, err);
	}
	return r;
}

static int take_lines(struct contour_simple *s, struct err *err)
{
	struct contour_line line = {0};
	int r;

	while (!(r = contour_next(s->c, &line, err)) && line.points) {
		r = add_line(s, &line, err);
		if (r)
			return r;
	}
	return r;
}

/* ---- cells ---- */

/* Digits that two keys have in common, from the top. */
static int common(const uint64_t a[2], const uint64_t b[2])
{
	if (a[0] != b[0])
		return __builtin_clzll(a[0] ^ b[0]) / 2;
	return a[1] != b[1] ? DIGITS / 2 + __builtin_clzll(a[1] ^ b[1]) / 2 : DIGITS;
}

static int fill(struct contour_simple *s, struct err *err)
{
	const uint64_t *rec;

	while (s->have <= s->most && !s->ended) {
		int r = sort_next(s->vertices, &rec, err);

		if (r)
			return r;
		s->ended = !rec;
		if (rec)
			memcpy(&s->buffer[s->have++], rec, sizeof(*s->buffer));
	}
	return 0;
}

static int keep(struct contour_simple *s, const struct contour_vertex *v, struct err *err)
{
	uint64_t rec[KEPT_WORDS] = {v->number};

	memcpy(rec + 1, v->at, sizeof(v->at));
	return sort_add(s->kept, rec, err);
}

/* The first n of the buffer are a cell. */
static int simplify_cell(struct contour_simple *s, size_t n, struct err *err)
{
	int r = interrupted(s, err);

	contour_cell_simplify(s->cell, s->buffer, n);
	for (size_t i = 0; i < n && !r; i++)
		r = contour_cell_keeps(s->cell, i) ? keep(s, &s->buffer[i], err) : 0;
	memcpy(s->before, s->buffer[n - 1].key, sizeof(s->before));
	s->any = true;
	memmove(s->buffer, s->buffer + n, (s->have - n) * sizeof(*s->buffer));
	s->have -= n;
	return r;
}

/* More vertices in one place than a cell may have: all stay. */
static int keep_place(struct contour_simple *s, struct err *err)
{
	int r = 0;

	memcpy(s->before, s->buffer[0].key, sizeof(s->before));
	s->any = true;
	while (!r && s->have && common(s->before, s->buffer[0].key) == DIGITS) {
		size_t n = 0;

		while (n < s->have && common(s->before, s->buffer[n].key) == DIGITS && !r)
			r = keep(s, &s->buffer[n++], err);
		memmove(s->buffer, s->buffer + n, (s->have - n) * sizeof(*s->buffer));
		s->have -= n;
		if (!r)
			r = fill(s, err);
	}
	return r;
}

/* The largest square from the first vertex on that has no more than `most` vertices. One that also has vertices before it has
 * more: else that would have been the cell. */
static int simplify_cells(struct contour_simple *s, struct err *err)
{
	int r;

	while (!(r = fill(s, err)) && s->have) {
		int digits = s->any ? common(s->before, s->buffer[0].key) + 1 : 0, crowd = -1;
		size_t n = 0;

		if (s->have > s->most)
			crowd = common(s->buffer[0].key, s->buffer[s->most].key);
		digits = crowd >= digits ? crowd + 1 : digits;
		while (digits <= DIGITS && n < s->have && common(s->buffer[0].key, s->buffer[n].key) >= digits)
			n++;
		r = n ? simplify_cell(s, n, err) : keep_place(s, err);
		if (r)
			return r;
	}
	return r;
}

/* ---- lines again ---- */

static int read_line(struct contour_simple *s, struct outfile *from, struct contour_line *ret, struct err *err)
{
	uint64_t left = (outfile_size(from) - s->at_line) / sizeof(*s->line);
	int r = 0;

	if (s->next_line == s->nline) {
		s->nline = left < LINES ? (unsigned)left : LINES;
		s->next_line = 0;
		r = s->nline ? outfile_read(from, s->at_line, s->line, s->nline * sizeof(*s->line), err) : 0;
		s->at_line += s->nline * sizeof(*s->line);
	}
	*ret = s->nline ? s->line[s->next_line++] : (struct contour_line){0};
	return r;
}

static void measure(struct contour_line *line, const double at[2], double last[2])
{
	double x = at[0] - last[0], y = at[1] - last[1];

	line->length += line->points++ ? sqrt(x * x + y * y) : 0;
	for (int i = 0; i < 2; i++) {
		last[i] = at[i];
		line->box[i] = at[i] < line->box[i] ? at[i] : line->box[i];
		line->box[i + 2] = at[i] > line->box[i + 2] ? at[i] : line->box[i + 2];
	}
}

static int write_lines(struct contour_simple *s, struct outfile *was, struct err *err)
{
	struct contour_line line = {0};
	const uint64_t *rec;
	double at[2], last[2] = {0};
	int r = sort_start(s->kept, err);

	while (!r && !(r = sort_next(s->kept, &rec, err)) && rec) {
		if (rec[0] & CONTOUR_FIRST)
			r = read_line(s, was, &line, err);
		if (!r && rec[0] & CONTOUR_FIRST) {
			line.points = 0;
			line.length = 0;
			line.box[0] = line.box[1] = INFINITY;
			line.box[2] = line.box[3] = -INFINITY;
		}
		memcpy(at, rec + 1, sizeof(at));
		measure(&line, at, last);
		if (!r)
			r = outfile_write(s->points, at, sizeof(at), err);
		if (!r && rec[0] & CONTOUR_LAST)
			r = outfile_write(s->lines, &line, sizeof(line), err);
		if (!r && ++s->written % 65536 == 0)
			r = interrupted(s, err);
	}
	return r;
}

/* ---- */

static int make_cells(struct contour_simple *s, struct err *err)
{
	int r = sort_start(s->vertices, err);

	s->buffer = malloc((s->most + 1) * sizeof(*s->buffer));
	if (!s->buffer)
		r = no_memory(err);
	if (!r)
		r = sort_new(KEPT_WORDS, 1, s->c->opt.sort_memory ? s->c->opt.sort_memory : KEPT_MEMORY, s->c->out, &s->kept,
			     err);
	if (!r)
		sort_interrupt(s->kept, s->c->opt.interrupted, s->c->opt.ctx);
	if (!r)
		r = contour_cell_new((unsigned)s->most, s->c->opt.simplify, &s->cell, err);
	if (!r)
		r = simplify_cells(s, err);
	s->vertices = sort_free(s->vertices);
	s->cell = contour_cell_free(s->cell);
	free(s->buffer);
	s->buffer = NULL;
	return r;
}

static int make_lines(struct contour_simple *s, struct err *err)
{
	struct outfile *was = s->lines;
	int r;

	s->lines = NULL;
	r = outfile_spool(s->c->out, &s->lines, err);
	if (!r)
		r = outfile_spool(s->c->out, &s->points, err);
	if (!r)
		r = write_lines(s, was, err);
	outfile_free(was);
	s->kept = sort_free(s->kept);
	s->nline = s->next_line = 0;
	s->at_line = 0;
	s->point = malloc(CONTOUR_POINTS * sizeof(*s->point));
	return r || s->point ? r : no_memory(err);
}

int contour_simplify(struct contour *c, struct err *err)
{
	double step = decimal_double(c->opt.axis[0].scale);
	struct contour_simple *s = calloc(1, sizeof(*s));
	int r;

	if (!s)
		return no_memory(err);
	s->c = c;
	s->unit = (step > 0 ? ilogb(step) : 0) - FINER;
	s->most = c->opt.cell ? c->opt.cell : CONTOUR_CELL;
	r = sort_new(VERTEX_WORDS, VERTEX_KEYS, c->opt.sort_memory ? c->opt.sort_memory : SORT_MEMORY, c->out, &s->vertices, err);
	if (!r)
		sort_interrupt(s->vertices, c->opt.interrupted, c->opt.ctx);
	if (!r)
		r = outfile_spool(c->out, &s->lines, err);
	if (!r)
		r = take_lines(s, err);
	contour_joined_free(c); /* the annex stays: a run that is killed now can be continued */
	if (!r)
		r = make_cells(s, err);
	if (!r)
		r = make_lines(s, err);
	if (r) {
		simple_free(s);
		return r;
	}
	c->simplified = (struct contour_simplified){s->taken, s->taken - s->written};
	c->simple = s;
	return 0;
}

int contour_simple_next(struct contour_simple *s, struct contour_line *ret, struct err *err)
{
	int r;

	s->at_point += s->left * sizeof(*s->point);
	r = read_line(s, s->lines, ret, err);
	s->left = ret->points;
	return r;
}

int contour_simple_points(struct contour_simple *s, const double (**ret)[2], size_t *ret_n, struct err *err)
{
	size_t n = s->left < CONTOUR_POINTS ? (size_t)s->left : CONTOUR_POINTS;
	int r = n ? outfile_read(s->points, s->at_point, s->point, n * sizeof(*s->point), err) : 0;

	s->at_point += n * sizeof(*s->point);
	s->left -= n;
	*ret = (const double(*)[2])s->point;
	*ret_n = n;
	return r;
}

struct contour_simple *contour_simple_free(struct contour_simple *s)
{
	return simple_free(s);
}

struct contour_simplified contour_simplified(const struct contour *c)
{
	return c->simplified;
}
