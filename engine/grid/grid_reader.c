/*
 * The reader of one thread (grid.h): its memory, index pages, blocks of cells. Every byte is checked before it is used:
 * pages and blocks against their own checksum and against the one in whatever points to them, so a stale or exchanged
 * page or block fails too.
 */
#include <assert.h>
#include <string.h>

#include "align.h"
#include "err.h"
#include "grid_priv.h"

/* ---- memory ---- */

/* Memory for merging, at most: of blocks, and of what very many segments need. */
enum { MERGE_MEMORY = 4 << 20, MERGE_RECORDS_LEAST = 64 };

/* A scan begins with two segments, if there are two, and goes on with those that meet. */
static uint32_t cursor_count(const struct grid *g)
{
	return g->order.depth == 1 && g->order.n > 1 ? 2 : g->order.depth;
}

/* The buffer of a cursor, in records; 0: a single segment is read without merging. */
static size_t merge_records(const struct grid *g)
{
	uint32_t n = cursor_count(g);
	size_t room = n > 1 ? MERGE_MEMORY / n / sizeof(struct point) : 0;

	if (room > GRID_CELL_RECORDS)
		return GRID_CELL_RECORDS;
	return n > 1 && room < MERGE_RECORDS_LEAST ? MERGE_RECORDS_LEAST : room;
}

/* Pages of level 0 that a reader keeps: the cells of a region are listed on few pages. */
static unsigned leaf_pages(const struct grid *g)
{
	uint64_t pages = 0;

	for (size_t i = 0; i < g->manifest->nsegments; i++)
		pages += g->segments[i].cells / DISK_ENTRIES + 1;
	return pages < GRID_LEAF_PAGES ? (unsigned)pages : GRID_LEAF_PAGES;
}

static size_t page_bytes(const struct grid *g)
{
	return (leaf_pages(g) + (g->height ? g->height - 1 : 0)) * (size_t)DISK_PAGE;
}

size_t grid_reader_bytes(const struct grid *g)
{
	size_t each = align_line(sizeof(struct grid_cursor)) + align_line(sizeof(struct grid_cursor *));

	return ALIGN_LINE + align_line(sizeof(struct grid_reader)) + page_bytes(g) + align_line(DISK_BLOCK_MAX) +
	       (g->lines ? align_line(lineset_reader_bytes()) : 0) + align_line(GRID_CELL_RECORDS * sizeof(struct point)) +
	       align_line(GRID_CELL_RECORDS) + (cursor_count(g) + 1) * each +
	       cursor_count(g) * align_line(merge_records(g) * sizeof(struct point));
}

int grid_reader_new(const struct grid *g, void *memory, size_t size, struct grid_reader **ret, struct err *err)
{
	uint8_t *at = (uint8_t *)align_line((uintptr_t)memory);
	struct grid_reader *r;

	if (size < grid_reader_bytes(g))
		return err_set(err, ERR_INTERNAL, "a reader needs %zu bytes, not %zu", grid_reader_bytes(g), size);
	r = align_carve(&at, sizeof *r);
	*r = (struct grid_reader){.grid = g, .nleaves = leaf_pages(g), .room = merge_records(g)};
	r->pages = align_carve(&at, page_bytes(g));
	r->block = align_carve(&at, DISK_BLOCK_MAX);
	r->piece = align_carve(&at, GRID_CELL_RECORDS * sizeof *r->piece);
	r->flags = align_carve(&at, GRID_CELL_RECORDS);
	r->cursors = align_carve(&at, (cursor_count(g) + 1) * sizeof *r->cursors);
	r->heap = align_carve(&at, (cursor_count(g) + 1) * sizeof *r->heap);
	if (g->lines)
		r->lines = lineset_reader_init(align_carve(&at, lineset_reader_bytes()), g->lines);
	memset(r->cursors, 0, (cursor_count(g) + 1) * sizeof *r->cursors);
	for (uint32_t i = 0; i < cursor_count(g); i++) {
		r->heap[i] = &r->cursors[i];
		r->cursors[i].pts = align_carve(&at, r->room * sizeof(struct point));
	}
	assert(at <= (uint8_t *)memory + size);
	*ret = r;
	return 0;
}

struct grid_reader *grid_reader_free(struct grid_reader *r)
{
	return NULL; /* everything is in the caller's memory */
}

struct grid_reader_stats grid_reader_stats(const struct grid_reader *r)
{
	return r->stats;
}

const struct grid *grid_reader_grid(const struct grid_reader *r)
{
	return r->grid;
}

struct lineset_reader *grid_reader_lines(struct grid_reader *r)
{
	return r->lines;
}

/* ---- index pages ---- */

/* The slot of the page: of the pages of level 0, the one that holds it or the least recently used one. */
static struct grid_held_page *find_held(struct grid_reader *r, uint32_t segment, unsigned level, uint64_t place)
{
	struct grid_held_page *at = r->held;

	if (level)
		return &r->held[r->nleaves + level - 1];
	for (unsigned i = 0; i < r->nleaves; i++) {
		struct grid_held_page *h = &r->held[i];

		if (h->valid && h->place == place && h->segment == segment) {
			at = h;
			break;
		}
		at = h->used < at->used ? h : at;
	}
	at->used = ++r->clock;
	r->leaf = (unsigned)(at - r->held);
	return at;
}

int grid_page_read(struct grid_reader *r, uint32_t segment, unsigned level, uint64_t place, uint64_t check, struct err *err)
{
	struct grid_segment p;
	struct grid_held_page *held = find_held(r, segment, level, place);
	uint8_t *page = grid_reader_page(r, level);

	r->stats.pages++;
	if (held->valid && held->place == place && held->segment == segment)
		return 0;
	held->place = place;
	held->segment = segment;
	held->valid = grid_cache_get(r->grid->cache, segment, place, page);
	if (held->valid)
		return 0;
	r->stats.misses++;
	int rc = grid_files_take(r->grid->files, segment, &p, err);

	if (rc)
		return rc;
	rc = grid_segment_page(&p, level, place, check, page, err);
	grid_files_give(r->grid->files, segment, &p);
	if (rc)
		return rc;
	grid_cache_put(r->grid->cache, segment, place, page);
	held->valid = true;
	return 0;
}

int grid_cell_of(const struct grid_segment *p, uint32_t segment, const struct disk_leaf *leaf, struct grid_cell *ret,
		 struct err *err)
{
	int rc = grid_segment_check_leaf(p, leaf, err);

	if (rc)
		return rc;
	*ret = (struct grid_cell){
		.lo = leaf->lo,
		.hi = disk_range_end(leaf->lo, leaf->bits),
		.count = leaf->count,
		.distinct = leaf->distinct,
		.segment = segment,
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
	const struct grid_live *live = &g->live[c->segment];

	if (live->all || live->none)
		return live->none;
	return c->source && !grid_live(g, c->source);
}

/* ---- blocks ---- */

void grid_cursor_cell(struct grid_cursor *c, const struct grid_cell *cell)
{
	c->cell = *cell;
	c->segment = cell->segment;
	c->block = 0;
	c->place = cell->place;
	c->check = 0;
}

/* Reads the bytes of the next block: first `want` bytes, then the rest if its head says that it is larger. */
static int read_bytes(struct grid_reader *r, const struct grid_segment *p, const struct grid_cursor *c, size_t want, bool whole,
		      struct grid_block *ret, struct err *err)
{
	size_t got = p->bytes - c->place < want ? (size_t)(p->bytes - c->place) : want, need;
	int rc;

	if (c->place > p->bytes || got < sizeof(struct disk_block))
		return grid_segment_damaged(p, c->place, "a block is cut off", err);
	rc = grid_segment_read(p, r->block, got, c->place, err);
	if (rc)
		return rc;
	need = grid_block_head_bytes(r->block);
	if (!need)
		return grid_segment_damaged(p, c->place, "a block has an impossible size", err);
	if (whole)
		need += ((const struct disk_block *)r->block)->records * sizeof(struct point);
	if (need > got)
		rc = grid_segment_read(p, r->block + got, need - got, c->place + got, err);
	if (rc)
		return rc;
	r->stats.bytes += need > got ? need : got;
	if (!grid_block_open(r->block, need, c->place, whole, ret))
		return grid_segment_damaged(p, c->place, "the checksum of a block does not agree", err);
	return 0;
}

static int read_block(struct grid_reader *r, const struct grid_cursor *c, size_t want, bool whole, struct grid_block *ret,
		      struct err *err)
{
	struct grid_segment p;
	int rc = grid_files_take(r->grid->files, c->segment, &p, err);

	if (rc)
		return rc;
	rc = read_bytes(r, &p, c, want, whole, ret, err);
	grid_files_give(r->grid->files, c->segment, &p);
	return rc;
}

/* Advances past a block. After the last one the sum of their checksums must be the one in the index. */
static int advance(struct grid_reader *r, struct grid_cursor *c, const struct grid_block *b, struct err *err)
{
	c->check += b->head->check;
	c->place += b->bytes;
	if (++c->block < c->cell.blocks)
		return 0;
	r->stats.cells++;
	if (c->check == c->cell.check)
		return 0;
	return grid_segment_damaged(&r->grid->segments[c->segment], c->cell.place, "a cell differs from its index entry", err);
}

/* Above them the slot. */
enum { LIVE = 1, LINE = 2, SLOT_SHIFT = 3 };

static uint8_t flags_of(const struct grid_reader *r, uint32_t segment, uint32_t source)
{
	const struct grid *g = r->grid;

	if (!g->live[segment].all && !grid_live(g, source))
		return 0;
	return (uint8_t)((source == g->line_source ? LIVE | LINE : LIVE) | grid_slot(g, source) << SLOT_SHIFT);
}

/* Keeps the live records, in place; in place of the source index their tags say whether they are of line vertices, and have the
 * slot. */
static int keep_live(struct grid_reader *r, uint32_t segment, const struct grid_block *b, size_t *ret_n, struct err *err)
{
	unsigned sources = b->head->sources, live = 0;
	size_t n = 0;

	for (unsigned i = 0; i < sources; i++) {
		r->flags[i] = flags_of(r, segment, b->sources[i].id);
		live += r->flags[i];
	}
	for (size_t i = 0; live && i < b->head->records; i++) {
		unsigned source = point_source(&b->records[i]);

		if (source >= sources)
			return grid_segment_damaged(&r->grid->segments[segment], 0, "a record has no source", err);
		b->records[n] = b->records[i];
		if (r->ids)
			r->ids[n] = b->sources[source].id;
		b->records[n].tag &= POINT_FLAGS;
		b->records[n].tag |= r->flags[source] & LINE ? POINT_LINE : 0;
		b->records[n].tag |= (uint16_t)((unsigned)r->flags[source] >> SLOT_SHIFT << POINT_SLOT_SHIFT);
		n += r->flags[source] & LIVE;
	}
	*ret_n = n;
	return 0;
}

int grid_cursor_block(struct grid_reader *r, struct grid_cursor *c, struct point **ret_pts, size_t *ret_n, struct err *err)
{
	uint64_t left = c->cell.count - c->block * (uint64_t)GRID_CELL_RECORDS;
	size_t want = (left < GRID_CELL_RECORDS ? left : GRID_CELL_RECORDS) * sizeof(struct point);
	struct grid_block b;
	size_t n;
	int rc = read_block(r, c, want + c->cell.head_bytes, true, &b, err);

	if (rc == 0)
		rc = advance(r, c, &b, err);
	if (rc)
		return rc;
	n = b.head->records;
	r->stats.records += n;
	/* Nothing to do in the common case of one live source without a slot: its index is zero. */
	if (b.head->sources > 1 || r->ids || flags_of(r, c->segment, b.sources[0].id) != LIVE)
		rc = keep_live(r, c->segment, &b, &n, err);
	if (rc)
		return rc;
	*ret_pts = b.records;
	*ret_n = n;
	return 0;
}

void grid_reader_ids(struct grid_reader *r, uint32_t *id)
{
	r->ids = id;
}

int grid_mark(struct grid_reader *r, const int32_t box[4], struct point *pts, size_t n, struct err *err)
{
	return r->grid->marks && n ? lineset_mark(r->lines, box, (double)r->grid->clear, pts, n, err) : 0;
}

int grid_cursor_head(struct grid_reader *r, struct grid_cursor *c, struct grid_block *ret, struct err *err)
{
	int rc = read_block(r, c, c->cell.head_bytes < sizeof(struct disk_block) ? sizeof(struct disk_block) : c->cell.head_bytes,
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

void grid_reader_until(struct grid_reader *r, const atomic_bool *cancel)
{
	r->cancel = cancel;
}

int grid_cell_read(struct grid_reader *r, const struct grid_cell *cell, grid_points_fn sink, void *ctx, struct err *err)
{
	struct grid_cursor c;
	struct point *pts;
	size_t n;

	if (r->cancel && atomic_load(r->cancel))
		return err_set(err, ERR_CANCELLED, "the search was cancelled");
	if (grid_cell_dead(r->grid, cell))
		return 0;
	for (grid_cursor_cell(&c, cell); c.block < cell->blocks;) {
		int rc = grid_cursor_block(r, &c, &pts, &n, err);

		if (rc == 0)
			rc = grid_mark(r, cell->box, pts, n, err);
		if (rc == 0 && n)
			rc = sink(ctx, pts, n, err);
		if (rc)
			return rc;
	}
	return 0;
}
