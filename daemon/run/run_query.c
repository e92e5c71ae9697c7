/* What other rooms ask of a run: its plan, its sums, its progress. */
#include "clock.h"
#include "run_priv.h"

const struct pipe_totals *run_totals(const struct run *w)
{
	return &w->totals;
}

uint64_t run_reused(const struct run *w)
{
	if (w->plan_only)
		return w->reusable;
	return w->made < w->plan_n ? w->plan_n - w->made : 0;
}

size_t run_emitted(const struct run *w)
{
	return w->next_emit;
}

const struct cut_plan *run_plan(const struct run *w)
{
	return &w->plan;
}

const struct pipe_budget *run_budget(const struct run *w)
{
	return &w->budget;
}

const struct dataset *run_dataset(const struct run *w)
{
	return w->dataset;
}

const struct view *run_view(const struct run *w)
{
	return &w->view;
}

bool run_classes(const struct run *w, uint64_t *ret_ground, uint64_t *ret_other)
{
	*ret_ground = w->ground;
	*ret_other = w->other;
	return w->classes_exact;
}

uint64_t run_cropped(const struct run *w)
{
	return w->cropped;
}

bool run_unclassified(const struct run *w)
{
	return w->unclassified;
}

bool run_unweighted(const struct run *w)
{
	return w->unweighted;
}

uint64_t run_grid_points(const struct run *w)
{
	return w->grid_total;
}

void run_progress(const struct run *w, uint64_t *ret_points, uint64_t *ret_total, uint64_t *ret_domains,
		  uint64_t *ret_domains_total)
{
	*ret_points = w->simplify.working          ? run_simplify_done(w, w->select.total) :
		      run_selecting(w)             ? atomic_load(&w->select.judged) :
		      w->points > w->points_before ? w->points :
						     w->points_before;
	*ret_total = run_selecting(w) ? w->select.total : w->grid_total;
	*ret_domains = w->next_emit;
	*ret_domains_total = w->plan_n;
}

void run_seconds(const struct run *w, double *ret_plan, double *ret_domains)
{
	*ret_plan = w->started_ns ? (double)(w->started_ns - w->opened_ns) / 1e9 : 0;
	*ret_domains = w->started_ns ? clock_since(w->started_ns) : 0;
}

uint64_t run_first_ns(const struct run *w)
{
	return w->first_ns;
}
