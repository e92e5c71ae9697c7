/*
 * Files of lines of a dataset: their names before and after a commit, the line set and its places, which are read in pages; what
 * a failed build leaves, which is nothing; and every changed byte of a file is found.
 */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "breaklines.h"
#include "err.h"
#include "grid_stage.h"
#include "lattice.h"
#include "repeat.h"

enum { PUSH = 7, SET = 9, MEMORY = 4 << 20 };

static char path[128];
static int dirfd = -1;
static const struct lattice lattice = {.scale_xy = {1, -2}, .scale_z = {1, -2}};
static struct grid_lines described[2];
static struct grid_source source[2];

static int make_folder(void **state)
{
	repeat_folder(path, sizeof path, "breaklines");
	dirfd = open(path, O_RDONLY | O_DIRECTORY);
	return dirfd < 0;
}

static int remove_folder(void **state)
{
	close(dirfd);
	return repeat_remove(path);
}

static bool there(const char *name)
{
	return faccessat(dirfd, name, F_OK, 0) == 0;
}

/* A line from a to b as source `id`, staged by a push. */
static void stage_line(uint64_t push, unsigned i, const int32_t a[3], const int32_t b[3])
{
	const struct breakline_vertex v[2] = {
		{a[0], a[1], a[2], BREAKLINE_FEATURE | BREAKLINE_LINE, BREAKLINE_HARD, 0, 1},
		{b[0], b[1], b[2], 0, BREAKLINE_HARD, 0, 1},
	};
	struct breakline_writer *w = NULL;
	struct breakline_totals t;
	struct err err = ERR_INIT;
	char name[64];

	source[i] = (struct grid_source){.id = i + 1, .kind = GRID_LINES, .lines = &described[i]};
	breaklines_staged_name(push, source[i].id, name);
	assert_int_equal(breakline_writer_new(dirfd, name, &w, &err), 0);
	assert_int_equal(breakline_write(w, v, 2, &err), 0);
	assert_int_equal(breakline_writer_finish(w, &t, &err), 0);
	breakline_writer_free(w);
	assert_int_equal(breaklines_described(dirfd, name, &t, &described[i], &err), 0);
	assert_true(described[i].lines == 1 && described[i].vertices == 2 && described[i].bytes == 8192);
}

/* Two lines that cross at 5 5, at heights 0 and 10, with their final names. */
static void make_lines(void)
{
	struct err err = ERR_INIT;

	stage_line(PUSH, 0, (const int32_t[3]){0, 0, 0}, (const int32_t[3]){10, 10, 0});
	stage_line(PUSH, 1, (const int32_t[3]){0, 10, 10}, (const int32_t[3]){10, 0, 10});
	for (int i = 0; i < 2; i++)
		assert_int_equal(breaklines_publish(dirfd, PUSH, &source[i], &err), 0);
	assert_true(there("lines-1") && there("lines-2"));
}

static int build(bool strict, uint64_t memory, struct breaklines *ret, struct err *err)
{
	const struct grid_source *lines[2] = {&source[0], &source[1]};
	struct breaklines_params p = {
		.dirfd = dirfd, .lines = lines, .nlines = 2, .id = SET, .memory = memory, .lattice = &lattice, .strict = strict};

	return breaklines_build(&p, ret, err);
}

static void names(void **state)
{
	struct err err = ERR_INIT;

	make_lines();
	stage_line(PUSH * 10 + 1, 0, (const int32_t[3]){0, 0, 0}, (const int32_t[3]){1, 1, 0});
	assert_int_equal(breaklines_discard(dirfd, PUSH, &err), 0);
	assert_false(there("push-7.lines-1") || there("push-7.lines-2"));
	assert_true(there("push-71.lines-1") && there("lines-1") && there("lines-2"));
	assert_int_equal(breaklines_discard(dirfd, PUSH * 10 + 1, &err), 0);
	assert_int_equal(breaklines_remove(dirfd, &source[0], &err), 0);
	assert_int_equal(breaklines_remove(dirfd, &source[0], &err), 0);
	assert_false(there("lines-1"));
}

static void line_set(void **state)
{
	struct breaklines_place place[4];
	struct err err = ERR_INIT;
	struct breaklines made;
	struct digest sum = {0, 0};
	size_t n;

	make_lines();
	assert_int_equal(build(false, MEMORY, &made, &err), 0);
	assert_string_equal(made.segment.file, "vertices-9.seg");
	assert_true(grid_is_line_segment(made.segment.file) && there(made.segment.file) && made.segment.points == made.points);
	assert_false(grid_is_line_segment("vertices-9") || grid_is_line_segment("vertices-09.seg") ||
		     grid_is_line_segment("vertices-9.seg.tmp") || grid_is_line_segment("push-9.seg"));
	assert_true(made.counts.pieces == 4 && made.counts.positions == 5 && made.counts.crossings == 1 && made.points == 6);
	digest_add(&sum, described[0].content);
	digest_add(&sum, described[1].content);
	assert_true(digest_equal(made.lines.content, sum) && made.lines.places == 1 && !made.lines.lines && !made.lines.vertices);
	const struct grid_source set = {.id = SET, .kind = GRID_LINE_VERTICES, .lines = &made.lines};

	assert_int_equal(breaklines_verify(dirfd, &set, NULL, &err), 0);
	assert_int_equal(breaklines_verify(dirfd, &source[0], NULL, &err), 0);
	assert_int_equal(breaklines_verify(dirfd, &source[1], "push-7.lines-2", &err), 0);
	assert_int_equal(breaklines_places(dirfd, &set, 0, 4, place, &n, &err), 0);
	assert_true(n == 1 && place->event == BREAKLINE_CROSSING && place->x == 5 && place->y == 5 && !place->lower &&
		    place->upper == 10);
	assert_int_equal(breaklines_places(dirfd, &set, 1, 4, place, &n, &err), 0);
	assert_int_equal(n, 0);
	/* the files of the second source under the name of the first */
	assert_int_equal(renameat(dirfd, "lines-2", dirfd, "lines-1"), 0);
	assert_int_equal(breaklines_verify(dirfd, &source[0], NULL, &err), -ERR_CORRUPT);
	assert_non_null(strstr(err.message, "not the one"));
	assert_int_equal(breaklines_remove(dirfd, &set, &err), 0);
	assert_false(there("vertices-9.seg") || there("lineset-9") || there("places-9"));
}

static void refused(void **state)
{
	struct err err = ERR_INIT;
	struct breaklines made;

	make_lines();
	assert_int_equal(build(true, MEMORY, &made, &err), -ERR_INPUT);
	assert_string_equal(err.message, "lines cross at 0.05 0.05 with heights 0 and 0.1");
	assert_non_null(strstr(err.hint, "--strict"));
	assert_false(there("vertices-9.seg") || there("lineset-9") || there("places-9") || there("places-9.tmp"));
	err = ERR_INIT;
	assert_int_equal(build(false, 64, &made, &err), -ERR_LIMIT);
	assert_true(err.need > 64);
	assert_false(there("vertices-9.seg") || there("lineset-9") || there("places-9") || there("lineset-9.tmp"));
}

/* Each byte of each file in turn. */
static void damage(void **state)
{
	static const char *const names[] = {"lineset-9", "places-9", "lines-1"};
	struct err err = ERR_INIT;
	struct breaklines made;

	make_lines();
	assert_int_equal(build(false, MEMORY, &made, &err), 0);
	const struct grid_source set = {.id = SET, .kind = GRID_LINE_VERTICES, .lines = &made.lines};

	for (unsigned i = 0; i < sizeof names / sizeof *names; i++) {
		int fd = openat(dirfd, names[i], O_RDWR);
		struct stat st;

		assert_true(fd >= 0 && fstat(fd, &st) == 0);
		for (off_t at = 0; at < st.st_size; at += i == 1 ? 1 : 7) {
			uint8_t c, x;

			assert_int_equal(pread(fd, &c, 1, at), 1);
			x = c ^ 4;
			assert_int_equal(pwrite(fd, &x, 1, at), 1);
			err = ERR_INIT;
			if (!breaklines_verify(dirfd, i == 2 ? &source[0] : &set, NULL, &err))
				fail_msg("%s: byte %ld", names[i], (long)at);
			assert_string_equal(err.file, names[i]);
			assert_int_equal(pwrite(fd, &c, 1, at), 1);
		}
		err = ERR_INIT;
		assert_int_equal(breaklines_verify(dirfd, i == 2 ? &source[0] : &set, NULL, &err), 0);
		assert_int_equal(ftruncate(fd, st.st_size + 1), 0);
		assert_int_equal(breaklines_verify(dirfd, i == 2 ? &source[0] : &set, NULL, &err), -ERR_CORRUPT);
		assert_int_equal(ftruncate(fd, st.st_size), 0);
		close(fd);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(names), cmocka_unit_test(line_set), cmocka_unit_test(refused),
					   cmocka_unit_test(damage)};

	return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
