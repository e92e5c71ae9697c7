/*
 * Places: which job, stream or plan is next to be at work.
 *
 * The model: who wants to walk over a mesh seeks a place, and is told when it has one (granted). Next is who has the
 * highest priority; of those, whose user has the fewest walks at work; then whose user was served least; then who
 * came first. One user has at most half of the places, and may only have a further one where the memory left carries
 * two walks of others: so there is a place for somebody else. Where there is none all the same, a walk of the user
 * who has most of them gives way: a job, whose finished domains are in the store, begins again later.
 *
 * What does not fit now waits. A seeker whose grid needs more than most is passed by those that fit, but only
 * PASSES times; then nobody gets a place before it. One grant in sixteen goes by priority from the lowest, so that
 * nobody waits for ever.
 *
 * A walk that finds out how much it needs, and that this is not there now, gives its place back and seeks again
 * (walk_retreat): nobody waits for memory with a place in hand.
 */
#include <stdio.h>

#include "job_priv.h"
#include "parse.h"
#include "walk_priv.h"

enum { PASSES = 8, LOWER_TURN = 16, OTHERS = 2 };

/* ---- the list ---- */

void place_seek(struct jobs *j, struct place *p, uint64_t need)
{
	struct place **at;

	if (p->seeks)
		return;
	/* Whoever comes back keeps its turn. */
	if (!p->number)
		p->number = ++j->last_place;
	p->seeks = true;
	p->need = need;
	p->wait = PLACE_TURN;
	p->held = 0;
	p->service = 0;
	for (at = &j->places; *at && (*at)->number < p->number; at = &(*at)->next)
		;
	p->next = *at;
	*at = p;
	j->nplaces++;
}

void place_leave(struct jobs *j, struct place *p)
{
	struct place **at;

	if (!p->seeks)
		return;
	for (at = &j->places; *at != p; at = &(*at)->next)
		;
	*at = p->next;
	p->seeks = false;
	j->nplaces--;
}

/* ---- the order ---- */

static unsigned rank_order(const struct place *p, bool lowest)
{
	static const unsigned order[] = {[SCHED_RANK_HIGH] = 0, [SCHED_RANK_NORMAL] = 1, [SCHED_RANK_LOW] = 2};

	return lowest ? 2 - order[p->owner.rank] : order[p->owner.rank];
}

static bool before(const struct place *a, const struct place *b, bool lowest)
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
static void look_at_users(struct jobs *j)
{
	struct place *p, *first;

	for (p = j->places; p; p = p->next)
		p->seen = false;
	for (first = j->places; first; first = first->next) {
		unsigned held;
		int64_t service;

		if (first->seen)
			continue;
		held = admit_tally(j, first->owner.uid).own_running;
		service = sched_service(j->p.sched, first->owner.uid);
		for (p = first; p; p = p->next) {
			if (p->owner.uid != first->owner.uid)
				continue;
			p->seen = true;
			p->held = held;
			p->service = service;
		}
	}
}

static struct place *next_of(struct jobs *j)
{
	bool lowest = j->grants % LOWER_TURN == LOWER_TURN - 1;
	struct place *p, *best = NULL;

	for (p = j->places; p; p = p->next)
		if (!p->skip && (!best || before(p, best, lowest)))
			best = p;
	return best;
}

/* ---- room ---- */

static enum place_wait room_for(struct jobs *j, struct place *p)
{
	struct admit_tally t = admit_tally(j, p->owner.uid);
	uint64_t free = jobs_domain_memory(j), share = admit_share(j), must = t.largest, keep = 0;
	unsigned own;

	must = must > p->need ? must : p->need;
	must = must > admit_least() ? must : admit_least();
	/* What a push and a job need must not be held by readers who do not read. */
	if (p->reader && t.walks != t.running)
		keep = GRID_STAGE_MIN + pipe_ingest_bytes() + share;
	p->keeps = keep > 0;
	p->lacks = must + share + keep;
	p->free = free;
	/* Streams that wait for whoever reads them hold memory, but do no work: they count against other streams. */
	if (limit_room(j, &p->owner, NULL) < share + must && !limit_alone(j, &p->owner, NULL)) {
		p->lacks = share + must;
		p->free = limit_room(j, &p->owner, NULL);
		return PLACE_SHARE;
	}
	own = p->reader ? t.own : t.own_running;
	if (own) {
		if (t.own_running >= j->walks_max / 2 || t.running >= j->walks_max)
			return PLACE_USER;
		if (free < must + (1 + OTHERS) * share + keep)
			return PLACE_USER;
	} else if (t.running >= 2 * j->walks_max) {
		return PLACE_FULL;
	}
	/* The only one finds out itself whether it fits. */
	return free < must + share + keep && (t.walks || jobs_staged(j)) ? PLACE_MEMORY : PLACE_READY;
}

/* All that cannot have what this one cannot: of its user, or all streams, for which more is kept free. */
static void skip_like(struct jobs *j, const struct place *like)
{
	for (struct place *p = j->places; p; p = p->next)
		if (p->reader == like->reader &&
		    (p->owner.uid == like->owner.uid || (like->wait != PLACE_USER && like->wait != PLACE_SHARE))) {
			p->skip = true;
			p->wait = like->wait;
			p->lacks = like->lacks;
			p->free = like->free;
		}
}

static void grant(struct jobs *j, struct place *p)
{
	struct place *q;

	for (q = j->places; q; q = q->next)
		q->passed += q->skip && q->wait == PLACE_MEMORY;
	place_leave(j, p);
	p->passed = 0;
	j->grants++;
	p->granted(p);
}

/* ---- giving way ---- */

/* Of the user with the most walks, the job that loses least. Not one that streams follow: they would wait for it
 * with places in hand. */
static void make_way(struct jobs *j)
{
	struct walk *best = NULL;
	unsigned most = 2;

	for (struct job *job = j->jobs; job; job = job->next) {
		struct walk *w = job->walk;
		unsigned held;

		if (!w || job->walk_ended)
			continue;
		if (w->giving)
			return;
		if (job->fetches || !walk_can_give_way(w))
			continue;
		held = admit_tally(j, w->owner.uid).own_running;
		if (held < most || (best && held == most && best->points <= w->points))
			continue;
		best = w;
		most = held;
	}
	if (best)
		walk_give_way(best);
}

void places_settle(struct jobs *j)
{
	struct place *p;

	if (!j->places || j->placing || j->parking)
		return;
	j->placing = true;
	for (p = j->places; p; p = p->next)
		p->skip = false;
	look_at_users(j);
	while ((p = next_of(j))) {
		p->wait = room_for(j, p);
		if (p->wait == PLACE_READY) {
			grant(j, p);
			look_at_users(j);
		} else if (p->wait == PLACE_USER || p->wait == PLACE_SHARE || (p->wait == PLACE_MEMORY && p->keeps)) {
			skip_like(j, p);
		} else if (p->wait == PLACE_MEMORY && p->need > admit_least() && p->passed < PASSES) {
			p->skip = true;
		} else {
			if (!p->held)
				make_way(j);
			break;
		}
	}
	j->placing = false;
}

/* ---- what others ask ---- */

unsigned place_position(const struct jobs *j, const struct place *p)
{
	unsigned n = 1;

	if (!p->seeks)
		return 0;
	for (const struct place *q = j->places; q; q = q->next)
		n += q != p && before(q, p, false);
	return n;
}

char *place_text(const struct jobs *j, const struct place *p, char *buf, size_t size)
{
	unsigned n = place_position(j, p);
	char lacks[32], free[32];

	if (p->wait == PLACE_MEMORY)
		snprintf(buf, size, "memory: needs %s, %s are free", parse_size_text(p->lacks, lacks),
			 parse_size_text(p->free, free));
	else if (p->wait == PLACE_SHARE)
		snprintf(buf, size, "this user's share of the memory: needs %s, %s are free", parse_size_text(p->lacks, lacks),
			 parse_size_text(p->free, free));
	else if (n > 1)
		snprintf(buf, size, "its turn: %u before it", n - 1);
	else if (p->wait == PLACE_USER)
		snprintf(buf, size, "its turn: as many of this user's are at work as one user may have");
	else
		snprintf(buf, size, "its turn: it is next");
	return buf;
}
