/*
 * The share of the memory that one user may have (user-memory). Administrators have no limit.
 *
 * The model: what a user's runs and stages hold is added up when one of them wants more. A run gets a slot, a plan its budget,
 * and a push its stage only within the share; if several domains at once would exceed it, they start one after the other. What
 * exceeds the share even alone is refused with the numbers.
 */
#include "admission_priv.h"
#include "parse.h"

uint64_t admission_user_limit(const struct admission *a, const struct sched_owner *owner)
{
	if (!a->core->p.limits.user.memory || owner->exempt)
		return UINT64_MAX;
	return ledger_total(a->core->p.ledger) / 100 * a->core->p.limits.user.memory;
}

uint64_t admission_user_held(struct admission *a, uint32_t uid, const struct admission_run *except)
{
	const struct admission_stage *s;
	const struct admission_run *r;
	uint64_t bytes = 0;

	THREAD_LOOP_ONLY();
	for (r = a->runs; r; r = r->next) {
		struct admission_view view = r->calls->view(r);

		if (view.has_slot && r != except && view.uid == uid)
			bytes += r->calls->held(r);
	}
	for (s = a->stages; s; s = s->next)
		if (s->uid == uid)
			bytes += s->calls->held(s);
	return bytes;
}

uint64_t admission_user_available(struct admission *a, const struct sched_owner *owner, const struct admission_run *except)
{
	uint64_t limit = admission_user_limit(a, owner), used;

	if (limit == UINT64_MAX)
		return limit;
	used = admission_user_held(a, owner->uid, except) + (except ? admission_share(a) : 0);
	return used < limit ? limit - used : 0;
}

int admission_user_check_size(struct admission *a, const struct sched_owner *owner, uint64_t bytes, const char *what,
			      struct err *err)
{
	uint64_t limit = admission_user_limit(a, owner), total = ledger_total(a->core->p.ledger);
	char need[32], may[32];

	THREAD_LOOP_ONLY();
	if (bytes <= limit)
		return 0;
	err_set(err, ERR_LIMIT, "%s needs %s of memory, and %s are all that one user may have (user-memory, %u%%)", what,
		parse_size_text(bytes, need), parse_size_text(limit, may), a->core->p.limits.user.memory);
	err_add_hint(err, "ask an administrator for user-memory = %llu%%, or for more memory",
		     (unsigned long long)(bytes / (total / 100) + 1));
	return err_add_place(err, ERR_NO_OFFSET, "user-memory");
}

int admission_lacks(struct admission *a, const struct sched_owner *owner, uint64_t least, uint64_t left, const char *what,
		    struct err *err)
{
	int r = admission_check_size(a, least, what, err);

	if (!r)
		r = admission_user_check_size(a, owner, least + admission_share(a), what, err);
	if (r || !admission_is_alone(a))
		return r;
	err_set(err, ERR_LIMIT, "%s needs %llu KiB, %llu KiB are left of the memory", what, (unsigned long long)(least >> 10),
		(unsigned long long)(left >> 10));
	return err_add_hint(err, "remove datasets and jobs that are not needed (acutctl rm), or give acutd more memory");
}
