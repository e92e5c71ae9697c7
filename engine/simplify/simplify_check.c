/*
 * A task of a round: tests the points of the view against the triangles that a region owns, and of each triangle from which one
 * is farther than the error takes the farthest point. These points are added to the triangulation at hand, and what they change
 * is tested again, until the region has no such triangle. Other regions do the same meanwhile, so the next round tests again.
 *
 * Regions are a constant of the points chosen, and so is the memory in which they are made: both decide what is added.
 *
 * Triangles are tested where they were made, in the triangulation of what the region loads. It has triangles of other regions,
 * too, and some that are not in the mesh, so that every point lies in one: a walk finds it. If that is not one of the region's,
 * the point is another region's. A point on a side is tested against both triangles there; one at a corner is a point of the
 * mesh. So a triangle is tested against all points in it, its sides included, whatever region they are in.
 *
 * In later rounds only triangles with a corner that the last round added are tested: the others were there before, and have
 * no point that is too far, else one had been added, and with it in their circle they had gone. (A triangle whose corners are all
 * old has no old point in its circle, that is visible from it, so it was in the mesh before. docs/design/simplify.md.)
 *
 * The memory: this struct; the domain (trace, reader of the chosen points, kernel); the reader of the points; for each triangle
 * its farthest point, and bits; the keys of points that were added.
 */
#include <stdlib.h>
#include <string.h>

#include "align.h"
#include "cut_owner.h"
#include "err.h"
#include "order.h"
#include "pipe.h"
#include "simplify_error.h"
#include "simplify_priv.h"
#include "simplify_raster.h"
#include "tri.h"

enum { NONE = UINT16_MAX, LEAVES = 1 };

struct check {
	const struct simplify *s;
	struct pipe_budget budget;
	struct cut_plan plan; /* of the task's region, split as often as necessary */
	struct simplify_in in;
	struct simplify_out out;
	struct simplify_sink sink;
	struct simplify_raster raster;
	uint8_t *domain, *source; /* the memory of the domain, of the reader of the points */
	struct point *worst;      /* of each triangle; the tag is NONE if there is none */
	uint64_t *mine;           /* a bit for each triangle that is tested */
	uint64_t *key;            /* of points that were added, ascending */
	uint64_t *fresh;          /* a bit for each vertex that was added */
	struct tri_result tri;
	uint32_t at; /* the triangle of the last point */
	uint32_t random;
	struct simplify_plane plane;
	uint32_t plane_of;
	uint64_t tests;
};

/* For each position of the kernel's arena: two triangles. */
enum { EACH = 2 * sizeof(struct point) + sizeof(uint64_t) + 1 };

static size_t fixed_bytes(const struct simplify *s)
{
	return align_line(sizeof(struct check)) + align_line(grid_reader_bytes(s->p.grid)) + 5 * ALIGN_LINE;
}

/* Without a grid of the points chosen: one of as many segments as it may have. */
size_t simplify_check_bytes(const struct simplify_params *p)
{
	struct pipe_budget budget;
	struct err err = ERR_INIT;
	struct simplify s = {.p = *p};

	pipe_budget_fixed(SIMPLIFY_REGION, 0, fixed_bytes(&s), EACH, NULL, &budget, &err);
	/* For a cursor and a buffer of each of the other segments. */
	return (size_t)err.need + SIMPLIFY_SEGMENTS * ((size_t)1 << 16);
}

static int lay_out(struct check *c, uint8_t *memory, struct err *err)
{
	const struct simplify *s = c->s;
	uint8_t *at = memory + align_line(sizeof *c);
	size_t cap;
	int r;

	r = pipe_budget_fixed(SIMPLIFY_REGION, s->p.memory, fixed_bytes(s), EACH, s->chosen, &c->budget, err);
	if (r)
		return r;
	cap = c->budget.cap;
	c->domain = align_carve(&at, c->budget.domain_bytes);
	c->source = align_carve(&at, grid_reader_bytes(s->p.grid));
	c->worst = align_carve(&at, 2 * cap * sizeof *c->worst);
	c->key = align_carve(&at, cap * sizeof *c->key);
	c->mine = align_carve(&at, (2 * cap + 63) / 64 * sizeof *c->mine);
	c->fresh = align_carve(&at, (cap + 63) / 64 * sizeof *c->fresh);
	return 0;
}

static inline bool bit_of(const uint64_t *bits, uint32_t i)
{
	return bits[i / 64] >> i % 64 & 1;
}

static inline bool is_ghost(const struct tri_triangle *t)
{
	return t->corner[0] == TRI_GHOST || t->corner[1] == TRI_GHOST || t->corner[2] == TRI_GHOST;
}

/* ---- the vertices that the last round added ---- */

static bool has_key(const struct check *c, size_t n, uint64_t key)
{
	return bsearch(&key, c->key, n, sizeof key, order_u64) != NULL;
}

static int first_key(const struct check *c, uint64_t key, uint64_t *ret, struct err *err)
{
	uint64_t lo = 0, hi = c->in.n, at;
	int r = 0;

	while (!r && lo < hi) {
		uint64_t mid = lo + (hi - lo) / 2;

		r = simplify_in_some(&c->in, &at, mid, 1, err);
		if (r)
			break;
		if (at < key)
			lo = mid + 1;
		else
			hi = mid;
	}
	*ret = lo;
	return r;
}

/* All vertices, if it is the first round, or if those that may have been added do not fit. */
static int find_fresh(struct check *c, struct err *err)
{
	uint64_t lo = UINT64_MAX, hi = 0, from = 0, to = c->in.n;
	int r = 0;

	memset(c->fresh, 0xff, (c->budget.cap + 63) / 64 * sizeof *c->fresh);
	if (c->in.fd < 0)
		return 0;
	for (uint32_t i = 0; i < c->tri.nvertex; i++) {
		uint64_t key = point_morton(c->tri.xy[i][0], c->tri.xy[i][1]);

		lo = key < lo ? key : lo;
		hi = key > hi ? key : hi;
	}
	r = first_key(c, lo, &from, err);
	if (!r && hi != UINT64_MAX)
		r = first_key(c, hi + 1, &to, err);
	if (r || to - from > c->budget.cap)
		return r;
	r = simplify_in_some(&c->in, c->key, from, (size_t)(to - from), err);
	memset(c->fresh, 0, (c->budget.cap + 63) / 64 * sizeof *c->fresh);
	for (uint32_t i = 0; !r && from < to && i < c->tri.nvertex; i++)
		if (has_key(c, (size_t)(to - from), point_morton(c->tri.xy[i][0], c->tri.xy[i][1])))
			c->fresh[i / 64] |= UINT64_C(1) << i % 64;
	return r;
}

/* ---- the triangles to test ---- */

static bool is_mine(const struct check *c, const struct pipe_kernel *k, const struct cut_owner *owner, uint32_t i)
{
	const uint32_t *v = c->tri.triangle[i].corner;

	if (is_ghost(&c->tri.triangle[i]) || !(bit_of(c->fresh, v[0]) || bit_of(c->fresh, v[1]) || bit_of(c->fresh, v[2])))
		return false;
	if (k->chosen && (bit_of(k->chosen, i) || !k->special || bit_of(k->special, i)))
		return bit_of(k->chosen, i);
	return cut_owner_has(owner, c->tri.xy[v[0]], c->tri.xy[v[1]], c->tri.xy[v[2]]);
}

/* Marks them; *ret_box contains them. False: there are none. */
static bool find_mine(struct check *c, const struct pipe_kernel *k, const struct cut_region *region, int32_t ret_box[4])
{
	struct cut_owner owner;
	bool any = false;

	cut_owner_init(&owner, region);
	memset(c->mine, 0, (c->tri.ntriangle + 63) / 64 * sizeof *c->mine);
	for (uint32_t i = 0; i < c->tri.ntriangle; i++) {
		const uint32_t *v = c->tri.triangle[i].corner;

		if (!is_mine(c, k, &owner, i))
			continue;
		c->mine[i / 64] |= UINT64_C(1) << i % 64;
		c->worst[i].tag = NONE;
		for (unsigned n = 0; n < 3; n++) {
			const int32_t *xy = c->tri.xy[v[n]];
			const int32_t box[4] = {xy[0], xy[1], xy[0], xy[1]};

			if (any)
				point_box_join(ret_box, box);
			else
				memcpy(ret_box, box, sizeof box);
			any = true;
		}
	}
	return any;
}

/* ---- a point ---- */

/* Goes from triangle to triangle towards p. *ret_sides: the sides on which it lies. False: it is beyond the hull. Which of two
 * sides is crossed is drawn, because with pieces a walk that always crosses the first may go in circles. */
static bool locate(struct check *c, const int32_t p[2], unsigned *ret_sides)
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

static void corner_point(const struct check *c, uint32_t v, struct point *ret)
{
	*ret = (struct point){.x = c->tri.xy[v][0], .y = c->tri.xy[v][1], .z = c->tri.z[v]};
}

static void test(struct check *c, uint32_t t, const struct point *p)
{
	struct point *worst = &c->worst[t];
	geom_u128 far, most;

	if (!bit_of(c->mine, t))
		return;
	c->tests++;
	if (c->plane_of != t) {
		struct point corner[3];

		for (unsigned k = 0; k < 3; k++)
			corner_point(c, c->tri.triangle[t].corner[k], &corner[k]);
		simplify_plane_init(&c->plane, &corner[0], &corner[1], &corner[2]);
		c->plane_of = t;
	}
	far = simplify_plane_far(&c->plane, p->x, p->y, p->z);
	if (!simplify_plane_beyond(&c->plane, far, (int64_t)c->s->at.error))
		return;
	if (worst->tag != NONE) {
		most = simplify_plane_far(&c->plane, worst->x, worst->y, worst->z);
		if (far < most || (far == most && digest_place(p->x, p->y) > digest_place(worst->x, worst->y)))
			return;
	}
	*worst = *p;
}

static int add_point(void *ctx, const struct point *p, struct err *err)
{
	const int32_t at[2] = {p->x, p->y};
	struct check *c = ctx;
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

static int read_points(struct check *c, struct err *err)
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

static int compare(const void *a, const void *b)
{
	return point_compare(a, b);
}

/* Collects the farthest points, at the front. A point on a side may be that of both triangles. */
static uint32_t take_worst(struct check *c)
{
	uint32_t n = 0, once = 0;

	for (uint32_t i = 0; i < c->tri.ntriangle; i++)
		if (bit_of(c->mine, i) && c->worst[i].tag != NONE)
			c->worst[n++] = c->worst[i];
	qsort(c->worst, n, sizeof *c->worst, compare);
	for (uint32_t i = 0; i < n; i++)
		if (!once || c->worst[i].x != c->worst[once - 1].x || c->worst[i].y != c->worst[once - 1].y)
			c->worst[once++] = c->worst[i];
	return once;
}

/* Tests the triangles with a fresh corner. *ret: how many points are to be added, in `worst`. */
static int test_fresh(struct check *c, const struct pipe_kernel *k, const struct cut_region *region, uint32_t *ret,
		      struct err *err)
{
	int32_t box[4];
	int r;

	*ret = 0;
	if (!find_mine(c, k, region, box))
		return 0;
	simplify_raster_init(&c->raster, box);
	c->plane_of = UINT32_MAX;
	for (uint32_t i = 0; i < c->tri.ntriangle; i++) {
		const uint32_t *v = c->tri.triangle[i].corner;

		if (!bit_of(c->mine, i))
			continue;
		c->at = i;
		simplify_raster_mark(&c->raster, c->tri.xy[v[0]], c->tri.xy[v[1]], c->tri.xy[v[2]]);
	}
	r = read_points(c, err);
	if (r)
		return r;
	*ret = take_worst(c);
	return simplify_out_add(&c->out, c->worst, *ret, err);
}

/* Adds n points to the triangulation; these alone are fresh then. False: not all of them fit. */
static bool add_worst(struct check *c, const struct pipe_kernel *k, uint32_t n)
{
	uint32_t before = tri_count(k->tri);

	for (uint32_t i = 0; i < n; i++) {
		const struct mesh_vertex v = {c->worst[i].x, c->worst[i].y, c->worst[i].z};

		if (tri_add(k->tri, &v, 1, false) == TRI_E_FULL)
			return false;
	}
	memset(c->fresh, 0, (c->budget.cap + 63) / 64 * sizeof *c->fresh);
	for (uint32_t i = before; i < tri_count(k->tri); i++)
		c->fresh[i / 64] |= UINT64_C(1) << i % 64;
	tri_result(k->tri, &c->tri);
	return true;
}

/* With pieces no point is added here: pipe_kernel does not keep what adding to pieces needs. */
static int check_kernel(struct check *c, const struct pipe_kernel *k, const struct cut_region *region, struct err *err)
{
	uint32_t n;
	int r;

	tri_result(k->tri, &c->tri);
	r = find_fresh(c, err);
	do {
		if (!r)
			r = test_fresh(c, k, region, &n, err);
	} while (!r && n && !k->chosen && add_worst(c, k, n));
	return r;
}

static int split(struct check *c, size_t i, uint64_t need, struct err *err)
{
	struct grid_reader *reader;
	int r = grid_reader_new(c->s->chosen, c->domain, grid_reader_bytes(c->s->chosen), &reader, err);

	if (r)
		return r;
	r = cut_plan_split(&c->plan, i, reader, need, c->budget.cap, err);
	grid_reader_free(reader);
	err->need = 0; /* positions of a region, whose size more memory does not change */
	return r;
}

static int check_regions(struct check *c, struct err *err)
{
	struct pipe_kernel k;
	uint64_t need = 0;
	int r = 0;

	for (size_t i = 0; !r && i < c->plan.n;) {
		const struct cut_region region = c->plan.leaf[i].region;

		r = pipe_kernel(c->s->chosen, &c->s->rest, &region, NULL, &c->budget, c->domain, &k, &need, err);
		if (r == PIPE_E_SPLIT) {
			r = split(c, i, need, err);
			continue;
		}
		if (!r && !k.flat)
			r = check_kernel(c, &k, &region, err);
		i++;
	}
	return r;
}

static int begin(struct check *c, uint32_t task, struct err *err)
{
	const struct simplify *s = c->s;
	struct cut_leaf leaf = {.exact = false};
	char name[GRID_NAME_MAX];
	int r = simplify_in_begin(&c->in, s->p.dirfd, simplify_name(name, "plan", s->at.attempt, s->at.round, 0),
				  sizeof leaf.region, err);

	if (r)
		return r;
	r = simplify_in_some(&c->in, &leaf.region, task, 1, err);
	simplify_in_end(&c->in);
	if (!r)
		r = cut_plan_room(&c->plan, LEAVES, err);
	if (r)
		return r;
	c->plan.leaf[c->plan.n++] = leaf;
	simplify_sink_init(&c->sink, s, &s->view);
	c->sink.ctx = c;
	c->sink.point = add_point;
	if (!s->at.round)
		return 0;
	return simplify_in_begin(&c->in, s->p.dirfd, simplify_name(name, "fresh", s->at.attempt, s->at.round, 0), sizeof *c->key,
				 err);
}

int simplify_check(const struct simplify *s, uint32_t task, void *memory, struct err *err)
{
	struct check *c = memory;
	uint64_t info[SIMPLIFY_INFO] = {0};
	char name[GRID_NAME_MAX];
	int r;

	memset(c, 0, sizeof *c);
	c->s = s;
	c->in.fd = -1;
	c->random = 1;
	r = lay_out(c, memory, err);
	if (r)
		return r;
	simplify_name(name, "bad", s->at.attempt, s->at.round, task);
	r = simplify_out_begin(&c->out, s->p.dirfd, name, sizeof *c->worst, err);
	if (r)
		return r;
	r = begin(c, task, err);
	if (!r)
		r = check_regions(c, err);
	info[0] = c->tests;
	if (!r)
		r = simplify_out_end(&c->out, info, err);
	simplify_out_abort(&c->out);
	simplify_in_end(&c->in);
	cut_plan_done(&c->plan);
	return r;
}
