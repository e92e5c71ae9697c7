/*
 * Staging: points in any order become one segment (grid.h).
 *
 * One allocation of params.memory: a file buffer and the pages of the index in front, then two halves,
 * records and the sorter's scratch. When the records' half is full (or has as many sources as a tag can
 * tell apart) it is sorted and becomes a run. Sealing merges the runs, and what is still in memory,
 * straight into the segment; without runs nothing is merged. While merging, scratch holds a block of each
 * run and the window in which cells are found; if there are more runs than that carries, the oldest are
 * merged into longer runs first.
 *
 * Dropping sources, leaving and going on: grid_stage_leave.c.
 *
 * The first failure is final: grid_stage_free then removes every file that the stage made, grid_stage_part all
 * but what was left.
 */
#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_left.h"
#include "grid_segment.h"
#include "grid_stage_priv.h"
#include "io.h"
#include "log.h"

enum { WINDOW_MIN = 4096, WINDOW_MAX = 16384 };

int grid_stage_new(const struct grid_stage_params *params, struct grid_stage **ret, struct err *err)
{
	size_t len = strlen(params->name);

	if (!len || len >= STEM_MAX || strchr(params->name, '/') || params->name[0] == '.')
		return err_set(err, ERR_INTERNAL, "not a name for a segment: '%s'", params->name);
	if (params->memory < GRID_STAGE_MIN)
		return err_set(err, ERR_LIMIT, "staging needs %d bytes of memory, not %zu", GRID_STAGE_MIN,
			       params->memory);
	size_t memory = (params->memory - sizeof(struct grid_stage)) & ~(size_t)63; /* both are what was charged */
	struct grid_stage *s = calloc(1, sizeof *s);

	if (!s || !(s->memory = aligned_alloc(64, memory))) {
		free(s);
		return err_set(err, ERR_NOMEM, "no memory for a stage of %zu bytes", params->memory);
	}
	s->dirfd = params->dirfd;
	s->durable = params->durable;
	snprintf(s->stem, sizeof s->stem, "%s", params->name);
	s->buffer = memory / 16 & ~(size_t)63;
	s->buffer = s->buffer > 1 << 20 ? 1 << 20 : s->buffer < 1 << 17 ? 1 << 17 : s->buffer;
	s->halves = s->memory + grid_segment_bytes(s->buffer);
	s->half = (memory - grid_segment_bytes(s->buffer)) / 2 & ~(size_t)63;
	s->pts = (struct point *)s->halves;
	s->cap = s->half / sizeof *s->pts;
	grid_merge_init(&s->merge);
	*ret = s;
	return 0;
}

static void run_name(const struct grid_stage *s, uint32_t number, char name[GRID_NAME_MAX])
{
	grid_left_run_name(s->stem, number, name);
}

/* ---- sources ---- */

/* Into an ascending list, once: they nearly always come so. */
int grid_stage_insert(uint32_t **list, uint32_t *n, uint32_t *room, uint32_t id, struct err *err)
{
	uint32_t at = *n;

	while (at && (*list)[at - 1] > id)
		at--;
	if (at && (*list)[at - 1] == id)
		return 0;
	if (*n == *room) {
		uint32_t cap = *room ? *room * 2 : 16;
		uint32_t *more = realloc(*list, cap * sizeof *more);

		if (!more)
			return err_set(err, ERR_NOMEM, "no memory for a list of %u sources", cap);
		*list = more;
		*room = cap;
	}
	memmove(*list + at + 1, *list + at, (*n - at) * sizeof **list);
	(*list)[at] = id;
	++*n;
	return 0;
}

static int remember(struct grid_stage *s, uint32_t id, struct err *err)
{
	return grid_stage_insert(&s->all, &s->nall, &s->allcap, id, err);
}

static int by_id(const void *a, const void *b)
{
	uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

	return x < y ? -1 : x > y;
}

/* Make the order of the indices in the tags the order of the sources, so that sorting by tag sorts by
 * source. */
static void rank_sources(struct grid_stage *s)
{
	uint32_t sorted[POINT_SOURCES];
	uint16_t rank[POINT_SOURCES];
	bool ascending = true;

	for (uint32_t i = 1; i < s->ntable; i++)
		ascending = ascending && s->table[i - 1] < s->table[i];
	if (ascending)
		return;
	memcpy(sorted, s->table, s->ntable * sizeof *sorted);
	qsort(sorted, s->ntable, sizeof *sorted, by_id);
	for (uint32_t i = 0; i < s->ntable; i++) {
		const uint32_t *hit = bsearch(&s->table[i], sorted, s->ntable, sizeof *sorted, by_id);

		rank[i] = (uint16_t)(hit - sorted);
	}
	for (size_t i = 0; i < s->n; i++) {
		unsigned index = rank[point_source(&s->pts[i])];

		s->pts[i].tag = (uint16_t)(point_flags(&s->pts[i]) | index << POINT_SOURCE_SHIFT);
	}
	memcpy(s->table, sorted, s->ntable * sizeof *sorted);
}

static void sort_memory(struct grid_stage *s)
{
	rank_sources(s);
	point_sort(s->pts, (struct point *)(s->halves + s->half), s->n);
}

/* ---- runs ---- */

static int add_run(struct grid_stage *s, uint32_t number, struct err *err)
{
	if (s->nruns == s->runcap) {
		size_t cap = s->runcap ? s->runcap * 2 : 64;
		uint32_t *runs = realloc(s->runs, cap * sizeof *runs);

		if (!runs)
			return err_set(err, ERR_NOMEM, "no memory for a list of %zu runs", cap);
		s->runs = runs;
		s->runcap = cap;
	}
	s->runs[s->nruns++] = number;
	s->unsynced = true;
	return 0;
}

/* What is in memory becomes a run. `source` is void afterwards. */
static int spill(struct grid_stage *s, struct err *err)
{
	struct grid_run_writer w;
	char name[GRID_NAME_MAX];
	uint64_t records;
	int rc;

	if (!s->n) {
		s->ntable = 0;
		return 0;
	}
	sort_memory(s);
	rc = add_run(s, s->next_run, err); /* first: a file that exists is in the list */
	if (rc)
		return rc;
	run_name(s, s->next_run++, name);
	rc = grid_run_begin(&w, s->dirfd, name, s->memory, s->buffer, err);
	if (rc == 0)
		rc = grid_run_add(&w, s->pts, NULL, s->table, s->n, err);
	if (rc == 0)
		rc = grid_run_finish(&w, s->durable, &records, err);
	grid_run_abort(&w);
	s->n = 0;
	s->ntable = 0;
	return rc;
}

/* ---- adding ---- */

int grid_stage_fail(struct grid_stage *s, int rc)
{
	if (rc)
		s->failed = true;
	return rc;
}

int grid_stage_usable(const struct grid_stage *s, struct err *err)
{
	if (!s->failed && !s->sealed)
		return 0;
	return err_set(err, ERR_INTERNAL, "the stage was used after it %s",
		       s->failed ? "failed" : "was sealed");
}

int grid_stage_source(struct grid_stage *s, uint32_t id, struct err *err)
{
	int rc = grid_stage_usable(s, err);

	if (rc)
		return rc;
	if (!id)
		return err_set(err, ERR_INTERNAL, "0 is no source");
	rc = remember(s, id, err);
	if (rc)
		return grid_stage_fail(s, rc);
	for (uint32_t i = 0; i < s->ntable; i++) {
		if (s->table[i] == id) {
			s->source = i;
			return 0;
		}
	}
	if (s->ntable == GRID_RUN_SOURCES)
		rc = spill(s, err);
	if (rc)
		return grid_stage_fail(s, rc);
	s->source = s->ntable;
	s->table[s->ntable++] = id;
	return 0;
}

int grid_stage_add(struct grid_stage *s, const struct point *pts, size_t n, struct err *err)
{
	int rc = grid_stage_usable(s, err);

	if (rc)
		return rc;
	if (!s->ntable)
		return err_set(err, ERR_INTERNAL, "points without a source");
	while (n) {
		size_t part = s->cap - s->n < n ? s->cap - s->n : n;

		if (!part) {
			uint32_t id = s->table[s->source];

			rc = spill(s, err);
			if (rc)
				return grid_stage_fail(s, rc);
			s->table[0] = id;
			s->ntable = 1;
			s->source = 0;
			continue;
		}
		for (size_t i = 0; i < part; i++) {
			struct point *p = &s->pts[s->n + i];

			*p = pts[i];
			p->tag = (uint16_t)((p->tag & POINT_FLAGS) | s->source << POINT_SOURCE_SHIFT);
		}
		s->n += part;
		pts += part;
		n -= part;
	}
	return 0;
}

/* What is in memory becomes a run, and the source that is being added stays. */
int grid_stage_spill(struct grid_stage *s, struct err *err)
{
	uint32_t id = s->ntable ? s->table[s->source] : 0;
	int rc = spill(s, err);

	if (rc == 0 && id) {
		s->table[0] = id;
		s->ntable = 1;
		s->source = 0;
	}
	return rc;
}

int grid_stage_sync(struct grid_stage *s, struct err *err)
{
	int rc = grid_stage_usable(s, err);

	if (rc || !s->durable)
		return rc;
	rc = grid_stage_spill(s, err);
	if (rc)
		return grid_stage_fail(s, rc);
	if (s->unsynced)
		rc = io_sync(s->dirfd, s->stem, err);
	s->unsynced = rc != 0;
	return grid_stage_fail(s, rc);
}

/* ---- sealing ---- */

/* Memory for merging: a window, and behind it a block for each run. */
struct bench {
	struct point *window;
	uint32_t *ids;
	size_t records;
	uint8_t *blocks;
	size_t fan_in;
};

static struct bench bench_of(void *memory, size_t bytes)
{
	struct bench b = {.window = memory};
	size_t each = sizeof *b.window + sizeof *b.ids;

	b.records = bytes / 8 / each;
	b.records = b.records < WINDOW_MIN ? WINDOW_MIN : b.records > WINDOW_MAX ? WINDOW_MAX : b.records;
	b.ids = (uint32_t *)(b.window + b.records);
	b.blocks = (uint8_t *)memory + ((b.records * each + 63) & ~(size_t)63);
	b.fan_in =
	    (bytes - (size_t)(b.blocks - (uint8_t *)memory)) / ((DISK_RUN_BLOCK_MAX + 63) & ~(size_t)63);
	b.fan_in = b.fan_in < GRID_MERGE_INPUTS ? b.fan_in : GRID_MERGE_INPUTS;
	assert(b.fan_in >= 2);
	return b;
}

static int open_runs(struct grid_stage *s, size_t n, const struct bench *b, struct err *err)
{
	char name[GRID_NAME_MAX];
	int rc = 0;

	for (size_t i = 0; rc == 0 && i < n; i++) {
		run_name(s, s->runs[i], name);
		rc = grid_merge_run(&s->merge, s->dirfd, name,
				    b->blocks + i * ((DISK_RUN_BLOCK_MAX + 63) & ~(size_t)63), err);
	}
	return rc;
}

void grid_stage_remove_run(struct grid_stage *s, uint32_t number)
{
	struct err err = ERR_INIT;
	char name[GRID_NAME_MAX];

	run_name(s, number, name);
	if (io_remove(s->dirfd, name, &err) == 0)
		return;
	s->litter = true;
	log_err(LOG_LEVEL_DEBUG, "a sorted run stays behind", &err);
}

/* Runs that are not needed any more. Whether they go matters to the disk's space only, not to the result:
 * what stays is tried again in the end. */
static void drop_runs(struct grid_stage *s, size_t n)
{
	for (size_t i = 0; i < n; i++)
		grid_stage_remove_run(s, s->runs[i]);
	s->nruns -= n;
	if (s->nruns)
		memmove(s->runs, s->runs + n, s->nruns * sizeof *s->runs);
}

/* The n oldest runs become one, the newest. */
static int merge_runs(struct grid_stage *s, size_t n, const struct bench *b, struct err *err)
{
	struct grid_run_writer w = {.file = GRID_FILE_INIT};
	char name[GRID_NAME_MAX];
	uint64_t records;
	size_t got = 0;
	int rc = open_runs(s, n, b, err);

	if (rc == 0)
		rc = add_run(s, s->next_run, err);
	if (rc == 0) {
		run_name(s, s->next_run++, name);
		rc = grid_run_begin(&w, s->dirfd, name, s->memory, s->buffer, err);
	}
	if (rc == 0)
		grid_merge_start(&s->merge);
	do {
		if (rc == 0)
			rc = grid_merge_take(&s->merge, b->window, b->ids, b->records, &got, err);
		if (rc == 0)
			rc = grid_run_add(&w, b->window, b->ids, NULL, got, err);
	} while (rc == 0 && got == b->records);
	if (rc == 0)
		rc = grid_run_finish(&w, s->durable, &records, err); /* before the runs that it replaces go */
	grid_run_abort(&w);
	grid_merge_close(&s->merge);
	if (rc == 0 && s->left)
		rc = grid_stage_write_left(s, n, err); /* likewise */
	if (rc == 0)
		drop_runs(s, n);
	return rc;
}

/* The merged stream, through the window, into the segment. */
static int merge_segment(struct grid_stage *s, struct grid_segment *seg, const struct bench *b,
			 struct err *err)
{
	uint32_t *ids = s->nall > 1 || s->ndead ? b->ids : NULL;
	size_t held = 0, got = 0, taken = 0;
	bool end = false;
	int rc = 0;

	grid_merge_start(&s->merge);
	while (rc == 0 && !end) {
		size_t want = b->records - held;

		rc = grid_merge_take(&s->merge, b->window + held, ids ? ids + held : NULL, want, &got, err);
		if (rc)
			break;
		end = got < want;
		got = grid_stage_leave_out(s, b->window + held, ids ? ids + held : NULL, got);
		held += got;
		if (!ids)
			for (size_t i = held - got; i < held; i++)
				b->window[i].tag &= POINT_FLAGS; /* index 0 of `all` */
		rc = grid_segment_add(seg, b->window, ids, s->all, held, end, &taken, err);
		if (rc)
			break;
		held -= taken;
		memmove(b->window, b->window + taken, held * sizeof *b->window);
		if (ids)
			memmove(ids, ids + taken, held * sizeof *ids);
	}
	return rc;
}

/* Fewer runs than can be merged at once, and a bench for them. */
static int prepare_runs(struct grid_stage *s, struct bench *ret, struct err *err)
{
	struct bench b = bench_of(s->halves + s->half, s->half);
	int rc = 0;

	if (s->nruns > b.fan_in) {
		rc = spill(s, err); /* then both halves are free */
		b = bench_of(s->halves, 2 * s->half);
	}
	while (rc == 0 && s->nruns > b.fan_in) {
		size_t over = s->nruns - b.fan_in + 1;

		rc = merge_runs(s, over < b.fan_in ? over : b.fan_in, &b, err);
	}
	*ret = b;
	return rc;
}

static int seal(struct grid_stage *s, struct grid_segment_info *ret, struct err *err)
{
	struct grid_segment seg;
	struct bench b = {0};
	char name[GRID_NAME_MAX];
	size_t taken;
	int rc = s->nruns ? prepare_runs(s, &b, err) : 0;

	if (rc)
		return rc;
	if (s->n)
		sort_memory(s);
	snprintf(name, sizeof name, "%s.seg", s->stem);
	rc = grid_segment_begin(&seg, s->dirfd, name, s->all, s->nall, s->memory, s->buffer, err);
	if (rc)
		return rc;
	if (!s->nruns) {
		rc = grid_segment_add(&seg, s->pts, NULL, s->table, s->n, true, &taken, err);
	} else {
		rc = open_runs(s, s->nruns, &b, err);
		if (s->n)
			grid_merge_memory(&s->merge, s->pts, s->n, s->table);
		if (rc == 0)
			rc = merge_segment(s, &seg, &b, err);
		grid_merge_close(&s->merge);
	}
	if (rc == 0)
		rc = grid_segment_finish(&seg, ret, err);
	grid_segment_abort(&seg);
	return rc;
}

int grid_stage_seal(struct grid_stage *s, struct grid_segment_info *ret, struct err *err)
{
	int rc = grid_stage_usable(s, err);

	if (rc)
		return rc;
	rc = seal(s, ret, err);
	if (rc)
		return grid_stage_fail(s, rc);
	if (!s->left)
		drop_runs(s, s->nruns);
	s->sealed = true;
	s->n = 0;
	return 0;
}

struct grid_stage *grid_stage_release(struct grid_stage *s)
{
	free(s->runs);
	free(s->all);
	free(s->dead);
	free(s->memory);
	free(s);
	return NULL;
}

struct grid_stage *grid_stage_free(struct grid_stage *s)
{
	struct err err = ERR_INIT;
	char name[GRID_NAME_MAX];

	if (!s)
		return NULL;
	grid_left_name(s->stem, name);
	/* First what names the runs. */
	if (s->left && io_remove(s->dirfd, name, &err))
		log_err(LOG_LEVEL_DEBUG, "the state of a stage stays behind", &err);
	drop_runs(s, s->nruns);
	for (uint32_t i = 0; s->litter && i < s->next_run; i++)
		grid_stage_remove_run(s, i);
	return grid_stage_release(s);
}

