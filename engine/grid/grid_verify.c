/*
 * Verification (grid_verify.h): reads each page and block of a segment, and each block of the runs of a suspended
 * stage, and checks them against their checksums and against whatever points to them. Dead records are checked too. A
 * checksum does not protect against a forged file. So every number of a segment that a reader relies on is derived from
 * the records again and compared (counts, sums, boxes, sources, classes, ranges, sizes), or bounded (places).
 *
 * Damage is reported and skipped; a damaged page is skipped with everything below it. After that, totals that would
 * include the skipped part are not compared. Memory is fixed (a page for each level of the index, and two blocks)
 * except for the table of sources, which is bounded by the manifest.
 */
#include "grid_verify.h"

#include <stdlib.h>
#include <string.h>

#include "align.h"
#include "err.h"
#include "grid_priv.h"
#include "grid_run.h"
#include "grid_run_old.h"
#include "grid_state.h"
#include "io.h"
#include "ledger.h"
#include "order.h"

enum { RUN_BLOCKS = 4 };
_Static_assert(GRID_VERIFY_BYTES >= DISK_LEVELS * DISK_PAGE + 2 * (DISK_BLOCK_MAX + 16) + ALIGN_LINE, "pages and two blocks");
_Static_assert(GRID_VERIFY_BYTES >= RUN_BLOCKS * DISK_RUN_BLOCK, "blocks of a run");

static const char SMALL_CELL[] = "a cell is smaller than it must be";

struct verify {
	const struct grid_verify_params *p;
	struct grid_segment segment;
	uint8_t *pages, *block, *expected;            /* expected: the block as its records define it */
	uint64_t cells, bytes, skipped, classes[256]; /* totals so far; damaged things that were skipped */
	struct disk_total *totals, *found;            /* the segment's table of sources; the same, derived from the blocks */
	size_t ntotals;
	uint64_t at, end;         /* the next cell or page begins at or after `at`; all end before `end` */
	uint64_t range, range_hi; /* check_maximal: records of the range so far, or 0; its last key */
	uint64_t cell_hi;         /* last key of the previous cell */
	uint64_t first_key;       /* of all records */
	uint64_t last_key;        /* key, source (0: none) and record of the previous record */
	uint32_t last_id;
	struct point last;
	uint32_t ids[GRID_CELL_RECORDS]; /* the sources of a block */
};

/* Reports damage, and what only a newer version can read. Other errors end the verification. */
static int report_damage(struct verify *v, int rc, struct err *err)
{
	if (rc != -ERR_CORRUPT && rc != -ERR_TRUNCATED && rc != -ERR_IO && rc != -ERR_VERSION)
		return rc;
	v->p->damaged(v->p->ctx, err);
	v->skipped++;
	err_clear(err);
	return 0;
}

static int report_progress(struct verify *v, uint64_t bytes, struct err *err)
{
	if (v->p->progress && v->p->progress(v->p->ctx, bytes))
		return err_set(err, ERR_CANCELLED, "cancelled");
	return 0;
}

/* ---- segments ---- */

static int read_block(struct verify *v, uint64_t place, uint64_t end, struct grid_block *ret, struct err *err)
{
	size_t got = end - place < DISK_BLOCK_MAX ? (size_t)(end - place) : DISK_BLOCK_MAX, need;
	int rc;

	if (place > end || got < sizeof(struct disk_block))
		return grid_segment_damaged(&v->segment, place, "a block is cut off", err);
	rc = grid_segment_read(&v->segment, v->block, got, place, err);
	if (rc)
		return rc;
	need = grid_block_head_bytes(v->block);
	if (need)
		need += ((const struct disk_block *)v->block)->records * sizeof(struct point);
	if (!need || need > got)
		return grid_segment_damaged(&v->segment, place, "a block has an impossible size", err);
	if (!grid_block_open(v->block, need, place, true, ret))
		return grid_segment_damaged(&v->segment, place, "the checksum of a block does not agree", err);
	return 0;
}

/* Whether the records are in the box and the range of their cell, and in order, also from block to block. */
static bool records_ordered(struct verify *v, const struct grid_cell *cell, const struct grid_block *b)
{
	for (uint32_t i = 0; i < b->head->records; i++) {
		struct point p = b->records[i];
		uint64_t key = point_morton(p.x, p.y);
		uint32_t id = v->ids[point_source(&p)];

		p.tag &= POINT_FLAGS;
		if (key < cell->lo || key > cell->hi || p.x < cell->box[0] || p.x > cell->box[2] || p.y < cell->box[1] ||
		    p.y > cell->box[3] || key < v->last_key)
			return false;
		if (key == v->last_key && v->last_id) {
			int order = point_compare(&v->last, &p);

			if (order > 0 || (order == 0 && id < v->last_id))
				return false;
		}
		v->first_key = v->last_id ? v->first_key : key;
		v->last_key = key;
		v->last = p;
		v->last_id = id;
	}
	return true;
}

/* Whether the tables of a block match its records: makes the block from these again. */
static bool tables_match(struct verify *v, const struct grid_block *b, struct grid_block_info *ret)
{
	struct disk_block *expected = (struct disk_block *)v->expected;

	for (unsigned i = 0; i < b->head->sources; i++)
		v->ids[i] = b->sources[i].id;
	for (uint32_t i = 0; i < b->head->records; i++)
		if (point_source(&b->records[i]) >= b->head->sources)
			return false;
	grid_block_make(b->records, b->head->records, NULL, v->ids, expected, ret);
	expected->check = b->head->check;
	expected->records_check = b->head->records_check;
	return ret->bytes == b->bytes && memcmp(expected, b->head, b->bytes) == 0;
}

static bool zeros(const uint8_t *bytes, size_t n)
{
	uint8_t any = 0;

	for (size_t i = 0; i < n; i++)
		any |= bytes[i];
	return !any;
}

/* Adds a block to the totals of classes and sources; false: a source is not in the segment's table. */
static bool count_block(struct verify *v, const struct grid_block *b)
{
	for (unsigned i = 0; i < b->head->classes; i++)
		v->classes[b->classes[i].cls] += b->classes[i].records;
	for (unsigned i = 0; i < b->head->sources; i++) {
		const struct disk_source *s = &b->sources[i];
		size_t from = 0, to = v->ntotals;

		while (from < to) {
			size_t mid = from + (to - from) / 2;

			if (v->totals[mid].id < s->id)
				from = mid + 1;
			else
				to = mid;
		}
		if (from == v->ntotals || v->totals[from].id != s->id)
			return false;
		v->found[from].id = s->id;
		v->found[from].points += s->records;
		v->found[from].sum_hi += s->sum_hi;
		v->found[from].sum_lo += s->sum_lo;
	}
	return true;
}

/* Checks a block of the cell, and adds it to `sum`, the entry that the index must have for the cell. */
static int check_block(struct verify *v, const struct grid_cell *cell, uint64_t place, uint64_t end, struct disk_leaf *sum,
		       struct err *err)
{
	struct grid_block_info info;
	struct grid_block b;
	int rc = read_block(v, place, end, &b, err);

	if (rc)
		return rc;
	if (!tables_match(v, &b, &info))
		return grid_segment_damaged(&v->segment, place, "the tables of a block do not match its records", err);
	if (!records_ordered(v, cell, &b))
		return grid_segment_damaged(&v->segment, place, "a record is outside of its cell, or out of order", err);
	if (sum->blocks + 1 < cell->blocks && b.head->records != GRID_CELL_RECORDS)
		return grid_segment_damaged(&v->segment, place, "a block is not full, and not the last of its cell", err);
	if (!count_block(v, &b))
		return grid_segment_damaged(&v->segment, place, "a block has a source that is not in the segment's table", err);
	if (!sum->blocks++) {
		sum->head_bytes = (uint32_t)info.head_bytes;
		sum->source = info.source;
		sum->distinct = (uint16_t)info.distinct;
		memcpy(sum->box, info.box, sizeof sum->box);
	} else if (sum->source != info.source) {
		sum->source = 0;
	}
	sum->bytes += b.bytes;
	sum->count += b.head->records;
	sum->check += b.head->check;
	sum->sum_hi += info.sum.hi;
	sum->sum_lo += info.sum.lo;
	return 0;
}

/* Whether the cell follows the previous one, both in the file and in the order of keys. */
static bool cell_follows(const struct verify *v, const struct disk_leaf *leaf, const struct grid_cell *cell)
{
	return leaf->place >= v->at && leaf->place <= v->end && leaf->bytes <= v->end - leaf->place &&
	       (!v->cells || cell->lo > v->cell_hi) && (leaf->blocks == 1 || !leaf->bits);
}

/*
 * Checks that cells are maximal: the aligned range twice as large as a cell's must hold more than GRID_CELL_RECORDS
 * records. If the previous cell is in that range, it does, because that cell is maximal. Otherwise the other cells in
 * the range follow, and their records are counted (`range`) until a cell is beyond it. If a second cell needs this
 * meanwhile, its range is inside the first one's, and only the second is counted. False: the range counted last has too
 * few records. Nothing is concluded after something was skipped.
 */
static bool check_maximal(struct verify *v, const struct disk_leaf *leaf)
{
	const bool over = v->range && leaf->lo > v->range_hi, fits = over && v->range <= GRID_CELL_RECORDS && !v->skipped;
	const unsigned bits = leaf->bits + 1u;
	const uint64_t lo = bits < 64 ? leaf->lo >> bits << bits : 0;

	v->range = over ? 0 : v->range + (v->range ? leaf->count : 0);
	if (bits <= 64 && !(v->cells && v->cell_hi >= lo)) {
		v->range = leaf->count;
		v->range_hi = disk_range_end(lo, bits);
	}
	return !fits;
}

static void add_entry(struct disk_inner *sum, const struct disk_inner *next)
{
	if (sum->cells)
		grid_inner_add(sum, next);
	else
		*sum = *next;
}

static int read_cell(struct verify *v, const struct disk_leaf *leaf, struct disk_inner *sum, struct err *err)
{
	struct disk_leaf is = {.lo = leaf->lo, .place = leaf->place, .bits = leaf->bits};
	struct grid_cell cell;
	int rc = grid_cell_of(&v->segment, 0, leaf, &cell, err);

	if (rc == 0 && !cell_follows(v, leaf, &cell))
		rc = grid_segment_damaged(&v->segment, leaf->place, "a cell does not follow the previous one", err);
	if (rc == 0 && !check_maximal(v, leaf))
		rc = grid_segment_damaged(&v->segment, leaf->place, SMALL_CELL, err);
	if (rc == 0) {
		v->at = leaf->place + leaf->bytes;
		v->cell_hi = cell.hi;
	}
	for (uint32_t i = 0; rc == 0 && i < leaf->blocks; i++)
		rc = check_block(v, &cell, leaf->place + is.bytes, leaf->place + leaf->bytes, &is, err);
	if (rc == 0 && memcmp(&is, leaf, sizeof is))
		rc = grid_segment_damaged(&v->segment, leaf->place, "a cell differs from its index entry", err);
	v->cells++;
	v->bytes += leaf->bytes;
	if (rc == 0) {
		struct disk_inner one = {.lo = is.lo,
					 .hi = cell.hi,
					 .count = is.count,
					 .distinct = is.distinct,
					 .cells = 1,
					 .sum_hi = is.sum_hi,
					 .sum_lo = is.sum_lo};

		memcpy(one.box, is.box, sizeof one.box);
		add_entry(sum, &one);
	}
	rc = report_damage(v, rc, err);
	return rc ? rc : report_progress(v, leaf->bytes, err);
}

/* Whether the number of entries is possible: only the last page of a level may be partly filled, and the root of several
 * levels has at least two. */
static bool entries_valid(const struct verify *v, const struct disk_page *head, unsigned level, bool last)
{
	return head->magic == DISK_PAGE_MAGIC && head->level == level && head->entries && head->entries <= DISK_ENTRIES &&
	       (last || head->entries == DISK_ENTRIES) && (!level || level + 1 < v->segment.height || head->entries > 1);
}

static int open_page(struct verify *v, unsigned level, const struct disk_inner *up, bool last, struct err *err)
{
	uint8_t *page = v->pages + level * (size_t)DISK_PAGE;
	const struct disk_page *head = (const struct disk_page *)page;
	int rc = up->place > v->end || v->end - up->place < DISK_PAGE || up->place % DISK_ALIGN ?
			 grid_segment_damaged(&v->segment, up->place, "an index page has an impossible place", err) :
			 grid_segment_read(&v->segment, page, DISK_PAGE, up->place, err);

	if (rc == 0 && (head->check != up->check || up->check != grid_check(page + 8, DISK_PAGE - 8, up->place)))
		rc = grid_segment_damaged(&v->segment, up->place, "the checksum of an index page does not agree", err);
	if (rc == 0 && (!entries_valid(v, head, level, last) || head->zero[0] || head->zero[1] ||
			!zeros(page + sizeof *head + head->entries * (size_t)DISK_ENTRY,
			       DISK_PAGE - sizeof *head - head->entries * (size_t)DISK_ENTRY)))
		rc = grid_segment_damaged(&v->segment, up->place, "an index page has invalid fields", err);
	return rc;
}

/* Reads the page that the entry `up` describes, and all below it, which it adds to `sum`. */
static int read_page(struct verify *v, unsigned level, const struct disk_inner *up, bool last, struct disk_inner *sum,
		     struct err *err)
{
	const uint8_t *page = v->pages + level * (size_t)DISK_PAGE;
	struct disk_inner is = {0};
	const uint64_t skipped = v->skipped;
	unsigned n = 0;
	int rc = open_page(v, level, up, last, err);

	if (rc)
		return report_damage(v, rc, err);
	v->bytes += DISK_PAGE;
	rc = report_progress(v, DISK_PAGE, err);
	n = grid_page_entries(page);
	for (unsigned i = 0; rc == 0 && i < n; i++)
		rc = level ? read_page(v, level - 1, grid_page_inner(page, i), last && i + 1 == n, &is, err) :
			     read_cell(v, grid_page_leaf(page, i), &is, err);
	if (rc || skipped != v->skipped)
		return rc;
	is.place = up->place;
	is.check = up->check;
	add_entry(sum, &is);
	if (level + 1 < v->segment.height && memcmp(&is, up, sizeof is))
		rc = report_damage(
			v, grid_segment_damaged(&v->segment, up->place, "an index entry does not agree with its page", err), err);
	if (up->place < v->at)
		rc = report_damage(v, grid_segment_damaged(&v->segment, up->place, "an index page lies before its cells", err),
				   err);
	return rc;
}

/* Compares all totals with the header. */
static int check_header(struct verify *v, const struct disk_segment *head, const struct disk_inner *all, struct err *err)
{
	if (all->cells != head->cells || all->count != head->points || v->bytes != v->end - DISK_HEADER)
		return grid_segment_damaged(&v->segment, head->root, "its index does not hold all of its cells", err);
	if (v->range && v->range <= GRID_CELL_RECORDS)
		return grid_segment_damaged(&v->segment, v->at, SMALL_CELL, err);
	if (all->sum_hi != head->sum_hi || all->sum_lo != head->sum_lo || memcmp(all->box, head->box, sizeof all->box) ||
	    memcmp(v->classes, head->classes, sizeof v->classes) || !zeros(head->zero, sizeof head->zero) ||
	    (!head->cells && (head->root || head->root_check)))
		return grid_segment_damaged(&v->segment, 0, "its header does not agree with its cells", err);
	if (v->ntotals && memcmp(v->found, v->totals, v->ntotals * sizeof *v->totals))
		return grid_segment_damaged(&v->segment, head->sources_place,
					    "its table of sources does not agree with its cells", err);
	return 0;
}

/* Whoever needs other keys never looks into the segment. */
static int check_range(const struct verify *v, const struct grid_segment_info *info, struct err *err)
{
	if (!info->points || (info->lo <= v->first_key && v->last_key <= info->hi))
		return 0;
	return grid_segment_damaged(&v->segment, 0, "it has a record outside of the range of keys in the manifest", err);
}

/* Checks that the manifest has each source of the segment. */
static int check_sources(struct verify *v, const struct disk_segment *head, const struct grid_manifest *m, struct err *err)
{
	size_t n = 0;
	struct grid_batch *batches = grid_batches_sorted(m, &n);
	int rc = batches ? 0 :
			   err_set(err, ERR_NOMEM, "no memory for a table of %llu sources",
				   (unsigned long long)grid_manifest_all(m));

	for (size_t i = 0; rc == 0 && i < v->ntotals; i++)
		if (!grid_batches_find(batches, n, v->totals[i].id))
			rc = grid_segment_damaged(&v->segment, head->sources_place, "one of its sources is not in the manifest",
						  err);
	free(batches);
	return rc;
}

static int verify_all(struct verify *v, const struct disk_segment *head, const struct grid_manifest *m, size_t segment,
		      struct err *err)
{
	const struct disk_inner root = {.place = head->root, .check = head->root_check};
	struct disk_inner all = {0};
	int rc = grid_segment_sources(&v->segment, head, &v->totals, err);

	if (rc)
		return rc;
	v->ntotals = head->sources;
	v->end = head->sources_place;
	v->at = DISK_HEADER;
	v->found = calloc(v->ntotals ? v->ntotals : 1, sizeof *v->found);
	if (!v->found)
		return err_set(err, ERR_NOMEM, "no memory for a table of %zu sources", v->ntotals);
	rc = check_sources(v, head, m, err);
	if (rc == 0 && v->segment.height)
		rc = read_page(v, v->segment.height - 1, &root, true, &all, err);
	if (rc == 0 && !v->skipped)
		rc = check_header(v, head, &all, err);
	if (rc == 0 && !v->skipped)
		rc = check_range(v, &m->segments[segment], err);
	return rc;
}

int grid_verify_segment(const struct grid_verify_params *p, const struct grid_manifest *m, size_t segment, struct err *err)
{
	enum { EACH = 2 * sizeof(struct disk_total) };
	struct verify v = {.p = p, .segment = {.fd = -1}};
	struct disk_segment head = {0};
	uint64_t bytes = grid_manifest_all(m) * EACH + m->nbatches * sizeof(struct grid_batch);
	int rc;

	/* A segment cannot have more sources than the manifest, so a larger table is not read. */
	if (m->ledger && !ledger_take(m->ledger, LEDGER_INDEX, bytes))
		return err_set(err, ERR_BUSY, "no %llu bytes are free for a table of %llu sources", (unsigned long long)bytes,
			       (unsigned long long)grid_manifest_all(m));
	v.block = (uint8_t *)align_line((uintptr_t)p->memory);
	v.expected = v.block + ((DISK_BLOCK_MAX + 15) & ~(size_t)15);
	v.pages = v.expected + ((DISK_BLOCK_MAX + 15) & ~(size_t)15);
	rc = grid_segment_open(&v.segment, p->dirfd, &m->segments[segment], &head, err);
	if (rc == 0 && head.sources > grid_manifest_all(m))
		rc = grid_segment_damaged(&v.segment, head.sources_place, "one of its sources is not in the manifest", err);
	if (rc == 0)
		rc = verify_all(&v, &head, m, segment, err);
	rc = report_damage(&v, rc, err);
	free(v.totals);
	free(v.found);
	io_close(v.segment.fd);
	if (m->ledger)
		ledger_give(m->ledger, LEDGER_INDEX, bytes);
	return rc;
}

/* ---- suspended stages ---- */

static int read_run(struct verify *v, const char *name, struct err *err)
{
	struct grid_run run;
	struct grid_run_reader reader;
	const struct point *pts;
	const uint32_t *ids;
	size_t n = 1;
	uint64_t bytes;
	bool older = false;
	int rc = grid_run_check(v->p->dirfd, name, &older, &bytes, err);

	if (rc == 0 && older)
		return report_damage(v, grid_run_convert(v->p->dirfd, name, NULL, false, err), err);
	if (rc == 0)
		rc = grid_run_open(&run, v->p->dirfd, name, false, err);
	if (rc)
		return report_damage(v, rc, err);
	for (uint64_t i = 0; rc == 0 && i < run.blocks; i++) {
		grid_run_read(&reader, &run, i, i + 1, v->block, 1);
		rc = report_damage(v, grid_run_next(&reader, &pts, &n, &ids, err), err);
		if (rc == 0)
			rc = report_progress(v, DISK_RUN_BLOCK, err);
	}
	grid_run_close(&run);
	return rc;
}

int grid_verify_stage(const struct grid_verify_params *p, const char *stem, struct err *err)
{
	struct verify v = {.p = p};
	struct grid_state state;
	char name[GRID_NAME_MAX];
	int rc = grid_state_read(p->dirfd, stem, &state, err);

	v.block = (uint8_t *)align_line((uintptr_t)p->memory);
	if (rc)
		return report_damage(&v, rc, err);
	for (size_t i = 0; rc == 0 && i < state.nruns; i++) {
		grid_run_name(stem, state.runs[i], name);
		rc = read_run(&v, name, err);
	}
	grid_state_free(&state);
	return rc;
}
