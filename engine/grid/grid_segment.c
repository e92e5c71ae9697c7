/*
 * Writing a segment (grid_segment.h). Everything is appended: the blocks of cells, and a page of the index
 * as soon as it is full, so the pages of all levels lie between the blocks. In memory there is one page a
 * level. The header's place at the front is filled in last. What is written depends on the records and
 * their sources only, not on how they arrived.
 */
#include "grid_segment.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_cell.h"

size_t grid_segment_bytes(size_t buffer)
{
	return buffer + GRID_SEGMENT_LEVELS * (size_t)DISK_PAGE;
}

int grid_segment_begin(struct grid_segment *s, int dirfd, const char *name, const uint32_t *ids, uint32_t n,
		       void *memory, size_t buffer, struct err *err)
{
	uint8_t *at = memory, *room;

	assert(buffer >= DISK_BLOCK_MAX && buffer >= DISK_PAGE);
	*s = (struct grid_segment){.file = GRID_FILE_INIT};
	s->totals = calloc(n ? n : 1, sizeof *s->totals);
	if (!s->totals)
		return err_set(err, ERR_NOMEM, "no memory for the totals of %u sources", n);
	s->ntotals = n;
	for (uint32_t i = 0; i < n; i++)
		s->totals[i].id = ids[i];
	for (unsigned i = 0; i < GRID_SEGMENT_LEVELS; i++)
		s->level[i].page = at + buffer + i * (size_t)DISK_PAGE;
	int rc = grid_file_create(&s->file, dirfd, name, at, buffer, err);

	if (rc == 0)
		rc = grid_file_reserve(&s->file, DISK_HEADER, &room, err);
	if (rc) {
		grid_segment_abort(s);
		return rc;
	}
	memset(room, 0, DISK_HEADER);
	grid_file_commit(&s->file, DISK_HEADER);
	return 0;
}

void grid_segment_abort(struct grid_segment *s)
{
	grid_file_abort(&s->file);
	free(s->totals);
	s->totals = NULL;
}

/* ---- index ---- */

static void widen(int32_t box[4], const int32_t by[4])
{
	box[0] = by[0] < box[0] ? by[0] : box[0];
	box[1] = by[1] < box[1] ? by[1] : box[1];
	box[2] = by[2] > box[2] ? by[2] : box[2];
	box[3] = by[3] > box[3] ? by[3] : box[3];
}

/* An entry (`bytes`, worth `sum`) into the page of this level that is being filled. */
static void level_put(struct grid_segment_level *l, const void *bytes, const struct disk_inner *sum)
{
	memcpy(l->page + sizeof(struct disk_page) + l->entries * (size_t)DISK_ENTRY, bytes, DISK_ENTRY);
	if (l->entries++ == 0) {
		l->sum = *sum;
		return;
	}
	l->sum.hi = sum->hi;
	l->sum.count += sum->count;
	l->sum.distinct += sum->distinct;
	l->sum.cells += sum->cells;
	l->sum.sum_hi += sum->sum_hi;
	l->sum.sum_lo += sum->sum_lo;
	widen(l->sum.box, sum->box);
}

/* Write out the page of level i; *ret is the entry for it in the level above. */
static int level_write(struct grid_segment *s, unsigned i, struct disk_inner *ret, struct err *err)
{
	struct grid_segment_level *l = &s->level[i];
	struct disk_page head = {.magic = DISK_PAGE_MAGIC, .level = (uint16_t)i, .entries = l->entries};
	size_t used = sizeof head + l->entries * (size_t)DISK_ENTRY;
	uint64_t place = grid_file_place(&s->file);

	memset(l->page + used, 0, DISK_PAGE - used);
	memcpy(l->page, &head, sizeof head);
	head.check = grid_check(l->page + 8, DISK_PAGE - 8, place);
	memcpy(l->page, &head, sizeof head);
	int rc = grid_file_append(&s->file, l->page, DISK_PAGE, err);

	*ret = l->sum;
	ret->place = place;
	ret->check = head.check;
	l->entries = 0;
	return rc;
}

/* An entry into level i; a full page goes out first, and its entry up. */
static int index_put(struct grid_segment *s, unsigned i, const void *bytes, const struct disk_inner *sum,
		     struct err *err)
{
	struct disk_inner up[GRID_SEGMENT_LEVELS];
	unsigned top = i;

	while (s->level[top].entries == DISK_ENTRIES) {
		int rc = level_write(s, top, &up[top], err);

		if (rc)
			return rc;
		if (++top == GRID_SEGMENT_LEVELS)
			return err_set(err, ERR_LIMIT, "more cells than a segment can have");
	}
	for (; top > i; top--)
		level_put(&s->level[top], &up[top - 1], &up[top - 1]);
	level_put(&s->level[i], bytes, sum);
	return 0;
}

/* All pages that are still being filled, from below; the last one is the root. */
static int index_finish(struct grid_segment *s, struct err *err)
{
	struct disk_inner up;

	if (!s->head.cells)
		return 0;
	for (unsigned i = 0; i < GRID_SEGMENT_LEVELS; i++) {
		bool top = true;
		int rc = level_write(s, i, &up, err);

		for (unsigned k = i + 1; k < GRID_SEGMENT_LEVELS; k++)
			top = top && !s->level[k].entries;
		if (rc)
			return rc;
		if (top) {
			s->head.root = up.place;
			s->head.root_check = up.check;
			s->head.height = i + 1;
			return 0;
		}
		rc = index_put(s, i + 1, &up, &up, err);
		if (rc)
			return rc;
	}
	return err_set(err, ERR_LIMIT, "more cells than a segment can have");
}

/* ---- cells ---- */

static int total_add(struct grid_segment *s, const struct disk_source *source, struct err *err)
{
	uint32_t from = 0, to = s->ntotals;

	while (from < to) {
		uint32_t mid = from + (to - from) / 2;

		if (s->totals[mid].id < source->id)
			from = mid + 1;
		else
			to = mid;
	}
	if (from == s->ntotals || s->totals[from].id != source->id)
		return err_set(err, ERR_INTERNAL, "a record of source %u, which was never announced",
			       source->id);
	s->totals[from].points += source->records;
	s->totals[from].sum_hi += source->sum_hi;
	s->totals[from].sum_lo += source->sum_lo;
	return 0;
}

/* One more block of the open cell. */
static int block_put(struct grid_segment *s, const struct point *pts, const uint32_t *ids,
		     const uint32_t *table, size_t n, struct err *err)
{
	struct grid_block_info info;
	struct grid_block block;
	struct disk_leaf *c = &s->cell;
	uint64_t place;
	uint8_t *room;
	int rc = grid_file_reserve(&s->file, DISK_BLOCK_MAX, &room, err);

	if (rc)
		return rc;
	place = grid_file_place(&s->file);
	grid_block_make(pts, n, ids, table, place, room, &info);
	grid_file_commit(&s->file, info.bytes);
	block.head = (const struct disk_block *)room;
	block.sources = (const struct disk_source *)(room + sizeof *block.head);
	block.classes = (const struct disk_class *)(block.sources + block.head->sources);
	for (unsigned i = 0; i < block.head->classes; i++)
		s->head.classes[block.classes[i].cls] += block.classes[i].records;
	for (unsigned i = 0; rc == 0 && i < block.head->sources; i++)
		rc = total_add(s, &block.sources[i], err);

	if (!c->blocks) {
		c->place = place;
		c->head_bytes = (uint32_t)info.head_bytes;
		c->source = info.source;
		memcpy(c->box, info.box, sizeof c->box);
		c->distinct = (uint16_t)info.distinct; /* further blocks are of the same position */
	} else if (c->source != info.source) {
		c->source = 0;
	}
	c->blocks++;
	c->bytes += info.bytes;
	c->count += n;
	c->check += info.check;
	c->sum_hi += info.sum.hi;
	c->sum_lo += info.sum.lo;
	s->has_prev = true;
	s->prev = point_morton(pts[n - 1].x, pts[n - 1].y);
	return rc;
}

static void cell_begin(struct grid_segment *s, const struct point *first, unsigned bits)
{
	uint64_t key = point_morton(first->x, first->y);

	s->cell = (struct disk_leaf){.lo = bits >= 64 ? 0 : key >> bits << bits, .bits = (uint8_t)bits};
	s->cell_open = true;
}

static int cell_end(struct grid_segment *s, struct err *err)
{
	const struct disk_leaf *c = &s->cell;
	struct disk_inner sum = {
	    .lo = c->lo,
	    .hi = disk_range_end(c->lo, c->bits),
	    .count = c->count,
	    .distinct = c->distinct,
	    .cells = 1,
	    .sum_hi = c->sum_hi,
	    .sum_lo = c->sum_lo,
	};

	memcpy(sum.box, c->box, sizeof sum.box);
	s->cell_open = false;
	if (s->head.cells++ == 0)
		memcpy(s->head.box, c->box, sizeof s->head.box);
	widen(s->head.box, c->box);
	s->head.points += c->count;
	s->head.sum_hi += c->sum_hi;
	s->head.sum_lo += c->sum_lo;
	return index_put(s, 0, c, &sum, err);
}

/* The next block of a cell that is one position, or its end. How many of pts were taken. */
static int long_cell(struct grid_segment *s, const struct point *pts, const uint32_t *ids,
		     const uint32_t *table, size_t n, size_t *ret_taken, struct err *err)
{
	size_t most = n < GRID_CELL_RECORDS ? n : GRID_CELL_RECORDS, take = 0;
	uint64_t key = s->cell.lo;

	while (take < most && point_morton(pts[take].x, pts[take].y) == key)
		take++;
	*ret_taken = take;
	int rc = take ? block_put(s, pts, ids, table, take, err) : 0;

	return rc || take == GRID_CELL_RECORDS ? rc : cell_end(s, err);
}

int grid_segment_add(struct grid_segment *s, const struct point *pts, const uint32_t *ids,
		     const uint32_t *table, size_t n, bool end, size_t *ret_taken, struct err *err)
{
	size_t at = 0, take;
	unsigned bits;
	int rc = 0;

	while (rc == 0 && (n - at > GRID_CELL_RECORDS || (end && at < n))) {
		const uint32_t *at_ids = ids ? ids + at : NULL;

		if (s->cell_open) {
			rc = long_cell(s, pts + at, at_ids, table, n - at, &take, err);
			at += take;
			continue;
		}
		take = grid_cell_extent(pts + at, n - at, s->has_prev, s->prev, &bits);
		cell_begin(s, pts + at, bits);
		if (!take)
			continue;
		rc = block_put(s, pts + at, at_ids, table, take, err);
		if (rc == 0)
			rc = cell_end(s, err);
		at += take;
	}
	if (rc == 0 && end && s->cell_open)
		rc = cell_end(s, err);
	*ret_taken = at;
	return rc;
}

/* ---- the end ---- */

static void describe(const struct grid_segment *s, struct grid_segment_info *ret)
{
	const struct disk_segment *h = &s->head;

	*ret = (struct grid_segment_info){
	    .points = h->points, .cells = h->cells, .bytes = h->bytes, .sum = {h->sum_hi, h->sum_lo}};
	memcpy(ret->file, s->file.name, sizeof s->file.name);
	memcpy(ret->box, h->box, sizeof ret->box);
	memcpy(ret->classes, h->classes, sizeof ret->classes);
}

int grid_segment_finish(struct grid_segment *s, struct grid_segment_info *ret, struct err *err)
{
	struct disk_segment *h = &s->head;
	uint32_t sources = 0;
	int rc = index_finish(s, err);

	if (rc)
		return rc;
	for (uint32_t i = 0; i < s->ntotals; i++)
		if (s->totals[i].points)
			s->totals[sources++] = s->totals[i];
	h->sources = sources;
	h->sources_place = grid_file_place(&s->file);
	h->sources_check = grid_check(s->totals, sources * sizeof *s->totals, h->sources_place);
	rc = grid_file_append(&s->file, s->totals, sources * sizeof *s->totals, err);
	if (rc)
		return rc;
	memcpy(h->magic, DISK_SEGMENT_MAGIC, sizeof h->magic);
	h->version = DISK_VERSION;
	h->header_bytes = DISK_HEADER;
	h->page_bytes = DISK_PAGE;
	h->cell_records = GRID_CELL_RECORDS;
	h->bytes = grid_file_place(&s->file);
	h->check = grid_check((uint8_t *)h + 8, DISK_HEADER - 8, 0);
	rc = grid_file_patch(&s->file, 0, h, DISK_HEADER, err);
	if (rc == 0)
		rc = grid_file_publish(&s->file, true, err);
	if (rc)
		return rc;
	describe(s, ret);
	free(s->totals);
	s->totals = NULL;
	return 0;
}
