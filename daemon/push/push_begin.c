/*
 * The beginning of a push: the newest manifest of the dataset, the pending pushes of the same user, and then the push's row in
 * the catalogue, so that the next start finds what the push writes.
 *
 * Nobody waits for the row: it reaches the disk while headers are read, and points go into memory. Whatever writes comes after it
 * (push_pump, push_row_wait).
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "mode.h"
#include "push_priv.h"

int push_begin_start(struct push *p, struct push_request *rq, struct err *err)
{
	const struct push *other;

	/* A push of the same user is just ending: it may be pending in a moment. */
	for (other = p->pushes->first; other; other = other->next)
		if (other != p && other->dataset == p->dataset && other->left && other->peer.uid == p->peer.uid)
			return PUSH_WAIT;
	memcpy(p->base_name, p->dataset->manifest, sizeof p->base_name);
	if (!p->reading_base)
		dataset_read_begin(p->dataset);
	p->reading_base = true;
	return push_offers_list(p, err);
}

/* There is no memory for a manifest now: it begins again later. */
static void release_base(struct push *p)
{
	names_free(&p->base_paths);
	p->base = grid_manifest_free(p->base);
	push_offers_forget(p);
	if (p->opened)
		dataset_close(p->dataset);
	p->opened = false;
}

void push_begin_run(struct push *p, struct push_request *rq)
{
	rq->err = ERR_INIT;
	rq->r = dataset_open(p->dataset, &rq->err);
	p->opened = !rq->r;
	if (!rq->r && *p->base_name)
		rq->r = grid_manifest_load(p->dataset->dirfd, p->base_name, p->pushes->core->p.ledger, &p->base, &rq->err);
	if (!rq->r)
		rq->r = push_agree_begin(p, &rq->err);
	if (!rq->r && p->base)
		rq->r = push_known_index(p->base, &p->base_paths, &rq->err);
	if (!rq->r)
		rq->r = push_offers_read(p, &rq->err);
	if (rq->r == -ERR_BUSY)
		release_base(p);
}

static void begin_answer(struct push *p, const struct err *why)
{
	struct push_begun begun = {.push = p, .id = p->id, .lattice = "", .note = p->note};
	char lattice[LATTICE_TEXT_SIZE];
	const struct push_calls calls = p->calls;
	const struct err copy = why ? *why : ERR_INIT; /* `why` may be in the request, which is freed first */
	void *token = p->requests->token;

	if (p->agree.has_lattice)
		begun.lattice = lattice_text(&p->agree.lattice, lattice);
	push_request_end(p);
	if (why)
		push_leave(p);
	calls.begun(token, why ? &copy : NULL, why ? NULL : &begun);
}

static void row_written(void *ctx, int r, const struct err *why)
{
	struct push *p = ctx;

	admission_guard_lock(&p->row_guard);
	p->row_queued = false;
	p->has_row = !r;
	if (r && !p->left)
		push_break(p, why);
	admission_guard_wake(&p->row_guard);
	admission_guard_unlock(&p->row_guard);
	push_pump(p);
}

int push_row_wait(void *push, struct err *err)
{
	struct push *p = push;
	int r;

	admission_guard_lock(&p->row_guard);
	while (p->row_queued && !atomic_load(&p->cancel)) {
		p->row_awaited = true;
		admission_guard_wait(&p->row_guard);
	}
	/* A push that leaves when the row is there still writes what is to stay. */
	if (!p->row_queued && (p->has_row || p->dataset->onestep))
		r = 0;
	else if (!p->row_queued && p->broken)
		r = -(int)(*err = p->broken_err).code;
	else
		r = err_set(err, ERR_CANCELLED, "the push was ended");
	admission_guard_unlock(&p->row_guard);
	return r;
}

void push_row_wake(struct push *p)
{
	admission_guard_lock(&p->row_guard);
	admission_guard_wake(&p->row_guard);
	admission_guard_unlock(&p->row_guard);
}

static int take_lattice(struct push *p, struct err *err)
{
	const struct grid_manifest *m = p->base;
	size_t i;

	p->agree.has_lattice = true;
	p->agree.lattice = m->lattice;
	p->base_generation = m->generation;
	agree_fix(&p->agree, m->crs, m->unit_xy, m->unit_z);
	for (i = 0; i < m->nsources; i++)
		dataset_sources_from(p->dataset, m->sources[i].id + 1);
	if (*p->agree.scale_xy || *p->agree.scale_z) {
		struct decimal d;

		if ((*p->agree.scale_xy && (!decimal_parse(p->agree.scale_xy, &d) || decimal_compare(d, m->lattice.scale_xy))) ||
		    (*p->agree.scale_z && (!decimal_parse(p->agree.scale_z, &d) || decimal_compare(d, m->lattice.scale_z)))) {
			err_set(err, ERR_USAGE, "the dataset %s has another scale", p->dataset->name);
			return err_add_hint(err, "leave the scale out, or push into a new dataset");
		}
	}
	return 0;
}

/* The manifest of the dataset, and what the commit makes of it. */
static uint64_t base_bytes(const struct push *p)
{
	const struct grid_manifest *m = p->base;

	return m ? names_bytes(&p->base_paths) +
			       4 * (m->nsources * sizeof *m->sources + m->texts_bytes + m->nsegments * sizeof *m->segments) :
		   0;
}

/* Once: takes over the base. */
static int take_base(struct push *p, const struct err *why, struct err *err)
{
	if (!why)
		push_offers_settle(p);
	if (dataset_created(p->dataset))
		snprintf(p->agree.created, sizeof p->agree.created, "%s", p->dataset->crs);
	p->base_settled = true;
	if (!why && p->base && take_lattice(p, err))
		return -(int)err->code;
	return why ? 0 : push_created_scale(p, err);
}

/* If there is never memory for the pending pushes, it does without them. */
static int reserve(struct push *p, struct err *err)
{
	int r = push_table_reserve(p, base_bytes(p) + push_offers_bytes(p), err);

	if (r >= 0 || !p->noffers)
		return r;
	push_offers_free(p);
	err_clear(err);
	return push_table_reserve(p, base_bytes(p), err);
}

bool push_begin_done(struct push *p, struct push_request *rq, const struct err *why)
{
	struct err err = ERR_INIT;
	struct catalogue_push row = {
		.dataset = p->dataset->id,
		.uid = p->peer.uid,
		.begun_us = clock_real_us(),
	};
	int r = 0;

	if (p->reading_base)
		dataset_read_end(p->dataset);
	p->reading_base = false;
	if (why && why->code == ERR_BUSY && p->task.ran && !p->left && !push_must_refuse(p)) {
		p->waits_memory = p->retry = true;
		return false;
	}
	if (!p->base_settled)
		r = take_base(p, why, &err);
	if (!why && !r)
		r = reserve(p, &err);
	p->waits_memory = r == PUSH_WAIT;
	if (p->waits_memory)
		return false;
	if (!why && r)
		why = &err;
	if (!why && !p->dataset->onestep) {
		row.id = p->id;
		p->row_queued = true;
		if (dataset_put_row(p->dataset, &err) ||
		    catalogue_put_push(p->pushes->core->p.catalogue, &row, row_written, p, &err)) {
			p->row_queued = false;
			why = &err;
		}
	}
	begin_answer(p, why);
	return false;
}

char *push_copy_text(const char *text)
{
	return strdup(text ? text : "");
}

static struct dataset *find_or_make_dataset(struct pushes *pushes, const struct push_params *in, struct err *err)
{
	struct dataset *d;

	if (!*in->dataset)
		return dataset_new(pushes->datasets, "", &in->peer, true, err);
	if (dataset_name_check(in->dataset, err))
		return NULL;
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

/* One user may have half of what others leave, so something is left for the next user, and for administrators. */
static bool too_many_pushes(const struct pushes *pushes, const struct peer *peer)
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

/* NULL: err says why. */
static struct push *push_new(struct pushes *pushes, const struct push_params *in, struct err *err)
{
	struct push *p = calloc(1, sizeof *p);

	if (!p) {
		err_set(err, ERR_NOMEM, "no memory for a push");
		return NULL;
	}
	lock_init(&p->space.lock, LOCK_PUSH_SPACE);
	admission_guard_init(&p->row_guard);
	p->space.why = ERR_INIT;
	p->requests_end = &p->requests;
	p->format = push_copy_text(in->format);
	p->close_request = calloc(1, sizeof *p->close_request);
	p->pushes = pushes;
	if (!charge(pushes->core, PUSH_BYTES, "another push", err)) {
		p->charged = PUSH_BYTES;
		p->pending = pending_new(pushes->datasets, in->peer.uid, err);
	}
	if (!err->code && (agree_init(&p->agree, &in->says, err) || !p->format || !p->close_request))
		err_set(err, ERR_NOMEM, "no memory for a push");
	return err->code ? push_free(p) : p;
}

static int check_begin(struct pushes *pushes, struct push *p, const struct push_params *in, struct err *err)
{
	int r;

	if (pushes->core->stopping)
		return err_set(err, ERR_BUSY, "the daemon is stopping");
	if (too_many_pushes(pushes, &in->peer))
		return err_set(err, ERR_BUSY, "too many pushes are open, of all users or of this one");
	r = agree_said(&p->agree, &in->says, err);
	if (!r && p->agree.said_wkt && !(r = charge(pushes->core, strlen(p->agree.said_wkt), "another push", err)))
		p->charged += strlen(p->agree.said_wkt);
	return r ? r : check_crop(in, err);
}

static void push_init(struct push *p, const struct push_params *in)
{
	struct pushes *pushes = p->pushes;

	p->close_request->push = p;
	p->close_request->kind = PUSH_CLOSE;
	p->close_request->fd = -1;
	p->close_request->err = ERR_INIT;
	p->id = p->stem = ++pushes->core->last_push;
	p->owner =
		(struct sched_owner){.uid = in->peer.uid, .flow = ++pushes->core->last_flow, .exempt = rights_admin(&in->peer)};
	p->calls = *in->calls;
	p->ctx = in->ctx;
	p->peer = rights_without_groups(&in->peer);
	p->space.owner = p->dataset->uid;
	p->agree.dataset = p->dataset->name;
	p->agree.grows = !p->dataset->onestep;
	p->accept_truncated = in->accept_truncated;
	p->strict = in->strict;
	p->has_crop = in->ncrop > 0;
	if (p->has_crop)
		memcpy(p->crop, in->crop, sizeof p->crop);
	p->begun_ns = p->synced_ns = p->asked_ns = clock_mono_ns();
	p->next = pushes->first;
	pushes->first = p;
	p->admission.calls = &push_stage_calls;
	p->admission.uid = p->peer.uid;
	admission_add_stage(pushes->admission, &p->admission);
}

void push_begin(struct pushes *pushes, const struct push_params *in, void *token)
{
	struct err err = ERR_INIT;
	struct push *p;

	THREAD_LOOP_ONLY();
	disk_restore_folders(pushes->core);
	p = push_new(pushes, in, &err);
	if (p && !check_begin(pushes, p, in, &err))
		p->dataset = find_or_make_dataset(pushes, in, &err);
	if (p && p->dataset)
		dataset_hold(p->dataset);
	if (!err.code && !push_request_new(p, PUSH_BEGIN, token, false))
		err_set(&err, ERR_NOMEM, "no memory for a push");
	if (err.code) {
		if (p && p->dataset)
			dataset_release(p->dataset); /* removes a new one */
		push_free(p);
		in->calls->begun(token, &err, NULL);
		return;
	}
	dataset_push_begin(p->dataset);
	push_init(p, in);
	push_pump(p);
}
