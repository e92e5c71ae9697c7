/*
 * Scans: the live records of a Morton range over all segments in point order (grid.h). The cells of a segment are
 * fetched in batches, each by a new descent, so a scan holds no pages. If only one segment has cells in the range, its
 * blocks go to the sink as they were read. Otherwise blocks are copied to one buffer for each segment and merged; more
 * than two segments are merged with a heap.
 */
#include <string.h>

#include "err.h"
#include "grid_priv.h"

struct scan {
	struct grid_reader *r;
	uint64_t lo, hi;
	grid_points_fn sink;
	void *ctx;
	size_t npiece; /* records in r->piece */
	size_t nheap;
};

/* ---- cells of a segment in order ---- */

/* Fetches the next cells that meet [c->from, hi]. */
static int next_batch(struct grid_reader *r, struct grid_cursor *c, uint64_t hi, struct err *err)
{
	const struct grid_segment *p = &r->grid->segments[c->segment];
	uint64_t place = p->root, check = p->root_check;
	unsigned n;

	c->nbatch = c->at = 0;
	for (unsigned level = p->height; level-- > 0;) {
		int rc = grid_page_read(r, c->segment, level, place, check, err);

		if (rc)
			return rc;
		if (!level)
			break;
		const uint8_t *inner = grid_reader_page(r, level);
		unsigned i = grid_page_find(inner, true, c->from);
		const struct disk_inner *e = grid_page_inner(inner, i);

		if (i == grid_page_entries(inner) || e->lo > hi) {
			c->done = true;
			return 0;
		}
		place = e->place;
		check = e->check;
	}
	const uint8_t *page = grid_reader_page(r, 0);

	n = grid_page_entries(page);
	for (unsigned i = grid_page_find(page, false, c->from); i < n && c->nbatch < GRID_BATCH; i++) {
		const struct disk_leaf *leaf = grid_page_leaf(page, i);

		if (leaf->lo > hi)
			break;
		c->batch[c->nbatch++] = *leaf;
	}
	if (!c->nbatch) {
		c->done = true;
		return 0;
	}
	const struct disk_leaf *last = &c->batch[c->nbatch - 1];
	uint64_t end = disk_range_end(last->lo, last->bits);

	c->done = end >= hi;
	c->from = c->done ? end : end + 1;
	return 0;
}

/* Reads the next block of the segment in the range; *ret_n = 0 at the end. *ret_pts points into the block buffer. */
static int next_block(struct scan *s, struct grid_cursor *c, struct point **ret_pts, size_t *ret_n, struct err *err)
{
	const struct grid *g = s->r->grid;
	int rc = 0;

	*ret_n = 0;
	while (rc == 0 && !*ret_n) {
		if (c->block < c->cell.blocks) {
			rc = grid_cursor_block(s->r, c, ret_pts, ret_n, err);
			if (rc == 0 && (c->cell.lo < s->lo || c->cell.hi > s->hi))
				grid_trim(ret_pts, ret_n, s->lo, s->hi);
			if (rc == 0)
				rc = grid_mark(s->r, c->cell.box, *ret_pts, *ret_n, err);
		} else if (c->at < c->nbatch) {
			struct grid_cell cell;

			rc = grid_cell_of(&g->segments[c->segment], c->segment, &c->batch[c->at++], &cell, err);
			if (rc == 0 && !grid_cell_dead(g, &cell))
				grid_cursor_cell(c, &cell);
		} else if (!c->done) {
			rc = next_batch(s->r, c, s->hi, err);
		} else {
			break;
		}
	}
	return rc;
}

/* ---- one segment ---- */

static int scan_one(struct scan *s, struct grid_cursor *c, struct err *err)
{
	struct point *pts;
	size_t n;

	for (;;) {
		int rc = next_block(s, c, &pts, &n, err);

		if (rc || !n)
			return rc;
		rc = s->sink(s->ctx, pts, n, err);
		if (rc)
			return rc;
	}
}

/* ---- several ---- */

static int load(struct scan *s, struct grid_cursor *c, struct err *err)
{
	struct point *pts;
	int rc = next_block(s, c, &pts, &c->n, err);

	if (rc || !c->n)
		return rc;
	memcpy(c->pts, pts, c->n * sizeof *pts);
	c->pos = 0;
	c->key = point_morton(c->pts->x, c->pts->y);
	return 0;
}

static bool before(const struct grid_cursor *a, const struct grid_cursor *b)
{
	if (a->key != b->key)
		return a->key < b->key;
	return point_compare(&a->pts[a->pos], &b->pts[b->pos]) < 0;
}

static void sift(struct scan *s, size_t i)
{
	struct grid_cursor **heap = s->r->heap, *c = heap[i];

	for (size_t k; (k = 2 * i + 1) < s->nheap; i = k) {
		if (k + 1 < s->nheap && before(heap[k + 1], heap[k]))
			k++;
		if (!before(heap[k], c))
			break;
		heap[i] = heap[k];
	}
	heap[i] = c;
}

static int flush(struct scan *s, struct err *err)
{
	size_t n = s->npiece;

	s->npiece = 0;
	return n ? s->sink(s->ctx, s->r->piece, n, err) : 0;
}

/* Copies records of the heap's first cursor to the piece while they come before those of all others. */
static int take_first(struct scan *s, struct err *err)
{
	struct grid_cursor **heap = s->r->heap, *c = heap[0], *next = s->nheap > 1 ? heap[1] : NULL;

	if (s->nheap > 2 && before(heap[2], heap[1]))
		next = heap[2];
	do {
		if (s->npiece == GRID_CELL_RECORDS) {
			int rc = flush(s, err);

			if (rc)
				return rc;
		}
		s->r->piece[s->npiece++] = c->pts[c->pos++];
		if (c->pos == c->n)
			return load(s, c, err);
		c->key = point_morton(c->pts[c->pos].x, c->pts[c->pos].y);
	} while (!next || !before(next, c));
	return 0;
}

static int scan_many(struct scan *s, struct err *err)
{
	struct grid_cursor **heap = s->r->heap;

	for (size_t i = s->nheap / 2; i-- > 0;)
		sift(s, i);
	while (s->nheap) {
		int rc = take_first(s, err);

		if (rc)
			return rc;
		if (!heap[0]->n)
			heap[0] = heap[--s->nheap];
		sift(s, 0);
	}
	return flush(s, err);
}

/* Point order without computing the keys: the coordinate that differs in a higher bit decides; x if it is the same
 * bit. */
static inline bool point_before(const struct point *a, const struct point *b)
{
	uint32_t dx = (uint32_t)a->x ^ (uint32_t)b->x, dy = (uint32_t)a->y ^ (uint32_t)b->y;

	bool by_y = (dx < dy) & (dx < (dx ^ dy));

	if (__builtin_expect(!(dx | dy), 0))
		return point_compare(a, b) < 0;
	/* Without a branch: in mixed input it would be mispredicted half of the time. */
	return (by_y & (a->y < b->y)) | (!by_y & (a->x < b->x));
}

/* Passes the rest of c's block straight to the sink. */
static int pass_block(struct scan *s, struct grid_cursor *c, struct err *err)
{
	int rc = flush(s, err);

	if (rc == 0)
		rc = s->sink(s->ctx, c->pts + c->pos, c->n - c->pos, err);
	c->pos = c->n;
	return rc;
}

/* Merges two blocks into the piece, until a block or the piece ends. */
static void merge_blocks(struct scan *s, struct grid_cursor *a, struct grid_cursor *b)
{
	const struct point *p = a->pts + a->pos, *p_end = a->pts + a->n, *q = b->pts + b->pos, *q_end = b->pts + b->n;
	struct point *out = s->r->piece + s->npiece, *end = s->r->piece + GRID_CELL_RECORDS;

	while (p < p_end && q < q_end && out < end) {
		bool second = point_before(q, p);

		*out++ = *(const struct point *)((uintptr_t)p ^ (((uintptr_t)p ^ (uintptr_t)q) & -(uintptr_t)second));
		q += second;
		p += !second;
	}
	a->pos = (size_t)(p - a->pts);
	b->pos = (size_t)(q - b->pts);
	s->npiece = (size_t)(out - s->r->piece);
}

/* The usual case of several segments: the old data, and the last push. */
static int scan_two(struct scan *s, struct err *err)
{
	struct grid_cursor *a = s->r->heap[0], *b = s->r->heap[1];
	int rc = 0;

	while (rc == 0 && a->n && b->n) {
		if (point_before(&a->pts[a->n - 1], &b->pts[b->pos]))
			rc = pass_block(s, a, err);
		else if (point_before(&b->pts[b->n - 1], &a->pts[a->pos]))
			rc = pass_block(s, b, err);
		else
			merge_blocks(s, a, b);
		if (rc == 0 && s->npiece == GRID_CELL_RECORDS)
			rc = flush(s, err);
		if (rc == 0 && a->pos == a->n)
			rc = load(s, a, err);
		if (rc == 0 && b->pos == b->n)
			rc = load(s, b, err);
	}
	if (a->n == 0)
		a = b;
	if (rc == 0)
		rc = pass_block(s, a, err);
	return rc ? rc : scan_one(s, a, err);
}

/* Puts the segments with cells in the range on the heap and reads their first batch. */
static int open_cursors(struct scan *s, struct err *err)
{
	const struct grid *g = s->r->grid;
	uint32_t used = 0;

	for (uint32_t i = 0; i < g->manifest->nsegments; i++) {
		struct grid_cursor *c = &s->r->cursors[used];
		struct point *buffer = c->pts;

		if (!grid_segment_meets(g, i, s->lo, s->hi))
			continue;
		*c = (struct grid_cursor){.segment = i, .from = s->lo, .pts = buffer};
		int rc = next_batch(s->r, c, s->hi, err);

		if (rc)
			return rc;
		if (c->nbatch) {
			s->r->heap[s->nheap++] = c;
			used++;
		}
	}
	return 0;
}

int grid_scan(struct grid_reader *r, uint64_t lo, uint64_t hi, grid_points_fn sink, void *ctx, struct err *err)
{
	struct scan s = {.r = r, .lo = lo, .hi = hi, .sink = sink, .ctx = ctx};
	size_t kept = 0;
	int rc;

	if (r->walking)
		return err_set(err, ERR_INTERNAL, "a reader was used for a scan inside a walk or scan");
	if (lo > hi)
		return 0;
	r->walking = true;
	rc = open_cursors(&s, err);
	if (rc == 0 && s.nheap == 1) {
		rc = scan_one(&s, r->heap[0], err);
	} else if (rc == 0 && s.nheap > 1) {
		for (size_t i = 0; rc == 0 && i < s.nheap; i++) {
			rc = load(&s, r->heap[i], err);
			if (r->heap[i]->n)
				r->heap[kept++] = r->heap[i];
		}
		s.nheap = kept;
		if (rc == 0)
			rc = s.nheap == 2 ? scan_two(&s, err) : scan_many(&s, err);
	}
	r->walking = false;
	return rc;
}
