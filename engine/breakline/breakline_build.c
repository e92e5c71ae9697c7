/*
 * All lines of a generation to a line set and the records of line vertices (breakline.h): all files are read, snap rounding makes
 * pieces, the areas decide what these turn and which are out, and both results are sorted. No step depends on the order of files
 * or lines. What grows with the lines is counted in `memory` before it is taken.
 */
#include <stdlib.h>
#include <string.h>

#include "breakline_priv.h"
#include "err.h"

struct build {
	const struct breakline_params *p;
	struct breakline_memory memory;
	struct breakline_counts counts;
	/* Of the input. */
	struct mesh_vertex *vertex;
	uint32_t (*segment)[2], *label;
	uint8_t *kind; /* of each label */
	uint64_t most_vertices, most_segments, most_labels;
	uint32_t nvertex, nsegment, nlabel;
	uint32_t first; /* vertex of the line that is being read */
	bool ring;
	uint32_t in_label; /* of the feature that is being read; 0: none yet */
	uint8_t feature;   /* its kind */
	bool boundary;
	struct snap lines;
};

/* ---- memory ---- */

int breakline_over(const struct breakline_memory *m, struct err *err)
{
	return err_set(err, ERR_LIMIT, "the lines of the dataset need more than %llu MiB of memory",
		       (unsigned long long)(m->most >> 20));
}

void *breakline_take(struct breakline_memory *m, uint64_t n, size_t size, struct err *err)
{
	void *at;

	if (n > m->left / size) {
		breakline_over(m, err);
		return NULL;
	}
	at = calloc(n ? n : 1, size);
	if (at)
		m->left -= n * size;
	else
		err_set(err, ERR_NOMEM, "no memory for lines");
	return at;
}

void breakline_give(struct breakline_memory *m, void *at, uint64_t n, size_t size)
{
	if (at)
		m->left += n * size;
	free(at);
}

/* ---- reading ---- */

static int add_totals(struct build *b, struct err *err)
{
	struct breakline_totals t;
	int rc = 0;

	for (size_t i = 0; rc == 0 && i < b->p->nfiles; i++) {
		rc = breakline_totals(b->p->dirfd, b->p->file[i], &t, err);
		for (unsigned k = 0; rc == 0 && k < BREAKLINE_KINDS; k++)
			b->counts.features[k] += t.features[k];
		if (rc == 0) {
			b->counts.lines += t.lines;
			b->counts.vertices += t.vertices;
		}
	}
	if (rc == 0 && (b->counts.vertices >= UINT32_MAX || b->counts.lines >= UINT32_MAX))
		return err_set(err, ERR_LIMIT, "the lines have more than %u vertices", UINT32_MAX);
	b->most_vertices = b->counts.vertices;
	b->most_segments = b->counts.vertices;
	b->most_labels =
		b->counts.features[BREAKLINE_LAKE] + b->counts.features[BREAKLINE_BOUNDARY] + b->counts.features[BREAKLINE_HOLE];
	return rc;
}

static int take_input(struct build *b, struct err *err)
{
	b->vertex = breakline_take(&b->memory, b->most_vertices, sizeof *b->vertex, err);
	b->segment = b->vertex ? breakline_take(&b->memory, b->most_segments, sizeof *b->segment, err) : NULL;
	b->label = b->segment ? breakline_take(&b->memory, b->most_segments, sizeof *b->label, err) : NULL;
	b->kind = b->label ? breakline_take(&b->memory, b->most_labels, sizeof *b->kind, err) : NULL;
	return b->kind ? 0 : -(int)err->code;
}

static void free_input(struct build *b)
{
	breakline_give(&b->memory, b->vertex, b->most_vertices, sizeof *b->vertex);
	breakline_give(&b->memory, b->segment, b->most_segments, sizeof *b->segment);
	breakline_give(&b->memory, b->label, b->most_segments, sizeof *b->label);
	b->vertex = NULL;
	b->segment = NULL;
	b->label = NULL;
}

static void add_segment(struct build *b, uint32_t from, uint32_t to)
{
	b->segment[b->nsegment][0] = from;
	b->segment[b->nsegment][1] = to;
	b->label[b->nsegment++] = b->ring ? b->in_label : 0;
}

/* A ring of two vertices is closed, too: so it goes there and back, and bounds nothing. */
static void end_line(struct build *b)
{
	if (b->ring && b->nvertex - b->first > 1)
		add_segment(b, b->nvertex - 1, b->first);
	b->ring = false;
}

static int begin_line(struct build *b, const struct breakline_vertex *v, struct err *err)
{
	end_line(b);
	if (v->bits & BREAKLINE_FEATURE) {
		b->in_label = 0;
		b->feature = v->kind;
	}
	b->first = b->nvertex;
	b->ring = v->bits & BREAKLINE_RING;
	if (!b->ring || b->feature == BREAKLINE_HARD || b->in_label)
		return 0;
	if (b->nlabel == b->most_labels)
		return err_set(err, ERR_CHANGED, "a file of lines has changed while it was read");
	b->kind[b->nlabel] = b->feature;
	b->in_label = ++b->nlabel;
	b->boundary = b->boundary || b->feature == BREAKLINE_BOUNDARY;
	return 0;
}

/* There are as many segments as vertices at most: a line has one less, a ring has as many. */
static int take_vertices(void *ctx, const struct breakline_vertex *v, size_t n, struct err *err)
{
	struct build *b = ctx;

	if (n > b->most_vertices - b->nvertex)
		return err_set(err, ERR_CHANGED, "a file of lines has changed while it was read");
	for (size_t i = 0; i < n; i++) {
		int rc = 0;

		if (v[i].bits & BREAKLINE_LINE)
			rc = begin_line(b, &v[i], err);
		else
			add_segment(b, b->nvertex - 1, b->nvertex);
		if (rc)
			return rc;
		b->vertex[b->nvertex++] = (struct mesh_vertex){v[i].x, v[i].y, v[i].z};
	}
	return 0;
}

static int read_files(struct build *b, struct err *err)
{
	int rc = add_totals(b, err);

	if (rc == 0)
		rc = take_input(b, err);
	for (size_t i = 0; rc == 0 && i < b->p->nfiles; i++) {
		rc = breakline_read(b->p->dirfd, b->p->file[i], take_vertices, b, err);
		end_line(b);
		if (rc == -ERR_CHANGED) {
			err_add_file(err, b->p->file[i]);
			err_add_hint(err, "check the disk, and restore the file, or push the lines again");
		}
	}
	return rc;
}

/* ---- rounding ---- */

static int round_lines(struct build *b, struct err *err)
{
	int rc = snap_round(b->vertex, b->nvertex, (const uint32_t(*)[2])b->segment, b->nlabel ? b->label : NULL, b->nsegment,
			    b->memory.left, &b->lines, err);

	if (rc)
		return rc;
	b->memory.left -= snap_bytes(&b->lines);
	b->counts.crossings = b->lines.ncrossing;
	b->counts.uneven = b->lines.nuneven;
	b->counts.doubled = b->lines.doubled;
	b->counts.points = b->lines.points;
	return 0;
}

static int report(struct build *b, enum breakline_event event, const struct snap_crossing *c, uint32_t n, struct err *err)
{
	int rc = 0;

	for (uint32_t i = 0; rc == 0 && i < n; i++) {
		uint32_t wide = (uint32_t)c[i].upper - (uint32_t)c[i].lower;

		if (wide > b->counts.widest) {
			b->counts.widest = wide;
			b->counts.widest_at[0] = c[i].x;
			b->counts.widest_at[1] = c[i].y;
		}
		if (b->p->event)
			rc = b->p->event(b->p->ctx, event, c[i].x, c[i].y, c[i].lower, c[i].upper, err);
	}
	return rc;
}

/* ---- results ---- */

/* Pieces that are not out, as the line set has them; their ends are used. */
static int write_pieces(struct build *b, const uint8_t *side, uint8_t *used, struct err *err)
{
	const struct snap *l = &b->lines;
	struct lineset_piece *piece = breakline_take(&b->memory, l->npiece, sizeof *piece, err);
	size_t n = 0;
	int rc;

	if (!piece)
		return -(int)err->code;
	for (uint32_t i = 0; i < l->npiece; i++) {
		const uint32_t *end = l->piece[i];

		if (side[i] == BREAKLINE_PIECE_OUT) {
			b->counts.left_out++;
			continue;
		}
		used[end[0]] = used[end[1]] = 1;
		piece[n++] = (struct lineset_piece){{l->vertex[end[0]].x, l->vertex[end[0]].y},
						    {l->vertex[end[1]].x, l->vertex[end[1]].y},
						    side[i] & (LINESET_LAKE | LINESET_OUT)};
	}
	b->counts.pieces = n;
	rc = lineset_write(b->p->dirfd, b->p->lineset, piece, n, b->boundary ? LINESET_OUT : 0, err);
	breakline_give(&b->memory, piece, l->npiece, sizeof *piece);
	return rc;
}

static int pass_sorted(struct build *b, struct point *pts, struct point *scratch, size_t n, struct err *err)
{
	enum { PART = 4096 };
	int rc = 0;

	point_sort(pts, scratch, n);
	for (size_t i = 0; rc == 0 && i < n; i += PART)
		rc = b->p->vertices(b->p->ctx, pts + i, n - i < PART ? n - i : PART, err);
	return rc;
}

static int pass_vertices(struct build *b, const uint8_t *used, struct err *err)
{
	const struct snap *l = &b->lines;
	struct point *pts, *scratch;
	size_t n = 0, at = 0;
	int rc;

	for (uint32_t i = 0; i < l->nvertex; i++)
		n += used[i] ? 1u + (l->vertex[i].z != l->highest[i]) : 0;
	pts = breakline_take(&b->memory, n, sizeof *pts, err);
	scratch = pts ? breakline_take(&b->memory, n, sizeof *pts, err) : NULL;
	for (uint32_t i = 0; scratch && i < l->nvertex; i++) {
		struct point p = {.x = l->vertex[i].x, .y = l->vertex[i].y, .z = l->vertex[i].z, .tag = POINT_LINE};

		if (!used[i])
			continue;
		b->counts.positions++;
		pts[at++] = p;
		p.z = l->highest[i];
		if (p.z != l->vertex[i].z)
			pts[at++] = p;
	}
	rc = scratch ? pass_sorted(b, pts, scratch, n, err) : -(int)err->code;
	breakline_give(&b->memory, scratch, n, sizeof *pts);
	breakline_give(&b->memory, pts, n, sizeof *pts);
	return rc;
}

static int make_results(struct build *b, struct err *err)
{
	struct breakline_areas areas = {.lines = &b->lines, .kind = b->kind, .boundary = b->boundary};
	uint8_t *used = breakline_take(&b->memory, b->lines.nvertex, 1, err);
	int rc;

	areas.side = used ? breakline_take(&b->memory, b->lines.npiece, 1, err) : NULL;
	rc = areas.side ? breakline_areas(&areas, &b->memory, err) : -(int)err->code;
	if (rc == 0)
		rc = write_pieces(b, areas.side, used, err);
	if (rc == 0)
		rc = pass_vertices(b, used, err);
	breakline_give(&b->memory, areas.side, b->lines.npiece, 1);
	breakline_give(&b->memory, used, b->lines.nvertex, 1);
	return rc;
}

/* Lines without labels need about 140 bytes a vertex, rings 70 more, and crossings are not known before. */
static void add_need(const struct build *b, struct err *err)
{
	uint64_t most = b->memory.most, by_vertices = 240 * b->counts.vertices;

	err->need = 2 * most > by_vertices ? 2 * most : by_vertices;
	err_add_hint(err, "give acutd more memory, or push fewer lines");
}

int breakline_build(const struct breakline_params *p, struct breakline_counts *ret, struct err *err)
{
	struct build b = {.p = p, .memory = {p->memory, p->memory}};
	int rc = read_files(&b, err);

	if (rc == 0)
		rc = round_lines(&b, err);
	free_input(&b);
	if (rc == 0)
		rc = report(&b, BREAKLINE_CROSSING, b.lines.crossing, b.lines.ncrossing, err);
	if (rc == 0)
		rc = report(&b, BREAKLINE_UNEVEN, b.lines.uneven, b.lines.nuneven, err);
	if (rc == 0)
		rc = make_results(&b, err);
	breakline_give(&b.memory, b.kind, b.most_labels, sizeof *b.kind);
	snap_done(&b.lines);
	if (rc == -ERR_LIMIT)
		add_need(&b, err);
	if (rc == 0)
		*ret = b.counts;
	return rc;
}
