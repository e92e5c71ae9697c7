/*
 * One file that can be read in parts, staged by several workers at once.
 *
 * The model: parts are taken in order, some at a time, by whoever is free: the task of the push itself, whose
 * memory is there already, and helpers that start only where a thread and memory are idle, take one helping
 * each and queue up again behind everybody else. All put points into the stage at once, which is split; who
 * finds it full sorts a part and writes it out. When a helping fails, later ones are given up and earlier ones
 * finished; the error of the first part that fails is the file's, whoever came to it and when.
 *
 * Not here: what is done with a file that failed; opening and checking it.
 */
#include <stdlib.h>
#include <string.h>

#include "push_priv.h"

enum { MEMBERS_MAX = GRID_LANES - 1, STEP_MAX = 16, STEPS = 8, HELPINGS_MAX = 128 };

struct member {
	struct sched_task task; /* of helpers; the first has the push's */
	struct push_helpers *crew;
	uint64_t begin; /* of its helping */
	uint64_t told;  /* points of it */
};

struct push_helpers {
	struct push *push;
	struct push_ask *ask;
	const struct input *whole;
	struct push_plane_step plane;
	struct push_guard guard;
	enum { WHOLE, SPLIT, GONE } state; /* of the stage */
	uint64_t parts, step;
	_Atomic uint64_t next;   /* part */
	_Atomic uint64_t failed; /* first part of the lowest helping that failed; `parts`: none */
	struct err err;          /* of it */
	struct pipe_ingested sum;
	unsigned members, running;
	struct member member[];
};

static uint64_t push_helper_bytes(const struct input_info *info)
{
	return pipe_ingest_bytes() + info->read_bytes;
}

static int progress(void *ctx, uint64_t points)
{
	struct member *m = ctx;
	struct push *p = m->crew->push;

	atomic_fetch_add(&p->progress, points - m->told);
	m->told = points;
	return atomic_load(&p->cancel) || !push_space_staged(p, atomic_load(&p->progress)) ||
	       atomic_load(&m->crew->failed) < m->begin;
}

static void helping_over(struct member *m, int r, const struct err *err, const struct pipe_ingested *in)
{
	struct push_helpers *c = m->crew;

	push_guard_lock(&c->guard);
	if (!r) {
		pipe_ingested_add(&c->sum, in);
	} else if (m->begin < atomic_load(&c->failed)) {
		atomic_store(&c->failed, m->begin);
		c->err = *err;
	}
	push_guard_unlock(&c->guard);
}

/* Worker: the next helping; false: there is none. */
static bool help(struct member *m)
{
	struct push_helpers *c = m->crew;
	const struct pipe_ingest_params params = {
		.lattice = &c->push->lattice,
		.stage = c->push->stage,
		.step = c->plane.needed ? &c->plane.params : NULL,
		.split = c->members > 1,
		.progress = progress,
		.ctx = m,
	};
	struct pipe_ingested in = {0};
	struct err err = ERR_INIT;
	struct input *part = NULL;
	uint64_t end;
	int r;

	m->begin = atomic_fetch_add(&c->next, c->step);
	m->told = 0;
	if (m->begin >= c->parts || m->begin >= atomic_load(&c->failed))
		return false;
	end = c->parts - m->begin < c->step ? c->parts : m->begin + c->step;
	r = input_open_part(c->whole, m->begin, end, &part, &err);
	if (!r)
		r = pipe_ingest(part, &params, &in, &err);
	input_close(part);
	helping_over(m, r, &err, &in);
	return true;
}

static bool over(struct push_helpers *c)
{
	return atomic_load(&c->next) >= c->parts || atomic_load(&c->failed) < c->parts;
}

/* Loop: the last one gone answers. */
static void leave(struct push_helpers *c)
{
	struct push_ask *a = c->ask;

	if (--c->running)
		return;
	a->in = c->sum;
	if (atomic_load(&c->failed) < c->parts) {
		a->r = -(int)c->err.code;
		a->err = c->err;
	}
	push_task_over(c->push);
}

static void set_state(struct push_helpers *c, int state)
{
	push_guard_lock(&c->guard);
	c->state = state;
	push_guard_wake(&c->guard);
	push_guard_unlock(&c->guard);
}

/* Worker: a lane for each. */
static void split(struct push_helpers *c)
{
	const struct grid_guard guard = push_guard_of(&c->guard);
	struct err err = ERR_INIT;

	if (grid_stage_split(c->push->stage, c->members, &guard, &err)) {
		c->err = err;
		atomic_store(&c->failed, 0);
	}
	set_state(c, SPLIT);
}

static void first_run(struct sched_task *t)
{
	struct push *p = (struct push *)((char *)t - offsetof(struct push, task));
	struct push_ask *a = p->asks;

	if (a->crew->members > 1)
		split(a->crew);
	while (help(&a->crew->member[0]))
		;
	/* Others may still be at work; what they find comes first. */
	if (atomic_load(&a->crew->failed) == a->crew->parts)
		a->r = push_file_finish(p, a);
}

static void first_done(struct sched_task *t)
{
	struct push *p = (struct push *)((char *)t - offsetof(struct push, task));
	struct push_helpers *c = p->asks->crew;

	if (t->ran && t->bytes)
		sched_give(p->pushes->core->p.sched, t->name, t->bytes);
	if (!t->ran) {
		c->ask->r = -ERR_CANCELLED;
		err_set(&c->ask->err, ERR_CANCELLED, "the push was ended");
	}
	set_state(c, GONE);
	for (unsigned i = 1; i < c->members; i++)
		if (c->member[i].task.run)
			sched_cancel(p->pushes->core->p.sched, &c->member[i].task);
	leave(c);
}

static void helper_run(struct sched_task *t)
{
	struct push_helpers *c = ((struct member *)t)->crew;
	bool ready;

	push_guard_lock(&c->guard);
	while (c->state == WHOLE)
		push_guard_wait(&c->guard);
	ready = c->state == SPLIT;
	push_guard_unlock(&c->guard);
	if (ready)
		help((struct member *)t);
}

static void helper_done(struct sched_task *t)
{
	struct member *m = (struct member *)t;
	struct push_helpers *c = m->crew;

	if (t->ran)
		sched_give(c->push->pushes->core->p.sched, t->name, t->bytes);
	if (t->ran && !over(c) && !atomic_load(&t->cancel)) {
		t->ran = false;
		sched_submit(c->push->pushes->core->p.sched, t);
		return;
	}
	t->run = NULL;
	leave(c);
}

_Static_assert(offsetof(struct member, task) == 0, "a task is its member");

/* Those that idle threads and memory allow: a job that runs must be able to finish beside them. */
static unsigned count_members(struct push *p, const struct input_info *info)
{
	struct pushes *pushes = p->pushes;
	uint64_t left = admission_domain_memory(pushes->admission), head = 2 * admission_domain_largest(pushes->admission), n,
		 room = admission_user_available(pushes->admission, &p->owner, NULL);

	n = left > head ? (left - head) / push_helper_bytes(info) : 0;
	if (n > room / push_helper_bytes(info))
		n = room / push_helper_bytes(info);
	if (n > sched_threads(pushes->core->p.sched) - 1)
		n = sched_threads(pushes->core->p.sched) - 1;
	if (n > info->parts - 1)
		n = info->parts - 1;
	if (n > grid_stage_lanes(p->stage) - 1)
		n = grid_stage_lanes(p->stage) - 1;
	return 1 + (n < MEMBERS_MAX ? (unsigned)n : MEMBERS_MAX);
}

/* Small ones, so that nobody waits long for the last; but each goes through the list of all parts to find its own,
 * so of many parts there are not more than HELPINGS_MAX, unless so many members want theirs. */
uint64_t push_helpers_step(uint64_t parts, unsigned members)
{
	uint64_t step = parts / (members * STEPS), most = parts / HELPINGS_MAX;

	most = most < STEP_MAX ? STEP_MAX : most;
	return step < 1 ? 1 : step > most ? most : step;
}

int push_helpers_start(struct push *p, struct push_ask *a, struct err *err)
{
	const struct input_info *info = input_info(a->whole);
	unsigned n = count_members(p, info);
	struct push_helpers *c = calloc(1, sizeof *c + n * sizeof *c->member);

	int r;

	if (!c)
		return err_set(err, ERR_NOMEM, "no memory to read a file");
	r = push_plane_of(p, &a->info.crs, &c->plane, err);
	if (r) {
		free(c);
		return r;
	}
	c->push = p;
	c->ask = a;
	c->whole = a->whole;
	c->parts = info->parts;
	c->step = push_helpers_step(c->parts, n);
	atomic_store(&c->failed, c->parts);
	c->err = ERR_INIT;
	push_guard_init(&c->guard);
	c->members = c->running = n;
	a->crew = c;
	p->task = (struct sched_task){.run = first_run,
				      .done = first_done,
				      .owner = p->owner,
				      .priority = SCHED_NORMAL,
				      .lengthy = true,
				      .reads = true,
				      .name = p->task.name,
				      .bytes = p->task.bytes};
	for (unsigned i = 0; i < n; i++)
		c->member[i].crew = c;
	sched_submit(p->pushes->core->p.sched, &p->task);
	for (unsigned i = 1; i < n; i++) {
		c->member[i].task = (struct sched_task){.run = helper_run,
							.done = helper_done,
							.owner = p->owner,
							.reads = true,
							.priority = SCHED_LAST,
							.name = LEDGER_INPUT,
							.bytes = push_helper_bytes(info)};
		sched_submit(p->pushes->core->p.sched, &c->member[i].task);
	}
	return 0;
}

uint64_t push_helpers_held(const struct push_helpers *c)
{
	uint64_t bytes = 0;

	for (unsigned i = 1; c && i < c->members; i++)
		bytes += sched_taken(c->push->pushes->core->p.sched, &c->member[i].task);
	return bytes;
}

struct push_helpers *push_helpers_free(struct push_helpers *c)
{
	if (c)
		push_guard_free(&c->guard);
	free(c);
	return NULL;
}
