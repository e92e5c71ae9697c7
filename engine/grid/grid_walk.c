/*
 * Walks over the index (grid.h): cells, counts, content sums. All use one descent and differ in what they do with a
 * subtree and with a cell. Pages are copies that belong to the reader, so a slow visitor blocks nobody.
 */
#include <string.h>

#include "err.h"
#include "grid_priv.h"

struct descent {
	struct grid_reader *r;
	uint32_t segment;
	uint64_t lo, hi;
	void *ctx;
	bool (*enter)(const struct descent *); /* whether to visit `segment`; NULL: always */
	/* Whether to descend into a subtree that meets [lo, hi]. */
	bool (*inner)(struct descent *, const struct disk_inner *);
	int (*cell)(struct descent *, const struct grid_cell *, const struct disk_leaf *, struct err *err);
};

static int descend_leaf(struct descent *d, struct err *err)
{
	const struct grid_segment *p = &d->r->grid->segments[d->segment];
	const uint8_t *page = grid_reader_page(d->r, 0);
	unsigned n = grid_page_entries(page);

	for (unsigned i = d->lo ? grid_page_find(page, false, d->lo) : 0; i < n; i++) {
		const struct disk_leaf *leaf = grid_page_leaf(page, i);
		struct grid_cell cell;

		if (leaf->lo > d->hi)
			break;
		int rc = grid_cell_of(p, d->segment, leaf, &cell, err);

		if (rc == 0 && cell.hi >= d->lo && !grid_cell_dead(d->r->grid, &cell))
			rc = d->cell(d, &cell, leaf, err);
		if (rc)
			return rc;
	}
	return 0;
}

static int descend_page(struct descent *d, unsigned level, uint64_t place, uint64_t check, struct err *err)
{
	int rc = grid_page_read(d->r, d->segment, level, place, check, err);

	if (rc)
		return rc;
	if (!level)
		return descend_leaf(d, err);

	const uint8_t *page = grid_reader_page(d->r, level);
	unsigned first = d->lo ? grid_page_find(page, true, d->lo) : 0;

	for (unsigned i = first, n = grid_page_entries(page); rc == 0 && i < n; i++) {
		const struct disk_inner *e = grid_page_inner(page, i);

		if (e->lo > d->hi)
			break;
		if (e->hi >= d->lo && d->inner(d, e))
			rc = descend_page(d, level - 1, e->place, e->check, err);
	}
	return rc;
}

static int descend_segment(struct descent *d, const struct grid_segment *p, struct err *err)
{
	uint64_t place, check;
	int rc = grid_root_of(d->r->grid, d->segment, &place, &check, err);

	return rc ? rc : descend_page(d, p->height - 1, place, check, err);
}

/* Descends into the segments that have live records with keys in the range. */
static int descend(struct descent *d, struct err *err)
{
	const struct grid *g = d->r->grid;
	int rc = 0;

	if (d->r->walking)
		return err_set(err, ERR_INTERNAL, "a reader was used for a second walk inside a walk");
	d->r->walking = true;
	for (uint32_t i = 0; rc == 0 && d->lo <= d->hi; i++) {
		const struct grid_segment *p;

		i = grid_order_next(&g->order, i, d->lo);
		if (i == g->order.n)
			break;
		d->segment = g->order.segment[i];
		p = &g->segments[d->segment];
		if (p->lo > d->hi)
			break;
		if (!d->enter || d->enter(d))
			rc = descend_segment(d, p, err);
	}
	d->r->walking = false;
	return rc;
}

static bool inside(const struct descent *d, uint64_t lo, uint64_t hi)
{
	return lo >= d->lo && hi <= d->hi;
}

/* ---- walk ---- */

static bool walk_inner(struct descent *d, const struct disk_inner *e)
{
	const struct grid_visitor *v = d->ctx;
	struct grid_cell cell = {
		.lo = e->lo,
		.hi = e->hi,
		.count = e->count,
		.distinct = e->distinct,
		.segment = d->segment,
	};

	memcpy(cell.box, e->box, sizeof cell.box);
	return !v->enter || v->enter(v->ctx, &cell);
}

static bool walk_segment(const struct descent *d)
{
	const struct grid_segment *p = &d->r->grid->segments[d->segment];
	const struct grid_visitor *v = d->ctx;
	struct grid_cell whole = {
		.lo = p->lo, .hi = p->hi, .segment = d->segment, .count = d->r->grid->manifest->segments[d->segment].points};

	memcpy(whole.box, p->box, sizeof whole.box);
	return !v->segment || v->segment(v->ctx, &whole);
}

static int walk_cell(struct descent *d, const struct grid_cell *cell, const struct disk_leaf *leaf, struct err *err)
{
	const struct grid_visitor *v = d->ctx;

	return v->cell(v->ctx, cell);
}

int grid_walk(struct grid_reader *r, uint64_t lo, uint64_t hi, const struct grid_visitor *visitor, struct err *err)
{
	struct descent d = {.r = r,
			    .lo = lo,
			    .hi = hi,
			    .ctx = (void *)visitor,
			    .enter = walk_segment,
			    .inner = walk_inner,
			    .cell = walk_cell};

	return descend(&d, err);
}

/* ---- count ---- */

struct count {
	uint64_t count;
	bool exact;
};

/* Of a whole segment nothing is read: the number of its live records is known. */
static bool count_segment(const struct descent *d)
{
	const struct grid_segment *p = &d->r->grid->segments[d->segment];
	struct count *c = d->ctx;

	if (!inside(d, p->lo, p->hi))
		return true;
	c->count += d->r->grid->live[d->segment].points;
	return false;
}

static bool count_inner(struct descent *d, const struct disk_inner *e)
{
	struct count *c = d->ctx;

	if (!inside(d, e->lo, e->hi))
		return true;
	c->count += e->count;
	c->exact = c->exact && d->r->grid->live[d->segment].all;
	return false;
}

static int count_cell(struct descent *d, const struct grid_cell *cell, const struct disk_leaf *leaf, struct err *err)
{
	struct count *c = d->ctx;
	struct grid_cursor cursor;
	struct point *pts;
	size_t n;

	if (inside(d, cell->lo, cell->hi)) {
		c->count += cell->count; /* a cell with one source is live, else it was skipped */
		c->exact = c->exact && (cell->source || d->r->grid->live[d->segment].all);
		return 0;
	}
	for (grid_cursor_cell(&cursor, cell); cursor.block < cell->blocks;) {
		int rc = grid_cursor_block(d->r, &cursor, &pts, &n, err);

		if (rc)
			return rc;
		grid_trim(&pts, &n, d->lo, d->hi);
		c->count += n;
	}
	return 0;
}

int grid_count(struct grid_reader *r, uint64_t lo, uint64_t hi, uint64_t *ret_count, bool *ret_exact, struct err *err)
{
	struct count c = {.exact = true};
	struct descent d = {
		.r = r, .lo = lo, .hi = hi, .ctx = &c, .enter = count_segment, .inner = count_inner, .cell = count_cell};
	int rc = descend(&d, err);

	if (rc)
		return rc;
	*ret_count = c.count;
	*ret_exact = c.exact;
	return 0;
}

/* ---- content sum ---- */

/* Sums a cell of sources that count differently from the heads of its blocks, without reading its records. */
static int sum_heads(struct descent *d, const struct grid_cell *cell, struct err *err)
{
	struct grid_cursor cursor;
	struct grid_block b;

	for (grid_cursor_cell(&cursor, cell); cursor.block < cell->blocks;) {
		int rc = grid_cursor_head(d->r, &cursor, &b, err);

		if (rc)
			return rc;
		for (unsigned i = 0; i < b.head->sources; i++)
			if (grid_live(d->r->grid, b.sources[i].id))
				digest_add(d->ctx, grid_slot_sum((struct digest){b.sources[i].sum_hi, b.sources[i].sum_lo},
								 grid_slot(d->r->grid, b.sources[i].id)));
	}
	return 0;
}

/*
 * Sums of many ranges. All keys of a cell or subtree are between the keys of its box's corners, which is often a
 * smaller interval than its own range. So a range that was drawn around a box contains whole cells more often.
 */
struct sums {
	struct grid_sum *range;
	size_t n;
};

enum relation { OUTSIDE, ACROSS, INSIDE };

static enum relation sums_relation(const struct sums *s, const int32_t box[4], struct digest **ret)
{
	uint64_t lo = point_morton(box[0], box[1]), hi = point_morton(box[2], box[3]);
	size_t i = grid_sum_find(s->range, s->n, lo);

	if (i == s->n || s->range[i].lo > hi)
		return OUTSIDE;
	*ret = &s->range[i].sum;
	return s->range[i].lo <= lo && hi <= s->range[i].hi ? INSIDE : ACROSS;
}

/* Whether all records of a segment are live and of one slot. */
static bool is_uniform(const struct grid_live *l)
{
	return l->all && !(l->slots & (l->slots - 1));
}

static bool sums_segment(const struct descent *d)
{
	struct digest *sum;
	enum relation relation = sums_relation(d->ctx, d->r->grid->segments[d->segment].box, &sum);

	if (relation == INSIDE)
		digest_add(sum, d->r->grid->live[d->segment].content);
	return relation == ACROSS;
}

static bool sums_inner(struct descent *d, const struct disk_inner *e)
{
	const struct grid_live *l = &d->r->grid->live[d->segment];
	struct digest *sum;
	enum relation relation = sums_relation(d->ctx, e->box, &sum);

	if (relation != INSIDE || !is_uniform(l))
		return relation != OUTSIDE;
	digest_add(sum, grid_slot_sum((struct digest){e->sum_hi, e->sum_lo}, l->slot));
	return false;
}

static int sums_records(struct descent *d, const struct grid_cell *cell, struct err *err)
{
	struct sums *s = d->ctx;
	struct grid_cursor cursor;
	struct point *pts;
	size_t n;

	for (grid_cursor_cell(&cursor, cell); cursor.block < cell->blocks;) {
		int rc = grid_cursor_block(d->r, &cursor, &pts, &n, err);

		if (rc)
			return rc;
		for (size_t i = 0; i < n; i++) {
			uint64_t key = point_morton(pts[i].x, pts[i].y);
			size_t k = grid_sum_find(s->range, s->n, key);

			if (k < s->n && s->range[k].lo <= key)
				digest_add(&s->range[k].sum,
					   grid_slot_sum(grid_record_hash(&pts[i]), (uint8_t)point_slot(&pts[i])));
		}
	}
	return 0;
}

static int sums_cell(struct descent *d, const struct grid_cell *cell, const struct disk_leaf *leaf, struct err *err)
{
	const struct grid_live *l = &d->r->grid->live[d->segment];
	struct digest *sum = NULL;

	switch (sums_relation(d->ctx, cell->box, &sum)) {
	case OUTSIDE:
		return 0;
	case ACROSS:
		return sums_records(d, cell, err);
	default:
		break;
	}
	if (!cell->source && !is_uniform(l)) {
		struct descent heads = *d;

		heads.ctx = sum;
		return sum_heads(&heads, cell, err);
	}
	digest_add(sum, grid_slot_sum((struct digest){leaf->sum_hi, leaf->sum_lo},
				      cell->source ? grid_slot(d->r->grid, cell->source) : l->slot));
	return 0;
}

/* What marks depend on. */
static int sums_lines(struct grid_reader *r, struct grid_sum *range, size_t n, struct err *err)
{
	for (size_t i = 0; i < n; i++) {
		struct digest lines;
		int rc = lineset_sum_range(r->lines, range[i].lo, range[i].hi, r->grid->clear, &lines, err);

		if (rc)
			return rc;
		digest_add(&range[i].sum, lines);
	}
	return 0;
}

int grid_sums(struct grid_reader *r, struct grid_sum *range, size_t n, struct err *err)
{
	struct sums sums = {range, n};
	struct descent d = {.r = r, .ctx = &sums, .enter = sums_segment, .inner = sums_inner, .cell = sums_cell};
	int rc;

	for (size_t i = 0; i < n; i++)
		range[i].sum = (struct digest){0, 0};
	if (!n)
		return 0;
	d.lo = range[0].lo;
	d.hi = range[n - 1].hi;
	rc = descend(&d, err);
	return rc || !r->grid->marks ? rc : sums_lines(r, range, n, err);
}

int grid_sum(struct grid_reader *r, uint64_t lo, uint64_t hi, struct digest *ret, struct err *err)
{
	struct grid_sum range = {.lo = lo, .hi = hi};
	int rc = grid_sums(r, &range, 1, err);

	if (rc == 0)
		*ret = range.sum;
	return rc;
}
