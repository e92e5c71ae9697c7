/*
 * The phase plan: the plane is halved into top leaves, and these are divided into ranges of about equal work.
 *
 * The model: load and cap decide which domains there are and which bytes they have, so they stand in the plan and come from the
 * memory of a task alone. The load is at most the one of kept domains (PIPE_KEPT_LOAD), as in acutd; the cap is the largest that
 * fits. How many top leaves there are, and how they are divided, decides only who makes what. So nothing depends on the number of
 * tasks but the division, and two attempts write the same bytes.
 *
 * Not here: halos. A task finds by itself which of its regions do not fit, at less cost than looking for all of them in advance.
 */
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>

#include "align.h"
#include "err.h"
#include "io.h"
#include "mesh_priv.h"

/* Top leaves a task, about, so that ranges are of nearly equal size. What a leaf takes beside its positions: this part of what a
 * full domain takes. */
enum { LEAVES = 5, LEAF_WORK = 32 };

struct planning {
	struct phase *s;
	struct mesh_plan plan;
	struct cut_plan top;
	uint64_t *first;
};

/* ---- load and cap ---- */

/* The largest cap that fits. */
static int choose_budget(const struct phase *s, struct pipe_budget *ret, struct err *err)
{
	int r = -ERR_LIMIT;

	for (int rung = PIPE_LOADS; r && rung-- > 0;) {
		err_clear(err);
		r = pipe_budget_fixed(pipe_load[rung], phase_arena(s), 0, 0, s->grid, ret, err);
	}
	if (r)
		return phase_needs(s, phase_arena_needs(s, err->need), err);
	if (ret->load > PIPE_KEPT_LOAD)
		ret->load = PIPE_KEPT_LOAD;
	if (s->p->load)
		ret->load = s->p->load;
	if (s->p->cap)
		ret->cap = s->p->cap;
	return 0;
}

static uint32_t top_load(const struct phase *s, uint32_t load, uint32_t tasks)
{
	uint64_t each = grid_points(s->grid) / ((uint64_t)tasks * LEAVES);

	if (s->p->top)
		each = s->p->top;
	return each < load ? load : each > INT32_MAX ? INT32_MAX : (uint32_t)each;
}

/* ---- the division ---- */

/* A leaf is of the task in whose share of the work its middle is. */
static int divide(struct planning *l, struct err *err)
{
	const uint32_t tasks = l->plan.tasks, each = l->plan.load / LEAF_WORK + 1;
	unsigned __int128 all = 0, at = 0;
	size_t i = 0;

	l->first = calloc((size_t)tasks + 1, sizeof *l->first);
	if (!l->first)
		return err_set(err, ERR_NOMEM, "no memory for %u tasks", (unsigned)tasks);
	for (size_t k = 0; k < l->top.n; k++)
		all += 2 * (l->top.leaf[k].count + each);
	for (uint32_t task = 0; task < tasks; task++) {
		for (l->first[task] = i; i < l->top.n; i++) {
			uint64_t work = l->top.leaf[i].count + each;

			if ((uint64_t)((at + work) * tasks / all) > task)
				break;
			at += 2 * (unsigned __int128)work;
		}
	}
	l->first[tasks] = l->top.n;
	return 0;
}

/* ---- the plan ---- */

static int resolve_view(struct planning *l, struct err *err)
{
	struct phase *s = l->s;
	const struct grid_manifest *m = grid_manifest(s->grid);
	const char *refused;
	int r = view_resolve(s->p->view ? s->p->view : "", &m->lattice, m->unit_xy, m->unit_z, &s->view, err);

	if (r)
		return r;
	refused = phase_refuses(&s->view);
	if (refused)
		return err_set(err, ERR_UNSUPPORTED, "a run of a cluster makes no mesh with %s", refused);
	l->plan.view = view_text(&s->view);
	if (!l->plan.view)
		return err_set(err, ERR_NOMEM, "no memory for a view");
	view_bind(&s->view, &m->lattice);
	return 0;
}

/* As acutd says it. */
static int without_ground(const struct phase *s, const struct mesh_counts *c, struct err *err)
{
	const struct grid_manifest *m = grid_manifest(s->grid);
	bool classified = false;

	for (size_t i = 0; i < m->nsegments; i++)
		classified |= m->segments[i].classes[2] || m->segments[i].classes[8];
	if (c->removed[VIEW_BY_CLASS] == c->points || (c->removed[VIEW_BY_CLASS] && !classified)) {
		err_set(err, ERR_INPUT, "the dataset has no ground points (classes 2 and 8, key-points)");
		return err_add_hint(err, "classify it first, for example with PDAL (filters.smrf, filters.csf), "
					 "LAStools (lasground) or CloudCompare (CSF), or leave --ground out");
	}
	err_set(err, ERR_INPUT, "what else the view asks for leaves no ground points");
	return err_add_hint(err, "leave out --ground, or some of the other options that choose points");
}

static int make_leaves(struct planning *l, struct err *err)
{
	struct phase *s = l->s;
	struct pipe_budget budget;
	size_t size = align_line(grid_reader_bytes(s->grid));
	void *memory;
	int r = choose_budget(s, &budget, err);

	if (r)
		return r;
	l->plan.load = budget.load;
	l->plan.cap = budget.cap;
	l->plan.top = budget.load = top_load(s, budget.load, l->plan.tasks);
	memory = aligned_alloc(64, size);
	if (!memory)
		return err_set(err, ERR_NOMEM, "no memory to plan a mesh");
	r = pipe_plan_make(s->grid, &s->view, &budget, memory, &l->top, &l->plan.empty, err);
	free(memory);
	if (r == -ERR_BUSY)
		return phase_needs(s, 2 * s->p->memory, err);
	if (r != PIPE_E_EMPTY)
		return r;
	return s->view.ground && !l->plan.empty.used ? without_ground(s, &l->plan.empty, err) : 0;
}

static int write_plan(struct planning *l, struct err *err)
{
	struct work_attempt *a = l->s->attempt;
	char name[WORK_NAME];
	int fd = -1, r = work_attempt_file(a, "", "plan", "", name, err);

	if (!r)
		r = io_open(work_fd(l->s->work), name, O_RDWR | O_CREAT | O_EXCL, 0640, &fd, err);
	if (!r)
		r = mesh_plan_write(fd, name, &l->plan, l->top.leaf, l->first, err);
	if (!r)
		r = io_sync(fd, name, err);
	io_close(fd);
	return r ? r : work_result_file(a, name, err);
}

static int write_results(struct planning *l, struct err *err)
{
	const struct {
		const char *key;
		uint64_t value;
	} of[] = {{"points", grid_points(l->s->grid)},
		  {"leaves", l->plan.leaves},
		  {"load", l->plan.load},
		  {"cap", l->plan.cap},
		  {"top", l->plan.top}};
	int r = 0;

	for (size_t i = 0; !r && i < sizeof of / sizeof *of; i++)
		r = work_result_u64(l->s->attempt, of[i].key, of[i].value, err);
	return r ? r : work_result(l->s->attempt, "view", l->plan.view, err);
}

static int run(struct phase *s, uint32_t task, struct err *err)
{
	struct planning l = {.s = s, .plan.tasks = work_about(s->work)->tasks[WORK_MESH]};
	int r = phase_open(s, err);

	if (!r)
		r = resolve_view(&l, err);
	if (!r)
		r = make_leaves(&l, err);
	if (!r) {
		l.plan.leaves = l.top.n;
		l.plan.flat = cut_plan_flat(&l.top);
		l.plan.content = grid_content(s->grid);
		r = divide(&l, err);
	}
	if (!r)
		r = write_plan(&l, err);
	if (!r)
		r = write_results(&l, err);
	cut_plan_done(&l.top);
	mesh_plan_done(&l.plan);
	free(l.first);
	return r;
}

int mesh_phase_plan(struct work *w, const struct mesh_phase_params *p, struct err *err)
{
	return phase_run(w, WORK_PLAN, 0, p, run, err);
}
