/*
 * One thread's reading (grid.h): its memory, pages of the index, blocks of cells. Every byte is checked
 * before it is believed: pages and blocks against their own checksum and against the one that whoever
 * points to them carries, so that a stale or exchanged page or block does not pass either.
 */
#include <assert.h>
#include <string.h>

#include "err.h"
#include "grid_read.h"

/* ---- memory ---- */

enum { LINE = 64 };

static size_t lines(size_t n)
{
	return (n + LINE - 1) & ~(size_t)(LINE - 1);
}

static uint32_t buffers(const struct grid *g)
{
	return g->active > 1 ? g->active : 0; /* a single segment is read without merging */
}

/* Pages of cells that a reader has in hand: the regions that it is asked for lie on few. */
static unsigned leaves(const struct grid *g)
{
	uint64_t pages = 0;

	for (size_t i = 0; i < g->manifest->nsegments; i++)
		pages += g->parts[i].cells / DISK_ENTRIES + 1;
	return pages < GRID_LEAVES ? (unsigned)pages : GRID_LEAVES;
}

static size_t page_bytes(const struct grid *g)
{
	return (leaves(g) + (g->height ? g->height - 1 : 0)) * (size_t)DISK_PAGE;
}

size_t grid_reader_bytes(const struct grid *g)
{
	size_t each = lines(sizeof(struct grid_cursor)) + lines(sizeof(struct grid_cursor *));

	return LINE + lines(sizeof(struct grid_reader)) + page_bytes(g) + lines(DISK_BLOCK_MAX) +
	       lines(GRID_CELL_RECORDS * sizeof(struct point)) + lines(GRID_CELL_RECORDS) + (g->active + 1) * each +
	       buffers(g) * lines(GRID_CELL_RECORDS * sizeof(struct point));
}

static void *carve(uint8_t **at, size_t n)
{
	void *piece = *at;

	*at += lines(n);
	return piece;
}

int grid_reader_new(const struct grid *g, void *memory, size_t size, struct grid_reader **ret, struct err *err)
{
	uint8_t *at = (uint8_t *)(((uintptr_t)memory + LINE - 1) & ~(uintptr_t)(LINE - 1));
	struct grid_reader *r;

	if (size < grid_reader_bytes(g))
		return err_set(err, ERR_INTERNAL, "a reader needs %zu bytes, not %zu", grid_reader_bytes(g), size);
	r = carve(&at, sizeof *r);
	*r = (struct grid_reader){.grid = g, .leaves = leaves(g)};
	r->pages = carve(&at, page_bytes(g));
	r->block = carve(&at, DISK_BLOCK_MAX);
	r->piece = carve(&at, GRID_CELL_RECORDS * sizeof *r->piece);
	r->flags = carve(&at, GRID_CELL_RECORDS);
	r->cursors = carve(&at, (g->active + 1) * sizeof *r->cursors);
	r->heap = carve(&at, (g->active + 1) * sizeof *r->heap);
	memset(r->cursors, 0, (g->active + 1) * sizeof *r->cursors);
	for (uint32_t i = 0; i < buffers(g); i++)
		r->cursors[i].pts = carve(&at, GRID_CELL_RECORDS * sizeof(struct point));
	assert(at <= (uint8_t *)memory + size);
	*ret = r;
	return 0;
}

struct grid_reader *grid_reader_free(struct grid_reader *r)
{
	return NULL; /* everything lies in the caller's memory */
}

struct grid_reader_stats grid_reader_stats(const struct grid_reader *r)
{
	return r->stats;
}

const struct grid *grid_reader_grid(const struct grid_reader *r)
{
	return r->grid;
}

/* ---- index pages ---- */

/* Where the page is, or will be: of pages of cells that whose last use is longest ago gives way. */
static struct grid_held *hold(struct grid_reader *r, uint32_t part, unsigned level, uint64_t place)
{
	struct grid_held *at = r->held;

	if (level)
		return &r->held[r->leaves + level - 1];
	for (unsigned i = 0; i < r->leaves; i++) {
		struct grid_held *h = &r->held[i];

		if (h->is && h->place == place && h->part == part) {
			at = h;
			break;
		}
		at = h->used < at->used ? h : at;
	}
	at->used = ++r->clock;
	r->leaf = (unsigned)(at - r->held);
	return at;
}

int grid_page_read(struct grid_reader *r, uint32_t part, unsigned level, uint64_t place, uint64_t check, struct err *err)
{
	const struct grid_part *p = &r->grid->parts[part];
	struct grid_held *held = hold(r, part, level, place);
	uint8_t *page = grid_reader_page(r, level);
	const struct disk_page *head = (const struct disk_page *)page;

	r->stats.pages++;
	if (held->is && held->place == place && held->part == part)
		return 0;
	held->place = place;
	held->part = part;
	held->is = grid_cache_get(r->grid->cache, part, place, page);
	if (held->is)
		return 0;
	r->stats.misses++;
	int rc = grid_part_read(p, page, DISK_PAGE, place, err);

	if (rc)
		return rc;
	if (head->check != check || check != grid_check(page + 8, DISK_PAGE - 8, place))
		return grid_damaged(p, place, "the checksum of an index page does not agree", err);
	if (head->magic != DISK_PAGE_MAGIC || head->level != level || !head->entries || head->entries > DISK_ENTRIES)
		return grid_damaged(p, place, "an index page is not what it should be", err);
	grid_cache_put(r->grid->cache, part, place, page);
	held->is = true;
	return 0;
}

int grid_cell_of(const struct grid_part *p, uint32_t part, const struct disk_leaf *leaf, struct grid_cell *ret, struct err *err)
{
	if (leaf->bits > 64 || (leaf->lo & disk_range_end(0, leaf->bits)) || leaf->place % DISK_ALIGN || !leaf->blocks ||
	    !leaf->count || leaf->head_bytes > DISK_HEAD_MAX || leaf->count > (uint64_t)leaf->blocks * GRID_CELL_RECORDS ||
	    leaf->place > p->bytes || leaf->bytes > p->bytes - leaf->place)
		return grid_damaged(p, leaf->place, "an index entry is not what it should be", err);
	*ret = (struct grid_cell){
		.lo = leaf->lo,
		.hi = disk_range_end(leaf->lo, leaf->bits),
		.count = leaf->count,
		.distinct = leaf->distinct,
		.segment = part,
		.blocks = leaf->blocks,
		.place = leaf->place,
		.check = leaf->check,
		.head_bytes = leaf->head_bytes,
		.source = leaf->source,
	};
	memcpy(ret->box, leaf->box, sizeof ret->box);
	return 0;
}

bool grid_cell_dead(const struct grid *g, const struct grid_cell *c)
{
	const struct grid_part *p = &g->parts[c->segment];

	if (p->all_live || p->none_live)
		return p->none_live;
	return c->source && !grid_live(g, c->source);
}

/* ---- blocks ---- */

void grid_cursor_cell(struct grid_cursor *c, const struct grid_cell *cell)
{
	c->cell = *cell;
	c->part = cell->segment;
	c->block = 0;
	c->place = cell->place;
	c->check = 0;
}

/* The next block's bytes: first `want`, then what its head says is missing. */
static int fetch(struct grid_reader *r, struct grid_cursor *c, size_t want, bool whole, struct grid_block *ret, struct err *err)
{
	const struct grid_part *p = &r->grid->parts[c->part];
	size_t got = p->bytes - c->place < want ? (size_t)(p->bytes - c->place) : want, need;
	int rc;

	if (c->place > p->bytes || got < sizeof(struct disk_block))
		return grid_damaged(p, c->place, "a block is cut off", err);
	rc = grid_part_read(p, r->block, got, c->place, err);
	if (rc)
		return rc;
	need = grid_block_head_bytes(r->block);
	if (!need)
		return grid_damaged(p, c->place, "a block has an impossible size", err);
	if (whole)
		need += ((const struct disk_block *)r->block)->records * sizeof(struct point);
	if (need > got)
		rc = grid_part_read(p, r->block + got, need - got, c->place + got, err);
	if (rc)
		return rc;
	r->stats.bytes += need > got ? need : got;
	if (!grid_block_open(r->block, need, c->place, whole, ret))
		return grid_damaged(p, c->place, "the checksum of a block does not agree", err);
	return 0;
}

/* Go on behind a block; after the last one the checksums of all must be what the index says. */
static int advance(struct grid_reader *r, struct grid_cursor *c, const struct grid_block *b, struct err *err)
{
	c->check += b->head->check;
	c->place += b->bytes;
	if (++c->block < c->cell.blocks)
		return 0;
	r->stats.cells++;
	if (c->check == c->cell.check)
		return 0;
	return grid_damaged(&r->grid->parts[c->part], c->cell.place, "a cell is not the one that the index means", err);
}

/* Keep what is live, in place, and clear the source index of all. */
static int keep_live(struct grid_reader *r, const struct grid_part *p, const struct grid_block *b, size_t *ret_n, struct err *err)
{
	unsigned sources = b->head->sources, live = 0;
	size_t n = 0;

	for (unsigned i = 0; i < sources; i++) {
		r->flags[i] = p->all_live || grid_live(r->grid, b->sources[i].id);
		live += r->flags[i];
	}
	for (size_t i = 0; live && i < b->head->records; i++) {
		unsigned source = point_source(&b->records[i]);

		if (source >= sources)
			return grid_damaged(p, 0, "a record has no source", err);
		b->records[n] = b->records[i];
		b->records[n].tag &= POINT_FLAGS;
		n += r->flags[source];
	}
	*ret_n = n;
	return 0;
}

int grid_cursor_block(struct grid_reader *r, struct grid_cursor *c, struct point **ret_pts, size_t *ret_n, struct err *err)
{
	const struct grid_part *p = &r->grid->parts[c->part];
	uint64_t left = c->cell.count - c->block * (uint64_t)GRID_CELL_RECORDS;
	size_t want = (left < GRID_CELL_RECORDS ? left : GRID_CELL_RECORDS) * sizeof(struct point);
	struct grid_block b;
	size_t n;
	int rc = fetch(r, c, want + c->cell.head_bytes, true, &b, err);

	if (rc == 0)
		rc = advance(r, c, &b, err);
	if (rc)
		return rc;
	n = b.head->records;
	r->stats.records += n;
	/* The common case costs nothing: one source, of index zero, and it is live. */
	if (b.head->sources > 1 || !(p->all_live || grid_live(r->grid, b.sources[0].id)))
		rc = keep_live(r, p, &b, &n, err);
	if (rc)
		return rc;
	*ret_pts = b.records;
	*ret_n = n;
	return 0;
}

int grid_cursor_head(struct grid_reader *r, struct grid_cursor *c, struct grid_block *ret, struct err *err)
{
	int rc = fetch(r, c, c->cell.head_bytes < sizeof(struct disk_block) ? sizeof(struct disk_block) : c->cell.head_bytes,
		       false, ret, err);

	return rc ? rc : advance(r, c, ret, err);
}

void grid_trim(struct point **pts, size_t *n, uint64_t lo, uint64_t hi)
{
	size_t from = 0, to = *n, end = *n;

	while (from < to) { /* the first with key >= lo */
		size_t mid = from + (to - from) / 2;

		if (point_morton((*pts)[mid].x, (*pts)[mid].y) < lo)
			from = mid + 1;
		else
			to = mid;
	}
	size_t first = from;

	for (to = end; from < to;) { /* the first with key > hi */
		size_t mid = from + (to - from) / 2;

		if (point_morton((*pts)[mid].x, (*pts)[mid].y) <= hi)
			from = mid + 1;
		else
			to = mid;
	}
	*pts += first;
	*n = from - first;
}

int grid_cell_read(struct grid_reader *r, const struct grid_cell *cell, grid_points_fn sink, void *ctx, struct err *err)
{
	struct grid_cursor c;
	struct point *pts;
	size_t n;

	if (grid_cell_dead(r->grid, cell))
		return 0;
	for (grid_cursor_cell(&c, cell); c.block < cell->blocks;) {
		int rc = grid_cursor_block(r, &c, &pts, &n, err);

		if (rc == 0 && n)
			rc = sink(ctx, pts, n, err);
		if (rc)
			return rc;
	}
	return 0;
}
