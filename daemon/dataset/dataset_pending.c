/*
 * Pending pushes: pushes that were interrupted.
 *
 * The model: a push leaves its stage in the dataset's folder, and beside it a manifest without segments, push-ID.pending
 * (push_pending.c). When its connection or its daemon ends, the push is pending: an entry of its dataset in memory, which holds
 * the dataset, and a row in the catalogue. Each of its files stays until a push of the same user commits it or they are
 * discarded, or for 7 days.
 *
 * A file that is in the dataset's manifest, too, was committed: the crash came before the list in push-ID.pending was shortened.
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

/* The list is sorted by time, so that what is dropped first comes last. */
static void insert(struct dataset *d, struct pending *q)
{
	struct pending **at = &d->pending;

	while (*at && (*at)->interrupted_us > q->interrupted_us)
		at = &(*at)->next;
	q->stamp = ++d->datasets->pending_stamp;
	q->next = *at;
	*at = q;
}

void pending_add(struct dataset *d, struct pending *q)
{
	THREAD_LOOP_ONLY();
	insert(dataset_hold(d), q);
}

struct pending *pending_take(struct dataset *d, uint64_t id, uint64_t stamp)
{
	struct pending **at, *q;

	THREAD_LOOP_ONLY();
	for (at = &d->pending; *at && ((*at)->id != id || (*at)->stamp != stamp); at = &(*at)->next)
		;
	q = *at;
	if (q)
		*at = q->next;
	return q;
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

uint64_t pending_source_points(const struct grid_source *s)
{
	return s->points + (s->lines ? s->lines->vertices : 0);
}

uint64_t pending_points(const struct grid_manifest *m)
{
	uint64_t points = 0;

	for (size_t i = 0; m && i < m->nsources; i++)
		points += pending_source_points(&m->sources[i]);
	return points;
}

uint64_t pending_bytes(int dirfd, uint64_t id, uint64_t points)
{
	uint64_t bytes = datasets_points_bytes(points), of_runs;
	struct err ignored = ERR_INIT; /* whoever continues it reports what cannot be read */
	char stage[48];
	uint32_t last;

	/* Runs may also have points of files that are committed, or were not read whole. */
	pending_stage_name(id, stage);
	return !grid_stage_check(dirfd, stage, &last, &of_runs, &ignored) && of_runs > bytes ? of_runs : bytes;
}

/* A request to discard some: answered when the last of them is removed. */
struct discards {
	unsigned left;
	struct datasets *datasets;
	struct discarded sum;
	struct err why; /* of the first that cannot be removed */
	discard_answer_fn *answer;
	void *token;
};

struct discard {
	struct sched_task task;
	int r;
	struct err why;
	struct dataset *dataset;
	struct pending *pending;
	struct discards *of; /* NULL: nobody waits for it */
};

static void discard_run(struct sched_task *t)
{
	struct discard *x = (struct discard *)t;

	x->r = dataset_open(x->dataset, &x->why);
	if (!x->r) {
		x->r = pending_discard(x->dataset, x->pending->id, &x->why);
		dataset_close(x->dataset);
	}
	if (x->r && !x->of)
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "what an interrupted push left cannot be removed", &x->why);
}

static void log_dropped(const struct dataset *d, const struct pending *q, const char *why)
{
	log_event(LOG_EVENT_PUSH_DROPPED, ABOUT_PENDING(q, d),
		  "the interrupted push %llu of user %u into %s is dropped with its %u files: %s", (unsigned long long)q->id,
		  q->uid, d->name, q->files, why);
}

static void discards_end(struct discards *all)
{
	if (--all->left)
		return;
	datasets_count(all->datasets);
	all->answer(all->token, all->why.code ? &all->why : NULL, &all->sum);
	free(all);
}

/* One that cannot be removed is pending as before. */
static void keep(struct dataset *d, struct pending *q, const struct err *why, struct discards *of)
{
	insert(d, q);
	if (!of->why.code)
		of->why = *why;
}

static void discard_asked(struct discard *x)
{
	struct discards *of = x->of;
	struct pending *q = x->pending;

	if (!x->task.ran)
		err_set(&x->why, ERR_CANCELLED, "acutd stops before all interrupted pushes are discarded");
	if (x->why.code) {
		keep(x->dataset, q, &x->why, of);
	} else {
		of->sum.pushes++;
		of->sum.files += q->files;
		of->sum.bytes += q->bytes;
		log_dropped(x->dataset, q, "it was discarded");
		dataset_drop_row(x->dataset, q->id);
		pending_free(of->datasets, q);
		dataset_release(x->dataset);
	}
	discards_end(of);
}

static void discard_done(struct sched_task *t)
{
	struct discard *x = (struct discard *)t;
	struct datasets *ds = x->dataset->datasets;

	core_background_done(ds->core);
	if (x->of) {
		discard_asked(x);
	} else {
		/* Otherwise the row stays, and the next start removes the files. */
		if (t->ran && !x->r)
			dataset_drop_row(x->dataset, x->pending->id);
		pending_free(ds, x->pending);
		dataset_release(x->dataset);
	}
	free(x);
}

static void submit(struct discard *x, struct dataset *d, struct pending *q, uint32_t uid, enum sched_priority priority)
{
	x->task = (struct sched_task){.run = discard_run, .done = discard_done, .owner = {.uid = uid}, .priority = priority};
	x->dataset = d;
	x->pending = q;
	core_background(d->datasets->core, &x->task);
}

/* If there is no memory for a task, the next start removes the files. */
void pending_drop(struct dataset *d, struct pending *q, const char *why)
{
	struct discard *x = calloc(1, sizeof *x);

	log_dropped(d, q, why);
	if (!x) {
		pending_free(d->datasets, q);
		dataset_release(d);
		return;
	}
	submit(x, d, q, d->uid, SCHED_LAST);
}

static void discard_of(struct dataset *d, const struct peer *peer, bool all, struct discards *of)
{
	struct pending **at = &d->pending, *q;

	while ((q = *at)) {
		bool meant = all || q->uid == peer->uid;
		struct discard *x = meant ? calloc(1, sizeof *x) : NULL;

		if (!x) {
			at = &q->next;
			if (meant)
				err_set(&of->why, ERR_NOMEM, "no memory for a request");
			continue;
		}
		*at = q->next;
		x->of = of;
		of->left++;
		submit(x, d, q, peer->uid, SCHED_FIRST);
	}
}

void dataset_discard(struct datasets *ds, const char *name, const struct peer *peer, bool all, discard_answer_fn *answer,
		     void *token)
{
	struct discards *of = calloc(1, sizeof *of);
	struct dataset *there = dataset_find(ds, name, peer);
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (!of) {
		err_set(&err, ERR_NOMEM, "no memory for a request");
		answer(token, &err, NULL);
		return;
	}
	*of = (struct discards){.left = 1, .datasets = ds, .why = ERR_INIT, .answer = answer, .token = token};
	if (all && there)
		dataset_rights(there, peer, RIGHT_OWN, &of->why);
	for (struct dataset *d = ds->first; d && !of->why.code; d = d->next)
		if ((d == there || (d->removed_us && !strcmp(d->name, name))) &&
		    (!all || rights_allow(peer, RIGHT_OWN, d->uid, d->gid, d->mode)))
			discard_of(d, peer, all, of);
	/* Who has one may discard it, also without any right by now. */
	if (of->left == 1 && !of->why.code)
		dataset_access(ds, name, peer, all ? RIGHT_OWN : RIGHT_READ, &there, &of->why);
	discards_end(of);
}

static unsigned newer_ones(const struct dataset *d, const struct pending *of)
{
	unsigned n = 0;

	for (const struct pending *q = d->pending; q != of; q = q->next)
		n += q->uid == of->uid;
	return n;
}

void pending_expire(struct dataset *d)
{
	int64_t now = datasets_trusted_us(d->datasets);
	struct pending **at = &d->pending, *q;

	while ((q = *at)) {
		bool old = now - q->interrupted_us > PENDING_US;
		char why[80] = "it is older than 7 days";

		if (!old && newer_ones(d, q) < PENDING_MOST) {
			at = &q->next;
			continue;
		}
		if (!old)
			snprintf(why, sizeof why, "its user has %d newer ones in the dataset, as many as are kept", PENDING_MOST);
		*at = q->next;
		pending_drop(d, q, why);
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

/* The push with that number made the newest manifest. */
static bool has_committed(const struct dataset *d, uint64_t id)
{
	char end[32];
	size_t n = strlen(d->manifest), k;

	snprintf(end, sizeof end, "-%llu", (unsigned long long)id);
	k = strlen(end);
	return n > k && !strcmp(d->manifest + n - k, end);
}

static bool is_committed(const struct grid_manifest *base, const struct grid_source *s)
{
	for (size_t i = 0; base && i < base->nbatches; i++)
		if (s->id - base->batches[i].first < base->batches[i].n)
			return true;
	return false;
}

void pending_leave_out(struct grid_manifest *m, const struct grid_manifest *base)
{
	size_t n = 0;

	for (size_t i = 0; i < m->nsources; i++)
		if (!is_committed(base, &m->sources[i]))
			m->sources[n++] = m->sources[i];
	m->nsources = n;
}

/* The list of files on the disk becomes that in memory. */
static void leave_pending(struct dataset *d, const char *name, struct grid_manifest *m, const struct grid_manifest *base)
{
	size_t n = m->nsources;
	struct err err = ERR_INIT;

	pending_leave_out(m, base);
	/* If it fails, the next start tries again. */
	if (m->nsources && m->nsources < n && grid_manifest_write(d->dirfd, name, m, &err))
		log_event_err(LOG_EVENT_LEFTOVER, ABOUT_DATASET(d),
			      "the files of an interrupted push that were committed stay with it", &err);
}

/* Reads what there is of it. NULL: nothing, or it is damaged. */
static int load_manifest(struct dataset *d, uint64_t id, struct grid_manifest **ret, struct err *err)
{
	struct ledger *ledger = d->datasets->core->p.ledger;
	struct grid_manifest *m = NULL, *base = NULL;
	struct err absent = ERR_INIT;
	char name[64];
	int r = 0;

	pending_manifest_name(id, name);
	if (*d->manifest)
		r = grid_manifest_load_bare(d->dirfd, d->manifest, ledger, &base, err);
	if (!r) {
		r = grid_manifest_load(d->dirfd, name, ledger, &m, &absent);
		/* A push that cannot be read now is kept. */
		if (r && (absent.sys == ENOENT || r == -ERR_CORRUPT))
			r = 0;
		else if (r)
			*err = absent;
	}
	if (!r && m)
		leave_pending(d, name, m, base);
	grid_manifest_free(base);
	*ret = m;
	return r;
}

/* A row of the catalogue, before the loop runs. *ret_stays: the push is pending; otherwise its row goes. */
int pending_load(struct dataset *d, const struct catalogue_push *row, bool *ret_stays, struct err *err)
{
	struct grid_manifest *m = NULL;
	struct pending *q = pending_new(d->datasets, row->uid, err);
	int r = q ? dataset_open(d, err) : -(int)err->code;

	*ret_stays = false;
	if (r) {
		pending_free(d->datasets, q);
		return r;
	}
	r = load_manifest(d, row->id, &m, err);
	if (!r && m && m->nsources) {
		*q = (struct pending){.id = row->id, .uid = row->uid, .interrupted_us = row->begun_us};
		q->files = (uint32_t)m->nsources;
		q->points = pending_points(m);
		q->bytes = pending_bytes(d->dirfd, q->id, q->points);
		for (size_t i = 0; i < m->nsources; i++)
			dataset_sources_from(d, m->sources[i].id + 1);
		/* Its age is judged later, by the trusted clock (pending_expire). */
		*ret_stays = true;
		insert(dataset_hold(d), q);
		log_event(LOG_EVENT_PUSH_PENDING, ABOUT_PENDING(q, d), "push %llu of user %u into %s is pending: %u files",
			  (unsigned long long)q->id, q->uid, d->name, q->files);
		q = NULL;
	} else if (!r && !m && !has_committed(d, row->id)) {
		log_event(LOG_EVENT_PUSH_DROPPED, &(struct log_about){.push = row->id, .dataset = d->name, ABOUT_USER(row->uid)},
			  "push %llu of user %u into %s was interrupted: nothing of it was durable yet",
			  (unsigned long long)row->id, row->uid, d->name);
	}
	dataset_close(d);
	pending_free(d->datasets, q);
	grid_manifest_free(m);
	return r;
}
