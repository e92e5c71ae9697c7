/*
 * Before a seal: if a stage has more runs than its memory can merge at once, the oldest runs are merged into longer
 * ones, as few of them as necessary.
 */
#include <assert.h>
#include <string.h>

#include "align.h"
#include "err.h"
#include "grid_seal.h"
#include "grid_stage_priv.h"

enum { WINDOW = 8 * DISK_RUN_RECORDS, WRITE = 16 * DISK_RUN_BLOCK };

/* The open runs of one merge, and its memory. */
struct run_merge {
	struct grid_run *run;
	uint64_t *seen;
	size_t n;
	struct grid_merge merge;
	uint8_t *buffer, *blocks;
	struct point *window;
	uint32_t *ids;
};

static size_t lay_out(struct run_merge *o, uint8_t *memory, size_t n)
{
	uint8_t *at = memory;

	o->run = (struct grid_run *)at;
	o->seen = (uint64_t *)(o->run + n);
	at += align_line(n * (sizeof *o->run + sizeof *o->seen));
	grid_merge_init(&o->merge, (unsigned)n, at);
	at += align_line(grid_merge_bytes((unsigned)n));
	o->buffer = at;
	o->window = (struct point *)(at + WRITE);
	o->ids = (uint32_t *)(o->window + WINDOW);
	o->blocks = at + WRITE + align_line(WINDOW * (sizeof *o->window + sizeof *o->ids));
	return (size_t)(o->blocks - memory) + n * DISK_RUN_BLOCK;
}

/* Memory that suffices to merge n runs, into one run as well as into a segment. */
static size_t merge_bytes(size_t n)
{
	uint8_t none[64];
	struct run_merge o;
	size_t run = lay_out(&o, none, n), seal = grid_seal_min_bytes(n);

	return run > seal ? run : seal;
}

static size_t fan_in(const struct grid_stage *s, size_t bytes)
{
	size_t n = bytes / DISK_RUN_BLOCK;

	n = n < GRID_MERGE_INPUTS ? n : GRID_MERGE_INPUTS;
	while (n > 2 && (merge_bytes(n) > bytes || grid_seal_runs_bytes(n) > s->lists_bytes))
		n--;
	assert(merge_bytes(n) <= bytes);
	return n;
}

/* Writes the merged records, in full blocks. */
static int write_merged(struct run_merge *o, struct grid_run_writer *w, struct err *err)
{
	size_t held = 0, got, taken;
	bool end = false;
	int rc = 0;

	grid_merge_start(&o->merge);
	while (rc == 0 && !end) {
		rc = grid_merge_take(&o->merge, o->window + held, o->ids + held, WINDOW - held, &got, err);
		if (rc)
			break;
		end = got < WINDOW - held;
		held += got;
		rc = grid_run_add(w, o->window, o->ids, NULL, held, end, &taken, err);
		if (rc)
			break;
		held -= taken;
		memmove(o->window, o->window + taken, held * sizeof *o->window);
		memmove(o->ids, o->ids + taken, held * sizeof *o->ids);
	}
	return rc;
}

static int open_all(const struct grid_stage *s, struct run_merge *o, size_t n, struct err *err)
{
	char name[GRID_NAME_MAX];
	int rc = 0;

	for (o->n = 0; rc == 0 && o->n < n; o->n++) {
		struct grid_run *run = &o->run[o->n];
		struct grid_run_reader r;

		grid_stage_run_name(s, s->runs[o->n], name);
		rc = grid_run_open(run, s->dirfd, name, false, err);
		if (rc)
			return rc;
		grid_run_read(&r, run, 0, run->blocks, o->blocks + o->n * DISK_RUN_BLOCK, 1);
		o->seen[o->n] = 0;
		rc = grid_merge_run(&o->merge, &r, 0, UINT64_MAX, &o->seen[o->n], err);
	}
	return rc;
}

static int close_all(struct run_merge *o, int rc, struct err *err)
{
	for (size_t i = 0; i < o->n; i++) {
		if (rc == 0 && o->seen[i] != o->run[i].records)
			rc = grid_run_damaged(&o->run[i], 0, "the number of its records differs from its header", err);
		grid_run_close(&o->run[i]);
	}
	return rc;
}

/* Merges the n oldest runs into one, which becomes the newest. */
static int merge_runs(struct grid_stage *s, size_t n, uint8_t *memory, struct err *err)
{
	struct grid_run_writer w = {.file = GRID_FILE_INIT};
	char name[GRID_NAME_MAX];
	struct run_merge o;
	uint64_t records;
	int rc;

	lay_out(&o, memory, n);
	rc = open_all(s, &o, n, err);
	if (rc == 0)
		rc = grid_stage_add_run(s, name, err);
	if (rc == 0)
		rc = grid_run_begin(&w, s->dirfd, name, o.buffer, WRITE, err);
	if (rc == 0)
		rc = write_merged(&o, &w, err);
	rc = close_all(&o, rc, err);
	if (rc == 0)
		rc = grid_run_finish(&w, s->durable, &records, err); /* before the runs that it replaces are removed */
	grid_run_abort(&w);
	if (rc == 0 && s->suspended)
		rc = grid_stage_write_state(s, n, err); /* likewise */
	if (rc == 0)
		grid_stage_drop_runs(s, n);
	return rc;
}

int grid_seal_premerge(struct grid_stage *s, uint8_t **ret, size_t *ret_bytes, struct err *err)
{
	size_t half = s->cap * sizeof *s->pts, bytes = half, most = fan_in(s, half);
	uint8_t *memory = (uint8_t *)s->scratch;
	int rc = 0;

	if (s->nruns > most) {
		rc = grid_stage_spill(s, err); /* now both halves are free */
		memory = (uint8_t *)s->pts;
		bytes = 2 * half;
		most = fan_in(s, bytes);
	}
	while (rc == 0 && s->nruns > most) {
		size_t over = s->nruns - most + 1;

		rc = merge_runs(s, over < most ? over : most, memory, err);
	}
	*ret = memory;
	*ret_bytes = bytes;
	return rc;
}
