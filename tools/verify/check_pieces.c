/*
 * A mesh and the pieces of its lines, for acut-verify. Each piece is an edge that is marked, no other edge is marked, vertices of
 * lines have their heights, and no triangle is out. A mesh that ends at boundaries and holes ends there or at the convex hull,
 * and nowhere else. Of a part of a mesh, pieces may be missing; no triangle that is there may be crossed by one.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check_lines.h"
#include "err.h"
#include "grow.h"

#define NONE UINT32_MAX

struct compare {
	struct check_lines *l;
	const struct check_mesh *m;
	const struct view *view;
	struct check_fault *fault;
	struct err *err;
	uint32_t *number;   /* of the vertex of a line at each vertex of the mesh, or NONE */
	bool *kept;         /* of each vertex of lines: the view keeps it */
	bool *met;          /* and the mesh has it */
	int32_t (*hull)[2]; /* corners of the hull of all vertices, counter-clockwise */
	size_t nhull;
	struct check_grid at;     /* vertices of lines */
	const int32_t *corner[3]; /* of the triangle that is looked at */
};

/* ---- faults ---- */

static void set(struct compare *c, const char *fault, const int32_t at[2], int32_t z, const char *text)
{
	if (c->fault->fault)
		return;
	c->fault->fault = fault;
	memcpy(c->fault->place, (const int32_t[3]){at[0], at[1], z}, sizeof c->fault->place);
	snprintf(c->fault->text, sizeof c->fault->text, "%s", text);
}

static void place_text(const struct compare *c, const int32_t at[2], char *buf, size_t size)
{
	const struct lattice *l = &c->m->lattice;
	char x[DECIMAL_TEXT_SIZE], y[DECIMAL_TEXT_SIZE];

	snprintf(buf, size, "%s %s", decimal_scaled_text(l->scale_xy, at[0] + l->k[0], x),
		 decimal_scaled_text(l->scale_xy, at[1] + l->k[1], y));
}

static void set_piece(struct compare *c, const char *fault, const struct check_piece *p, const char *text)
{
	const struct check_segment *s = &c->l->segment[p->from];
	const char *path = c->l->file[s->file], *slash = strrchr(path, '/');
	char to[2 * DECIMAL_TEXT_SIZE], all[sizeof c->fault->text];
	int32_t a[2], b[2];

	check_place(c->l, p->end[0], a);
	check_place(c->l, p->end[1], b);
	place_text(c, b, to, sizeof to);
	snprintf(all, sizeof all, "%s: feature %" PRIu32 " of %.60s, the piece to %s", text, s->feature, slash ? slash + 1 : path,
		 to);
	set(c, fault, a, c->l->vertex[p->end[0]].low, all);
}

/* ---- vertices ---- */

static int compare_places(const void *a, const void *b)
{
	const struct check_vertex *p = a, *q = b;

	return p->x != q->x ? (p->x < q->x ? -1 : 1) : (p->y > q->y) - (p->y < q->y);
}

static int32_t height_of(const struct view *view, const struct check_vertex *v)
{
	struct view n = view_normal(view);

	return n.duplicates == VIEW_HIGHEST ? v->high : v->low;
}

static void match_vertices(struct compare *c)
{
	struct check_lines *l = c->l;

	for (size_t i = 0; i < c->m->nvertex; i++) {
		const int32_t *at = c->m->vertex[i];
		struct check_vertex key = {.x = at[0], .y = at[1]};
		const struct check_vertex *v =
			l->nvertex ? bsearch(&key, l->vertex, l->nvertex, sizeof key, compare_places) : NULL;

		c->number[i] = NONE;
		if (!v || !v->used || !c->kept[v - l->vertex])
			continue;
		c->number[i] = (uint32_t)(v - l->vertex);
		c->met[v - l->vertex] = true;
		if (at[2] != height_of(c->view, v))
			set(c, "height", at, at[2], "a vertex of a line has another height than the line");
	}
}

static void keep_vertices(struct compare *c)
{
	for (size_t i = 0; i < c->l->nvertex; i++) {
		const struct check_vertex *v = &c->l->vertex[i];
		const struct point p = {.x = v->x, .y = v->y, .z = v->low, .tag = POINT_LINE};

		c->kept[i] = v->used && view_judge(c->view, &p) == VIEW_KEPT;
	}
}

/* ---- edges ---- */

/* Where the view takes a piece of a boundary away, triangles go as their centroids say, and any edge may be the last one. */
static bool is_part(const struct compare *c)
{
	if (!c->m->bounded)
		return c->m->trimmed;
	for (size_t i = 0; i < c->l->npiece; i++) {
		const struct check_piece *p = &c->l->piece[i];

		if (p->turns & CHECK_OUT && !p->absent && !(c->kept[p->end[0]] && c->kept[p->end[1]]))
			return true;
	}
	return false;
}

static bool is_expected(const struct compare *c, const struct check_piece *p)
{
	return !p->absent && c->kept[p->end[0]] && c->kept[p->end[1]];
}

static int compare_pieces(const void *a, const void *b)
{
	const struct check_piece *p = a, *q = b;

	if (p->end[0] != q->end[0])
		return p->end[0] < q->end[0] ? -1 : 1;
	return (p->end[1] > q->end[1]) - (p->end[1] < q->end[1]);
}

/* The piece between two vertices of the mesh; NULL: there is none. */
static struct check_piece *piece_between(const struct compare *c, uint32_t a, uint32_t b)
{
	uint32_t i = c->number[a], k = c->number[b];
	struct check_piece key = {.end = {i < k ? i : k, i < k ? k : i}}, *p;

	if (i == NONE || k == NONE || !c->l->npiece)
		return NULL;
	p = bsearch(&key, c->l->piece, c->l->npiece, sizeof key, compare_pieces);
	return p && is_expected(c, p) ? p : NULL;
}

static void match_side(struct compare *c, size_t t, unsigned k)
{
	const uint32_t *v = c->m->triangle[t];
	uint32_t a = v[(k + 1) % 3], b = v[(k + 2) % 3];
	struct check_piece *p = piece_between(c, a, b);
	bool marked = c->m->edges && c->m->edges[t] >> k & 1;
	char text[128], to[2 * DECIMAL_TEXT_SIZE];

	if (p)
		p->found = true;
	if (p && !marked)
		set_piece(c, "mark", p, "an edge is a piece of a line, and not marked as one");
	if (p || !marked)
		return;
	place_text(c, c->m->vertex[b], to, sizeof to);
	snprintf(text, sizeof text, "the edge to %.80s is marked, and no piece of a line", to);
	set(c, "mark", c->m->vertex[a], c->m->vertex[a][2], text);
}

static void check_out(struct compare *c, size_t t)
{
	const uint32_t *v = c->m->triangle[t];
	int64_t sum[2] = {0, 0};

	for (unsigned k = 0; k < 3; k++)
		for (unsigned i = 0; i < 2; i++)
			sum[i] += c->m->vertex[v[k]][i];
	if (check_state(c->l, sum[0], sum[1], 3) & CHECK_OUT)
		set(c, "area", c->m->vertex[v[0]], c->m->vertex[v[0]][2], "a triangle is outside of the boundary, or in a hole");
}

/* ---- parts of a mesh ---- */

static int crosses(const struct compare *c, const struct check_piece *p, const int32_t *a, const int32_t *b)
{
	int32_t from[2], to[2];

	check_place(c->l, p->end[0], from);
	check_place(c->l, p->end[1], to);
	return check_sign(check_side(a, b, from)) * check_sign(check_side(a, b, to)) < 0 &&
	       check_sign(check_side(from, to, a)) * check_sign(check_side(from, to, b)) < 0;
}

static int check_column(void *ctx, uint64_t low, uint64_t high)
{
	struct compare *c = ctx;
	const struct check_grid *g = &c->l->near;

	for (size_t i = check_grid_find(g, low); i < g->n && g->cell[i].key <= high; i++) {
		const struct check_piece *p = &c->l->piece[g->cell[i].item];

		if (is_expected(c, p) && crosses(c, p, c->corner[0], c->corner[1]))
			set_piece(c, "line", p, "a piece of a line crosses a triangle");
	}
	return 0;
}

/* Vertices of lines that are in a triangle, and none of its corners. */
static void check_inside(struct compare *c)
{
	const struct check_grid *g = &c->at;
	int32_t low[2] = {INT32_MAX, INT32_MAX}, high[2] = {INT32_MIN, INT32_MIN};

	for (unsigned i = 0; i < 3; i++)
		for (unsigned k = 0; k < 2; k++) {
			low[k] = c->corner[i][k] < low[k] ? c->corner[i][k] : low[k];
			high[k] = c->corner[i][k] > high[k] ? c->corner[i][k] : high[k];
		}
	for (int64_t column = low[0] >> g->shift; column <= high[0] >> g->shift; column++) {
		int64_t x = column * (INT64_C(1) << g->shift);
		uint64_t last = check_grid_key(g->shift, x, high[1]);

		for (size_t i = check_grid_find(g, check_grid_key(g->shift, x, low[1])); i < g->n && g->cell[i].key <= last;
		     i++) {
			int32_t at[2];
			bool in = true;

			check_place(c->l, g->cell[i].item, at);
			for (unsigned k = 0; k < 3; k++)
				in = in && check_side(c->corner[k], c->corner[(k + 1) % 3], at) >= 0 &&
				     (at[0] != c->corner[k][0] || at[1] != c->corner[k][1]);
			if (in)
				set(c, "line", at, c->l->vertex[g->cell[i].item].low, "a vertex of a line is in a triangle");
		}
	}
}

static int make_places(struct compare *c)
{
	c->at.shift = c->l->near.shift;
	for (uint32_t i = 0; i < c->l->nvertex; i++) {
		const struct check_vertex *v = &c->l->vertex[i];

		if (!c->kept[i])
			continue;
		if (!grow(&c->at.cell, &c->at.cap, c->at.n + 1, 256, sizeof *c->at.cell))
			return check_no_memory(c->err);
		c->at.cell[c->at.n++] = (struct check_cell){check_grid_key(c->at.shift, v->x, v->y), i};
	}
	check_grid_sort(&c->at);
	return 0;
}

static int check_part(struct compare *c)
{
	int rc = make_places(c);

	for (size_t t = 0; rc == 0 && t < c->m->ntriangle && !c->fault->fault; t++) {
		const uint32_t *v = c->m->triangle[t];

		for (unsigned k = 0; k < 3; k++) {
			for (unsigned i = 0; i < 3; i++)
				c->corner[i] = c->m->vertex[v[(k + i) % 3]];
			check_grid_walk(c->l->near.shift, c->corner[0], c->corner[1], 0, check_column, c);
		}
		check_inside(c);
	}
	return rc;
}

/* ---- whole meshes, and such as end at boundaries ---- */

static int compare_corners(const void *a, const void *b)
{
	const int32_t *p = a, *q = b;

	return p[0] != q[0] ? (p[0] < q[0] ? -1 : 1) : (p[1] > q[1]) - (p[1] < q[1]);
}

static size_t half_hull(int32_t (*hull)[2], size_t n, size_t from, const int32_t *at)
{
	while (n >= from + 2 && check_side(hull[n - 2], hull[n - 1], at) <= 0)
		n--;
	memcpy(hull[n], at, sizeof hull[n]);
	return n + 1;
}

/* Of the vertices of the mesh and of lines: those of lines may be in no triangle. */
static int make_hull(struct compare *c)
{
	size_t most = c->m->nvertex + c->l->nvertex, n = 0, h = 0;
	int32_t(*all)[2] = calloc(most + 1, sizeof *all);

	c->hull = calloc(2 * most + 2, sizeof *c->hull);
	if (!all || !c->hull) {
		free(all);
		return check_no_memory(c->err);
	}
	for (size_t i = 0; i < c->m->nvertex; i++)
		memcpy(all[n++], c->m->vertex[i], sizeof *all);
	for (uint32_t i = 0; i < c->l->nvertex; i++)
		if (c->kept[i])
			check_place(c->l, i, all[n++]);
	qsort(all, n, sizeof *all, compare_corners);
	for (size_t i = 0; i < n; i++)
		h = half_hull(c->hull, h, 0, all[i]);
	size_t lower = h ? h - 1 : 0;

	for (size_t i = n; i-- > 0;)
		h = half_hull(c->hull, h, lower, all[i]);
	c->nhull = h;
	free(all);
	return 0;
}

/* Whether everything is on one side of a segment, or on its line. */
static bool is_on_hull(const struct compare *c, const int32_t *a, const int32_t *b)
{
	unsigned seen = 0;

	for (size_t i = 0; i < c->nhull && seen != 3; i++) {
		__int128 side = check_side(a, b, c->hull[i]);

		seen |= side > 0 ? 1 : side < 0 ? 2 : 0;
	}
	return seen != 3;
}

struct side {
	uint32_t end[2]; /* the smaller one first */
};

static int compare_sides(const void *a, const void *b)
{
	const struct side *p = a, *q = b;

	if (p->end[0] != q->end[0])
		return p->end[0] < q->end[0] ? -1 : 1;
	return (p->end[1] > q->end[1]) - (p->end[1] < q->end[1]);
}

static void check_rim(struct compare *c, const struct side *s)
{
	const int32_t *a = c->m->vertex[s->end[0]], *b = c->m->vertex[s->end[1]];
	const struct check_piece *p = piece_between(c, s->end[0], s->end[1]);
	char text[sizeof c->fault->text], to[2 * DECIMAL_TEXT_SIZE];

	if ((p && p->turns & CHECK_OUT) || is_on_hull(c, a, b))
		return;
	place_text(c, b, to, sizeof to);
	snprintf(text, sizeof text, "the mesh ends at the edge to %.80s, which is neither of a boundary or hole nor of the hull",
		 to);
	set(c, "boundary", a, a[2], text);
}

static int check_rims(struct compare *c)
{
	struct side *side = calloc(3 * c->m->ntriangle + 1, sizeof *side);
	size_t n = 0;

	if (!side)
		return check_no_memory(c->err);
	for (size_t t = 0; t < c->m->ntriangle; t++)
		for (unsigned k = 0; k < 3; k++) {
			uint32_t a = c->m->triangle[t][k], b = c->m->triangle[t][(k + 1) % 3];

			side[n++] = (struct side){{a < b ? a : b, a < b ? b : a}};
		}
	qsort(side, n, sizeof *side, compare_sides);
	for (size_t i = 0, end; i < n && !c->fault->fault; i = end) {
		for (end = i; end < n && !compare_sides(&side[i], &side[end]); end++)
			;
		if (end - i == 1)
			check_rim(c, &side[i]);
	}
	free(side);
	return 0;
}

/* A piece that is on the hull and has only what is out beside it is in no triangle. */
static void check_found(struct compare *c)
{
	struct check_lines *l = c->l;

	for (size_t i = 0; i < l->npiece; i++) {
		struct check_piece *p = &l->piece[i];
		int32_t a[2], b[2];

		check_place(l, p->end[0], a);
		check_place(l, p->end[1], b);
		if (!is_expected(c, p) || p->found)
			continue;
		if (c->m->bounded && p->turns & CHECK_OUT && is_on_hull(c, a, b))
			p->absent = true;
		else
			set_piece(c, "line", p, "a piece of a line is no edge of the mesh");
	}
	for (uint32_t i = 0; c->m->bounded && i < l->nvertex; i++)
		l->vertex[i].absent = l->vertex[i].used && !c->met[i];
	for (size_t i = 0; i < l->npiece; i++)
		for (unsigned k = 0; k < 2 && is_expected(c, &l->piece[i]); k++)
			l->vertex[l->piece[i].end[k]].absent = false;
}

static int check_whole(struct compare *c)
{
	int rc = c->m->bounded ? make_hull(c) : 0;

	if (rc == 0)
		check_found(c);
	return rc || !c->m->bounded ? rc : check_rims(c);
}

static int check_mesh(struct compare *c)
{
	keep_vertices(c);
	c->l->part = is_part(c);
	match_vertices(c);
	for (size_t t = 0; t < c->m->ntriangle; t++) {
		for (unsigned k = 0; k < 3; k++)
			match_side(c, t, k);
		if (c->l->nareas)
			check_out(c, t);
	}
	int rc = !c->m->ntriangle ? 0 : c->l->part ? check_part(c) : check_whole(c);

	for (size_t i = 0; i < c->l->npiece; i++) {
		c->l->checked += c->l->piece[i].found;
		c->l->absent += !c->l->piece[i].found;
	}
	return rc;
}

int check_lines_mesh(struct check_lines *l, const struct check_mesh *m, const struct view *view, struct check_fault *ret,
		     struct err *err)
{
	struct compare c = {.l = l, .m = m, .view = view, .fault = ret, .err = err};
	int rc;

	c.number = calloc(m->nvertex + 1, sizeof *c.number);
	c.kept = calloc(l->nvertex + 1, sizeof *c.kept);
	c.met = calloc(l->nvertex + 1, sizeof *c.met);
	rc = c.number && c.kept && c.met ? check_mesh(&c) : check_no_memory(err);
	free(c.number);
	free(c.kept);
	free(c.met);
	free(c.hull);
	free(c.at.cell);
	return rc;
}

int check_lines_points(const struct check_lines *l, const struct view *view, struct check_points *points, struct err *err)
{
	for (size_t i = 0; i < l->nvertex; i++) {
		const struct check_vertex *v = &l->vertex[i];
		struct point p = {.x = v->x, .y = v->y, .z = height_of(view, v), .tag = POINT_LINE};

		if (!v->used || v->absent || view_judge(view, &p) != VIEW_KEPT)
			continue;
		if (!grow(&points->pts, &points->cap, points->n + 1, 256, sizeof *points->pts))
			return check_no_memory(err);
		points->pts[points->n++] = p;
	}
	return 0;
}
