/*
 * Pairs of triangles of two meshes of any size.
 *
 * A grid over the first mesh; each triangle goes into each cell that it meets, through one external sort. Then the triangles of a
 * cell, of both meshes, are joined in memory (volume_leaf.c). A cell with more than fit there, since the points are denser in it,
 * goes into a file and is divided by a grid of its own, and so on. Where that does not help, as around a vertex of a hundred
 * thousand triangles, which are in many cells of any grid, parts of the one side are joined with parts of the other.
 *
 * Cells come in the order of a Z curve, so that neighbours in the plane are near each other in time, for images.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "morton.h"
#include "outfile.h"
#include "sort.h"
#include "volume_priv.h"

struct volume_join_sizes volume_join_sizes = {2048, VOLUME_LEAF, 5, 8u << 20, 64};

enum { WORDS = 6, PART = 1024 };

/* The triangles of a side that wait: in memory, or in a file if they are more. */
struct heap {
	struct volume_triangle *t;
	size_t n;
	uint64_t spilled;
	struct outfile *file;
};

struct volume_join {
	const struct outfile *beside;
	struct volume_call call;
	int (*interrupted)(void *ctx);
	void *ctx;
	struct volume_leaf *leaf;
	/* of a level */
	unsigned depth;
	struct volume_rect rect;
	struct volume_grid grid;
	int64_t box[4];
	struct sort *sort;
	struct heap heap[2];
	/* of the running addition */
	struct err *err;
	const struct volume_triangle *t;
	unsigned side;
	uint64_t added;
	void (*progress)(void *ctx, double share); /* NULL: none */
};

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory for pairs of triangles");
}

/* ---- heaps ---- */

static int heap_add(struct volume_join *j, struct heap *h, const struct volume_triangle *t, struct err *err)
{
	size_t room = volume_join_sizes.leaf < VOLUME_LEAF ? volume_join_sizes.leaf : VOLUME_LEAF;

	if (!h->t && !(h->t = malloc(room * sizeof(*h->t))))
		return no_memory(err);
	if (h->n == room) {
		if (!h->file && outfile_spool(j->beside, &h->file, err))
			return -(int)err->code;
		if (outfile_write(h->file, h->t, h->n * sizeof(*h->t), err))
			return -(int)err->code;
		h->spilled += h->n;
		h->n = 0;
	}
	h->t[h->n++] = *t;
	return 0;
}

static uint64_t heap_size(const struct heap *h)
{
	return h->spilled + h->n;
}

static void heap_clear(struct heap *h)
{
	h->file = outfile_free(h->file);
	h->spilled = 0;
	h->n = 0;
}

/* Up to n of them, from number `at` on. */
static int heap_read(struct heap *h, uint64_t at, struct volume_triangle *to, size_t n, size_t *ret, struct err *err)
{
	uint64_t size = heap_size(h);

	*ret = size - at < n ? (size_t)(size - at) : n;
	for (size_t i = 0; i < *ret;) {
		size_t part = *ret - i;
		uint64_t from = at + i;

		if (from >= h->spilled) {
			memcpy(to + i, h->t + (from - h->spilled), part * sizeof(*to));
			return 0;
		}
		part = h->spilled - from < part ? (size_t)(h->spilled - from) : part;
		if (outfile_read(h->file, from * sizeof(*to), to + i, part * sizeof(*to), err))
			return -(int)err->code;
		i += part;
	}
	return 0;
}

/* ---- cells ---- */

static int add_cells(void *ctx, uint32_t y, uint32_t x1, uint32_t x2)
{
	struct volume_join *j = ctx;
	uint64_t record[WORDS] = {0};
	int r = 0;

	memcpy(record + 1, j->t, sizeof(*j->t));
	for (uint32_t x = x1; x <= x2 && !r; x++) {
		record[0] = morton_code(x, y) << 1 | j->side;
		r = sort_add(j->sort, record, j->err);
		j->added++;
	}
	return r;
}

static int count_cells(void *ctx, uint32_t y, uint32_t x1, uint32_t x2)
{
	*(uint64_t *)ctx += x2 - x1 + 1;
	return 0;
}

static int level_init(struct volume_join *j, double triangles, struct err *err)
{
	int r;

	j->grid = volume_grid_of(j->box, triangles / volume_join_sizes.cell);
	r = sort_new(WORDS, 1, j->depth ? volume_join_sizes.sort / 4 : volume_join_sizes.sort, j->beside, &j->sort, err);
	if (!r)
		sort_interrupt(j->sort, j->interrupted, j->ctx);
	return r;
}

static void level_done(struct volume_join *j)
{
	sort_free(j->sort);
	for (int i = 0; i < 2; i++) {
		heap_clear(&j->heap[i]);
		free(j->heap[i].t);
	}
}

int volume_join_add(struct volume_join *j, unsigned side, const struct volume_triangle *t, struct err *err)
{
	for (int k = 0; k < 2; k++) /* beside all of the first mesh there is nothing to meet */
		if ((t->at[0][k] < j->box[k] && t->at[1][k] < j->box[k] && t->at[2][k] < j->box[k]) ||
		    (t->at[0][k] > j->box[2 + k] && t->at[1][k] > j->box[2 + k] && t->at[2][k] > j->box[2 + k]))
			return 0;
	j->t = t;
	j->side = side;
	j->err = err;
	return volume_cells(&j->grid, t, add_cells, j);
}

static int run(struct volume_join *j, struct err *err);

/* ---- one cell ---- */

static bool given_up(const struct volume_join *j)
{
	return j->interrupted && j->interrupted(j->ctx);
}

/* Parts of the one with parts of the other. */
static int by_parts(struct volume_join *j, const struct volume_rect *rect, struct err *err)
{
	size_t room = volume_join_sizes.leaf < VOLUME_LEAF ? volume_join_sizes.leaf : VOLUME_LEAF, n[2];
	struct volume_triangle *part[2] = {malloc(room * sizeof(**part)), malloc(room * sizeof(**part))};
	uint64_t na = heap_size(&j->heap[0]), nb = heap_size(&j->heap[1]);
	int r = part[0] && part[1] ? 0 : no_memory(err);

	for (uint64_t a = 0; a < na && !r; a += n[0]) {
		r = heap_read(&j->heap[0], a, part[0], room, &n[0], err);
		for (uint64_t b = 0; b < nb && !r; b += n[1]) {
			r = heap_read(&j->heap[1], b, part[1], room, &n[1], err);
			if (!r)
				r = volume_leaf_join(j->leaf, part[0], n[0], part[1], n[1], rect, &j->call, err);
			if (!r && given_up(j))
				r = err_set(err, ERR_CANCELLED, "interrupted");
		}
	}
	free(part[0]);
	free(part[1]);
	return r;
}

/* Slivers are in many cells of any grid: more of them would not help. */
static int helps(struct volume_join *j, const struct volume_grid *g, bool *ret, struct err *err)
{
	uint64_t cells = 0, most = 3 * (heap_size(&j->heap[0]) + heap_size(&j->heap[1]));
	struct volume_triangle *part = malloc(PART * sizeof(*part));
	size_t n;
	int r = part ? 0 : no_memory(err);

	for (unsigned s = 0; s < 2; s++)
		for (uint64_t i = 0; i < heap_size(&j->heap[s]) && !r; i += n) {
			r = heap_read(&j->heap[s], i, part, PART, &n, err);
			for (size_t k = 0; k < n && !r; k++)
				volume_cells(g, &part[k], count_cells, &cells);
		}
	free(part);
	*ret = cells <= most;
	return r;
}

static int divide(struct volume_join *j, const struct volume_rect *rect, uint32_t x, uint32_t y, struct err *err)
{
	struct volume_join lower = {.beside = j->beside,
				    .call = j->call,
				    .interrupted = j->interrupted,
				    .ctx = j->ctx,
				    .leaf = j->leaf,
				    .depth = j->depth + 1,
				    .rect = *rect};
	const int64_t low[2] = {j->grid.x + (int64_t)x * j->grid.w, j->grid.y + (int64_t)y * j->grid.h};
	const int64_t high[2] = {low[0] + j->grid.w - 1, low[1] + j->grid.h - 1}, end[2] = {rect->x2 - 1, rect->y2 - 1};
	struct volume_triangle *part;
	bool good;
	size_t n;
	int r;

	for (int k = 0; k < 2; k++) {
		lower.box[k] = low[k];
		lower.box[2 + k] = high[k] < end[k] ? high[k] : end[k]; /* cells at the end of a grid are smaller */
	}
	r = level_init(&lower, (double)(heap_size(&j->heap[0]) + heap_size(&j->heap[1])), err);
	if (!r)
		r = helps(j, &lower.grid, &good, err);
	if (!r && !good) {
		level_done(&lower);
		return by_parts(j, rect, err);
	}
	part = malloc(PART * sizeof(*part));
	if (!r && !part)
		r = no_memory(err);
	for (unsigned s = 0; s < 2; s++)
		for (uint64_t i = 0; i < heap_size(&j->heap[s]) && !r; i += n) {
			r = heap_read(&j->heap[s], i, part, PART, &n, err);
			for (size_t k = 0; k < n && !r; k++) {
				lower.t = &part[k];
				lower.side = s;
				lower.err = err;
				r = volume_cells(&lower.grid, &part[k], add_cells, &lower);
			}
		}
	free(part);
	heap_clear(&j->heap[0]);
	heap_clear(&j->heap[1]);
	if (!r)
		r = run(&lower, err);
	level_done(&lower);
	return r;
}

static int join_cell(struct volume_join *j, uint64_t key, struct err *err)
{
	uint32_t x = morton_gather(key), y = morton_gather(key >> 1);
	struct volume_rect rect = volume_grid_cell(&j->grid, &j->rect, x, y);
	struct heap *h = j->heap;
	bool large = h[0].spilled || h[1].spilled;
	int r = 0;

	if (given_up(j))
		return err_set(err, ERR_CANCELLED, "interrupted");
	if (!heap_size(&h[0]) || !heap_size(&h[1]))
		r = 0;
	else if (!large)
		r = volume_leaf_join(j->leaf, h[0].t, h[0].n, h[1].t, h[1].n, &rect, &j->call, err);
	else if (j->depth + 1 < volume_join_sizes.depth && (j->grid.w > 4 || j->grid.h > 4))
		r = divide(j, &rect, x, y, err);
	else
		r = by_parts(j, &rect, err);
	heap_clear(&h[0]);
	heap_clear(&h[1]);
	return r;
}

static int run(struct volume_join *j, struct err *err)
{
	const uint64_t *record = NULL;
	uint64_t cell = UINT64_MAX, seen = 0;
	int r = sort_start(j->sort, err);

	while (!r && !(r = sort_next(j->sort, &record, err)) && record) {
		struct volume_triangle t;
		unsigned side = record[0] & 1;

		memcpy(&t, record + 1, sizeof(t));
		if (record[0] >> 1 != cell && cell != UINT64_MAX) {
			uint64_t last = cell;

			r = join_cell(j, last, err);
		}
		cell = record[0] >> 1;
		if (!(seen++ & 0x3fff) && j->progress)
			j->progress(j->ctx, (double)seen / (double)j->added);
		if (!r)
			r = heap_add(j, &j->heap[side], &t, err);
	}
	return !r && cell != UINT64_MAX ? join_cell(j, cell, err) : r;
}

int volume_join_new(const int64_t box[4], double triangles, const struct outfile *beside, const struct volume_call *call,
		    int (*interrupted)(void *ctx), void *ctx, struct volume_join **ret, struct err *err)
{
	struct volume_join *j = calloc(1, sizeof(*j));
	int r;

	if (!j || !(j->leaf = volume_leaf_new(interrupted, ctx))) {
		free(j);
		return no_memory(err);
	}
	j->beside = beside;
	j->call = *call;
	j->interrupted = interrupted;
	j->ctx = ctx;
	j->rect = (struct volume_rect){INT64_MIN, INT64_MIN, INT64_MAX, INT64_MAX};
	memcpy(j->box, box, sizeof(j->box));
	r = level_init(j, triangles, err);
	if (r)
		volume_join_free(j);
	else
		*ret = j;
	return r;
}

int volume_join_run(struct volume_join *j, void (*progress)(void *ctx, double share), struct err *err)
{
	j->progress = progress;
	return run(j, err);
}

struct volume_join *volume_join_free(struct volume_join *j)
{
	if (j) {
		level_done(j);
		volume_leaf_free(j->leaf);
	}
	free(j);
	return NULL;
}
