/*
 * Rewriting segments of a dataset, for a merge or a prune.
 *
 * The model: a worker reads the newest manifest and chooses. Then a row of the catalogue says that something is being
 * made in that folder, so that the next start looks there and nowhere else; a worker makes the new segments, in pieces of
 * a few hundredths of a second, after everybody else; each is durable when it has its name. Only then comes the
 * dataset's turn for a new manifest (dataset_change.c): it takes the place of the newest one, whatever was committed
 * meanwhile, and differs in these segments only. The old ones go when nobody opens them any more (dataset_old.c), and with
 * them the row. Until the catalogue has the new manifest nothing has happened: what was made is removed, by us or by the
 * next start. Memory is taken once, for all of it.
 */
#include "dataset_rewrite.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>

#include "clock.h"
#include "grid_rewrite.h"
#include "io.h"
#include "log.h"

#define PIECE_SECONDS 0.05

static struct dataset_rewrite *of_task(struct sched_task *t)
{
	return (struct dataset_rewrite *)t;
}

static struct dataset_rewrite *of_change(struct dataset_change *c)
{
	return (struct dataset_rewrite *)((char *)c - offsetof(struct dataset_rewrite, change));
}

/* ---- choosing ---- */

static bool grow(struct dataset_rewrite *w, size_t n)
{
	size_t room = 2 * (w->room + n);
	struct grid_segment_info *old, *made;
	size_t *unit;
	bool *gone;

	if (w->nold + n <= w->room)
		return true;
	if ((old = realloc(w->old, room * sizeof *old)))
		w->old = old;
	if ((made = realloc(w->made, room * sizeof *made)))
		w->made = made;
	if ((unit = realloc(w->unit, room * sizeof *unit)))
		w->unit = unit;
	if ((gone = realloc(w->gone, room * sizeof *gone)))
		w->gone = gone;
	if (!old || !made || !unit || !gone)
		return false;
	w->room = room;
	return true;
}

int rewrite_add(struct dataset_rewrite *w, const struct grid_segment_info *const *segments, size_t n, bool gone, struct err *err)
{
	if (!grow(w, n))
		return err_set(err, ERR_NOMEM, "no memory for a list of segments");
	for (size_t i = 0; i < n; i++) {
		w->read += gone ? 0 : segments[i]->bytes;
		w->old[w->nold++] = *segments[i];
	}
	w->gone[w->nunits] = gone;
	w->unit[w->nunits++] = w->nold;
	return 0;
}

void rewrite_drop_last(struct dataset_rewrite *w)
{
	w->nold--;
	w->read -= w->old[w->nold].bytes;
	w->unit[w->nunits - 1] = w->nold;
}

static size_t unit_first(const struct dataset_rewrite *w, size_t unit)
{
	return unit ? w->unit[unit - 1] : 0;
}

uint64_t rewrite_bytes(const struct dataset_rewrite *w)
{
	uint64_t most = 0;

	for (size_t i = 0; i < w->nunits; i++) {
		size_t first = unit_first(w, i);
		uint64_t bytes = w->gone[i] ? 0 : grid_rewrite_min_bytes(w->old + first, w->unit[i] - first, w->nsources);

		most = bytes > most ? bytes : most;
	}
	return most + w->room * (2 * sizeof *w->old + sizeof *w->unit);
}

static void look_run(struct sched_task *t)
{
	struct dataset_rewrite *w = of_task(t);
	struct dataset *d = w->dataset;
	struct grid_manifest *m = NULL;

	if (!w->opened)
		w->r = dataset_open(d, &w->err);
	w->opened = !w->r;
	if (!w->r)
		w->r = grid_manifest_load(d->dirfd, w->base_name, w->datasets->core->p.ledger, &m, &w->err);
	if (!w->r) {
		w->nsources = m->nsources;
		w->r = w->choose(w, m, &w->err);
	}
	grid_manifest_free(m);
}

/* ---- the end ---- */

static void give_space(struct dataset_rewrite *w)
{
	if (!w->space)
		return;
	space_add_unwritten(w->datasets->core->space, SPACE_MERGES, -(int64_t)w->space);
	space_give(w->datasets->core->space, SPACE_MERGES, w->space);
	w->space = 0;
}

static void finish(struct dataset_rewrite *w)
{
	struct dataset *d = w->dataset;

	if (w->bytes)
		sched_give(w->datasets->core->p.sched, LEDGER_STAGE, w->bytes);
	admission_add_rewrite(w->datasets->admission, -(int64_t)w->bytes);
	give_space(w);
	w->bytes = 0;
	if (w->opened)
		dataset_close(d);
	w->opened = false;
	w->olds = dataset_old_free(w->olds);
	core_background_done(w->datasets->core);
	w->over(w, w->r ? &w->err : NULL);
	dataset_release(d);
}

void dataset_rewrite_clear(struct dataset_rewrite *w)
{
	free(w->old);
	free(w->made);
	free(w->unit);
	free(w->gone);
	w->old = w->made = NULL;
	w->unit = NULL;
	w->gone = NULL;
}

static void task(struct dataset_rewrite *w, void (*run)(struct sched_task *), void (*done)(struct sched_task *),
		 enum sched_priority priority)
{
	w->task = (struct sched_task){.run = run,
				      .done = done,
				      .priority = priority,
				      .lengthy = true,
				      .owner = {.uid = w->peer.uid, .flow = ++w->datasets->core->last_flow}};
	w->busy = true;
	sched_submit(w->datasets->core->p.sched, &w->task);
}

static void tidy_run(struct sched_task *t)
{
	struct dataset_rewrite *w = of_task(t);
	struct err err = ERR_INIT;
	int r = 0;

	w->rewrite = grid_rewrite_free(w->rewrite);
	/* The catalogue may name the manifest that names them. */
	if (catalogue_is_uncertain(w->datasets->core->p.catalogue)) {
		w->has_row = false;
		return;
	}
	for (size_t i = 0; !r && i < w->nmade; i++)
		if (*w->made[i].file)
			r = io_remove(w->dataset->dirfd, w->made[i].file, &err);
	if (!r)
		r = io_sync(w->dataset->dirfd, "the folder of a dataset", &err);
	if (!r)
		return;
	log_event_err(LOG_EVENT_LEFTOVER, NULL, "what was made of segments is removed again at the next start", &err);
	w->has_row = false;
}

static void tidy_done(struct sched_task *t)
{
	struct dataset_rewrite *w = of_task(t);
	struct err err = ERR_INIT;

	w->busy = false;
	/* Where no worker came to it the row stays. */
	if (t->ran && w->has_row && catalogue_drop_push(w->datasets->core->p.catalogue, w->row, NULL, NULL, &err))
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL, "the catalogue", &err);
	if (!t->ran)
		w->rewrite = grid_rewrite_free(w->rewrite);
	finish(w);
}

/* w->err says why. */
static void fail(struct dataset_rewrite *w)
{
	w->state = REWRITE_TIDYING;
	if (w->has_row || w->nmade || w->rewrite)
		task(w, tidy_run, tidy_done, SCHED_FIRST);
	else
		finish(w);
}

static bool stopped(struct dataset_rewrite *w)
{
	if (!w->stop)
		return false;
	if (!w->r)
		w->r = err_set(&w->err, ERR_CANCELLED, "it was ended");
	return true;
}

/* ---- the manifest ---- */

static bool is_old(const struct dataset_rewrite *w, const char *file)
{
	for (size_t i = 0; i < w->nold; i++)
		if (!strcmp(w->old[i].file, file))
			return true;
	return false;
}

/* The new segments stand where the first of their old ones stood; the others move up. */
static int make(struct dataset_change *c, const struct grid_manifest *base, struct grid_manifest *m, struct err *err)
{
	struct dataset_rewrite *w = of_change(c);
	size_t n = 0, found = 0;

	for (size_t i = 0; i < base->nsegments; i++) {
		if (!is_old(w, base->segments[i].file)) {
			m->segments[n++] = base->segments[i];
			continue;
		}
		found++;
		for (size_t u = 0; u < w->nunits; u++)
			if (!strcmp(w->old[unit_first(w, u)].file, base->segments[i].file) && *w->made[u].file)
				m->segments[n++] = w->made[u];
	}
	if (found != w->nold)
		return err_set(err, ERR_INTERNAL, "of %zu segments of %s %zu are there still", w->nold, w->dataset->name, found);
	m->nsegments = n;
	return w->alter ? w->alter(w, base, m, err) : 0;
}

static void changed(struct dataset_change *c, const struct err *why)
{
	struct dataset_rewrite *w = of_change(c);

	if (why && why->code == ERR_BUSY && !w->stop && !w->datasets->core->stopping) {
		w->again = true; /* no memory for manifests now */
		return;
	}
	if (why) {
		w->r = -(int)why->code;
		w->err = *why;
		fail(w);
		return;
	}
	if (w->has_row || w->nold) {
		dataset_old_goes(w->olds, w->dataset, w->has_row ? w->row : 0);
		w->olds = NULL;
	}
	finish(w);
}

/* Beforehand: when the catalogue has the new manifest, nothing may fail. */
static int list_old(struct dataset_rewrite *w, struct err *err)
{
	if (w->olds)
		return 0;
	w->olds = dataset_old_new(w->nold);
	if (!w->olds)
		return err_set(err, ERR_NOMEM, "no memory for a list of segments");
	for (size_t i = 0; i < w->nold; i++)
		dataset_old_add(w->olds, w->old[i].file);
	return 0;
}

static void change(struct dataset_rewrite *w)
{
	w->state = REWRITE_CHANGING;
	w->again = false;
	w->r = w->last_look ? w->last_look(w, &w->err) : 0;
	if (!w->r)
		w->r = list_old(w, &w->err);
	if (w->r) {
		fail(w);
		return;
	}
	w->change = (struct dataset_change){.dataset = w->dataset, .peer = w->peer, .make = make, .over = changed};
	dataset_change_start(&w->change);
}

/* ---- the segments ---- */

/* The next unit's; *ret_more: there is one. */
static int begin(struct dataset_rewrite *w, struct err *err)
{
	size_t unit = w->nmade, first = unit_first(w, unit);
	struct grid_rewrite_params p = {
		.dirfd = w->dataset->dirfd,
		.segments = w->old + first,
		.nsegments = w->unit[unit] - first,
		.nsources = w->nsources,
		.name = w->new_name,
		.drop = w->drop,
		.ndrop = w->ndrop,
		.memory = w->bytes - w->room * (2 * sizeof *w->old + sizeof *w->unit),
	};

	snprintf(w->new_name, sizeof w->new_name, "merge-%llu-%zu", (unsigned long long)w->row, unit);
	return grid_rewrite_new(&p, &w->rewrite, err);
}

/* Of the disk, once: the new segments are no larger than the old ones. */
static int take_space(struct dataset_rewrite *w, struct err *err)
{
	struct statvfs vfs;
	int r;

	if (w->space || !w->read)
		return 0;
	r = space_take(w->datasets->core->space, SPACE_MERGES, w->read, w->always ? SPACE_MUST : SPACE_MAY, w->what, err);
	if (!r) {
		w->space = w->read;
		space_add_unwritten(w->datasets->core->space, SPACE_MERGES, (int64_t)w->space);
	}
	if (r != -ERR_NOSPACE || !w->always || io->fstatvfs(w->dataset->dirfd, &vfs) != 0 ||
	    (uint64_t)vfs.f_bavail * vfs.f_frsize < w->read + w->read / 8)
		return r;
	/* What frees disk in the end may for a while take what is kept free of others. */
	err_clear(err);
	return 0;
}

static int piece(struct dataset_rewrite *w, struct err *err)
{
	int r = take_space(w, err);

	if (r)
		return r;
	if (w->gone[w->nmade]) {
		w->made[w->nmade++] = (struct grid_segment_info){0};
		return 0;
	}
	if (!w->rewrite)
		r = begin(w, err);
	if (!r)
		r = grid_rewrite_step(w->rewrite, err);
	if (r != GRID_REWRITE_DONE)
		return r;
	r = grid_rewrite_finish(w->rewrite, &w->made[w->nmade], err);
	w->rewrite = NULL;
	if (r)
		return r;
	w->written += w->made[w->nmade++].bytes;
	return 0;
}

static void work_run(struct sched_task *t)
{
	struct dataset_rewrite *w = of_task(t);
	uint64_t begun = clock_mono_ns();

	while (!w->r && w->nmade < w->nunits && !atomic_load(&t->cancel) && clock_since(begun) < PIECE_SECONDS)
		w->r = piece(w, &w->err);
}

static void work(struct dataset_rewrite *w);

static void work_done(struct sched_task *t)
{
	struct dataset_rewrite *w = of_task(t);

	w->busy = false;
	if (stopped(w) || w->r)
		fail(w);
	else if (w->nmade < w->nunits)
		work(w);
	else
		change(w);
}

static void work(struct dataset_rewrite *w)
{
	task(w, work_run, work_done, w->priority);
}

static void row_done(void *ctx, int r, const struct err *why)
{
	struct dataset_rewrite *w = ctx;

	w->has_row = !r;
	if (r) {
		w->r = r;
		w->err = *why;
	}
	if (stopped(w) || w->r)
		fail(w);
	else
		work(w);
}

static void put_row(struct dataset_rewrite *w)
{
	/* Of a push no row has the time 0 (rewrite_row). */
	struct catalogue_push row = {.dataset = w->dataset->id, .uid = w->dataset->uid};

	w->state = REWRITE_WORKING;
	row.id = w->row = ++w->datasets->core->last_push;
	w->r = catalogue_put_push(w->datasets->core->p.catalogue, &row, row_done, w, &w->err);
	if (w->r)
		fail(w);
}

bool rewrite_row(const struct catalogue_push *row)
{
	return !row->begun_us;
}

/* ---- memory ---- */

static uint64_t share(const struct datasets *ds)
{
	uint64_t part = ledger_total(ds->core->p.ledger) / 32;

	return part < 1 << 20 ? 1 << 20 : part > 8 << 20 ? 8 << 20 : part;
}

static bool take(struct dataset_rewrite *w)
{
	uint64_t least = rewrite_bytes(w), want = share(w->datasets) > least ? share(w->datasets) : least;

	if (admission_stage_is_awaited(w->datasets->admission) || slots_requested(w->datasets->admission) ||
	    !admission_stage_available(w->datasets->admission, want) ||
	    !ledger_take(w->datasets->core->p.ledger, LEDGER_STAGE, want))
		return false;
	w->bytes = want;
	admission_add_rewrite(w->datasets->admission, (int64_t)want);
	return true;
}

void dataset_rewrite_settle(struct dataset_rewrite *w)
{
	if (w->state != REWRITE_WAITING)
		return;
	if (stopped(w)) {
		fail(w);
	} else if (take(w)) {
		put_row(w);
	} else if (!w->patient) {
		w->r = err_set(&w->err, ERR_BUSY, "no memory is free to merge segments");
		fail(w);
	}
}

static void look_done(struct sched_task *t)
{
	struct dataset_rewrite *w = of_task(t);

	w->busy = false;
	dataset_read_end(w->dataset);
	if (!t->ran)
		w->r = err_set(&w->err, ERR_CANCELLED, "the daemon is stopping");
	if (w->r == -ERR_BUSY && w->patient && !w->stop) {
		w->r = 0;
		w->err = ERR_INIT;
		w->again = true;
	}
	if (stopped(w) || w->r) {
		fail(w);
		return;
	}
	if (w->again)
		return;
	if (!w->nunits && !w->always) {
		finish(w);
		return;
	}
	if (!w->nunits) {
		change(w);
		return;
	}
	w->state = REWRITE_WAITING;
	dataset_rewrite_settle(w);
}

/* ---- from outside ---- */

static void look(struct dataset_rewrite *w)
{
	memcpy(w->base_name, w->dataset->manifest, sizeof w->base_name);
	dataset_read_begin(w->dataset);
	w->state = REWRITE_LOOKING;
	w->again = false;
	task(w, look_run, look_done, w->priority);
}

void dataset_rewrite_start(struct dataset_rewrite *w)
{
	w->datasets = w->dataset->datasets;
	w->err = ERR_INIT;
	w->most = ledger_total(w->datasets->core->p.ledger) / 8;
	dataset_hold(w->dataset);
	w->datasets->core->background++;
	look(w);
}

void dataset_rewrite_tick(struct dataset_rewrite *w)
{
	if (!w->again)
		return;
	w->again = false;
	if (stopped(w))
		fail(w);
	else if (w->state == REWRITE_CHANGING)
		change(w);
	else
		look(w);
}

void dataset_rewrite_cancel(struct dataset_rewrite *w)
{
	w->stop = true;
	if (w->busy && w->state != REWRITE_TIDYING)
		sched_cancel(w->datasets->core->p.sched, &w->task);
	dataset_rewrite_settle(w);
	dataset_rewrite_tick(w);
}
