/*
 * Rewriting segments: the file is the one that a seal of the same records writes; damage is found; nothing is left
 * behind. Then pushes, removals, merges and prunes in any order, against a model that is a list of records, leave every
 * readable generation unchanged.
 */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "grid_block.h"
#include "grid_fixture.h"
#include "grid_rewrite.h"

enum { PLENTY = 8 << 20 };

static struct set set_part(const struct set *all, bool (*wanted)(uint32_t id, void *ctx), void *ctx)
{
	struct set s = {malloc((all->n + 1) * sizeof *s.pts), malloc((all->n + 1) * sizeof *s.ids), 0};

	for (size_t i = 0; i < all->n; i++) {
		if (!wanted(all->ids[i], ctx))
			continue;
		s.pts[s.n] = all->pts[i];
		s.ids[s.n++] = all->ids[i];
	}
	return s;
}

static int rewrite(const struct folder *f, const char *name, const struct grid_segment_info *segments, size_t n,
		   const uint32_t *drop, size_t ndrop, size_t memory, struct grid_segment_info *ret, struct err *err)
{
	struct grid_rewrite_params p = {.dirfd = f->fd,
					.segments = segments,
					.nsegments = n,
					.nsources = 100,
					.name = name,
					.drop = drop,
					.ndrop = ndrop,
					.memory = memory};
	struct grid_rewrite *w;
	int rc;

	if (!memory)
		p.memory = grid_rewrite_min_bytes(segments, n, p.nsources);
	rc = grid_rewrite_new(&p, &w, err);
	if (rc)
		return rc;
	while (!(rc = grid_rewrite_step(w, err)))
		;
	if (rc < 0) {
		grid_rewrite_free(w);
		return rc;
	}
	return grid_rewrite_finish(w, ret, err);
}

static char *slurp(const struct folder *f, const char *name, size_t *ret_n)
{
	int fd = openat(f->fd, name, O_RDONLY | O_CLOEXEC);
	off_t n = lseek(fd, 0, SEEK_END);
	char *bytes = malloc((size_t)n + 1);

	assert_true(fd >= 0 && n >= 0);
	assert_int_equal(pread(fd, bytes, (size_t)n, 0), n);
	close(fd);
	*ret_n = (size_t)n;
	return bytes;
}

static void same_file(const struct folder *f, const char *a, const char *b)
{
	size_t n, m;
	char *p = slurp(f, a, &n), *q = slurp(f, b, &m);

	assert_int_equal(n, m);
	assert_memory_equal(p, q, n);
	free(p);
	free(q);
}

static void same_info(struct grid_segment_info a, struct grid_segment_info b)
{
	memset(a.file, 0, sizeof a.file);
	memset(b.file, 0, sizeof b.file);
	assert_memory_equal(&a, &b, sizeof a);
}

struct split {
	unsigned parts, part;
};

static bool in_split(uint32_t id, void *ctx)
{
	const struct split *s = ctx;

	return id % s->parts == s->part;
}

static bool stays(uint32_t id, void *ctx)
{
	return id % 3 != 1;
}

/* Segments by source, each a part of `all`. */
static void seal_parts(const struct folder *f, const struct set *all, unsigned parts, struct grid_segment_info *ret)
{
	struct err err = ERR_INIT;

	for (unsigned i = 0; i < parts; i++) {
		struct split split = {parts, i};
		struct set s = set_part(all, in_split, &split);
		char name[16];

		snprintf(name, sizeof name, "part%u", i);
		CHECK(stage_set(f, name, &s, 0, &ret[i], &err));
		set_free(&s);
	}
}

static void try_same(enum shape shape, size_t n, unsigned sources, unsigned parts, size_t memory)
{
	struct folder f = folder_new();
	struct set all = set_make(shape, n, sources, 7 * n + parts), some = set_part(&all, stays, NULL);
	struct grid_segment_info part[16], whole, left, made;
	struct err err = ERR_INIT;
	uint32_t drop[64];
	size_t ndrop = 0;

	for (uint32_t id = 1; id <= sources; id++)
		if (!stays(id, NULL))
			drop[ndrop++] = id;
	seal_parts(&f, &all, parts, part);
	CHECK(stage_set(&f, "whole", &all, 0, &whole, &err));
	CHECK(stage_set(&f, "left", &some, 0, &left, &err));
	CHECK(rewrite(&f, "made", part, parts, NULL, 0, memory, &made, &err));
	same_file(&f, whole.file, made.file);
	same_info(whole, made);
	CHECK(rewrite(&f, "some", part, parts, drop, ndrop, memory, &made, &err));
	same_file(&f, left.file, made.file);
	same_info(left, made);
	/* The merged segment again, without some sources. */
	CHECK(rewrite(&f, "again", &whole, 1, drop, ndrop, memory, &made, &err));
	same_file(&f, left.file, made.file);
	set_free(&all);
	set_free(&some);
	folder_remove(&f);
}

static void test_same(void **state)
{
	int before = (int)open_descriptors();

	for (enum shape s = 0; s < SHAPES; s++) {
		try_same(s, 20000, 12, 4, 0);
		try_same(s, 20000, 60, 7, PLENTY);
		try_same(s, 3000, 1, 1, 0);
		try_same(s, 1, 1, 2, 0);
	}
	try_same(SHAPE_UNIFORM, 400000, 5, 3, 0); /* an index of two levels */
	assert_int_equal(open_descriptors(), before);
}

/* Ranges of keys, one after the other, have all records once, as a dataset of them says. */
static void try_ranges(const struct folder *f, const struct set *all, const struct grid_segment_info *part, unsigned parts,
		       const uint64_t *border, unsigned n, const struct grid_manifest *whole)
{
	struct grid_segment_info made[17];
	struct grid_manifest m = *whole;
	struct err err = ERR_INIT;
	uint64_t points = 0, rng = 9, lo, hi;
	struct reader r;

	for (unsigned i = 0; i <= n; i++) {
		struct grid_rewrite_params p = {.dirfd = f->fd,
						.segments = part,
						.nsegments = parts,
						.nsources = 100,
						.memory = PLENTY,
						.part = true,
						.lo = i ? border[i - 1] : 0,
						.hi = i < n ? border[i] - 1 : UINT64_MAX};
		char name[16];
		struct grid_rewrite *w;
		int rc;

		snprintf(name, sizeof name, "range%u", i);
		p.name = name;
		CHECK(grid_rewrite_new(&p, &w, &err));
		while (!(rc = grid_rewrite_step(w, &err)))
			;
		assert_int_equal(rc, GRID_REWRITE_DONE);
		CHECK(grid_rewrite_finish(w, &made[i], &err));
		points += made[i].points;
		if (made[i].points) {
			assert_true(point_morton(made[i].box[2], made[i].box[3]) >= p.lo);
			assert_true(point_morton(made[i].box[0], made[i].box[1]) <= p.hi);
		}
	}
	assert_int_equal(points, all->n);
	m.segments = made;
	m.nsegments = n + 1;
	CHECK(grid_manifest_write(f->fd, "ranges", &m, &err));
	r = reader_open(f, "ranges", GRID_NEWEST, 1 << 20);
	reader_check(&r, all, 0, UINT64_MAX, true);
	for (unsigned i = 0; i < 20; i++) {
		random_range(all, &rng, &lo, &hi);
		reader_check(&r, all, lo, hi, false);
	}
	reader_close(&r);
}

static int by_size(const void *a, const void *b)
{
	uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;

	return x < y ? -1 : x > y;
}

static void test_ranges(void **state)
{
	for (enum shape shape = 0; shape < SHAPES; shape++) {
		struct folder f = folder_new();
		struct set all = set_make(shape, shape ? 30000 : 400000, 12, 5 + shape);
		struct grid_segment_info part[3];
		struct err err = ERR_INIT;
		struct grid_manifest m;
		uint64_t border[16], rng = 3;

		seal_parts(&f, &all, 3, part);
		m = manifest_of(part, 3, 12);
		manifest_count(&m, &all);
		set_sort(&all);
		try_ranges(&f, &all, part, 3, border, 0, &m);
		/* Where one of the segments has the same number before and behind. */
		CHECK(grid_segment_divide(f.fd, &part[1], 4, border, &err));
		assert_true(border[0] <= border[1] && border[1] <= border[2]);
		if (shape == SHAPE_UNIFORM) {
			uint64_t before = 0, of = 0;

			for (size_t i = 0; i < all.n; i++) {
				of += all.ids[i] % 3 == 1;
				before += all.ids[i] % 3 == 1 && point_morton(all.pts[i].x, all.pts[i].y) < border[1];
			}
			assert_true(before + 2048 > of / 2 && before < of / 2 + 2048);
		}
		if (border[0] && border[2] < UINT64_MAX)
			try_ranges(&f, &all, part, 3, border, 3, &m);
		/* Anywhere, and at records. */
		for (unsigned i = 0; i < 8; i++) {
			const struct point *at = &all.pts[random_below(&rng, all.n)];

			border[i] = i % 2 ? random_next(&rng) | 1 : point_morton(at->x, at->y) + i / 4;
			border[i] += !border[i];
		}
		qsort(border, 8, sizeof *border, by_size);
		try_ranges(&f, &all, part, 3, border, 8, &m);
		free(m.sources);
		set_free(&all);
		folder_remove(&f);
	}
}

static void test_nothing(void **state)
{
	struct folder f = folder_new();
	struct set none = set_make(SHAPE_UNIFORM, 0, 1, 1), one = set_make(SHAPE_UNIFORM, 100, 1, 1);
	struct grid_segment_info whole, part[2], made;
	struct err err = ERR_INIT;
	const uint32_t drop = 1;

	CHECK(stage_set(&f, "none", &none, 0, &whole, &err));
	CHECK(stage_set(&f, "one", &one, 0, &part[0], &err));
	part[1] = whole;
	CHECK(rewrite(&f, "made", part, 2, &drop, 1, 0, &made, &err));
	same_file(&f, whole.file, made.file);
	CHECK(rewrite(&f, "none2", NULL, 0, NULL, 0, 0, &made, &err));
	same_file(&f, whole.file, made.file);
	set_free(&none);
	set_free(&one);
	folder_remove(&f);
}

static void test_too_little(void **state)
{
	struct folder f = folder_new();
	struct set all = set_make(SHAPE_UNIFORM, 5000, 4, 1);
	struct grid_segment_info part[2], made;
	struct err err = ERR_INIT;

	seal_parts(&f, &all, 2, part);
	assert_int_equal(rewrite(&f, "made", part, 2, NULL, 0, grid_rewrite_min_bytes(part, 2, 100) - 1, &made, &err),
			 -ERR_LIMIT);
	assert_int_equal(folder_files(&f, ""), 2);
	set_free(&all);
	folder_remove(&f);
}

/* Abandoned in the middle: nothing is left. */
static void test_given_up(void **state)
{
	struct folder f = folder_new();
	struct set all = set_make(SHAPE_UNIFORM, 50000, 4, 1);
	struct grid_segment_info part[2];
	struct grid_rewrite_params p = {
		.dirfd = f.fd, .segments = part, .nsegments = 2, .nsources = 4, .name = "made", .memory = PLENTY};
	struct grid_rewrite *w;
	struct err err = ERR_INIT;
	size_t before = open_descriptors();

	seal_parts(&f, &all, 2, part);
	CHECK(grid_rewrite_new(&p, &w, &err));
	for (int i = 0; i < 3; i++)
		assert_int_equal(grid_rewrite_step(w, &err), 0);
	grid_rewrite_free(w);
	assert_int_equal(folder_files(&f, ""), 2);
	assert_int_equal(open_descriptors(), before);
	set_free(&all);
	folder_remove(&f);
}

/* Any bit of any byte. */
static void test_damage(void **state)
{
	struct folder f = folder_new();
	struct set all = set_make(SHAPE_CLUSTERED, 6000, 9, 3);
	struct grid_segment_info part[3], made;
	uint64_t rng = 5;

	seal_parts(&f, &all, 3, part);
	for (int i = 0; i < 400; i++) {
		const struct grid_segment_info *s = &part[random_below(&rng, 3)];
		uint64_t at = random_below(&rng, i % 4 ? s->bytes : 4096);
		struct err err = ERR_INIT;
		int fd = openat(f.fd, s->file, O_RDWR | O_CLOEXEC);
		uint8_t byte, bad;

		assert_int_equal(pread(fd, &byte, 1, (off_t)at), 1);
		bad = byte ^ (uint8_t)(1 << random_below(&rng, 8));
		assert_int_equal(pwrite(fd, &bad, 1, (off_t)at), 1);
		assert_int_equal(rewrite(&f, "made", part, 3, NULL, 0, 0, &made, &err), -ERR_CORRUPT);
		assert_string_equal(err.file, s->file);
		assert_int_equal(folder_files(&f, ""), 3);
		assert_int_equal(pwrite(fd, &byte, 1, (off_t)at), 1);
		close(fd);
	}
	/* Truncated. */
	for (int i = 0; i < 20; i++) {
		struct err err = ERR_INIT;
		uint64_t at = random_below(&rng, part[0].bytes);
		size_t n;
		char *bytes = slurp(&f, part[0].file, &n);
		int fd = openat(f.fd, part[0].file, O_RDWR | O_CLOEXEC);

		assert_int_equal(ftruncate(fd, (off_t)at), 0);
		assert_int_equal(rewrite(&f, "made", part, 3, NULL, 0, 0, &made, &err), -ERR_CORRUPT);
		assert_int_equal(pwrite(fd, bytes, n, 0), (ssize_t)n);
		close(fd);
		free(bytes);
	}
	set_free(&all);
	folder_remove(&f);
}

static void test_holds(void **state)
{
	struct folder f = folder_new();
	struct set all = set_make(SHAPE_UNIFORM, 5000, 6, 1);
	struct grid_segment_info part[2];
	struct err err = ERR_INIT;
	const uint32_t ids[] = {2, 3, 99};
	uint64_t points, want = 0;

	seal_parts(&f, &all, 2, part);
	for (size_t i = 0; i < all.n; i++)
		want += all.ids[i] == 2;
	CHECK(grid_segment_count_sources(f.fd, &part[0], ids, 3, &points, &err));
	assert_int_equal(points, want);
	CHECK(grid_segment_count_sources(f.fd, &part[0], ids + 1, 2, &points, &err));
	assert_int_equal(points, 0);
	set_free(&all);
	folder_remove(&f);
}

int main(void)
{
	no_sync();
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_same),       cmocka_unit_test(test_ranges),   cmocka_unit_test(test_nothing),
		cmocka_unit_test(test_too_little), cmocka_unit_test(test_given_up), cmocka_unit_test(test_damage),
		cmocka_unit_test(test_holds),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
