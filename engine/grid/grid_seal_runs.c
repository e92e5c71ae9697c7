/*
 * Before a seal: where a stage has more runs than its memory can merge at once, the oldest are merged into longer
 * ones, as few as will do.
 */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_seal.h"
#include "grid_stage_priv.h"

enum { WINDOW = 8 * DISK_RUN_RECORDS, WRITE = 16 * DISK_RUN_BLOCK };

static size_t align(size_t n)
{
	return (n + 63) & ~(size_t)63;
}

/* Memory to merge n runs into one, and to merge n runs into a segment, in one slot. */
static size_t bytes_for(size_t n)
{
	size_t run = align(grid_merge_bytes((unsigned)n)) + WRITE +
		     align(WINDOW * (sizeof(struct point) + sizeof(uint32_t))) + n * DISK_RUN_BLOCK;
	size_t slot = grid_seal_slot_least(n, 1);

	return run > slot ? run : slot;
}

static size_t fan_in(size_t bytes)
{
	size_t n = bytes / DISK_RUN_BLOCK;

	n = n < GRID_MERGE_INPUTS ? n : GRID_MERGE_INPUTS;
	while (n > 2 && bytes_for(n) > bytes)
		n--;
	assert(bytes_for(n) <= bytes);
	return n;
}

/* What is merged goes out in whole blocks. */
static int copy(struct grid_merge *m, struct grid_run_writer *w, struct point *window, uint32_t *ids, struct err *err)
{
	size_t held = 0, got, taken;
	bool end = false;
	int rc = 0;

	grid_merge_start(m);
	while (rc == 0 && !end) {
		rc = grid_merge_take(m, window + held, ids + held, WINDOW - held, &got, err);
		if (rc)
			break;
		end = got < WINDOW - held;
		held += got;
		rc = grid_run_add(w, window, ids, NULL, held, end, &taken, err);
		held -= taken;
		memmove(window, window + taken, held * sizeof *window);
		memmove(ids, ids + taken, held * sizeof *ids);
	}
	return rc;
}

/* The runs of one merge, open. */
struct opened {
	struct grid_run run[GRID_MERGE_INPUTS];
	uint64_t seen[GRID_MERGE_INPUTS];
	size_t n;
};

static int open_all(struct grid_stage *s, struct opened *o, size_t n, struct grid_merge *m, uint8_t *blocks,
		    struct err *err)
{
	char name[GRID_NAME_MAX];
	int rc = 0;

	for (o->n = 0; rc == 0 && o->n < n;) {
		struct grid_run *run = &o->run[o->n];
		struct grid_run_reader r;

		grid_stage_run_name(s, s->runs[o->n], name);
		rc = grid_run_open(run, s->dirfd, name, false, err);
		if (rc)
			break;
		grid_run_read(&r, run, 0, run->blocks, blocks + o->n * (size_t)DISK_RUN_BLOCK, 1);
		o->seen[o->n] = 0;
		rc = grid_merge_run(m, &r, 0, UINT64_MAX, &o->seen[o->n], err);
		o->n++;
	}
	return rc;
}

static int close_all(struct opened *o, int rc, struct err *err)
{
	for (size_t i = 0; i < o->n; i++) {
		if (rc == 0 && o->seen[i] != o->run[i].records)
			rc = grid_run_damaged(&o->run[i], 0, "it has not as many records as its header says", err);
		grid_run_close(&o->run[i]);
	}
	return rc;
}

/* The n oldest runs become one, the newest. */
static int merge_runs(struct grid_stage *s, struct opened *o, size_t n, uint8_t *memory, struct err *err)
{
	uint8_t *buffer = memory + align(grid_merge_bytes((unsigned)n));
	struct point *window = (struct point *)(buffer + WRITE);
	uint32_t *ids = (uint32_t *)(window + WINDOW);
	struct grid_run_writer w = {.file = GRID_FILE_INIT};
	char name[GRID_NAME_MAX];
	struct grid_merge m;
	uint64_t records;

	grid_merge_init(&m, (unsigned)n, memory);
	int rc = open_all(s, o, n, &m, buffer + WRITE + align(WINDOW * (sizeof *window + sizeof *ids)), err);

	if (rc == 0)
		rc = grid_stage_add_run(s, name, err);
	if (rc == 0)
		rc = grid_run_begin(&w, s->dirfd, name, buffer, WRITE, err);
	if (rc == 0)
		rc = copy(&m, &w, window, ids, err);
	rc = close_all(o, rc, err);
	if (rc == 0)
		rc = grid_run_finish(&w, s->durable, &records, err); /* before the runs that it replaces go */
	grid_run_abort(&w);
	if (rc == 0 && s->left)
		rc = grid_stage_write_left(s, n, err); /* likewise */
	if (rc == 0)
		grid_stage_drop_runs(s, n);
	return rc;
}

int grid_seal_prepare(struct grid_stage *s, uint8_t **ret, size_t *ret_bytes, struct err *err)
{
	size_t half = s->cap * sizeof *s->pts, bytes = half, most = fan_in(half);
	uint8_t *memory = (uint8_t *)s->scratch;
	struct opened *o = NULL;
	int rc = 0;

	if (s->nruns > most) {
		rc = grid_stage_spill(s, err); /* then both halves are free */
		memory = (uint8_t *)s->pts;
		bytes = 2 * half;
		most = fan_in(bytes);
	}
	if (rc == 0 && s->nruns > most) {
		o = malloc(sizeof *o);
		if (!o)
			rc = err_set(err, ERR_NOMEM, "no memory to merge runs");
	}
	while (rc == 0 && s->nruns > most) {
		size_t over = s->nruns - most + 1;

		rc = merge_runs(s, o, over < most ? over : most, memory, err);
	}
	free(o);
	*ret = memory;
	*ret_bytes = bytes;
	return rc;
}
