/*
 * Staging (grid_stage.h): points in any order become one segment.
 *
 * There is one allocation of params.memory: index pages, then two halves, records and scratch. When the records' half is
 * full, or has as many sources as a tag can distinguish, it is sorted and written to a run through the scratch. If
 * several threads add points, the half is split into lanes, each with its part of the scratch. A thread that fills a
 * lane sorts it and writes it while the others continue. Afterwards the records in the lanes are moved together.
 *
 * Sealing: grid_seal.c. Dropping sources, suspending and resuming: grid_stage_suspend.c.
 *
 * The first failure is final: grid_stage_free then removes every file of the stage, grid_stage_detach all files that are
 * not in its state.
 */
#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "err.h"
#include "grid_seal.h"
#include "grid_segment_writer.h"
#include "grid_stage_priv.h"
#include "grid_state.h"
#include "io.h"
#include "log.h"
#include "order.h"

enum {
	MIN_LANE = 1 << 14, /* records */
	MAX_WRITE = 1 << 20,
	MAX_LISTS = 1 << 16,
	HUGE_PAGE = 2 << 20,
	MIN_HUGE = (4 << 20) / sizeof(struct point), /* records */
	PAGE = 4096,
	MIN_TOUCH = 8 * PAGE,
};

int grid_stage_new(const struct grid_stage_params *params, struct grid_stage **ret, struct err *err)
{
	size_t len = strlen(params->name);

	if (!len || len >= STEM_MAX || strchr(params->name, '/') || params->name[0] == '.')
		return err_set(err, ERR_INTERNAL, "not a name for a segment: '%s'", params->name);
	if (params->memory < GRID_STAGE_MIN)
		return err_set(err, ERR_LIMIT, "staging needs %d bytes of memory, not %zu", GRID_STAGE_MIN, params->memory);
	/* The structs are part of the memory that was charged. */
	size_t memory = (params->memory - sizeof(struct grid_stage) - grid_seal_bytes()) & ~(size_t)63;
	struct grid_stage *s = calloc(1, sizeof *s);

	void *pages = NULL;

	if (!s || posix_memalign(&pages, memory < HUGE_PAGE ? 64 : HUGE_PAGE, memory)) {
		free(s);
		return err_set(err, ERR_NOMEM, "no memory for a stage of %zu bytes", params->memory);
	}
	s->pages = pages;
	s->memory = memory;
	s->why = ERR_INIT;
	s->dirfd = params->dirfd;
	s->segment_dirfd = params->segment_dirfd ? params->segment_dirfd : params->dirfd;
	s->durable = params->durable;
	snprintf(s->stem, sizeof s->stem, "%s", params->name);
	snprintf(s->segment, sizeof s->segment, "%s", params->segment ? params->segment : params->name);
	s->temporary = params->temporary;
	s->folder_later = params->folder_later;
	s->ready = params->ready;
	s->ready_ctx = params->ready_ctx;
	s->lists = s->pages + grid_segment_writer_bytes();
	s->lists_bytes = memory / 64 < MAX_LISTS ? memory / 64 & ~(size_t)63 : MAX_LISTS;
	s->cap = (memory - grid_segment_writer_bytes() - s->lists_bytes) / 2 / 64 * 64 / sizeof *s->pts;
	s->pts = (struct point *)(s->lists + s->lists_bytes);
	s->scratch = s->pts + s->cap;
	s->lanes = 1;
	s->lane[0].cap = s->cap;
	*ret = s;
	return 0;
}

void grid_stage_run_name(const struct grid_stage *s, uint32_t number, char name[GRID_NAME_MAX])
{
	grid_run_name(s->stem, number, name);
}

/* ---- sources ---- */

int grid_stage_insert(uint32_t **list, uint32_t *n, uint32_t *cap, uint32_t id, struct err *err)
{
	uint32_t at = *n; /* ids nearly always come in ascending order */

	while (at && (*list)[at - 1] > id)
		at--;
	if (at && (*list)[at - 1] == id)
		return 0;
	if (*n == *cap) {
		uint32_t larger = *cap ? *cap * 2 : 16;
		uint32_t *more = realloc(*list, larger * sizeof *more);

		if (!more)
			return err_set(err, ERR_NOMEM, "no memory for a list of %u sources", larger);
		*list = more;
		*cap = larger;
	}
	memmove(*list + at + 1, *list + at, (*n - at) * sizeof **list);
	(*list)[at] = id;
	++*n;
	return 0;
}

/* Changes nothing if the table is in order, so threads may call it at the same time then. */
void grid_stage_rank(struct grid_stage *s)
{
	uint32_t sorted[POINT_SOURCES];
	uint16_t rank[POINT_SOURCES];
	bool ascending = true;

	for (uint32_t i = 1; i < s->ntable; i++)
		ascending = ascending && s->table[i - 1] < s->table[i];
	if (ascending)
		return;
	memcpy(sorted, s->table, s->ntable * sizeof *sorted);
	qsort(sorted, s->ntable, sizeof *sorted, order_u32);
	for (uint32_t i = 0; i < s->ntable; i++) {
		const uint32_t *hit = bsearch(&s->table[i], sorted, s->ntable, sizeof *sorted, order_u32);

		rank[i] = (uint16_t)(hit - sorted);
	}
	for (size_t i = 0; i < s->lane[0].n; i++) {
		unsigned index = rank[point_source(&s->pts[i])];

		s->pts[i].tag = (uint16_t)(point_flags(&s->pts[i]) | index << POINT_SOURCE_SHIFT);
	}
	s->source = rank[s->source];
	memcpy(s->table, sorted, s->ntable * sizeof *sorted);
}

/* ---- runs ---- */

int grid_stage_add_run(struct grid_stage *s, char ret_name[GRID_NAME_MAX], struct err *err)
{
	if (s->nruns == s->runcap) {
		size_t cap = s->runcap ? s->runcap * 2 : 64;
		uint32_t *runs = realloc(s->runs, cap * sizeof *runs);

		if (!runs)
			return err_set(err, ERR_NOMEM, "no memory for a list of %zu runs", cap);
		s->runs = runs;
		s->runcap = cap;
	}
	grid_stage_run_name(s, s->next_run, ret_name);
	s->runs[s->nruns++] = s->next_run++; /* before the file exists, so every file is in the list */
	s->unsynced = true;
	return 0;
}

static void lock(const struct grid_stage *s)
{
	if (s->guard.lock)
		s->guard.lock(s->guard.ctx);
}

static void unlock(const struct grid_stage *s)
{
	if (s->guard.lock)
		s->guard.unlock(s->guard.ctx);
}

/* Writes the points of a lane to a run. */
static int spill_lane(struct grid_stage *s, struct grid_lane *l, struct err *err)
{
	struct point *pts = s->pts + l->first, *scratch = s->scratch + l->first;
	size_t bytes = l->cap * sizeof *scratch, taken;
	struct grid_run_writer w = {.file = GRID_FILE_INIT};
	char name[GRID_NAME_MAX];
	uint64_t records;
	int rc;

	if (!l->n)
		return 0;
	point_sort(pts, scratch, l->n);
	rc = s->ready ? s->ready(s->ready_ctx, err) : 0;
	if (rc)
		return rc;
	lock(s);
	rc = grid_stage_add_run(s, name, err);
	unlock(s);
	if (rc == 0)
		rc = grid_run_begin(&w, s->dirfd, name, scratch, bytes < MAX_WRITE ? bytes : MAX_WRITE, err);
	if (rc == 0)
		rc = grid_run_add(&w, pts, NULL, s->table, l->n, true, &taken, err);
	if (rc == 0)
		rc = grid_run_finish(&w, s->durable, &records, err);
	grid_run_abort(&w);
	return rc;
}

/* Writes all points in memory to a run. `source` is invalid afterwards. */
static int spill(struct grid_stage *s, struct err *err)
{
	grid_stage_rank(s);
	int rc = spill_lane(s, &s->lane[0], err);

	s->lane[0].n = 0;
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

/* Moves the points of all lanes together, into the first. */
static void join_lanes(struct grid_stage *s)
{
	struct grid_lane *first = &s->lane[0];

	for (unsigned i = 1; i < s->lanes; i++) {
		memmove(s->pts + first->n, s->pts + s->lane[i].first, s->lane[i].n * sizeof *s->pts);
		first->n += s->lane[i].n;
	}
	first->cap = s->cap;
	s->lanes = 1;
	s->guard = (struct grid_guard){0};
}

int grid_stage_usable(struct grid_stage *s, struct err *err)
{
	join_lanes(s);
	if (!s->failed && !s->sealed)
		return 0;
	return err_set(err, ERR_INTERNAL, "the stage was used after it %s", s->failed ? "failed" : "was sealed");
}

int grid_stage_source(struct grid_stage *s, uint32_t id, struct err *err)
{
	int rc = grid_stage_usable(s, err);

	if (rc)
		return rc;
	if (!id)
		return err_set(err, ERR_INTERNAL, "0 is no source");
	rc = grid_stage_insert(&s->all, &s->nall, &s->allcap, id, err);
	if (rc)
		return grid_stage_fail(s, rc);
	for (uint32_t i = 0; i < s->ntable; i++) {
		if (s->table[i] == id) {
			s->source = i;
			return 0;
		}
	}
	if (s->ntable == POINT_SOURCES)
		rc = spill(s, err);
	if (rc)
		return grid_stage_fail(s, rc);
	s->source = s->ntable;
	s->table[s->ntable++] = id;
	return 0;
}

/* Requests huge pages: sorting accesses all of the memory. A small push does without, because the kernel clears whole pages. A
 * failure only costs time. */
static void request_huge_pages(struct grid_stage *s, const struct grid_lane *l)
{
	if (s->huge || l->n < MIN_HUGE / s->lanes)
		return;
	s->huge = true;
	madvise(s->pages, s->memory, MADV_HUGEPAGE);
}

void grid_stage_touch(const struct grid_stage *s, void *from, size_t bytes)
{
#ifdef MADV_POPULATE_WRITE
	size_t before = (uintptr_t)from & (PAGE - 1);

	/* If it fails, the pages are populated when they are written. */
	if (!s->huge && bytes >= MIN_TOUCH)
		madvise((uint8_t *)from - before, before + bytes, MADV_POPULATE_WRITE);
#endif
}

static void copy_points(const struct grid_stage *s, struct point *to, const struct point *pts, size_t n)
{
	uint16_t source = (uint16_t)(s->source << POINT_SOURCE_SHIFT);

	for (size_t i = 0; i < n; i++) {
		to[i] = pts[i];
		to[i].tag = (uint16_t)((pts[i].tag & POINT_FLAGS) | source);
	}
}

int grid_stage_add(struct grid_stage *s, const struct point *pts, size_t n, struct err *err)
{
	struct grid_lane *l = &s->lane[0];
	int rc = grid_stage_usable(s, err);

	if (rc)
		return rc;
	if (!s->ntable)
		return err_set(err, ERR_INTERNAL, "points without a source");
	while (n) {
		size_t part = l->cap - l->n < n ? l->cap - l->n : n;

		if (!part) {
			rc = grid_stage_spill(s, err);
			if (rc)
				return grid_stage_fail(s, rc);
			continue;
		}
		grid_stage_touch(s, s->pts + l->n, part * sizeof *pts);
		copy_points(s, s->pts + l->n, pts, part);
		l->n += part;
		request_huge_pages(s, l);
		pts += part;
		n -= part;
	}
	return 0;
}

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

/* ---- lanes ---- */

unsigned grid_stage_lanes(const struct grid_stage *s)
{
	size_t n = s->cap / MIN_LANE;

	return n < 1 ? 1 : n < GRID_LANES ? (unsigned)n : GRID_LANES;
}

int grid_stage_split(struct grid_stage *s, unsigned lanes, const struct grid_guard *guard, struct err *err)
{
	int rc = grid_stage_usable(s, err);

	if (rc)
		return rc;
	if (!s->ntable || !lanes || lanes > grid_stage_lanes(s))
		return err_set(err, ERR_INTERNAL, "a stage cannot be split into so many lanes");
	/* The table must be in order before the split. If little memory is left, the lanes would be too small. */
	if (s->cap - s->lane[0].n < s->cap / 8)
		rc = grid_stage_spill(s, err);
	if (rc)
		return grid_stage_fail(s, rc);
	grid_stage_rank(s);

	size_t each = s->cap / lanes;

	if (s->lane[0].n > each) /* the first lane already has more than its share */
		each = (s->cap - s->lane[0].n) / lanes;
	s->guard = *guard;
	s->lane[0].cap = s->cap - each * (lanes - 1);
	for (unsigned i = 1; i < lanes; i++)
		s->lane[i] = (struct grid_lane){.first = s->lane[0].cap + (i - 1) * each, .cap = each};
	s->lanes = lanes;
	return 0;
}

/* Returns the idle lane with the most space. A lane is written out only when all are full, so this waits while the only
 * lanes with space are busy. Under the lock. */
static struct grid_lane *choose_lane(struct grid_stage *s)
{
	for (;;) {
		struct grid_lane *best = NULL;
		bool space = false;

		for (unsigned i = 0; i < s->lanes; i++) {
			struct grid_lane *l = &s->lane[i];

			space |= l->n < l->cap;
			if (!l->busy && (!best || l->cap - l->n > best->cap - best->n))
				best = l;
		}
		if (best && (!space || best->n < best->cap))
			return best;
		s->guard.wait(s->guard.ctx);
	}
}

int grid_stage_share(struct grid_stage *s, const struct point *pts, size_t n, struct err *err)
{
	int rc = 0;

	lock(s);
	while (rc == 0 && n && !s->failed) {
		struct grid_lane *l = choose_lane(s);
		size_t part = l->cap - l->n < n ? l->cap - l->n : n;

		struct point *to = s->pts + l->first + l->n;

		l->busy = true;
		l->n += part;
		request_huge_pages(s, l);
		unlock(s);
		if (part)
			copy_points(s, to, pts, part);
		else
			rc = spill_lane(s, l, err);
		lock(s);
		l->busy = false;
		l->n = part ? l->n : 0;
		s->guard.wake(s->guard.ctx);
		pts += part;
		n -= part;
	}
	/* All threads return the first failure, because the caller may report only one of them. */
	if (rc && !s->failed) {
		s->why = *err;
		s->failed = true;
	} else if (n) {
		err_set(&s->why, ERR_INTERNAL, "the stage was used after it failed");
		rc = -(int)(*err = s->why).code;
	}
	unlock(s);
	return rc;
}

/* ---- the end ---- */

void grid_stage_remove_run(struct grid_stage *s, uint32_t number)
{
	struct err err = ERR_INIT;
	char name[GRID_NAME_MAX];

	grid_stage_run_name(s, number, name);
	if (io_remove(s->dirfd, name, &err) == 0)
		return;
	s->leftovers = true;
	log_err(LOG_LEVEL_DEBUG, "a sorted run could not be removed", &err);
}

/* A failure is not an error, because it only wastes space; grid_stage_free tries again. */
void grid_stage_drop_runs(struct grid_stage *s, size_t n)
{
	for (size_t i = 0; i < n; i++)
		grid_stage_remove_run(s, s->runs[i]);
	s->nruns -= n;
	if (s->nruns)
		memmove(s->runs, s->runs + n, s->nruns * sizeof *s->runs);
}

struct grid_stage *grid_stage_release(struct grid_stage *s)
{
	free(s->runs);
	free(s->all);
	free(s->dropped);
	free(s->pages);
	free(s);
	return NULL;
}

struct grid_stage *grid_stage_free(struct grid_stage *s)
{
	struct err err = ERR_INIT;
	char name[GRID_NAME_MAX];

	if (!s)
		return NULL;
	grid_state_name(s->stem, name);
	/* The state goes first, because it names the runs. */
	if (s->suspended && io_remove(s->dirfd, name, &err))
		log_err(LOG_LEVEL_DEBUG, "the state of a stage could not be removed", &err);
	grid_stage_drop_runs(s, s->nruns);
	for (uint32_t i = 0; s->leftovers && i < s->next_run; i++)
		grid_stage_remove_run(s, i);
	return grid_stage_release(s);
}
