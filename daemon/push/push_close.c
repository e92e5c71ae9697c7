/*
 * How a push ends without a commit: it parks (what was staged goes to the disk, and stays for a while), is aborted, or its
 * caller is gone.
 *
 * The model: parked and closed are rows of push_rows like every other ask (push_ask.c), so they come after what was asked before.
 * What the catalogue does not name is removed here; its row goes last, so that the next start finds what this one could not.
 */
#include "io.h"
#include "log.h"
#include "push_priv.h"

/* ---- park ---- */

int push_park_start(struct push *p, struct push_ask *a, struct err *err)
{
	return p->stage ? 0 : PUSH_NOW;
}

void push_park_run(struct push *p, struct push_ask *a)
{
	a->r = push_leave_pending(p, &a->err);
	if (!a->r)
		p->stage = grid_stage_detach(p->stage);
}

bool push_park_done(struct push *p, struct push_ask *a, const struct err *why)
{
	if (!p->stage)
		push_stage_give(p);
	if (why && !p->left)
		push_break(p, why);
	return true;
}

/* ---- abort, close ---- */

int push_close_start(struct push *p, struct push_ask *a, struct err *err)
{
	return push_streams_busy(p) ? PUSH_WAIT : 0;
}

int push_abort_start(struct push *p, struct push_ask *a, struct err *err)
{
	int r = push_close_start(p, a, err);

	p->aborted |= r != PUSH_WAIT && !p->committed;
	return r;
}

void push_close_run(struct push *p, struct push_ask *a)
{
	struct err err = ERR_INIT;

	push_end_run(p);
	if (p->made && !p->committed && !catalogue_is_uncertain(p->pushes->core->p.catalogue)) {
		/* The catalogue does not name them. */
		io->unlinkat(p->dataset->dirfd, p->made->segments[p->made->nsegments - 1].file, 0);
		io->unlinkat(p->dataset->dirfd, p->made_name, 0);
	}
	if (p->old_goes && *p->base_name)
		io->unlinkat(p->dataset->dirfd, p->base_name, 0);
	/* Its row, by which the next start would know of them, goes only when they cannot come back. */
	if (p->opened && !p->kept && p->row && io_sync(p->dataset->dirfd, "the folder of a dataset", &err)) {
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "files of a push stay until the next start", &err);
		p->row = false;
	}
}

bool push_abort_done(struct push *p, struct push_ask *a, const struct err *why)
{
	if (!p->stage)
		push_stage_give(p);
	atomic_store(&p->cancel, false);
	if (!why && !p->committed) {
		p->nsources = 0;
		push_replace_nothing(p);
		p->files = p->durable = 0;
	}
	push_streams_free(p);
	p->calls.aborted(a->token);
	return true;
}

bool push_close_done(struct push *p, struct push_ask *a, const struct err *why)
{
	struct err err = ERR_INIT;

	if (!p->task.ran)
		push_end_run(p); /* no worker came to it: the daemon ends */
	push_stage_give(p);
	push_room_give(p);
	if (p->kept)
		push_becomes_pending(p);
	else if (p->row && catalogue_drop_push(p->pushes->core->p.catalogue, p->id, NULL, NULL, &err))
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL, "the catalogue", &err);
	push_space_end(p); /* what is pending counts now */
	if (p->opened)
		dataset_close(p->dataset);
	return true;
}
