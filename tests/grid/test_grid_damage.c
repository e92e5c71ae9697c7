/*
 * Damage: any changed byte of a segment, manifest or run is found when it is read, and so is an intact segment, page or
 * block that is not the right one.
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

struct bytes {
	uint8_t *at;
	size_t n;
};

static struct bytes load(const struct folder *f, const char *name)
{
	struct bytes b = {malloc(1 << 22), 0};
	int fd = openat(f->fd, name, O_RDONLY);
	ssize_t n = read(fd, b.at, 1 << 22);

	assert_true(fd >= 0 && n >= 0);
	b.n = (size_t)n;
	close(fd);
	return b;
}

static void store(const struct folder *f, const char *name, const void *bytes, size_t n)
{
	int fd = openat(f->fd, name, O_WRONLY | O_CREAT | O_TRUNC, 0644);

	assert_true(fd >= 0 && write(fd, bytes, n) == (ssize_t)n);
	close(fd);
}

static void poke(const struct folder *f, const char *name, size_t place, uint8_t byte)
{
	int fd = openat(f->fd, name, O_WRONLY);

	assert_int_equal(pwrite(fd, &byte, 1, (off_t)place), 1);
	close(fd);
}

static int nothing(void *ctx, const struct grid_cell *cell)
{
	return 0;
}

/* Opens and reads everything in every way; 0 if there was no error. */
static int read_all(const struct folder *f, struct gather *g, struct digest *ret_sum, struct err *err)
{
	struct grid_visitor v = {NULL, NULL, nothing};
	struct grid_reader *r;
	struct grid *grid;
	uint64_t count;
	bool exact;
	int rc = grid_open(f->fd, "m", 1, NULL, 1 << 20, &grid, err);

	if (rc)
		return rc;
	void *memory = malloc(grid_reader_bytes(grid));

	rc = grid_reader_new(grid, memory, grid_reader_bytes(grid), &r, err);
	if (rc == 0)
		rc = grid_walk(r, 0, UINT64_MAX, &v, err);
	if (rc == 0)
		rc = grid_count(r, 0, UINT64_MAX, &count, &exact, err);
	if (rc == 0)
		rc = grid_sum(r, 0, UINT64_MAX, ret_sum, err);
	if (rc == 0)
		rc = grid_scan(r, 0, UINT64_MAX, gather_sink, g, err);
	grid_close(grid);
	free(memory);
	return rc;
}

/* A dataset "m" of one segment with several sources, one of them removed, and cells of many kinds. */
static struct grid_segment_info make_dataset(const struct folder *f, struct set *ret_sorted, uint64_t seed)
{
	struct set s = set_make(SHAPE_CLUSTERED, 5000, 5, seed);
	struct grid_segment_info info;
	struct err err = ERR_INIT;

	for (size_t i = 0; i < 2500; i++)
		s.pts[i].x = s.pts[i].y = 12345; /* three blocks */
	CHECK(stage_set(f, seed == 1 ? "one" : "two", &s, 0, &info, &err));
	struct grid_manifest m = manifest_of(&info, 1, 5);

	m.sources[3].removed = 2;
	m.generation = 2;
	CHECK(grid_manifest_write(f->fd, "m", &m, &err));
	free(m.sources);
	set_sort(&s);
	*ret_sorted = s;
	return info;
}

static void must_be_found(const struct folder *f, const char *file, size_t place)
{
	struct gather g = {0};
	struct digest sum;
	struct err err = ERR_INIT;
	int rc = read_all(f, &g, &sum, &err);

	if (rc != -ERR_CORRUPT && rc != -ERR_VERSION)
		print_error("byte %zu of %s: %d\n", place, file, rc);
	assert_true(rc == -ERR_CORRUPT || rc == -ERR_VERSION);
	assert_int_equal(err.code, -rc);
	assert_string_equal(err.file, file);
	free(g.pts);
}

static void flips(const char *file, bool all)
{
	struct folder f = folder_new();
	struct set s;
	struct grid_segment_info info = make_dataset(&f, &s, 1);
	const char *name = strcmp(file, "seg") ? file : info.file;
	struct bytes b = load(&f, name);
	struct gather g = {0};
	struct digest sum;
	struct err err = ERR_INIT;
	uint64_t rng = 77;
	size_t tried = 0;

	CHECK(read_all(&f, &g, &sum, &err));
	assert_int_equal(g.n, s.n);
	assert_true(digest_equal(sum, info.sum));
	for (size_t i = 0; i < b.n; i += all ? 1 : 1 + random_below(&rng, 40)) {
		poke(&f, name, i, b.at[i] ^ (uint8_t)(1u << random_below(&rng, 8)));
		must_be_found(&f, name, i);
		poke(&f, name, i, b.at[i]);
		tried++;
	}
	for (int i = 0; i < 200; i++) { /* truncated, or longer */
		size_t n = random_below(&rng, b.n);

		store(&f, name, b.at, n);
		must_be_found(&f, name, n);
	}
	b.at[b.n] = 0;
	store(&f, name, b.at, b.n + 1);
	must_be_found(&f, name, b.n + 1);
	store(&f, name, b.at, b.n);
	g.n = 0;
	CHECK(read_all(&f, &g, &sum, &err));
	print_message("%s: %zu bytes changed\n", file, tried);
	free(g.pts);
	free(b.at);
	set_free(&s);
	folder_remove(&f);
}

static void test_segment_flips(void **state)
{
	flips("seg", false);
}

static void test_manifest_flips(void **state)
{
	flips("m", true);
}

/* Another segment under the same name; parts of it moved. All checksums in them are valid. */
static void test_exchanged(void **state)
{
	struct folder f = folder_new();
	struct set s, other;
	struct grid_segment_info two = make_dataset(&f, &other, 2), one = make_dataset(&f, &s, 1);
	struct bytes b = load(&f, one.file), o = load(&f, two.file);
	uint64_t rng = 5;

	store(&f, one.file, o.at, o.n);
	must_be_found(&f, one.file, 0);
	for (int i = 0; i < 300; i++) {
		size_t n = 16 * (1 + random_below(&rng, 1200)), from = 16 * random_below(&rng, (b.n - n) / 16);
		size_t to = i % 2 ? from : 4096 + 16 * random_below(&rng, (b.n - n - 4096) / 16);
		const uint8_t *source = i % 2 ? o.at : b.at; /* the other one at the same place, or the same one elsewhere */

		if (i % 2 && from + n > o.n)
			continue;
		if (!memcmp(b.at + to, source + from, n))
			continue;
		uint8_t *mixed = malloc(b.n);

		memcpy(mixed, b.at, b.n);
		memcpy(mixed + to, source + from, n);
		store(&f, one.file, mixed, b.n);
		must_be_found(&f, one.file, to);
		free(mixed);
	}
	free(b.at);
	free(o.at);
	set_free(&s);
	set_free(&other);
	folder_remove(&f);
}

/* Blocks and pages of another segment that differs only in heights: each is intact and at the right place. */
static void test_stale(void **state)
{
	struct folder f = folder_new();
	struct set s = set_make(SHAPE_CLUSTERED, 20000, 5, 1), other = set_make(SHAPE_CLUSTERED, 20000, 5, 1);
	struct grid_segment_info one, two;
	struct err err = ERR_INIT;
	uint64_t root;

	for (size_t i = 0; i < s.n; i++) {
		s.pts[i].z = other.pts[i].z + 7;
		if (i < 2500) /* a cell of several blocks */
			s.pts[i].x = s.pts[i].y = other.pts[i].x = other.pts[i].y = 12345;
	}
	CHECK(stage_set(&f, "two", &other, 0, &two, &err));
	CHECK(stage_set(&f, "one", &s, 0, &one, &err));
	struct grid_manifest m = manifest_of(&one, 1, 5);

	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	struct bytes b = load(&f, one.file), o = load(&f, two.file);

	assert_int_equal(b.n, o.n);
	memcpy(&root, b.at + 88, sizeof root);
	const size_t cuts[] = {0, 4096, root, root + 16384, b.n};

	for (unsigned mask = 1; mask < 15; mask++) { /* every combination of header, blocks, index, sources */
		uint8_t *mixed = malloc(b.n);

		for (unsigned i = 0; i < 4; i++)
			memcpy(mixed + cuts[i], (mask >> i & 1 ? o.at : b.at) + cuts[i], cuts[i + 1] - cuts[i]);
		store(&f, one.file, mixed, b.n);
		must_be_found(&f, one.file, mask);
		free(mixed);
	}
	free(b.at);
	free(o.at);
	free(m.sources);
	set_free(&s);
	set_free(&other);
	folder_remove(&f);
}

/* Runs are read once, when sealing. */
static void test_run_flips(void **state)
{
	struct folder f = folder_new();
	struct set s = set_make(SHAPE_DUPLICATES, 1500, 3, 8);
	struct grid_stage_params params = {f.fd, "r", GRID_STAGE_MIN, true};
	uint64_t rng = 6;
	size_t size = 1, tried = 0;

	for (size_t place = 0; place < size; place += 1 + random_below(&rng, 30)) {
		struct grid_segment_info info;
		struct grid_stage *stage;
		struct err err = ERR_INIT;

		CHECK(grid_stage_new(&params, &stage, &err));
		for (unsigned i = 0; i < 3; i++) {
			CHECK(grid_stage_source(stage, 1 + i, &err));
			CHECK(grid_stage_add(stage, s.pts + i * 500, 500, &err));
		}
		CHECK(grid_stage_sync(stage, &err));
		struct bytes b = load(&f, "r.0.run");

		size = b.n;
		if (place % 7 == 3)
			store(&f, "r.0.run", b.at, place);
		else
			poke(&f, "r.0.run", place, b.at[place] ^ (uint8_t)(1u << random_below(&rng, 8)));
		assert_int_equal(grid_stage_seal(stage, &info, &err), -ERR_CORRUPT);
		assert_string_equal(err.file, "r.0.run");
		grid_stage_free(stage);
		assert_int_equal(folder_files(&f, ""), 0);
		free(b.at);
		tried++;
	}
	print_message("run: %zu bytes changed\n", tried);
	set_free(&s);
	folder_remove(&f);
}

/* ---- valid checksums, wrong content ---- */

static void note_damage(void *ctx, const struct err *err)
{
	if (!*(char *)ctx)
		snprintf(ctx, sizeof err->message, "%s", err->message);
}

static const char *verified(const struct folder *f, const struct grid_segment_info *info, char message[])
{
	struct grid_verify_params p = {
		.dirfd = f->fd, .memory = malloc(GRID_VERIFY_BYTES), .damaged = note_damage, .ctx = message};
	struct grid_segment_info one = *info;
	struct grid_manifest m = manifest_of(&one, 1, 5);
	struct err err = ERR_INIT;

	*message = '\0';
	CHECK(grid_verify_segment(&p, &m, 0, &err));
	free(m.sources);
	free(p.memory);
	return message;
}

/* As a forger would do it: makes each checksum that of the bytes. */
static void reseal(struct bytes b, struct disk_leaf *leaf)
{
	struct disk_segment *head = (struct disk_segment *)b.at;
	struct disk_page *page = (struct disk_page *)(b.at + head->root);
	struct disk_block *block = (struct disk_block *)(b.at + leaf->place);
	size_t bytes = disk_head_bytes(block);

	block->records_check = grid_check((uint8_t *)block + bytes, block->records * sizeof(struct point), leaf->place);
	leaf->check -= block->check;
	block->check = grid_check((uint8_t *)block + 8, bytes - 8, leaf->place);
	leaf->check += block->check;
	page->check = grid_check((uint8_t *)page + 8, DISK_PAGE - 8, head->root);
	head->root_check = page->check;
	head->check = grid_check(b.at + 8, DISK_HEADER - 8, 0);
}

/* An imported segment is verified before its records are used. */
static void test_out_of_place(void **state)
{
	struct folder f = folder_new();
	struct set s;
	struct grid_segment_info info = make_dataset(&f, &s, 1);
	char message[sizeof((struct err *)0)->message];

	(void)state;
	assert_string_equal(verified(&f, &info, message), "");
	for (unsigned way = 0; way < 7; way++) {
		struct bytes b = load(&f, info.file);
		struct disk_segment *head = (struct disk_segment *)b.at;
		struct disk_leaf *leaf = (struct disk_leaf *)(b.at + head->root + sizeof(struct disk_page));
		struct disk_block *block = (struct disk_block *)(b.at + leaf->place);
		struct point *pts = (struct point *)((uint8_t *)block + disk_head_bytes(block)), first = *pts;
		uint32_t last = block->records - 1;

		assert_int_equal(head->height, 1);
		assert_true(leaf->blocks == 1 && leaf->box[0] < leaf->box[2] && leaf->box[1] < leaf->box[3]);
		if (way >= 1 && way <= 4) {
			leaf->box[way - 1] += way <= 2 ? 1 : -1;
		} else if (way == 5) {
			pts[0] = pts[last];
			pts[last] = first;
		} else if (way == 6) {
			leaf->lo = point_morton(pts[last].x, pts[last].y);
			leaf->bits = 0;
		}
		reseal(b, leaf);
		store(&f, info.file, b.at, b.n);
		assert_string_equal(verified(&f, &info, message),
				    way ? "the segment is damaged: a record is outside of its cell, or out of order" : "");
		free(b.at);
		set_free(&s);
		folder_remove(&f);
		f = folder_new();
		info = make_dataset(&f, &s, 1);
	}
	set_free(&s);
	folder_remove(&f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_segment_flips), cmocka_unit_test(test_manifest_flips), cmocka_unit_test(test_exchanged),
		cmocka_unit_test(test_stale),         cmocka_unit_test(test_run_flips),      cmocka_unit_test(test_out_of_place),
	};

	no_sync();
	return cmocka_run_group_tests_name("grid: damage", tests, NULL, NULL);
}
