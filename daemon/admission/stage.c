/*
 * Stages of pushes: which push gets the next one.
 *
 * The order: the user with the fewest stages; then the user who was served least; then the oldest push. A push that does not fit
 * its user's share is skipped.
 */
#include <assert.h>

#include "admission_priv.h"

void admission_add_stage(struct admission *a, struct admission_stage *s)
{
	THREAD_LOOP_ONLY();
	s->next = a->stages;
	a->stages = s;
}

void admission_remove_stage(struct admission *a, struct admission_stage *s)
{
	struct admission_stage **at;

	THREAD_LOOP_ONLY();
	for (at = &a->stages; *at != s; at = &(*at)->next)
		;
	*at = s->next;
	if (a->next_stage == s)
		a->next_stage = NULL;
}

uint64_t admission_staged_bytes(const struct admission *a)
{
	uint64_t bytes = a->rewrite_bytes;

	for (const struct admission_stage *s = a->stages; s; s = s->next)
		bytes += s->calls->bytes(s);
	return bytes;
}

uint64_t admission_stage_share(const struct admission *a)
{
	return a->stage_share;
}

void admission_add_rewrite(struct admission *a, int64_t bytes)
{
	THREAD_LOOP_ONLY();
	assert(bytes >= 0 || a->rewrite_bytes >= (uint64_t)-bytes);
	a->rewrite_bytes += (uint64_t)bytes;
}

uint64_t admission_stage_available(struct admission *a, uint64_t least)
{
	uint64_t left = admission_domain_memory(a), head = 2 * admission_domain_largest(a);
	/* A stage that needs more than its share, for a line set, may have that. */
	uint64_t share = a->stage_share > least ? a->stage_share : least;

	THREAD_LOOP_ONLY();
	/* A job must be able to finish beside the stage, one domain at a time. */
	head = head > admission_plan_min() ? head : admission_plan_min();
	left = left > head ? left - head : 0;
	left = left < share ? left : share;
	return left >= least ? left : 0;
}

static unsigned count_stages(const struct admission *a, uint32_t uid)
{
	unsigned n = 0;

	for (const struct admission_stage *s = a->stages; s; s = s->next)
		n += s->uid == uid && s->calls->held(s);
	return n;
}

static struct admission_stage *find_next_stage(struct admission *a)
{
	struct admission_stage *s, *best = NULL;
	unsigned have = 0;
	int64_t service = 0;

	for (s = a->stages; s; s = s->next) {
		int64_t served;
		unsigned n;

		if (!s->calls->wants(s) || !s->calls->fits(s))
			continue;
		n = count_stages(a, s->uid);
		served = sched_service(a->core->p.sched, s->uid);
		/* The list is by age, the youngest first, so of equals the last is the oldest. */
		if (best && (n > have || (n == have && served > service)))
			continue;
		best = s;
		have = n;
		service = served;
	}
	return best;
}

void admission_grant_stages(struct admission *a)
{
	THREAD_LOOP_ONLY();
	do {
		a->next_stage = find_next_stage(a);
		if (a->next_stage)
			a->next_stage->calls->retry(a->next_stage);
	} while (a->next_stage && !a->next_stage->calls->wants(a->next_stage));
}

bool admission_stage_is_awaited(const struct admission *a)
{
	return a->next_stage != NULL;
}

bool admission_stage_other_is_next(const struct admission *a, const struct admission_stage *s)
{
	return a->next_stage && a->next_stage != s;
}

bool admission_stage_other_needs(const struct admission *a, uint32_t uid)
{
	return a->next_stage && a->next_stage->uid != uid && !count_stages(a, a->next_stage->uid);
}
