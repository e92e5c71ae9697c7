/*
 * One run: its life, from the opening of the generation to the sums of the mesh.
 *
 * The model: a table of states (enum run_state). A run holds memory, files and a plan only while it has a slot; without one it
 * may go back to RUN_NEW and begin again later (run_yield.c). A run that fails or is stopped waits for its tasks, and is over
 * then.
 */
#include "run.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "log.h"
#include "recency.h"
#include "run_priv.h"
#include "store.h"

/* Fractions of the memory: 1/n. */
enum { RECENCY_PART = 1024, SUMMARIES_PART = 256 };

/* A failed run finishes writing a block that is half written, so that the error can follow it. */
#define FAREWELL_SECONDS 2.0

int runs_new(struct core *core, struct admission *admission, struct runs **ret, struct err *err)
{
	struct runs *runs = calloc(1, sizeof *runs);

	if (!runs)
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	runs->core = core;
	runs->admission = admission;
	runs->recency = recency_new(core->p.ledger, sizeof(struct store_id), RECENCY_PART);
	runs->summaries = recency_new(core->p.ledger, sizeof(struct pipe_summary), SUMMARIES_PART);
	*ret = runs;
	return 0;
}

struct runs *runs_free(struct runs *runs)
{
	if (!runs)
		return NULL;
	recency_free(runs->recency);
	recency_free(runs->summaries);
	free(runs);
	return NULL;
}

void run_set_state(struct run *w, enum run_state next)
{
	static const unsigned allowed[] = {
		[RUN_NEW] = 1 << RUN_OPENING,
		[RUN_OPENING] = 1 << RUN_UNSELECTED | 1 << RUN_OPEN,
		[RUN_UNSELECTED] = 1 << RUN_SELECTING,
		[RUN_SELECTING] = 1 << RUN_OPEN,
		[RUN_OPEN] = 1 << RUN_PLANNING | 1 << RUN_RUNNING,
		[RUN_PLANNING] = 1 << RUN_RUNNING,
		[RUN_RUNNING] = 1 << RUN_FINISHING,
		[RUN_FINISHING] = 0,
		[RUN_OVER] = 0,
	};

	THREAD_LOOP_ONLY();
	assert(w->state != RUN_OVER);
	assert(next == RUN_NEW || next == RUN_OVER || allowed[w->state] >> next & 1);
	w->state = next;
}

int run_new(const struct run_params *p, struct run **ret, struct err *err)
{
	struct run *w = calloc(1, sizeof *w);
	int r;

	THREAD_LOOP_ONLY();
	if (!w)
		return err_set(err, ERR_NOMEM, "no memory for a job");
	disk_restore_folders(p->runs->core);
	w->view_text = strdup(p->view_text);
	if (!w->view_text) {
		free(w);
		return err_set(err, ERR_NOMEM, "no memory for a job");
	}
	r = view_parse(p->view_text, &w->view, err);
	if (r) {
		free(w->view_text);
		free(w);
		return r;
	}
	/* With the domains in its window. */
	w->charged = sizeof *w + charge_view_bytes(p->view_text, (w->view.area != NULL) + (w->view.window_area != NULL)) +
		     (w->view.slots ? w->view.slots->n * sizeof *w->view.slots->range : 0) +
		     (p->runs->core->p.threads + 4) * sizeof(struct run_domain);
	r = charge(p->runs->core, w->charged, "the view of a job", err);
	if (r) {
		view_done(&w->view);
		free(w->view_text);
		free(w);
		return r;
	}
	w->runs = p->runs;
	w->plan.ledger = p->runs->core->p.ledger;
	w->dataset = dataset_hold(p->dataset);
	w->generation = p->generation;
	w->keep = p->keep;
	w->client = p->client;
	w->plan_only = p->plan_only;
	w->job = p->job;
	w->owner = p->owner;
	w->slot = p->slot;
	w->owner.flow = ++p->runs->core->last_flow;
	w->patience = p->patience;
	w->file = p->plan;
	w->lazy = p->lazy;
	w->since = p->since;
	w->calls = p->calls;
	w->ctx = p->ctx;
	w->why = ERR_INIT;
	w->err = ERR_INIT;
	w->admission.calls = &run_admission_calls;
	admission_add_run(w->runs->admission, &w->admission);
	*ret = w;
	return 0;
}

struct run *run_free(struct run *w)
{
	THREAD_LOOP_ONLY();
	if (!w)
		return NULL;
	assert(w->state == RUN_NEW || w->state == RUN_OVER);
	admission_remove_run(w->runs->admission, &w->admission);
	run_change_free(w, w->change);
	cut_plan_done(&w->plan);
	dataset_release(w->dataset);
	view_done(&w->view);
	uncharge(w->runs->core, w->charged);
	free(w->view_text);
	free(w);
	return NULL;
}

static void forget_system(struct run *w)
{
	free(w->wkt);
	w->wkt = NULL;
	ledger_give(w->runs->core->p.ledger, LEDGER_MANIFEST, w->wkt_bytes);
	w->wkt_bytes = 0;
}

void run_close(struct run *w)
{
	pipe_emitter_free(w->emitter);
	w->emitter = NULL;
	run_stored_leaves_free(w);
	run_space_release(w);
	w->grid = grid_close(w->grid);
	w->origin = grid_close(w->origin);
	if (w->reading)
		dataset_read_end(w->dataset);
	w->reading = false;
	forget_system(w);
	if (w->opened)
		dataset_close(w->dataset);
	w->opened = false;
	if (w->emitter_bytes)
		sched_give(w->runs->core->p.sched, LEDGER_EMITTER, w->emitter_bytes);
	if (w->output_buffer)
		sched_give(w->runs->core->p.sched, LEDGER_PIPE, RUN_OUTPUT_BUFFER);
	w->emitter_bytes = 0;
	w->output_buffer = false;
}

/* ---- opening ---- */

/* What a selection, whose grid takes the place of this one, has not. */
static int keep_system(struct run *w)
{
	const struct grid_manifest *m = grid_manifest(w->grid);
	const char *wkt = grid_manifest_wkt(m, w->generation);
	size_t bytes = strlen(wkt) + 1;

	memcpy(w->geoid, m->geoid, sizeof w->geoid);
	if (!*wkt)
		return 0;
	if (!ledger_take(w->runs->core->p.ledger, LEDGER_MANIFEST, bytes))
		return err_set(&w->err, ERR_BUSY, "no %zu bytes are free for the coordinate system", bytes);
	w->wkt_bytes = bytes;
	w->wkt = strdup(wkt);
	return w->wkt ? 0 : err_set(&w->err, ERR_NOMEM, "no memory for a coordinate system");
}

uint64_t run_index_share(const struct run *w)
{
	return admission_index_share(w->runs->admission) / (w->view.hidden && view_selects(&w->view) ? 2 : 1);
}

static void open_run(struct sched_task *t)
{
	struct run *w = run_of_task(t);
	struct runs *runs = w->runs;
	struct grid_use use;

	w->err = ERR_INIT;
	w->r = dataset_open(w->dataset, &w->err);
	if (w->r)
		return;
	w->opened = true;
	use = (struct grid_use){.no_lines = w->view.no_breaklines, .clear = w->view.breakline_clear, .slots = w->view.slots};
	w->r = grid_open_use(w->dataset->dirfd, w->manifest, w->generation, &use, runs->core->p.ledger, run_index_share(w),
			     &w->grid, &w->err);
	if (w->r == GRID_E_NO_LINE_SET)
		w->r = RUN_E_NO_LINES;
	if (w->r)
		return;
	view_bind(&w->view, &grid_manifest(w->grid)->lattice);
	w->grid_view = w->view;
	run_count_classes(w);
	w->r = keep_system(w);
	if (!w->r)
		w->r = pipe_emitter_new(&grid_manifest(w->grid)->lattice, admission_emitter_share(runs->admission),
					runs->core->tempfd, &w->emitter, &w->err);
	if (!w->r && (w->view.window || pipe_has_out(w->grid)))
		pipe_emitter_part(w->emitter);
	if (!w->r)
		w->r = run_plan_read(w, &w->err);
	if (!w->r && !w->view.metric.k)
		w->r = run_change_read(w, &w->err);
	if (!w->r && view_selects(&w->view))
		w->r = run_select_open(w, &w->err);
}

/* The job may be older than a prune. Its user knows the generation, not the file name of a manifest. */
static void name_generation(struct run *w)
{
	struct err why = ERR_INIT;

	if (w->r == -ERR_NOTFOUND && dataset_check_generation(w->dataset, w->generation, &why))
		w->err = why;
}

static void lines_there(struct dataset_lines_wait *wait, const struct err *why)
{
	struct run *w = (struct run *)((char *)wait - offsetof(struct run, lines_wait));

	if (why)
		run_fail(w, why);
	else
		slot_request(w->runs->admission, w->slot, w->slot->need);
}

/* The line set of this generation was not kept. It is made again, in memory that this run leaves, and the run begins again then.
 */
static void ask_for_lines(struct run *w)
{
	const struct peer peer = rights_of_user(w->owner.uid, 0);
	struct err err = ERR_INIT;

	run_reset(w);
	w->lines_wait.done = lines_there;
	if (dataset_ask_lines(w->dataset, w->generation, &peer, &w->lines_wait, &err))
		run_fail(w, &err);
}

void run_opened(struct run *w)
{
	name_generation(w);
	if (w->stopping || (w->r < 0 && w->r != -ERR_BUSY)) {
		if (w->r < 0)
			run_fail(w, &w->err);
		run_settle(w);
		return;
	}
	if (w->r == -ERR_BUSY) {
		/* There is no memory for the index now, or the selection has to be made again: it begins again at the next
		 * tick. */
		run_close(w);
		w->select.open = false;
		run_set_state(w, RUN_NEW);
		return;
	}
	if (w->r == RUN_E_NO_LINES) {
		ask_for_lines(w);
		return;
	}
	if (!w->reading && (grid_reopens(w->grid) || (w->origin && grid_reopens(w->origin)))) {
		dataset_read_begin(w->dataset);
		w->reading = true;
	}
	run_set_state(w, w->r == RUN_E_ABSENT ? RUN_UNSELECTED : RUN_OPEN);
	if (w->state == RUN_OPEN)
		pipe_key_init(&w->key, w->grid, &w->grid_view);
	run_settle(w);
}

static void open_done(struct sched_task *t)
{
	struct run *w = run_of_task(t);

	w->task_busy = false;
	if (!t->ran) {
		run_settle(w);
		return;
	}
	w->emitter_bytes = t->bytes;
	run_opened(w);
}

void run_open(struct run *w)
{
	run_set_state(w, RUN_OPENING);
	w->opened_ns = w->opened_ns ? w->opened_ns : clock_mono_ns();
	memcpy(w->manifest, w->dataset->manifest, sizeof w->manifest);
	w->task = (struct sched_task){
		.run = open_run,
		.done = open_done,
		.owner = w->owner,
		.priority = SCHED_FIRST,
		.name = LEDGER_EMITTER,
		.bytes = admission_emitter_share(w->runs->admission),
	};
	w->task_busy = true;
	sched_submit(w->runs->core->p.sched, &w->task);
}

/* ---- the end ---- */

static void finish_run(struct sched_task *t)
{
	struct run *w = run_of_task(t);

	w->err = ERR_INIT;
	w->r = pipe_emitter_finish(w->emitter, &w->totals, &w->err);
}

static void finish_done(struct sched_task *t)
{
	struct run *w = run_of_task(t);

	w->task_busy = false;
	if (t->ran && !w->r)
		w->r = run_select_count(w, &w->err);
	if (t->ran && w->r)
		run_fail(w, &w->err);
	run_settle(w);
}

void run_finish(struct run *w)
{
	run_set_state(w, RUN_FINISHING);
	w->task = (struct sched_task){.run = finish_run, .done = finish_done, .owner = w->owner, .priority = SCHED_FIRST};
	w->task_busy = true;
	sched_submit(w->runs->core->p.sched, &w->task);
}

void run_over(struct run *w)
{
	assert(!w->domains && !w->tasks && !w->task_busy);
	run_set_state(w, RUN_OVER);
	slot_withdraw(w->runs->admission, w->slot);
	dataset_ask_end(&w->lines_wait);
	run_close(w);
	if (w->why.code == ERR_CORRUPT)
		run_select_discard(w);
	admission_remove_run(w->runs->admission, &w->admission);
	w->calls->ended(w->ctx, w->why.code ? &w->why : NULL);
}

/* Says how much memory a region that does not fit would need. */
static void memory_hint(struct run *w)
{
	uint64_t memory = admission_memory_for(w->runs->admission, w->grid, w->why.need);

	if (admission_user_limit(w->runs->admission, &w->owner) != UINT64_MAX)
		err_add_hint(
			&w->why,
			"one user may have %u%% of the memory (user-memory): ask an administrator for more, or leave out points",
			w->runs->core->p.limits.user.memory);
	else if (memory)
		err_add_hint(&w->why, "run with memory=%lluM or more", (unsigned long long)(memory >> 20));
	else
		err_add_hint(&w->why, "no domain carries so many positions, whatever the memory: leave out points");
}

void run_fail(struct run *w, const struct err *why)
{
	struct run_domain *d;

	THREAD_LOOP_ONLY();
	if (w->yielding && run_space_waits(w))
		return; /* its tasks only meet the same lack of space */
	if (w->yielding) {
		/* It was about to yield, and ends for good now. */
		w->yielding = false;
		w->why = *why;
		return;
	}
	if (w->stopping || w->state == RUN_OVER)
		return;
	w->yielding = run_space_suspend(w, why);
	w->stopping = true;
	w->stopped_ns = clock_mono_ns();
	w->why = *why;
	if (why->code == ERR_LIMIT && why->need && w->grid)
		memory_hint(w);
	if (w->task_busy)
		sched_cancel(w->runs->core->p.sched, &w->task);
	for (d = w->domains; d; d = d->next)
		if (d->state != DOMAIN_READY && d->state != DOMAIN_SENDING)
			sched_cancel(w->runs->core->p.sched, &d->task);
}

void run_stop(struct run *w, const struct err *why)
{
	THREAD_LOOP_ONLY();
	run_space_give_up(w);
	run_fail(w, why);
}

void run_settle_stopping(struct run *w)
{
	struct run_domain *d, *next;
	bool farewell;

	/* What its caller did may have ended it: an output whose reader has gone is closed within a call to it. */
	if (w->state == RUN_OVER)
		return;
	run_arenas_trim(w);
	farewell = w->sending && w->output && clock_since(w->stopped_ns) < FAREWELL_SECONDS;

	/* A suspended run resumes behind this block. */
	farewell |= w->output && w->output_busy && w->yielding && run_space_waits(w);

	for (d = w->domains; d; d = next) {
		next = d->next;
		if (d->state == DOMAIN_READY || (d->state == DOMAIN_SPLIT && w->splitting != d))
			run_domain_release(d);
	}
	if (w->task_busy || w->tasks || farewell)
		return;
	while (w->domains)
		run_domain_release(w->domains);
	w->sending = w->emitting = NULL;
	if (!run_finish_yield(w))
		run_over(w);
}
