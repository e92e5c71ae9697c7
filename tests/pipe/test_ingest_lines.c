/*
 * Lines of an input on the lattice: points along lines by their exact divisions, computed here as fractions, and the same for
 * either direction; equal vertices in a row; levels of lakes; what is refused, with the number of the feature.
 */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cmocka.h>

#include "breakline.h"
#include "err.h"
#include "pipe.h"
#include "random.h"
#include "repeat.h"

enum { MOST = 4096 };

static char path[128];
static int dirfd = -1;

static int make_folder(void **state)
{
	repeat_folder(path, sizeof path, "pipe-lines");
	dirfd = open(path, O_RDONLY | O_DIRECTORY);
	return dirfd < 0;
}

static int remove_folder(void **state)
{
	close(dirfd);
	return repeat_remove(path);
}

struct taken {
	struct breakline_vertex v[MOST];
	size_t n;
	struct pipe_ingested in;
	struct breakline_totals totals;
};

static int take(void *ctx, const struct breakline_vertex *v, size_t n, struct err *err)
{
	struct taken *t = ctx;

	assert_true(t->n + n <= MOST);
	memcpy(t->v + t->n, v, n * sizeof *v);
	t->n += n;
	return 0;
}

/* On a lattice of hundredths whose unit is the foot, to check that lengths are converted. */
static int ingest(const char *text, struct taken *ret, struct err *err)
{
	const struct input_options options = {.format = "lines"};
	const struct lattice lattice = {.scale_xy = {1, -2}, .scale_z = {1, -2}, .k = {1000, -500, 7}};
	struct pipe_ingest_params params = {.lattice = &lattice, .unit_xy = "foot"};
	int fd = memfd_create("lines", MFD_CLOEXEC), r;
	struct input *in = NULL;

	assert_int_equal(pwrite(fd, text, strlen(text), 0), strlen(text));
	if (input_open(fd, "a.txt", &options, &in, err) || breakline_writer_new(dirfd, "lines-1", &params.lines, err))
		fail_msg("%s", err->message);
	memset(ret, 0, sizeof *ret);
	r = pipe_ingest(in, &params, &ret->in, err);
	if (!r) {
		assert_int_equal(breakline_writer_finish(params.lines, &ret->totals, err), 0);
		assert_int_equal(breakline_read(dirfd, "lines-1", take, ret, err), 0);
	}
	breakline_writer_free(params.lines);
	input_close(in);
	close(fd);
	return r;
}

static struct taken got, back;

static void check(const char *text, const int32_t (*want)[3], size_t n, uint64_t dropped, uint64_t added)
{
	struct err err = ERR_INIT;

	if (ingest(text, &got, &err))
		fail_msg("%s: %s", text, err.message);
	if (got.n != n || got.in.vertices_dropped != dropped || got.in.vertices_added != added)
		fail_msg("%s: %zu vertices, %d dropped, %d added", text, got.n, (int)got.in.vertices_dropped,
			 (int)got.in.vertices_added);
	for (size_t i = 0; i < n; i++)
		if (got.v[i].x != want[i][0] || got.v[i].y != want[i][1] || got.v[i].z != want[i][2])
			fail_msg("%s: vertex %zu is %d %d %d", text, i, got.v[i].x, got.v[i].y, got.v[i].z);
}

#define HEAD "acut-lines 1\n"

static void vertices(void **state)
{
	/* lattice numbers: x 100 - 1000, y 100 + 500, z 100 - 7 */
	check(HEAD "feature 5 hard\nline\n11 -4 0.07\n12 -4 0.08\n", (const int32_t[][3]){{100, 100, 0}, {200, 100, 1}}, 2, 0, 0);
	assert_true(got.v[0].bits == (BREAKLINE_FEATURE | BREAKLINE_LINE) && !got.v[1].bits && got.v[1].number == 5);
	assert_true(got.totals.lines == 1 && got.totals.features[BREAKLINE_HARD] == 1 && got.in.points == 2);
	/* equal on the lattice; another height is another vertex */
	check(HEAD "feature 5 hard\nline\n11 -4 0.07\n11.001 -4 0.0701\n11 -4 0.09\n12 -4 0.08\n",
	      (const int32_t[][3]){{100, 100, 0}, {100, 100, 2}, {200, 100, 1}}, 3, 1, 0);
	/* the ring repeats its first vertex, after rounding */
	check(HEAD "feature 5 hard\nring\n11 -4 0.07\n12 -4 0.07\n12 -3 0.07\n11.002 -4.001 0.07\n",
	      (const int32_t[][3]){{100, 100, 0}, {200, 100, 0}, {200, 200, 0}}, 3, 1, 0);
	assert_int_equal(got.v[0].bits, BREAKLINE_FEATURE | BREAKLINE_LINE | BREAKLINE_RING);
	/* all of a line at one position */
	check(HEAD "feature 5 hard\nline\n11 -4 0.07\n11 -4 0.07\n", (const int32_t[][3]){{100, 100, 0}}, 1, 1, 0);
}

static void divisions(void **state)
{
	/* 5 feet are 500: 1000 long, so two parts; half of 1 and of -1 is rounded upwards */
	check(HEAD "densify 5 ft\nfeature 5 hard\nline\n11 -4 0.07\n21 -4 0.08\n",
	      (const int32_t[][3]){{100, 100, 0}, {600, 100, 1}, {1100, 100, 1}}, 3, 0, 1);
	/* a metre is 328.08; the closing side of a ring is divided, too */
	check(HEAD "densify 1 m\nfeature 5 hard\nring\n11 -4 0.07\n14.28 -4 0.07\n14.28 -0.71 0.07\n",
	      (const int32_t[][3]){{100, 100, 0}, {428, 100, 0}, {428, 265, 0}, {428, 429, 0}, {264, 265, 0}}, 5, 0, 2);
}

/* Random segments both ways: as few parts as suffice, each point the nearest to its fraction, halves upwards. */
static void both_ways(void **state)
{
	uint64_t rng = 7;

	for (int i = 0; i < 300; i++) {
		int64_t a[3], b[3], dx, dy, parts;
		char text[2][256];
		struct err err = ERR_INIT;

		for (int k = 0; k < 3; k++) {
			a[k] = (int64_t)random_below(&rng, 4000) - 2000;
			b[k] = (int64_t)random_below(&rng, 4000) - 2000;
		}
		for (int w = 0; w < 2; w++) {
			const int64_t *p = w ? b : a, *q = w ? a : b;

			snprintf(text[w], sizeof text[w],
				 HEAD "densify 1.5\nfeature 1 hard\nline\n%.2f %.2f %.2f\n%.2f %.2f %.2f\n", (double)p[0] / 100,
				 (double)p[1] / 100, (double)p[2] / 100, (double)q[0] / 100, (double)q[1] / 100,
				 (double)q[2] / 100);
		}
		assert_int_equal(ingest(text[0], &got, &err), 0);
		assert_int_equal(ingest(text[1], &back, &err), 0);
		assert_int_equal(got.n, back.n);
		for (size_t k = 0; k < got.n; k++)
			assert_true(got.v[k].x == back.v[got.n - 1 - k].x && got.v[k].y == back.v[got.n - 1 - k].y &&
				    got.v[k].z == back.v[got.n - 1 - k].z);
		dx = b[0] - a[0];
		dy = b[1] - a[1];
		parts = (int64_t)got.n - 1;
		assert_true(dx * dx + dy * dy <= parts * parts * 22500);
		assert_true(parts == 1 || dx * dx + dy * dy > (parts - 1) * (parts - 1) * 22500);
		for (int64_t k = 0; k <= parts; k++) {
			/* |2 (x - from) n - 2 d k| <= n: nearest */
			int64_t off[3] = {2 * (got.v[k].x + 1000 - a[0]) * parts - 2 * dx * k,
					  2 * (got.v[k].y - 500 - a[1]) * parts - 2 * dy * k,
					  2 * (got.v[k].z + 7 - a[2]) * parts - 2 * (b[2] - a[2]) * k};

			for (int j = 0; j < 3; j++)
				assert_true(off[j] >= -parts && off[j] <= parts);
		}
	}
}

static void levels(void **state)
{
#define LAKE "feature 9 lake\nring\n11 -4 0.07\n12 -4 0.10\n12 -3 0.08\nring\n11 -4 1.07\n12 -4 1.07\n12 -3 1.07\n"
	static const char *const level[] = {"min", "max", "mean"};
	static const int32_t z[] = {0, 100, 51}; /* of the shore and the island */

	for (int i = 0; i < 3; i++) {
		char text[256];

		snprintf(text, sizeof text, HEAD "lake-level %s\n" LAKE, level[i]);
		check(text,
		      (const int32_t[][3]){{100, 100, z[i]},
					   {200, 100, z[i]},
					   {200, 200, z[i]},
					   {100, 100, z[i]},
					   {200, 100, z[i]},
					   {200, 200, z[i]}},
		      6, 0, 0);
		assert_int_equal(got.totals.features[BREAKLINE_LAKE], 1);
	}
	/* z that are the same on the lattice are one level */
	check(HEAD "feature 9 lake\nring\n11 -4 0.0701\n12 -4 0.0699\n12 -3 0.07\n",
	      (const int32_t[][3]){{100, 100, 0}, {200, 100, 0}, {200, 200, 0}}, 3, 0, 0);
}

static void refused(void **state)
{
	static const struct {
		const char *text, *says;
		enum err_code code;
	} rows[] = {
		{HEAD LAKE, "it is a lake, and the z of its rings are not the same: 0.07 and 0.1", ERR_INPUT},
		{HEAD "feature 9 lake\nring\n11 -4 1\n12 -4 1\n12 -3 1\nring\n11 -4 2\n12 -4 2\n12 -3 2\n",
		 "not the same: 1 and 2", ERR_INPUT},
		{HEAD "densify 0.001\nfeature 9 hard\nline\n0 0 0\n1 1 1\n", "below the scale", ERR_INPUT},
		{HEAD "densify 0.01\nfeature 9 hard\nline\n0 0 0\n200000 1 1\n", "divided into", ERR_LIMIT},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct err err = ERR_INIT;

		if (ingest(rows[i].text, &got, &err) != -(int)rows[i].code || !strstr(err.message, rows[i].says) || !*err.hint ||
		    strcmp(err.file, "a.txt"))
			fail_msg("%s: %d: %s", rows[i].text, (int)err.code, err.message);
		assert_int_not_equal(faccessat(dirfd, "lines-1.tmp", F_OK, 0), 0);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(vertices), cmocka_unit_test(divisions), cmocka_unit_test(both_ways),
		cmocka_unit_test(levels),   cmocka_unit_test(refused),
	};

	return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
