/*
 * Pushes: what was asked, one after the other.
 *
 * The model: a push is a queue of asks, of which the first is being done, by a worker or by the loop; each is
 * answered exactly once, in order. What an ask does is a row of push_rows (push_ask.c). A push whose caller
 * has left answers what is queued with "cancelled" and closes itself; it is gone when its PUSH_CLOSE is done.
 * Points are visible only after a commit. What a push wrote without one is removed by its close, or by the
 * next start, or stays as a pending push (push_pending.c).
 */
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "io.h"
#include "log.h"
#include "mode.h"
#include "push_priv.h"

#define PROGRESS_SECONDS 0.2
#define DURABLE_SECONDS 5.0
#define IDLE_SECONDS 5.0 /* without a question: others may have the stage's memory */

static struct push *push_free(struct push *p)
{
	if (!p)
		return NULL;
	push_forget_probes(p);
	names_free(&p->base_paths);
	push_streams_free(p);
	names_free(&p->adopt_paths);
	grid_manifest_free(p->adopt);
	free(p->adopt_taken);
	push_replace_free(p);
	if (p->pushes) {
		pending_free(p->pushes->datasets, p->pending);
		uncharge(p->pushes->core, p->charged);
	}
	free(p->sources);
	free(p->scale_xy);
	free(p->scale_z);
	free(p->format);
	free(p->utm);
	free(p->geoid);
	free(p->geoid_way);
	free(p->last);
	lock_done(&p->space.lock);
	push_guard_free(&p->row_guard);
	grid_manifest_free(p->base);
	grid_manifest_free(p->made);
	dataset_next_clear(&p->becomes);
	free(p);
	return NULL;
}

static void ask_free(struct push_ask *a)
{
	push_hash_free(&a->hashing);
	io_close(a->fd);
	free(a->name);
	free(a->format);
	free(a->columns);
	free(a->path);
	free(a->replaces);
	free(a);
}

struct push_ask *push_ask_new(struct push *p, enum push_kind kind, void *token, bool front)
{
	struct push_ask *a = calloc(1, sizeof *a);

	if (!a)
		return NULL;
	a->push = p;
	a->kind = kind;
	a->token = token;
	a->fd = -1;
	a->err = ERR_INIT;
	if (front) {
		a->next = p->asks;
		p->asks = a;
		if (!a->next)
			p->asks_end = &a->next;
	} else {
		*p->asks_end = a;
		p->asks_end = &a->next;
	}
	return a;
}

void push_ask_over(struct push *p)
{
	struct push_ask *a = p->asks;

	p->asks = a->next;
	if (!p->asks)
		p->asks_end = &p->asks;
	if (a->kind == PUSH_FILE || a->kind == PUSH_PROBE)
		p->unanswered--;
	ask_free(a);
	p->busy = false;
	p->asked_ns = clock_mono_ns();
}

static void close_done(struct push *p)
{
	struct push **at;

	for (at = &p->pushes->first; *at != p; at = &(*at)->next)
		;
	*at = p->next;
	admission_remove_stage(p->pushes->admission, &p->admission);
	dataset_plan_end(p->dataset, p);
	dataset_commit_end(p->dataset, p);
	dataset_release(p->dataset);
	while (p->asks)
		push_ask_over(p);
	push_free(p);
}

/* True if the push is still there. */
static bool finish_first(struct push *p, const struct err *why)
{
	struct push_ask *a = p->asks;
	bool last = a->kind == PUSH_CLOSE;

	if (!push_rows[a->kind].done(p, a, why))
		return true;
	push_ask_over(p);
	if (last) {
		close_done(p);
		return false;
	}
	return true;
}

void push_task_over(struct push *p)
{
	if (finish_first(p, p->asks->r ? &p->asks->err : NULL))
		push_pump(p);
}

static void task_run(struct sched_task *t)
{
	struct push *p = (struct push *)((char *)t - offsetof(struct push, task));

	push_rows[p->asks->kind].run(p, p->asks);
}

static void task_done(struct sched_task *t)
{
	struct push *p = (struct push *)((char *)t - offsetof(struct push, task));
	struct push_ask *a = p->asks;

	if (t->ran && t->bytes && a->kind != PUSH_STAGE)
		sched_give(p->pushes->core->p.sched, t->name, t->bytes);
	if (!t->ran) {
		a->r = -ERR_CANCELLED;
		err_set(&a->err, ERR_CANCELLED, "the push was ended");
	}
	push_task_over(p);
}

/* What is asked from here on is answered with this, and may be about a file that has no part in it: so it says what it is about.
 */
void push_break(struct push *p, const struct err *why)
{
	struct err *err = &p->broken_err;

	if (p->broken)
		return;
	push_tell_failed(p, why);
	p->broken = true;
	*err = *why;
	snprintf(err->message, sizeof err->message, "the push%s%s cannot go on: %.400s", p->dataset->onestep ? "" : " into ",
		 p->dataset->onestep ? "" : p->dataset->name, *why->message ? why->message : err_wire_name(why->code));
	err_add_place(err, ERR_NO_OFFSET, "push");
}

/* What is asked of a push that is closing, or whose stage broke, is answered with the reason. */
static const struct err *refusal(const struct push *p, const struct push_ask *a, struct err *err)
{
	if (a->kind == PUSH_CLOSE || a->kind == PUSH_ABORT)
		return NULL;
	if (p->left) {
		err_set(err, ERR_CANCELLED, "the push was ended");
		return err;
	}
	if (p->broken && a->kind != PUSH_BEGIN)
		return &p->broken_err;
	/* Aborted: what waits for a pipe or for memory before the abort would keep it waiting too. */
	if (atomic_load(&p->cancel)) {
		err_set(err, ERR_CANCELLED, "the push was ended");
		return err;
	}
	return NULL;
}

/* What writes nothing need not wait until the next start would know of the push. Points go into memory; who runs out of that
 * waits then (push_row_wait). A plan may give up what an interrupted push left, and a stage goes on from there: not for a push
 * that may never be one. */
static bool before_row(const struct push_ask *a)
{
	return a->kind == PUSH_PROBE ||
	       (!a->push->adopt && (a->kind == PUSH_PLAN || a->kind == PUSH_STAGE || a->kind == PUSH_FILE));
}

void push_pump(struct push *p)
{
	while (p->asks && !p->busy && !p->waiting_row && (!p->row_comes || before_row(p->asks))) {
		struct push_ask *a = p->asks;
		struct err err = ERR_INIT;
		const struct err *why = refusal(p, a, &err);
		int r = 0;

		p->busy = true;
		p->task = (struct sched_task){
			.run = task_run, .done = task_done, .owner = p->owner, .priority = SCHED_NORMAL, .lengthy = true};
		if (!why && push_rows[a->kind].start)
			r = push_rows[a->kind].start(p, a, &err);
		if (r == PUSH_WAIT) {
			p->busy = false;
			return;
		}
		if (p->asks != a) {
			/* Something of our own goes before it. */
			p->busy = false;
			continue;
		}
		if (!why && !r) {
			sched_submit(p->pushes->core->p.sched, &p->task);
			return;
		}
		if (!finish_first(p, why ? why : r < 0 ? &err : NULL))
			return;
	}
}

/* ---- what is asked ---- */

static char *copy(const char *text)
{
	return strdup(text ? text : "");
}

static struct dataset *target(struct pushes *pushes, const struct push_params *in, struct err *err)
{
	struct dataset *d;

	if (!*in->dataset)
		return dataset_new(pushes->datasets, "", &in->peer, true, err);
	if (!dataset_name_valid(in->dataset)) {
		err_set(err, ERR_USAGE, "\"%.80s\" cannot name a dataset", in->dataset);
		err_add_hint(err, "use up to %d letters, digits, '_', '-' and '.', not starting with '.' or '-'",
			     DATASET_NAME_MAX);
		return NULL;
	}
	d = dataset_find(pushes->datasets, in->dataset, &in->peer);
	if (d)
		return dataset_rights(d, &in->peer, RIGHT_WRITE, err) ? NULL : d;
	if (dataset_limit(pushes->datasets, &in->peer, err))
		return NULL;
	d = dataset_new(pushes->datasets, in->dataset, &in->peer, false, err);
	if (d)
		dataset_set_mode(d, in->has_mode ? in->mode & MODE_ALL : DATASET_MODE);
	return d;
}

/* One user may have half of what others leave: something is left for the next, and for administrators. */
static bool too_many(const struct pushes *pushes, const struct peer *peer)
{
	const struct push *p;
	unsigned n = 0, own = 0;

	for (p = pushes->first; p; p = p->next) {
		n++;
		own += p->peer.uid == peer->uid;
	}
	return n >= PUSHES_MAX || (!rights_admin(peer) && own >= (PUSHES_MAX - (n - own)) / 2);
}

static int check_crop(const struct push_params *in, struct err *err)
{
	const double *c = in->crop;

	if (!in->ncrop)
		return 0;
	if (in->ncrop != 4 || !(c[0] <= c[2] && c[1] <= c[3]) || !isfinite(c[0]) || !isfinite(c[1]) || !isfinite(c[2]) ||
	    !isfinite(c[3])) {
		err_set(err, ERR_PROTO, "a crop must be x1, y1, x2, y2, with the smaller ones first");
		return err_add_place(err, ERR_NO_OFFSET, "crop");
	}
	if (*in->dataset) {
		err_set(err, ERR_USAGE, "a named dataset is pushed whole: its views are not known beforehand");
		err_add_hint(err, "crop the view, not the push");
		return err_add_place(err, ERR_NO_OFFSET, "crop");
	}
	return 0;
}

void push_begin(struct pushes *pushes, const struct push_params *in, void *token)
{
	struct push *p = calloc(1, sizeof *p);
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	disk_restore_folders(pushes->core);
	if (p) {
		lock_init(&p->space.lock, LOCK_PUSH_SPACE);
		push_guard_init(&p->row_guard);
		p->space.why = ERR_INIT;
		p->asks_end = &p->asks;
		p->scale_xy = copy(in->scale_xy);
		p->scale_z = copy(in->scale_z);
		p->format = copy(in->format);
		p->utm = copy(in->utm);
		p->geoid = copy(in->geoid);
		p->geoid_way = copy(in->geoid_way);
		p->last = calloc(1, sizeof *p->last);
		p->pushes = pushes;
		if (!charge(pushes->core, PUSH_BYTES, "another push", &err)) {
			p->charged = PUSH_BYTES;
			p->pending = pending_new(pushes->datasets, in->peer.uid, &err);
		}
	}
	if (err.code)
		;
	else if (!p || !p->scale_xy || !p->scale_z || !p->format || !p->utm || !p->geoid || !p->geoid_way || !p->last)
		err_set(&err, ERR_NOMEM, "no memory for a push");
	else if (pushes->core->stopping)
		err_set(&err, ERR_BUSY, "the daemon is stopping");
	else if (too_many(pushes, &in->peer))
		err_set(&err, ERR_BUSY, "too many pushes are open, of all users or of this one");
	else if (!push_assume_read(p, in, &err) && !check_crop(in, &err))
		p->dataset = target(pushes, in, &err);
	if (!err.code && !push_ask_new(p, PUSH_BEGIN, token, false))
		err_set(&err, ERR_NOMEM, "no memory for a push");
	if (err.code) {
		if (p && p->dataset) {
			dataset_hold(p->dataset);
			dataset_release(p->dataset);
		}
		if (p)
			free(p->asks);
		push_free(p);
		in->calls->begun(token, &err, NULL);
		return;
	}
	p->last->push = p;
	p->last->kind = PUSH_CLOSE;
	p->last->fd = -1;
	p->last->err = ERR_INIT;
	dataset_hold(p->dataset);
	dataset_push_begin(p->dataset);
	p->id = ++pushes->core->last_push;
	p->owner =
		(struct sched_owner){.uid = in->peer.uid, .flow = ++pushes->core->last_flow, .exempt = rights_admin(&in->peer)};
	p->calls = *in->calls;
	p->ctx = in->ctx;
	p->peer = rights_without_groups(&in->peer);
	p->space.owner = p->dataset->uid;
	p->planar = in->planar;
	p->accept_truncated = in->accept_truncated;
	p->strict = in->strict;
	p->has_crop = in->ncrop > 0;
	if (p->has_crop)
		memcpy(p->crop, in->crop, sizeof p->crop);
	p->begun_ns = p->synced_ns = p->asked_ns = clock_mono_ns();
	snprintf(p->crs, sizeof p->crs, "unknown");
	snprintf(p->unit_xy, sizeof p->unit_xy, "unknown");
	snprintf(p->unit_z, sizeof p->unit_z, "unknown");
	p->next = pushes->first;
	pushes->first = p;
	p->admission.calls = &push_stage_calls;
	p->admission.uid = p->peer.uid;
	admission_add_stage(pushes->admission, &p->admission);
	push_pump(p);
}

/* False: answered already. */
static bool ask_file(struct push *p, enum push_kind kind, int fd, const struct push_input *in, void *token)
{
	struct push_ask *a = push_ask_new(p, kind, token, false);

	if (!a) {
		io_close(fd);
		return false;
	}
	p->unanswered++;
	a->fd = fd;
	a->name = copy(in->name);
	a->format = copy(in->format && *in->format ? in->format : p->format);
	a->columns = copy(in->columns);
	a->decimal_comma = in->decimal_comma;
	/* One that is too long to be kept is nobody's. */
	a->path = copy(in->path && strlen(in->path) < GRID_SOURCE_PATH ? in->path : "");
	a->checksum = in->checksum;
	a->add = in->add;
	a->replace = in->replace;
	a->replaces = copy(in->replaces);
	a->stream = fd < 0 ? push_stream_find(p, in->name) : NULL;
	a->told = a->stream && in->told;
	a->told_size = in->size;
	if (a->told)
		a->hash = in->hash;
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
	if (!ask_file(p, PUSH_PROBE, fd, in, token))
		p->calls.probed(token, no_memory(&err), NULL);
}

void push_file(struct push *p, int fd, const struct push_input *in, void *token)
{
	struct err err;

	THREAD_LOOP_ONLY();
	if (!ask_file(p, PUSH_FILE, fd, in, token))
		p->calls.staged(token, no_memory(&err), NULL);
}

void push_plan(struct push *p, void *token)
{
	struct err err;

	THREAD_LOOP_ONLY();
	if (!push_ask_new(p, PUSH_PLAN, token, false))
		p->calls.planned(token, no_memory(&err), NULL);
	else
		push_pump(p);
}

void push_commit(struct push *p, void *token)
{
	struct err err;

	THREAD_LOOP_ONLY();
	if (!push_ask_new(p, PUSH_COMMIT, token, false))
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
	if (!push_ask_new(p, PUSH_ABORT, token, false))
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
	/* A commit that is under way is carried through. */
	if (!p->busy || p->asks->kind != PUSH_COMMIT) {
		atomic_store(&p->cancel, true);
		push_streams_wake(p);
		push_row_wake(p);
		if (p->busy)
			sched_cancel(p->pushes->core->p.sched, &p->task);
	}
	*p->asks_end = p->last;
	p->asks_end = &p->last->next;
	p->last = NULL;
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

/* What it keeps of its files does not count while it waits for its stage: pushes of one user would wait for each other. */
static uint64_t stage_held(const struct admission_stage *s)
{
	const struct push *p = push_of(s);

	return p->stage_bytes ? p->stage_bytes + push_keeps(p) : 0;
}

static bool stage_wants(const struct admission_stage *s)
{
	return push_wants_stage(push_of(s));
}

static bool stage_fits(const struct admission_stage *s)
{
	const struct push *p = push_of(s);

	return admission_user_available(p->pushes->admission, &p->owner, NULL) >= GRID_STAGE_MIN + p->read_bytes + push_keeps(p);
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

	if (p->lacks && !p->again) {
		p->lacks = false;
		if (!finish_first(p, refusal(p, p->asks, &err)))
			return;
	}
	push_pump(p);
}

/* For a stop that cannot wait: its own files and no others. What others have in that folder may be promised, or be named by a row
 * that is on its way to the disk; the next start knows all of it. */
void push_remove_files(struct push *p)
{
	struct err err = ERR_INIT;
	char name[64];

	/* What the next start can go on with stays. */
	if (p->committed || p->on_disk || p->dataset->onestep || (p->busy && p->asks->kind == PUSH_COMMIT) ||
	    dataset_open(p->dataset, &err))
		return;
	pending_stage_name(p->id, name);
	strcat(name, ".");
	if (io_folder_sweep(p->dataset->dirfd, name, &err))
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "the files of a push cannot be removed", &err);
	dataset_close(p->dataset);
}

static void tell_progress(struct push *p, const struct push_ask *a)
{
	uint64_t hash_end = atomic_load(&p->hash_end), done = atomic_load(&p->progress), all = atomic_load(&p->claimed);

	if (a->kind != PUSH_FILE && a->kind != PUSH_COMMIT && !hash_end)
		return;
	p->told_ns = clock_mono_ns();
	if (hash_end)
		p->calls.progress(a->token, "hash", atomic_load(&p->hashed), hash_end);
	else if (a->kind == PUSH_FILE)
		p->calls.progress(a->token, "stage", done, all);
	else
		p->calls.progress(a->token, "seal", a->sealing ? done : 0, a->sealing ? all : 0);
}

void push_tick(struct push *p)
{
	struct push_ask *a = p->asks;

	push_space_tick(p);
	/* Once a tick: a worker is asked each time. */
	if (p->again)
		p->again = p->lacks = p->busy = false;
	if (a && p->busy && !p->left && clock_since(p->told_ns) >= PROGRESS_SECONDS)
		tell_progress(p, a);
	if (!a && p->stage && !p->dataset->onestep && p->durable < p->files && !p->broken &&
	    clock_since(p->synced_ns) >= DURABLE_SECONDS)
		push_ask_new(p, PUSH_SYNC, NULL, false);
	else if (!a && p->stage && !p->broken && clock_since(p->asked_ns) >= IDLE_SECONDS)
		push_ask_new(p, PUSH_PARK, NULL, false);
	push_pump(p);
}
