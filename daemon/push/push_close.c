/*
 * The end of a push without a commit: it is parked (its staged points are written to disk), it is aborted, or its caller leaves.
 *
 * The model: these are requests in the queue, so they come after earlier ones. Files that the catalogue does not name are
 * removed; then the push's row is dropped, so that the next start finds what could not be removed.
 */
#include <string.h>

#include "io.h"
#include "log.h"
#include "push_priv.h"

/* ---- park ---- */

int push_park_start(struct push *p, struct push_request *rq, struct err *err)
{
	return p->stage ? 0 : PUSH_NOW;
}

void push_park_run(struct push *p, struct push_request *rq)
{
	rq->r = push_pending_write(p, &rq->err);
	if (!rq->r)
		p->stage = grid_stage_detach(p->stage);
}

bool push_park_done(struct push *p, struct push_request *rq, const struct err *why)
{
	if (!p->stage)
		push_stage_give(p);
	if (why && !p->left)
		push_break(p, why);
	return true;
}

/* ---- abort, close ---- */

int push_close_start(struct push *p, struct push_request *rq, struct err *err)
{
	return push_streams_busy(p) ? PUSH_WAIT : 0;
}

int push_abort_start(struct push *p, struct push_request *rq, struct err *err)
{
	int r = push_close_start(p, rq, err);

	p->aborted |= r != PUSH_WAIT && !p->committed;
	return r;
}

/* The files of a commit that the catalogue does not name, or may name. */
static void undo_commit(struct push *p)
{
	struct err err = ERR_INIT;
	char segment[64];

	if (catalogue_is_uncertain(p->pushes->core->p.catalogue)) {
		err_set(&err, ERR_IO, "the catalogue may name them");
		dataset_left(p->dataset, &err);
		return;
	}
	pending_stage_name(p->id, segment);
	strcat(segment, ".seg");
	io->unlinkat(p->dataset->dirfd, segment, 0);
	dataset_remove_made(p->dataset->dirfd, p->made_name, &p->apart);
	push_lines_undo(p);
}

void push_close_run(struct push *p, struct push_request *rq)
{
	struct err err = ERR_INIT;

	push_end_files(p);
	if (p->made && !p->committed)
		undo_commit(p);
	if (p->removes_old_manifest && *p->base_name)
		io->unlinkat(p->dataset->dirfd, p->base_name, 0);
	for (unsigned i = 0; p->removes_old_manifest && i < p->apart.ndropped; i++)
		io->unlinkat(p->dataset->dirfd, p->apart.dropped[i], 0);
	/* The row leads the next start to the files, so it is dropped only when their removal is durable. */
	if (p->opened && !p->kept && p->has_row && io_sync(p->dataset->dirfd, "the folder of a dataset", &err)) {
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "files of a push stay until the next start", &err);
		p->has_row = false;
	}
}

bool push_abort_done(struct push *p, struct push_request *rq, const struct err *why)
{
	if (!p->stage)
		push_stage_give(p);
	atomic_store(&p->cancel, false);
	if (!why && !p->committed) {
		p->nsources = 0;
		push_replace_nothing(p);
		p->files = p->listed = p->durable = 0;
	}
	push_streams_free(p);
	p->calls.aborted(rq->token);
	return true;
}

bool push_close_done(struct push *p, struct push_request *rq, const struct err *why)
{
	if (!p->task.ran)
		push_end_files(p); /* the daemon ends, and no worker ran it */
	push_stage_give(p);
	push_table_release(p);
	if (p->kept)
		push_pending_keep(p);
	else if (p->has_row && p->taken)
		dataset_drop_row(p->dataset, p->stem);
	if (p->has_row && !(p->kept && p->stem == p->id))
		dataset_drop_row(p->dataset, p->id);
	push_space_end(p); /* the pending push counts now */
	if (p->opened)
		dataset_close(p->dataset);
	return true;
}
