/*
 * The steps of a simplification: which tasks there are, what follows when they are done, and how all of it is found again.
 *
 * A task is done if its file is there. What the next step needs is written under new names; then the file "state" is replaced,
 * which names it. So a crash leaves the present step, with some files that nobody needs, which simplify_open removes.
 */
#include "simplify.h"

#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_stage.h"
#include "io.h"
#include "simplify_priv.h"
#include "simplify_round.h"

static const char STATE[] = "state";
static const char HEAD[] = "acut-simplify-state 3";

#define ROW(field)                                             \
	{                                                      \
#field, offsetof(struct simplify_where, field) \
	}
static const struct simplify_row rows[] = {
	ROW(step),       ROW(attempt),     ROW(round),    ROW(error),  ROW(tasks),   ROW(parts),      ROW(chosen),
	ROW(added),      ROW(seeds),       ROW(rounds),   ROW(tested), ROW(hull),    ROW(lines),      ROW(points),
	ROW(flat),       ROW(records),     ROW(target),   ROW(low),    ROW(best),    ROW(best_error), ROW(best_chosen),
	ROW(best_seeds), ROW(best_rounds), ROW(best_far), ROW(far),    ROW(corner0), ROW(corner1),    ROW(corner2),
	ROW(lost),       ROW(regions),     ROW(stars),    ROW(edges),
};
enum { ROWS = sizeof rows / sizeof *rows };

size_t simplify_memory_min(const struct grid *grid)
{
	const struct simplify_params p = {.grid = grid};
	size_t most = simplify_check_bytes(&p);
	size_t other[] = {simplify_divide_bytes(grid), simplify_part_bytes(grid), 2 * (size_t)GRID_STAGE_MIN};

	for (unsigned i = 0; i < sizeof other / sizeof *other; i++)
		most = other[i] > most ? other[i] : most;
	return most;
}

/* ---- its tasks ---- */

static char *task_file(const struct simplify *s, uint32_t task, char name[GRID_NAME_MAX])
{
	switch ((enum simplify_step)s->at.step) {
	case SIMPLIFY_DIVIDE:
		return strcpy(name, "blocks");
	case SIMPLIFY_BLOCKS:
		return simplify_name(name, "part", task, 0, 0);
	default:
		return simplify_name(name, "bad", s->at.attempt, s->at.round, task);
	}
}

static int find_done(struct simplify *s, struct err *err)
{
	char name[GRID_NAME_MAX];

	free(s->done);
	s->done = calloc(s->at.tasks + 1, sizeof *s->done);
	if (!s->done)
		return err_set(err, ERR_NOMEM, "no memory for %llu tasks", (unsigned long long)s->at.tasks);
	for (uint32_t i = 0; i < s->at.tasks; i++)
		atomic_init(&s->done[i], simplify_file_exists(s->p.dirfd, task_file(s, i, name)));
	return 0;
}

uint32_t simplify_tasks(const struct simplify *s)
{
	return (uint32_t)s->at.tasks;
}

bool simplify_task_done(const struct simplify *s, uint32_t task)
{
	return atomic_load(&s->done[task]);
}

int simplify_task(struct simplify *s, uint32_t task, void *memory, struct err *err)
{
	int r = 0;

	if (simplify_task_done(s, task))
		return 0;
	if (s->at.step == SIMPLIFY_DIVIDE)
		r = simplify_divide(s, memory, err);
	else if (s->at.step == SIMPLIFY_BLOCKS)
		r = simplify_part(s, task, memory, err);
	else
		r = simplify_check(s, task, memory, err);
	if (!r)
		atomic_store(&s->done[task], true);
	return r;
}

/* ---- its files ---- */

static int where_write(const struct simplify *s, const struct simplify_where *where, struct err *err)
{
	return simplify_text_write(s->p.dirfd, STATE, HEAD, rows, ROWS, where, GRID_TEMPORARY, err);
}

/* Whether the manifest of a grid, or a segment that it names, has this name. */
static bool is_of_grid(const struct simplify *s, const char *manifest, const char *name)
{
	struct err err = ERR_INIT;
	struct grid_manifest *m;
	bool found = !strcmp(manifest, name);

	if (found || grid_manifest_read(s->p.dirfd, manifest, &m, &err))
		return found;
	for (size_t i = 0; i < m->nsegments; i++)
		found = found || !strcmp(m->segments[i].file, name);
	grid_manifest_free(m);
	return found;
}

static bool has_prefix(const char *name, const char *prefix)
{
	return !strncmp(name, prefix, strlen(prefix));
}

/* Whether a file is needed to continue. */
static bool is_needed(const struct simplify *s, const char *name)
{
	const struct simplify_where *at = &s->at;
	char other[GRID_NAME_MAX];

	if (at->step == SIMPLIFY_DONE)
		return !strcmp(name, "report") || is_of_grid(s, SIMPLIFY_MANIFEST, name);
	if (!strcmp(name, STATE) || !strcmp(name, "blocks") || !strcmp(name, "removed"))
		return true;
	if (at->step == SIMPLIFY_BLOCKS)
		return has_prefix(name, "part-") && !strstr(name, ".tmp");
	if (at->step != SIMPLIFY_CHECK)
		return false;
	if (s->p.max_points && (has_prefix(name, "part-") || !strcmp(name, "histogram") || !strcmp(name, "hull")))
		return true;
	if (at->best && is_of_grid(s, simplify_name(other, "best", at->best - 1, 0, 0), name))
		return true;
	for (uint32_t i = 0; i < at->tasks; i++)
		if (!strcmp(name, task_file(s, i, other)) ||
		    !strcmp(name, simplify_name(other, "edge", at->attempt, at->round, i)))
			return true;
	if (at->edges && !at->round &&
	    (!strcmp(name, simplify_name(other, "border", at->attempt, 0, 0)) ||
	     is_of_grid(s, simplify_name(other, "strip", at->attempt, 0, 0), name)))
		return true;
	return (!at->stars && !strcmp(name, simplify_name(other, "plan", at->attempt, at->round, 0))) ||
	       !strcmp(name, simplify_name(other, "star", at->attempt, at->round, 0)) ||
	       is_of_grid(s, simplify_name(other, "chosen", at->attempt, at->round, 0), name);
}

static int sweep_file(void *ctx, const struct dirent *d, struct err *err)
{
	const struct simplify *s = ctx;

	return is_needed(s, d->d_name) ? 0 : io_remove(s->p.dirfd, d->d_name, err);
}

static int sweep(const struct simplify *s, struct err *err)
{
	struct simplify copy = *s;

	return io_list(s->p.dirfd, ".", sweep_file, &copy, err);
}

/* ---- beginning and end ---- */

static void is_done(struct simplify *s)
{
	s->at = (struct simplify_where){.step = SIMPLIFY_DONE};
}

/* Tasks read parts of these files only, so their checksums are compared once, before. */
static int check_files(const struct simplify *s, struct err *err)
{
	char name[GRID_NAME_MAX] = "blocks";
	bool whole = true;

	if (s->at.step == SIMPLIFY_BLOCKS)
		whole = simplify_file_whole(s->p.dirfd, name);
	if (s->at.step == SIMPLIFY_CHECK && !s->at.stars)
		whole = simplify_file_whole(s->p.dirfd, simplify_name(name, "plan", s->at.attempt, s->at.round, 0));
	if (s->at.step == SIMPLIFY_CHECK && whole && s->at.edges && !s->at.round)
		whole = simplify_file_whole(s->p.dirfd, simplify_name(name, "border", s->at.attempt, 0, 0));
	if (s->at.step == SIMPLIFY_CHECK && whole && s->at.stars)
		whole = simplify_file_whole(s->p.dirfd, simplify_name(name, "star", s->at.attempt, s->at.round, 0));
	if (whole)
		return 0;
	err_set(err, ERR_CORRUPT, "a file of a simplification is damaged");
	return err_add_file(err, name);
}

static int find_state(struct simplify *s, struct err *err)
{
	struct simplify_report report;
	char name[GRID_NAME_MAX];
	int r;

	if (simplify_file_exists(s->p.dirfd, SIMPLIFY_MANIFEST)) {
		is_done(s);
		r = simplify_report_read(s->p.dirfd, &report, err);
		return r ? r : sweep(s, err);
	}
	if (!simplify_file_exists(s->p.dirfd, STATE)) {
		s->at = (struct simplify_where){.step = SIMPLIFY_DIVIDE, .tasks = 1, .error = (uint64_t)s->p.max_error};
		r = where_write(s, &s->at, err);
	} else {
		r = simplify_text_read(s->p.dirfd, STATE, HEAD, rows, ROWS, &s->at, err);
	}
	if (!r)
		r = check_files(s, err);
	if (!r)
		r = sweep(s, err);
	if (!r && s->at.step == SIMPLIFY_CHECK)
		r = simplify_grid(s, simplify_name(name, "chosen", s->at.attempt, s->at.round, 0), &s->chosen, err);
	if (!r && s->at.step == SIMPLIFY_CHECK && s->at.edges && !s->at.round)
		r = simplify_grid(s, simplify_name(name, "strip", s->at.attempt, 0, 0), &s->strip, err);
	return r;
}

int simplify_open(const struct simplify_params *params, struct simplify **ret, struct err *err)
{
	struct simplify *s;
	int r;

	if (params->memory < simplify_memory_min(params->grid))
		return err_set(err, ERR_LIMIT, "a simplification needs %zu bytes of memory, not %zu",
			       simplify_memory_min(params->grid), params->memory);
	if (params->max_error < 0)
		return err_set(err, ERR_USAGE, "an error is not negative");
	s = calloc(1, sizeof *s);
	if (!s)
		return err_set(err, ERR_NOMEM, "no memory for a simplification");
	s->p = *params;
	s->p.max_error = params->max_error > SIMPLIFY_ERROR_MOST ? SIMPLIFY_ERROR_MOST : params->max_error;
	s->view = *params->view;
	s->view.window = VIEW_CROP_NONE;
	s->view.window_area = NULL;
	s->rest = view_rest(&s->view);
	memcpy(s->rest.k, s->view.k, sizeof s->rest.k);
	r = find_state(s, err);
	if (!r)
		r = find_done(s, err);
	if (r)
		simplify_free(s);
	else
		*ret = s;
	return r;
}

struct simplify *simplify_free(struct simplify *s)
{
	if (!s)
		return NULL;
	grid_close(s->chosen);
	grid_close(s->strip);
	free(s->done);
	free(s);
	return NULL;
}

void simplify_state(const struct simplify *s, struct simplify_state *ret)
{
	*ret = (struct simplify_state){
		.step = (enum simplify_step)s->at.step,
		.attempt = (unsigned)s->at.attempt,
		.round = (unsigned)s->at.round,
		.chosen = s->at.chosen,
		.added = s->at.added,
		.max_error = (int64_t)s->at.error,
	};
}

/* ---- the next step ---- */

/* Whether the files of a task are whole. In a round that tests regions there are two. */
static bool is_whole(const struct simplify *s, uint32_t task)
{
	char name[GRID_NAME_MAX];

	if (!simplify_file_whole(s->p.dirfd, task_file(s, task, name)))
		return false;
	return s->at.step != SIMPLIFY_CHECK || s->at.stars ||
	       simplify_file_whole(s->p.dirfd, simplify_name(name, "edge", s->at.attempt, s->at.round, task));
}

/* A task with a torn file is done again. */
static void discard_torn(struct simplify *s)
{
	for (uint32_t i = 0; i < s->at.tasks; i++) {
		struct err ignored = ERR_INIT;
		char name[GRID_NAME_MAX];

		if (is_whole(s, i))
			continue;
		io_remove(s->p.dirfd, task_file(s, i, name), &ignored);
		atomic_store(&s->done[i], false);
	}
}

static int end_divide(const struct simplify *s, struct simplify_where *to, struct err *err)
{
	struct simplify_in in;
	int r = simplify_in_begin(&in, s->p.dirfd, "blocks", sizeof(struct simplify_block), err);

	if (r)
		return r;
	to->points = in.info[0];
	to->flat = in.info[1];
	to->records = in.info[2];
	to->step = SIMPLIFY_BLOCKS;
	to->parts = to->tasks = in.n < SIMPLIFY_PARTS ? in.n : SIMPLIFY_PARTS;
	simplify_in_end(&in);
	return 0;
}

/* `next` is the step that follows, with its own grid. It replaces *s only when all its files are there. */
int simplify_next(struct simplify *s, struct err *err)
{
	struct simplify next = *s;
	int r;

	if (s->at.step == SIMPLIFY_DONE)
		return SIMPLIFY_E_DONE;
	next.chosen = next.strip = NULL;
	next.done = NULL;
	if (s->at.step == SIMPLIFY_DIVIDE)
		r = end_divide(s, &next.at, err);
	else
		r = s->at.step == SIMPLIFY_BLOCKS ? simplify_end_blocks(s, &next, err) : simplify_end_round(s, &next, err);
	if (!r && next.at.step != SIMPLIFY_DONE)
		r = where_write(s, &next.at, err);
	if (!r)
		r = find_done(&next, err);
	if (r) {
		grid_close(next.chosen);
		grid_close(next.strip);
		if (r == -ERR_CORRUPT)
			discard_torn(s);
		return r;
	}
	grid_close(s->chosen);
	grid_close(s->strip);
	free(s->done);
	*s = next;
	r = sweep(s, err);
	return r ? r : s->at.step == SIMPLIFY_DONE ? SIMPLIFY_E_DONE : 0;
}
