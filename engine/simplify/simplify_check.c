/*
 * A task of a round: tests the points of the view against the triangles that a region owns, and of each triangle from which one
 * is farther than the error takes the farthest point. These points are added to the triangulation at hand, and what they change
 * is tested again, until the region has no such triangle (simplify_region.c). Other regions do the same meanwhile, so the next
 * round tests again.
 *
 * Regions are a constant of the seeds, and so is the memory in which they are made: both decide what is added.
 *
 * In later rounds only triangles with a corner that the last round added are tested: the others were there before, and have
 * no point that is too far, else one had been added, and with it in their circle they had gone. (A triangle whose corners are all
 * old has no old point in its circle, that is visible from it, so it was in the mesh before. docs/design/simplify.md.)
 *
 * A region near which the last round added nothing is not even read. Near: no farther than the sum of its sides. A triangle that
 * it owns has its circle's centre in the region, and no vertex of the mesh is nearer to the centre than the corners; but a vertex
 * in the region is. So what was added far away is no corner of its triangles, and in none of their circles.
 *
 * The greatest error of the triangles that are not tested again is that of the round before, if the triangle that had it is still
 * there. Else, and that is rare, all triangles of the region are tested again. With pieces of lines all are tested in every
 * round: of a triangle that pieces made the owner may be another one when points are added.
 *
 * The memory: this struct; the domain (trace, reader of the chosen points, kernel); the reader of the points; for each triangle
 * its farthest point, and bits; the keys of points that were added.
 */
#include <stdlib.h>
#include <string.h>

#include "align.h"
#include "err.h"
#include "order.h"
#include "simplify_region.h"

enum { LEAVES = 1, KEYS = 512 };

/* For each position of the kernel's arena: two triangles. */
enum { EACH = 2 * sizeof(struct point) + sizeof(uint64_t) + 1 };

static size_t fixed_bytes(const struct simplify *s)
{
	return align_line(sizeof(struct simplify_check)) + align_line(grid_reader_bytes(s->p.grid)) + 5 * ALIGN_LINE;
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

static int lay_out(struct simplify_check *c, uint8_t *memory, struct err *err)
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
	c->list = (uint32_t *)(void *)c->key;
	c->mine = align_carve(&at, (2 * cap + 63) / 64 * sizeof *c->mine);
	c->fresh = align_carve(&at, (cap + 63) / 64 * sizeof *c->fresh);
	return 0;
}

/* ---- the vertices that the last round added ---- */

static bool has_key(const struct simplify_check *c, size_t n, uint64_t key)
{
	return bsearch(&key, c->key, n, sizeof key, order_u64) != NULL;
}

static int first_key(const struct simplify_check *c, uint64_t key, uint64_t *ret, struct err *err)
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

/* All vertices, if all triangles are tested, or if those that may have been added do not fit. */
static int find_fresh(struct simplify_check *c, bool all, struct err *err)
{
	uint64_t lo = UINT64_MAX, hi = 0, from = 0, to = c->in.n;
	int r = 0;

	memset(c->fresh, 0xff, (c->budget.cap + 63) / 64 * sizeof *c->fresh);
	if (all)
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
	c->all = false;
	r = simplify_in_some(&c->in, c->key, from, (size_t)(to - from), err);
	memset(c->fresh, 0, (c->budget.cap + 63) / 64 * sizeof *c->fresh);
	for (uint32_t i = 0; !r && from < to && i < c->tri.nvertex; i++)
		if (has_key(c, (size_t)(to - from), point_morton(c->tri.xy[i][0], c->tri.xy[i][1])))
			c->fresh[i / 64] |= UINT64_C(1) << i % 64;
	return r;
}

/* ---- regions near them ---- */

static int32_t clamp(int64_t v)
{
	return v < INT32_MIN ? INT32_MIN : v > INT32_MAX ? INT32_MAX : (int32_t)v;
}

/* The positions that are near the region, which is finite. */
static void find_near(const struct simplify *s, const struct cut_region *region, int32_t ret[4])
{
	int64_t box[4], far;

	cut_region_box(region, box); /* doubled */
	far = s->narrow ? 0 : box[2] - box[0] + box[3] - box[1];
	for (unsigned k = 0; k < 2; k++) {
		ret[k] = clamp((box[k] - far) / 2 - 1);
		ret[2 + k] = clamp((box[2 + k] + far) / 2 + 1);
	}
}

/* Whether a key of these is in the box. */
static bool any_in(const uint64_t *key, size_t n, const int32_t box[4])
{
	int32_t x, y;

	for (size_t i = 0; i < n; i++) {
		point_from_morton(key[i], &x, &y);
		if (x >= box[0] && y >= box[1] && x <= box[2] && y <= box[3])
			return true;
	}
	return false;
}

/* Whether the last round added a point near the region. */
static int has_near(const struct simplify_check *c, const struct cut_region *region, bool *ret, struct err *err)
{
	uint64_t key[KEYS], at, last;
	int32_t box[4];
	int r;

	find_near(c->s, region, box);
	last = point_morton(box[2], box[3]);
	r = first_key(c, point_morton(box[0], box[1]), &at, err);
	for (*ret = false; !r && !*ret && at < c->in.n; at += KEYS) {
		size_t n = c->in.n - at < KEYS ? (size_t)(c->in.n - at) : KEYS;

		r = simplify_in_some(&c->in, key, at, n, err);
		*ret = !r && any_in(key, n, box);
		if (!r && key[n - 1] > last)
			break;
	}
	return r;
}

/* ---- regions ---- */

static bool has_vertex(const struct simplify_check *c, const struct cut_region *region)
{
	for (uint32_t i = 0; i < c->tri.nvertex; i++)
		if (cut_region_holds(region, c->tri.xy[i][0], c->tri.xy[i][1]))
			return true;
	return false;
}

/* Whether all sides are finite, or none. */
static bool sides(const struct cut_region *region, bool finite)
{
	int64_t box[4];

	cut_region_box(region, box);
	for (unsigned k = 0; k < 4; k++)
		if ((box[k] == (k < 2 ? INT64_MIN : INT64_MAX)) == finite)
			return false;
	return true;
}

static int split(struct simplify_check *c, size_t i, uint64_t need, struct err *err)
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

static int check_regions(struct simplify_check *c, struct err *err)
{
	struct pipe_kernel k;
	uint64_t need = 0;
	bool vertex = false, pieces = false;
	int r = 0;

	for (size_t i = 0; !r && i < c->plan.n;) {
		const struct cut_region region = c->plan.leaf[i].region;

		r = pipe_kernel(c->s->chosen, &c->s->rest, &region, NULL, &c->budget, c->domain, &k, &need, err);
		if (r == PIPE_E_SPLIT) {
			r = split(c, i, need, err);
			continue;
		}
		if (!r && !k.flat) {
			tri_result(k.tri, &c->tri);
			r = find_fresh(c, c->whole || k.chosen, err);
			if (!r)
				r = simplify_region(c, &k, &region, err);
			vertex = vertex || has_vertex(c, &region);
			pieces = pieces || k.chosen;
		}
		i++;
	}
	if (c->plan.n == 1 && !c->open && sides(&c->plan.leaf->region, false))
		c->found.is |= SIMPLIFY_CLOSED;
	if (vertex && !pieces)
		c->found.is |= SIMPLIFY_BOUND;
	return r;
}

/* For tests. */
static void count(atomic_uint *n)
{
	if (n)
		atomic_fetch_add(n, 1);
}

/* Tests again whatever the round before does not answer. */
static int check_task(struct simplify_check *c, struct err *err)
{
	const struct cut_leaf leaf = *c->plan.leaf;
	bool near = true;
	int r = 0;

	c->all = true;
	c->whole = !c->s->at.round || c->before.far == SIMPLIFY_UNKNOWN;
	if (!c->whole && (c->before.is & SIMPLIFY_BOUND) && sides(&leaf.region, true))
		r = has_near(c, &leaf.region, &near, err);
	if (!near) {
		count(c->s->unread);
		c->found = c->before;
		c->found.tests = 0;
		return 0;
	}
	if (!r)
		r = check_regions(c, err);
	if (r || c->all || c->found.far == SIMPLIFY_UNKNOWN || c->found.far >= c->before.far)
		return r;
	if (c->again) {
		c->found.far = c->before.far;
		memcpy(c->found.corner, c->before.corner, sizeof c->found.corner);
		return 0;
	}
	count(c->s->twice);
	c->whole = c->all = true;
	c->plan.n = 1;
	*c->plan.leaf = leaf;
	return check_regions(c, err);
}

static int read_before(struct simplify_check *c, uint32_t task, struct err *err)
{
	const struct simplify *s = c->s;
	char name[GRID_NAME_MAX];
	int r = simplify_in_begin(&c->in, s->p.dirfd, simplify_name(name, "bad", s->at.attempt, s->at.round - 1, task),
				  sizeof *c->worst, err);

	if (r)
		return r;
	memcpy(&c->before, c->in.info, sizeof c->before);
	simplify_in_end(&c->in);
	return simplify_in_begin(&c->in, s->p.dirfd, simplify_name(name, "fresh", s->at.attempt, s->at.round, 0), sizeof *c->key,
				 err);
}

static int begin(struct simplify_check *c, uint32_t task, struct err *err)
{
	const struct simplify *s = c->s;
	struct cut_leaf leaf = {.exact = false};
	char name[GRID_NAME_MAX];
	int r = simplify_in_begin(&c->in, s->p.dirfd, simplify_name(name, "plan", s->at.attempt, 0, 0), sizeof leaf.region, err);

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
	return s->at.round ? read_before(c, task, err) : 0;
}

int simplify_check(const struct simplify *s, uint32_t task, void *memory, struct err *err)
{
	struct simplify_check *c = memory;
	uint64_t info[SIMPLIFY_INFO];
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
		r = check_task(c, err);
	memcpy(info, &c->found, sizeof info);
	if (!r)
		r = simplify_out_end(&c->out, info, err);
	simplify_out_abort(&c->out);
	simplify_in_end(&c->in);
	cut_plan_done(&c->plan);
	return r;
}
