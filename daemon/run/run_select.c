/*
 * The selection of a view with crop, every, thin or metric (with a bound of errors: run_simplify.c): a grid of the points that
 * remain, made once, kept in the cache, and opened in place of the generation's grid.
 *
 * The model: a selection is a folder cache/selected/KEY (that of a one-step dataset lies in the dataset's folder, and is removed
 * with it). KEY depends on the content of the generation, its coordinate system, and the rules that select. A later job with the
 * same key stages nothing, and finds the counts for its report there. It is made in a folder tmp-N and renamed when complete; the
 * next start removes what a crash left. What cannot be read is removed and made again.
 *
 * Memory: as for a domain, all bytes are taken before the task starts, and are returned without waiting for anybody. Of two runs
 * that need the same selection, the second waits for the first.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io.h"
#include "lineset.h"
#include "log.h"
#include "run_priv.h"

/* More would not make it faster, and others would wait. */
#define SELECT_MOST (UINT64_C(256) << 20)

/* The folder of the run's selections. */
int run_select_parent(struct run *w, int *ret_fd, struct err *err)
{
	if (w->dataset->onestep)
		return io_open(w->dataset->dirfd, ".", O_RDONLY | O_DIRECTORY, 0, ret_fd, err);
	return core_selected_folder(w->runs->core, ret_fd, err);
}

/* ---- opening ---- */

static bool end_is_kept(const struct run *w, const int32_t at[2])
{
	const struct view_map *map = &w->grid_view.map;
	int32_t back[2] = {at[0], at[1]};

	if (map->is.k)
		view_map_back(map, at, back);
	return view_judge(&w->view, &(struct point){.x = back[0], .y = back[1], .tag = POINT_LINE}) == VIEW_KEPT;
}

/* A piece of a line is in the mesh if both of its ends are. */
static int see_piece(void *ctx, const struct lineset_piece *piece, struct err *err)
{
	struct run *w = ctx;

	(void)err;
	w->cropped += !end_is_kept(w, piece->a) || !end_is_kept(w, piece->b);
	return 0;
}

static int count_cropped(struct run *w, struct err *err)
{
	struct lineset *lines = grid_lines(w->grid);
	void *memory;
	int r;

	w->cropped = 0;
	if (!lines || w->view.crop == VIEW_CROP_NONE)
		return 0;
	memory = malloc(lineset_reader_bytes());
	if (!memory)
		return err_set(err, ERR_NOMEM, "no memory to read lines");
	r = lineset_find(lineset_reader_init(memory, lines), lineset_info(lines)->box, see_piece, w, err);
	free(memory);
	return r;
}

/* Reads its counts and opens its grid. The generation's index is closed first: a run has memory for one. Files of hidden
 * positions are found in the generation, so both have half of it then. */
static int selected_open(struct run *w, int dirfd, bool final, struct err *err)
{
	const struct grid_source *lines = grid_lines_source(w->grid);
	struct grid_named file[GRID_SOURCE_FILES];
	struct grid_use use = {.no_lines = !lines, .slots = w->view.slots ? &selection_slots : NULL};
	int r = selection_counts_read(dirfd, &w->select.counts, err);

	if (!r && final && view_simplifies(&w->view))
		r = simplify_report_read(dirfd, &w->select.simplified, err);
	if (r)
		return r;
	if (w->select.counts.mapped != (w->view.metric.k != 0))
		return err_set(err, ERR_CORRUPT, "a selection is of another metric");
	w->grid_view = view_rest(&w->view);
	if (w->select.counts.mapped)
		view_bind_map(&w->grid_view, w->select.counts.origin);
	pipe_emitter_map(w->emitter, &w->grid_view);
	if (lines) {
		/* The pieces stay in the dataset, unless they are mapped. */
		grid_source_files(lines, file);
		use.lines = w->select.counts.mapped ? SELECTION_LINES : file[0].name;
		use.linesfd = w->select.counts.mapped ? dirfd : w->dataset->dirfd;
	}
	if (w->view.hidden && !w->select.counts.mapped && !w->origin) {
		w->origin = w->grid;
		w->grid = NULL;
	}
	w->grid = grid_close(w->grid);
	r = grid_open_use(dirfd, SELECTION_MANIFEST, GRID_NEWEST, &use, w->runs->core->p.ledger, run_index_share(w), &w->grid,
			  err);
	return r ? r : count_cropped(w, err);
}

/* `final`: it is what the view asks for, not what a simplification chooses from. */
static int open_in(struct run *w, int parent, struct digest key, bool final, struct err *err)
{
	char name[DIGEST_HEX_SIZE];
	struct err why = ERR_INIT, absent = ERR_INIT;
	int dirfd, r;

	if (io_open(parent, digest_hex(key, name), O_RDONLY | O_DIRECTORY, 0, &dirfd, &absent))
		return RUN_E_ABSENT;
	r = selected_open(w, dirfd, final, &why);
	io_close(dirfd);
	if (!r) {
		w->select.open = true;
		run_space_select_hold(w);
		return 0;
	}
	if (r == -ERR_BUSY || r == -ERR_NOMEM) {
		*err = why;
		return r;
	}
	log_event_err(LOG_EVENT_DAMAGE_DERIVED, ABOUT_RUN(w), "a selection cannot be read, it is made again", &why);
	r = io_folder_remove(parent, name, err);
	return r ? r : err_set(err, ERR_BUSY, "a selection has to be made again");
}

int run_select_open_in(struct run *w, int parent, struct err *err)
{
	return open_in(w, parent, w->select.key, true, err);
}

/* A simplification depends on the rules by which it chooses, too. */
static void find_keys(struct run *w)
{
	struct view whole = view_whole(&w->view);
	struct digest parts[2];

	w->select.key = selection_key(w->grid, &w->view);
	if (!view_simplifies(&w->view))
		return;
	parts[0] = w->select.base = selection_key(w->grid, &whole);
	parts[1] = simplify_key(w->grid, &w->view, w->view.max_error, w->view.max_points);
	w->select.key = digest_hash(parts, sizeof parts);
}

/* Regions of mapped points can be compared when their origin is known. */
static int change_mapped(struct run *w, struct err *err)
{
	return w->select.counts.mapped ? run_change_read(w, err) : 0;
}

int run_select_open(struct run *w, struct err *err)
{
	int parent, r = run_select_parent(w, &parent, err);

	if (r)
		return r;
	find_keys(w);
	w->select.total = grid_points(w->grid);
	r = open_in(w, parent, w->select.key, true, err);
	io_close(parent);
	return r ? r : change_mapped(w, err);
}

/* ---- making ---- */

struct selection_task {
	struct run *run;
	int parent;
	const char *temp;
	struct err full; /* set if the disk has no room for it */
};

static int select_progress(void *ctx, uint64_t points)
{
	struct selection_task *m = ctx;

	atomic_store(&m->run->select.judged, points);
	return atomic_load(&m->run->task.cancel) || run_space_select_grow(m->run, m->parent, m->temp, false, &m->full);
}

/* Writes the points into the folder `temp`, and reserves the disk space that they take. */
static int selection_fill(struct selection_task *m, uint64_t bytes, struct err *err)
{
	struct selection_params p = {
		.grid = m->run->grid,
		.view = &m->run->view,
		.memory = bytes,
		.progress = select_progress,
		.ctx = m,
	};
	struct selection_counts counts;
	int r = io_make_dir(m->parent, m->temp, 0700, err);

	if (!r)
		r = io_open(m->parent, m->temp, O_RDONLY | O_DIRECTORY, 0, &p.dirfd, err);
	if (r)
		return r;
	r = selection_make(&p, &counts, err);
	io_close(p.dirfd);
	if (r && m->full.code) {
		*err = m->full;
		return -(int)err->code;
	}
	return r ? r : run_space_select_grow(m->run, m->parent, m->temp, true, err);
}

static int make_in(struct run *w, int parent, const char *temp, const char *name, uint64_t bytes, struct err *err)
{
	struct selection_task m = {.run = w, .parent = parent, .temp = temp, .full = ERR_INIT};
	struct err ignored = ERR_INIT;
	int r = run_space_select_begin(w, bytes, err);

	if (r)
		return r;
	r = selection_fill(&m, bytes, err);
	if (!r && io->renameat(parent, temp, parent, name) != 0)
		r = err_sys(err, errno, "cannot rename a selection");
	run_space_select_end(w, r ? 0 : space_folder_bytes(parent, name));
	if (r && io_folder_remove(parent, temp, &ignored))
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "a part of a selection stays behind until the next start", &ignored);
	return r;
}

static void select_run(struct sched_task *t)
{
	struct run *w = run_of_task(t);
	const bool final = !view_simplifies(&w->view);
	const struct digest key = final ? w->select.key : w->select.base;
	char name[DIGEST_HEX_SIZE], temp[32];
	int parent;

	digest_hex(key, name);
	snprintf(temp, sizeof temp, SPACE_SELECTION_TEMP "%llu", (unsigned long long)w->select.number);
	w->err = ERR_INIT;
	w->r = run_select_parent(w, &parent, &w->err);
	if (w->r)
		return;
	/* Another run may have made it meanwhile. */
	w->r = open_in(w, parent, key, final, &w->err);
	if (w->r == RUN_E_ABSENT) {
		w->r = make_in(w, parent, temp, name, t->bytes, &w->err);
		if (!w->r)
			w->r = open_in(w, parent, key, final, &w->err);
		if (w->r == RUN_E_ABSENT)
			w->r = err_sys(&w->err, ENOENT, "a selection disappeared as soon as it was made");
	}
	io_close(parent);
	if (!w->r)
		w->r = change_mapped(w, &w->err);
}

static void select_done(struct sched_task *t)
{
	struct run *w = run_of_task(t);

	w->task_busy = false;
	if (!t->ran) {
		run_settle(w);
		return;
	}
	sched_give(w->runs->core->p.sched, t->name, t->bytes);
	if (!w->r && !w->stopping && view_simplifies(&w->view))
		run_simplify_start(w);
	else
		run_opened(w);
	if (w->stopping && !w->task_busy)
		run_settle(w);
}

/* A quarter of what stages leave now: a push that comes meanwhile still gets a stage. False: it begins again later, or the run
 * fails. */
static bool selection_memory(struct run *w)
{
	uint64_t left = admission_domain_memory(w->runs->admission), least = selection_memory_min(w->grid, &w->view),
		 bytes = left / 4, room = admission_user_available(w->runs->admission, &w->owner, &w->admission);
	struct err err = ERR_INIT;

	bytes = bytes > admission_stage_share(w->runs->admission) ? admission_stage_share(w->runs->admission) : bytes;
	bytes = bytes > SELECT_MOST ? SELECT_MOST : bytes;
	bytes = bytes > room ? room : bytes;
	bytes = bytes < least ? least : bytes;
	if (bytes <= left && bytes <= room) {
		w->select.bytes = bytes;
		return true;
	}
	if (admission_lacks(w->runs->admission, &w->owner, least, left, "the selection of points", &err))
		run_fail(w, &err);
	else
		run_requeue(w, least);
	return false;
}

void run_select_start(struct run *w)
{
	struct view whole = view_whole(&w->view);

	if (run_selected_elsewhere(w))
		return;
	if (view_simplifies(&w->view) && !view_selects(&whole)) {
		run_simplify_start(w);
		return;
	}
	if (!selection_memory(w))
		return;
	w->select.making = view_simplifies(&w->view) ? w->select.base : w->select.key;
	run_set_state(w, RUN_SELECTING);
	w->select.number = ++w->runs->last_select;
	atomic_store(&w->select.judged, 0);
	w->select.reported = 0;
	w->task = (struct sched_task){
		.run = select_run,
		.done = select_done,
		.owner = w->owner,
		.lengthy = true,
		.priority = SCHED_NORMAL,
		.name = LEDGER_STAGE,
		.bytes = w->select.bytes,
	};
	w->task_busy = true;
	sched_submit(w->runs->core->p.sched, &w->task);
}

/* ---- its progress and counts ---- */

bool run_selecting(const struct run *w)
{
	return w->state == RUN_UNSELECTED || w->state == RUN_SELECTING;
}

const char *run_phase(const struct run *w)
{
	if (run_selecting(w))
		return w->simplify.working ? run_simplify_phase(w) : "select";
	return "mesh";
}

int run_select_count(struct run *w, struct err *err)
{
	struct mesh_counts *counts = &w->totals.counts;
	const struct selection_counts *selected = &w->select.counts;

	/* A window, or a stream of changes, does not count all points. */
	if (!w->select.open || w->view.window || w->since)
		return 0;
	if (counts->points != selected->kept)
		return err_set(err, ERR_INTERNAL, "the selection kept %llu points, the mesh read %llu",
			       (unsigned long long)selected->kept, (unsigned long long)counts->points);
	counts->points = selected->points;
	for (int i = 0; i < VIEW_RULES; i++)
		counts->removed[i] += selected->removed[i];
	return 0;
}

/* ---- damage ---- */

struct discard {
	struct sched_task task;
	struct runs *runs;
	char name[DIGEST_HEX_SIZE];
};

static void discard_run(struct sched_task *t)
{
	struct discard *d = (struct discard *)t;
	struct err err = ERR_INIT;
	int parent, r = core_selected_folder(d->runs->core, &parent, &err);

	if (!r) {
		r = io_folder_remove(parent, d->name, &err);
		io_close(parent);
	}
	if (r)
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "a damaged selection stays behind", &err);
}

static void discard_done(struct sched_task *t)
{
	struct discard *d = (struct discard *)t;

	core_background_done(d->runs->core);
	free(d);
}

void run_select_discard(struct run *w)
{
	struct discard *d;

	if (!w->select.open || w->dataset->onestep || !(d = calloc(1, sizeof *d)))
		return;
	w->why.hint[0] = 0; /* the hint asks to push the data again */
	err_add_hint(&w->why, "the damaged selection is removed: the same again makes it new");
	d->task = (struct sched_task){.run = discard_run, .done = discard_done, .owner = w->owner, .priority = SCHED_FIRST};
	d->runs = w->runs;
	digest_hex(w->select.key, d->name);
	core_background(w->runs->core, &d->task);
}
