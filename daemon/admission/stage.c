/*
 * Stages of pushes: who gets the next one.
 *
 * Next is the push whose user has the fewest stages; then whose user was served least; then the oldest. What does not fit its
 * user's share is passed over.
 */
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
	if (a->turn == s)
		a->turn = NULL;
}

uint64_t admission_staged(const struct admission *a)
{
	uint64_t bytes = a->rewriting;

	for (const struct admission_stage *s = a->stages; s; s = s->next)
		bytes += s->calls->bytes(s);
	return bytes;
}

uint64_t admission_stage_share(const struct admission *a)
{
	return a->stage_share;
}

void admission_rewriting(struct admission *a, int64_t bytes)
{
	a->rewriting += (uint64_t)bytes;
}

uint64_t admission_stage_room(struct admission *a, uint64_t least)
{
	uint64_t left = admission_domain_memory(a), head = 2 * admission_domain_largest(a);

	/* A job that runs, or comes, must be able to finish beside it, one domain at a time. */
	head = head > admission_least() ? head : admission_least();
	left = left > head ? left - head : 0;
	left = left < a->stage_share ? left : a->stage_share;
	return left >= least ? left : 0;
}

static unsigned stages_of(const struct admission *a, uint32_t uid)
{
	unsigned n = 0;

	for (const struct admission_stage *s = a->stages; s; s = s->next)
		n += s->uid == uid && s->calls->held(s);
	return n;
}

static struct admission_stage *stage_next(struct admission *a)
{
	struct admission_stage *s, *best = NULL;
	unsigned have = 0;
	int64_t service = 0;

	for (s = a->stages; s; s = s->next) {
		int64_t served;
		unsigned n;

		if (!s->calls->wants(s) || !s->calls->fits(s))
			continue;
		n = stages_of(a, s->uid);
		served = sched_service(a->core->p.sched, s->uid);
		/* The list is by age, the youngest first. */
		if (best && (n > have || (n == have && served > service)))
			continue;
		best = s;
		have = n;
		service = served;
	}
	return best;
}

void admission_stages(struct admission *a)
{
	THREAD_LOOP_ONLY();
	do {
		a->turn = stage_next(a);
		if (a->turn)
			a->turn->calls->retry(a->turn);
	} while (a->turn && !a->turn->calls->wants(a->turn));
}

bool admission_stage_waits(const struct admission *a)
{
	return a->turn != NULL;
}

bool admission_stage_other(const struct admission *a, const struct admission_stage *s)
{
	return a->turn && a->turn != s;
}

bool admission_stage_awaited(const struct admission *a, uint32_t uid)
{
	return a->turn && a->turn->uid != uid && !stages_of(a, a->turn->uid);
}
