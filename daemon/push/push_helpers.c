/*
 * One file that can be read in parts, staged by several workers at once.
 *
 * The model: batches of parts are taken in order by the workers that are free: the task of the push, which has its memory, and
 * helpers. A helper starts only if a thread and memory are idle, reads one batch, and queues again behind all other work. All put
 * points into the stage at once, each into its own lane; a worker that finds its lane full sorts and writes a part. When a batch
 * fails, later ones are skipped and earlier ones finished. The error of the first part that fails is the file's, so it does not
 * depend on timing.
 *
 * Not here: opening and checking the file, and what a failure means for the push.
 */
#include <stdlib.h>
#include <string.h>

#include "push_priv.h"

enum { MEMBERS_MAX = GRID_LANES - 1, STEP_MAX = 16, BATCHES_EACH = 8, BATCHES_MAX = 128 };

struct member {
	struct sched_task task; /* for helpers; member 0 has push.task */
	struct push_helpers *helpers;
	uint64_t begin;    /* first part of its batch */
	uint64_t reported; /* points of its batch, added to push.progress */
};

struct push_helpers {
	struct push *push;
	struct push_request *request;
	const struct input *whole;
	struct agree_step plane;
	struct admission_guard guard;
	enum { STAGE_WHOLE, STAGE_SPLIT, STAGE_CLOSED } state; /* of the stage */
	uint64_t parts, step;
	_Atomic uint64_t next;   /* the next part to be taken */
	_Atomic uint64_t failed; /* first part of the lowest batch that failed; `parts`: none */
	struct err err;          /* of that batch */
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
	struct push *p = m->helpers->push;

	atomic_fetch_add(&p->progress, points - m->reported);
	m->reported = points;
	return atomic_load(&p->cancel) || !push_space_staged(p, atomic_load(&p->progress)) ||
	       atomic_load(&m->helpers->failed) < m->begin;
}

static void batch_done(struct member *m, int r, const struct err *err, const struct pipe_ingested *in)
{
	struct push_helpers *c = m->helpers;

	admission_guard_lock(&c->guard);
	if (!r) {
		pipe_ingested_add(&c->sum, in);
	} else if (m->begin < atomic_load(&c->failed)) {
		atomic_store(&c->failed, m->begin);
		c->err = *err;
	}
	admission_guard_unlock(&c->guard);
}

/* Worker: reads the next batch. False: there is none. */
static bool read_batch(struct member *m)
{
	struct push_helpers *c = m->helpers;
	const struct pipe_ingest_params params = {
		.lattice = &c->push->agree.lattice,
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
	m->reported = 0;
	if (m->begin >= c->parts || m->begin >= atomic_load(&c->failed))
		return false;
	end = c->parts - m->begin < c->step ? c->parts : m->begin + c->step;
	r = input_open_part(c->whole, m->begin, end, &part, &err);
	if (!r)
		r = pipe_ingest(part, &params, &in, &err);
	input_close(part);
	batch_done(m, r, &err, &in);
	return true;
}

static bool is_finished(struct push_helpers *c)
{
	return atomic_load(&c->next) >= c->parts || atomic_load(&c->failed) < c->parts;
}

/* Loop: the last member to end answers. */
static void helpers_leave(struct push_helpers *c)
{
	struct push_request *rq = c->request;

	if (--c->running)
		return;
	rq->in = c->sum;
	if (atomic_load(&c->failed) < c->parts) {
		rq->r = -(int)c->err.code;
		rq->err = c->err;
		push_mark_unreadable(rq);
	}
	push_request_done(c->push);
}

static void set_state(struct push_helpers *c, int state)
{
	admission_guard_lock(&c->guard);
	c->state = state;
	admission_guard_wake(&c->guard);
	admission_guard_unlock(&c->guard);
}

/* Worker: gives each member a lane. */
static void split_stage(struct push_helpers *c)
{
	const struct grid_guard guard = admission_guard_of(&c->guard);
	struct err err = ERR_INIT;

	if (grid_stage_split(c->push->stage, c->members, &guard, &err)) {
		c->err = err;
		atomic_store(&c->failed, 0);
	}
	set_state(c, STAGE_SPLIT);
}

static void first_run(struct sched_task *t)
{
	struct push *p = (struct push *)((char *)t - offsetof(struct push, task));
	struct push_request *rq = p->requests;

	if (rq->helpers->members > 1)
		split_stage(rq->helpers);
	while (read_batch(&rq->helpers->member[0]))
		;
	/* Other members may still run; an error of theirs takes precedence. */
	if (atomic_load(&rq->helpers->failed) == rq->helpers->parts)
		rq->r = push_file_finish(p, rq);
}

static void first_done(struct sched_task *t)
{
	struct push *p = (struct push *)((char *)t - offsetof(struct push, task));
	struct push_helpers *c = p->requests->helpers;

	if (t->ran && t->bytes)
		sched_give(p->pushes->core->p.sched, t->name, t->bytes);
	if (!t->ran) {
		c->request->r = -ERR_CANCELLED;
		err_set(&c->request->err, ERR_CANCELLED, "the push was ended");
	}
	set_state(c, STAGE_CLOSED);
	for (unsigned i = 1; i < c->members; i++)
		if (c->member[i].task.run)
			sched_cancel(p->pushes->core->p.sched, &c->member[i].task);
	helpers_leave(c);
}

static void helper_run(struct sched_task *t)
{
	struct push_helpers *c = ((struct member *)t)->helpers;
	bool ready;

	admission_guard_lock(&c->guard);
	while (c->state == STAGE_WHOLE)
		admission_guard_wait(&c->guard);
	ready = c->state == STAGE_SPLIT;
	admission_guard_unlock(&c->guard);
	if (ready)
		read_batch((struct member *)t);
}

static void helper_done(struct sched_task *t)
{
	struct member *m = (struct member *)t;
	struct push_helpers *c = m->helpers;

	if (t->ran)
		sched_give(c->push->pushes->core->p.sched, t->name, t->bytes);
	if (t->ran && !is_finished(c) && !atomic_load(&t->cancel)) {
		t->ran = false;
		sched_submit(c->push->pushes->core->p.sched, t);
		return;
	}
	t->run = NULL;
	helpers_leave(c);
}

_Static_assert(offsetof(struct member, task) == 0, "a task is its member");

/* As many as there are idle threads, and memory beside a job that runs. */
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

/* Small batches keep the wait for the last one short. But each batch searches the list of all parts, so there are at most
 * BATCHES_MAX, unless more members need one each. */
uint64_t push_helpers_step(uint64_t parts, unsigned members)
{
	uint64_t step = parts / (members * BATCHES_EACH), most = parts / BATCHES_MAX;

	most = most < STEP_MAX ? STEP_MAX : most;
	return step < 1 ? 1 : step > most ? most : step;
}

int push_helpers_start(struct push *p, struct push_request *rq, struct err *err)
{
	const struct input_info *info = input_info(rq->whole);
	unsigned n = count_members(p, info);
	struct push_helpers *c = calloc(1, sizeof *c + n * sizeof *c->member);

	int r;

	if (!c)
		return err_set(err, ERR_NOMEM, "no memory to read a file");
	r = agree_plane_of(&p->agree, &rq->info.crs, &c->plane, err);
	if (r) {
		free(c);
		return r;
	}
	c->push = p;
	c->request = rq;
	c->whole = rq->whole;
	c->parts = info->parts;
	c->step = push_helpers_step(c->parts, n);
	atomic_store(&c->failed, c->parts);
	c->err = ERR_INIT;
	admission_guard_init(&c->guard);
	c->members = c->running = n;
	rq->helpers = c;
	p->task = (struct sched_task){.run = first_run,
				      .done = first_done,
				      .owner = p->owner,
				      .priority = SCHED_NORMAL,
				      .lengthy = true,
				      .reads = true,
				      .name = p->task.name,
				      .bytes = p->task.bytes};
	for (unsigned i = 0; i < n; i++)
		c->member[i].helpers = c;
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
		admission_guard_free(&c->guard);
	free(c);
	return NULL;
}
