/* The stage of a push: its memory, and the points where what was staged becomes durable. */
#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "push_priv.h"

/* ---- memory ---- */

int push_stage_start(struct push *p, struct push_request *rq, struct err *err)
{
	struct pushes *pushes = p->pushes;
	uint64_t size, room, least;

	/* Includes the buffers for reading, so that a file never waits for memory that this stage keeps from others. */
	p->read_bytes = push_read_bytes(p);
	least = GRID_STAGE_MIN + p->read_bytes + p->lines.want;
	if (admission_check_size(pushes->admission, least + admission_plan_min(),
				 p->lines.want ? "making the line set of the dataset, beside a mesh," : "staging, beside a mesh,",
				 err) ||
	    admission_user_check_size(pushes->admission, &p->owner, least + push_kept_bytes(p), "staging", err))
		return -(int)err->code;
	if (admission_stage_other_is_next(pushes->admission, &p->admission))
		return PUSH_WAIT;
	size = admission_stage_available(pushes->admission, least);
	room = admission_user_available(pushes->admission, &p->owner, NULL);
	room = room > push_kept_bytes(p) ? room - push_kept_bytes(p) : 0;
	size = size < room ? size : room;
	if (size < least)
		return PUSH_WAIT;
	p->stage_ns = clock_mono_ns();
	p->task.priority = SCHED_FIRST;
	push_task_bytes(p, LEDGER_STAGE, size);
	/* Plans that are made from now on count it. */
	p->stage_bytes = size;
	return 0;
}

void push_stage_run(struct push *p, struct push_request *rq)
{
	char name[48], segment[48];
	struct grid_stage_params params = {
		.dirfd = p->dataset->dirfd,
		.name = name,
		.segment = segment,
		.memory = p->task.bytes - p->read_bytes - p->lines.want,
		.durable = !p->dataset->onestep,
		.temporary = p->dataset->onestep, /* nobody finds it after a crash */
		.folder_later = true,             /* the .pending manifest follows, and the folder is synchronised after it */
		.ready = push_row_wait,
		.ready_ctx = p,
	};

	p->lines.have = p->lines.want;
	pending_stage_name(p->stem, name);
	pending_stage_name(p->id, segment);
	if (p->on_disk)
		rq->r = grid_stage_resume(&params, &p->stage, &rq->err);
	else
		rq->r = grid_stage_new(&params, &p->stage, &rq->err);
}

bool push_stage_done(struct push *p, struct push_request *rq, const struct err *why)
{
	if (!p->task.ran) {
		p->stage_bytes = 0;
	} else if (why) {
		sched_give(p->pushes->core->p.sched, LEDGER_STAGE, p->stage_bytes);
		p->stage_bytes = 0;
	}
	if (why)
		push_break(p, why);
	return true;
}

void push_stage_give(struct push *p)
{
	THREAD_LOOP_ONLY();
	assert(!p->stage);
	if (p->stage_bytes)
		sched_give(p->pushes->core->p.sched, LEDGER_STAGE, p->stage_bytes);
	p->stage_bytes = 0;
}

/* ---- durable points ---- */

int push_sync_start(struct push *p, struct push_request *rq, struct err *err)
{
	return p->stage ? 0 : PUSH_NOW;
}

void push_sync_run(struct push *p, struct push_request *rq)
{
	rq->r = push_pending_write(p, &rq->err);
}

bool push_sync_done(struct push *p, struct push_request *rq, const struct err *why)
{
	struct err err = ERR_INIT;
	struct catalogue_push row = {
		.id = p->stem,
		.dataset = p->dataset->id,
		.uid = p->peer.uid,
		.files = p->files + (p->adopt ? (uint32_t)p->adopt->nsources : 0),
		.begun_us = clock_real_us(),
	};

	if (why) {
		/* A push that has left tries once more at its end. */
		if (!p->left)
			push_break(p, why);
		return true;
	}
	p->durable = p->files;
	p->unsynced_points = 0;
	p->synced_ns = clock_mono_ns();
	if (p->has_row && catalogue_put_push(p->pushes->core->p.catalogue, &row, NULL, NULL, &err))
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL, "the catalogue", &err);
	if (!p->left)
		p->calls.durable(p->ctx, p->durable);
	return true;
}
