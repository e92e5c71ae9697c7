/*
 * Writing a segment (grid_segment_writer.h). The file grows at its end: blocks of cells, and each index page as soon as it
 * is full, so pages of all levels are among the blocks. Memory holds one page for each level. The header at the front is
 * written last. The bytes depend only on the records and their sources, not on the order in which they came or on the
 * threads that made the cells.
 */
#include "grid_segment_writer.h"

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_block.h"
#include "grid_segment.h"
#include "io.h"

size_t grid_segment_writer_bytes(void)
{
	return GRID_SEGMENT_WRITER_LEVELS * (size_t)DISK_PAGE;
}

int grid_segment_writer_begin(struct grid_segment_writer *s, int dirfd, const char *name, const uint32_t *ids, uint32_t n,
			      void *memory, struct err *err)
{
	*s = (struct grid_segment_writer){.file = GRID_FILE_INIT, .at = DISK_HEADER};
	s->totals = calloc(n ? n : 1, sizeof *s->totals);
	if (!s->totals)
		return err_set(err, ERR_NOMEM, "no memory for the totals of %u sources", n);
	s->ntotals = n;
	for (uint32_t i = 0; i < n; i++)
		s->totals[i].id = ids[i];
	for (unsigned i = 0; i < GRID_SEGMENT_WRITER_LEVELS; i++)
		s->level[i].page = (uint8_t *)memory + i * (size_t)DISK_PAGE;
	int rc = grid_file_create(&s->file, dirfd, name, NULL, 0, err);

	if (rc)
		grid_segment_writer_abort(s);
	return rc;
}

void grid_segment_writer_abort(struct grid_segment_writer *s)
{
	grid_file_abort(&s->file);
	free(s->totals);
	s->totals = NULL;
}

/* ---- index ---- */

/* Adds an entry to the page of this level that is being filled. `sum`: its totals. */
static void level_put(struct grid_segment_writer_level *l, const void *bytes, const struct disk_inner *sum)
{
	memcpy(l->page + sizeof(struct disk_page) + l->entries * (size_t)DISK_ENTRY, bytes, DISK_ENTRY);
	if (l->entries++ == 0)
		l->sum = *sum;
	else
		grid_inner_add(&l->sum, sum);
}

/* Writes the page of level i; *ret is its entry in the level above. */
static int level_write(struct grid_segment_writer *s, unsigned i, struct disk_inner *ret, struct err *err)
{
	struct grid_segment_writer_level *l = &s->level[i];
	struct disk_page head = {.magic = DISK_PAGE_MAGIC, .level = (uint16_t)i, .entries = l->entries};
	size_t used = sizeof head + l->entries * (size_t)DISK_ENTRY;
	uint64_t place = s->at;

	memset(l->page + used, 0, DISK_PAGE - used);
	memcpy(l->page, &head, sizeof head);
	head.check = grid_check(l->page + 8, DISK_PAGE - 8, place);
	memcpy(l->page, &head, sizeof head);
	int rc = io_write_at(s->file.fd, l->page, DISK_PAGE, place, s->file.temp, err);

	s->at += DISK_PAGE;
	*ret = l->sum;
	ret->place = place;
	ret->check = head.check;
	l->entries = 0;
	return rc;
}

/* Adds an entry to level i. A full page is written first, and its entry is added to the level above. */
static int index_put(struct grid_segment_writer *s, unsigned i, const void *bytes, const struct disk_inner *sum, struct err *err)
{
	struct disk_inner up[GRID_SEGMENT_WRITER_LEVELS];
	unsigned top = i;

	while (s->level[top].entries == DISK_ENTRIES) {
		int rc = level_write(s, top, &up[top], err);

		if (rc)
			return rc;
		if (++top == GRID_SEGMENT_WRITER_LEVELS)
			return err_set(err, ERR_LIMIT, "more cells than a segment can have");
	}
	for (; top > i; top--)
		level_put(&s->level[top], &up[top - 1], &up[top - 1]);
	level_put(&s->level[i], bytes, sum);
	return 0;
}

/* Writes the pages that are not full, from below; the last one is the root. */
static int index_finish(struct grid_segment_writer *s, struct err *err)
{
	struct disk_inner up;

	if (!s->head.cells)
		return 0;
	for (unsigned i = 0; i < GRID_SEGMENT_WRITER_LEVELS; i++) {
		bool top = true;
		int rc = level_write(s, i, &up, err);

		for (unsigned k = i + 1; k < GRID_SEGMENT_WRITER_LEVELS; k++)
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

static int total_add(struct grid_segment_writer *s, const struct disk_source *source, struct err *err)
{
	uint32_t from = 0, to = s->ntotals;

	if (s->total < to && s->totals[s->total].id == source->id)
		from = to = s->total;
	while (from < to) {
		uint32_t mid = from + (to - from) / 2;

		if (s->totals[mid].id < source->id)
			from = mid + 1;
		else
			to = mid;
	}
	if (from == s->ntotals || s->totals[from].id != source->id)
		return err_set(err, ERR_INTERNAL, "a record of source %u, which was not added", source->id);
	s->total = from;
	s->totals[from].points += source->records;
	s->totals[from].sum_hi += source->sum_hi;
	s->totals[from].sum_lo += source->sum_lo;
	return 0;
}

/* Adds a block to the totals of the header and of the table of sources. */
static int count_block(struct grid_segment_writer *s, const uint8_t *bytes, struct err *err)
{
	const struct disk_block *head = (const struct disk_block *)bytes;
	const struct disk_source *sources = (const struct disk_source *)(head + 1);
	const struct disk_class *classes = (const struct disk_class *)(sources + head->sources);
	int rc = 0;

	for (unsigned i = 0; i < head->classes; i++)
		s->head.classes[classes[i].cls] += classes[i].records;
	for (unsigned i = 0; rc == 0 && i < head->sources; i++)
		rc = total_add(s, &sources[i], err);
	return rc;
}

/* Blocks come in the order of keys. */
static void note_keys(struct grid_segment_writer *s, const uint8_t *bytes, const struct grid_new_block *b)
{
	const struct point *pts = (const struct point *)(bytes + b->info.head_bytes), *last = &pts[b->records - 1];

	if (!s->head.cells && b->first)
		s->first_key = point_morton(pts->x, pts->y);
	s->last_key = point_morton(last->x, last->y);
}

/* Adds a block to the current cell, or begins one. */
static int block_put(struct grid_segment_writer *s, struct grid_new_block *b, uint8_t *bytes, struct err *err)
{
	struct disk_leaf *c = &s->cell;

	if (b->first) {
		*c = (struct disk_leaf){.lo = b->lo,
					.bits = b->bits,
					.place = s->at,
					.head_bytes = (uint32_t)b->info.head_bytes,
					.source = b->info.source,
					.distinct = (uint16_t)b->info.distinct};
		memcpy(c->box, b->info.box, sizeof c->box); /* further blocks have the same position */
	} else if (c->source != b->info.source) {
		c->source = 0;
	}
	note_keys(s, bytes, b);
	b->place = s->at;
	s->at += b->info.bytes;
	c->blocks++;
	c->bytes += b->info.bytes;
	c->count += b->records;
	c->check += grid_block_place(bytes, b->place);
	c->sum_hi += b->info.sum.hi;
	c->sum_lo += b->info.sum.lo;
	return count_block(s, bytes, err);
}

static int cell_end(struct grid_segment_writer *s, struct err *err)
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
	if (s->head.cells++ == 0)
		memcpy(s->head.box, c->box, sizeof s->head.box);
	point_box_join(s->head.box, c->box);
	s->head.points += c->count;
	s->head.sum_hi += c->sum_hi;
	s->head.sum_lo += c->sum_lo;
	return index_put(s, 0, c, &sum, err);
}

int grid_segment_writer_put(struct grid_segment_writer *s, struct grid_cells *cells, struct err *err)
{
	int rc = 0;

	for (size_t i = 0; rc == 0 && i < cells->n; i++) {
		struct grid_new_block *b = grid_cells_block(cells, i);

		rc = block_put(s, b, cells->memory + b->offset, err);
		if (rc == 0 && b->last)
			rc = cell_end(s, err);
	}
	return rc;
}

/* ---- the end ---- */

static void describe(const struct grid_segment_writer *s, struct grid_segment_info *ret)
{
	const struct disk_segment *h = &s->head;

	*ret = (struct grid_segment_info){.points = h->points,
					  .cells = h->cells,
					  .bytes = h->bytes,
					  .sum = {h->sum_hi, h->sum_lo},
					  .lo = s->first_key,
					  .hi = s->last_key};
	memcpy(ret->file, s->file.name, sizeof s->file.name);
	memcpy(ret->box, h->box, sizeof ret->box);
	memcpy(ret->classes, h->classes, sizeof ret->classes);
}

int grid_segment_writer_finish(struct grid_segment_writer *s, enum grid_durability durable, struct grid_segment_info *ret,
			       struct err *err)
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
	h->sources_place = s->at;
	h->sources_check = grid_check(s->totals, sources * sizeof *s->totals, h->sources_place);
	rc = io_write_at(s->file.fd, s->totals, sources * sizeof *s->totals, s->at, s->file.temp, err);
	if (rc)
		return rc;
	memcpy(h->magic, DISK_SEGMENT_MAGIC, sizeof h->magic);
	h->version = DISK_VERSION;
	h->header_bytes = DISK_HEADER;
	h->page_bytes = DISK_PAGE;
	h->cell_records = GRID_CELL_RECORDS;
	h->bytes = s->at + sources * sizeof *s->totals;
	h->check = grid_check((uint8_t *)h + 8, DISK_HEADER - 8, 0);
	rc = grid_file_patch(&s->file, 0, h, DISK_HEADER, err);
	if (rc == 0)
		rc = grid_file_publish(&s->file, durable, err);
	if (rc)
		return rc;
	describe(s, ret);
	free(s->totals);
	s->totals = NULL;
	return 0;
}
