/*
 * Incremental insertion: walk to the new position, remove the triangles whose circumcircle contains it, and fill the
 * cavity with a fan (algorithm.md 10).
 *
 * The removed triangles form a tree, because two of them share at most one side, and none of their vertices is inside
 * the cavity. The tree is searched depth first, counter-clockwise, with one test for each side, and the cavity is
 * filled in the same sweep. Sides of the cavity and triangles that are left for good alternate. So each new triangle
 * takes the slot of the removed triangle that was left just before, and only two fresh slots are needed. The triangles
 * that were entered but not left form the stack: each stores the place of the one below in the link that was followed.
 * So a cavity of any size needs no memory, no recursion and no marks.
 *
 * There are two ways to compute. "narrow" (the whole input spans less than 2^31): 64-bit coordinates relative to the
 * new position, carried from side to side. "careful" (wide inputs, and from the first ghost in conflict on): by vertex
 * numbers, in full precision.
 */
#include "tri_priv.h"

#include "geom.h"

/* Ends of the stack: below the first side of the cavity's first triangle, and below its other two sides. */
enum { STACK_FIRST = 0xfffffff8u, STACK_LAST = 0xfffffff0u };

/* A vertex relative to the new position. */
struct spoke {
	int64_t x, y;
	uint32_t vertex;
};

static inline struct spoke spoke_to(const int32_t (*xy)[2], uint32_t vertex, const int32_t p[2])
{
	return (struct spoke){(int64_t)xy[vertex][0] - p[0], (int64_t)xy[vertex][1] - p[1], vertex};
}

static inline int64_t cross(struct spoke a, struct spoke b)
{
	return a.x * b.y - a.y * b.x;
}

static inline int64_t dot(struct spoke a, struct spoke b)
{
	return a.x * b.x + a.y * b.y;
}

/* The tie order with the new position as origin: keys are lexicographic. Arguments are by value, because a struct whose
 * address is taken would stay in memory during the whole sweep. */
static __attribute__((noinline)) bool spoke_tie(struct spoke a, struct spoke b, struct spoke v)
{
	int64_t ka = a.x * ((int64_t)1 << 32) + a.y, kb = b.x * ((int64_t)1 << 32) + b.y;
	int64_t kv = v.x * ((int64_t)1 << 32) + v.y, most = ka > kb ? ka : kb;

	if (kv > most)
		return kv > 0 && cross(a, b) < 0;
	return most > 0 && (ka > kb ? cross(v, b) > 0 : cross(a, v) > 0);
}

/*
 * Whether the origin is inside the circumcircle of the triangle b, a, v across the side a, b of the cavity: the angles under
 * which the origin and v see the side are together more than a half turn, so their sum has a negative sine (Cline and Renka, A
 * storage-efficient method for construction of a Thiessen triangulation, 1984). Times four lengths this sine is the in-circle
 * determinant, with two long products in place of three. Coordinates differ by less than 2^31, so dots are below 2^63 and crosses
 * within 2^62.
 */
static inline bool spoke_conflict(struct spoke a, struct spoke b, struct spoke v)
{
	const struct spoke va = {a.x - v.x, a.y - v.y, 0}, vb = {b.x - v.x, b.y - v.y, 0};
	geom_i128 det = (geom_i128)dot(a, b) * cross(va, vb) - (geom_i128)cross(a, b) * dot(va, vb);

	if (TRI_UNLIKELY(det == 0))
		return spoke_tie(a, b, v);
	return det > 0;
}

/* Whether p is outside the hull edge a, b (outside on its left), or on it between its ends. */
static bool ghost_conflict(const int32_t a[2], const int32_t b[2], const int32_t p[2])
{
	int turn = geom_orient(a, b, p);

	if (turn)
		return turn > 0;
	return geom_less(a, b) ? geom_less(a, p) && geom_less(p, b) : geom_less(b, p) && geom_less(p, a);
}

static bool careful_conflict(const struct tri_triangle *t, const int32_t (*xy)[2], const int32_t p[2])
{
	for (unsigned i = 0; i < 3; i++)
		if (t->corner[i] == TRI_GHOST)
			return ghost_conflict(xy[t->corner[(i + 1) % 3]], xy[t->corner[(i + 2) % 3]], p);
	return geom_incircle(xy[t->corner[0]], xy[t->corner[1]], xy[t->corner[2]], p) > 0;
}

static uint32_t real_neighbour(const struct tri_triangle *tri, uint32_t at)
{
	for (unsigned i = 0; i < 3; i++)
		if (tri[at].corner[i] == TRI_GHOST)
			return tri[at].link[i] >> 3;
	return at;
}

/* Walks from triangle `at` to the triangle that contains p, or to a ghost whose side p is on. */
static uint32_t careful_walk(const struct tri_triangle *tri, const int32_t (*xy)[2], const int32_t p[2], uint32_t at)
{
	uint32_t from = UINT32_MAX;

	at = real_neighbour(tri, at);
	for (;;) {
		const struct tri_triangle *t = &tri[at];
		unsigned side = 0;

		for (; side < 3; side++) {
			if (t->link[side] >> 3 == from)
				continue;
			if (geom_orient(xy[t->corner[(side + 1) % 3]], xy[t->corner[(side + 2) % 3]], p) < 0)
				break;
		}
		if (side == 3)
			return at;
		from = at;
		at = t->link[side] >> 3;
		t = &tri[at];
		if (t->corner[0] == TRI_GHOST || t->corner[1] == TRI_GHOST || t->corner[2] == TRI_GHOST)
			return at;
	}
}

/*
 * The same in 64 bits. Leaves each triangle by the side that p is farther beyond. The state is the side that was
 * crossed, seen from the triangle behind it: p is not left of a, b. No branch depends on the path.
 */
static inline uint32_t narrow_walk(const struct tri_triangle *tri, const int32_t (*xy)[2], const int32_t p[2], uint32_t at)
{
	const int64_t px = p[0], py = p[1];
	const struct tri_triangle *t = &tri[at = real_neighbour(tri, at)];
	int64_t ax = xy[t->corner[1]][0] - px, ay = xy[t->corner[1]][1] - py;
	int64_t bx = xy[t->corner[2]][0] - px, by = xy[t->corner[2]][1] - py;
	bool out = ax * by - ay * bx < 0;
	uint32_t link = out ? t->link[0] : at << 3;

	if (!out) {
		int64_t x = ax, y = ay;

		ax = bx, ay = by;
		bx = x, by = y;
	}
	for (;;) {
		uint32_t side2 = link & 6, v, left, right;
		int64_t vx, vy, av, vb;
		bool go;

		t = &tri[link >> 3];
		v = tri_corner_of(t, side2);
		left = tri_link_of(t, tri_side_next(side2));
		right = tri_link_of(t, tri_side_prev(side2));
		if (TRI_UNLIKELY(v == TRI_GHOST))
			return link >> 3;
		vx = xy[v][0] - px;
		vy = xy[v][1] - py;
		av = ax * vy - ay * vx;
		vb = vx * by - vy * bx;
		go = av < vb;
		if ((go ? av : vb) >= 0)
			return link >> 3;
		link = go ? left : right;
		ax = go ? ax : vx;
		ay = go ? ay : vy;
		bx = go ? vx : bx;
		by = go ? vy : by;
	}
}

uint32_t tri_locate(const struct tri *t, bool narrow, const int32_t p[2], uint32_t from)
{
	const int32_t(*xy)[2] = (const int32_t(*)[2])t->xy;

	return narrow ? narrow_walk(t->triangle, xy, p, from) : careful_walk(t->triangle, xy, p, from);
}

/* A cavity that is being filled. */
struct cavity {
	struct tri_triangle *tri;
	const int32_t (*xy)[2];
	uint32_t p, root, fresh; /* the slots `fresh` and `fresh` + 1 are unused */
	int64_t to[2];           /* from p to the next vertex, or zero */
	/* The side that is next: between a and b, with the link across it. */
	struct spoke a, b;
	uint32_t link, top, slot, last;
	uint32_t toward; /* the triangle of the fan in whose direction the next vertex is */
};

/* Searches and fills the cavity. False, if not `careful`: a ghost is in conflict, and the rest has to be done carefully.
 * `pieces`: some links are constrained, and the cavity ends there. */
static inline __attribute__((always_inline)) bool cavity_sweep(struct cavity *cavity, bool careful, bool pieces)
{
	/* A copy, which is not in memory. */
	struct cavity c = *cavity;
	const int32_t at[2] = {c.xy[c.p][0], c.xy[c.p][1]};
	int64_t before = -1;
	bool done = true;

	for (;;) {
		struct tri_triangle *t = &c.tri[c.link >> 3], *n;
		uint32_t side2 = c.link & 6;
		struct spoke v = {0, 0, tri_corner_of(t, side2)};
		bool conflict;

		if (pieces && c.link & 1) {
			conflict = false;
		} else if (careful) {
			conflict = careful_conflict(t, c.xy, at);
		} else if (TRI_UNLIKELY(v.vertex == TRI_GHOST)) {
			conflict = careful_conflict(t, c.xy, at);
			done = !conflict;
			if (conflict)
				break;
		} else {
			v = spoke_to(c.xy, v.vertex, at);
			conflict = spoke_conflict(c.a, c.b, v);
		}
		if (conflict) {
			uint32_t first = tri_side_next(side2), here = c.link;

			c.link = tri_link_of(t, first);
			t->link[first >> 1] = c.top;
			c.top = (here & ~7u) | first;
			c.b = v;
			continue;
		}

		n = &c.tri[c.slot];
		n->corner[0] = c.a.vertex;
		n->corner[1] = c.b.vertex;
		n->corner[2] = c.p;
		n->link[1] = c.last << 3;
		n->link[2] = c.link;
		c.tri[c.last].link[0] = c.slot << 3 | 2;
		t->link[side2 >> 1] = c.slot << 3 | 4 | (pieces ? c.link & 1 : 0);
		if (!careful) {
			int64_t turn = c.b.x * c.to[1] - c.b.y * c.to[0];

			c.toward = before >= 0 && turn < 0 ? c.slot : c.toward;
			before = turn;
		}
		c.last = c.slot;

		c.a = c.b;
		if (c.top < STACK_LAST) {
			uint32_t second = tri_side_next(c.top & 6);

			c.slot = c.top >> 3;
			t = &c.tri[c.slot];
			c.top = tri_link_of(t, c.top & 6);
			c.b.vertex = tri_corner_of(t, tri_side_prev(second));
			c.link = tri_link_of(t, second);
		} else if (c.top == STACK_FIRST) {
			t = &c.tri[c.root];
			c.slot = c.fresh + 1;
			c.link = t->link[1];
			t->link[1] = STACK_LAST;
			c.top = c.root << 3 | 2;
			c.b.vertex = t->corner[0];
		} else {
			break;
		}
		if (!careful)
			c.b = spoke_to(c.xy, c.b.vertex, at);
	}
	*cavity = c;
	return done;
}

/* Replaces the triangles in conflict with vertex p (`root` is one) by a fan around p. The slots `fresh` and `fresh` + 1
 * are unused. Returns a triangle of the fan: if not `careful`, mostly the one towards vertex `next`. */
static inline __attribute__((always_inline)) uint32_t cavity_fill(struct tri_triangle *tri, const int32_t (*xy)[2], uint32_t p,
								  uint32_t next, uint32_t root, uint32_t fresh, bool careful,
								  bool pieces)
{
	struct cavity c = {
		.tri = tri,
		.xy = xy,
		.p = p,
		.root = root,
		.fresh = fresh,
		.to = {(int64_t)xy[next][0] - xy[p][0], (int64_t)xy[next][1] - xy[p][1]},
		.a.vertex = tri[root].corner[1],
		.b.vertex = tri[root].corner[2],
		.link = tri[root].link[0],
		.top = STACK_FIRST,
		.slot = fresh,
		.last = fresh,
		.toward = fresh,
	};

	careful |= c.a.vertex == TRI_GHOST || c.b.vertex == TRI_GHOST || tri[root].corner[0] == TRI_GHOST;
	if (!careful) {
		c.a = spoke_to(xy, c.a.vertex, xy[p]);
		c.b = spoke_to(xy, c.b.vertex, xy[p]);
		careful = !cavity_sweep(&c, false, pieces);
	}
	if (TRI_UNLIKELY(careful))
		cavity_sweep(&c, true, pieces);
	tri[c.last].link[0] = fresh << 3 | 2;
	tri[fresh].link[1] = c.last << 3;
	return c.toward;
}

void tri_insert_all(struct tri *t, bool narrow)
{
	struct tri_triangle *tri = t->triangle;
	const int32_t(*xy)[2] = (const int32_t(*)[2])t->xy;
	uint32_t at = 0, n = t->ntriangle;

	for (uint32_t p = 3; p < t->nvertex; p++) {
		at = narrow ? narrow_walk(tri, xy, xy[p], at) : careful_walk(tri, xy, xy[p], at);
		at = cavity_fill(tri, xy, p, p + 1 < t->nvertex ? p + 1 : p, at, n, !narrow, false);
		n += 2;
	}
	t->ntriangle = n;
}

bool tri_insert_one(struct tri *t, bool narrow, uint32_t *ret_same)
{
	struct tri_triangle *tri = t->triangle;
	const int32_t(*xy)[2] = (const int32_t(*)[2])t->xy;
	uint32_t p = t->nvertex - 1, n = t->ntriangle, at;

	/* The previous vertex is near the next one. */
	at = narrow ? narrow_walk(tri, xy, xy[p], n - 1) : careful_walk(tri, xy, xy[p], n - 1);
	for (unsigned i = 0; i < 3; i++) {
		uint32_t corner = tri[at].corner[i];

		if (corner == TRI_GHOST || xy[corner][0] != xy[p][0] || xy[corner][1] != xy[p][1])
			continue;
		*ret_same = corner;
		return false;
	}
	cavity_fill(tri, xy, p, p, at, n, !narrow, false);
	t->ntriangle = n + 2;
	return true;
}

bool tri_conflict(const struct tri *t, uint32_t triangle, const int32_t at[2])
{
	return careful_conflict(&t->triangle[triangle], (const int32_t(*)[2])t->xy, at);
}

void tri_insert_at(struct tri *t, uint32_t root)
{
	const int32_t(*xy)[2] = (const int32_t(*)[2])t->xy;
	uint32_t p = t->nvertex - 1;

	cavity_fill(t->triangle, xy, p, p, root, t->ntriangle, !tri_narrow(&t->extent), true);
	t->ntriangle += 2;
}

/* In triangles that are not Delaunay a walk may go round in circles if it always decides in the same way. So the side that is
 * tested first is drawn. */
uint32_t tri_walk(const struct tri *t, const int32_t at[2], uint32_t from)
{
	const int32_t(*xy)[2] = (const int32_t(*)[2])t->xy;
	uint32_t here = real_neighbour(t->triangle, from), before = UINT32_MAX, random = 1;

	for (;;) {
		const struct tri_triangle *tri = &t->triangle[here];
		unsigned side, left;

		random = random * UINT32_C(1664525) + UINT32_C(1013904223);
		side = random >> 30;
		for (left = 3; left > 0; left--, side++) {
			side -= side >= 3 ? 3 : 0;
			if (tri->link[side] >> 3 != before &&
			    geom_orient(xy[tri->corner[(side + 1) % 3]], xy[tri->corner[(side + 2) % 3]], at) < 0)
				break;
		}
		if (!left)
			return here;
		before = here;
		here = tri->link[side] >> 3;
		tri = &t->triangle[here];
		if (tri->corner[0] == TRI_GHOST || tri->corner[1] == TRI_GHOST || tri->corner[2] == TRI_GHOST)
			return here;
	}
}
