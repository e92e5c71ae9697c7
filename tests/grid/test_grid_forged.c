/*
 * Forged segments: all checksums are valid, and one number is not what the records imply. Verification must report each
 * of them, so readers need not distrust a verified segment.
 */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "grid_block.h"
#include "grid_disk.h"
#include "grid_fixture.h"
#include "grid_verify.h"

enum { SOURCES = 3, HEAVY = 6, RECORDS = 1030, ROOM = 1 << 21, MESSAGE = sizeof((struct err *)0)->message };

struct forge {
	struct folder folder;
	struct grid_segment_info info;
	uint8_t *good, *bytes;
	size_t n, cells;
	uint64_t page; /* a page of level 0, not the last one */
	unsigned leaf; /* its entry with several blocks */
	char message[MESSAGE];
};

static struct disk_segment *head_of(struct forge *f)
{
	return (struct disk_segment *)f->bytes;
}

static struct disk_inner *inner_of(struct forge *f, unsigned i)
{
	return (struct disk_inner *)(f->bytes + head_of(f)->root + sizeof(struct disk_page)) + i;
}

static struct disk_leaf *leaf_of(struct forge *f, uint64_t page, unsigned i)
{
	return (struct disk_leaf *)(f->bytes + page + sizeof(struct disk_page)) + i;
}

/* Few records in many cells: positions with more records than a cell can have, and for each bit of the key one that
 * differs in it. */
static struct set many_cells(void)
{
	struct set s = {.n = HEAVY * (RECORDS + 60)};
	size_t at = 0;

	s.pts = calloc(s.n, sizeof *s.pts);
	s.ids = calloc(s.n, sizeof *s.ids);
	for (unsigned h = 0; h < HEAVY; h++) {
		const uint64_t key = UINT64_C(0x0123456789abcdef) * (2 * h + 1);

		for (unsigned i = 0; i < RECORDS + 60; i++, at++) {
			point_from_morton(i < RECORDS ? key : key ^ UINT64_C(1) << (i - RECORDS), &s.pts[at].x, &s.pts[at].y);
			s.pts[at].z = (int32_t)(i / 3);
			s.pts[at].cls = (uint8_t)(i % 5);
			s.ids[at] = 1 + i % SOURCES;
		}
	}
	return s;
}

static void begin(struct forge *f)
{
	struct set s = many_cells();
	struct err err = ERR_INIT;
	int fd;

	*f = (struct forge){.folder = folder_new(), .good = malloc(ROOM), .bytes = malloc(ROOM)};
	CHECK(stage_set(&f->folder, "one", &s, 0, &f->info, &err));
	set_free(&s);
	fd = openat(f->folder.fd, f->info.file, O_RDONLY);
	f->n = (size_t)read(fd, f->good, ROOM);
	close(fd);
	assert_true(f->n == f->info.bytes && f->n < ROOM);
	memcpy(f->bytes, f->good, f->n);
	assert_int_equal(head_of(f)->height, 2);
	f->page = inner_of(f, 0)->place;
	while (leaf_of(f, f->page, f->leaf)->blocks == 1)
		f->leaf++;
	assert_true(f->leaf > 0 && f->leaf < DISK_ENTRIES);
}

static void end(struct forge *f)
{
	folder_remove(&f->folder);
	free(f->good);
	free(f->bytes);
}

static void note(void *ctx, const struct err *err)
{
	assert_string_not_equal(err->message, "");
	assert_string_not_equal(err->file, "");
	if (!*(char *)ctx)
		snprintf(ctx, MESSAGE, "%s", err->message);
}

/* The manifest agrees with the header, because a forger would make both. */
static const char *verify(struct forge *f, uint32_t sources)
{
	struct grid_verify_params p = {
		.dirfd = f->folder.fd, .memory = malloc(GRID_VERIFY_BYTES), .damaged = note, .ctx = f->message};
	struct grid_segment_info info = f->info;
	struct grid_manifest m = manifest_of(&info, 1, sources);
	const struct disk_segment *h = head_of(f);
	struct err err = ERR_INIT;
	int fd = openat(f->folder.fd, f->info.file, O_WRONLY | O_TRUNC);

	assert_int_equal(write(fd, f->bytes, f->n), f->n);
	close(fd);
	info.points = h->points;
	info.cells = h->cells;
	info.bytes = h->bytes;
	info.sum = (struct digest){h->sum_hi, h->sum_lo};
	memcpy(info.box, h->box, sizeof info.box);
	memcpy(info.classes, h->classes, sizeof info.classes);
	*f->message = '\0';
	CHECK(grid_verify_segment(&p, &m, 0, &err));
	free(m.sources);
	free(p.memory);
	return f->message;
}

/* ---- checksums, from the changed place up to the header ---- */

static void seal_header(struct forge *f)
{
	head_of(f)->check = grid_check(f->bytes + 8, DISK_HEADER - 8, 0);
}

static void seal_page(struct forge *f, uint64_t place)
{
	struct disk_page *page = (struct disk_page *)(f->bytes + place);

	page->check = grid_check((uint8_t *)page + 8, DISK_PAGE - 8, place);
	if (place == head_of(f)->root)
		head_of(f)->root_check = page->check;
	else
		inner_of(f, 0)->check = page->check;
	if (place != head_of(f)->root)
		seal_page(f, head_of(f)->root);
	seal_header(f);
}

static void seal_block(struct forge *f, struct disk_leaf *leaf, uint64_t place)
{
	struct disk_block *block = (struct disk_block *)(f->bytes + place);
	uint64_t was = block->check;

	leaf->check += grid_block_place(block, place) - was;
	seal_page(f, f->page);
}

static void seal_sources(struct forge *f)
{
	struct disk_segment *h = head_of(f);

	h->sources_check = grid_check(f->bytes + h->sources_place, h->sources * sizeof(struct disk_total), h->sources_place);
	seal_header(f);
}

/* ---- changes ---- */

static void add(struct forge *f, size_t at, uint32_t much)
{
	uint32_t n;

	memcpy(&n, f->bytes + at, sizeof n);
	n += much;
	memcpy(f->bytes + at, &n, sizeof n);
}

static size_t tried;

static void must_be_reported(struct forge *f, const char *what, size_t at)
{
	if (!*verify(f, SOURCES))
		fail_msg("%s, byte %zu: nothing was told", what, at);
	memcpy(f->bytes, f->good, f->n);
	tried++;
}

/* Changes each number of that many bytes at `at`, by a little and by much. */
static void change_each(struct forge *f, const char *what, size_t at, size_t bytes, void (*seal)(struct forge *, size_t at))
{
	static const uint32_t much[] = {1, UINT32_MAX, 0x10, 0x7fffffff};

	for (size_t i = 0; i + 4 <= bytes; i += 4) {
		for (size_t k = 0; k < 4; k++) {
			add(f, at + i, much[k]);
			seal(f, at);
			must_be_reported(f, what, i);
		}
	}
}

static void by_header(struct forge *f, size_t at)
{
	(void)at;
	seal_header(f);
}

static void by_root(struct forge *f, size_t at)
{
	(void)at;
	seal_page(f, head_of(f)->root);
}

static void by_page(struct forge *f, size_t at)
{
	(void)at;
	seal_page(f, f->page);
}

static void by_block(struct forge *f, size_t at)
{
	struct disk_leaf *leaf = leaf_of(f, f->page, f->leaf);

	(void)at;
	seal_block(f, leaf, leaf->place);
}

static void by_sources(struct forge *f, size_t at)
{
	(void)at;
	seal_sources(f);
}

static void test_every_number(void **state)
{
	const size_t page = sizeof(struct disk_page);
	struct forge f;
	struct disk_block *block;
	uint64_t place;

	(void)state;
	begin(&f);
	assert_string_equal(verify(&f, SOURCES), "");
	place = leaf_of(&f, f.page, f.leaf)->place;
	block = (struct disk_block *)(f.bytes + place);
	change_each(&f, "header", 8, 128 - 8 + 8 * sizeof(uint64_t), by_header);
	change_each(&f, "header: the last class, zeros", 128 + 255 * sizeof(uint64_t), 3 * sizeof(uint64_t), by_header);
	change_each(&f, "header: the last zeros", DISK_HEADER - 8, 8, by_header);
	change_each(&f, "table of sources", head_of(&f)->sources_place, SOURCES * sizeof(struct disk_total), by_sources);
	change_each(&f, "root page", head_of(&f)->root + 8, page - 8, by_root);
	change_each(&f, "root page: first entry", head_of(&f)->root + page, DISK_ENTRY, by_root);
	change_each(&f, "root page: second entry", head_of(&f)->root + page + DISK_ENTRY, DISK_ENTRY, by_root);
	change_each(&f, "root page: behind its entries", head_of(&f)->root + page + 2 * DISK_ENTRY, 8, by_root);
	change_each(&f, "page of cells", f.page + 8, page - 8, by_page);
	change_each(&f, "page of cells: its end", f.page + DISK_PAGE - 8, 8, by_page);
	change_each(&f, "first cell", f.page + page, DISK_ENTRY, by_page);
	change_each(&f, "cell of several blocks", f.page + page + f.leaf * (size_t)DISK_ENTRY, DISK_ENTRY, by_page);
	change_each(&f, "tables of a block", place + sizeof *block, disk_head_bytes(block) - sizeof *block, by_block);
	print_message("%zu numbers changed\n", tried);
	end(&f);
}

/* The numbers of a block's fixed part determine where everything else is. */
static void test_block(void **state)
{
	static const size_t at[] = {16, 20, 22, 24, 28};
	struct forge f;

	(void)state;
	begin(&f);
	for (size_t i = 0; i < sizeof at / sizeof *at; i++) {
		for (int by = -1; by <= 1; by += 2) {
			struct disk_leaf *leaf = leaf_of(&f, f.page, f.leaf);
			uint16_t n;

			memcpy(&n, f.bytes + leaf->place + at[i], sizeof n);
			n = (uint16_t)(n + by);
			memcpy(f.bytes + leaf->place + at[i], &n, sizeof n);
			seal_block(&f, leaf, leaf->place);
			must_be_reported(&f, "block", at[i]);
		}
	}
	end(&f);
}

/* No sum covers the order of records, or which source a record has in a block with several. */
static void test_order(void **state)
{
	struct forge f;
	struct disk_leaf *leaf;
	struct point *pts, first;

	(void)state;
	begin(&f);
	leaf = leaf_of(&f, f.page, f.leaf);
	pts = (struct point *)(f.bytes + leaf->place + leaf->head_bytes);
	first = pts[0];
	assert_true(pts[0].x == pts[100].x && pts[0].y == pts[100].y && pts[0].z < pts[100].z);
	pts[0] = pts[100];
	pts[100] = first;
	seal_block(&f, leaf, leaf->place);
	assert_string_equal(verify(&f, SOURCES), "the segment is damaged: a record is outside of its cell, or out of order");
	memcpy(f.bytes, f.good, f.n);
	pts[0].tag = (uint16_t)(point_flags(&pts[0]) | SOURCES << POINT_SOURCE_SHIFT);
	seal_block(&f, leaf, leaf->place);
	assert_string_equal(verify(&f, SOURCES), "the segment is damaged: the tables of a block do not match its records");
	end(&f);
}

/* Cells of a page in another order; a page twice; a range that overlaps the next one. */
static void test_places(void **state)
{
	struct forge f;
	struct disk_leaf leaf;
	unsigned wide = 0;

	(void)state;
	begin(&f);
	leaf = *leaf_of(&f, f.page, 0);
	*leaf_of(&f, f.page, 0) = *leaf_of(&f, f.page, 1);
	*leaf_of(&f, f.page, 1) = leaf;
	seal_page(&f, f.page);
	assert_string_equal(verify(&f, SOURCES), "the segment is damaged: a cell does not follow the previous one");
	memcpy(f.bytes, f.good, f.n);
	*inner_of(&f, 1) = *inner_of(&f, 0);
	seal_page(&f, head_of(&f)->root);
	assert_string_equal(verify(&f, SOURCES), "the segment is damaged: a cell does not follow the previous one");
	memcpy(f.bytes, f.good, f.n);
	while (leaf_of(&f, f.page, wide)->lo >> leaf_of(&f, f.page, wide)->bits & 1)
		wide++;
	leaf_of(&f, f.page, wide)->bits++; /* the neighbouring keys belong to another cell */
	seal_page(&f, f.page);
	assert_string_equal(verify(&f, SOURCES), "the segment is damaged: a cell does not follow the previous one");
	end(&f);
}

/* A range that could be smaller and still contain all of the cell's records. */
static void test_ranges(void **state)
{
	struct forge f;
	size_t smaller = 0;

	(void)state;
	begin(&f);
	for (unsigned i = 0; i < DISK_ENTRIES; i++) {
		struct disk_leaf *leaf = leaf_of(&f, f.page, i);
		const uint64_t first = point_morton(leaf->box[0], leaf->box[1]);
		const uint64_t last = point_morton(leaf->box[2], leaf->box[3]);

		if (!leaf->bits || first >> (leaf->bits - 1) != last >> (leaf->bits - 1))
			continue;
		leaf->bits--;
		leaf->lo = first >> leaf->bits << leaf->bits;
		if (i == 0)
			inner_of(&f, 0)->lo = leaf->lo;
		if (i + 1 == DISK_ENTRIES)
			inner_of(&f, 0)->hi = disk_range_end(leaf->lo, leaf->bits);
		seal_page(&f, f.page);
		must_be_reported(&f, "range of cell", i);
		smaller++;
	}
	assert_true(smaller > DISK_ENTRIES / 2);
	end(&f);
}

/* Few points are one cell, which must be as large as possible; without points there is no index. */
static void test_few(void **state)
{
	static const char *const file[] = {"none", "some"};
	struct forge f = {.folder = folder_new(), .bytes = malloc(ROOM)};

	(void)state;
	for (unsigned i = 0; i < 2; i++) {
		struct set s = set_make(SHAPE_UNIFORM, 20 * i, 1, 5);
		struct err err = ERR_INIT;
		int fd;

		for (size_t k = 0; k < s.n; k++)
			s.pts[k].x = s.pts[k].y = -1 - (int32_t)k;
		CHECK(stage_set(&f.folder, file[i], &s, 0, &f.info, &err));
		set_free(&s);
		fd = openat(f.folder.fd, f.info.file, O_RDONLY);
		f.n = (size_t)read(fd, f.bytes, ROOM);
		close(fd);
		assert_string_equal(verify(&f, 1), "");
		if (i) {
			assert_int_equal(leaf_of(&f, head_of(&f)->root, 0)->bits, 64);
			leaf_of(&f, head_of(&f)->root, 0)->bits = 62;
			seal_page(&f, head_of(&f)->root);
			assert_string_equal(verify(&f, 1), "the segment is damaged: a cell is smaller than it must be");
		} else {
			head_of(&f)->root = DISK_HEADER;
			seal_header(&f);
			assert_string_not_equal(verify(&f, 1), "");
			head_of(&f)->root = 0;
			head_of(&f)->root_check = 1;
			seal_header(&f);
			assert_string_not_equal(verify(&f, 1), "");
		}
	}
	end(&f);
}

/* If a cell has several blocks, all but the last are full: here the first one gives its last record to the last one. */
static void test_full_blocks(void **state)
{
	struct forge f;
	struct disk_leaf *leaf;
	struct disk_block *first, *last;
	struct grid_block_info info;
	struct point pts[RECORDS];
	uint32_t ids[RECORDS];
	uint8_t *at;
	size_t n = 0;

	(void)state;
	begin(&f);
	leaf = leaf_of(&f, f.page, f.leaf);
	at = f.bytes + leaf->place;
	for (unsigned i = 0; i < 2; i++) {
		struct grid_block b;

		assert_true(grid_block_open(at, DISK_BLOCK_MAX, (uint64_t)(at - f.bytes), true, &b));
		for (unsigned k = 0; k < b.head->records; k++, n++) {
			pts[n] = b.records[k];
			ids[n] = b.sources[point_source(&pts[n])].id;
			pts[n].tag &= POINT_FLAGS;
		}
		at += b.bytes;
	}
	assert_true(n == RECORDS);
	first = (struct disk_block *)(f.bytes + leaf->place);
	grid_block_make(pts, GRID_CELL_RECORDS - 1, ids, NULL, first, &info);
	last = (struct disk_block *)((uint8_t *)first + info.bytes);
	leaf->check = grid_block_place(first, leaf->place);
	grid_block_make(pts + GRID_CELL_RECORDS - 1, RECORDS - GRID_CELL_RECORDS + 1, ids + GRID_CELL_RECORDS - 1, NULL, last,
			&info);
	assert_true((uint8_t *)last + info.bytes == at);
	leaf->check += grid_block_place(last, (uint64_t)((uint8_t *)last - f.bytes));
	seal_page(&f, f.page);
	assert_string_equal(verify(&f, SOURCES), "the segment is damaged: a block is not full, and not the last of its cell");
	end(&f);
}

/* Readers look up each record's source in the manifest. */
static void test_manifest_lacks(void **state)
{
	struct forge f;

	(void)state;
	begin(&f);
	assert_string_equal(verify(&f, SOURCES - 1), "the segment is damaged: one of its sources is not in the manifest");
	((struct disk_total *)(f.bytes + head_of(&f)->sources_place))[SOURCES - 1].id = 77;
	seal_sources(&f);
	assert_string_equal(verify(&f, SOURCES), "the segment is damaged: one of its sources is not in the manifest");
	end(&f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_every_number), cmocka_unit_test(test_block),          cmocka_unit_test(test_order),
		cmocka_unit_test(test_places),       cmocka_unit_test(test_manifest_lacks), cmocka_unit_test(test_ranges),
		cmocka_unit_test(test_few),          cmocka_unit_test(test_full_blocks),
	};

	no_sync();
	return cmocka_run_group_tests_name("grid: forged", tests, NULL, NULL);
}
