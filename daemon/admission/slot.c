/*
 * Slots: which job, stream or plan runs next.
 *
 * The model: whoever wants to run over a mesh seeks a slot, and is called when it is granted. Next is who has the highest
 * priority; of those, whose user has the fewest runs at work; then whose user was served least; then who came first. One user has
 * at most half of the slots, and gets a further one only where the memory left carries two runs of others: so there is a slot for
 * somebody else. Where there is none all the same, a run of the user who has most of them yields: its finished domains are in the
 * store, and it begins again later.
 *
 * What does not fit now waits. A seeker whose grid needs more than most is passed by those that fit, but only PASSES times; then
 * nobody gets a slot before it. One grant in sixteen goes by priority from the lowest, so that nobody waits for ever.
 *
 * A run that finds out how much it needs, and that this is not there now, gives its slot back and seeks again (run_retreat):
 * nobody waits for memory with a slot in hand.
 */
#include <stdio.h>

#include "admission_priv.h"
#include "parse.h"
#include "pipe.h"

enum { PASSES = 8, LOWER_TURN = 16, OTHERS = 2 };

/* ---- the list ---- */

void slot_seek(struct admission *a, struct slot *p, uint64_t need)
{
	struct slot **at;

	THREAD_LOOP_ONLY();
	if (p->seeks)
		return;
	/* Whoever comes back keeps its turn. */
	if (!p->number)
		p->number = ++a->last_slot;
	p->seeks = true;
	p->need = need;
	p->wait = SLOT_TURN;
	p->held = 0;
	p->service = 0;
	for (at = &a->slots; *at && (*at)->number < p->number; at = &(*at)->next)
		;
	p->next = *at;
	*at = p;
	a->nslots++;
}

void slot_leave(struct admission *a, struct slot *p)
{
	struct slot **at;

	THREAD_LOOP_ONLY();
	if (!p->seeks)
		return;
	for (at = &a->slots; *at != p; at = &(*at)->next)
		;
	*at = p->next;
	p->seeks = false;
	a->nslots--;
}

/* ---- the order ---- */

static unsigned rank_order(const struct slot *p, bool lowest)
{
	static const unsigned order[] = {[SCHED_RANK_HIGH] = 0, [SCHED_RANK_NORMAL] = 1, [SCHED_RANK_LOW] = 2};

	return lowest ? 2 - order[p->owner.rank] : order[p->owner.rank];
}

static bool before(const struct slot *a, const struct slot *b, bool lowest)
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

/* What users have now; asked once for all seekers of a user. */
static void look_at_users(struct admission *a)
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

static struct slot *next_of(struct admission *a)
{
	bool lowest = a->grants % LOWER_TURN == LOWER_TURN - 1;
	struct slot *p, *best = NULL;

	for (p = a->slots; p; p = p->next)
		if (!p->skip && (!best || before(p, best, lowest)))
			best = p;
	return best;
}

/* ---- room ---- */

static enum slot_wait room_for(struct admission *a, struct slot *p)
{
	struct admission_tally t = admission_tally(a, p->owner.uid);
	uint64_t free = admission_domain_memory(a), share = admission_share(a), must = t.largest, keep = 0;
	unsigned own;

	must = must > p->need ? must : p->need;
	must = must > admission_least() ? must : admission_least();
	/* What a push and a job need must not be held by readers who do not read. */
	if (p->reader && t.runs != t.running)
		keep = GRID_STAGE_MIN + pipe_ingest_bytes() + share;
	p->keeps = keep > 0;
	p->lacks = must + share + keep;
	p->free = free;
	/* Streams that wait for whoever reads them hold memory, but do no work: they count against other streams. */
	if (admission_user_room(a, &p->owner, NULL) < share + must && admission_user_held(a, p->owner.uid, NULL)) {
		p->lacks = share + must;
		p->free = admission_user_room(a, &p->owner, NULL);
		return SLOT_SHARE;
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
	/* The only one finds out itself whether it fits. */
	return free < must + share + keep && (t.runs || admission_staged(a)) ? SLOT_MEMORY : SLOT_READY;
}

/* All that cannot have what this one cannot: of its user, or all streams, for which more is kept free. */
static void skip_like(struct admission *a, const struct slot *like)
{
	for (struct slot *p = a->slots; p; p = p->next)
		if (p->reader == like->reader &&
		    (p->owner.uid == like->owner.uid || (like->wait != SLOT_USER && like->wait != SLOT_SHARE))) {
			p->skip = true;
			p->wait = like->wait;
			p->lacks = like->lacks;
			p->free = like->free;
		}
}

static void grant(struct admission *a, struct slot *p)
{
	struct slot *q;

	for (q = a->slots; q; q = q->next)
		q->passed += q->skip && q->wait == SLOT_MEMORY;
	slot_leave(a, p);
	p->passed = 0;
	a->grants++;
	p->granted(p);
}

/* ---- yielding ---- */

/* Of the user with the most runs, the run that loses least. */
static void make_way(struct admission *a)
{
	struct admission_run *best = NULL;
	uint64_t points = 0;
	unsigned most = 2;

	for (struct admission_run *r = a->runs; r; r = r->next) {
		struct admission_view view = r->calls->view(r);
		unsigned held;

		if (view.yields)
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

unsigned slots_sought(const struct admission *a)
{
	return a->nslots;
}

void slots_settle(struct admission *a)
{
	struct slot *p;

	THREAD_LOOP_ONLY();
	if (!a->slots || a->granting || a->core->stopping)
		return;
	a->granting = true;
	for (p = a->slots; p; p = p->next)
		p->skip = false;
	look_at_users(a);
	while ((p = next_of(a))) {
		p->wait = room_for(a, p);
		if (p->wait == SLOT_READY) {
			grant(a, p);
			look_at_users(a);
		} else if (p->wait == SLOT_USER || p->wait == SLOT_SHARE || (p->wait == SLOT_MEMORY && p->keeps)) {
			skip_like(a, p);
		} else if (p->wait == SLOT_MEMORY && p->need > admission_least() && p->passed < PASSES) {
			p->skip = true;
		} else {
			if (!p->held)
				make_way(a);
			break;
		}
	}
	a->granting = false;
}

/* ---- what others ask ---- */

unsigned slot_position(const struct admission *a, const struct slot *p)
{
	unsigned n = 1;

	if (!p->seeks)
		return 0;
	for (const struct slot *q = a->slots; q; q = q->next)
		n += q != p && before(q, p, false);
	return n;
}

char *slot_text(const struct admission *a, const struct slot *p, char *buf, size_t size)
{
	unsigned n = slot_position(a, p);
	char lacks[32], free[32];

	if (p->wait == SLOT_MEMORY)
		snprintf(buf, size, "memory: needs %s, %s are free", parse_size_text(p->lacks, lacks),
			 parse_size_text(p->free, free));
	else if (p->wait == SLOT_SHARE)
		snprintf(buf, size, "this user's share of the memory: needs %s, %s are free", parse_size_text(p->lacks, lacks),
			 parse_size_text(p->free, free));
	else if (n > 1)
		snprintf(buf, size, "its turn: %u before it", n - 1);
	else if (p->wait == SLOT_USER)
		snprintf(buf, size, "its turn: as many of this user's are at work as one user may have");
	else
		snprintf(buf, size, "its turn: it is next");
	return buf;
}
