/*
 * Halos. There are up to four chains, one for each finite border. Every cell that is read feeds all of them, and is
 * read once.
 *
 * Rounds: a walk notes, for every column of every border, the nearest cell that is a hit. These cells are read, the
 * hulls get lower, and the next walk finds fewer hits. Nearest first is important: it reads a tenth of what "all hits"
 * reads if a border is far from the data. Once the hits of a walk are few, they are listed, and later rounds use the
 * list instead of the index. The cells read are recorded so that they are not noted again. When that memory or the
 * number of rounds is exhausted, a sweep in the order of the index finishes: it needs no memory, and ends after every
 * cell was tested once, because hulls only get lower: a cell that is no hit never becomes one.
 *
 * Membership is exact, without an epsilon. Nothing is allocated.
 */
#include "cut_halo.h"

#include <string.h>

#include "cut_halo_priv.h"
#include "cut_order.h"
#include "cut_valid.h"

/* ---- memory ---- */

static uint32_t seen_size(uint32_t cap)
{
	uint32_t n = 2048;

	while (n < cap / 64)
		n *= 2;
	return n;
}

static size_t round64(size_t n)
{
	return (n + 63) & ~(size_t)63;
}

/* Positions in the pool of all chains, for a region of at most cap positions. */
static size_t pool_size(uint32_t cap)
{
	return (size_t)cap / 2 + 16384;
}

size_t cut_halo_bytes(uint32_t cap)
{
	return 64 + round64(sizeof(struct cut_halo)) + round64(seen_size(cap) * sizeof(struct seen)) +
	       pool_size(cap) * sizeof(struct point);
}

static void add_chain(struct cut_halo *h, bool vertical, int64_t c2, int64_t t0, int64_t t1)
{
	if (c2 != INT64_MIN && c2 != INT64_MAX)
		cut_chain_init(&h->chain[h->nchain++], vertical, c2, t0, t1, NULL, 0, NULL, 0);
}

/* Redistributes the free part of the pool: half to chain `more`, or equal shares if there is none. */
static void share_pool(struct cut_halo *h, unsigned more)
{
	struct point *at = h->pool + h->pool_size;
	size_t used = 0, room, share;

	for (unsigned i = 0; i < h->nchain; i++) {
		struct cut_chain *c = &h->chain[i];

		memmove(h->pool + used, c->pt, c->n * sizeof(*c->pt));
		c->pt = h->pool + used;
		used += c->n;
	}
	room = h->pool_size - used;
	share = more < h->nchain && h->nchain > 1 ? room / 2 / (h->nchain - 1) : room / h->nchain;
	for (unsigned i = h->nchain; i-- > 0;) {
		struct cut_chain *c = &h->chain[i];

		c->cap = (uint32_t)(c->n + (i == more && h->nchain > 1 ? room / 2 : share));
		at -= c->cap;
		memmove(at, c->pt, c->n * sizeof(*c->pt));
		c->pt = at;
	}
}

struct cut_halo *cut_halo_init(void *scratch, size_t size, const struct cut_source *src, const struct view *view,
			       const struct cut_region *region, bool own_known)
{
	size_t pad = round64((uintptr_t)scratch) - (uintptr_t)scratch, left;
	struct cut_halo *h = (struct cut_halo *)((char *)scratch + pad);
	uint32_t table = 2048, batch;
	int64_t box[4];
	char *at;

	if (size < cut_halo_bytes(0))
		return NULL;
	/* The largest table that leaves the pool its share: the inverse of cut_halo_bytes. */
	left = size - pad - round64(sizeof(*h));
	while (2 * (size_t)table * sizeof(struct seen) * 8 < left)
		table *= 2;
	memset(h, 0, offsetof(struct cut_halo, list));
	at = (char *)h + round64(sizeof(*h));
	h->seen = (struct seen *)at;
	memset(h->seen, 0, table * sizeof(struct seen));
	h->seen_size = table;
	h->seen_limit = table - table / 8;
	at += round64(table * sizeof(struct seen));
	left -= round64(table * sizeof(struct seen));
	h->pool = (struct point *)at;
	h->src = *src;
	h->view = view;
	cut_judge_init(&h->judge, view);
	h->region = *region;
	h->own_known = own_known;
	h->rounds = ROUNDS;
	h->list_limit = LIST;
	h->many = TAKE_MANY;
	h->merged_always = MERGED_ALWAYS;
	h->merge_share = MERGE_SHARE;
	h->block_bits = SEED_BLOCK_BITS;
	h->column_bits = SEED_COLUMN_BITS;
	h->columns = own_known ? COLUMNS : 16;
	h->nrange = cut_region_ranges(region, h->range);
	cut_region_box(region, box);
	add_chain(h, true, box[0], box[1], box[3]);
	add_chain(h, true, box[2], box[1], box[3]);
	add_chain(h, false, box[1], box[0], box[2]);
	add_chain(h, false, box[3], box[0], box[2]);
	if (h->nchain == 0)
		return h;
	left /= sizeof(struct point);
	batch = left / BATCH_SHARE > BATCH ? (uint32_t)(left / BATCH_SHARE) : BATCH;
	h->pool_size = left - h->nchain * (size_t)batch;
	if (h->pool_size > UINT32_MAX)
		h->pool_size = UINT32_MAX;
	for (unsigned i = 0; i < h->nchain; i++) {
		h->chain[i].pt = h->pool;
		cut_chain_batch(&h->chain[i], h->pool + h->pool_size + i * (size_t)batch, batch);
	}
	share_pool(h, h->nchain);
	return h;
}

void cut_halo_before(struct cut_halo *h, const struct cut_trace *before)
{
	const struct point *from = before->site;
	struct point *at = h->bound_site;

	h->bounded = true;
	for (unsigned i = 0; i < h->nchain; from += before->nsite[i], at += before->nsite[i], i++) {
		const struct cut_chain *c = &h->chain[i];

		memcpy(at, from, before->nsite[i] * sizeof *at);
		cut_chain_init(&h->bound[i], c->vertical, c->c2, c->t0, c->t1, NULL, 0, NULL, 0);
		cut_chain_of(&h->bound[i], at, before->nsite[i]);
		cut_chain_survey(&h->bound[i]);
	}
}

void cut_halo_limit(struct cut_halo *h, unsigned rounds, uint32_t seen)
{
	h->rounds = rounds;
	if (seen < h->seen_limit)
		h->seen_limit = seen;
}

void cut_halo_merged(struct cut_halo *h, uint32_t always, uint32_t share)
{
	h->merge_share = share;
	h->merged_always = always;
}

void cut_halo_grain(struct cut_halo *h, unsigned block, unsigned columns, uint32_t list, uint32_t many)
{
	h->block_bits = block;
	h->column_bits = columns;
	if (list < h->list_limit)
		h->list_limit = list;
	h->many = many;
}

void cut_halo_stats(const struct cut_halo *h, uint64_t *ret_cells, uint64_t *ret_points)
{
	*ret_cells = h->cells;
	*ret_points = h->points;
}

int cut_halo_add(struct cut_halo *h, unsigned i, const struct point *p)
{
	int rc = cut_chain_add(&h->chain[i], h->view, p);

	if (rc == CUT_E_FULL) {
		share_pool(h, i);
		rc = cut_chain_add(&h->chain[i], h->view, p);
	}
	return rc;
}

int cut_halo_flush(struct cut_halo *h, unsigned i)
{
	int rc = cut_chain_flush(&h->chain[i], h->view);

	if (rc == CUT_E_FULL) {
		share_pool(h, i);
		rc = cut_chain_flush(&h->chain[i], h->view);
	}
	return rc;
}

/* ---- cells ---- */

static bool inside(const struct cut_halo *h, const struct grid_cell *cell)
{
	for (unsigned i = 0; i < h->nrange; i++)
		if (cell->lo >= h->range[i].lo && cell->hi <= h->range[i].hi)
			return true;
	return false;
}

static struct seen *seen_find(const struct cut_halo *h, const struct grid_cell *cell)
{
	uint64_t key = (cell->lo + cell->segment) * UINT64_C(0x9e3779b97f4a7c15) ^ cell->place;
	uint32_t i = (uint32_t)((key * UINT64_C(0xd6e8feb86659fd93)) >> 32) & (h->seen_size - 1);

	while (h->seen[i].used &&
	       (h->seen[i].lo != cell->lo || h->seen[i].place != cell->place || h->seen[i].segment != cell->segment))
		i = (i + 1) & (h->seen_size - 1);
	return &h->seen[i];
}

bool cut_halo_hit(const struct cut_halo *h, unsigned i, const int32_t box[4])
{
	return cut_chain_hit(&h->chain[i], box) && (!h->bounded || cut_chain_hit(&h->bound[i], box));
}

/* Whether a cell or subtree can contain a point that belongs to a chain. */
static bool matters(const struct cut_halo *h, const struct grid_cell *cell)
{
	if (cell->count == 0 || (h->own_known && inside(h, cell)))
		return false;
	for (unsigned i = 0; i < h->nchain; i++)
		if (cut_halo_hit(h, i, cell->box))
			return true;
	return false;
}

static bool halo_enter(void *ctx, const struct grid_cell *subtree)
{
	return matters(ctx, subtree);
}

/* Like a subtree: its keys are between those of its box's corners, too. */
static bool halo_segment(void *ctx, const struct grid_cell *whole)
{
	return matters(ctx, whole);
}

/* Between two walks a long chain keeps a small batch: a hull that is a little higher reads a few cells more, while merging costs
 * the whole chain. `all`: no walk follows. */
static int flush(struct cut_halo *h, bool all)
{
	for (unsigned i = 0; i < h->nchain; i++) {
		const struct cut_chain *c = &h->chain[i];
		int rc =
			all || c->n < h->merged_always || (uint64_t)c->nbatch * h->merge_share >= c->n ? cut_halo_flush(h, i) : 0;

		if (rc)
			return rc;
	}
	return 0;
}

/* ---- rounds ---- */

/* The part of the border's line that still matters, bounded by the data and the reach. */
static void span_columns(struct cut_halo *h)
{
	for (unsigned i = 0; i < h->nchain; i++) {
		const struct cut_chain *c = &h->chain[i];
		int64_t x;

		double reach = h->bounded && h->bound[i].reach < c->reach ? h->bound[i].reach : c->reach;

		cut_chain_span(c, h->box, &h->u0[i], &h->u1[i], &x);
		if (reach < 0x1p35) {
			int64_t far = (int64_t)reach + 1;

			h->u0[i] = c->t0 - far > h->u0[i] ? c->t0 - far : h->u0[i];
			h->u1[i] = c->t1 + far < h->u1[i] ? c->t1 + far : h->u1[i];
		}
		for (unsigned k = 0; k < h->columns; k++)
			h->noted[i][k].x = INT64_MAX;
	}
}

static int64_t column_of(const struct cut_halo *h, unsigned chain, int64_t u)
{
	int64_t width = h->u1[chain] - h->u0[chain] + 1;

	u -= h->u0[chain];
	return u < 0 ? 0 : u >= width ? h->columns - 1 : u * h->columns / width;
}

/* Whether the cell is nearer to a border than the noted cells, in one of its columns. */
static bool round_nearer(const struct cut_halo *h, const struct grid_cell *cell)
{
	for (unsigned i = 0; i < h->nchain; i++) {
		int64_t u0, u1, x, last;

		cut_chain_span(&h->chain[i], cell->box, &u0, &u1, &x);
		last = column_of(h, i, u1);
		for (int64_t k = column_of(h, i, u0); k <= last; k++)
			if (x < h->noted[i][k].x)
				return true;
	}
	return false;
}

/* As halo_enter when all cells are hits: skips subtrees that cannot contain the nearest cell of any column. */
static bool round_enter(void *ctx, const struct grid_cell *subtree)
{
	return round_nearer(ctx, subtree) && matters(ctx, subtree);
}

/* Notes an unread cell in the columns of the chains that it hits. False: it hits none. */
static bool round_note(struct cut_halo *h, const struct grid_cell *cell)
{
	bool any = false;

	for (unsigned i = 0; i < h->nchain; i++) {
		int64_t u0, u1, x, last;

		if (!cut_halo_hit(h, i, cell->box))
			continue;
		if (!any && seen_find(h, cell)->used)
			return false;
		any = true;
		cut_chain_span(&h->chain[i], cell->box, &u0, &u1, &x);
		last = column_of(h, i, u1);
		for (int64_t k = column_of(h, i, u0); k <= last; k++)
			if (x < h->noted[i][k].x) {
				h->noted[i][k].x = x;
				h->noted[i][k].cell = *cell;
			}
	}
	return any;
}

static int round_cell(void *ctx, const struct grid_cell *cell)
{
	struct cut_halo *h = ctx;

	if (cell->count == 0 || (h->own_known && inside(h, cell)) || !round_note(h, cell))
		return 0;
	if (h->nlist < h->list_limit)
		h->list[h->nlist++] = *cell;
	else
		h->listed = false;
	return 0;
}

/* Visits all hits, from the index or from the list (a listed cell may no longer be a hit). As long as a chain is empty,
 * all cells are hits, and only the nearest are searched. */
static int round_walk(struct cut_halo *h, struct err *err)
{
	struct grid_visitor v = {.ctx = h, .segment = halo_segment, .enter = halo_enter, .cell = round_cell};
	uint32_t n = h->nlist;
	bool empty = false;
	int rc;

	h->nlist = 0;
	if (!h->listed) {
		for (unsigned i = 0; i < h->nchain; i++)
			empty |= h->chain[i].n == 0 && !(h->bounded && h->bound[i].n);
		if (empty)
			v.enter = round_enter;
		h->listed = true;
		rc = h->src.walk(h->src.ctx, 0, UINT64_MAX, &v, err);
		h->listed &= !empty;
		return rc;
	}
	for (uint32_t i = 0; i < n; i++)
		if (round_note(h, &h->list[i]))
			h->list[h->nlist++] = h->list[i];
	return 0;
}

/* One walk, then reads the nearest hits of each column. *ret_more: there were some. */
static int round_once(struct cut_halo *h, bool *ret_more, struct err *err)
{
	bool more = false;
	int rc;

	span_columns(h);
	rc = round_walk(h, err);
	for (unsigned i = 0; i < h->nchain && !rc; i++)
		for (unsigned k = 0; k < h->columns && !rc; k++) {
			const struct noted *noted = &h->noted[i][k];
			struct seen *seen;

			if (noted->x == INT64_MAX)
				continue;
			more = true;
			seen = seen_find(h, &noted->cell);
			if (seen->used || h->nseen >= h->seen_limit)
				continue;
			*seen = (struct seen){noted->cell.lo, noted->cell.place, noted->cell.segment, 1};
			h->nseen++;
			rc = cut_halo_read(h, &noted->cell, err);
		}
	if (!rc)
		rc = flush(h, !more);
	h->columns = h->columns * 4 < COLUMNS ? h->columns * 4 : COLUMNS;
	*ret_more = more;
	return rc;
}

/* ---- sweep ---- */

static bool cell_before(const struct grid_cell *a, const struct grid_cell *b)
{
	if (a->segment != b->segment)
		return a->segment < b->segment;
	if (a->lo != b->lo)
		return a->lo < b->lo;
	return a->place < b->place;
}

static int sweep_cell(void *ctx, const struct grid_cell *cell)
{
	struct cut_halo *h = ctx;
	uint32_t i;

	if ((h->has_after && !cell_before(&h->after, cell)) || (h->nsweep == SWEEP && !cell_before(cell, &h->sweep[SWEEP - 1])) ||
	    !matters(h, cell) || seen_find(h, cell)->used)
		return 0;
	i = h->nsweep < SWEEP ? h->nsweep++ : SWEEP - 1;
	for (; i > 0 && cell_before(cell, &h->sweep[i - 1]); i--)
		h->sweep[i] = h->sweep[i - 1];
	h->sweep[i] = *cell;
	return 0;
}

static int sweep_all(struct cut_halo *h, struct err *err)
{
	const struct grid_visitor v = {.ctx = h, .segment = halo_segment, .enter = halo_enter, .cell = sweep_cell};

	for (;;) {
		int rc;

		h->nsweep = 0;
		rc = h->src.walk(h->src.ctx, 0, UINT64_MAX, &v, err);
		for (uint32_t i = 0; i < h->nsweep && !rc; i++)
			rc = cut_halo_read(h, &h->sweep[i], err);
		if (!rc)
			rc = flush(h, h->nsweep < SWEEP);
		if (rc || h->nsweep < SWEEP)
			return rc;
		h->after = h->sweep[SWEEP - 1];
		h->has_after = true;
	}
}

/* ---- result ---- */

static bool morton_less(const void *ctx, const struct point *a, const struct point *b)
{
	(void)ctx;
	return cut_order_before(a->x, a->y, b->x, b->y);
}

static int estimate_cell(void *ctx, const struct grid_cell *cell)
{
	struct cut_halo *h = ctx;

	if (matters(h, cell) && !seen_find(h, cell)->used)
		h->waiting += cell->distinct < cell->count ? cell->distinct : cell->count;
	return 0;
}

/* Estimates the halo, from the chains and the unread cells that may matter. */
static int estimate(struct cut_halo *h, uint64_t *ret, struct err *err)
{
	const struct grid_visitor v = {.ctx = h, .segment = halo_segment, .enter = halo_enter, .cell = estimate_cell};
	uint64_t known = 0;
	int rc;

	h->waiting = 0;
	rc = h->src.walk(h->src.ctx, 0, UINT64_MAX, &v, err);
	if (rc)
		return rc;
	for (unsigned i = 0; i < h->nchain; i++) {
		uint64_t outside = 0;

		for (uint32_t k = 0; k < h->chain[i].n; k++)
			outside += !cut_region_holds(&h->region, h->chain[i].pt[k].x, h->chain[i].pt[k].y);
		known = outside > known ? outside : known;
	}
	*ret = known + h->waiting;
	return CUT_E_FULL;
}

/* Collects the chains' points outside the region, each position once, at the front of the pool. */
static uint32_t collect_points(struct cut_halo *h)
{
	uint32_t n = 0, k = 0;

	for (unsigned i = 0; i < h->nchain; i++)
		for (uint32_t j = 0; j < h->chain[i].n; j++) {
			/* Copied: the write position in the pool is never past the read position. */
			struct point p = h->chain[i].pt[j];

			if (!cut_region_holds(&h->region, p.x, p.y))
				h->pool[n++] = p;
		}
	cut_order_sort(h->pool, n, morton_less, NULL);
	for (uint32_t i = 0; i < n; i++) {
		if (k > 0 && h->pool[k - 1].x == h->pool[i].x && h->pool[k - 1].y == h->pool[i].y) {
			if (view_prefers(h->view, &h->pool[i], &h->pool[k - 1]))
				h->pool[k - 1] = h->pool[i];
			continue;
		}
		h->pool[k++] = h->pool[i];
	}
	return k;
}

void cut_halo_trace(struct cut_halo *h, struct cut_trace *trace)
{
	h->trace = trace;
}

int cut_halo_find(struct cut_halo *h, const struct point **ret, uint32_t *ret_n, uint64_t *ret_need, struct err *err)
{
	bool more = h->nchain > 0;
	int rc = 0;

	more = more && h->src.box(h->src.ctx, h->box);
	for (unsigned round = 0; more && !rc && round < h->rounds && h->nseen < h->seen_limit; round++)
		rc = round_once(h, &more, err);
	if (more && !rc)
		rc = sweep_all(h, err);
	if (rc == CUT_E_FULL)
		return estimate(h, ret_need, err);
	if (rc)
		return rc;
	if (h->trace)
		cut_trace_sites(h->trace, h->chain, h->nchain);
	*ret_n = collect_points(h);
	*ret = h->pool;
	return 0;
}
