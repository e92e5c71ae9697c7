/*
 * Slots: which job, stream or plan runs next.
 *
 * The model: a job, stream or plan requests a slot before it runs over a mesh, and is called when it is granted. The order of
 * requests: the highest priority; then the user with the fewest running runs; then the user who was served least; then the
 * oldest. A user has at most half of the slots, and gets a further one only if the memory left suffices for two runs of others.
 * So there is usually a slot for another user. If there is none, a run of the user with the most runs yields: its finished
 * domains are in the store, and it starts again later.
 *
 * A request that does not fit now waits. One whose grid needs more than most is passed by requests that fit, but only PASSES
 * times; then nobody gets a slot before it. One grant in LOWEST_EVERY goes by priority from the lowest, so that no request waits
 * for ever.
 *
 * A run that finds out that it needs more memory than is free releases its slot and requests another (run_requeue). So nobody
 * waits for memory while holding a slot.
 */
#include <assert.h>
#include <stdio.h>

#include "admission_priv.h"
#include "grid_stage.h"
#include "parse.h"
#include "pipe.h"

enum {
	PASSES = 8,
	LOWEST_EVERY = 16,
	OTHERS = 2, /* runs of other users, for whose shares memory is left */
};

/* ---- the list of requests ---- */

void slot_request(struct admission *a, struct slot *p, uint64_t need)
{
	struct slot **at;

	THREAD_LOOP_ONLY();
	if (p->requested)
		return;
	/* A run that starts again keeps its age. */
	if (!p->number)
		p->number = ++a->last_slot;
	p->requested = true;
	p->need = need;
	p->wait = SLOT_QUEUED;
	p->held = 0;
	p->service = 0;
	for (at = &a->slots; *at && (*at)->number < p->number; at = &(*at)->next)
		;
	p->next = *at;
	*at = p;
	a->nslots++;
}

void slot_withdraw(struct admission *a, struct slot *p)
{
	struct slot **at;

	THREAD_LOOP_ONLY();
	if (!p->requested)
		return;
	for (at = &a->slots; *at != p; at = &(*at)->next)
		;
	*at = p->next;
	p->requested = false;
	a->nslots--;
}

/* ---- the order ---- */

static unsigned rank_order(const struct slot *p, bool lowest)
{
	static const unsigned order[] = {[SCHED_RANK_HIGH] = 0, [SCHED_RANK_NORMAL] = 1, [SCHED_RANK_LOW] = 2};

	return lowest ? 2 - order[p->owner.rank] : order[p->owner.rank];
}

static bool is_before(const struct slot *a, const struct slot *b, bool lowest)
{
	unsigned ra = rank_order(a, lowest), rb = rank_order(b, lowest);

	if (ra != rb)
		return ra < rb;
	if (a->held != b->held)
		return a->held < b->held;
	if (a->service != b->service)
		return a->service < b->service;
	return a->number < b->number;
}

/* Reads the state of each user once, for all of its requests. */
static void update_users(struct admission *a)
{
	struct slot *p, *first;

	for (p = a->slots; p; p = p->next)
		p->seen = false;
	for (first = a->slots; first; first = first->next) {
		unsigned held;
		int64_t service;

		if (first->seen)
			continue;
		held = admission_tally(a, first->owner.uid).own_running;
		service = sched_service(a->core->p.sched, first->owner.uid);
		for (p = first; p; p = p->next) {
			if (p->owner.uid != first->owner.uid)
				continue;
			p->seen = true;
			p->held = held;
			p->service = service;
		}
	}
}

static struct slot *next_request(struct admission *a)
{
	bool lowest = a->grants % LOWEST_EVERY == LOWEST_EVERY - 1;
	struct slot *p, *best = NULL;

	for (p = a->slots; p; p = p->next)
		if (!p->skip && (!best || is_before(p, best, lowest)))
			best = p;
	return best;
}

/* ---- what fits ---- */

static enum slot_wait check_fit(struct admission *a, struct slot *p)
{
	struct admission_tally t = admission_tally(a, p->owner.uid);
	uint64_t free = admission_domain_memory(a), share = admission_share(a), must = t.largest, keep = 0;
	unsigned own;

	must = must > p->need ? must : p->need;
	must = must > admission_plan_min() ? must : admission_plan_min();
	/* Readers that do not read must not hold the memory that a push and a job need. */
	if (p->reader && t.runs != t.running)
		keep = GRID_STAGE_MIN + pipe_ingest_bytes() + share;
	p->keeps = keep > 0;
	p->needed = must + share + keep;
	p->free = free;
	/* A stream that waits for its reader holds memory but does no work. It counts against other streams only. */
	if (admission_user_available(a, &p->owner, NULL) < share + must && admission_user_held(a, p->owner.uid, NULL)) {
		p->needed = share + must;
		p->free = admission_user_available(a, &p->owner, NULL);
		return SLOT_USER_MEMORY;
	}
	own = p->reader ? t.own : t.own_running;
	if (own) {
		if (t.own_running >= a->runs_max / 2 || t.running >= a->runs_max)
			return SLOT_USER;
		if (free < must + (1 + OTHERS) * share + keep)
			return SLOT_USER;
	} else if (t.running >= 2 * a->runs_max) {
		return SLOT_FULL;
	}
	/* A run that is the only one finds out itself whether it fits. */
	return free < must + share + keep && (t.runs || admission_staged_bytes(a)) ? SLOT_MEMORY : SLOT_READY;
}

/* Skips all requests that fail for the same reason: those of the user, or all streams, since more memory is kept free beside
 * them. */
static void skip_like(struct admission *a, const struct slot *like)
{
	for (struct slot *p = a->slots; p; p = p->next)
		if (p->reader == like->reader &&
		    (p->owner.uid == like->owner.uid || (like->wait != SLOT_USER && like->wait != SLOT_USER_MEMORY))) {
			p->skip = true;
			p->wait = like->wait;
			p->needed = like->needed;
			p->free = like->free;
		}
}

static void grant_slot(struct admission *a, struct slot *p)
{
	struct slot *q;

	for (q = a->slots; q; q = q->next)
		q->passed += q->skip && q->wait == SLOT_MEMORY;
	assert(p->requested && p->wait == SLOT_READY);
	slot_withdraw(a, p);
	p->passed = 0;
	a->grants++;
	p->granted(p);
}

/* ---- yielding ---- */

/* Lets a run of the user with the most runs yield: the one with the fewest points emitted. */
static void yield_one(struct admission *a)
{
	struct admission_run *best = NULL;
	uint64_t points = 0;
	unsigned most = 2;

	for (struct admission_run *r = a->runs; r; r = r->next) {
		struct admission_view view = r->calls->view(r);
		unsigned held;

		if (view.yielding)
			return;
		if (!view.can_yield)
			continue;
		held = admission_tally(a, view.uid).own_running;
		if (held < most || (best && held == most && points <= view.points))
			continue;
		best = r;
		points = view.points;
		most = held;
	}
	if (best)
		best->calls->yield(best);
}

unsigned slots_requested(const struct admission *a)
{
	return a->nslots;
}

void slots_grant(struct admission *a)
{
	struct slot *p;

	THREAD_LOOP_ONLY();
	if (!a->slots || a->granting || a->core->stopping)
		return;
	a->granting = true;
	for (p = a->slots; p; p = p->next)
		p->skip = false;
	update_users(a);
	while ((p = next_request(a))) {
		p->wait = check_fit(a, p);
		if (p->wait == SLOT_READY) {
			grant_slot(a, p);
			update_users(a);
		} else if (p->wait == SLOT_USER || p->wait == SLOT_USER_MEMORY || (p->wait == SLOT_MEMORY && p->keeps)) {
			skip_like(a, p);
		} else if (p->wait == SLOT_MEMORY && p->need > admission_plan_min() && p->passed < PASSES) {
			p->skip = true;
		} else {
			if (!p->held)
				yield_one(a);
			break;
		}
	}
	a->granting = false;
}

/* ---- reports ---- */

unsigned slot_position(const struct admission *a, const struct slot *p)
{
	unsigned n = 1;

	if (!p->requested)
		return 0;
	for (const struct slot *q = a->slots; q; q = q->next)
		n += q != p && is_before(q, p, false);
	return n;
}

char *slot_wait_text(const struct admission *a, const struct slot *p, char *buf, size_t size)
{
	unsigned n = slot_position(a, p);
	char needed[32], free[32];

	if (p->wait == SLOT_MEMORY)
		snprintf(buf, size, "memory: needs %s, %s are free", parse_size_text(p->needed, needed),
			 parse_size_text(p->free, free));
	else if (p->wait == SLOT_USER_MEMORY)
		snprintf(buf, size, "this user's share of the memory: needs %s, %s are free", parse_size_text(p->needed, needed),
			 parse_size_text(p->free, free));
	else if (n > 1)
		snprintf(buf, size, "its turn: %u before it", n - 1);
	else if (p->wait == SLOT_USER)
		snprintf(buf, size, "its turn: as many of this user's are at work as one user may have");
	else
		snprintf(buf, size, "its turn: it is next");
	return buf;
}
