/*
 * The test of one region (simplify_check.c). Triangles are tested where they were made, in the triangulation of what the region
 * loads. It has triangles of other regions, too, and some that are not in the mesh, so that every point lies in one: a walk finds
 * it. If that is not one of the region's, the point is another region's. A point on a side is tested against both triangles
 * there; one at a corner is a point of the mesh. So a triangle is tested against all points in it, its sides included, whatever
 * region they are in.
 *
 * The farthest point of a triangle stays known until the triangle is gone. So at the end the greatest error of the region is that
 * of triangles which are still there.
 */
#include "simplify_region.h"

#include <stdlib.h>
#include <string.h>

#include "cut_owner.h"
#include "err.h"
#include "geom.h"
#include "tri_piece.h"

enum { NONE = UINT16_MAX, CAVITY = 256 };

static inline bool is_ghost(const struct tri_triangle *t)
{
	return t->corner[0] == TRI_GHOST || t->corner[1] == TRI_GHOST || t->corner[2] == TRI_GHOST;
}

static inline bool is_fresh(const struct simplify_check *c, uint32_t i)
{
	const uint32_t *v = c->tri.triangle[i].corner;

	return simplify_bit(c->fresh, v[0]) || simplify_bit(c->fresh, v[1]) || simplify_bit(c->fresh, v[2]);
}

/* ---- the triangles to test ---- */

/* Of a triangle that is no ghost. */
static bool is_own(const struct simplify_check *c, const struct pipe_kernel *k, const struct cut_owner *owner, uint32_t i)
{
	const uint32_t *v = c->tri.triangle[i].corner;

	if (k->chosen && (simplify_bit(k->chosen, i) || !k->special || simplify_bit(k->special, i)))
		return simplify_bit(k->chosen, i);
	return cut_owner_has(owner, c->tri.xy[v[0]], c->tri.xy[v[1]], c->tri.xy[v[2]]);
}

static uint64_t place_of(const struct simplify_check *c, uint32_t v)
{
	return digest_place(c->tri.xy[v][0], c->tri.xy[v][1]);
}

static void join_corners(const struct simplify_check *c, uint32_t i, bool first, int32_t box[4])
{
	for (unsigned n = 0; n < 3; n++) {
		const int32_t *xy = c->tri.xy[c->tri.triangle[i].corner[n]];
		const int32_t at[4] = {xy[0], xy[1], xy[0], xy[1]};

		if (first && !n)
			memcpy(box, at, sizeof at);
		else
			point_box_join(box, at);
	}
}

static void list(struct simplify_check *c, uint32_t i, int32_t box[4])
{
	c->worst[i].tag = NONE;
	join_corners(c, i, !c->nlist, box);
	c->list[c->nlist++] = i;
}

/* Marks and lists those that the region owns, but lists no settled ones; *ret_box contains those in the list. */
static int find_own(struct simplify_check *c, const struct pipe_kernel *k, const struct cut_region *region, int32_t ret_box[4],
		    struct err *err)
{
	struct cut_owner owner;
	int r = 0;

	cut_owner_init(&owner, region);
	c->nlist = 0;
	for (uint32_t i = 0; !r && i < c->tri.ntriangle; i++) {
		bool mine = !is_ghost(&c->tri.triangle[i]) && is_own(c, k, &owner, i);

		if (mine && simplify_in_strip(c))
			r = simplify_in_mesh(c, i, &mine, err);
		c->worst[i].tag = NONE;
		if (!mine)
			continue;
		c->mine[i / 64] |= UINT64_C(1) << i % 64;
		if (!simplify_is_calm(c, i))
			list(c, i, ret_box);
	}
	return r;
}

/* Marks and lists those with a fresh corner. What was added is in triangles of the region only, so these are the region's. */
static void find_fresh(struct simplify_check *c, int32_t ret_box[4])
{
	c->nlist = 0;
	for (uint32_t i = 0; i < c->tri.ntriangle; i++) {
		bool ghost = is_ghost(&c->tri.triangle[i]);

		if (!ghost && !is_fresh(c, i))
			continue;
		/* The place may be that of a triangle that is gone. */
		c->mine[i / 64] &= ~(UINT64_C(1) << i % 64);
		if (ghost)
			continue;
		c->mine[i / 64] |= UINT64_C(1) << i % 64;
		list(c, i, ret_box);
	}
}

/* ---- a point ---- */

/* Goes from triangle to triangle towards p. *ret_sides: the sides on which it lies. False: it is beyond the hull. Which of two
 * sides is crossed is drawn, because with pieces a walk that always crosses the first may go in circles. */
static bool locate(struct simplify_check *c, const int32_t p[2], unsigned *ret_sides)
{
	uint32_t at = c->at, from = UINT32_MAX;

	for (;;) {
		const struct tri_triangle *t = &c->tri.triangle[at];
		unsigned on = 0, k, first = (c->random = c->random * 1664525u + 1013904223u) >> 30;

		for (k = 0; k < 3; k++) {
			unsigned side = (first + k) % 3;
			uint32_t next = t->link[side] >> 3;
			int turn;

			if (next == from)
				continue;
			turn = geom_orient(c->tri.xy[t->corner[(side + 1) % 3]], c->tri.xy[t->corner[(side + 2) % 3]], p);
			if (turn < 0) {
				c->at = at;
				if (is_ghost(&c->tri.triangle[next]))
					return false;
				from = at;
				at = next;
				break;
			}
			on |= !turn ? 1u << side : 0;
		}
		if (k == 3) {
			c->at = at;
			*ret_sides = on;
			return true;
		}
	}
}

static void set_plane(struct simplify_check *c, uint32_t t)
{
	const struct point *worst = &c->worst[t];
	struct point corner[3];

	for (unsigned k = 0; k < 3; k++) {
		uint32_t v = c->tri.triangle[t].corner[k];

		corner[k] = (struct point){.x = c->tri.xy[v][0], .y = c->tri.xy[v][1], .z = c->tri.z[v]};
	}
	simplify_plane_init(&c->plane, &corner[0], &corner[1], &corner[2]);
	c->plane_of = t;
	c->most = worst->tag == NONE ? 0 : simplify_plane_far(&c->plane, worst->x, worst->y, worst->z);
}

static void test(struct simplify_check *c, uint32_t t, const struct point *p)
{
	struct point *worst = &c->worst[t];
	geom_u128 far;

	if (!simplify_bit(c->mine, t))
		return;
	c->found.tests++;
	if (c->plane_of != t)
		set_plane(c, t);
	far = simplify_plane_far(&c->plane, p->x, p->y, p->z);
	if (far < c->most ||
	    (far == c->most && worst->tag != NONE && digest_place(p->x, p->y) > digest_place(worst->x, worst->y)))
		return;
	c->most = far;
	*worst = *p;
}

static int add_point(void *ctx, const struct point *p, struct err *err)
{
	const int32_t at[2] = {p->x, p->y};
	struct simplify_check *c = ctx;
	unsigned sides;

	(void)err;
	if (!locate(c, at, &sides) || (sides & (sides - 1)))
		return 0;
	test(c, c->at, p);
	if (sides)
		test(c, c->tri.triangle[c->at].link[__builtin_ctz(sides)] >> 3, p);
	return 0;
}

/* ---- a region ---- */

int simplify_check_read(struct simplify_check *c, struct err *err)
{
	size_t n = simplify_raster_ranges(&c->raster);
	struct grid_reader *reader;
	int r = grid_reader_new(c->s->p.grid, c->source, grid_reader_bytes(c->s->p.grid), &reader, err);

	if (r)
		return r;
	for (size_t i = 0; !r && i < n; i++)
		r = simplify_scan(&c->sink, reader, c->raster.range[i].lo, c->raster.range[i].hi, err);
	grid_reader_free(reader);
	return r;
}

static int compare(const void *a, const void *b, void *ctx)
{
	const struct simplify_check *c = ctx;

	return point_compare(&c->worst[*(const uint32_t *)a], &c->worst[*(const uint32_t *)b]);
}

/* Leaves the triangles from which a point is too far in the list, by that point. One on a side may be that of both triangles. */
static void find_bad(struct simplify_check *c)
{
	uint32_t n = 0, once = 0;

	for (uint32_t i = 0; i < c->nlist; i++) {
		uint32_t t = c->list[i];

		if (c->worst[t].tag == NONE)
			continue;
		set_plane(c, t);
		if (simplify_plane_beyond(&c->plane, c->most, (int64_t)c->s->at.error))
			c->list[n++] = t;
	}
	qsort_r(c->list, n, sizeof *c->list, compare, c);
	for (uint32_t i = 0; i < n; i++) {
		const struct point *p = &c->worst[c->list[i]], *last = once ? &c->worst[c->list[once - 1]] : NULL;

		if (!last || p->x != last->x || p->y != last->y)
			c->list[once++] = c->list[i];
	}
	c->nlist = once;
}

/* Tests the triangles that the region owns, or those with a fresh corner. The farthest points of those in the list then are to be
 * added. */
static int test_fresh(struct simplify_check *c, const struct pipe_kernel *k, const struct cut_region *region, bool first,
		      struct err *err)
{
	int32_t box[4];
	int r = 0;

	if (first)
		r = find_own(c, k, region, box, err);
	else
		find_fresh(c, box);
	if (r || !c->nlist)
		return r;
	simplify_raster_init(&c->raster, box, SIMPLIFY_RASTER);
	c->plane_of = UINT32_MAX;
	c->at = c->list[0];
	for (uint32_t i = 0; i < c->nlist; i++) {
		const uint32_t *v = c->tri.triangle[c->list[i]].corner;

		simplify_raster_mark(&c->raster, c->tri.xy[v[0]], c->tri.xy[v[1]], c->tri.xy[v[2]]);
	}
	r = simplify_check_read(c, err);
	if (r)
		return r;
	find_bad(c);
	for (uint32_t i = 0; !r && i < c->nlist; i++)
		r = simplify_out_add(&c->out, &c->worst[c->list[i]], 1, err);
	return r;
}

/* Whether all triangles that have the point in their circle, and those around them, are the region's, so that no other region
 * changes them. `root`: the one that has the point. */
static bool is_inner(const struct simplify_check *c, uint32_t root, const int32_t at[2])
{
	uint32_t link[CAVITY], n = 1;

	if (is_ghost(&c->tri.triangle[root]) || !simplify_bit(c->mine, root))
		return false;
	link[0] = root << 3 | 6;
	for (uint32_t i = 0; i < n; i++)
		for (uint32_t side = 0; side < 3; side++) {
			uint32_t next = c->tri.triangle[link[i] >> 3].link[side], there = next >> 3;
			const struct tri_triangle *t = &c->tri.triangle[there];

			if (side == (link[i] & 6) >> 1 || next & 1)
				continue;
			if (is_ghost(t) || !simplify_bit(c->mine, there))
				return false;
			if (geom_incircle(c->tri.xy[t->corner[0]], c->tri.xy[t->corner[1]], c->tri.xy[t->corner[2]], at) <= 0)
				continue;
			if (n == CAVITY)
				return false;
			link[n++] = next;
		}
	return true;
}

/* Adds a point to the triangulation, if that is inner. *ret_added: whether it did. False: it has no more room. */
static bool add_inner(struct simplify_check *c, const struct pipe_kernel *k, const struct point *p, uint32_t near,
		      bool *ret_added)
{
	const int32_t at[2] = {p->x, p->y};
	const struct mesh_vertex v = {p->x, p->y, p->z};
	uint32_t root = tri_walk(k->tri, at, near), n = c->tri.ntriangle;
	int full;

	*ret_added = false;
	if (!is_inner(c, root, at) && !c->s->inward)
		return true;
	if (c->s->grow && tri_count(k->tri) >= c->s->grow)
		return false;
	full = k->pieces ? tri_piece_add(k->pieces, &v, root, &n) : tri_add(k->tri, &v, 1, false);
	if (full == TRI_E_FULL)
		return false;
	*ret_added = !full;
	n = c->tri.ntriangle;
	tri_result(k->tri, &c->tri);
	/* The others have the places of those that are gone. */
	for (; n < c->tri.ntriangle; n++)
		c->mine[n / 64] |= UINT64_C(1) << n % 64;
	return true;
}

/* Adds these points, if they are inner; those alone are fresh then. Around others a later round tests. */
static int add_bad(struct simplify_check *c, const struct pipe_kernel *k, struct err *err)
{
	uint32_t before = tri_count(k->tri);
	int r = 0;

	for (uint32_t i = 0; !r && i < c->nlist; i++) {
		const struct point *p = &c->worst[c->list[i]];
		bool added = false;

		if (!c->found.full && !add_inner(c, k, p, c->list[i], &added))
			c->found.full = 1;
		if (!added)
			r = simplify_out_add(&c->edge, p, 1, err);
		else if (c->s->settled)
			atomic_fetch_add(c->s->settled, 1);
	}
	memset(c->fresh, 0, (c->budget.cap + 63) / 64 * sizeof *c->fresh);
	for (uint32_t i = before; i < tri_count(k->tri); i++)
		c->fresh[i / 64] |= UINT64_C(1) << i % 64;
	return r;
}

/* The greatest error of the triangles that stay: one from which a point is too far will go. */
static void measure(struct simplify_check *c)
{
	for (uint32_t i = 0; i < c->tri.ntriangle; i++) {
		const uint32_t *v = c->tri.triangle[i].corner;

		if (!simplify_bit(c->mine, i) || c->worst[i].tag == NONE)
			continue;
		set_plane(c, i);
		if (!simplify_plane_beyond(&c->plane, c->most, (int64_t)c->s->at.error))
			simplify_found_far(&c->found, c->most, c->plane.area,
					   (const uint64_t[]){place_of(c, v[0]), place_of(c, v[1]), place_of(c, v[2])});
	}
}

int simplify_region(struct simplify_check *c, const struct pipe_kernel *k, const struct cut_region *region, struct err *err)
{
	int r = simplify_in_strip(c) ? simplify_calm(c, region, err) : 0;

	c->sink.point = add_point;
	memset(c->mine, 0, (2 * (size_t)c->budget.cap + 63) / 64 * sizeof *c->mine);
	for (bool first = true; !r; first = false) {
		uint32_t before = c->tri.nvertex;

		r = test_fresh(c, k, region, first, err);
		if (!r)
			r = add_bad(c, k, err);
		if (c->tri.nvertex == before)
			break;
	}
	if (!r)
		measure(c);
	return r;
}
