/*
 * Cells of a segment (grid_cell.h).
 *
 * A cell is a maximal aligned Morton range with at most GRID_CELL_RECORDS records: what recursive halving
 * of the whole key space gives that stops at that count. In a sorted stream the cell of the first record
 * that has none yet, key k, follows from two keys alone. Let A(b) be the aligned range of 2^b keys around
 * k. A(b) may not hold the record before: its cell is maximal, so every aligned range that holds more than
 * that cell is too full. So b <= the highest bit in which the previous key differs from k. And A(b) may
 * not hold the record GRID_CELL_RECORDS places further on: b <= the highest bit in which that one's key
 * differs from k. Both conditions are sufficient too, so the cell is A(the smaller of the two). Instead of the
 * previous record's key any key between it and the cell does, if it is known to be in no cell with k: A(b) holds
 * it wherever A(b) holds the record.
 */
#include "grid_cell.h"

#include <stdlib.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

static inline unsigned highest_bit(uint64_t v)
{
	return 63u - (unsigned)__builtin_clzll(v);
}

size_t grid_cell_extent(const struct point *pts, size_t n, const uint64_t *prev, const uint64_t *next, unsigned *ret_bits)
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

struct digest grid_record_hash(const struct point *p)
{
	struct point bare = *p;

	bare.tag &= POINT_FLAGS;
	XXH128_hash_t h = XXH3_128bits(&bare, sizeof bare);

	return (struct digest){h.high64, h.low64};
}

uint64_t grid_check(const void *bytes, size_t n, uint64_t seed)
{
	return XXH3_64bits_withSeed(bytes, n, seed);
}

/* ---- making blocks ---- */

static unsigned count_classes(const struct point *pts, size_t n, uint32_t counts[256])
{
	unsigned classes = 0;

	for (size_t i = 0; i < n; i++)
		classes += counts[pts[i].cls]++ == 0;
	return classes;
}

/* Records without sources to `out`; box, distinct positions and sum of them. */
static void survey(const struct point *pts, size_t n, struct point *out, struct grid_block_info *info)
{
	int32_t x0 = pts[0].x, x1 = x0, y0 = pts[0].y, y1 = y0;
	uint32_t distinct = 1;
	struct digest sum = {0, 0};

	for (size_t i = 0; i < n; i++) {
		out[i] = pts[i];
		out[i].tag &= POINT_FLAGS;
		XXH128_hash_t h = XXH3_128bits(&out[i], sizeof out[i]);

		sum.hi += h.high64;
		sum.lo += h.low64;
	}
	for (size_t i = 1; i < n; i++) {
		x0 = pts[i].x < x0 ? pts[i].x : x0;
		x1 = pts[i].x > x1 ? pts[i].x : x1;
		y0 = pts[i].y < y0 ? pts[i].y : y0;
		y1 = pts[i].y > y1 ? pts[i].y : y1;
		distinct += (pts[i].x != pts[i - 1].x) | (pts[i].y != pts[i - 1].y);
	}
	info->box[0] = x0;
	info->box[1] = y0;
	info->box[2] = x1;
	info->box[3] = y1;
	info->distinct = distinct;
	info->sum = sum;
}

/* The ids of the records, or NULL and the one they all have. */
static const uint32_t *resolve(const struct point *pts, size_t n, const uint32_t *ids, const uint32_t *table,
			       uint32_t space[GRID_CELL_RECORDS], uint32_t *ret_only)
{
	uint32_t differ = 0;

	if (!ids) {
		for (size_t i = 0; i < n; i++)
			space[i] = table[point_source(&pts[i])];
		ids = space;
	}
	for (size_t i = 1; i < n; i++)
		differ |= ids[i] ^ ids[0];
	*ret_only = n ? ids[0] : 0;
	return differ ? ids : NULL;
}

static int by_id(const void *a, const void *b)
{
	uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

	return x < y ? -1 : x > y;
}

/* Which sources there are, ascending. */
static unsigned tabulate_ids(const uint32_t *ids, size_t n, struct disk_source *out)
{
	uint32_t sorted[GRID_CELL_RECORDS];
	unsigned count = 0, at = 0;

	/* Sources come in long stretches or hardly at all: taking out repeats first keeps the sort short. */
	for (size_t i = 0; i < n; i++)
		if (!i || ids[i] != ids[i - 1])
			sorted[count++] = ids[i];
	qsort(sorted, count, sizeof *sorted, by_id);
	for (unsigned i = 1; i < count; i++)
		if (sorted[i] != sorted[at])
			sorted[++at] = sorted[i];
	count = at + 1;
	for (unsigned i = 0; i < count; i++)
		out[i] = (struct disk_source){.id = sorted[i]};
	return count;
}

static int by_source(const void *key, const void *source)
{
	return by_id(key, &((const struct disk_source *)source)->id);
}

/* Their counts and sums, and the index into every tag. */
static void tabulate(struct point *records, size_t n, const uint32_t *ids, struct disk_source *out, unsigned count)
{
	struct disk_source *at = out;

	for (size_t i = 0; i < n; i++) {
		if (at->id != ids[i])
			at = bsearch(&ids[i], out, count, sizeof *out, by_source);
		struct digest h = grid_record_hash(&records[i]);

		at->records++;
		at->sum_hi += h.hi;
		at->sum_lo += h.lo;
		records[i].tag = (uint16_t)(point_flags(&records[i]) | (unsigned)(at - out) << POINT_SOURCE_SHIFT);
	}
}

void grid_block_make(const struct point *pts, size_t n, const uint32_t *ids, const uint32_t *table, void *out,
		     struct grid_block_info *ret)
{
	uint32_t counts[256] = {0}, space[GRID_CELL_RECORDS], only;
	struct disk_source sources[GRID_CELL_RECORDS];
	struct disk_block head = {.records = (uint32_t)n, .sources = 1};

	ids = resolve(pts, n, ids, table, space, &only);
	/* Its head's size depends on sources and classes, which are few, or found without the records' place. */
	head.classes = (uint16_t)count_classes(pts, n, counts);
	if (ids)
		head.sources = (uint16_t)tabulate_ids(ids, n, sources);
	ret->head_bytes = disk_head_bytes(&head);
	ret->bytes = ret->head_bytes + n * sizeof(struct point);

	struct point *records = (struct point *)((uint8_t *)out + ret->head_bytes);

	survey(pts, n, records, ret);
	if (ids)
		tabulate(records, n, ids, sources, head.sources);
	else
		sources[0] = (struct disk_source){only, (uint32_t)n, ret->sum.hi, ret->sum.lo};
	ret->source = ids ? 0 : only;

	uint8_t *at = (uint8_t *)out + sizeof head;

	memcpy(at, sources, head.sources * sizeof *sources);
	at += head.sources * sizeof *sources;
	for (unsigned c = 0, left = head.classes; left; c++) {
		if (!counts[c])
			continue;
		struct disk_class entry = {.cls = (uint8_t)c, .records = (uint16_t)counts[c]};

		memcpy(at, &entry, sizeof entry);
		at += sizeof entry;
		left--;
	}
	memset(at, 0, (size_t)((uint8_t *)out + ret->head_bytes - at));
	memcpy(out, &head, sizeof head);
}

uint64_t grid_block_place(void *block, uint64_t place)
{
	struct disk_block head;

	memcpy(&head, block, sizeof head);
	size_t bytes = disk_head_bytes(&head);

	head.records_check = grid_check((uint8_t *)block + bytes, head.records * sizeof(struct point), place);
	memcpy(block, &head, sizeof head);
	head.check = grid_check((uint8_t *)block + 8, bytes - 8, place);
	memcpy(block, &head, sizeof head);
	return head.check;
}

/* ---- reading blocks ---- */

size_t grid_block_head_bytes(const void *bytes)
{
	struct disk_block head;

	memcpy(&head, bytes, sizeof head);
	if (!head.records || head.records > GRID_CELL_RECORDS || !head.sources || head.sources > GRID_CELL_RECORDS ||
	    !head.classes || head.classes > 256)
		return 0;
	return disk_head_bytes(&head);
}

/* What a checksum cannot vouch for when the writer was wrong: that the tables fit the records. */
static bool tables_agree(const struct grid_block *b)
{
	uint32_t records = 0;

	for (unsigned i = 0; i < b->head->sources; i++) {
		records += b->sources[i].records;
		if (i && b->sources[i].id <= b->sources[i - 1].id)
			return false;
	}
	return records == b->head->records;
}

bool grid_block_open(void *bytes, size_t size, uint64_t place, bool whole, struct grid_block *ret)
{
	uint8_t *at = bytes;
	struct grid_block b = {.head = bytes};

	if (size < sizeof *b.head)
		return false;
	b.head_bytes = grid_block_head_bytes(bytes);
	if (!b.head_bytes || b.head_bytes > size)
		return false;
	if (b.head->check != grid_check(at + 8, b.head_bytes - 8, place))
		return false;
	b.bytes = b.head_bytes + b.head->records * sizeof(struct point);
	b.sources = (const struct disk_source *)(at + sizeof *b.head);
	b.classes = (const struct disk_class *)(b.sources + b.head->sources);
	if (!tables_agree(&b))
		return false;
	if (whole) {
		b.records = (struct point *)(at + b.head_bytes);
		if (b.bytes > size || b.head->records_check != grid_check(b.records, b.bytes - b.head_bytes, place))
			return false;
	}
	*ret = b;
	return true;
}
