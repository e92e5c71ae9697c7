/*
 * A pass over a segment (grid_pass.h): visits its cells, all or those that meet a range of keys, in the order of the index.
 * Blocks are in the same order in the file, so they are read through a window that moves forwards. An index page is behind the
 * cells that it lists, and is read separately. Every byte is checked: pages and heads against whatever points to them, records
 * against their head, totals against the header.
 */
#include "grid_pass.h"

#include <stdlib.h>
#include <string.h>

#include "align.h"
#include "err.h"
#include "io.h"
#include "order.h"

size_t grid_pass_bytes(uint64_t cells, size_t window)
{
	return grid_index_levels(cells) * (size_t)DISK_PAGE + align_line(window) +
	       align_line(GRID_CELL_RECORDS * sizeof(uint32_t));
}

bool grid_dropped_has(const struct grid_dropped *d, uint32_t id)
{
	return d->n && bsearch(&id, d->ids, d->n, sizeof id, order_u32);
}

int grid_pass_open(struct grid_pass *p, int dirfd, const struct grid_segment_info *info, const struct grid_dropped *dropped,
		   const struct grid_range *range, void *memory, size_t window, struct disk_total **ret_sources, uint32_t *ret_n,
		   struct err *err)
{
	struct disk_segment h;
	uint8_t *at = memory;

	*p = (struct grid_pass){.segment.fd = -1, .dropped = dropped, .range = {0, UINT64_MAX}, .cap = window};
	if (range)
		p->range = *range;
	p->part = p->range.lo || p->range.hi != UINT64_MAX;
	int rc = grid_segment_open(&p->segment, dirfd, info, &h, err);

	if (rc == 0)
		rc = grid_segment_sources(&p->segment, &h, ret_sources, err);
	if (rc) {
		grid_pass_close(p);
		return rc;
	}
	*ret_n = h.sources;
	p->expected = h.points;
	p->pages = at;
	at += h.height * (size_t)DISK_PAGE;
	p->window = at;
	p->ids = (uint32_t *)(at + align_line(window));
	return 0;
}

void grid_pass_close(struct grid_pass *p)
{
	p->segment.fd = io_close(p->segment.fd);
}

/* ---- the index ---- */

static uint8_t *page_of(const struct grid_pass *p, unsigned level)
{
	return p->pages + level * (size_t)DISK_PAGE;
}

static int read_page(struct grid_pass *p, unsigned level, uint64_t place, uint64_t check, struct err *err)
{
	uint8_t *page = page_of(p, level);
	int rc = grid_segment_page(&p->segment, level, place, check, page, err);

	p->at[level] = 0;
	return rc;
}

static bool is_over(const struct grid_pass *p, unsigned level)
{
	return p->at[level] == grid_page_entries(page_of(p, level));
}

/* The lowest level that has an entry left; the height of the index if none has. */
static unsigned lowest_level(const struct grid_pass *p)
{
	unsigned level = 0;

	while (level < p->segment.height && is_over(p, level))
		level++;
	return level;
}

/* Reads a page, and moves to its first entry that meets the range. */
static int enter_page(struct grid_pass *p, unsigned level, uint64_t place, uint64_t check, struct err *err)
{
	int rc = read_page(p, level, place, check, err);

	if (rc == 0)
		p->at[level] = grid_page_find(page_of(p, level), level > 0, p->range.lo);
	return rc;
}

int grid_pass_cell(struct grid_pass *p, bool *ret_end, struct err *err)
{
	unsigned level, height = p->segment.height;
	int rc = 0;

	*ret_end = false;
	if (!p->begun && height)
		rc = enter_page(p, height - 1, p->segment.root, p->segment.root_check, err);
	level = p->begun ? lowest_level(p) : rc == 0 && height && !is_over(p, height - 1) ? height - 1 : height;
	p->begun = true;
	if (rc == 0 && level == height) {
		*ret_end = true;
		return 0;
	}
	for (; rc == 0 && level > 0; level--) {
		const struct disk_inner *e = grid_page_inner(page_of(p, level), p->at[level]++);

		rc = enter_page(p, level - 1, e->place, e->check, err);
		if (rc == 0 && is_over(p, level - 1))
			rc = grid_segment_damaged(&p->segment, e->place, "an index page ends before its entry", err);
	}
	if (rc)
		return rc;
	p->leaf = *grid_page_leaf(page_of(p, 0), p->at[0]++);
	if (p->leaf.lo > p->range.hi) {
		*ret_end = true;
		return 0;
	}
	p->block = 0;
	p->place = p->leaf.place;
	p->check = 0;
	return grid_segment_check_leaf(&p->segment, &p->leaf, err);
}

/* ---- blocks ---- */

/* Provides n bytes at a place of the file, in the window; n is at most its size. */
static int bytes_at(struct grid_pass *p, uint64_t place, size_t n, uint8_t **ret, struct err *err)
{
	int rc = 0;

	if (place < p->from || place + n > p->from + p->have) {
		uint64_t left = place < p->segment.bytes ? p->segment.bytes - place : 0;

		p->have = left < p->cap ? (size_t)left : p->cap;
		p->from = place;
		if (n > p->have)
			return grid_segment_damaged(&p->segment, place, "a block is cut off", err);
		rc = grid_segment_read(&p->segment, p->window, p->have, place, err);
	}
	*ret = p->window + (place - p->from);
	return rc;
}

static int read_block(struct grid_pass *p, struct grid_block *ret, struct err *err)
{
	uint8_t *bytes = NULL;
	size_t need;
	int rc = bytes_at(p, p->place, sizeof(struct disk_block), &bytes, err);

	if (rc)
		return rc;
	need = grid_block_head_bytes(bytes);
	if (!need)
		return grid_segment_damaged(&p->segment, p->place, "a block has an impossible size", err);
	need += ((const struct disk_block *)bytes)->records * sizeof(struct point);
	rc = bytes_at(p, p->place, need, &bytes, err);
	if (rc)
		return rc;
	if (!grid_block_open(bytes, need, p->place, true, ret))
		return grid_segment_damaged(&p->segment, p->place, "the checksum of a block does not agree", err);
	p->check += ret->head->check;
	p->place += ret->bytes;
	if (++p->block == p->leaf.blocks && p->check != p->leaf.check)
		return grid_segment_damaged(&p->segment, p->leaf.place, "a cell differs from its index entry", err);
	p->cells += p->block == p->leaf.blocks;
	p->points += ret->head->records;
	return 0;
}

/* Removes the records outside of the range, in place. Returns how many are left. */
static size_t filter_keys(struct grid_pass *p, struct point *at, size_t n)
{
	size_t stay = 0;

	if (p->leaf.lo >= p->range.lo && disk_range_end(p->leaf.lo, p->leaf.bits) <= p->range.hi)
		return n;
	for (size_t i = 0; i < n; i++) {
		uint64_t key = point_morton(at[i].x, at[i].y);

		at[stay] = at[i];
		stay += key >= p->range.lo && key <= p->range.hi;
	}
	return stay;
}

/* Removes the records of omitted sources, in place. */
static int filter_block(struct grid_pass *p, const struct grid_block *b, size_t *ret_n, struct err *err)
{
	unsigned sources = b->head->sources, stay = 0;
	bool stays[GRID_CELL_RECORDS];
	size_t n = 0;

	for (unsigned i = 0; i < sources; i++) {
		p->ids[i] = b->sources[i].id;
		stays[i] = !grid_dropped_has(p->dropped, p->ids[i]);
		stay += stays[i];
	}
	for (size_t i = 0; i < b->head->records; i++) {
		unsigned source = point_source(&b->records[i]);

		if (source >= sources)
			return grid_segment_damaged(&p->segment, p->place - b->bytes, "a record has no source", err);
		if (stay == sources)
			continue;
		b->records[n] = b->records[i];
		n += stays[source];
	}
	*ret_n = filter_keys(p, b->records, stay == sources ? b->head->records : n);
	p->omitted += b->head->records - *ret_n;
	return 0;
}

int grid_pass_next(void *pass, const struct point **ret_pts, size_t *ret_n, const uint32_t **ret_table, struct err *err)
{
	struct grid_pass *p = pass;
	struct grid_block b;
	bool end = false;
	int rc = 0;

	*ret_n = 0;
	while (rc == 0 && !*ret_n) {
		if (!p->begun || p->block == p->leaf.blocks) {
			rc = grid_pass_cell(p, &end, err);
			if (rc || end)
				break;
		}
		rc = read_block(p, &b, err);
		if (rc == 0)
			rc = filter_block(p, &b, ret_n, err);
		*ret_pts = b.records;
		*ret_table = p->ids;
	}
	if (rc == 0 && end && !p->part && (p->points != p->expected || p->cells != p->segment.cells))
		return grid_segment_damaged(&p->segment, 0, "the number of its records differs from its header", err);
	return rc;
}
