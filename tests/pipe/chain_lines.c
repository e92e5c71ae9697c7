#include "chain_lines.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "check.h"
#include "geom.h"

static struct err err;

static void piece_of(const struct point *a, const struct point *b, struct lineset_piece *ret)
{
	const int32_t ends[2][2] = {{a->x, a->y}, {b->x, b->y}};
	bool swap = !geom_less(ends[0], ends[1]);

	*ret = (struct lineset_piece){.turns = 0};
	memcpy(ret->a, ends[swap], sizeof ret->a);
	memcpy(ret->b, ends[!swap], sizeof ret->b);
}

static struct lineset_piece *same_piece(struct chain_lines *l, const struct lineset_piece *p)
{
	for (size_t i = 0; i < l->n; i++)
		if (!memcmp(l->piece[i].a, p->a, sizeof p->a) && !memcmp(l->piece[i].b, p->b, sizeof p->b))
			return &l->piece[i];
	return NULL;
}

static void add(struct chain_lines *l, const struct point *a, const struct point *b, unsigned turns)
{
	struct lineset_piece p, *at;

	piece_of(a, b, &p);
	at = same_piece(l, &p);
	if (!at && l->n < CHAIN_PIECES) {
		l->piece[l->n] = p;
		at = &l->piece[l->n++];
	}
	if (at)
		at->turns ^= turns;
}

static int by_key(const void *a, const void *b)
{
	return point_compare(a, b);
}

/* Sorted, one for each position. */
static void make_vertices(uint64_t *rng, const struct set *s, struct chain_lines *l)
{
	size_t want = 3 + random_below(rng, CHAIN_VERTICES - 3), n = 0;

	for (size_t i = l->nvertex; i < want; i++) {
		struct point p = s->pts[random_below(rng, s->n)];

		l->vertex[l->nvertex++] = (struct point){.x = p.x, .y = p.y, .z = (int32_t)random_below(rng, 9)};
	}
	qsort(l->vertex, l->nvertex, sizeof *l->vertex, by_key);
	for (size_t i = 0; i < l->nvertex; i++)
		if (!n || l->vertex[n - 1].x != l->vertex[i].x || l->vertex[n - 1].y != l->vertex[i].y)
			l->vertex[n++] = l->vertex[i];
	l->nvertex = n;
}

/* The sides of a triangle become a ring. */
static void add_ring(uint64_t *rng, struct chain_lines *l, const struct tri_result *r)
{
	const struct tri_triangle *t = &r->triangle[random_below(rng, r->ntriangle)];
	unsigned turns = 1 + (unsigned)random_below(rng, 2);

	for (unsigned k = 0; k < 3; k++)
		if (t->corner[k] == TRI_GHOST)
			return;
	if (l->n + 3 > CHAIN_PIECES)
		return;
	for (unsigned k = 0; k < 3; k++)
		add(l, &l->vertex[r->id[t->corner[k]]], &l->vertex[r->id[t->corner[(k + 1) % 3]]], turns);
}

void chain_lines_make(uint64_t *rng, const struct set *s, const struct chain_lines *like, struct chain_lines *ret)
{
	struct mesh_vertex v[CHAIN_VERTICES];
	struct tri_pieces *p;
	struct tri_result r;
	struct tri *t;
	bool areas = random_below(rng, 2);
	uint32_t at;

	*ret = (struct chain_lines){.n = 0};
	for (size_t i = 0; like && i < like->nvertex; i++)
		if (random_below(rng, 8))
			ret->vertex[ret->nvertex++] = like->vertex[i];
	make_vertices(rng, s, ret);
	for (size_t i = 0; i < ret->nvertex; i++)
		v[i] = (struct mesh_vertex){ret->vertex[i].x, ret->vertex[i].y, 0};
	t = ret->nvertex < 3 ? NULL : check_tri(v, (uint32_t)ret->nvertex);
	if (!t)
		return;
	tri_result(t, &r);
	p = check_pieces(t, 2 * (uint32_t)ret->nvertex);
	for (size_t i = 0; i < 40; i++) {
		uint32_t a = (uint32_t)random_below(rng, ret->nvertex), b = (uint32_t)random_below(rng, ret->nvertex);

		if (!tri_piece_insert(p, a, b, &at))
			add(ret, &ret->vertex[a], &ret->vertex[b], 0);
	}
	for (unsigned i = 0; areas && i < 4; i++)
		add_ring(rng, ret, &r);
	free(p);
	free(t);
}

void chain_lines_add(const struct chain_lines *l, struct set *s, uint32_t source)
{
	s->pts = realloc(s->pts, (s->n + l->nvertex + 1) * sizeof *s->pts);
	s->ids = realloc(s->ids, (s->n + l->nvertex + 1) * sizeof *s->ids);
	for (size_t i = 0; i < l->nvertex; i++) {
		s->pts[s->n] = l->vertex[i];
		s->ids[s->n++] = source;
	}
}

/* ---- the whole ---- */

/* The positions that the view keeps, of a scan, in place. */
static uint32_t keep(const struct view *view, struct gather *g, struct mesh_vertex *ret)
{
	const struct point *last = NULL;
	uint32_t n = 0;

	for (size_t i = 0; i < g->n; i++) {
		const struct point *p = &g->pts[i];
		bool again = n && ret[n - 1].x == p->x && ret[n - 1].y == p->y;

		if (view_judge(view, p) != VIEW_KEPT || (again && !view_prefers(view, p, last)))
			continue;
		n -= again;
		ret[n++] = (struct mesh_vertex){p->x, p->y, p->z};
		last = p;
	}
	return n;
}

static uint32_t position(const struct mesh_vertex *v, uint32_t n, const int32_t at[2])
{
	uint32_t i = 0;

	while (i < n && (v[i].x != at[0] || v[i].y != at[1]))
		i++;
	return i;
}

bool chain_lines_out(const struct reader *reader, const struct tri_result *r, const uint32_t corner[3])
{
	struct lineset_reader *lines = grid_reader_lines(reader->r);
	int64_t sum[2] = {0, 0};
	unsigned state = 0;

	for (unsigned i = 0; i < 3; i++)
		for (unsigned k = 0; k < 2; k++)
			sum[k] += r->xy[corner[i]][k];
	if (lines)
		CHECK(lineset_state(lines, sum[0], sum[1], 3, &state, &err));
	return state & LINESET_OUT;
}

uint64_t chain_lines_insert(const struct chain_lines *l, struct tri *t, const struct mesh_vertex *v, uint32_t n,
			    struct tri_pieces **ret)
{
	struct tri_pieces *p = check_pieces(t, 2 * n);
	uint32_t at, found;
	uint64_t crossed = 0;

	for (size_t i = 0; l && i < l->n; i++) {
		uint32_t a = position(v, n, l->piece[i].a), b = position(v, n, l->piece[i].b);

		if (a == n || b == n)
			continue;
		assert_int_equal(tri_piece_find(p, a, b, &found, &at), 0);
		crossed += found;
		assert_int_equal(tri_piece_insert(p, a, b, &at), 0);
	}
	*ret = p;
	return crossed;
}

static void compare(const struct reader *reader, const struct tri_result *r, const struct pipe_totals *totals)
{
	const int64_t *k = grid_manifest(reader->grid)->lattice.k;
	struct digest sum = {0, 0};
	uint64_t n = 0;

	for (uint32_t i = 0; i < r->ntriangle; i++) {
		const uint32_t *c = r->triangle[i].corner;
		int64_t corner[3][2];

		if (c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST || chain_lines_out(reader, r, c))
			continue;
		for (unsigned j = 0; j < 3; j++)
			for (unsigned a = 0; a < 2; a++)
				corner[j][a] = r->xy[c[j]][a] + k[a];
		digest_add_triangle(&sum, corner);
		n++;
	}
	assert_int_equal(totals->triangles, n);
	assert_true(digest_equal(totals->digest, sum));
}

uint64_t chain_lines_check(const struct reader *reader, const struct view *view, const struct chain_lines *l,
			   const struct pipe_totals *totals)
{
	struct gather all = {0};
	struct mesh_vertex *v;
	struct tri_pieces *p;
	struct tri_result r;
	struct tri *t;
	uint64_t crossed = 0;
	uint32_t n;

	CHECK(grid_scan(reader->r, 0, UINT64_MAX, gather_sink, &all, &err));
	v = calloc(all.n + 1, sizeof *v);
	n = keep(view, &all, v);
	t = n < 3 ? NULL : check_tri(v, n);
	if (t) {
		tri_result(t, &r);
		crossed = chain_lines_insert(l, t, v, n, &p);
		compare(reader, &r, totals);
		free(p);
		free(t);
	}
	free(all.pts);
	free(v);
	return crossed;
}
