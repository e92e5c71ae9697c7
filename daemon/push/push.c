/*
 * The queue of requests of a push.
 *
 * The model: a push is a queue of requests. The first one is being handled, by a worker or by the loop; each is answered exactly
 * once, in order. A table has the handlers of each kind (push_handlers). When the caller of a push leaves, queued requests are
 * answered with "cancelled", and the push closes itself; it is freed when its PUSH_CLOSE is done.
 *
 * Points are visible only after a commit. What a push wrote without one is removed by its close or by the next start, or stays as
 * a pending push (push_pending.c).
 */
#include <assert.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "io.h"
#include "log.h"
#include "push_priv.h"
#include "utf8.h"

#define PROGRESS_SECONDS 0.2
#define IDLE_SECONDS 5.0 /* without a request: others may have the stage's memory */

struct push *push_free(struct push *p)
{
	if (!p)
		return NULL;
	push_forget_probes(p);
	names_free(&p->base_paths);
	push_streams_free(p);
	push_offers_free(p);
	free(p->adopt_named);
	push_replace_free(p);
	if (p->pushes) {
		pending_free(p->pushes->datasets, p->pending);
		uncharge(p->pushes->core, p->charged);
	}
	free(p->sources);
	push_lines_free(p);
	agree_done(&p->agree);
	free(p->format);
	free(p->close_request);
	lock_done(&p->space.lock);
	admission_guard_free(&p->row_guard);
	grid_manifest_free(p->base);
	grid_manifest_free(p->made);
	dataset_next_clear(&p->new_state);
	free(p);
	return NULL;
}

static void request_free(struct push_request *rq)
{
	file_hash_free(&rq->hashing);
	io_close(rq->fd);
	free(rq->name);
	free(rq->format);
	free(rq->columns);
	free(rq->path);
	free(rq->replaces);
	free(rq->wkt);
	free(rq->lines);
	free(rq);
}

struct push_request *push_request_new(struct push *p, enum push_kind kind, void *token, bool front)
{
	struct push_request *rq = calloc(1, sizeof *rq);

	if (!rq)
		return NULL;
	rq->push = p;
	rq->kind = kind;
	rq->token = token;
	rq->fd = -1;
	rq->err = ERR_INIT;
	if (front) {
		rq->next = p->requests;
		p->requests = rq;
		if (!rq->next)
			p->requests_end = &rq->next;
	} else {
		*p->requests_end = rq;
		p->requests_end = &rq->next;
	}
	return rq;
}

void push_request_end(struct push *p)
{
	struct push_request *rq = p->requests;

	THREAD_LOOP_ONLY();
	assert(rq);
	p->requests = rq->next;
	if (!p->requests)
		p->requests_end = &p->requests;
	if (rq->kind == PUSH_FILE || rq->kind == PUSH_PROBE)
		p->unanswered--;
	request_free(rq);
	p->busy = false;
	p->asked_ns = clock_mono_ns();
}

static void push_closed(struct push *p)
{
	struct push **at;

	for (at = &p->pushes->first; *at != p; at = &(*at)->next)
		;
	*at = p->next;
	admission_remove_stage(p->pushes->admission, &p->admission);
	dataset_plan_end(p->dataset, p);
	dataset_commit_end(p->dataset, p);
	dataset_release(p->dataset);
	while (p->requests)
		push_request_end(p);
	push_free(p);
}

/* True if the push still exists. */
static bool end_first(struct push *p, const struct err *why)
{
	struct push_request *rq = p->requests;
	bool last = rq->kind == PUSH_CLOSE;

	if (!push_handlers[rq->kind].done(p, rq, why))
		return true;
	push_request_end(p);
	if (last) {
		push_closed(p);
		return false;
	}
	return true;
}

void push_request_done(struct push *p)
{
	assert(p->busy);
	if (end_first(p, p->requests->r ? &p->requests->err : NULL))
		push_pump(p);
}

static void task_run(struct sched_task *t)
{
	struct push *p = (struct push *)((char *)t - offsetof(struct push, task));

	atomic_store(&p->run_ns, clock_mono_ns());
	push_handlers[p->requests->kind].run(p, p->requests);
	atomic_store(&p->run_ns, 0);
}

static void task_done(struct sched_task *t)
{
	struct push *p = (struct push *)((char *)t - offsetof(struct push, task));
	struct push_request *rq = p->requests;

	if (t->ran && t->bytes && rq->kind != PUSH_STAGE)
		sched_give(p->pushes->core->p.sched, t->name, t->bytes);
	if (!t->ran) {
		rq->r = -ERR_CANCELLED;
		err_set(&rq->err, ERR_CANCELLED, "the push was ended");
	}
	push_request_done(p);
}

/* Later requests are answered with this error, also those about other files. So the error names the push as its subject. */
void push_break(struct push *p, const struct err *why)
{
	struct err *err = &p->broken_err;

	THREAD_LOOP_ONLY();
	if (p->broken)
		return;
	push_event_failed(p, why);
	p->broken = true;
	*err = *why;
	snprintf(err->message, sizeof err->message, "the push%s%s cannot go on: %.400s", p->dataset->onestep ? "" : " into ",
		 p->dataset->onestep ? "" : p->dataset->name, *why->message ? why->message : err_wire_name(why->code));
	err_add_place(err, ERR_NO_OFFSET, "push");
}

/* Why a request of a push that closes, was cancelled, or is broken is not handled. */
static const struct err *refuse_reason(const struct push *p, const struct push_request *rq, struct err *err)
{
	if (rq->kind == PUSH_CLOSE || rq->kind == PUSH_ABORT)
		return NULL;
	if (p->left) {
		err_set(err, ERR_CANCELLED, "the push was ended");
		return err;
	}
	if (p->broken && rq->kind != PUSH_BEGIN)
		return &p->broken_err;
	/* Aborted: requests before the abort that wait for a pipe or for memory would keep it waiting. */
	if (atomic_load(&p->cancel)) {
		err_set(err, ERR_CANCELLED, "the push was ended");
		return err;
	}
	return NULL;
}

/* Requests that write nothing need not wait for the push's row. Points go into memory, and a worker that runs out of it waits
 * then (push_row_wait). The files of a pending push have a row already. */
static bool may_precede_row(const struct push_request *rq)
{
	return rq->kind == PUSH_PROBE || rq->kind == PUSH_PLAN || rq->kind == PUSH_STAGE || rq->kind == PUSH_FILE;
}

void push_pump(struct push *p)
{
	THREAD_LOOP_ONLY();
	while (p->requests && !p->busy && !p->commit_row_queued && (!p->row_queued || may_precede_row(p->requests))) {
		struct push_request *rq = p->requests;
		struct err err = ERR_INIT;
		const struct err *why = refuse_reason(p, rq, &err);
		int r = 0;

		p->busy = true;
		p->task = (struct sched_task){
			.run = task_run, .done = task_done, .owner = p->owner, .priority = SCHED_NORMAL, .lengthy = true};
		if (!why && push_handlers[rq->kind].start)
			r = push_handlers[rq->kind].start(p, rq, &err);
		if (r == PUSH_WAIT) {
			p->busy = false;
			return;
		}
		if (p->requests != rq) {
			/* An internal request goes first. */
			p->busy = false;
			continue;
		}
		if (!why && !r) {
			sched_submit(p->pushes->core->p.sched, &p->task);
			return;
		}
		if (!end_first(p, why ? why : r < 0 ? &err : NULL))
			return;
	}
}

/* ---- requests ---- */

/* False: no memory, and no answer yet. */
static bool request_file(struct push *p, enum push_kind kind, int fd, const struct push_input *in, void *token)
{
	struct push_request *rq = push_request_new(p, kind, token, false);

	if (!rq) {
		io_close(fd);
		return false;
	}
	p->unanswered++;
	rq->fd = fd;
	rq->name = push_copy_text(in->name);
	rq->format = push_copy_text(in->format && *in->format ? in->format : p->format);
	rq->columns = push_copy_text(in->columns);
	rq->decimal_comma = in->decimal_comma;
	/* Paths too long for the manifest are not recorded. */
	rq->path = push_copy_text(in->path && strlen(in->path) < GRID_SOURCE_PATH ? in->path : "");
	rq->checksum = in->checksum;
	rq->add = in->add;
	rq->replace = in->replace;
	rq->replaces = push_copy_text(in->replaces);
	rq->stream = fd < 0 ? push_stream_find(p, in->name) : NULL;
	rq->announced = rq->stream && in->announced;
	rq->announced_size = in->size;
	if (rq->announced)
		rq->hash = in->hash;
	push_pump(p);
	return true;
}

static const struct err *no_memory(struct err *err)
{
	*err = ERR_INIT;
	err_set(err, ERR_NOMEM, "no memory for a request");
	return err;
}

void push_probe(struct push *p, int fd, const struct push_input *in, void *token)
{
	struct err err;

	THREAD_LOOP_ONLY();
	if (!request_file(p, PUSH_PROBE, fd, in, token))
		p->calls.probed(token, no_memory(&err), NULL);
}

void push_file(struct push *p, int fd, const struct push_input *in, void *token)
{
	struct err err;

	THREAD_LOOP_ONLY();
	if (!request_file(p, PUSH_FILE, fd, in, token))
		p->calls.staged(token, no_memory(&err), NULL);
}

void push_plan(struct push *p, void *token)
{
	struct err err;

	THREAD_LOOP_ONLY();
	if (!push_request_new(p, PUSH_PLAN, token, false))
		p->calls.planned(token, no_memory(&err), NULL);
	else
		push_pump(p);
}

void push_commit(struct push *p, void *token)
{
	struct err err;

	THREAD_LOOP_ONLY();
	if (!push_request_new(p, PUSH_COMMIT, token, false))
		p->calls.committed(token, no_memory(&err), NULL);
	else
		push_pump(p);
}

void push_abort(struct push *p, void *token)
{
	THREAD_LOOP_ONLY();
	atomic_store(&p->cancel, true);
	push_streams_wake(p);
	push_row_wake(p);
	if (!push_request_new(p, PUSH_ABORT, token, false))
		p->calls.aborted(token);
	else
		push_pump(p);
}

void push_leave(struct push *p)
{
	THREAD_LOOP_ONLY();
	if (p->left)
		return;
	p->left = true;
	dataset_push_end(p->dataset);
	/* A commit that runs is completed. */
	if (!p->busy || p->requests->kind != PUSH_COMMIT) {
		atomic_store(&p->cancel, true);
		push_streams_wake(p);
		push_row_wake(p);
		if (p->busy)
			sched_cancel(p->pushes->core->p.sched, &p->task);
	}
	*p->requests_end = p->close_request;
	p->requests_end = &p->close_request->next;
	p->close_request = NULL;
	push_pump(p);
}

static struct push *push_of(const struct admission_stage *s)
{
	return (struct push *)((char *)s - offsetof(struct push, admission));
}

static uint64_t stage_bytes(const struct admission_stage *s)
{
	return push_staged_bytes(push_of(s));
}

/* The table of its files does not count while it waits for a stage: pushes of one user would wait for each other. */
static uint64_t stage_held(const struct admission_stage *s)
{
	const struct push *p = push_of(s);

	return p->stage_bytes ? p->stage_bytes + push_kept_bytes(p) : 0;
}

static bool stage_wants(const struct admission_stage *s)
{
	return push_wants_stage(push_of(s));
}

static bool stage_fits(const struct admission_stage *s)
{
	const struct push *p = push_of(s);

	return admission_user_available(p->pushes->admission, &p->owner, NULL) >=
	       GRID_STAGE_MIN + p->read_bytes + p->lines.want + push_kept_bytes(p);
}

static void stage_retry(struct admission_stage *s)
{
	push_retry(push_of(s));
}

const struct admission_stage_calls push_stage_calls = {
	.bytes = stage_bytes, .held = stage_held, .wants = stage_wants, .fits = stage_fits, .retry = stage_retry};

void push_retry(struct push *p)
{
	struct err err = ERR_INIT;

	if (p->waits_memory && !p->retry) {
		p->waits_memory = false;
		if (!end_first(p, refuse_reason(p, p->requests, &err)))
			return;
	}
	push_pump(p);
}

/* For a stop that cannot wait: removes only its own files. Files of others in the folder may have been promised, or may belong to
 * a row that is on its way; the next start handles them. */
void push_remove_files(struct push *p)
{
	struct err err = ERR_INIT;
	char name[64];

	/* What the next start can continue stays. */
	if (p->committed || p->on_disk || p->dataset->onestep || (p->busy && p->requests->kind == PUSH_COMMIT) ||
	    dataset_open(p->dataset, &err))
		return;
	pending_stage_name(p->stem, name);
	strcat(name, ".");
	if (io_folder_sweep(p->dataset->dirfd, name, &err))
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "the files of a push cannot be removed", &err);
	dataset_close(p->dataset);
}

static bool reads_file(const struct push_request *rq)
{
	return rq->kind == PUSH_PROBE || rq->kind == PUSH_FILE;
}

/* No worker reads its file, because as many other files of the user hang as may hang at once: how many. Otherwise 0. */
static unsigned waits_for_others(const struct push *p, const struct push_request *rq)
{
	unsigned n = reads_file(rq) && !atomic_load(&p->run_ns) ? sched_hanging(p->pushes->core->p.sched, &p->owner) : 0;

	return n >= SCHED_HELD_EACH ? n : 0;
}

static void report_progress(struct push *p, const struct push_request *rq)
{
	uint64_t hash_end = atomic_load(&p->hash_end), done = atomic_load(&p->progress), all = atomic_load(&p->claimed);
	bool hangs = p->seen_ns && clock_since(p->seen_ns) >= SCHED_HOLD_SECONDS;
	unsigned others = waits_for_others(p, rq);
	char waiting[300] = "";

	if (rq->kind != PUSH_FILE && rq->kind != PUSH_COMMIT && !hash_end && !hangs && !others)
		return;
	p->progress_ns = clock_mono_ns();
	if (hangs)
		snprintf(waiting, sizeof waiting, "stalled-file: %s", utf8_end(rq->name, 280));
	else if (others)
		snprintf(waiting, sizeof waiting, "stalled-files: %u", others);
	if (hash_end)
		p->calls.progress(rq->token, "hash", atomic_load(&p->hashed), hash_end, waiting);
	else if (rq->kind == PUSH_FILE)
		p->calls.progress(rq->token, "stage", done, all, waiting);
	else if (rq->kind == PUSH_PROBE)
		p->calls.progress(rq->token, "probe", 0, 0, waiting);
	else
		p->calls.progress(rq->token, "seal", rq->sealing ? done : 0, rq->sealing ? all : 0, "");
}

/* How long the file that a worker reads has given nothing. */
static void watch_reading(struct push *p)
{
	const struct push_request *rq = p->requests;
	uint64_t run_ns = atomic_load(&p->run_ns), seen = atomic_load(&p->progress) + atomic_load(&p->hashed);

	if (!run_ns || !rq || !p->busy || !reads_file(rq)) {
		p->seen_ns = 0;
	} else if (!p->seen_ns || p->seen_ns < run_ns || seen != p->seen) {
		p->seen_ns = clock_mono_ns();
		p->seen = seen;
		if (p->holds)
			sched_release(p->pushes->core->p.sched, p->owner.flow);
		p->holds = false;
	} else if (clock_since(p->seen_ns) >= SCHED_HOLD_SECONDS) {
		p->holds = sched_hold(p->pushes->core->p.sched, p->owner.flow) > 0;
	}
}

void push_tick(struct push *p)
{
	struct push_request *rq = p->requests;

	watch_reading(p);
	push_space_tick(p);
	/* Once a tick, because each attempt needs a worker. */
	if (p->retry)
		p->retry = p->waits_memory = p->busy = false;
	if (rq && p->busy && !p->left && clock_since(p->progress_ns) >= PROGRESS_SECONDS)
		report_progress(p, rq);
	if (!rq && p->stage && !p->dataset->onestep && p->durable < p->files && !p->broken &&
	    clock_since(p->synced_ns) >= PUSH_DURABLE_SECONDS)
		push_request_new(p, PUSH_SYNC, NULL, false);
	else if (!rq && p->stage && !p->broken && clock_since(p->asked_ns) >= IDLE_SECONDS)
		push_request_new(p, PUSH_PARK, NULL, false);
	push_pump(p);
}

const struct push_handler push_handlers[PUSH_KINDS] = {
	[PUSH_BEGIN] = {push_begin_start, push_begin_run, push_begin_done},
	[PUSH_PROBE] = {push_probe_start, push_probe_run, push_probe_done},
	[PUSH_PLAN] = {push_plan_start, push_plan_run, push_plan_done},
	[PUSH_STAGE] = {push_stage_start, push_stage_run, push_stage_done},
	[PUSH_FILE] = {push_file_start, push_file_run, push_file_done},
	[PUSH_SYNC] = {push_sync_start, push_sync_run, push_sync_done},
	[PUSH_PARK] = {push_park_start, push_park_run, push_park_done},
	[PUSH_COMMIT] = {push_commit_start, push_commit_run, push_commit_done},
	[PUSH_ABORT] = {push_abort_start, push_close_run, push_abort_done},
	[PUSH_CLOSE] = {push_close_start, push_close_run, push_close_done},
};
