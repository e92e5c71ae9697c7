/*
 * Staging: points in any order become one segment (grid.h).
 *
 * One allocation of params.memory: the pages of the index in front, then two halves, records and scratch. When the
 * records' half is full (or has as many sources as a tag can tell apart) it is sorted and becomes a run, written
 * through the scratch. Where several threads add, the half is split into lanes, each with its part of the scratch: who
 * fills one sorts it and writes it out while the others go on. Afterwards what is left in them closes up.
 *
 * Sealing: grid_seal.c. Dropping sources, leaving and going on: grid_stage_leave.c.
 *
 * The first failure is final: grid_stage_free then removes every file that the stage made, grid_stage_part all
 * but what was left.
 */
#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "err.h"
#include "grid_left.h"
#include "grid_seal.h"
#include "grid_segment.h"
#include "grid_stage_priv.h"
#include "io.h"
#include "log.h"

enum {
	LANE_LEAST = 1 << 14, /* records */
	WRITE_MOST = 1 << 20,
	LISTS_MOST = 1 << 16,
	HUGE_PAGE = 2 << 20,
	HUGE_FROM = (4 << 20) / sizeof(struct point), /* records */
	PAGE = 4096,
	TOUCH_LEAST = 8 * PAGE,
};

int grid_stage_new(const struct grid_stage_params *params, struct grid_stage **ret, struct err *err)
{
	size_t len = strlen(params->name);

	if (!len || len >= STEM_MAX || strchr(params->name, '/') || params->name[0] == '.')
		return err_set(err, ERR_INTERNAL, "not a name for a segment: '%s'", params->name);
	if (params->memory < GRID_STAGE_MIN)
		return err_set(err, ERR_LIMIT, "staging needs %d bytes of memory, not %zu", GRID_STAGE_MIN, params->memory);
	/* All of these are what was charged. */
	size_t memory = (params->memory - sizeof(struct grid_stage) - grid_seal_bytes()) & ~(size_t)63;
	struct grid_stage *s = calloc(1, sizeof *s);

	void *room = NULL;

	if (!s || posix_memalign(&room, memory < HUGE_PAGE ? 64 : HUGE_PAGE, memory)) {
		free(s);
		return err_set(err, ERR_NOMEM, "no memory for a stage of %zu bytes", params->memory);
	}
	s->pages = room;
	s->memory = memory;
	s->why = ERR_INIT;
	s->dirfd = params->dirfd;
	s->durable = params->durable;
	snprintf(s->stem, sizeof s->stem, "%s", params->name);
	s->passing = params->passing;
	s->folder_later = params->folder_later;
	s->ready = params->ready;
	s->ready_ctx = params->ready_ctx;
	s->lists = s->pages + grid_segment_bytes();
	s->lists_bytes = memory / 64 < LISTS_MOST ? memory / 64 & ~(size_t)63 : LISTS_MOST;
	s->cap = (memory - grid_segment_bytes() - s->lists_bytes) / 2 / 64 * 64 / sizeof *s->pts;
	s->pts = (struct point *)(s->lists + s->lists_bytes);
	s->scratch = s->pts + s->cap;
	s->lanes = 1;
	s->lane[0].cap = s->cap;
	*ret = s;
	return 0;
}

void grid_stage_run_name(const struct grid_stage *s, uint32_t number, char name[GRID_NAME_MAX])
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

/* Where the table is in order nothing is touched: then threads may do this side by side. */
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
	qsort(sorted, s->ntable, sizeof *sorted, by_id);
	for (uint32_t i = 0; i < s->ntable; i++) {
		const uint32_t *hit = bsearch(&s->table[i], sorted, s->ntable, sizeof *sorted, by_id);

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
	s->runs[s->nruns++] = s->next_run++; /* first: a file that exists is in the list */
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

/* What is in a lane becomes a run. */
static int spill_lane(struct grid_stage *s, struct grid_lane *l, struct err *err)
{
	struct point *pts = s->pts + l->first, *scratch = s->scratch + l->first;
	size_t room = l->cap * sizeof *scratch, taken;
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
		rc = grid_run_begin(&w, s->dirfd, name, scratch, room < WRITE_MOST ? room : WRITE_MOST, err);
	if (rc == 0)
		rc = grid_run_add(&w, pts, NULL, s->table, l->n, true, &taken, err);
	if (rc == 0)
		rc = grid_run_finish(&w, s->durable, &records, err);
	grid_run_abort(&w);
	return rc;
}

/* All that is in memory becomes a run. `source` is void afterwards. */
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

/* What is in the other lanes closes up behind the first. */
static void join(struct grid_stage *s)
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
	join(s);
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

/* Sorting goes to and fro in all of it. To no avail: it is slower. A small push is faster without: the kernel clears whole pages.
 */
static void look_huge(struct grid_stage *s, const struct grid_lane *l)
{
	if (s->huge || l->n < HUGE_FROM / s->lanes)
		return;
	s->huge = true;
	madvise(s->pages, s->memory, MADV_HUGEPAGE);
}

void grid_stage_touch(const struct grid_stage *s, void *from, size_t bytes)
{
#ifdef MADV_POPULATE_WRITE
	size_t before = (uintptr_t)from & (PAGE - 1);

	/* To no avail: then page by page, when they are written. */
	if (!s->huge && bytes >= TOUCH_LEAST)
		madvise((uint8_t *)from - before, before + bytes, MADV_POPULATE_WRITE);
#endif
}

static void put(const struct grid_stage *s, struct point *to, const struct point *pts, size_t n)
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
		put(s, s->pts + l->n, pts, part);
		l->n += part;
		look_huge(s, l);
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

/* ---- lanes ---- */

unsigned grid_stage_lanes(const struct grid_stage *s)
{
	size_t n = s->cap / LANE_LEAST;

	return n < 1 ? 1 : n < GRID_LANES ? (unsigned)n : GRID_LANES;
}

int grid_stage_split(struct grid_stage *s, unsigned lanes, const struct grid_guard *guard, struct err *err)
{
	int rc = grid_stage_usable(s, err);

	if (rc)
		return rc;
	if (!s->ntable || !lanes || lanes > grid_stage_lanes(s))
		return err_set(err, ERR_INTERNAL, "a stage cannot be split so");
	/* The order of the table is not changed while it is split. Nor is there much use in small lanes. */
	if (s->cap - s->lane[0].n < s->cap / 8)
		rc = grid_stage_spill(s, err);
	if (rc)
		return grid_stage_fail(s, rc);
	grid_stage_rank(s);

	size_t each = s->cap / lanes;

	if (s->lane[0].n > each) /* it has more than its share already */
		each = (s->cap - s->lane[0].n) / lanes;
	s->guard = *guard;
	s->lane[0].cap = s->cap - each * (lanes - 1);
	for (unsigned i = 1; i < lanes; i++)
		s->lane[i] = (struct grid_lane){.first = s->lane[0].cap + (i - 1) * each, .cap = each};
	s->lanes = lanes;
	return 0;
}

/* Of the lanes that nobody is at, that with the most room. All are full before one is written out: while one that
 * has room is added to, it is waited for. Under the lock. */
static struct grid_lane *choose(struct grid_stage *s)
{
	for (;;) {
		struct grid_lane *best = NULL;
		bool room = false;

		for (unsigned i = 0; i < s->lanes; i++) {
			struct grid_lane *l = &s->lane[i];

			room |= l->n < l->cap;
			if (!l->busy && (!best || l->cap - l->n > best->cap - best->n))
				best = l;
		}
		if (best && (!room || best->n < best->cap))
			return best;
		s->guard.wait(s->guard.ctx);
	}
}

int grid_stage_share(struct grid_stage *s, const struct point *pts, size_t n, struct err *err)
{
	int rc = 0;

	lock(s);
	while (rc == 0 && n && !s->failed) {
		struct grid_lane *l = choose(s);
		size_t part = l->cap - l->n < n ? l->cap - l->n : n;

		struct point *to = s->pts + l->first + l->n;

		l->busy = true;
		l->n += part;
		look_huge(s, l);
		unlock(s);
		if (part)
			put(s, to, pts, part);
		else
			rc = spill_lane(s, l, err);
		lock(s);
		l->busy = false;
		l->n = part ? l->n : 0;
		s->guard.wake(s->guard.ctx);
		pts += part;
		n -= part;
	}
	/* The first failure is everybody's: of several only one may be told, whoever it is. */
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
	s->litter = true;
	log_err(LOG_LEVEL_DEBUG, "a sorted run stays behind", &err);
}

/* Runs that are not needed any more. Whether they go matters to the disk's space only, not to the result:
 * what stays is tried again in the end. */
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
	free(s->dead);
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
	grid_left_name(s->stem, name);
	/* First what names the runs. */
	if (s->left && io_remove(s->dirfd, name, &err))
		log_err(LOG_LEVEL_DEBUG, "the state of a stage stays behind", &err);
	grid_stage_drop_runs(s, s->nruns);
	for (uint32_t i = 0; s->litter && i < s->next_run; i++)
		grid_stage_remove_run(s, i);
	return grid_stage_release(s);
}
