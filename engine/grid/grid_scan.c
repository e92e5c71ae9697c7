/*
 * Scans: the live records of a Morton range over all segments in point order (grid.h). The cells of a segment are
 * fetched in batches, each by a new descent, so a scan holds no pages. If only one segment has cells in the range, its
 * blocks go to the sink as they were read. Otherwise blocks are copied to one buffer for each segment and merged.
 *
 * More than two segments are merged with a heap. A segment comes onto it when the merge is at the key where the segment begins,
 * and leaves it when its records are merged, so there are never more of them than meet at one key (grid_order.depth).
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
	/* The next segment: whether there is one, its place in the order, and the first key that it may have in the range. */
	bool more;
	uint32_t next;
	uint64_t begins;
};

/* ---- cells of a segment in order ---- */

/* Fetches the next cells that meet [c->from, hi]. */
static int next_batch(struct grid_reader *r, struct grid_cursor *c, uint64_t hi, struct err *err)
{
	const struct grid_segment *p = &r->grid->segments[c->segment];
	uint64_t place, check;
	unsigned n;
	int rc = grid_root_of(r->grid, c->segment, &place, &check, err);

	if (rc)
		return rc;
	c->nbatch = c->at = 0;
	for (unsigned level = p->height; level-- > 0;) {
		rc = grid_page_read(r, c->segment, level, place, check, err);

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
			c->again.block = c->block;
			c->again.place = c->place;
			c->again.check = c->check;
			rc = grid_cursor_block(s->r, c, ret_pts, ret_n, err);
			if (rc == 0 && (c->cell.lo < s->lo || c->cell.hi > s->hi))
				grid_trim(ret_pts, ret_n, s->lo, s->hi);
			*ret_pts += c->copied;
			*ret_n -= c->copied;
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

/* Fills the buffer of the cursor with its next records. n is 0 at the end. */
static int load(struct scan *s, struct grid_cursor *c, struct err *err)
{
	struct point *pts;
	int rc = next_block(s, c, &pts, &c->n, err);

	if (rc || !c->n)
		return rc;
	if (c->n > s->r->room) {
		c->n = s->r->room;
		c->copied += c->n;
		c->block = c->again.block;
		c->place = c->again.place;
		c->check = c->again.check;
	} else {
		c->copied = 0;
	}
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

/* Passes the rest of c's buffer straight to the sink. */
static int pass_block(struct scan *s, struct grid_cursor *c, struct err *err)
{
	int rc = flush(s, err);

	if (rc == 0)
		rc = s->sink(s->ctx, c->pts + c->pos, c->n - c->pos, err);
	c->pos = c->n;
	return rc;
}

/* Merges records of the heap's first cursor while they come before those of all others. */
static int take_first(struct scan *s, struct err *err)
{
	struct grid_cursor **heap = s->r->heap, *c = heap[0], *next = s->nheap > 1 ? heap[1] : NULL;
	const struct point *last = &c->pts[c->n - 1];
	uint64_t end = point_morton(last->x, last->y);

	if (s->nheap > 2 && before(heap[2], heap[1]))
		next = heap[2];
	/* The piece would be small otherwise, as would what is passed. */
	if (c->n - c->pos >= GRID_CELL_RECORDS / 16 && (!next || end < next->key) && (!s->more || end < s->begins)) {
		int rc = pass_block(s, c, err);

		return rc ? rc : load(s, c, err);
	}
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
	} while ((!next || !before(next, c)) && !(s->more && c->key >= s->begins));
	return 0;
}

/* Moves the last cursor of the heap to its place. */
static void rise(struct scan *s)
{
	struct grid_cursor **heap = s->r->heap, *c = heap[s->nheap - 1];
	size_t i = s->nheap - 1;

	for (; i && before(c, heap[(i - 1) / 2]); i = (i - 1) / 2)
		heap[i] = heap[(i - 1) / 2];
	heap[i] = c;
}

/* Goes to the next segment that meets the range. */
static void look_ahead(struct scan *s)
{
	const struct grid *g = s->r->grid;
	const struct grid_segment *p;

	s->next = grid_order_next(&g->order, s->next, s->lo);
	s->more = s->next < g->order.n;
	if (!s->more)
		return;
	p = &g->segments[g->order.segment[s->next]];
	s->more = p->lo <= s->hi;
	s->begins = p->lo > s->lo ? p->lo : s->lo;
}

/* Begins to read the next segment. Its cursor is in use if it has cells in the range. */
static int begin_next(struct scan *s, struct err *err)
{
	struct grid_cursor *c = s->r->heap[s->nheap];
	struct point *buffer = c->pts;
	int rc;

	*c = (struct grid_cursor){.segment = s->r->grid->order.segment[s->next], .from = s->lo, .pts = buffer};
	rc = next_batch(s->r, c, s->hi, err);
	if (rc)
		return rc;
	s->nheap += c->nbatch > 0;
	s->next++;
	look_ahead(s);
	return 0;
}

/* Reads the first records of the first `n` cursors, and puts those that have some onto the heap. */
static int load_first(struct scan *s, size_t n, struct err *err)
{
	struct grid_cursor **heap = s->r->heap;

	for (size_t i = 0; i < n; i++) {
		struct grid_cursor *c = heap[i];
		int rc = load(s, c, err);

		if (rc)
			return rc;
		if (!c->n)
			continue;
		heap[i] = heap[s->nheap];
		heap[s->nheap++] = c;
		rise(s);
	}
	return 0;
}

static int scan_many(struct scan *s, struct err *err)
{
	struct grid_cursor **heap = s->r->heap;

	for (;;) {
		while (s->more && (!s->nheap || s->begins <= heap[0]->key)) {
			size_t n = s->nheap;
			int rc = begin_next(s, err);

			if (rc == 0 && s->nheap > n) {
				rc = load(s, heap[n], err);
				s->nheap -= !heap[n]->n;
			}
			if (rc)
				return rc;
			if (s->nheap > n)
				rise(s);
		}
		if (!s->nheap)
			return flush(s, err);

		struct grid_cursor *c = heap[0];
		int rc = take_first(s, err);

		if (rc)
			return rc;
		if (!c->n) {
			heap[0] = heap[--s->nheap];
			heap[s->nheap] = c;
		}
		if (s->nheap)
			sift(s, 0);
	}
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

int grid_scan(struct grid_reader *r, uint64_t lo, uint64_t hi, grid_points_fn sink, void *ctx, struct err *err)
{
	struct scan s = {.r = r, .lo = lo, .hi = hi, .sink = sink, .ctx = ctx};
	size_t n;
	int rc = 0;

	if (r->walking)
		return err_set(err, ERR_INTERNAL, "a reader was used for a scan inside a walk or scan");
	if (lo > hi)
		return 0;
	r->walking = true;
	look_ahead(&s);
	while (rc == 0 && s.more && s.nheap < 2)
		rc = begin_next(&s, err);
	n = s.nheap;
	if (rc == 0 && n == 1)
		rc = scan_one(&s, r->heap[0], err);
	else if (rc == 0 && n == 2) {
		s.nheap = 0;
		rc = load_first(&s, n, err);
		if (rc == 0)
			rc = s.nheap == 2 && !s.more ? scan_two(&s, err) : scan_many(&s, err);
	}
	r->walking = false;
	return rc;
}
