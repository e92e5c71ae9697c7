/*
 * Pending pushes: pushes that were interrupted.
 *
 * The model: a push leaves its stage in the dataset's folder, and beside it a manifest without segments, push-ID.pending
 * (push_pending.c). When its connection or its daemon ends, the push is pending: an entry of its dataset in memory, which holds
 * the dataset, and a row in the catalogue. It stays for 7 days, or until a push of the same user takes it up.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "breaklines.h"
#include "dataset_priv.h"
#include "grid_stage.h"
#include "io.h"

#define PENDING_US (7 * INT64_C(86400) * 1000000)

void pending_manifest_name(uint64_t id, char name[64])
{
	snprintf(name, 64, "push-%llu.pending", (unsigned long long)id);
}

void pending_stage_name(uint64_t id, char name[48])
{
	snprintf(name, 48, "push-%llu", (unsigned long long)id);
}

struct pending *pending_new(struct datasets *ds, uint32_t uid, struct err *err)
{
	struct pending *q;

	THREAD_LOOP_ONLY();
	if (charge_lasting(ds->core, CHARGE_JOB, uid, PENDING_BYTES, "another push", err))
		return NULL;
	q = calloc(1, sizeof *q);
	if (!q) {
		uncharge(ds->core, PENDING_BYTES);
		err_set(err, ERR_NOMEM, "no memory for a push");
	}
	return q;
}

struct pending *pending_free(struct datasets *ds, struct pending *q)
{
	THREAD_LOOP_ONLY();
	if (q)
		uncharge(ds->core, PENDING_BYTES);
	free(q);
	return NULL;
}

void pending_add(struct dataset *d, struct pending *q)
{
	pending_put_back(dataset_hold(d), q);
}

struct pending *pending_take(struct dataset *d, uint32_t uid)
{
	struct pending **at, *q;

	THREAD_LOOP_ONLY();
	for (at = &d->pending; *at && (*at)->uid != uid; at = &(*at)->next)
		;
	q = *at;
	if (q)
		*at = q->next;
	return q;
}

void pending_put_back(struct dataset *d, struct pending *q)
{
	THREAD_LOOP_ONLY();
	q->next = d->pending;
	d->pending = q;
}

/* Worker. */
int pending_discard(struct dataset *d, uint64_t id, struct err *err)
{
	char manifest[64], stage[48];
	int r;

	pending_manifest_name(id, manifest);
	pending_stage_name(id, stage);
	r = io_remove(d->dirfd, manifest, err);
	if (!r)
		r = grid_stage_discard(d->dirfd, stage, err);
	if (!r)
		r = breaklines_discard(d->dirfd, id, err);
	/* Durable before the row is dropped that leads to the files. */
	return r ? r : io_sync(d->dirfd, "the folder of a dataset", err);
}

uint64_t pending_points(const struct grid_manifest *m)
{
	uint64_t points = 0;

	for (size_t i = 0; m && i < m->nsources; i++)
		points += m->sources[i].points + (m->sources[i].lines ? m->sources[i].lines->vertices : 0);
	return points;
}

struct discard {
	struct sched_task task;
	int r;
	struct dataset *dataset;
	struct pending *pending;
};

static void discard_run(struct sched_task *t)
{
	struct discard *x = (struct discard *)t;
	struct err err = ERR_INIT;

	x->r = dataset_open(x->dataset, &err);
	if (!x->r) {
		x->r = pending_discard(x->dataset, x->pending->id, &err);
		dataset_close(x->dataset);
	}
	if (x->r)
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "what an interrupted push left cannot be removed", &err);
}

static void discard_done(struct sched_task *t)
{
	struct discard *x = (struct discard *)t;
	struct datasets *ds = x->dataset->datasets;

	core_background_done(ds->core);
	/* Otherwise the row stays, and the next start removes the files. */
	if (t->ran && !x->r)
		dataset_drop_row(x->dataset, x->pending->id);
	pending_free(ds, x->pending);
	dataset_release(x->dataset);
	free(x);
}

/* Drops `q`, which is out of the list: in the background, or at the next start if there is no memory for a task. */
static void discard(struct dataset *d, struct pending *q, const char *why)
{
	struct discard *x = calloc(1, sizeof *x);

	log_event(LOG_EVENT_PUSH_DROPPED, ABOUT_PENDING(q, d),
		  "the interrupted push %llu of user %u into %s is dropped with its %u files: %s", (unsigned long long)q->id,
		  q->uid, d->name, q->files, why);
	if (!x) {
		pending_free(d->datasets, q);
		dataset_release(d);
		return;
	}
	x->task = (struct sched_task){.run = discard_run, .done = discard_done, .owner = {.uid = d->uid}, .priority = SCHED_LAST};
	x->dataset = d;
	x->pending = q;
	core_background(d->datasets->core, &x->task);
}

void pending_expire(struct dataset *d)
{
	int64_t now = datasets_trusted_us(d->datasets);
	struct pending **at = &d->pending, *q;

	while ((q = *at)) {
		if (now - q->interrupted_us <= PENDING_US) {
			at = &q->next;
			continue;
		}
		*at = q->next;
		discard(d, q, "it is older than 7 days");
	}
}

void pending_forget(struct dataset *d)
{
	struct pending *q;

	while ((q = d->pending)) {
		d->pending = q->next;
		dataset_drop_row(d, q->id);
		pending_free(d->datasets, q);
		dataset_unhold(d);
	}
}

int64_t pending_until_us(const struct pending *q)
{
	return q->interrupted_us + PENDING_US;
}

static bool was_committed(const struct dataset *d, const struct grid_manifest *base, const struct grid_manifest *m, uint64_t id)
{
	char end[32];
	size_t n = strlen(d->manifest), k;

	snprintf(end, sizeof end, "-%llu", (unsigned long long)id);
	k = strlen(end);
	if (n > k && !strcmp(d->manifest + n - k, end))
		return true;
	for (size_t i = 0; base && m && m->nsources && i < base->nbatches; i++)
		if (m->sources[0].id - base->batches[i].first < base->batches[i].n)
			return true;
	return false;
}

/* A row of the catalogue, before the loop runs. *ret_stays: the push is pending; otherwise its row goes. */
int pending_load(struct dataset *d, const struct catalogue_push *row, bool *ret_stays, struct err *err)
{
	struct grid_manifest *m = NULL, *base = NULL;
	struct pending *q = pending_new(d->datasets, row->uid, err);
	struct err absent = ERR_INIT;
	bool committed;
	char name[64];
	int r = q ? dataset_open(d, err) : -(int)err->code;

	*ret_stays = false;
	if (r) {
		pending_free(d->datasets, q);
		return r;
	}
	if (*d->manifest)
		r = grid_manifest_load_bare(d->dirfd, d->manifest, d->datasets->core->p.ledger, &base, err);
	pending_manifest_name(row->id, name);
	if (!r) {
		r = grid_manifest_load(d->dirfd, name, d->datasets->core->p.ledger, &m, &absent);
		/* A push that cannot be read now is kept. */
		if (r && (absent.sys == ENOENT || r == -ERR_CORRUPT))
			r = 0;
		else if (r)
			*err = absent;
	}
	dataset_close(d);
	committed = !r && was_committed(d, base, m, row->id);
	if (!r && m && !committed) {
		*q = (struct pending){.id = row->id, .uid = row->uid, .interrupted_us = row->begun_us};
		q->files = (uint32_t)m->nsources;
		q->points = pending_points(m);
		for (size_t i = 0; i < m->nsources; i++)
			dataset_sources_from(d, m->sources[i].id + 1);
	}
	/* Its age is judged later, by the trusted clock (pending_expire). */
	if (!r && m && !committed) {
		*ret_stays = true;
		q->next = d->pending;
		d->pending = q;
		dataset_hold(d);
		log_event(LOG_EVENT_PUSH_PENDING, ABOUT_PENDING(q, d), "push %llu of user %u into %s is pending: %u files",
			  (unsigned long long)q->id, q->uid, d->name, q->files);
		q = NULL;
	} else if (!r && !committed) {
		log_event(LOG_EVENT_PUSH_DROPPED, &(struct log_about){.push = row->id, .dataset = d->name, ABOUT_USER(row->uid)},
			  "push %llu of user %u into %s was interrupted: nothing of it was durable yet",
			  (unsigned long long)row->id, row->uid, d->name);
	}
	pending_free(d->datasets, q);
	grid_manifest_free(m);
	grid_manifest_free(base);
	return r;
}
