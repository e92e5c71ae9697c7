/*
 * Blocks (grid_block.h): the records of a cell as bytes, with tables of their classes and sources in front. Everything
 * but the checksums is independent of the block's place in the file.
 */
#include "grid_block.h"

#include <stdlib.h>
#include <string.h>

#include "order.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

/* The record without its source. As two words: a tag that was stored by itself would stall the load of its word by the hash. */
static inline struct point bare_point(const struct point *p)
{
	struct point bare;
	uint64_t word[2];

	memcpy(word, p, sizeof word);
	word[1] &= UINT64_MAX >> 16 | (uint64_t)POINT_FLAGS << 48;
	memcpy(&bare, word, sizeof bare);
	return bare;
}

struct digest grid_record_hash(const struct point *p)
{
	struct point bare = bare_point(p);
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

/* Copies the records without their sources to `out`; computes their box, distinct positions and sum. */
static void copy_records(const struct point *pts, size_t n, struct point *out, struct grid_block_info *info)
{
	int32_t x0 = pts[0].x, x1 = x0, y0 = pts[0].y, y1 = y0;
	uint32_t distinct = 1;
	struct digest sum = {0, 0};

	for (size_t i = 0; i < n; i++) {
		struct point bare = bare_point(&pts[i]);
		XXH128_hash_t h = XXH3_128bits(&bare, sizeof bare);

		out[i] = bare;
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

/* The sources of the records, or NULL and their common source in *ret_only. */
static const uint32_t *resolve_sources(const struct point *pts, size_t n, const uint32_t *ids, const uint32_t *table,
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

/* Lists the distinct sources, ascending. */
static unsigned list_sources(const uint32_t *ids, size_t n, struct disk_source *out)
{
	uint32_t sorted[GRID_CELL_RECORDS];
	unsigned count = 0, at = 0;

	/* Neighbours usually have the same source: removing repeats first keeps the sort short. */
	for (size_t i = 0; i < n; i++)
		if (!i || ids[i] != ids[i - 1])
			sorted[count++] = ids[i];
	qsort(sorted, count, sizeof *sorted, order_u32);
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
	return order_u32(key, &((const struct disk_source *)source)->id);
}

/* Sets the counts and sums of the sources, and the source index in every tag. */
static void assign_sources(struct point *records, size_t n, const uint32_t *ids, struct disk_source *out, unsigned count)
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

	ids = resolve_sources(pts, n, ids, table, space, &only);
	/* The size of the head, which decides where the records go, depends only on these counts. */
	head.classes = (uint16_t)count_classes(pts, n, counts);
	if (ids)
		head.sources = (uint16_t)list_sources(ids, n, sources);
	ret->head_bytes = disk_head_bytes(&head);
	ret->bytes = ret->head_bytes + n * sizeof(struct point);

	struct point *records = (struct point *)((uint8_t *)out + ret->head_bytes);

	copy_records(pts, n, records, ret);
	if (ids)
		assign_sources(records, n, ids, sources, head.sources);
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

/* Whether the table of sources is ascending and adds up: a checksum does not protect against a faulty writer. */
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
