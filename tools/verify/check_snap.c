/*
 * Snap rounding for acut-verify, from its rule alone (docs/design/constraints.md): hot positions are all vertices of lines and
 * all crossings, rounded; each segment goes through the hot positions whose pixels it meets. Written to be read, not to be fast:
 * all segments of one cell are compared, and whether a segment meets a pixel is a question of the sides of its line on which the
 * corners of the pixel are.
 */
#include <stdlib.h>

#include "check_lines.h"
#include "err.h"
#include "grow.h"

struct hot {
	struct check_vertex *at;
	size_t n, cap;
};

/* A stretch of a segment between two hot positions. */
struct stretch {
	uint32_t a, b; /* the smaller one first */
	uint32_t area, from;
};

struct snap {
	struct check_lines *l;
	struct check_grid grid; /* of segments, then of hot positions */
	struct hot crossing;
	struct stretch *stretch;
	size_t nstretch, stretch_cap;
	uint32_t *on; /* hot positions of one segment */
	size_t non, on_cap;
	const struct check_segment *segment;
	struct err *err;
};

static int compare_vertices(const void *a, const void *b)
{
	const struct check_vertex *p = a, *q = b;

	return p->x != q->x ? (p->x < q->x ? -1 : 1) : (p->y > q->y) - (p->y < q->y);
}

/* Sorts, and makes one of each position, with the lowest and the highest of its heights. */
static size_t unite(struct check_vertex *v, size_t n)
{
	size_t kept = 0;

	if (n)
		qsort(v, n, sizeof *v, compare_vertices);
	for (size_t i = 0; i < n; i++) {
		struct check_vertex *last = kept ? &v[kept - 1] : NULL;

		if (!last || compare_vertices(last, &v[i])) {
			v[kept++] = v[i];
			continue;
		}
		last->low = v[i].low < last->low ? v[i].low : last->low;
		last->high = v[i].high > last->high ? v[i].high : last->high;
	}
	return kept;
}

static const struct check_vertex *vertex_at(const struct check_lines *l, const int32_t *at)
{
	struct check_vertex key = {.x = at[0], .y = at[1]};

	return bsearch(&key, l->vertex, l->nvertex, sizeof key, compare_vertices);
}

/* ---- crossings ---- */

/* floor(from + (to - from) part / whole + 1/2), whole > 0. */
static int32_t part_of(int32_t from, int32_t to, __int128 part, __int128 whole)
{
	__int128 n = 2 * part * ((int64_t)to - from) + whole, d = 2 * whole;

	return (int32_t)(from + (int64_t)(n / d - (n % d < 0)));
}

/* Two segments that cross between their ends. */
static int add_crossing(struct snap *s, const struct check_segment *p, const struct check_segment *q)
{
	__int128 pa = check_side(q->a, q->b, p->a), pb = check_side(q->a, q->b, p->b);
	__int128 qa = check_side(p->a, p->b, q->a), qb = check_side(p->a, p->b, q->b);
	const struct check_vertex *end[4];
	struct hot *h = &s->crossing;
	int32_t z[4];

	if (check_sign(pa) * check_sign(pb) >= 0 || check_sign(qa) * check_sign(qb) >= 0)
		return 0;
	/* Distances from the other line; so the crossing divides p as pa to -pb, if pa is positive. */
	__int128 part[2] = {pa > 0 ? pa : -pa, qa > 0 ? qa : -qa},
		 whole[2] = {pa > 0 ? pa - pb : pb - pa, qa > 0 ? qa - qb : qb - qa};

	end[0] = vertex_at(s->l, p->a);
	end[1] = vertex_at(s->l, p->b);
	end[2] = vertex_at(s->l, q->a);
	end[3] = vertex_at(s->l, q->b);
	for (unsigned k = 0; k < 2; k++) {
		z[k] = part_of(end[2 * k]->low, end[2 * k + 1]->low, part[k], whole[k]);
		z[k + 2] = part_of(end[2 * k]->high, end[2 * k + 1]->high, part[k], whole[k]);
	}
	if (!grow(&h->at, &h->cap, h->n + 1, 256, sizeof *h->at))
		return check_no_memory(s->err);
	h->at[h->n++] = (struct check_vertex){.x = part_of(p->a[0], p->b[0], part[0], whole[0]),
					      .y = part_of(p->a[1], p->b[1], part[0], whole[0]),
					      .low = z[0] < z[1] ? z[0] : z[1],
					      .high = z[2] > z[3] ? z[2] : z[3]};
	return 0;
}

static double length_of(const int32_t *a, const int32_t *b)
{
	int64_t dx = llabs((int64_t)b[0] - a[0]), dy = llabs((int64_t)b[1] - a[1]);

	return (double)(dx > dy ? dx : dy);
}

static int find_crossings(struct snap *s)
{
	struct check_lines *l = s->l;
	double sum = 0;
	int rc = 0;

	for (size_t i = 0; i < l->nsegment; i++)
		sum += length_of(l->segment[i].a, l->segment[i].b);
	s->grid.shift = check_grid_shift(sum, l->nsegment);
	for (size_t i = 0; rc == 0 && i < l->nsegment; i++)
		rc = check_grid_add(&s->grid, (uint32_t)i, l->segment[i].a, l->segment[i].b, 0, s->err);
	check_grid_sort(&s->grid);
	for (size_t i = 0, end; rc == 0 && i < s->grid.n; i = end) {
		for (end = i; end < s->grid.n && s->grid.cell[end].key == s->grid.cell[i].key; end++)
			;
		for (size_t p = i; rc == 0 && p < end; p++)
			for (size_t q = i; rc == 0 && q < p; q++)
				rc = add_crossing(s, &l->segment[s->grid.cell[p].item], &l->segment[s->grid.cell[q].item]);
	}
	return rc;
}

/* Crossings become vertices. */
static int join_crossings(struct snap *s)
{
	struct check_lines *l = s->l;

	for (size_t i = 0; i < s->crossing.n; i++) {
		if (!grow(&l->vertex, &l->vertex_cap, l->nvertex + 1, 256, sizeof *l->vertex))
			return check_no_memory(s->err);
		l->vertex[l->nvertex++] = s->crossing.at[i];
	}
	l->nvertex = unite(l->vertex, l->nvertex);
	if (l->nvertex >= UINT32_MAX)
		return err_set(s->err, ERR_LIMIT, "the lines have more than %u vertices and crossings", UINT32_MAX);
	return 0;
}

/* ---- pixels ---- */

/*
 * Whether a segment meets the pixel of a position: the square of half a unit around it, without its upper sides. In doubled
 * numbers; the upper sides are moved inwards by less than anything. A segment and a square are apart if and only if they are so
 * in x, in y, or across the line of the segment.
 */
static bool meets_pixel(const struct check_segment *s, int32_t x, int32_t y)
{
	const int64_t c[2] = {2 * (int64_t)x, 2 * (int64_t)y};
	const int64_t d[2] = {(int64_t)s->b[0] - s->a[0], (int64_t)s->b[1] - s->a[1]};
	int seen = 0;

	for (unsigned k = 0; k < 2; k++) {
		int64_t a = 2 * (int64_t)s->a[k], b = 2 * (int64_t)s->b[k];

		if ((a > b ? a : b) < c[k] - 1 || (a < b ? a : b) >= c[k] + 1)
			return false;
	}
	for (unsigned corner = 0; corner < 4; corner++) {
		bool upper[2] = {corner & 1, corner & 2};
		__int128 side = (__int128)d[0] * (c[1] + (upper[1] ? 1 : -1) - 2 * (int64_t)s->a[1]) -
				(__int128)d[1] * (c[0] + (upper[0] ? 1 : -1) - 2 * (int64_t)s->a[0]);
		/* On the line: the corner is moved down by d[0] and left by d[1], so to speak. */
		int64_t moved = (upper[0] ? d[1] : 0) - (upper[1] ? d[0] : 0);
		int sign = side ? check_sign(side) : (moved > 0) - (moved < 0);

		seen |= sign > 0 ? 1 : sign < 0 ? 2 : 3;
	}
	return seen == 3;
}

static int take_column(void *ctx, uint64_t low, uint64_t high)
{
	struct snap *s = ctx;
	const struct check_grid *g = &s->grid;

	for (size_t i = check_grid_find(g, low); i < g->n && g->cell[i].key <= high; i++) {
		const struct check_vertex *v = &s->l->vertex[g->cell[i].item];

		if (!meets_pixel(s->segment, v->x, v->y))
			continue;
		if (!grow(&s->on, &s->on_cap, s->non + 1, 256, sizeof *s->on))
			return check_no_memory(s->err);
		s->on[s->non++] = g->cell[i].item;
	}
	return 0;
}

/* Numbers of vertices are by x, then y; along a segment that goes up. */
static int compare_up(const void *a, const void *b)
{
	const uint32_t *p = a, *q = b;

	return (*p > *q) - (*p < *q);
}

/* Along a segment that goes down to the right, those of one x follow each other downwards. */
static void turn_columns(struct snap *s)
{
	const struct check_vertex *v = s->l->vertex;

	for (size_t i = 0, end; i < s->non; i = end) {
		for (end = i; end < s->non && v[s->on[end]].x == v[s->on[i]].x; end++)
			;
		for (size_t p = i, q = end - 1; p < q; p++, q--) {
			uint32_t kept = s->on[p];

			s->on[p] = s->on[q];
			s->on[q] = kept;
		}
	}
}

static int round_segment(struct snap *s, uint32_t from)
{
	const struct check_segment *g = s->segment = &s->l->segment[from];
	bool down = (g->b[0] > g->a[0]) == (g->b[1] < g->a[1]) && g->b[0] != g->a[0] && g->b[1] != g->a[1];
	int rc;

	s->non = 0;
	rc = check_grid_walk(s->grid.shift, g->a, g->b, 1, take_column, s);
	if (rc)
		return rc;
	qsort(s->on, s->non, sizeof *s->on, compare_up);
	if (down)
		turn_columns(s);
	for (size_t i = 1; i < s->non; i++) {
		uint32_t a = s->on[i - 1], b = s->on[i];

		if (!grow(&s->stretch, &s->stretch_cap, s->nstretch + 1, 256, sizeof *s->stretch))
			return check_no_memory(s->err);
		s->stretch[s->nstretch++] = (struct stretch){a < b ? a : b, a < b ? b : a, g->area, from};
	}
	return 0;
}

/* ---- pieces ---- */

static int compare_stretches(const void *a, const void *b)
{
	const struct stretch *p = a, *q = b;

	if (p->a != q->a)
		return p->a < q->a ? -1 : 1;
	if (p->b != q->b)
		return p->b < q->b ? -1 : 1;
	if (p->area != q->area)
		return p->area < q->area ? -1 : 1;
	return (p->from > q->from) - (p->from < q->from);
}

/* A piece is there once, and an edge of each area that runs along it an odd number of times. */
static int make_pieces(struct snap *s)
{
	struct check_lines *l = s->l;
	const struct stretch *t = s->stretch;
	size_t n = s->nstretch;

	if (n)
		qsort(s->stretch, n, sizeof *s->stretch, compare_stretches);
	l->piece = calloc(n ? n : 1, sizeof *l->piece);
	l->edge = calloc(n ? n : 1, sizeof *l->edge);
	if (!l->piece || !l->edge)
		return check_no_memory(s->err);
	for (size_t i = 0, end; i < n; i = end) {
		if (!l->npiece || l->piece[l->npiece - 1].end[0] != t[i].a || l->piece[l->npiece - 1].end[1] != t[i].b)
			l->piece[l->npiece++] = (struct check_piece){.end = {t[i].a, t[i].b}, .from = t[i].from};
		for (end = i; end < n && t[end].a == t[i].a && t[end].b == t[i].b && t[end].area == t[i].area; end++)
			;
		if (t[i].area && (end - i) % 2)
			l->edge[l->nedge++] = (struct check_edge){(uint32_t)(l->npiece - 1), t[i].area};
	}
	return 0;
}

static int round_segments(struct snap *s)
{
	struct check_lines *l = s->l;
	int rc = 0;

	s->grid.n = 0;
	for (size_t i = 0; rc == 0 && i < l->nvertex; i++) {
		const int32_t at[2] = {l->vertex[i].x, l->vertex[i].y};
		uint64_t key = check_grid_key(s->grid.shift, at[0], at[1]);

		if (!grow(&s->grid.cell, &s->grid.cap, s->grid.n + 1, 256, sizeof *s->grid.cell))
			rc = check_no_memory(s->err);
		else
			s->grid.cell[s->grid.n++] = (struct check_cell){key, (uint32_t)i};
	}
	check_grid_sort(&s->grid);
	for (size_t i = 0; rc == 0 && i < l->nsegment; i++)
		rc = round_segment(s, (uint32_t)i);
	return rc ? rc : make_pieces(s);
}

int check_snap(struct check_lines *l, struct err *err)
{
	struct snap s = {.l = l, .err = err};
	int rc;

	l->nvertex = unite(l->vertex, l->nvertex);
	rc = find_crossings(&s);
	if (rc == 0)
		rc = join_crossings(&s);
	if (rc == 0)
		rc = round_segments(&s);
	free(s.grid.cell);
	free(s.crossing.at);
	free(s.stretch);
	free(s.on);
	return rc;
}
