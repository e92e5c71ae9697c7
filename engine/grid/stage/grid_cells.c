/*
 * Cells (grid_cells.h). Except for the checksums, a block does not depend on its place in the file. So several threads
 * can make the cells of different intervals of keys, and assign places later in order. Each interval must begin and end
 * at a border of cells.
 *
 * A cell is a maximal aligned Morton range with at most GRID_CELL_RECORDS records: the result of halving the key space
 * recursively until a part has no more than that. In a sorted stream the cell of the next record, with key k, follows
 * from two keys. Let A(b) be the aligned range of 2^b keys around k.
 * - A(b) must not contain the previous record: the cell of that record is maximal, so every larger aligned range has too
 *   many records. So b <= the highest bit in which the previous key differs from k.
 * - A(b) must not contain the record GRID_CELL_RECORDS places further on. So b <= the highest bit in which its key
 *   differs from k.
 * Both conditions together are sufficient, so the cell is A(b) for the smaller bound. Instead of the previous record's
 * key, any key between that record and the cell will do if no cell contains it together with k: A(b) contains it
 * whenever A(b) contains the record.
 */
#include "grid_cells.h"

#include "err.h"
#include "io.h"

static inline unsigned highest_bit(uint64_t v)
{
	return 63u - (unsigned)__builtin_clzll(v);
}

/*
 * Returns how many records the cell has that begins with pts[0], and the size of its range, 2^*ret_bits keys. 0: it is a
 * single position with more than GRID_CELL_RECORDS records. `n`: sorted records that are known, all up to the end if
 * n <= GRID_CELL_RECORDS. `prev`: a key before the cell as described above; NULL if there is no record before. `next`:
 * a key after the last record that is in another cell, or NULL.
 */
static size_t cell_extent(const struct point *pts, size_t n, const uint64_t *prev, const uint64_t *next, unsigned *ret_bits)
{
	uint64_t key = point_morton(pts[0].x, pts[0].y);
	unsigned bits = prev ? highest_bit(*prev ^ key) : 64;

	if (next && highest_bit(*next ^ key) < bits)
		bits = highest_bit(*next ^ key);

	if (n > GRID_CELL_RECORDS) {
		const struct point *beyond = &pts[GRID_CELL_RECORDS];
		uint64_t differ = point_morton(beyond->x, beyond->y) ^ key;

		if (!differ) {
			*ret_bits = 0;
			return 0;
		}
		if (highest_bit(differ) < bits)
			bits = highest_bit(differ);
	}
	*ret_bits = bits;

	uint64_t lo = bits >= 64 ? 0 : key >> bits << bits, hi = disk_range_end(lo, bits);
	size_t from = 1, to = n > GRID_CELL_RECORDS ? GRID_CELL_RECORDS : n;

	while (from < to) { /* the first record after `hi` */
		size_t mid = from + (to - from) / 2;

		if (point_morton(pts[mid].x, pts[mid].y) <= hi)
			from = mid + 1;
		else
			to = mid;
	}
	return from;
}

size_t grid_cells_min_bytes(void)
{
	return 2 * (DISK_BLOCK_MAX + sizeof(struct grid_new_block));
}

void grid_cells_begin(struct grid_cells *c, void *memory, size_t size, uint64_t lo, uint64_t hi)
{
	*c = (struct grid_cells){.memory = memory, .size = size & ~(size_t)(DISK_ALIGN - 1)};
	c->before = lo - 1;
	c->behind = hi + 1;
	c->prev = lo ? &c->before : NULL;
	c->next = hi < UINT64_MAX ? &c->behind : NULL;
}

struct grid_new_block *grid_cells_block(const struct grid_cells *c, size_t i)
{
	return (struct grid_new_block *)(c->memory + c->size) - 1 - i;
}

static bool has_room(const struct grid_cells *c)
{
	return c->size - c->used >= DISK_BLOCK_MAX + (c->n + 1) * sizeof(struct grid_new_block);
}

static struct grid_new_block *add_block(struct grid_cells *c, const struct point *pts, const uint32_t *ids, const uint32_t *table,
					size_t n, unsigned bits)
{
	struct grid_new_block *b = grid_cells_block(c, c->n++);
	uint64_t key = point_morton(pts->x, pts->y);

	*b = (struct grid_new_block){.lo = bits >= 64 ? 0 : key >> bits << bits,
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

/* Makes the next block of a cell that is a single position. */
static void add_long_cell(struct grid_cells *c, const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n,
			  bool first, size_t *ret_taken)
{
	uint64_t key = first ? point_morton(pts->x, pts->y) : c->last;
	size_t most = n < GRID_CELL_RECORDS ? n : GRID_CELL_RECORDS, take = 0;

	while (take < most && point_morton(pts[take].x, pts[take].y) == key)
		take++;
	*ret_taken = take;
	struct grid_new_block *b = add_block(c, pts, ids, table, take, 0);

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
		if (!has_room(c))
			return false;
		if (c->open) {
			add_long_cell(c, pts + at, at_ids, table, n - at, false, &take);
		} else {
			take = cell_extent(pts + at, n - at, c->prev, c->next, &bits);
			if (take)
				add_block(c, pts + at, at_ids, table, take, bits);
			else
				add_long_cell(c, pts + at, at_ids, table, n - at, true, &take);
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
		const struct grid_new_block *first = grid_cells_block(c, i), *b = first;
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
