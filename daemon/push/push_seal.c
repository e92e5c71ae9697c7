/*
 * Sealing: several workers make a segment of what was staged (sched_group.h). They need no memory but the stage's.
 */
#include <stdlib.h>

#include "push_priv.h"
#include "sched_group.h"

struct push_sealing {
	struct push *push;
	struct grid_seal *seal;
	struct admission_guard guard; /* for the engine */
	struct sched_group *group;
};

static bool seal_step(void *ctx, unsigned member)
{
	struct push_sealing *s = ctx;
	struct err err = ERR_INIT; /* the seal keeps the first error */
	uint64_t done, all;
	int r = grid_seal_step(s->seal, &err);

	grid_seal_progress(s->seal, &done, &all);
	atomic_store(&s->push->progress, done);
	atomic_store(&s->push->claimed, all);
	return r == 0;
}

static void sealing_over(void *ctx)
{
	push_request_done(((struct push_sealing *)ctx)->push);
}

struct push_sealing *push_sealing_new(struct push *p, struct err *err)
{
	unsigned threads = sched_threads(p->pushes->core->p.sched);
	struct push_sealing *s = calloc(1, sizeof *s);
	struct sched_group_params group = {
		.sched = p->pushes->core->p.sched, .owner = p->owner, .step = seal_step, .over = sealing_over, .ctx = s};
	struct grid_guard guard;

	if (!s) {
		err_set(err, ERR_NOMEM, "no memory to seal a push");
		return NULL;
	}
	admission_guard_init(&s->guard);
	guard = admission_guard_of(&s->guard);
	s->push = p;
	threads = threads < GRID_LANES ? threads : GRID_LANES;
	if (grid_seal_begin(p->stage, threads, &guard, &s->seal, err))
		return push_sealing_free(s);
	group.members = grid_seal_workers(s->seal);
	group.members = group.members < threads ? group.members : threads;
	return sched_group_new(&group, &s->group, err) ? push_sealing_free(s) : s;
}

struct push_sealing *push_sealing_free(struct push_sealing *s)
{
	if (!s)
		return NULL;
	grid_seal_free(s->seal);
	admission_guard_free(&s->guard);
	sched_group_free(s->group);
	free(s);
	return NULL;
}

int push_sealing_finish(struct push_sealing *s, struct grid_segment_info *ret, struct err *err)
{
	int r;

	sched_group_run(s->group);
	r = grid_seal_finish(s->seal, ret, err);
	s->seal = NULL;
	return r;
}

void push_sealing_start(struct push_sealing *s)
{
	sched_group_start(s->group);
}

void push_sealing_end(struct push_sealing *s)
{
	sched_group_end(s->group);
}
