/*
 * Incremental insertion with weights, as tri_insert.c without them. There are two differences. A position that is not in conflict
 * with the triangle around it is hidden, now and later. And a cavity may have vertices inside, which are hidden then: so it is no
 * tree, and makes fewer triangles than it removes.
 *
 * The cavity is followed depth first and counter-clockwise. A link of a removed triangle back to where it was entered from stays
 * valid, so no stack is needed: the lowest bit of that link marks it. An edge between two removed triangles that is not followed
 * always leads to a triangle that is not left yet, since a search without directions has no other edges: both sides become SKIP,
 * and the order of the sides that are left is still that around the cavity. A triangle is left when its last side is looked at.
 * So sides follow triangles that are left, as in a tree, and two spare triangles suffice at the beginning; what is spare at the
 * end is unused.
 */
#include "tri_regular.h"

#include <string.h>

#include "tri_priv.h"

enum { TABLE = 4 * TRI_SEARCH, STEPS = 1 << 13 }; /* of tri_regular_search; insertions between two calls of `progress` */
enum { SKIP = 0xfffffff0u, END = 0xfffffff8u, NONE = 0xffffffffu };
_Static_assert(TRI_MAX_POINTS <= 1u << TRI_WEIGHT_AT, "an id leaves room for the number of a weight");
_Static_assert(TRI_WEIGHTS <= 1u << (32 - TRI_WEIGHT_AT), "numbers of weights");

/* A vertex relative to the new position, and its height relative to that; for `narrow` sets. */
struct spoke {
	int64_t x, y, z;
	uint32_t vertex;
};

/* What an insertion needs. */
struct insert {
	struct tri_regular *r;
	struct tri_triangle *tri;
	const int32_t (*xy)[2];
	const uint32_t *id;
	const int64_t *weight;
	int32_t at[2];
	int64_t w;
	uint32_t p, root, spare;
	bool narrow;
};

/* All differences are below 2^30: heights are below 2^61 + 2^60, areas at most 2^61. */
static bool is_narrow(const struct tri_extent *e)
{
	const int64_t most = (INT64_C(1) << 30) - 1;

	return (int64_t)e->max[0] - e->min[0] <= most && (int64_t)e->max[1] - e->min[1] <= most;
}

static void extent_add(struct tri_extent *e, const int32_t at[2])
{
	for (unsigned k = 0; k < 2; k++) {
		e->min[k] = at[k] < e->min[k] ? at[k] : e->min[k];
		e->max[k] = at[k] > e->max[k] ? at[k] : e->max[k];
	}
}

bool tri_regular_conflict(const struct tri_regular *r, uint32_t triangle, struct geom_weighted p)
{
	const uint32_t *c = r->tri->triangle[triangle].corner;

	for (unsigned i = 0; i < 3; i++) {
		struct geom_weighted a, b;
		int turn;

		if (c[i] != TRI_GHOST)
			continue;
		a = tri_regular_vertex(r, c[(i + 1) % 3]);
		b = tri_regular_vertex(r, c[(i + 2) % 3]);
		turn = geom_orient(a.at, b.at, p.at);
		return (turn ? turn : geom_power_line(a, b, p)) > 0;
	}
	return geom_power(tri_regular_vertex(r, c[0]), tri_regular_vertex(r, c[1]), tri_regular_vertex(r, c[2]), p) > 0;
}

/* ---- conflicts of the position that is inserted ---- */

static inline struct spoke spoke_to(const struct insert *in, uint32_t vertex)
{
	struct spoke s = {(int64_t)in->xy[vertex][0] - in->at[0], (int64_t)in->xy[vertex][1] - in->at[1], 0, vertex};

	s.z = s.x * s.x + s.y * s.y - in->weight[in->id[vertex] >> TRI_WEIGHT_AT] + in->w;
	return s;
}

static inline int64_t cross(const struct spoke *a, const struct spoke *b)
{
	return a->x * b->y - a->y * b->x;
}

static bool conflict_of(const struct insert *in, uint32_t triangle)
{
	const uint32_t *c = in->tri[triangle].corner;

	if (in->narrow && c[0] != TRI_GHOST && c[1] != TRI_GHOST && c[2] != TRI_GHOST) {
		struct spoke a = spoke_to(in, c[0]), b = spoke_to(in, c[1]), v = spoke_to(in, c[2]);
		geom_i128 det = (geom_i128)a.z * cross(&b, &v) + (geom_i128)b.z * cross(&v, &a) + (geom_i128)v.z * cross(&a, &b);

		if (TRI_LIKELY(det != 0))
			return det > 0;
	}
	return tri_regular_conflict(in->r, triangle, (struct geom_weighted){in->at, in->w});
}

/* ---- the cavity ---- */

static uint32_t take(struct insert *in)
{
	uint32_t slot = in->spare;

	in->spare = in->tri[slot].link[0];
	return slot;
}

static void leave(struct insert *in, uint32_t slot)
{
	in->tri[slot].link[0] = in->spare;
	in->spare = slot;
}

/* Two spare triangles to begin with. */
static void find_spare(struct insert *in)
{
	struct tri_regular *r = in->r;

	in->spare = NONE;
	for (unsigned i = 0; i < 2; i++) {
		uint32_t slot = r->free;

		if (r->nfree) {
			r->free = in->tri[slot].link[0];
			r->nfree--;
		} else {
			slot = r->tri->ntriangle++;
		}
		leave(in, slot);
	}
}

static void give_back(struct insert *in)
{
	struct tri_regular *r = in->r;

	while (in->spare != NONE) {
		uint32_t slot = take(in);

		in->tri[slot] = (struct tri_triangle){{TRI_GHOST, TRI_GHOST, TRI_GHOST}, {r->free, 0, 0}};
		r->free = slot;
		r->nfree++;
	}
}

static bool is_removed(const struct insert *in, const struct tri_triangle *t, bool root_left)
{
	return (t->link[0] | t->link[1] | t->link[2]) & 1 || (!root_left && t == &in->tri[in->root]);
}

/* The fan that replaces the cavity: the sides arrive counter-clockwise. */
struct fan {
	uint32_t first, last;
};

static void fan_add(struct insert *in, struct fan *f, uint32_t a, uint32_t b, uint32_t link)
{
	uint32_t slot = take(in);
	struct tri_triangle *n = &in->tri[slot];

	n->corner[0] = a;
	n->corner[1] = b;
	n->corner[2] = in->p;
	n->link[1] = f->last << 3;
	n->link[2] = link;
	in->tri[link >> 3].link[(link & 6) >> 1] = slot << 3 | 2 << 1;
	if (f->first == NONE)
		f->first = slot;
	else
		in->tri[f->last].link[0] = slot << 3 | 1 << 1;
	f->last = slot;
}

/* Removes the triangles in conflict; `root` is one. Returns a triangle of the fan. */
static uint32_t cavity_fill(struct insert *in)
{
	struct fan fan = {NONE, NONE};
	struct tri_triangle *tri = in->tri;
	uint32_t at = in->root, side = 0;
	bool root_left = false;

	find_spare(in);
	for (;;) {
		const struct tri_triangle *t = &tri[at];
		bool is_root = !root_left && at == in->root, last = !is_root || side == 2, skip;
		uint32_t a = t->corner[(side + 1) % 3], b = t->corner[(side + 2) % 3], link = t->link[side],
			 back = at << 3 | side << 1;

		/* A triangle that was entered has two sides: the first is the one after its marked link. */
		if (!is_root && t->link[(side + 2) % 3] & 1)
			last = false;
		if (last) {
			back = is_root ? END : t->link[(side + 1) % 3] & ~1u;
			root_left |= is_root;
			leave(in, at);
		}
		skip = link == SKIP;
		if (!skip) {
			struct tri_triangle *n = &tri[link >> 3];
			uint32_t entry = (link & 6) >> 1;

			if (is_removed(in, n, root_left)) {
				n->link[entry] = SKIP;
			} else if (conflict_of(in, link >> 3)) {
				n->link[entry] = back | 1;
				at = link >> 3;
				side = (entry + 1) % 3;
				continue;
			} else {
				fan_add(in, &fan, a, b, link);
			}
		}
		if (!last) {
			side = (side + 1) % 3;
			continue;
		}
		if (back == END)
			break;
		at = back >> 3;
		side = ((back & 6) / 2 + 1) % 3;
	}
	tri[fan.last].link[0] = fan.first << 3 | 1 << 1;
	tri[fan.first].link[1] = fan.last << 3;
	give_back(in);
	return fan.last;
}

/* Inserts vertex p. */
static void insert_one(struct tri_regular *r, uint32_t p, bool narrow)
{
	struct tri *t = r->tri;
	struct insert in = {.r = r,
			    .tri = t->triangle,
			    .xy = (const int32_t(*)[2])t->xy,
			    .id = t->id,
			    .weight = r->weight,
			    .at = {t->xy[p][0], t->xy[p][1]},
			    .w = tri_regular_vertex(r, p).w,
			    .p = p,
			    .narrow = narrow};

	in.root = tri_locate(t, narrow, in.at, r->at);
	r->at = r->look = conflict_of(&in, in.root) ? cavity_fill(&in) : in.root;
}

/* ---- the interface ---- */

int tri_regular_run(struct tri_regular *r, uint32_t n, const uint8_t *kind)
{
	struct tri *t = r->tri;
	bool narrow;

	t->nvertex = n;
	t->ntriangle = r->nfree = r->at = r->look = 0;
	r->xy = (const int32_t(*)[2])t->xy;
	r->id = t->id;
	if (n == 0)
		return TRI_E_FLAT;
	tri_order(t, tri_input(t), n);
	for (uint32_t i = 0; i < n; i++)
		t->id[i] |= (uint32_t)kind[t->id[i]] << TRI_WEIGHT_AT;
	if (!tri_seed(t))
		return TRI_E_FLAT;
	narrow = is_narrow(&t->extent);
	for (uint32_t p = 3; p < n; p++) {
		if (p % STEPS == 0 && r->progress && r->progress(r->ctx))
			return TRI_E_STOPPED;
		insert_one(r, p, narrow);
	}
	return 0;
}

int tri_regular_add(struct tri_regular *r, const struct mesh_vertex *v, const uint8_t *kind, uint32_t n)
{
	struct tri *t = r->tri;

	for (uint32_t i = 0; i < n; i++) {
		const int32_t at[2] = {v[i].x, v[i].y};
		uint32_t p = t->nvertex;

		if (p == t->cap)
			return TRI_E_FULL;
		extent_add(&t->extent, at);
		memcpy(t->xy[p], at, sizeof at);
		t->z[p] = v[i].z;
		t->id[p] = p | (uint32_t)kind[i] << TRI_WEIGHT_AT;
		t->nvertex = p + 1;
		insert_one(r, p, is_narrow(&t->extent));
	}
	return 0;
}

void *tri_regular_room(const struct tri_regular *r)
{
	return r->tri->triangle + 2 * (size_t)r->tri->nvertex;
}

bool tri_regular_around(struct tri_regular *r, struct geom_weighted p, uint32_t *ret)
{
	const struct tri *t = r->tri;
	struct tri_extent extent = t->extent;

	extent_add(&extent, p.at);
	*ret = r->look = tri_locate(t, is_narrow(&extent), p.at, r->look);
	for (unsigned k = 0; k < 3; k++) {
		uint32_t c = t->triangle[r->look].corner[k];

		if (c != TRI_GHOST && t->xy[c][0] == p.at[0] && t->xy[c][1] == p.at[1])
			return false;
	}
	return tri_regular_conflict(r, r->look, p);
}

/* The place of a triangle in the table: zero if it is not in the list, else its number there, from 1. */
static uint16_t *place_of(uint16_t *table, const uint32_t *list, uint32_t triangle)
{
	uint32_t at = triangle % TABLE;

	while (table[at] && list[table[at] - 1] != triangle)
		at = (at + 1) % TABLE;
	return &table[at];
}

bool tri_regular_search(struct tri_regular *r, struct geom_weighted p, bool (*visit)(void *ctx, uint32_t triangle), void *ctx)
{
	const struct tri *t = r->tri;
	uint32_t list[TRI_SEARCH], n = 1;
	uint16_t table[TABLE] = {0};

	if (!tri_regular_around(r, p, &list[0]))
		return false;
	*place_of(table, list, list[0]) = 1;
	for (uint32_t i = 0; i < n; i++) {
		if (visit(ctx, list[i]))
			return true;
		for (unsigned k = 0; k < 3; k++) {
			uint32_t next = t->triangle[list[i]].link[k] >> 3;
			uint16_t *place = place_of(table, list, next);

			if (*place || !tri_regular_conflict(r, next, p))
				continue;
			if (n == TRI_SEARCH)
				return true;
			list[n++] = next;
			*place = (uint16_t)n;
		}
	}
	return false;
}

void tri_regular_pack(struct tri_regular *r)
{
	struct tri *t = r->tri;
	uint32_t n = 0;

	for (uint32_t i = 0; i < t->ntriangle; i++)
		if (tri_regular_used(&t->triangle[i]))
			t->triangle[n++] = t->triangle[i];
	for (uint32_t i = 0; i < t->nvertex; i++)
		t->id[i] &= (UINT32_C(1) << TRI_WEIGHT_AT) - 1;
	t->ntriangle = n;
	r->nfree = 0;
}
