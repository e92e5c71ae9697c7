/*
 * What the phases plan and mesh share: an attempt from its beginning to its record, the dataset, and the memory of a task.
 *
 * The model: a ledger with the task's memory pays for everything that grows: the manifest and the index of the dataset, one
 * arena, and the lists of regions and domains. An eighth is for the lists, so that the arena does not depend on them.
 */
#include "mesh_phase.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ctl_view.h"
#include "err.h"
#include "io.h"
#include "mesh_priv.h"
#include "parse.h"

enum { INDEX_LEAST = 1 << 20, INDEX_MOST = 64 << 20, INDEX_SHARE = 16, LISTS_SHARE = 8 };
static const char MANIFEST[] = "manifest";

/* ---- attempts ---- */

static int make(void *ctx, struct work_attempt *a, uint32_t task, struct err *err)
{
	struct phase *s = ctx;
	int r;

	s->attempt = a;
	s->ledger = ledger_new(s->p->memory);
	r = s->ledger ? s->run(s, task, err) : err_set(err, ERR_NOMEM, "no memory for a task");
	grid_close(s->grid);
	view_done(&s->view);
	ledger_free(s->ledger);
	return r;
}

int phase_run(struct work *w, enum work_phase phase, uint32_t task, const struct mesh_phase_params *p, phase_fn run,
	      struct err *err)
{
	struct phase s = {.work = w, .p = p, .run = run, .view = VIEW_INIT};
	int r = work_run(w, phase, task, make, &s, err);

	return r > 0 ? 0 : r;
}

/* ---- memory ---- */

uint64_t phase_arena(const struct phase *s)
{
	const uint64_t left = ledger_left(s->ledger), lists = s->p->memory / LISTS_SHARE;

	return left > lists ? left - lists : 0;
}

/* Shares of the memory grow with it. */
uint64_t phase_arena_needs(const struct phase *s, uint64_t bytes)
{
	return (bytes + s->p->memory - ledger_left(s->ledger)) * 5 / 4 + (1 << 20);
}

static uint64_t index_bytes(const struct phase *s)
{
	uint64_t share = s->p->memory / INDEX_SHARE;

	return share < INDEX_LEAST ? INDEX_LEAST : share > INDEX_MOST ? INDEX_MOST : share;
}

uint64_t mesh_phase_least_bytes(void)
{
	const uint64_t arena = pipe_budget_min(NULL) / 2 + INDEX_LEAST;

	return arena + arena / (LISTS_SHARE - 1) + INDEX_LEAST;
}

int phase_needs(const struct phase *s, uint64_t bytes, struct err *err)
{
	char need[32], is[32];

	err_clear(err);
	err_set(err, ERR_LIMIT, "a task needs %s of memory to mesh, and has %s", parse_size_text(bytes, need),
		parse_size_text(s->p->memory, is));
	err->need = bytes;
	return err_add_hint(err, "give tasks more with --task-memory");
}

/* ---- the dataset ---- */

/* Waits for a file of the dataset. */
static int open_segment(void *ctx, const char *file, uint64_t bytes, int *ret_fd, struct err *err)
{
	const struct phase *s = ctx;
	char name[WORK_NAME];

	if (snprintf(name, sizeof name, WORK_IN_DATASET "/%s", file) >= (int)sizeof name)
		return err_set(err, ERR_CORRUPT, "the name of a segment is too long");
	return work_file_open(s->work, name, bytes, ret_fd, err);
}

static int open_grid(struct phase *s, int dirfd, struct err *err)
{
	const struct grid_use use = {.no_lines = true, .late = true, .open = open_segment, .open_ctx = s};
	int r = grid_open_use(dirfd, MANIFEST, GRID_NEWEST, &use, s->ledger, index_bytes(s), &s->grid, err);

	if (r == -ERR_BUSY)
		return phase_needs(s, s->p->memory + s->p->memory / 2, err);
	return r;
}

/* A file that is not seen yet, or not whole, is waited for. */
int phase_open(struct phase *s, struct err *err)
{
	struct work_record *record = NULL;
	int dirfd, fd, r = work_record_need(s->work, WORK_COMMIT, 0, &record, err);

	if (r)
		return r;
	if (!record->nfile)
		r = err_set(err, ERR_CORRUPT, "the record of the commit names no manifest");
	else
		r = work_file_open(s->work, record->file[0].name, record->file[0].size, &fd, err);
	work_record_free(record);
	if (r)
		return r;
	io_close(fd);
	r = io_open(work_fd(s->work), WORK_IN_DATASET, O_RDONLY | O_DIRECTORY, 0, &dirfd, err);
	if (r)
		return r;
	r = open_grid(s, dirfd, err);
	io_close(dirfd);
	return r;
}

/* ---- views ---- */

const char *phase_refuses(const struct view *v)
{
	return v->window          ? "an area" :
	       v->crop            ? "a crop" :
	       v->every > 1       ? "every n-th position" :
	       v->thin.cell       ? "cells with one point" :
	       view_simplifies(v) ? "a bound of errors or of vertices" :
	       v->metric.k        ? "a metric" :
	       v->nweight         ? "weights" :
				    NULL;
}

int mesh_phase_check(const struct ctl_view_options *o, struct err *err)
{
	const struct {
		bool given;
		const char *option;
	} of[] = {
		{o->crop, "--crop"},    {o->bbox, "--bbox"},           {o->polygon, "--polygon"},       {o->every > 1, "--every"},
		{o->thin, "--thin"},    {o->max_error, "--max-error"}, {o->max_points, "--max-points"}, {o->metric, "--metric"},
		{o->weight, "--weight"}};

	for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
		if (!of[i].given)
			continue;
		err_set(err, ERR_UNSUPPORTED, "a run of a cluster makes no mesh with %s", of[i].option);
		return err_add_hint(err, "make the dataset with 'acut-cluster stage', import it, and mesh it with acutctl");
	}
	return 0;
}

/* ---- the plan ---- */

int phase_plan_open(const struct work *w, struct mesh_plan *ret, char name[WORK_NAME], int *ret_fd, struct err *err)
{
	struct work_record *record = NULL;
	int fd = -1, r = work_record_need(w, WORK_PLAN, 0, &record, err);

	if (r)
		return r;
	if (record->nfile != 1 || strlen(record->file[0].name) >= WORK_NAME) {
		r = err_set(err, ERR_CORRUPT, "the record of the plan names no file");
	} else {
		strcpy(name, record->file[0].name);
		r = work_file_open(w, name, record->file[0].size, &fd, err);
	}
	work_record_free(record);
	if (!r)
		r = mesh_plan_read(fd, name, ret, err);
	if (r)
		io_close(fd);
	else
		*ret_fd = fd;
	return r;
}

int mesh_plan_about(const struct work *w, struct mesh_plan_about *ret, struct err *err)
{
	struct mesh_plan plan;
	char name[WORK_NAME];
	int fd, r = phase_plan_open(w, &plan, name, &fd, err);

	if (r)
		return r;
	io_close(fd);
	*ret = (struct mesh_plan_about){.view = plan.view,
					.load = plan.load,
					.cap = plan.cap,
					.tasks = plan.tasks,
					.flat = plan.flat,
					.empty = plan.empty,
					.of = plan.of};
	return 0;
}

void mesh_plan_about_done(struct mesh_plan_about *p)
{
	free(p->view);
	p->view = NULL;
}
