/*
 * Reading everything: each page and block of a segment, each block of the runs that a stage left, against their
 * checksums and what points to them. No matter which records are live: a damaged block is told even where nobody
 * would read it today.
 *
 * The model: what is damaged is told and passed over, a page with all that lies below it. Memory is fixed: a page for
 * each level of the index, and a block.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_left.h"
#include "grid_read.h"
#include "grid_run.h"
#include "grid_run_old.h"
#include "io.h"

enum { RUN_BLOCKS = 4 };
_Static_assert(GRID_VERIFY_BYTES >= DISK_LEVELS * DISK_PAGE + DISK_BLOCK_MAX + 64, "pages and a block");
_Static_assert(GRID_VERIFY_BYTES >= RUN_BLOCKS * DISK_RUN_BLOCK, "blocks of a run");

struct verify {
	const struct grid_verify_params *p;
	struct grid_part part;
	uint8_t *pages, *block;
	uint64_t points, cells; /* that were met */
	uint64_t key;           /* of the record before */
	bool holed;             /* something was passed over */
};

/* Damage is told, and so is what only a newer version can read; other errors end it. */
static int told(struct verify *v, int rc, struct err *err)
{
	if (rc != -ERR_CORRUPT && rc != -ERR_TRUNCATED && rc != -ERR_IO && rc != -ERR_VERSION)
		return rc;
	v->p->damaged(v->p->ctx, err);
	v->holed = true;
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

/* What no checksum says of files that somebody else made, and every reader counts on: records lie in the box and the range of
 * their cell, in order. */
static bool in_place(struct verify *v, const struct grid_cell *cell, const struct grid_block *b)
{
	for (uint32_t i = 0; i < b->head->records; i++) {
		const struct point *p = &b->records[i];
		uint64_t key = point_morton(p->x, p->y);

		if (key < v->key || key < cell->lo || key > cell->hi || p->x < cell->box[0] || p->x > cell->box[2] ||
		    p->y < cell->box[1] || p->y > cell->box[3])
			return false;
		v->key = key;
	}
	return true;
}

static int read_cell(struct verify *v, const struct disk_leaf *leaf, struct err *err)
{
	struct grid_cell cell;
	uint64_t place = leaf->place, check = 0, points = 0;
	int rc = grid_cell_of(&v->part, 0, leaf, &cell, err);

	for (uint32_t i = 0; rc == 0 && i < leaf->blocks; i++) {
		struct grid_block b;

		rc = read_block(v, place, leaf->place + leaf->bytes, &b, err);
		if (rc == 0 && !in_place(v, &cell, &b))
			rc = grid_damaged(&v->part, place, "a record lies where its cell has none", err);
		if (rc)
			break;
		check += b.head->check;
		points += b.head->records;
		place += b.bytes;
	}
	if (rc == 0 && (check != leaf->check || points != leaf->count))
		rc = grid_damaged(&v->part, leaf->place, "a cell is not the one that the index means", err);
	v->points += points;
	v->cells++;
	rc = told(v, rc, err);
	return rc ? rc : tell(v, leaf->bytes, err);
}

static int read_page(struct verify *v, unsigned level, uint64_t place, uint64_t check, struct err *err)
{
	uint8_t *page = v->pages + level * (size_t)DISK_PAGE;
	const struct disk_page *head = (const struct disk_page *)page;
	int rc = grid_part_read(&v->part, page, DISK_PAGE, place, err);

	if (rc == 0 && (head->check != check || check != grid_check(page + 8, DISK_PAGE - 8, place)))
		rc = grid_damaged(&v->part, place, "the checksum of an index page does not agree", err);
	if (rc == 0 && (head->magic != DISK_PAGE_MAGIC || head->level != level || !head->entries ||
			head->entries > DISK_ENTRIES))
		rc = grid_damaged(&v->part, place, "an index page is not what it should be", err);
	if (rc)
		return told(v, rc, err);
	rc = tell(v, DISK_PAGE, err);
	for (unsigned i = 0; rc == 0 && i < head->entries; i++) {
		const struct disk_inner *inner = grid_page_inner(page, i);

		rc = level ? read_page(v, level - 1, inner->place, inner->check, err) :
			     read_cell(v, grid_page_leaf(page, i), err);
	}
	return rc;
}

int grid_verify_segment(const struct grid_verify_params *p, const struct grid_segment_info *info, struct err *err)
{
	struct verify v = {.p = p, .part = {.fd = -1}};
	struct disk_total *totals = NULL;
	struct disk_segment head;
	int rc;

	v.block = (uint8_t *)(((uintptr_t)p->memory + 63) & ~(uintptr_t)63);
	v.pages = v.block + ((DISK_BLOCK_MAX + 15) & ~(size_t)15);
	rc = grid_part_open(&v.part, p->dirfd, info, &head, err);
	if (rc == 0)
		rc = grid_part_sources(&v.part, &head, &totals, err);
	free(totals);
	if (rc == 0 && v.part.height)
		rc = read_page(&v, v.part.height - 1, v.part.root, v.part.root_check, err);
	/* Each page and block is sound, but are these all? */
	if (rc == 0 && !v.holed && (v.points != head.points || v.cells != head.cells))
		rc = grid_damaged(&v.part, head.root, "its index does not hold all of its cells", err);
	rc = told(&v, rc, err);
	io_close(v.part.fd);
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
