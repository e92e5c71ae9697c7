/*
 * Rewriting (grid_rewrite.h): the records of several segments, without those of some sources, become one segment.
 *
 * A pass over each segment (grid_pass.c) feeds a loser tree. The merged stream is made into cells as in a seal, so the
 * file is the same that a seal of these records writes. There is one thread, and a step handles one window of records.
 * Spare memory enlarges the windows through which the segments are read, so the disk reads longer stretches.
 */
#include "grid_rewrite.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "align.h"
#include "err.h"
#include "grid_merge.h"
#include "grid_pass.h"
#include "grid_segment_writer.h"
#include "io.h"
#include "order.h"

enum {
	WINDOW = 4096,        /* records that are merged at a time */
	MAX_WINDOW = 1 << 20, /* bytes that are read at a time */
};

_Static_assert((int)GRID_REWRITE_MOST == (int)GRID_MERGE_INPUTS, "all segments are merged at once");

struct grid_rewrite {
	struct grid_pass *pass;
	struct grid_segment_info *info; /* of each segment, copied */
	size_t npass;
	struct grid_dropped dropped;
	struct grid_range range;
	bool part;
	uint32_t *sources; /* of the new segment, ascending */
	size_t nsources;
	struct grid_merge merge;
	struct grid_cells cells;
	struct grid_segment_writer seg;
	struct point *window;
	uint32_t *ids;
	size_t held;  /* records in the window */
	uint64_t all; /* records of the segments */
	uint8_t *memory;
	bool temporary, done, failed;
};

/* ---- memory ---- */

static size_t cells_bytes(void)
{
	return align_line(2 * grid_cells_min_bytes());
}

static size_t fixed_bytes(size_t n)
{
	return align_line(n * sizeof(struct grid_pass)) + align_line(n * sizeof(struct grid_segment_info)) +
	       align_line(grid_merge_bytes((unsigned)n)) + align_line(grid_segment_writer_bytes()) +
	       align_line(WINDOW * (sizeof(struct point) + sizeof(uint32_t)));
}

/* Tables of sources: of one segment, of all segments with repeats, and of the new segment. */
static size_t sources_bytes(const struct grid_segment_info *segments, size_t n, size_t nsources)
{
	size_t most = 0, each;

	for (size_t i = 0; i < n; i++) {
		each = segments[i].points < nsources ? (size_t)segments[i].points : nsources;
		most += each;
	}
	return most * (sizeof(uint32_t) + 2 * sizeof(struct disk_total));
}

static size_t segments_bytes(const struct grid_segment_info *segments, size_t n, size_t window)
{
	size_t bytes = fixed_bytes(n);

	for (size_t i = 0; i < n; i++)
		bytes += grid_pass_bytes(segments[i].cells, window);
	return bytes;
}

size_t grid_rewrite_min_bytes(const struct grid_segment_info *segments, size_t n, size_t nsources)
{
	return sizeof(struct grid_rewrite) + 64 + sources_bytes(segments, n, nsources) + cells_bytes() +
	       segments_bytes(segments, n, GRID_PASS_WINDOW);
}

/* ---- beginning ---- */

/* Adds the sources of a segment that are not dropped. */
static int add_sources(struct grid_rewrite *w, const struct disk_total *totals, uint32_t n, struct err *err)
{
	uint32_t *all = realloc(w->sources, (w->nsources + n + 1) * sizeof *all);

	if (!all)
		return err_set(err, ERR_NOMEM, "no memory for a table of %u sources", n);
	w->sources = all;
	for (uint32_t i = 0; i < n; i++)
		if (!grid_dropped_has(&w->dropped, totals[i].id))
			all[w->nsources++] = totals[i].id;
	return 0;
}

static void sort_sources(struct grid_rewrite *w)
{
	size_t n = 0;

	if (w->nsources)
		qsort(w->sources, w->nsources, sizeof *w->sources, order_u32);
	for (size_t i = 0; i < w->nsources; i++)
		if (!n || w->sources[n - 1] != w->sources[i])
			w->sources[n++] = w->sources[i];
	w->nsources = n;
}

static int open_all(struct grid_rewrite *w, const struct grid_rewrite_params *in, uint8_t **at, size_t window, struct err *err)
{
	for (size_t i = 0; i < in->nsegments; i++) {
		struct disk_total *totals = NULL;
		uint32_t n = 0;
		int rc;

		w->info[i] = in->segments[i];
		rc = grid_pass_open(&w->pass[i], in->dirfd, &w->info[i], &w->dropped, &w->range,
				    align_carve(at, grid_pass_bytes(w->info[i].cells, window)), window, &totals, &n, err);
		if (rc)
			return rc;
		w->npass++;
		w->all += w->info[i].points;
		rc = add_sources(w, totals, n, err);
		free(totals);
		if (rc)
			return rc;
	}
	sort_sources(w);
	return 0;
}

static int begin(struct grid_rewrite *w, const struct grid_rewrite_params *in, size_t window, struct err *err)
{
	size_t n = in->nsegments;
	uint8_t *at = w->memory, *pages;
	char name[GRID_NAME_MAX];
	void *merging;
	int rc;

	w->pass = align_carve(&at, n * sizeof *w->pass);
	w->info = align_carve(&at, n * sizeof *w->info);
	merging = align_carve(&at, grid_merge_bytes((unsigned)n));
	pages = align_carve(&at, grid_segment_writer_bytes());
	w->window = align_carve(&at, WINDOW * (sizeof *w->window + sizeof *w->ids));
	w->ids = (uint32_t *)(w->window + WINDOW);
	grid_cells_begin(&w->cells, align_carve(&at, cells_bytes()), cells_bytes(), 0, UINT64_MAX);
	rc = open_all(w, in, &at, window, err);
	if (rc)
		return rc;
	grid_merge_init(&w->merge, (unsigned)n, merging);
	for (size_t i = 0; rc == 0 && i < n; i++)
		rc = grid_merge_stream(&w->merge, grid_pass_next, &w->pass[i], err);
	if (rc)
		return rc;
	grid_merge_start(&w->merge);
	snprintf(name, sizeof name, "%s.seg", in->name);
	return grid_segment_writer_begin(&w->seg, in->dirfd, name, w->sources, (uint32_t)w->nsources, pages, err);
}

int grid_rewrite_new(const struct grid_rewrite_params *in, struct grid_rewrite **ret, struct err *err)
{
	size_t least = grid_rewrite_min_bytes(in->segments, in->nsegments, in->nsources), bytes, window = GRID_PASS_WINDOW;
	struct grid_rewrite *w;
	int rc;

	if (in->nsegments > GRID_MERGE_INPUTS || in->memory < least) {
		err_set(err, ERR_LIMIT, "rewriting %zu segments of %zu sources takes %zu bytes, not %zu", in->nsegments,
			in->nsources, least, in->memory);
		return -ERR_LIMIT;
	}
	if (in->nsegments)
		window += (in->memory - least) / in->nsegments & ~(size_t)63;
	window = window < MAX_WINDOW ? window : MAX_WINDOW;
	bytes = segments_bytes(in->segments, in->nsegments, window) + cells_bytes();
	w = calloc(1, sizeof *w);
	if (w) {
		w->memory = aligned_alloc(64, align_line(bytes));
		w->seg.file = GRID_FILE_INIT;
		w->dropped = (struct grid_dropped){in->drop, in->ndrop};
		w->temporary = in->temporary;
		w->part = in->part;
		w->range = in->part ? (struct grid_range){in->lo, in->hi} : (struct grid_range){0, UINT64_MAX};
	}
	if (!w || !w->memory) {
		grid_rewrite_free(w);
		return err_set(err, ERR_NOMEM, "no memory to rewrite segments");
	}
	rc = begin(w, in, window, err);
	if (rc) {
		grid_rewrite_free(w);
		return rc;
	}
	*ret = w;
	return 0;
}

/* ---- steps ---- */

static int write_cells(struct grid_rewrite *w, struct err *err)
{
	int rc = grid_segment_writer_put(&w->seg, &w->cells, err);

	return rc ? rc : grid_cells_write(&w->cells, w->seg.file.fd, w->seg.file.temp, err);
}

/* Makes cells of the records in the window. */
static int make_cells(struct grid_rewrite *w, bool end, struct err *err)
{
	size_t at = 0, taken;
	int rc = 0;

	for (;;) {
		bool whole = grid_cells_add(&w->cells, w->window + at, w->ids + at, NULL, w->held - at, end, &taken);

		at += taken;
		if (whole)
			break;
		rc = write_cells(w, err);
		if (rc)
			return rc;
	}
	w->held -= at;
	memmove(w->window, w->window + at, w->held * sizeof *w->window);
	memmove(w->ids, w->ids + at, w->held * sizeof *w->ids);
	return end ? write_cells(w, err) : 0;
}

int grid_rewrite_step(struct grid_rewrite *w, struct err *err)
{
	size_t want = WINDOW - w->held, got = 0;
	int rc;

	if (w->done)
		return GRID_REWRITE_DONE;
	if (w->failed)
		return err_set(err, ERR_INTERNAL, "rewriting has failed before");
	rc = grid_merge_take(&w->merge, w->window + w->held, w->ids + w->held, want, &got, err);
	if (rc == 0) {
		w->held += got;
		w->done = got < want;
		rc = make_cells(w, w->done, err);
	}
	w->failed = rc != 0;
	return rc ? rc : w->done ? GRID_REWRITE_DONE : 0;
}

/* Every record was either written or omitted on request. */
static int check_all(const struct grid_rewrite *w, struct err *err)
{
	uint64_t points = w->seg.head.points, read = 0;

	for (size_t i = 0; i < w->npass; i++) {
		points += w->pass[i].omitted;
		read += w->pass[i].points;
	}
	/* How many a range has is for the caller to sum up. */
	if (w->done && !w->failed && points == read && (w->part || read == w->all))
		return 0;
	return err_set(err, ERR_INTERNAL, "of %llu points %llu were rewritten", (unsigned long long)w->all,
		       (unsigned long long)points);
}

struct grid_rewrite *grid_rewrite_free(struct grid_rewrite *w)
{
	if (!w)
		return NULL;
	grid_segment_writer_abort(&w->seg);
	for (size_t i = 0; i < w->npass; i++)
		grid_pass_close(&w->pass[i]);
	free(w->sources);
	free(w->memory);
	free(w);
	return NULL;
}

int grid_rewrite_finish(struct grid_rewrite *w, struct grid_segment_info *ret, struct err *err)
{
	int rc = check_all(w, err);

	if (rc == 0)
		rc = grid_segment_writer_finish(&w->seg, w->temporary ? GRID_TEMPORARY : GRID_DURABLE, ret, err);
	grid_rewrite_free(w);
	return rc;
}

/* ---- dividing and counting ---- */

int grid_segment_divide(int dirfd, const struct grid_segment_info *info, unsigned n, uint64_t *ret, struct err *err)
{
	const struct grid_dropped none = {NULL, 0};
	void *memory = aligned_alloc(64, align_line(grid_pass_bytes(info->cells, GRID_PASS_WINDOW)));
	struct disk_total *totals = NULL;
	struct grid_pass pass;
	uint64_t points = 0;
	unsigned part = 1;
	uint32_t sources;
	bool end = false;
	int rc = 0;

	if (!memory)
		return err_set(err, ERR_NOMEM, "no memory to divide a segment");
	rc = grid_pass_open(&pass, dirfd, info, &none, NULL, memory, GRID_PASS_WINDOW, &totals, &sources, err);
	for (uint64_t after = 0; rc == 0 && part < n; points = after) {
		rc = grid_pass_cell(&pass, &end, err);
		if (rc || end)
			break;
		after = points + pass.leaf.count;
		for (; part < n && (unsigned __int128)points * n >= (unsigned __int128)part * info->points; part++)
			ret[part - 1] = pass.leaf.lo;
	}
	for (; rc == 0 && part < n; part++)
		ret[part - 1] = UINT64_MAX;
	if (rc == 0)
		grid_pass_close(&pass);
	free(totals);
	free(memory);
	return rc;
}

int grid_segment_count_sources(int dirfd, const struct grid_segment_info *info, const uint32_t *ids, size_t n,
			       uint64_t *ret_points, struct err *err)
{
	const struct grid_dropped wanted = {ids, n};
	struct grid_segment p = {.fd = -1};
	struct disk_total *totals = NULL;
	struct disk_segment h;
	uint64_t points = 0;
	int rc = grid_segment_open(&p, dirfd, info, &h, err);

	if (rc == 0)
		rc = grid_segment_sources(&p, &h, &totals, err);
	for (uint32_t i = 0; rc == 0 && i < h.sources; i++)
		if (grid_dropped_has(&wanted, totals[i].id))
			points += totals[i].points;
	free(totals);
	io_close(p.fd);
	if (rc == 0)
		*ret_points = points;
	return rc;
}
