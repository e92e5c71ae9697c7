/*
 * Cells of a segment (grid_cell.h).
 *
 * A cell is a maximal aligned Morton range with at most GRID_CELL_RECORDS records: what recursive halving
 * of the whole key space gives that stops at that count. In a sorted stream the cell of the first record
 * that has none yet, key k, follows from two keys alone. Let A(b) be the aligned range of 2^b keys around
 * k. A(b) may not hold the record before: its cell is maximal, so every aligned range that holds more than
 * that cell is too full. So b <= the highest bit in which the previous key differs from k. And A(b) may
 * not hold the record GRID_CELL_RECORDS places further on: b <= the highest bit in which that one's key
 * differs from k. Both conditions are sufficient too, so the cell is A(the smaller of the two).
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

size_t grid_cell_extent(const struct point *pts, size_t n, bool has_prev, uint64_t prev, unsigned *ret_bits)
{
	uint64_t key = point_morton(pts[0].x, pts[0].y);
	unsigned bits = has_prev ? highest_bit(prev ^ key) : 64;

	if (n > GRID_CELL_RECORDS) {
		const struct point *next = &pts[GRID_CELL_RECORDS];
		uint64_t differ = point_morton(next->x, next->y) ^ key;

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

/* Records without sources to `out`; box, distinct positions, sum and classes of them. */
static void survey(const struct point *pts, size_t n, struct point *out, struct grid_block_info *info,
		   uint32_t classes[256])
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
		classes[pts[i].cls]++;
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

/* Tables of several sources: which there are, ascending, their counts and sums; index into every tag. */
static unsigned tabulate(struct point *records, size_t n, const uint32_t *ids, struct disk_source *out)
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
	at = 0;
	for (size_t i = 0; i < n; i++) {
		if (sorted[at] != ids[i]) {
			const uint32_t *hit = bsearch(&ids[i], sorted, count, sizeof *sorted, by_id);

			at = (unsigned)(hit - sorted);
		}
		struct digest h = grid_record_hash(&records[i]);

		out[at].records++;
		out[at].sum_hi += h.hi;
		out[at].sum_lo += h.lo;
		records[i].tag = (uint16_t)(point_flags(&records[i]) | at << POINT_SOURCE_SHIFT);
	}
	return count;
}

void grid_block_make(const struct point *pts, size_t n, const uint32_t *ids, const uint32_t *table,
		     uint64_t place, void *out, struct grid_block_info *ret)
{
	uint32_t counts[256] = {0}, space[GRID_CELL_RECORDS], only;
	struct disk_source sources[GRID_CELL_RECORDS];
	struct point records[GRID_CELL_RECORDS];
	struct disk_block head = {.records = (uint32_t)n, .sources = 1};

	survey(pts, n, records, ret, counts);
	ids = resolve(pts, n, ids, table, space, &only);
	if (ids)
		head.sources = (uint16_t)tabulate(records, n, ids, sources);
	else
		sources[0] = (struct disk_source){only, (uint32_t)n, ret->sum.hi, ret->sum.lo};
	ret->source = ids ? 0 : only;

	uint8_t *at = (uint8_t *)out + sizeof head;

	memcpy(at, sources, head.sources * sizeof *sources);
	at += head.sources * sizeof *sources;
	for (unsigned c = 0; c < 256; c++) {
		if (!counts[c])
			continue;
		struct disk_class entry = {.cls = (uint8_t)c, .records = (uint16_t)counts[c]};

		memcpy(at, &entry, sizeof entry);
		at += sizeof entry;
		head.classes++;
	}
	ret->head_bytes = disk_head_bytes(&head);
	ret->bytes = ret->head_bytes + n * sizeof *records;
	memset(at, 0, (size_t)((uint8_t *)out + ret->head_bytes - at));
	memcpy((uint8_t *)out + ret->head_bytes, records, n * sizeof *records);
	head.records_check = grid_check(records, n * sizeof *records, place);
	memcpy(out, &head, sizeof head);
	head.check = grid_check((uint8_t *)out + 8, ret->head_bytes - 8, place);
	memcpy(out, &head, sizeof head);
	ret->check = head.check;
}

/* ---- reading blocks ---- */

size_t grid_block_head_bytes(const void *bytes)
{
	struct disk_block head;

	memcpy(&head, bytes, sizeof head);
	if (!head.records || head.records > GRID_CELL_RECORDS || !head.sources ||
	    head.sources > GRID_CELL_RECORDS || !head.classes || head.classes > 256)
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
		if (b.bytes > size ||
		    b.head->records_check != grid_check(b.records, b.bytes - b.head_bytes, place))
			return false;
	}
	*ret = b;
	return true;
}
