/* What admission asks of a run (admission.h). */
#include "run_priv.h"

static struct run *run_of(const struct admission_run *r)
{
	return (struct run *)((char *)r - offsetof(struct run, admission));
}

/* Bytes of its largest task: a domain or the selection. 0: not known yet. */
static uint64_t task_bytes(const struct run *w)
{
	if (w->state == RUN_SELECTING)
		return w->select.bytes;
	if (w->state == RUN_PLANNING || w->state == RUN_RUNNING)
		return w->budget.domain_bytes;
	/* Without a plan: what its slot was granted for. */
	return w->state < RUN_PLANNING ? w->slot->need : 0;
}

static struct admission_view run_admission_view(const struct admission_run *r)
{
	const struct run *w = run_of(r);

	return (struct admission_view){
		.uid = w->owner.uid,
		.has_slot = w->has_slot,
		.stalled = run_stalled(w),
		.yielding = w->yielding,
		/* A run that follows this one would wait for it while holding a slot. */
		.can_yield = run_can_yield(w) && !(w->calls->followed && w->calls->followed(w->ctx)),
		.task_bytes = task_bytes(w),
		.points = w->points,
	};
}

/* What the run has or may take without asking: its share, and the memory of its plan or of two domains (the second one for a
 * split). */
static uint64_t claim(const struct run *w)
{
	uint64_t least = pipe_budget_min(w->grid && w->state > RUN_OPENING && w->state != RUN_SELECTING ? w->grid : NULL);
	uint64_t need = w->slot->need > least ? w->slot->need : least;

	if (w->state >= RUN_PLANNING)
		need = 2 * w->budget.domain_bytes;
	return admission_share(w->runs->admission) + w->charged + need;
}

static uint64_t held(const struct admission_run *r)
{
	const struct run *w = run_of(r);
	uint64_t bytes = admission_share(w->runs->admission) + w->charged, claimed = claim(w);
	const struct run_domain *d;

	if (w->state == RUN_SELECTING)
		bytes += w->select.bytes;
	for (d = w->domains; d; d = d->next)
		/* Only the worker knows how much of a domain in the making is mapped. */
		bytes += d->state == DOMAIN_MAKING || d->state == DOMAIN_SPLIT ? w->budget.domain_bytes : d->size;
	if (!w->sums_only)
		bytes += w->arenas.charged; /* of free arenas; the others are those of its domains */
	return bytes > claimed ? bytes : claimed;
}

static bool opens(const struct admission_run *r, const struct dataset *d)
{
	const struct run *w = run_of(r);

	/* A selection opens the line set of its generation once more. */
	return w->dataset == d &&
	       (w->state == RUN_NEW || w->state == RUN_OPENING || w->state == RUN_UNSELECTED || w->state == RUN_SELECTING);
}

static void relieve(struct admission_run *r, bool urgent)
{
	run_relieve(run_of(r), urgent);
}

static void yield(struct admission_run *r)
{
	run_yield(run_of(r));
}

const struct admission_calls run_admission_calls = {
	.view = run_admission_view, .held = held, .opens = opens, .relieve = relieve, .yield = yield};

bool run_may_start(const struct run *w)
{
	uint64_t limit = admission_user_limit(w->runs->admission, &w->owner), each = w->budget.domain_bytes;
	const struct run_domain *d;

	if (limit == UINT64_MAX)
		return true;
	for (d = w->domains; d && d->state != DOMAIN_MAKING && d->state != DOMAIN_SPLIT; d = d->next)
		;
	if (!d)
		return true; /* one domain is part of its claim */
	/* One more domain, and a second one in case it is split. */
	return admission_user_held(w->runs->admission, w->owner.uid, &w->admission) + held(&w->admission) + 2 * each <= limit;
}

struct same_selection {
	const struct run *run;
	bool found;
};

static void compare_selection(struct admission_run *r, void *ctx)
{
	const struct run *w = run_of(r);
	struct same_selection *s = ctx;

	s->found |= w != s->run && w->state == RUN_SELECTING &&
		    (digest_equal(w->select.key, s->run->select.key) || digest_equal(w->select.making, s->run->select.key) ||
		     (view_simplifies(&s->run->view) && digest_equal(w->select.making, s->run->select.base))) &&
		    (w->dataset == s->run->dataset || (!w->dataset->onestep && !s->run->dataset->onestep));
}

bool run_selected_elsewhere(const struct run *w)
{
	struct same_selection s = {.run = w};

	admission_each_run(w->runs->admission, compare_selection, &s);
	return s.found;
}
