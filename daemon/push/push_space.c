/*
 * Disk space of a push.
 *
 * The model: before its first point is staged, a push reserves what its probes claim: its runs and its segment, which both exist
 * until the commit (for a one-step dataset, runs shrink as the segment grows). Headers may be wrong, and pipes say nothing, so
 * more is reserved in steps as points are staged. What is reserved and not written yet is promised, so that two pushes do not
 * count on the same free bytes. With a crop the part that will be read is unknown, and only staged points count. What a pending
 * push that it continues has on the disk already (`held`) stays in the accounts, and needs no free bytes.
 *
 * All of it counts for the pushing user; what will remain after the commit also counts for the owner of the dataset (limit.c).
 * Both are released when the push ends. Then its result counts: a new generation for the owner, a pending push for the pushing
 * user.
 */
#include <assert.h>
#include <stdio.h>

#include "push_priv.h"

enum { TEXT_POINT_BYTES = 24, STEP_LEAST = 1 << 20 };

/* For that many points in all, with runs and segment. */
static uint64_t needed_bytes(const struct push *p, uint64_t points)
{
	uint64_t bytes = datasets_points_bytes(points);

	return p->dataset->onestep ? bytes + (points * 16) / 32 : 2 * bytes;
}

static enum space_kind kind_of(const struct push *p)
{
	return p->dataset->onestep ? SPACE_ONESTEP : SPACE_PENDING;
}

static uint64_t excess(uint64_t want, uint64_t has)
{
	return want > has ? want - has : 0;
}

static int reserve(struct push *p, uint64_t bytes, uint64_t points, struct err *err)
{
	struct push_space *s = &p->space;
	uint64_t taken = atomic_load(&s->taken) + bytes, all = s->held + taken, own = excess(all, s->own), owed = 0;
	char what[64];
	int r = 0;

	assert(lock_held(LOCK_PUSH_SPACE));
	snprintf(what, sizeof what, "a push of %llu points", (unsigned long long)points);
	/* After the commit the segment, without the runs, counts for the owner. */
	if (s->owner != p->peer.uid) {
		owed = excess(all / 2, s->owed);
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
	atomic_store(&s->taken, taken);
	return 0;
}

void push_space_claim(struct push *p, const struct pending *q)
{
	p->space.held = q->bytes;
	p->space.own += q->bytes;
	limit_release_and_recount(p->pushes->core, p->peer.uid, -(int64_t)q->bytes, 0, 0);
	space_commit(p->pushes->core->space, SPACE_PENDING, 0, q->bytes);
	datasets_count(p->pushes->datasets);
}

/* The segment will have the files of the pending push that were named. */
static uint64_t adopted_bytes(const struct push *p)
{
	uint64_t points = 0;

	for (size_t i = 0; p->adopt && i < p->adopt->nsources; i++)
		points += p->adopt_named[i] ? pending_source_points(&p->adopt->sources[i]) : 0;
	return p->adopt ? datasets_points_bytes(points) : 0;
}

int push_space_plan(struct push *p, struct err *err)
{
	uint64_t points = 0, need;
	int r = 0;

	if (p->has_crop)
		return 0;
	for (size_t i = 0; i < p->nprobes; i++) {
		const struct push_probed *probe = &p->probes[i];
		uint64_t claimed = probe->claimed ? probe->claimed : probe->id.size / TEXT_POINT_BYTES;

		if (!probe->excluded && __builtin_add_overflow(points, claimed, &points))
			points = UINT64_MAX / 64;
	}
	p->space.adopted = adopted_bytes(p);
	need = p->space.adopted + needed_bytes(p, points);
	lock_take(&p->space.lock);
	if (need > atomic_load(&p->space.taken))
		r = reserve(p, need - atomic_load(&p->space.taken), points, err);
	lock_give(&p->space.lock);
	return r;
}

bool push_space_staged(struct push *p, uint64_t points)
{
	uint64_t all = atomic_load(&p->space.staged) + points, need = p->space.adopted + needed_bytes(p, all), taken;
	struct err err = ERR_INIT;

	if (need <= atomic_load(&p->space.taken))
		return true;
	lock_take(&p->space.lock);
	taken = atomic_load(&p->space.taken);
	if (need > taken && !p->space.why.code) {
		uint64_t step = taken / 16 > STEP_LEAST ? taken / 16 : STEP_LEAST;

		/* In steps, or if that fails, only what is needed now. */
		if (reserve(p, need - taken + step, all, &err))
			reserve(p, need - taken, all, &p->space.why);
	}
	lock_give(&p->space.lock);
	return !p->space.why.code;
}

const struct err *push_space_full(const struct push *p)
{
	return p->space.why.code ? &p->space.why : NULL;
}

void push_space_tick(struct push *p)
{
	uint64_t points = atomic_load(&p->space.staged) + atomic_load(&p->progress), written = points * 16, open;
	struct push_space *s = &p->space;

	/* Points in memory are not written. */
	written = written > p->stage_bytes ? written - p->stage_bytes : 0;
	/* A worker may wait for the file system while it holds the lock. The next tick comes soon. */
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

	THREAD_LOOP_ONLY();
	space_add_unwritten(p->pushes->core->space, kind_of(p), -(int64_t)s->promised);
	space_give(p->pushes->core->space, kind_of(p), s->held + atomic_load(&s->taken));
	limit_release_and_recount(p->pushes->core, p->peer.uid, (int64_t)s->own, s->owner, (int64_t)s->owed);
	s->held = s->promised = s->own = s->owed = 0;
	atomic_store(&s->taken, 0);
	datasets_count(p->pushes->datasets);
}
