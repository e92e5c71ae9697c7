/*
 * Cells in the making (grid_cells.h). All that costs time, but the checksums, does not depend on where a block will
 * lie: stretches of the key space are made into cells side by side, and get their places one after the other. A
 * stretch must begin and end at a border of cells.
 */
#include "grid_cells.h"

#include "err.h"
#include "io.h"

size_t grid_cells_least(void)
{
	return 2 * (DISK_BLOCK_MAX + sizeof(struct grid_made));
}

void grid_cells_begin(struct grid_cells *c, void *memory, size_t size, uint64_t lo, uint64_t hi)
{
	*c = (struct grid_cells){.memory = memory, .size = size & ~(size_t)(DISK_ALIGN - 1)};
	c->before = lo - 1;
	c->behind = hi + 1;
	c->prev = lo ? &c->before : NULL;
	c->next = hi < UINT64_MAX ? &c->behind : NULL;
}

struct grid_made *grid_cells_block(const struct grid_cells *c, size_t i)
{
	return (struct grid_made *)(c->memory + c->size) - 1 - i;
}

static bool room(const struct grid_cells *c)
{
	return c->size - c->used >= DISK_BLOCK_MAX + (c->n + 1) * sizeof(struct grid_made);
}

static struct grid_made *put(struct grid_cells *c, const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n,
			     unsigned bits)
{
	struct grid_made *b = grid_cells_block(c, c->n++);
	uint64_t key = point_morton(pts->x, pts->y);

	*b = (struct grid_made){.lo = bits >= 64 ? 0 : key >> bits << bits,
				.offset = c->used,
				.records = (uint32_t)n,
				.bits = (uint8_t)bits,
				.first = true,
				.last = true};
	grid_block_make(pts, n, ids, table, c->memory + c->used, &b->info);
	c->used += b->info.bytes;
	c->last = point_morton(pts[n - 1].x, pts[n - 1].y);
	c->prev = &c->last;
	return b;
}

/* The next block of a cell that is one position. */
static void long_cell(struct grid_cells *c, const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n,
		      bool first, size_t *ret_taken)
{
	uint64_t key = first ? point_morton(pts->x, pts->y) : c->last;
	size_t most = n < GRID_CELL_RECORDS ? n : GRID_CELL_RECORDS, take = 0;

	while (take < most && point_morton(pts[take].x, pts[take].y) == key)
		take++;
	*ret_taken = take;
	struct grid_made *b = put(c, pts, ids, table, take, 0);

	b->first = first;
	b->last = take == n || point_morton(pts[take].x, pts[take].y) != key;
	c->open = !b->last;
}

bool grid_cells_add(struct grid_cells *c, const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n, bool end,
		    size_t *ret_taken)
{
	size_t at = 0, take;
	unsigned bits;

	while (n - at > GRID_CELL_RECORDS || (end && at < n)) {
		const uint32_t *at_ids = ids ? ids + at : NULL;

		*ret_taken = at;
		if (!room(c))
			return false;
		if (c->open) {
			long_cell(c, pts + at, at_ids, table, n - at, false, &take);
		} else {
			take = grid_cell_extent(pts + at, n - at, c->prev, c->next, &bits);
			if (take)
				put(c, pts + at, at_ids, table, take, bits);
			else
				long_cell(c, pts + at, at_ids, table, n - at, true, &take);
		}
		at += take;
	}
	*ret_taken = at;
	return true;
}

int grid_cells_write(struct grid_cells *c, int fd, const char *name, struct err *err)
{
	int rc = 0;

	for (size_t i = 0, k; rc == 0 && i < c->n; i = k) {
		const struct grid_made *first = grid_cells_block(c, i), *b = first;
		size_t bytes = 0;

		for (k = i; k < c->n; k++, bytes += b->info.bytes) {
			b = grid_cells_block(c, k);
			if (b->place != first->place + bytes)
				break;
		}
		rc = io_write_at(fd, c->memory + first->offset, bytes, first->place, name, err);
	}
	c->n = c->used = 0;
	return rc;
}
