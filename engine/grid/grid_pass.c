/*
 * A pass over a segment (grid_pass.h): its cells in order, by its index. Blocks lie in that order, so they come through a
 * window that moves forwards; a page of the index lies behind the cells that it lists, and is read on its own. Every byte
 * is checked: pages and heads against whoever points to them, records against their head, all against the header.
 */
#include "grid_pass.h"

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "io.h"

static size_t lines(size_t n)
{
	return (n + 63) & ~(size_t)63;
}

size_t grid_pass_bytes(uint64_t cells, size_t window)
{
	return grid_levels(cells) * (size_t)DISK_PAGE + lines(window) + lines(GRID_CELL_RECORDS * sizeof(uint32_t));
}

static int by_number(const void *a, const void *b)
{
	uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

	return x < y ? -1 : x > y;
}

bool grid_dropped_has(const struct grid_dropped *d, uint32_t id)
{
	return d->n && bsearch(&id, d->ids, d->n, sizeof id, by_number);
}

int grid_pass_open(struct grid_pass *p, int dirfd, const struct grid_segment_info *info, const struct grid_dropped *dropped,
		   void *memory, size_t window, struct disk_total **ret_sources, uint32_t *ret_n, struct err *err)
{
	struct disk_segment h;
	uint8_t *at = memory;

	*p = (struct grid_pass){.part.fd = -1, .dropped = dropped, .cap = window};
	int rc = grid_part_open(&p->part, dirfd, info, &h, err);

	if (rc == 0)
		rc = grid_part_sources(&p->part, &h, ret_sources, err);
	if (rc) {
		grid_pass_close(p);
		return rc;
	}
	*ret_n = h.sources;
	p->expected = h.points;
	p->pages = at;
	at += h.height * (size_t)DISK_PAGE;
	p->window = at;
	p->ids = (uint32_t *)(at + lines(window));
	return 0;
}

void grid_pass_close(struct grid_pass *p)
{
	p->part.fd = io_close(p->part.fd);
}

/* ---- the index ---- */

static uint8_t *page_of(const struct grid_pass *p, unsigned level)
{
	return p->pages + level * (size_t)DISK_PAGE;
}

static int read_page(struct grid_pass *p, unsigned level, uint64_t place, uint64_t check, struct err *err)
{
	uint8_t *page = page_of(p, level);
	const struct disk_page *head = (const struct disk_page *)page;
	int rc = grid_part_read(&p->part, page, DISK_PAGE, place, err);

	if (rc)
		return rc;
	if (head->check != check || check != grid_check(page + 8, DISK_PAGE - 8, place))
		return grid_damaged(&p->part, place, "the checksum of an index page does not agree", err);
	if (head->magic != DISK_PAGE_MAGIC || head->level != level || !head->entries || head->entries > DISK_ENTRIES)
		return grid_damaged(&p->part, place, "an index page is not what it should be", err);
	p->at[level] = 0;
	return 0;
}

/* The lowest level that has an entry left, as many as there are levels: none has. */
static unsigned lowest(const struct grid_pass *p)
{
	unsigned level = 0;

	while (level < p->part.height && p->at[level] == grid_page_entries(page_of(p, level)))
		level++;
	return level;
}

/* The next cell; *ret_end: there is none. */
static int next_cell(struct grid_pass *p, bool *ret_end, struct err *err)
{
	unsigned level, height = p->part.height;
	struct grid_cell ignored;
	int rc = 0;

	*ret_end = false;
	if (!p->begun && height)
		rc = read_page(p, height - 1, p->part.root, p->part.root_check, err);
	level = p->begun ? lowest(p) : height ? height - 1 : 0;
	p->begun = true;
	if (rc == 0 && level == height) {
		*ret_end = true;
		return 0;
	}
	for (; rc == 0 && level > 0; level--) {
		const struct disk_inner *e = grid_page_inner(page_of(p, level), p->at[level]++);

		rc = read_page(p, level - 1, e->place, e->check, err);
	}
	if (rc)
		return rc;
	p->leaf = *grid_page_leaf(page_of(p, 0), p->at[0]++);
	p->block = 0;
	p->place = p->leaf.place;
	p->check = 0;
	return grid_cell_of(&p->part, 0, &p->leaf, &ignored, err);
}

/* ---- blocks ---- */

/* n bytes at a place, in the window; n no more than its size. */
static int bytes_at(struct grid_pass *p, uint64_t place, size_t n, uint8_t **ret, struct err *err)
{
	int rc = 0;

	if (place < p->from || place + n > p->from + p->have) {
		uint64_t left = place < p->part.bytes ? p->part.bytes - place : 0;

		p->have = left < p->cap ? (size_t)left : p->cap;
		p->from = place;
		if (n > p->have)
			return grid_damaged(&p->part, place, "a block is cut off", err);
		rc = grid_part_read(&p->part, p->window, p->have, place, err);
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
		return grid_damaged(&p->part, p->place, "a block has an impossible size", err);
	need += ((const struct disk_block *)bytes)->records * sizeof(struct point);
	rc = bytes_at(p, p->place, need, &bytes, err);
	if (rc)
		return rc;
	if (!grid_block_open(bytes, need, p->place, true, ret))
		return grid_damaged(&p->part, p->place, "the checksum of a block does not agree", err);
	p->check += ret->head->check;
	p->place += ret->bytes;
	if (++p->block == p->leaf.blocks && p->check != p->leaf.check)
		return grid_damaged(&p->part, p->leaf.place, "a cell is not the one that the index means", err);
	p->cells += p->block == p->leaf.blocks;
	p->points += ret->head->records;
	return 0;
}

/* Keep what is of sources that stay, in place. */
static int keep(struct grid_pass *p, const struct grid_block *b, size_t *ret_n, struct err *err)
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
			return grid_damaged(&p->part, p->place - b->bytes, "a record has no source", err);
		if (stay == sources)
			continue;
		b->records[n] = b->records[i];
		n += stays[source];
	}
	*ret_n = stay == sources ? b->head->records : n;
	p->left_out += b->head->records - *ret_n;
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
			rc = next_cell(p, &end, err);
			if (rc || end)
				break;
		}
		rc = read_block(p, &b, err);
		if (rc == 0)
			rc = keep(p, &b, ret_n, err);
		*ret_pts = b.records;
		*ret_table = p->ids;
	}
	if (rc == 0 && end && (p->points != p->expected || p->cells != p->part.cells))
		return grid_damaged(&p->part, 0, "it has not as many records as its header says", err);
	return rc;
}
