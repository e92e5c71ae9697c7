/*
 * Ranges of keys in the manifest: they are those of the records after every way of writing a segment, older manifests are read
 * without them, verification finds a false one, and a grid that opens segments late opens only those whose range is read.
 */
#include <fcntl.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>
#include <xxhash.h>

#include "grid_file.h"
#include "grid_fixture.h"
#include "grid_rewrite.h"
#include "grid_verify.h"

static uint64_t key_of(const struct point *p)
{
	return point_morton(p->x, p->y);
}

/* ---- ranges are true ---- */

static struct grid_segment_info rewritten(const struct folder *f, const struct grid_segment_info *info, size_t n,
					  const struct grid_rewrite_params *how)
{
	struct grid_rewrite_params p = *how;
	struct grid_segment_info made;
	struct grid_rewrite *w;
	struct err err = ERR_INIT;
	int r;

	p.dirfd = f->fd;
	p.segments = info;
	p.nsegments = n;
	p.nsources = 9;
	p.name = "made";
	p.memory = grid_rewrite_min_bytes(info, n, 9);
	CHECK(grid_rewrite_new(&p, &w, &err));
	while ((r = grid_rewrite_step(w, &err)) == 0)
		;
	assert_int_equal(r, GRID_REWRITE_DONE);
	CHECK(grid_rewrite_finish(w, &made, &err));
	return made;
}

/* The first and last key of the sorted records from lo to hi without those of source `drop`. */
static void assert_range(const struct grid_segment_info *info, const struct set *sorted, uint64_t lo, uint64_t hi, uint32_t drop)
{
	uint64_t first = 0, last = 0, n = 0;

	for (size_t i = 0; i < sorted->n; i++) {
		uint64_t key = key_of(&sorted->pts[i]);

		if (key < lo || key > hi || sorted->ids[i] == drop)
			continue;
		first = n++ ? first : key;
		last = key;
	}
	assert_int_equal(info->points, n);
	assert_true(info->lo == first && info->hi == last);
}

static void test_exact(void **state)
{
	for (int shape = 0; shape < SHAPES; shape++) {
		struct folder f = folder_new();
		struct set s = set_make(shape, 8000, 3, 11);
		struct grid_segment_info info[3];
		struct err err = ERR_INIT;
		uint32_t two = 2;
		uint64_t rng = 5, lo, hi;

		stage_sources(&f, &s, 3, info);
		set_sort(&s);
		struct grid_segment_info all = rewritten(&f, info, 3, &(struct grid_rewrite_params){0});

		assert_range(&all, &s, 0, UINT64_MAX, 0);
		all = rewritten(&f, info, 3, &(struct grid_rewrite_params){.drop = &two, .ndrop = 1});
		assert_range(&all, &s, 0, UINT64_MAX, 2);
		for (int i = 0; i < 8; i++) {
			random_range(&s, &rng, &lo, &hi);
			all = rewritten(&f, info, 3, &(struct grid_rewrite_params){.part = true, .lo = lo, .hi = hi});
			assert_range(&all, &s, lo, hi, 0);
		}
		CHECK(stage_set(&f, "some", &s, GRID_STAGE_MIN, &all, &err));
		assert_range(&all, &s, 0, UINT64_MAX, 0);
		s.n = 0;
		CHECK(stage_set(&f, "none", &s, 0, &all, &err));
		assert_true(!all.lo && !all.hi);
		s.n = 1;
		set_free(&s);
		folder_remove(&f);
	}
}

/* ---- older manifests ---- */

/* Makes version 7 of a manifest with one segment, the class entries of which end at the range. */
static void make_old(const struct folder *f, const struct grid_segment_info *info)
{
	uint8_t bytes[4096], *at;
	int fd = openat(f->fd, "m", O_RDWR);
	size_t n = (size_t)pread(fd, bytes, sizeof bytes, 0);
	uint64_t size = n - 16, check;
	uint32_t version = 7;

	at = memmem(bytes, n, &info->lo, sizeof info->lo);
	assert_non_null(at);
	assert_memory_equal(at + 8, &info->hi, sizeof info->hi);
	memmove(at, at + 16, (size_t)(bytes + n - at) - 16);
	memcpy(bytes + 8, &version, sizeof version);
	memcpy(bytes + 16, &size, sizeof size);
	check = XXH3_64bits(bytes, size - 8);
	memcpy(bytes + size - 8, &check, sizeof check);
	assert_int_equal(pwrite(fd, bytes, size, 0), size);
	assert_int_equal(ftruncate(fd, (off_t)size), 0);
	close(fd);
}

static void test_older(void **state)
{
	struct folder f = folder_new();
	struct set s = set_make(SHAPE_CLUSTERED, 9000, 1, 3);
	struct grid_segment_info info;
	struct grid_manifest m, *back;
	struct err err = ERR_INIT;
	struct reader r;

	CHECK(stage_set(&f, "a", &s, 0, &info, &err));
	m = manifest_of(&info, 1, 1);
	set_sort(&s);
	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	make_old(&f, &info);
	CHECK(grid_manifest_read(f.fd, "m", &back, &err));
	assert_true(back->segments[0].lo == point_morton(info.box[0], info.box[1]));
	assert_true(back->segments[0].hi == point_morton(info.box[2], info.box[3]));
	assert_true(back->segments[0].lo <= info.lo && back->segments[0].hi >= info.hi);
	assert_memory_equal(back->segments[0].classes, info.classes, sizeof info.classes);
	CHECK(grid_manifest_write(f.fd, "m", back, &err)); /* as the next push does */
	grid_manifest_free(back);
	r = reader_open(&f, "m", 1, 1 << 20);
	reader_check(&r, &s, 0, UINT64_MAX, true);
	reader_check(&r, &s, info.lo, info.lo, true);
	reader_close(&r);
	free(m.sources);
	set_free(&s);
	folder_remove(&f);
}

/* ---- verification ---- */

static void note_damage(void *ctx, const struct err *err)
{
	snprintf(ctx, sizeof err->message, "%s", err->message);
}

static void verified(const struct folder *f, const struct grid_segment_info *info, bool good)
{
	char message[sizeof((struct err *)0)->message] = "";
	struct grid_verify_params p = {
		.dirfd = f->fd, .memory = malloc(GRID_VERIFY_BYTES), .damaged = note_damage, .ctx = message};
	struct grid_segment_info one = *info;
	struct grid_manifest m = manifest_of(&one, 1, 5);
	struct err err = ERR_INIT;

	CHECK(grid_verify_segment(&p, &m, 0, &err));
	if (good)
		assert_string_equal(message, "");
	else
		assert_non_null(strstr(message, "range of keys"));
	free(m.sources);
	free(p.memory);
}

/* A range that holds all records is accepted: it may have come from an older manifest. */
static void test_verified(void **state)
{
	for (int shape = 0; shape < SHAPES; shape++) {
		struct folder f = folder_new();
		struct set s = set_make(shape, 9000, 5, 8);
		struct grid_segment_info info, other;
		struct err err = ERR_INIT;

		CHECK(stage_set(&f, "a", &s, 0, &info, &err));
		verified(&f, &info, true);
		other = info;
		other.lo = point_morton(info.box[0], info.box[1]);
		other.hi = point_morton(info.box[2], info.box[3]);
		verified(&f, &other, true);
		if (info.lo < info.hi) {
			other = info;
			other.lo++;
			verified(&f, &other, false);
			other = info;
			other.hi--;
			verified(&f, &other, false);
		}
		set_free(&s);
		folder_remove(&f);
	}
}

/* ---- segments that are opened late ---- */

enum { PARTS = 60 };

struct late {
	struct folder folder;
	struct set sorted;
	struct grid_segment_info info[PARTS];
	struct grid_manifest manifest;
	unsigned opened, refused; /* by count_open; refused: a part that cannot be opened, from 1 on */
};

static int count_open(void *ctx, const char *file, uint64_t bytes, int *ret_fd, struct err *err)
{
	struct late *l = ctx;

	for (unsigned i = 0; i < PARTS; i++)
		if (!strcmp(l->info[i].file, file)) {
			assert_int_equal(bytes, l->info[i].bytes);
			if (i + 1 == l->refused)
				return err_set(err, ERR_NOTFOUND, "it is not there");
		}
	__atomic_fetch_add(&l->opened, 1, __ATOMIC_RELAXED);
	return grid_file_open(l->folder.fd, file, "the segment", ret_fd, err);
}

/* Segments beside each other in the order of keys. Equal keys stay together. */
static struct late *late_make(void)
{
	struct late *l = calloc(1, sizeof *l);
	struct err err = ERR_INIT;
	size_t at = 0, end;

	l->folder = folder_new();
	l->sorted = set_make(SHAPE_UNIFORM, 20000, 1, 77);
	set_sort(&l->sorted);
	for (unsigned i = 0; i < PARTS; i++, at = end) {
		char name[16];
		struct set part = {l->sorted.pts + at, l->sorted.ids + at, 0};

		for (end = l->sorted.n * (i + 1) / PARTS; end < l->sorted.n; end++)
			if (key_of(&l->sorted.pts[end]) != key_of(&l->sorted.pts[end - 1]))
				break;
		part.n = end - at;
		snprintf(name, sizeof name, "p%u", i);
		CHECK(stage_set(&l->folder, name, &part, GRID_STAGE_MIN, &l->info[i], &err));
	}
	l->manifest = manifest_of(l->info, PARTS, 1);
	CHECK(grid_manifest_write(l->folder.fd, "m", &l->manifest, &err));
	return l;
}

static void late_free(struct late *l)
{
	free(l->manifest.sources);
	set_free(&l->sorted);
	folder_remove(&l->folder);
	free(l);
}

static struct reader late_open(struct late *l)
{
	const struct grid_use use = {.late = true, .open = count_open, .open_ctx = l};
	struct reader r = {0};
	struct err err = ERR_INIT;

	l->opened = 0;
	CHECK(grid_open_use(l->folder.fd, "m", GRID_NEWEST, &use, NULL, 1 << 20, &r.grid, &err));
	r.memory = malloc(grid_reader_bytes(r.grid));
	CHECK(grid_reader_new(r.grid, r.memory, grid_reader_bytes(r.grid), &r.r, &err));
	return r;
}

static void test_late(void **state)
{
	struct late *l = late_make();
	struct reader r, all = reader_open(&l->folder, "m", GRID_NEWEST, 1 << 20);
	size_t before = open_descriptors();
	uint64_t rng = 9, lo, hi;

	r = late_open(l);
	assert_int_equal(l->opened, 0);
	assert_true(grid_reopens(r.grid));
	assert_true(digest_equal(grid_content(r.grid), grid_content(all.grid)));
	assert_true(grid_points(r.grid) == grid_points(all.grid) && grid_all_live(r.grid));
	assert_int_equal(grid_reader_bytes(r.grid), grid_reader_bytes(all.grid));
	for (unsigned i = 0; i < PARTS; i++) {
		assert_true(grid_segment_points(r.grid, i) == grid_segment_points(all.grid, i));
		assert_true(digest_equal(grid_segment_content(r.grid, i), grid_segment_content(all.grid, i)));
		assert_int_equal(grid_segment_slots(r.grid, i), grid_segment_slots(all.grid, i));
	}
	/* Whole segments are counted and summed unseen, others are opened alone. */
	reader_check(&r, &l->sorted, l->info[7].lo, l->info[9].hi, true);
	assert_int_equal(l->opened, 3);
	reader_check(&r, &l->sorted, l->info[7].lo + 1, l->info[7].hi - 1, true);
	assert_int_equal(l->opened, 3);
	reader_check(&r, &l->sorted, l->info[20].hi + 1, l->info[21].lo - 1, true); /* between two of them */
	assert_int_equal(l->opened, 3);
	for (int i = 0; i < 30; i++) {
		random_range(&l->sorted, &rng, &lo, &hi);
		reader_check(&r, &l->sorted, lo, hi, true);
	}
	reader_check(&r, &l->sorted, 0, UINT64_MAX, true);
	assert_int_equal(l->opened, PARTS);
	assert_true(open_descriptors() - before <= 129);
	reader_close(&r);
	assert_int_equal(open_descriptors(), before);
	reader_close(&all);
	late_free(l);
}

/* Files of others may be missing; the one that is read is named. */
static void test_late_missing(void **state)
{
	struct late *l = late_make();
	struct grid_segment_info *bad = &l->info[50];
	struct err err = ERR_INIT;
	struct gather g = {0};
	struct reader r;
	uint64_t wrong = 0;
	int fd;

	for (unsigned i = 0; i < PARTS; i += 2)
		if (i != 50)
			assert_int_equal(unlinkat(l->folder.fd, l->info[i].file, 0), 0);
	r = late_open(l);
	reader_check(&r, &l->sorted, l->info[51].lo, l->info[51].hi, true);
	l->refused = 51;
	assert_int_equal(grid_scan(r.r, bad->lo, bad->hi, gather_sink, &g, &err), -ERR_NOTFOUND);
	l->refused = 0;
	reader_check(&r, &l->sorted, bad->lo, bad->hi, true);
	reader_close(&r);
	fd = openat(l->folder.fd, bad->file, O_RDWR);
	assert_int_equal(pwrite(fd, &wrong, sizeof wrong, 0), sizeof wrong);
	close(fd);
	r = late_open(l);
	err_clear(&err);
	assert_int_equal(grid_scan(r.r, bad->lo, bad->hi, gather_sink, &g, &err), -ERR_CORRUPT);
	assert_string_equal(err.file, bad->file);
	err_clear(&err);
	assert_int_equal(grid_scan(r.r, l->info[52].lo, l->info[52].hi, gather_sink, &g, &err), -ERR_CORRUPT);
	assert_string_equal(err.file, l->info[52].file);
	reader_close(&r);
	free(g.pts);
	late_free(l);
}

/* Sources that the manifest does not have, or that are not live: then it is not late. */
static void test_late_sources(void **state)
{
	struct late *l = late_make();
	struct grid_source two[2] = {l->manifest.sources[0], {.id = 2, .added = 1, .removed = 1, .name = ""}};
	struct err err = ERR_INIT;
	struct gather g = {0};
	struct reader r;

	two[0].id = 3;
	free(l->manifest.sources);
	l->manifest.sources = two;
	CHECK(grid_manifest_write(l->folder.fd, "m", &l->manifest, &err));
	r = late_open(l);
	assert_int_equal(grid_scan(r.r, 0, l->info[0].hi, gather_sink, &g, &err), -ERR_CORRUPT);
	assert_non_null(strstr(err.message, "not in the manifest"));
	reader_close(&r);
	two[0].id = 1;
	l->manifest.nsources = 2;
	CHECK(grid_manifest_write(l->folder.fd, "m", &l->manifest, &err));
	r = late_open(l);
	assert_int_equal(l->opened, PARTS);
	reader_check(&r, &l->sorted, 0, UINT64_MAX, true);
	reader_close(&r);
	l->manifest.sources = NULL;
	free(g.pts);
	late_free(l);
}

struct task {
	struct late *late;
	const struct grid *grid;
	uint64_t points;
};

static int count_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	*(uint64_t *)ctx += n;
	return 0;
}

static void *read_all(void *arg)
{
	struct task *t = arg;
	struct err err = ERR_INIT;
	void *memory = malloc(grid_reader_bytes(t->grid));
	struct grid_reader *r;

	if (memory && grid_reader_new(t->grid, memory, grid_reader_bytes(t->grid), &r, &err) == 0 &&
	    grid_scan(r, 0, UINT64_MAX, count_points, &t->points, &err))
		t->points = 0;
	free(memory);
	return NULL;
}

/* All of them open the same segments at once. */
static void test_late_threads(void **state)
{
	enum { THREADS = 6 };
	struct late *l = late_make();
	struct reader r = late_open(l);
	struct task task[THREADS];
	pthread_t thread[THREADS];

	for (unsigned i = 0; i < THREADS; i++) {
		task[i] = (struct task){l, r.grid, 0};
		assert_int_equal(pthread_create(&thread[i], NULL, read_all, &task[i]), 0);
	}
	for (unsigned i = 0; i < THREADS; i++) {
		assert_int_equal(pthread_join(thread[i], NULL), 0);
		assert_int_equal(task[i].points, l->sorted.n);
	}
	reader_close(&r);
	late_free(l);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_exact),        cmocka_unit_test(test_older),        cmocka_unit_test(test_verified),
		cmocka_unit_test(test_late),         cmocka_unit_test(test_late_missing), cmocka_unit_test(test_late_sources),
		cmocka_unit_test(test_late_threads),
	};

	no_sync();
	return cmocka_run_group_tests_name("grid: ranges of keys", tests, NULL, NULL);
}
