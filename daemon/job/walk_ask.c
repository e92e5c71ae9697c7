/* What others ask of a walk: its plan, its sums, how far it is. Loop. */
#include "clock.h"
#include "job_priv.h"
#include "walk_priv.h"

size_t walk_domain_bytes(const struct walk *w)
{
	if (w->state == WALK_SELECTING)
		return w->select.bytes;
	return w->state == WALK_PLANNING || w->state == WALK_RUNNING ? w->budget.domain_bytes : 0;
}

const struct pipe_totals *walk_totals(const struct walk *w)
{
	return &w->totals;
}

uint64_t walk_reused(const struct walk *w)
{
	if (w->plan_only)
		return w->reusable;
	return w->made < w->plan_n ? w->plan_n - w->made : 0;
}

size_t walk_emitted(const struct walk *w)
{
	return w->next_emit;
}

const struct cut_plan *walk_plan(const struct walk *w)
{
	return &w->plan;
}

const struct pipe_budget *walk_budget(const struct walk *w)
{
	return &w->budget;
}

const struct view *walk_view(const struct walk *w)
{
	return &w->view;
}

bool walk_classes(const struct walk *w, uint64_t *ret_ground, uint64_t *ret_other)
{
	*ret_ground = w->ground;
	*ret_other = w->other;
	return w->classes_exact;
}

bool walk_unclassified(const struct walk *w)
{
	return w->unclassified;
}

uint64_t walk_grid_points(const struct walk *w)
{
	return w->grid_total;
}

void walk_progress(const struct walk *w, uint64_t *ret_points, uint64_t *ret_total, uint64_t *ret_domains,
		   uint64_t *ret_domains_total)
{
	*ret_points = walk_selecting(w)            ? atomic_load(&w->select.judged) :
		      w->points > w->points_before ? w->points :
						     w->points_before;
	*ret_total = walk_selecting(w) ? w->select.total : w->grid_total;
	*ret_domains = w->next_emit;
	*ret_domains_total = w->plan_n;
}

void walk_seconds(const struct walk *w, double *ret_plan, double *ret_domains)
{
	*ret_plan = w->started_ns ? (double)(w->started_ns - w->opened_ns) / 1e9 : 0;
	*ret_domains = w->started_ns ? clock_since(w->started_ns) : 0;
}

uint64_t walk_first_ns(const struct walk *w)
{
	return w->first_ns;
}

bool walk_opens(const struct walk *w, const struct dataset *d)
{
	return w->dataset == d && (w->state == WALK_NEW || w->state == WALK_OPENING);
}
