/*
 * The selection of a view with max-error or max-points: few points whose mesh is near all points of the view (engine/simplify).
 *
 * The model: first there is the grid that it chooses from, which is the generation's, or the selection of the same view without a
 * bound (run_select.c). Then a simplification takes its steps. Each is a task group: a task and its helpers do the tasks of the
 * step, then the task begins the next one. All that was done is in the folder cache/selected/part-KEY, which stays if the run
 * yields, is stopped, or is killed: the next run with the same key continues there, with any memory and any number of threads,
 * and has the same result. A folder that nobody continues is evicted like a selection. When the simplification is complete, the
 * folder gets the name KEY, and is a selection like any other.
 *
 * Memory: at most half of what domains may have now, charged before the first step and kept to the end; the index of the
 * chosen points is the second one of a run's share (admission.c). What simplify_next needs is the memory of one task, when none
 * runs.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>

#include "align.h"
#include "clock.h"
#include "io.h"
#include "log.h"
#include "run_priv.h"

/* Of one task. More would not make it faster. */
#define SIMPLIFY_MOST (UINT64_C(128) << 20)

/* ---- a step, on workers ---- */

static int simplify_cancelled(void *ctx)
{
	struct run *w = ctx;

	return atomic_load(&w->task.cancel);
}

/* The first failure counts; no further task begins. */
static void step_failed(struct run_simplify *x, const struct err *err)
{
	if (!atomic_flag_test_and_set(&x->failed)) {
		x->err = *err;
		x->lacks = err->code == ERR_LIMIT ? err->need : 0;
	}
	atomic_store(&x->next, x->tasks);
}

/* Disk space for what was written so far, and as much again. Only one member asks for it. */
static int reserve_space(struct run *w, struct err *err)
{
	return run_space_select_grow(w, w->simplify.parent, w->simplify.name, false, err);
}

static bool take_task(void *ctx, unsigned member)
{
	struct run *w = ctx;
	struct run_simplify *x = &w->simplify;
	struct err err = ERR_INIT;
	unsigned task;

	do
		task = atomic_fetch_add(&x->next, 1);
	while (task < x->tasks && simplify_task_done(x->s, task));
	if (task >= x->tasks)
		return false;
	if (simplify_task(x->s, task, (uint8_t *)x->memory + member * x->each, &err) || (!member && reserve_space(w, &err))) {
		step_failed(x, &err);
		return false;
	}
	atomic_fetch_add(&x->finished, 1);
	return !atomic_load(&w->task.cancel);
}

/* Looks at the step that is next. */
static void step_look(struct run_simplify *x)
{
	struct simplify_state state;
	unsigned finished = 0;

	x->tasks = simplify_tasks(x->s);
	for (uint32_t i = 0; i < x->tasks; i++)
		finished += simplify_task_done(x->s, i);
	simplify_state(x->s, &state);
	atomic_store(&x->step, state.step);
	atomic_store(&x->finished, finished);
	atomic_store(&x->of, x->tasks);
	atomic_store(&x->next, 0);
	x->left = x->tasks - finished;
}

static int begin_folder(struct run *w, struct err *err)
{
	struct run_simplify *x = &w->simplify;
	int r = io_make_dir(x->parent, x->name, 0700, err);

	return r ? r : io_open(x->parent, x->name, O_RDONLY | O_DIRECTORY, 0, &x->dirfd, err);
}

static int simplify_begin(struct run *w, struct err *err)
{
	struct run_simplify *x = &w->simplify;
	const struct grid_source *lines = grid_lines_source(w->grid);
	struct simplify_params p = {
		.grid = w->grid,
		.view = &x->view,
		.max_error = w->view.max_error,
		.max_points = w->view.max_points,
		.memory = x->each,
		.index_memory = admission_index_share(w->runs->admission),
		.ledger = w->runs->core->p.ledger,
		.dirfd = x->dirfd,
		.linesfd = w->dataset->dirfd,
		.progress = simplify_cancelled,
		.ctx = w,
	};

	if (lines) {
		grid_source_files(lines, x->file);
		p.lines = x->file[0].name;
	}
	return simplify_open(&p, &x->s, err);
}

static int simplify_open_again(struct run *w, struct err *err)
{
	struct run_simplify *x = &w->simplify;
	int r;

	x->s = simplify_free(x->s);
	if (x->dirfd >= 0)
		io_close(x->dirfd);
	x->dirfd = -1;
	r = begin_folder(w, err);
	if (!r)
		r = simplify_begin(w, err);
	if (!r)
		step_look(x);
	return r;
}

/* What is in the folder cannot be continued: from the start, once. */
static int simplify_empty(struct run *w, struct err *err)
{
	struct run_simplify *x = &w->simplify;
	int r;

	log_event_err(LOG_EVENT_DAMAGE_DERIVED, ABOUT_RUN(w), "a simplification cannot be continued, it begins again", err);
	x->emptied = true;
	/* The failure of a task is over with this, too. */
	x->err = ERR_INIT;
	x->lacks = 0;
	atomic_flag_clear(&x->failed);
	x->s = simplify_free(x->s);
	err_clear(err);
	r = io_folder_remove(x->parent, x->name, err);
	return r ? r : simplify_open_again(w, err);
}

/* Complete: it becomes a selection, with the counts of the rules that removed points before it. */
static int simplify_finish(struct run *w, struct err *err)
{
	struct run_simplify *x = &w->simplify;
	struct selection_counts counts = w->select.counts;
	struct simplify_report report;
	char name[DIGEST_HEX_SIZE];
	int r = simplify_report_read(x->dirfd, &report, err);

	if (r)
		return r;
	if (!w->select.open)
		counts = (struct selection_counts){.points = report.records};
	for (int i = 0; i < VIEW_RULES; i++)
		counts.removed[i] += i > VIEW_KEPT ? report.removed[i] : 0;
	counts.removed[VIEW_BY_ERROR] += report.points - report.kept;
	counts.kept = report.kept;
	r = selection_counts_write(x->dirfd, &counts, err);
	x->s = simplify_free(x->s);
	io_close(x->dirfd);
	x->dirfd = -1;
	if (!r && io->renameat(x->parent, x->name, x->parent, digest_hex(w->select.key, name)) != 0)
		r = err_sys(err, errno, "cannot rename a simplification");
	run_space_select_end(w, space_folder_bytes(x->parent, r ? x->name : name));
	x->counted = false;
	if (!r)
		r = run_select_open_in(w, x->parent, err);
	if (r == RUN_E_ABSENT)
		return err_sys(err, ENOENT, "a simplification disappeared as soon as it was made");
	x->done = !r;
	return r;
}

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory to simplify a mesh");
}

/* Takes the tasks of one step after the other, until one has work for helpers, too. `grouped`: this one has them. */
static int take_steps(struct run *w, bool grouped, struct err *err)
{
	struct run_simplify *x = &w->simplify;
	int r;

	while (grouped || x->members < 2 || x->left < 2) {
		if (!x->memory && x->left && !(x->memory = aligned_alloc(ALIGN_LINE, x->each)))
			return no_memory(err);
		if (grouped)
			sched_group_run(x->group);
		else
			while (take_task(w, 0))
				;
		grouped = false;
		if (atomic_load(&w->task.cancel))
			return err_set(err, ERR_CANCELLED, "the simplification was cancelled");
		if (x->err.code) {
			*err = x->err;
			return -(int)err->code;
		}
		/* The next step has this memory for itself. */
		free(x->memory);
		x->memory = NULL;
		r = reserve_space(w, err);
		if (!r)
			r = simplify_next(x->s, err);
		if (r == SIMPLIFY_E_DONE)
			return simplify_finish(w, err);
		if (r)
			return r;
		step_look(x);
	}
	return 0;
}

static int simplify_work(struct run *w, struct err *err)
{
	struct run_simplify *x = &w->simplify;
	int r = 0;

	if (x->parent < 0) {
		r = run_select_parent(w, &x->parent, err);
		/* Another run may have made it meanwhile. */
		if (!r && !(r = run_select_open_in(w, x->parent, err)))
			x->done = true;
		if (r != RUN_E_ABSENT)
			return r;
		r = run_space_part_begin(w, x->parent, x->name, err);
		x->counted = !r;
	}
	if (!r && !x->s)
		r = simplify_open_again(w, err);
	return r ? r : take_steps(w, x->group, err);
}

static void simplify_run(struct sched_task *t)
{
	struct run *w = run_of_task(t);
	struct run_simplify *x = &w->simplify;

	w->err = ERR_INIT;
	w->r = simplify_work(w, &w->err);
	if (w->r == -ERR_CORRUPT && !x->emptied && x->counted)
		w->r = simplify_empty(w, &w->err);
}

/* ---- its tasks, on the loop ---- */

static void simplify_submit(struct run *w, uint64_t bytes);

/* What was done stays in the folder. */
static void simplify_close(struct run *w)
{
	struct run_simplify *x = &w->simplify;

	simplify_free(x->s);
	free(x->memory);
	if (x->dirfd >= 0)
		io_close(x->dirfd);
	if (x->parent >= 0)
		io_close(x->parent);
	if (x->counted)
		run_space_select_end(w, w->space.selecting);
	if (x->held)
		sched_give(w->runs->core->p.sched, LEDGER_DOMAIN, x->held);
	*x = (struct run_simplify){.need = x->need, .parent = -1, .dirfd = -1};
}

/* A task needs more memory. True: it goes on with fewer at a time, or begins again later. */
static bool with_more_memory(struct run *w)
{
	struct run_simplify *x = &w->simplify;

	if (w->r != -ERR_LIMIT || w->stopping || x->lacks <= x->each)
		return false;
	x->need = x->lacks;
	simplify_close(w);
	run_simplify_start(w);
	return true;
}

static void simplify_over(void *run)
{
	struct run *w = run;
	struct run_simplify *x = &w->simplify;

	w->task_busy = false;
	x->group = sched_group_free(x->group);
	free(x->memory);
	x->memory = NULL;
	if (with_more_memory(w))
		return;
	if (!w->stopping && !w->r && !x->done) {
		simplify_submit(w, 0);
		return;
	}
	simplify_close(w);
	if (w->stopping && !w->r)
		run_settle(w);
	else
		run_opened(w);
}

static void simplify_ended(struct sched_task *t)
{
	struct run *w = run_of_task(t);
	struct run_simplify *x = &w->simplify;

	if (t->ran && t->bytes)
		x->held = t->bytes;
	if (x->group)
		sched_group_end(x->group);
	else
		simplify_over(w);
}

/* Members beyond the first. */
static int group_begin(struct run *w, struct err *err)
{
	struct run_simplify *x = &w->simplify;
	struct sched_group_params group = {
		.sched = w->runs->core->p.sched, .owner = w->owner, .step = take_task, .over = simplify_over, .ctx = w};

	if (!x->s || x->members < 2 || x->left < 2)
		return 0;
	group.members = x->members < x->left ? x->members : x->left;
	/* A helper may begin before the task. */
	x->memory = aligned_alloc(ALIGN_LINE, group.members * x->each);
	return x->memory ? sched_group_new(&group, &x->group, err) : no_memory(err);
}

static void simplify_submit(struct run *w, uint64_t bytes)
{
	struct run_simplify *x = &w->simplify;
	struct err err = ERR_INIT;

	if (group_begin(w, &err)) {
		simplify_close(w);
		run_fail(w, &err);
		run_settle(w);
		return;
	}
	w->r = 0;
	w->task = (struct sched_task){
		.run = simplify_run,
		.done = simplify_ended,
		.owner = w->owner,
		.lengthy = true,
		.priority = SCHED_NORMAL,
		.name = LEDGER_DOMAIN,
		.bytes = bytes,
	};
	w->task_busy = true;
	sched_submit(w->runs->core->p.sched, &w->task);
	if (x->group)
		sched_group_start(x->group);
}

/* Half of what domains may have now, at most: others begin meanwhile. False: it begins again later, or the run fails. */
static bool simplify_memory(struct run *w)
{
	struct run_simplify *x = &w->simplify;
	struct admission *a = w->runs->admission;
	uint64_t left = admission_domain_memory(a), room = admission_user_available(a, &w->owner, &w->admission),
		 least = simplify_memory_min(w->grid), bytes, each;
	unsigned threads = sched_threads(w->runs->core->p.sched);
	struct err err = ERR_INIT;

	left = left < room ? left : room;
	least = align_line(least > x->need ? least : x->need);
	if (least <= left) {
		bytes = left / 2 < least ? least : left / 2;
		each = bytes / threads < SIMPLIFY_MOST ? bytes / threads : SIMPLIFY_MOST;
		x->each = (each < least ? least : each) & ~(size_t)(ALIGN_LINE - 1);
		x->members = bytes / x->each < threads ? (unsigned)(bytes / x->each) : threads;
		w->select.bytes = x->members * x->each;
		return true;
	}
	if (admission_lacks(a, &w->owner, least, left, "the simplification of points", &err))
		run_fail(w, &err);
	else
		run_requeue(w, least);
	return false;
}

void run_simplify_start(struct run *w)
{
	struct run_simplify *x = &w->simplify;
	char key[DIGEST_HEX_SIZE];

	*x = (struct run_simplify){.need = x->need, .parent = -1, .dirfd = -1, .failed = ATOMIC_FLAG_INIT, .err = ERR_INIT};
	snprintf(x->name, sizeof x->name, SPACE_SELECTION_PART "%s", digest_hex(w->select.key, key));
	x->view = w->select.open ? view_rest(&w->view) : view_whole(&w->view);
	if (!simplify_memory(w))
		return;
	w->select.making = w->select.key;
	x->working = true;
	if (w->state != RUN_SELECTING)
		run_set_state(w, RUN_SELECTING);
	simplify_submit(w, w->select.bytes);
}

/* ---- what others ask ---- */

uint64_t run_simplify_done(const struct run *w, uint64_t total)
{
	const struct run_simplify *x = &w->simplify;
	uint64_t of = atomic_load(&x->of);

	return of ? (uint64_t)((double)total * atomic_load(&x->finished) / (double)of) : 0;
}

const char *run_simplify_phase(const struct run *w)
{
	return atomic_load(&w->simplify.step) == SIMPLIFY_CHECK ? "check" : "simplify";
}

const struct simplify_report *run_simplified(const struct run *w)
{
	return view_simplifies(&w->view) && w->select.open ? &w->select.simplified : NULL;
}
