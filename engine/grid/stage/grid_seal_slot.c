/*
 * The slots of a seal: memory of one worker, in which it merges the records of a slice and makes cells of them.
 */
#include <string.h>

#include "align.h"
#include "err.h"
#include "grid_seal_priv.h"

enum {
	WINDOW_MIN = 4096,
	WINDOW_MAX = 16384,
	READ_BLOCKS = 16, /* of a run, at a time, if there is memory */
};

static size_t window_bytes(size_t records)
{
	return align_line(records * (sizeof(struct point) + sizeof(uint32_t)));
}

static size_t fixed_bytes(size_t n, unsigned pieces)
{
	return align_line(grid_merge_bytes((unsigned)n + pieces)) + align_line(3 * n * sizeof(uint64_t));
}

size_t grid_slot_min_bytes(size_t n, unsigned pieces)
{
	return fixed_bytes(n, pieces) + window_bytes(WINDOW_MIN) + n * DISK_RUN_BLOCK + align_line(grid_cells_min_bytes());
}

/* Spare memory beyond the minimum goes to larger windows and read-ahead, and to cells. */
void grid_slot_init(struct grid_slot *s, uint8_t *memory, size_t bytes, size_t n, unsigned pieces)
{
	uint8_t *end = memory + bytes;
	size_t spare = bytes - grid_slot_min_bytes(n, pieces), more = window_bytes(WINDOW_MAX) - window_bytes(WINDOW_MIN),
	       ahead = 0;

	*s = (struct grid_slot){.cap = spare / 4 >= more ? WINDOW_MAX : WINDOW_MIN};
	if (n)
		ahead = spare / 4 / (n * DISK_RUN_BLOCK);
	s->ahead = ahead + 1 > READ_BLOCKS ? READ_BLOCKS : (unsigned)ahead + 1;
	s->merging = memory;
	memory += align_line(grid_merge_bytes((unsigned)n + pieces));
	s->seen = (uint64_t *)memory;
	s->slice.first = s->seen + n;
	s->slice.end = s->slice.first + n;
	memory += align_line(3 * n * sizeof(uint64_t));
	s->window = (struct point *)memory;
	s->ids = (uint32_t *)(s->window + s->cap);
	memory += window_bytes(s->cap);
	s->blocks = memory;
	memory += n * s->ahead * DISK_RUN_BLOCK;
	s->memory = memory;
	s->size = (size_t)(end - memory);
}

/* Opens the slice's part of the sorted memory and of the runs. */
static int open_slice(struct grid_seal *z, struct grid_slot *s, struct err *err)
{
	const struct grid_slices *all = &z->slices;
	const struct grid_slice *slice = &s->slice;
	int rc = 0;

	grid_cells_begin(&s->cells, s->memory, s->size, slice->lo, slice->hi);
	grid_merge_init(&s->merge, (unsigned)all->nruns + all->npieces, s->merging);
	memset(s->seen, 0, all->nruns * sizeof *s->seen);
	for (unsigned i = 0; i < all->npieces; i++)
		grid_merge_memory(&s->merge, all->piece[i].pts, all->piece[i].n, z->stage->table, slice->lo, slice->hi);
	for (size_t i = 0; rc == 0 && i < all->nruns; i++) {
		struct grid_run_reader r;

		if (slice->first[i] >= slice->end[i])
			continue;
		grid_run_read(&r, &all->run[i], slice->first[i], slice->end[i], s->blocks + i * s->ahead * DISK_RUN_BLOCK,
			      s->ahead);
		rc = grid_merge_run(&s->merge, &r, slice->lo, slice->hi, &s->seen[i], err);
	}
	grid_merge_start(&s->merge);
	return rc;
}

/* Called when the slot is full in the middle of a slice: waits until the slice is next, and puts its cells so far. */
static int put_partial(struct grid_seal *z, struct grid_slot *s, struct err *err)
{
	int rc = 0;

	grid_seal_lock(z);
	while (z->placed < s->slice.number && !z->failed)
		grid_seal_wait(z);
	if (z->failed)
		rc = -(int)(*err = z->err).code;
	else
		rc = grid_segment_writer_put(&z->seg, &s->cells, err);
	grid_seal_unlock(z);
	return rc ? rc : grid_cells_write(&s->cells, z->seg.file.fd, z->seg.file.temp, err);
}

/* Makes cells of pts: of all of them at the end, else only complete cells. */
static int add_records(struct grid_seal *z, struct grid_slot *s, const struct point *pts, const uint32_t *ids,
		       const uint32_t *table, size_t n, bool end, size_t *ret_taken, struct err *err)
{
	size_t at = 0, taken;

	for (;;) {
		bool all = grid_cells_add(&s->cells, pts + at, ids ? ids + at : NULL, table, n - at, end, &taken);
		int rc;

		at += taken;
		*ret_taken = at;
		if (all)
			return 0;
		rc = put_partial(z, s, err);
		if (rc)
			return rc;
	}
}

/* Merges the inputs through the window. */
static int merge_slice(struct grid_seal *z, struct grid_slot *s, uint64_t *ret_omitted, struct err *err)
{
	const struct grid_stage *stage = z->stage;
	/* A run that has another source than it should is found by the number of that. */
	uint32_t *ids = stage->nall > 1 || z->slices.nruns ? s->ids : NULL;
	size_t held = 0, got, taken;
	bool end = false;
	int rc = 0;

	while (rc == 0 && !end) {
		size_t want = s->cap - held;

		rc = grid_merge_take(&s->merge, s->window + held, ids ? ids + held : NULL, want, &got, err);
		if (rc)
			break;
		end = got < want;
		*ret_omitted += got;
		got = grid_stage_filter_dropped(stage, s->window + held, ids ? ids + held : NULL, got);
		*ret_omitted -= got;
		held += got;
		if (!ids)
			for (size_t i = held - got; i < held; i++)
				s->window[i].tag &= POINT_FLAGS; /* index 0 of `all` */
		rc = add_records(z, s, s->window, ids, stage->all, held, end, &taken, err);
		if (rc)
			break;
		held -= taken;
		memmove(s->window, s->window + taken, held * sizeof *s->window);
		if (ids)
			memmove(ids, ids + taken, held * sizeof *ids);
	}
	return rc;
}

int grid_slot_fill(struct grid_seal *z, struct grid_slot *s, uint64_t *ret_omitted, struct err *err)
{
	int rc = open_slice(z, s, err);
	size_t taken;

	if (rc || !s->merge.n)
		return rc;
	const struct grid_merge_input *in = &s->merge.input[0];

	/* A single sorted array needs no merge. */
	if (s->merge.n == 1 && !in->run.run && !z->stage->ndropped)
		return add_records(z, s, in->at, NULL, in->table, (size_t)(in->end - in->at), true, &taken, err);
	return merge_slice(z, s, ret_omitted, err);
}
