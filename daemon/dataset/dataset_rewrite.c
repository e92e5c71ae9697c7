/*
 * Rewrites segments of a dataset, for a merge or a prune.
 *
 * The model: a worker reads the newest manifest and chooses segments. A row in the catalogue then says that something is made in
 * that folder, so the next start sweeps it. A worker makes the new segments at the lowest priority, in pieces of some thousandths
 * of a second; each is durable when it has its name. Then a change (dataset_change.c) makes the next manifest from the newest
 * one, whatever was committed meanwhile; it differs in these segments only. The old segments are removed when nobody opens them
 * (dataset_obsolete.c), and the row with them. Until the catalogue has the new manifest nothing has changed: the new segments are
 * removed, now or by the next start. Memory is charged once for the whole rewrite.
 */
#include "dataset_rewrite.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>

#include "clock.h"
#include "grid_rewrite.h"
#include "io.h"
#include "log.h"

#define PIECE_SECONDS 0.005

static struct dataset_rewrite *of_task(struct sched_task *t)
{
	return (struct dataset_rewrite *)t;
}

static struct dataset_rewrite *of_change(struct dataset_change *c)
{
	return (struct dataset_rewrite *)((char *)c - offsetof(struct dataset_rewrite, change));
}

static void set_state(struct dataset_rewrite *w, enum rewrite_state next)
{
	static const unsigned allowed[] = {
		[REWRITE_CHOOSING] =
			1 << REWRITE_CHOOSING | 1 << REWRITE_WAITING | 1 << REWRITE_COMMITTING | 1 << REWRITE_UNDOING,
		[REWRITE_WAITING] = 1 << REWRITE_WRITING | 1 << REWRITE_UNDOING,
		[REWRITE_WRITING] = 1 << REWRITE_COMMITTING | 1 << REWRITE_UNDOING,
		[REWRITE_COMMITTING] = 1 << REWRITE_COMMITTING | 1 << REWRITE_UNDOING,
		[REWRITE_UNDOING] = 0,
	};

	THREAD_LOOP_ONLY();
	assert(allowed[w->state] >> next & 1);
	w->state = next;
}

/* ---- choosing ---- */

static bool grow(struct dataset_rewrite *w, size_t n)
{
	size_t room = 2 * (w->cap + n);
	struct grid_segment_info *old, *made;
	size_t *unit;
	bool *empty;

	if (w->nold + n <= w->cap)
		return true;
	if ((old = realloc(w->old, room * sizeof *old)))
		w->old = old;
	if ((made = realloc(w->made, room * sizeof *made)))
		w->made = made;
	if ((unit = realloc(w->unit_end, room * sizeof *unit)))
		w->unit_end = unit;
	if ((empty = realloc(w->unit_empty, room * sizeof *empty)))
		w->unit_empty = empty;
	if (!old || !made || !unit || !empty)
		return false;
	w->cap = room;
	return true;
}

int rewrite_add(struct dataset_rewrite *w, const struct grid_segment_info *const *segments, size_t n, bool empty, struct err *err)
{
	if (!grow(w, n))
		return err_set(err, ERR_NOMEM, "no memory for a list of segments");
	for (size_t i = 0; i < n; i++) {
		w->read += empty ? 0 : segments[i]->bytes;
		w->old[w->nold++] = *segments[i];
	}
	w->unit_empty[w->nunits] = empty;
	w->unit_end[w->nunits++] = w->nold;
	return 0;
}

void rewrite_drop_last(struct dataset_rewrite *w)
{
	w->nold--;
	w->read -= w->old[w->nold].bytes;
	w->unit_end[w->nunits - 1] = w->nold;
}

static size_t unit_first(const struct dataset_rewrite *w, size_t unit)
{
	return unit ? w->unit_end[unit - 1] : 0;
}

uint64_t rewrite_bytes(const struct dataset_rewrite *w)
{
	uint64_t most = 0;

	for (size_t i = 0; i < w->nunits; i++) {
		size_t first = unit_first(w, i);
		uint64_t bytes =
			w->unit_empty[i] ? 0 : grid_rewrite_min_bytes(w->old + first, w->unit_end[i] - first, w->nsources);

		most = bytes > most ? bytes : most;
	}
	return most + w->cap * (2 * sizeof *w->old + sizeof *w->unit_end);
}

static void choose_run(struct sched_task *t)
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

static void release_space(struct dataset_rewrite *w)
{
	if (!w->space)
		return;
	space_add_unwritten(w->datasets->core->space, SPACE_MERGES, -(int64_t)w->space);
	space_give(w->datasets->core->space, SPACE_MERGES, w->space);
	w->space = 0;
}

static void rewrite_finish(struct dataset_rewrite *w)
{
	struct dataset *d = w->dataset;

	if (w->bytes)
		sched_give(w->datasets->core->p.sched, LEDGER_STAGE, w->bytes);
	admission_add_rewrite(w->datasets->admission, -(int64_t)w->bytes);
	release_space(w);
	w->bytes = 0;
	if (w->opened)
		dataset_close(d);
	w->opened = false;
	w->obsolete = dataset_obsolete_free(w->obsolete);
	core_background_done(w->datasets->core);
	w->done(w, w->r ? &w->err : NULL);
	dataset_release(d);
}

void dataset_rewrite_clear(struct dataset_rewrite *w)
{
	free(w->old);
	free(w->made);
	free(w->unit_end);
	free(w->unit_empty);
	w->old = w->made = NULL;
	w->unit_end = NULL;
	w->unit_empty = NULL;
	free(w->gone);
	w->gone = NULL;
	w->ngone = 0;
}

static void rewrite_submit(struct dataset_rewrite *w, void (*run)(struct sched_task *), void (*done)(struct sched_task *),
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

static void undo_run(struct sched_task *t)
{
	struct dataset_rewrite *w = of_task(t);
	struct err err = ERR_INIT;
	int r = 0;

	w->rewrite = grid_rewrite_free(w->rewrite);
	/* The catalogue may name the manifest that names these files. */
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
	log_event_err(LOG_EVENT_LEFTOVER, NULL, "new segments of a merge or prune that ended stay until the next start", &err);
	w->has_row = false;
}

static void undo_done(struct sched_task *t)
{
	struct dataset_rewrite *w = of_task(t);

	w->busy = false;
	/* If no worker ran it, the row stays. */
	if (t->ran && w->has_row)
		dataset_drop_row(w->dataset, w->row_id);
	if (!t->ran)
		w->rewrite = grid_rewrite_free(w->rewrite);
	rewrite_finish(w);
}

/* w->err is set. */
static void rewrite_fail(struct dataset_rewrite *w)
{
	set_state(w, REWRITE_UNDOING);
	if (w->has_row || w->nmade || w->rewrite)
		rewrite_submit(w, undo_run, undo_done, SCHED_FIRST);
	else
		rewrite_finish(w);
}

static bool is_cancelled(struct dataset_rewrite *w)
{
	if (!w->cancelled)
		return false;
	if (!w->r)
		w->r = err_set(&w->err, ERR_CANCELLED, "it was cancelled");
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

/* A new segment takes the place of the first of its old ones. */
static int make_manifest(struct dataset_change *c, const struct grid_manifest *base, struct grid_manifest *m, struct err *err)
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
		return err_set(err, ERR_INTERNAL, "%s has %zu of the %zu segments that were rewritten", w->dataset->name, found,
			       w->nold);
	m->nsegments = n;
	return w->alter ? w->alter(w, base, m, err) : 0;
}

static void change_done(struct dataset_change *c, const struct err *why)
{
	struct dataset_rewrite *w = of_change(c);

	if (why && why->code == ERR_BUSY && !w->cancelled && !w->datasets->core->stopping) {
		w->retry = true; /* no memory for manifests now */
		return;
	}
	if (why) {
		w->r = -(int)why->code;
		w->err = *why;
		rewrite_fail(w);
		return;
	}
	if (w->has_row || w->nold || w->ngone) {
		dataset_obsolete_queue(w->obsolete, w->dataset, w->has_row ? w->row_id : 0);
		w->obsolete = NULL;
	}
	rewrite_finish(w);
}

/* Prepared now: nothing may fail once the catalogue has the new manifest. */
static int list_obsolete(struct dataset_rewrite *w, struct err *err)
{
	if (w->obsolete)
		return 0;
	w->obsolete = dataset_obsolete_new(w->nold + w->ngone);
	if (!w->obsolete)
		return err_set(err, ERR_NOMEM, "no memory for a list of segments");
	for (size_t i = 0; i < w->nold; i++)
		dataset_obsolete_add(w->obsolete, w->old[i].file);
	for (size_t i = 0; i < w->ngone; i++)
		dataset_obsolete_add(w->obsolete, w->gone[i]);
	return 0;
}

static void commit_start(struct dataset_rewrite *w)
{
	set_state(w, REWRITE_COMMITTING);
	w->retry = false;
	w->r = w->check ? w->check(w, &w->err) : 0;
	if (!w->r)
		w->r = list_obsolete(w, &w->err);
	if (w->r) {
		rewrite_fail(w);
		return;
	}
	w->change = (struct dataset_change){.dataset = w->dataset, .peer = w->peer, .make = make_manifest, .done = change_done};
	dataset_change_start(&w->change);
}

/* ---- the segments ---- */

/* Starts the next unit. */
static int unit_begin(struct dataset_rewrite *w, struct err *err)
{
	size_t unit = w->nmade, first = unit_first(w, unit);
	struct grid_rewrite_params p = {
		.dirfd = w->dataset->dirfd,
		.segments = w->old + first,
		.nsegments = w->unit_end[unit] - first,
		.nsources = w->nsources,
		.name = w->new_name,
		.drop = w->drop,
		.ndrop = w->ndrop,
		.memory = w->bytes - w->cap * (2 * sizeof *w->old + sizeof *w->unit_end),
	};

	snprintf(w->new_name, sizeof w->new_name, "merge-%llu-%zu", (unsigned long long)w->row_id, unit);
	return grid_rewrite_new(&p, &w->rewrite, err);
}

/* Reserves disk space once, for all units: the new segments are not larger than the old ones. */
static int reserve_space(struct dataset_rewrite *w, struct err *err)
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
	/* A rewrite that frees disk in the end may use what is kept free otherwise. */
	err_clear(err);
	return 0;
}

static int write_piece(struct dataset_rewrite *w, struct err *err)
{
	int r = reserve_space(w, err);

	if (r)
		return r;
	if (w->unit_empty[w->nmade]) {
		w->made[w->nmade++] = (struct grid_segment_info){0};
		return 0;
	}
	if (!w->rewrite)
		r = unit_begin(w, err);
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

static void write_run(struct sched_task *t)
{
	struct dataset_rewrite *w = of_task(t);
	uint64_t begun = clock_mono_ns();

	while (!w->r && w->nmade < w->nunits && !atomic_load(&t->cancel) && clock_since(begun) < PIECE_SECONDS)
		w->r = write_piece(w, &w->err);
}

static void write_start(struct dataset_rewrite *w);

static void write_done(struct sched_task *t)
{
	struct dataset_rewrite *w = of_task(t);

	w->busy = false;
	if (is_cancelled(w) || w->r)
		rewrite_fail(w);
	else if (w->nmade < w->nunits)
		write_start(w);
	else
		commit_start(w);
}

static void write_start(struct dataset_rewrite *w)
{
	rewrite_submit(w, write_run, write_done, w->priority);
}

static void row_written(void *ctx, int r, const struct err *why)
{
	struct dataset_rewrite *w = ctx;

	w->has_row = !r;
	if (r) {
		w->r = r;
		w->err = *why;
	}
	if (is_cancelled(w) || w->r)
		rewrite_fail(w);
	else
		write_start(w);
}

static void row_put(struct dataset_rewrite *w)
{
	/* The time 0 distinguishes it from the row of a push (rewrite_owns_row). */
	struct catalogue_push row = {.dataset = w->dataset->id, .uid = w->dataset->uid};

	set_state(w, REWRITE_WRITING);
	row.id = w->row_id = ++w->datasets->core->last_push;
	w->r = catalogue_put_push(w->datasets->core->p.catalogue, &row, row_written, w, &w->err);
	if (w->r)
		rewrite_fail(w);
}

bool rewrite_owns_row(const struct catalogue_push *row)
{
	return !row->begun_us;
}

/* ---- memory ---- */

static uint64_t memory_share(const struct datasets *ds)
{
	uint64_t part = ledger_total(ds->core->p.ledger) / 32;

	return part < 1 << 20 ? 1 << 20 : part > 8 << 20 ? 8 << 20 : part;
}

static bool charge_memory(struct dataset_rewrite *w)
{
	uint64_t least = rewrite_bytes(w), want = memory_share(w->datasets) > least ? memory_share(w->datasets) : least;

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
	if (is_cancelled(w)) {
		rewrite_fail(w);
	} else if (charge_memory(w)) {
		row_put(w);
	} else if (!w->patient) {
		w->r = err_set(&w->err, ERR_BUSY, "no memory is free to merge segments");
		rewrite_fail(w);
	}
}

static void choose_done(struct sched_task *t)
{
	struct dataset_rewrite *w = of_task(t);

	w->busy = false;
	dataset_read_end(w->dataset);
	if (!t->ran)
		w->r = err_set(&w->err, ERR_CANCELLED, "the daemon is stopping");
	if (w->r == -ERR_BUSY && w->patient && !w->cancelled) {
		w->r = 0;
		w->err = ERR_INIT;
		w->retry = true;
	}
	if (is_cancelled(w) || w->r) {
		rewrite_fail(w);
		return;
	}
	if (w->retry)
		return;
	if (!w->nunits && !w->always) {
		rewrite_finish(w);
		return;
	}
	if (!w->nunits && !w->ngone) {
		commit_start(w);
		return;
	}
	set_state(w, REWRITE_WAITING);
	/* Other files that go take no memory, but a start must find them. */
	if (w->nunits)
		dataset_rewrite_settle(w);
	else
		row_put(w);
}

/* ---- for the owner ---- */

static void choose_start(struct dataset_rewrite *w)
{
	memcpy(w->base_name, w->dataset->manifest, sizeof w->base_name);
	dataset_read_begin(w->dataset);
	set_state(w, REWRITE_CHOOSING);
	w->retry = false;
	rewrite_submit(w, choose_run, choose_done, w->priority);
}

void dataset_rewrite_start(struct dataset_rewrite *w)
{
	w->datasets = w->dataset->datasets;
	w->err = ERR_INIT;
	w->memory_max = ledger_total(w->datasets->core->p.ledger) / 8;
	dataset_hold(w->dataset);
	w->datasets->core->background++;
	choose_start(w);
}

void dataset_rewrite_tick(struct dataset_rewrite *w)
{
	if (!w->retry)
		return;
	w->retry = false;
	if (is_cancelled(w))
		rewrite_fail(w);
	else if (w->state == REWRITE_COMMITTING)
		commit_start(w);
	else
		choose_start(w);
}

void dataset_rewrite_cancel(struct dataset_rewrite *w)
{
	w->cancelled = true;
	if (w->busy && w->state != REWRITE_UNDOING)
		sched_cancel(w->datasets->core->p.sched, &w->task);
	/* Either of them may end the rewrite. */
	if (w->state == REWRITE_WAITING)
		dataset_rewrite_settle(w);
	else
		dataset_rewrite_tick(w);
}
