/*
 * What a push takes of the disk.
 *
 * The model: before its first point is staged, a push is held against what its probes claim: its runs and its segment,
 * both of which lie there until the commit (of a one-step dataset the runs give way as the segment grows). Headers
 * may lie and pipes do not tell, so what was really staged is held against it too, and more is taken in steps. What is
 * taken and not written yet is promised, so that two pushes do not count on the same free bytes. A crop of a one-step
 * mesh reads an unknown part: of such only what was staged counts. All of it counts with who pushes; what will lie there
 * after the commit, with the owner of the dataset too (limit.c). Both have it back when the push ends, however it does:
 * then what it left counts, a new generation with the owner, an interrupted push with who pushed.
 */
#include <assert.h>
#include <stdio.h>

#include "push_priv.h"

enum { TEXT_POINT_BYTES = 24, STEP_LEAST = 1 << 20 };

/* Of so many points in all, while runs and segment lie there. */
static uint64_t bytes_of(const struct push *p, uint64_t points)
{
	uint64_t bytes = datasets_points_bytes(points);

	return p->dataset->onestep ? bytes + (points * 16) / 32 : 2 * bytes;
}

static enum space_kind kind_of(const struct push *p)
{
	return p->dataset->onestep ? SPACE_ONESTEP : SPACE_PENDING;
}

static uint64_t adopted(const struct push *p)
{
	uint64_t points = 0;

	for (size_t i = 0; p->adopt && i < p->adopt->nsources; i++)
		points += p->adopt->sources[i].points;
	return points;
}

static uint64_t beyond(uint64_t want, uint64_t has)
{
	return want > has ? want - has : 0;
}

static int take(struct push *p, uint64_t bytes, uint64_t points, struct err *err)
{
	struct push_space *s = &p->space;
	uint64_t all = atomic_load(&s->taken) + bytes, own = beyond(all, s->own), owed = 0;
	char what[64];
	int r = 0;

	assert(lock_held(LOCK_PUSH_SPACE));
	snprintf(what, sizeof what, "a push of %llu points", (unsigned long long)points);
	/* When it is published it is the owner's: the segment, without the runs. */
	if (s->owner != p->peer.uid) {
		owed = beyond(all / 2, s->owed);
		r = limit_disk_take(p->pushes->core, s->owner, p->peer.admin, owed, what, err);
	}
	if (r)
		return r;
	r = limit_disk_take(p->pushes->core, p->peer.uid, p->peer.admin, own, what, err);
	if (r) {
		limit_disk_give(p->pushes->core, s->owner, owed);
		return r;
	}
	r = space_take(p->pushes->core->space, kind_of(p), bytes, SPACE_MUST, what, err);
	if (r) {
		limit_disk_give(p->pushes->core, p->peer.uid, own);
		limit_disk_give(p->pushes->core, s->owner, owed);
		return r;
	}
	s->own += own;
	s->owed += owed;
	space_add_unwritten(p->pushes->core->space, kind_of(p), (int64_t)bytes);
	s->promised += bytes;
	atomic_store(&s->taken, all);
	return 0;
}

void push_space_claim(struct push *p, const struct pending *q)
{
	p->space.own = datasets_points_bytes(q->points);
	limit_release_and_recount(p->pushes->core, p->peer.uid, -(int64_t)p->space.own, 0, 0);
	datasets_count(p->pushes->datasets);
}

void push_space_unclaim(struct push *p)
{
	limit_release_and_recount(p->pushes->core, p->peer.uid, (int64_t)p->space.own, 0, 0);
	p->space.own = 0;
}

int push_space_plan(struct push *p, struct err *err)
{
	uint64_t points = adopted(p), need;
	int r = 0;

	if (p->has_crop)
		return 0;
	for (size_t i = 0; i < p->nprobes; i++) {
		const struct push_probed *probe = &p->probes[i];
		uint64_t claimed = probe->claimed ? probe->claimed : probe->id.size / TEXT_POINT_BYTES;

		if (!probe->why && __builtin_add_overflow(points, claimed, &points))
			points = UINT64_MAX / 64;
	}
	need = bytes_of(p, points);
	lock_take(&p->space.lock);
	if (need > atomic_load(&p->space.taken))
		r = take(p, need - atomic_load(&p->space.taken), points, err);
	lock_give(&p->space.lock);
	return r;
}

bool push_space_staged(struct push *p, uint64_t points)
{
	uint64_t all = atomic_load(&p->space.staged) + points, need = bytes_of(p, all), taken;
	struct err err = ERR_INIT;

	if (need <= atomic_load(&p->space.taken))
		return true;
	lock_take(&p->space.lock);
	taken = atomic_load(&p->space.taken);
	if (need > taken && !p->space.why.code) {
		uint64_t step = taken / 16 > STEP_LEAST ? taken / 16 : STEP_LEAST;

		/* In steps, unless only what is needed is left. */
		if (take(p, need - taken + step, all, &err))
			take(p, need - taken, all, &p->space.why);
	}
	lock_give(&p->space.lock);
	return !p->space.why.code;
}

void push_space_adopted(struct push *p)
{
	atomic_fetch_add(&p->space.staged, adopted(p));
}

const struct err *push_space_full(const struct push *p)
{
	return p->space.why.code ? &p->space.why : NULL;
}

void push_space_tick(struct push *p)
{
	uint64_t points = atomic_load(&p->space.staged) + atomic_load(&p->progress), written = points * 16, open;
	struct push_space *s = &p->space;

	/* What is in memory is not written. */
	written = written > p->stage_bytes ? written - p->stage_bytes : 0;
	/* A worker that holds it may be waiting for the file system; the next tick comes soon. */
	if (!lock_try(&s->lock))
		return;
	open = atomic_load(&s->taken);
	open = open > written ? open - written : 0;
	if (open < s->promised) {
		space_add_unwritten(p->pushes->core->space, kind_of(p), -(int64_t)(s->promised - open));
		s->promised = open;
	}
	lock_give(&s->lock);
}

void push_space_end(struct push *p)
{
	struct push_space *s = &p->space;

	space_add_unwritten(p->pushes->core->space, kind_of(p), -(int64_t)s->promised);
	space_give(p->pushes->core->space, kind_of(p), atomic_load(&s->taken));
	limit_release_and_recount(p->pushes->core, p->peer.uid, (int64_t)s->own, s->owner, (int64_t)s->owed);
	s->promised = s->own = s->owed = 0;
	atomic_store(&s->taken, 0);
	datasets_count(p->pushes->datasets);
}
