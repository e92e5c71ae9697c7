/*
 * A task of a round. In the first one, of one region: it tests the points of the view against the triangles that the region owns,
 * and of each triangle from which one is farther than the error takes the farthest point. Those that change only triangles of the
 * region are added to the triangulation at hand, and what they change is tested again (simplify_region.c). Around the others,
 * near the region's border, later rounds test (simplify_star.c).
 *
 * Regions are a constant of the seeds, and so is the memory in which they are made: both decide what is added.
 *
 * The memory: this struct; the domain (trace, reader of the chosen points, kernel); the reader of the points; for each triangle
 * its farthest point, and bits.
 */
#include <stdlib.h>
#include <string.h>

#include "align.h"
#include "err.h"
#include "simplify_region.h"

enum { LEAVES = 1 };

/* For each position of the kernel's arena: two triangles. */
enum { EACH = 2 * sizeof(struct point) + 2 * sizeof(uint32_t) + 1 };

static size_t fixed_bytes(const struct simplify *s)
{
	return align_line(sizeof(struct simplify_check)) + align_line(grid_reader_bytes(s->p.grid)) + 7 * ALIGN_LINE;
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

	r = pipe_budget_fixed(SIMPLIFY_REGION, s->p.memory, fixed_bytes(s), EACH, simplify_tested(s), &c->budget, err);
	if (r)
		return r;
	cap = c->budget.cap;
	c->domain = align_carve(&at, c->budget.domain_bytes);
	c->source = align_carve(&at, grid_reader_bytes(s->p.grid));
	c->worst = align_carve(&at, 2 * cap * sizeof *c->worst);
	c->list = align_carve(&at, 2 * cap * sizeof *c->list);
	c->mine = align_carve(&at, (2 * cap + 63) / 64 * sizeof *c->mine);
	c->fresh = align_carve(&at, (cap + 63) / 64 * sizeof *c->fresh);
	c->calm = align_carve(&at, (cap + 63) / 64 * sizeof *c->calm);
	c->keyed = align_carve(&at, (cap + 63) / 64 * sizeof *c->keyed);
	return 0;
}

/* ---- regions ---- */

static int split(struct simplify_check *c, size_t i, uint64_t need, struct err *err)
{
	struct grid_reader *reader;
	const struct grid *grid = simplify_tested(c->s);
	int r = grid_reader_new(grid, c->domain, grid_reader_bytes(grid), &reader, err);

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
	int r = 0;

	for (size_t i = 0; !r && i < c->plan.n;) {
		const struct cut_region region = c->plan.leaf[i].region;

		r = pipe_kernel(simplify_tested(c->s), &c->s->rest, &region, NULL, &c->budget, c->domain, &k, &need, err);
		if (r == PIPE_E_SPLIT) {
			r = split(c, i, need, err);
			continue;
		}
		if (!r && !k.flat) {
			tri_result(k.tri, &c->tri);
			r = simplify_region(c, &k, &region, err);
		}
		i++;
	}
	return r;
}

static int begin_region(struct simplify_check *c, uint32_t task, struct err *err)
{
	const struct simplify *s = c->s;
	struct cut_leaf leaf = {.exact = false};
	char name[GRID_NAME_MAX];
	int r = simplify_in_begin(&c->in, s->p.dirfd, simplify_name(name, "plan", s->at.attempt, s->at.round, 0),
				  sizeof leaf.region, err);

	if (r)
		return r;
	r = simplify_in_some(&c->in, &leaf.region, task, 1, err);
	if (!r)
		r = cut_plan_room(&c->plan, LEAVES, err);
	if (r)
		return r;
	c->plan.leaf[c->plan.n++] = leaf;
	if (s->at.edges && !s->at.round)
		r = simplify_in_begin(&c->border, s->p.dirfd, simplify_name(name, "border", s->at.attempt, 0, 0),
				      sizeof(uint64_t), err);
	if (r)
		return r;
	simplify_name(name, "edge", s->at.attempt, s->at.round, task);
	return simplify_out_begin(&c->edge, s->p.dirfd, name, sizeof *c->worst, err);
}

static int do_task(struct simplify_check *c, uint32_t task, struct err *err)
{
	int r;

	if (c->s->at.stars)
		return simplify_stars(c, task, err);
	r = begin_region(c, task, err);
	if (!r)
		r = check_regions(c, err);
	/* The task is done when the other file is there. */
	if (!r)
		r = simplify_out_end(&c->edge, NULL, err);
	simplify_out_abort(&c->edge);
	return r;
}

int simplify_check(const struct simplify *s, uint32_t task, void *memory, struct err *err)
{
	struct simplify_check *c = memory;
	uint64_t info[SIMPLIFY_INFO];
	char name[GRID_NAME_MAX];
	int r;

	memset(c, 0, sizeof *c);
	c->s = s;
	c->in.fd = c->border.fd = -1;
	c->random = 1;
	r = lay_out(c, memory, err);
	if (r)
		return r;
	simplify_name(name, "bad", s->at.attempt, s->at.round, task);
	r = simplify_out_begin(&c->out, s->p.dirfd, name, sizeof *c->worst, err);
	if (r)
		return r;
	simplify_sink_init(&c->sink, s, &s->view);
	c->sink.ctx = c;
	r = do_task(c, task, err);
	memcpy(info, &c->found, sizeof info);
	if (!r)
		r = simplify_out_end(&c->out, info, err);
	simplify_out_abort(&c->out);
	simplify_in_end(&c->in);
	simplify_in_end(&c->border);
	cut_plan_done(&c->plan);
	return r;
}
