/*
 * Reading everything: each page and block of a segment, each block of the runs that a stage left, against
 * their checksums and what points to them. No matter which records are live: a damaged block is told even
 * where nobody would read it today. Checksums say nothing of a file that somebody made: so every number of a
 * segment that a reader counts on is found once more from the records (counts, sums, boxes, sources, classes,
 * ranges, sizes) and compared, from the tables of a block up to the header, or bounded (places).
 *
 * The model: what is damaged is told and passed over, a page with all that lies below it; of what was found
 * around that nothing is compared with a sum over all. Memory is fixed, a page for each level of the index
 * and two blocks, but for the table of sources: no more than the manifest has.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_left.h"
#include "grid_read.h"
#include "grid_run.h"
#include "grid_run_old.h"
#include "io.h"
#include "ledger.h"

enum { RUN_BLOCKS = 4 };
_Static_assert(GRID_VERIFY_BYTES >= DISK_LEVELS * DISK_PAGE + 2 * (DISK_BLOCK_MAX + 16) + 64, "pages and two blocks");
_Static_assert(GRID_VERIFY_BYTES >= RUN_BLOCKS * DISK_RUN_BLOCK, "blocks of a run");

static const char SMALL_CELL[] = "a cell is not as large as it may be";

struct verify {
	const struct grid_verify_params *p;
	struct grid_part part;
	uint8_t *pages, *block, *made; /* made: what a block should be */
	/* What was met. `holes`: things that were passed over. */
	uint64_t cells, bytes, holes, classes[256];
	struct disk_total *totals, *found; /* the segment's table of sources, and what of these there is */
	size_t ntotals;
	uint64_t at, end;       /* cells and pages lie from here to there */
	uint64_t wide, wide_hi; /* hold_range: records of a range, or 0, and its last key */
	uint64_t cell_hi, key;  /* last key of the cell before; key, source (0: none) and rest of the record before */
	uint32_t id;
	struct point last;
	uint32_t ids[GRID_CELL_RECORDS]; /* of a block's sources */
};

/* Damage is told, and so is what only a newer version can read; other errors end it. */
static int told(struct verify *v, int rc, struct err *err)
{
	if (rc != -ERR_CORRUPT && rc != -ERR_TRUNCATED && rc != -ERR_IO && rc != -ERR_VERSION)
		return rc;
	v->p->damaged(v->p->ctx, err);
	v->holes++;
	err_clear(err);
	return 0;
}

static int tell(struct verify *v, uint64_t bytes, struct err *err)
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
		return grid_damaged(&v->part, place, "a block is cut off", err);
	rc = grid_part_read(&v->part, v->block, got, place, err);
	if (rc)
		return rc;
	need = grid_block_head_bytes(v->block);
	if (need)
		need += ((const struct disk_block *)v->block)->records * sizeof(struct point);
	if (!need || need > got)
		return grid_damaged(&v->part, place, "a block has an impossible size", err);
	if (!grid_block_open(v->block, need, place, true, ret))
		return grid_damaged(&v->part, place, "the checksum of a block does not agree", err);
	return 0;
}

/* Records lie in the box and the range of their cell, and in order, from block to block as well. */
static bool in_place(struct verify *v, const struct grid_cell *cell, const struct grid_block *b)
{
	for (uint32_t i = 0; i < b->head->records; i++) {
		struct point p = b->records[i];
		uint64_t key = point_morton(p.x, p.y);
		uint32_t id = v->ids[point_source(&p)];

		p.tag &= POINT_FLAGS;
		if (key < cell->lo || key > cell->hi || p.x < cell->box[0] || p.x > cell->box[2] || p.y < cell->box[1] ||
		    p.y > cell->box[3] || key < v->key)
			return false;
		if (key == v->key && v->id) {
			int order = point_compare(&v->last, &p);

			if (order > 0 || (order == 0 && id < v->id))
				return false;
		}
		v->key = key;
		v->last = p;
		v->id = id;
	}
	return true;
}

/* Whether a block's tables are those of its records: it is made once more of these. */
static bool same_made(struct verify *v, const struct grid_block *b, struct grid_block_info *ret)
{
	struct disk_block *made = (struct disk_block *)v->made;

	for (unsigned i = 0; i < b->head->sources; i++)
		v->ids[i] = b->sources[i].id;
	for (uint32_t i = 0; i < b->head->records; i++)
		if (point_source(&b->records[i]) >= b->head->sources)
			return false;
	grid_block_make(b->records, b->head->records, NULL, v->ids, made, ret);
	made->check = b->head->check;
	made->records_check = b->head->records_check;
	return ret->bytes == b->bytes && memcmp(made, b->head, b->bytes) == 0;
}

static bool zeros(const uint8_t *bytes, size_t n)
{
	uint8_t any = 0;

	for (size_t i = 0; i < n; i++)
		any |= bytes[i];
	return !any;
}

/* Its sources, for the table of the segment; false: one is not in it. */
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

/* A block of the cell, and what the index must say of it, into `sum`. */
static int take_block(struct verify *v, const struct grid_cell *cell, uint64_t place, uint64_t end, struct disk_leaf *sum,
		      struct err *err)
{
	struct grid_block_info info;
	struct grid_block b;
	int rc = read_block(v, place, end, &b, err);

	if (rc)
		return rc;
	if (!same_made(v, &b, &info))
		return grid_damaged(&v->part, place, "the tables of a block are not those of its records", err);
	if (!in_place(v, cell, &b))
		return grid_damaged(&v->part, place, "a record lies where its cell has none", err);
	if (sum->blocks + 1 < cell->blocks && b.head->records != GRID_CELL_RECORDS)
		return grid_damaged(&v->part, place, "a block is not full, and not the last of its cell", err);
	if (!count_block(v, &b))
		return grid_damaged(&v->part, place, "a block has a source that the segment has not", err);
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

/* Where a cell can be: behind the one before, in the file as in the order of keys. */
static bool cell_follows(const struct verify *v, const struct disk_leaf *leaf, const struct grid_cell *cell)
{
	return leaf->place >= v->at && leaf->place <= v->end && leaf->bytes <= v->end - leaf->place &&
	       (!v->cells || cell->lo > v->cell_hi) && (leaf->blocks == 1 || !leaf->bits);
}

/*
 * Cells are maximal: a range twice as large would hold too many. It does where the cell before lies in it, as
 * that one is maximal. Else the others in it come behind, and are counted until one lies beyond it (`wide`).
 * Of one that needs the same meanwhile the larger range lies in that of the first, so only the last is
 * counted. False: the one counted last was too small. After what was passed over nothing is known.
 */
static bool hold_range(struct verify *v, const struct disk_leaf *leaf)
{
	const bool over = v->wide && leaf->lo > v->wide_hi, fits = over && v->wide <= GRID_CELL_RECORDS && !v->holes;
	const unsigned bits = leaf->bits + 1u;
	const uint64_t lo = bits < 64 ? leaf->lo >> bits << bits : 0;

	v->wide = over ? 0 : v->wide + (v->wide ? leaf->count : 0);
	if (bits <= 64 && !(v->cells && v->cell_hi >= lo)) {
		v->wide = leaf->count;
		v->wide_hi = disk_range_end(lo, bits);
	}
	return !fits;
}

static void summed(struct disk_inner *sum, const struct disk_inner *more)
{
	if (!sum->cells) {
		*sum = *more;
		return;
	}
	sum->hi = more->hi;
	sum->count += more->count;
	sum->distinct += more->distinct;
	sum->cells += more->cells;
	sum->sum_hi += more->sum_hi;
	sum->sum_lo += more->sum_lo;
	for (unsigned i = 0; i < 2; i++) {
		sum->box[i] = more->box[i] < sum->box[i] ? more->box[i] : sum->box[i];
		sum->box[2 + i] = more->box[2 + i] > sum->box[2 + i] ? more->box[2 + i] : sum->box[2 + i];
	}
}

static int read_cell(struct verify *v, const struct disk_leaf *leaf, struct disk_inner *sum, struct err *err)
{
	struct disk_leaf is = {.lo = leaf->lo, .place = leaf->place, .bits = leaf->bits};
	struct grid_cell cell;
	int rc = grid_cell_of(&v->part, 0, leaf, &cell, err);

	if (rc == 0 && !cell_follows(v, leaf, &cell))
		rc = grid_damaged(&v->part, leaf->place, "a cell is not behind the one before", err);
	if (rc == 0 && !hold_range(v, leaf))
		rc = grid_damaged(&v->part, leaf->place, SMALL_CELL, err);
	if (rc == 0) {
		v->at = leaf->place + leaf->bytes;
		v->cell_hi = cell.hi;
	}
	for (uint32_t i = 0; rc == 0 && i < leaf->blocks; i++)
		rc = take_block(v, &cell, leaf->place + is.bytes, leaf->place + leaf->bytes, &is, err);
	if (rc == 0 && memcmp(&is, leaf, sizeof is))
		rc = grid_damaged(&v->part, leaf->place, "a cell is not the one that the index means", err);
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
		summed(sum, &one);
	}
	rc = told(v, rc, err);
	return rc ? rc : tell(v, leaf->bytes, err);
}

/* All but the last of a level are full, and the highest would not be there for one. */
static bool entries_fit(const struct verify *v, const struct disk_page *head, unsigned level, bool last)
{
	return head->magic == DISK_PAGE_MAGIC && head->level == level && head->entries && head->entries <= DISK_ENTRIES &&
	       (last || head->entries == DISK_ENTRIES) && (!level || level + 1 < v->part.height || head->entries > 1);
}

static int open_page(struct verify *v, unsigned level, const struct disk_inner *up, bool last, struct err *err)
{
	uint8_t *page = v->pages + level * (size_t)DISK_PAGE;
	const struct disk_page *head = (const struct disk_page *)page;
	int rc = up->place > v->end || v->end - up->place < DISK_PAGE || up->place % DISK_ALIGN ?
			 grid_damaged(&v->part, up->place, "an index page lies where none can be", err) :
			 grid_part_read(&v->part, page, DISK_PAGE, up->place, err);

	if (rc == 0 && (head->check != up->check || up->check != grid_check(page + 8, DISK_PAGE - 8, up->place)))
		rc = grid_damaged(&v->part, up->place, "the checksum of an index page does not agree", err);
	if (rc == 0 && (!entries_fit(v, head, level, last) || head->zero[0] || head->zero[1] ||
			!zeros(page + sizeof *head + head->entries * (size_t)DISK_ENTRY,
			       DISK_PAGE - sizeof *head - head->entries * (size_t)DISK_ENTRY)))
		rc = grid_damaged(&v->part, up->place, "an index page is not what it should be", err);
	return rc;
}

/* The page that `up` points to and says this of. `sum`: what is found below. */
static int read_page(struct verify *v, unsigned level, const struct disk_inner *up, bool last, struct disk_inner *sum,
		     struct err *err)
{
	const uint8_t *page = v->pages + level * (size_t)DISK_PAGE;
	struct disk_inner is = {0};
	const uint64_t holes = v->holes;
	unsigned n = 0;
	int rc = open_page(v, level, up, last, err);

	if (rc)
		return told(v, rc, err);
	v->bytes += DISK_PAGE;
	rc = tell(v, DISK_PAGE, err);
	n = grid_page_entries(page);
	for (unsigned i = 0; rc == 0 && i < n; i++)
		rc = level ? read_page(v, level - 1, grid_page_inner(page, i), last && i + 1 == n, &is, err) :
			     read_cell(v, grid_page_leaf(page, i), &is, err);
	if (rc || holes != v->holes)
		return rc;
	is.place = up->place;
	is.check = up->check;
	summed(sum, &is);
	if (level + 1 < v->part.height && memcmp(&is, up, sizeof is))
		rc = told(v, grid_damaged(&v->part, up->place, "the index says something else of a page than it has", err), err);
	if (up->place < v->at)
		rc = told(v, grid_damaged(&v->part, up->place, "an index page lies before its cells", err), err);
	return rc;
}

/* All that was found, against the header. */
static int hold_header(struct verify *v, const struct disk_segment *head, const struct disk_inner *all, struct err *err)
{
	if (all->cells != head->cells || all->count != head->points || v->bytes != v->end - DISK_HEADER)
		return grid_damaged(&v->part, head->root, "its index does not hold all of its cells", err);
	if (v->wide && v->wide <= GRID_CELL_RECORDS)
		return grid_damaged(&v->part, v->at, SMALL_CELL, err);
	if (all->sum_hi != head->sum_hi || all->sum_lo != head->sum_lo || memcmp(all->box, head->box, sizeof all->box) ||
	    memcmp(v->classes, head->classes, sizeof v->classes) || !zeros(head->zero, sizeof head->zero) ||
	    (!head->cells && (head->root || head->root_check)))
		return grid_damaged(&v->part, 0, "its header says something else than its cells", err);
	if (v->ntotals && memcmp(v->found, v->totals, v->ntotals * sizeof *v->totals))
		return grid_damaged(&v->part, head->sources_place, "its table of sources says something else than its cells",
				    err);
	return 0;
}

static int by_number(const void *a, const void *b)
{
	uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

	return x < y ? -1 : x > y;
}

/* What readers look up is there: each source of the segment is one of the manifest. */
static int hold_manifest(struct verify *v, const struct disk_segment *head, const struct grid_manifest *m, struct err *err)
{
	uint32_t *ids = malloc((m->nsources ? m->nsources : 1) * sizeof *ids);
	int rc = ids ? 0 : err_set(err, ERR_NOMEM, "no memory for a table of %zu sources", m->nsources);

	for (size_t i = 0; rc == 0 && i < m->nsources; i++)
		ids[i] = m->sources[i].id;
	if (rc == 0)
		qsort(ids, m->nsources, sizeof *ids, by_number);
	for (size_t i = 0; rc == 0 && i < v->ntotals; i++)
		if (!bsearch(&v->totals[i].id, ids, m->nsources, sizeof *ids, by_number))
			rc = grid_damaged(&v->part, head->sources_place, "the manifest lacks one of its sources", err);
	free(ids);
	return rc;
}

static int verify_all(struct verify *v, const struct disk_segment *head, const struct grid_manifest *m, struct err *err)
{
	const struct disk_inner root = {.place = head->root, .check = head->root_check};
	struct disk_inner all = {0};
	int rc = grid_part_sources(&v->part, head, &v->totals, err);

	if (rc)
		return rc;
	v->ntotals = head->sources;
	v->end = head->sources_place;
	v->at = DISK_HEADER;
	v->found = calloc(v->ntotals ? v->ntotals : 1, sizeof *v->found);
	if (!v->found)
		return err_set(err, ERR_NOMEM, "no memory for a table of %zu sources", v->ntotals);
	rc = hold_manifest(v, head, m, err);
	if (rc == 0 && v->part.height)
		rc = read_page(v, v->part.height - 1, &root, true, &all, err);
	/* Each page and block is sound, but are these all? */
	if (rc == 0 && !v->holes)
		rc = hold_header(v, head, &all, err);
	return rc;
}

int grid_verify_segment(const struct grid_verify_params *p, const struct grid_manifest *m, size_t segment, struct err *err)
{
	enum { EACH = 2 * sizeof(struct disk_total) + sizeof(uint32_t) };
	struct verify v = {.p = p, .part = {.fd = -1}};
	struct disk_segment head = {0};
	uint64_t bytes = m->nsources * (uint64_t)EACH;
	int rc;

	/* Of the manifest's sources a segment has some: more are not read. */
	if (m->ledger && !ledger_take(m->ledger, LEDGER_INDEX, bytes))
		return err_set(err, ERR_BUSY, "no %llu bytes are free for a table of %zu sources", (unsigned long long)bytes,
			       m->nsources);
	v.block = (uint8_t *)(((uintptr_t)p->memory + 63) & ~(uintptr_t)63);
	v.made = v.block + ((DISK_BLOCK_MAX + 15) & ~(size_t)15);
	v.pages = v.made + ((DISK_BLOCK_MAX + 15) & ~(size_t)15);
	rc = grid_part_open(&v.part, p->dirfd, &m->segments[segment], &head, err);
	if (rc == 0 && head.sources > m->nsources)
		rc = grid_damaged(&v.part, head.sources_place, "the manifest lacks one of its sources", err);
	if (rc == 0)
		rc = verify_all(&v, &head, m, err);
	rc = told(&v, rc, err);
	free(v.totals);
	free(v.found);
	io_close(v.part.fd);
	if (m->ledger)
		ledger_give(m->ledger, LEDGER_INDEX, bytes);
	return rc;
}

/* ---- what a stage left ---- */

static int read_run(struct verify *v, const char *name, struct err *err)
{
	struct grid_run run;
	struct grid_run_reader reader;
	const struct point *pts;
	const uint32_t *ids;
	size_t n = 1;
	bool older = false;
	int rc = grid_run_version(v->p->dirfd, name, &older, err);

	if (rc == 0 && older)
		return told(v, grid_run_convert(v->p->dirfd, name, NULL, false, err), err);
	if (rc == 0)
		rc = grid_run_open(&run, v->p->dirfd, name, false, err);
	if (rc)
		return told(v, rc, err);
	for (uint64_t i = 0; rc == 0 && i < run.blocks; i++) {
		grid_run_read(&reader, &run, i, i + 1, v->block, 1);
		rc = told(v, grid_run_next(&reader, &pts, &n, &ids, err), err);
		if (rc == 0)
			rc = tell(v, DISK_RUN_BLOCK, err);
	}
	grid_run_close(&run);
	return rc;
}

int grid_verify_stage(const struct grid_verify_params *p, const char *stem, struct err *err)
{
	struct verify v = {.p = p};
	struct grid_left left;
	char name[GRID_NAME_MAX];
	int rc = grid_left_read(p->dirfd, stem, &left, err);

	v.block = (uint8_t *)(((uintptr_t)p->memory + 63) & ~(uintptr_t)63);
	if (rc)
		return told(&v, rc, err);
	for (size_t i = 0; rc == 0 && i < left.nruns; i++) {
		grid_left_run_name(stem, left.runs[i], name);
		rc = read_run(&v, name, err);
	}
	grid_left_free(&left);
	return rc;
}
