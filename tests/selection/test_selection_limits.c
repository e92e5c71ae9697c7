/* What a selection reads and allocates; and how it ends: cancelled, on a full disk, with damaged counts. Its identity. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "account.h"
#include "io.h"
#include "selection_fixture.h"
#include "view_area.h"

/* ---- costs ---- */

static struct io_table counting;
static uint64_t bytes_read;

static ssize_t counting_pread(int fd, void *buf, size_t n, off_t off)
{
	bytes_read += n;
	return io_system.pread(fd, buf, n, off);
}

/* Memory: exactly what it was given. Reading: a crop reads what it contains, a thin rule with many rectangles reads
 * everything about once. */
static void test_bounds(void **state)
{
	struct set set = (rng = 9, survey(400000, 1 << 20, 5000));
	struct dataset d = dataset_of(&set, 1, 1, false);
	const struct io_table *before = io;
	uint64_t all = d.info[0].bytes;
	struct {
		const char *name;
		struct view v;
		double share;
	} rows[5];
	int32_t lo = 300000, hi = 300000 + (1 << 20) / 10;

	counting = *io;
	counting.pread = counting_pread;
	for (unsigned i = 0; i < 5; i++) {
		rows[i].v = VIEW_INIT;
		view_bind(&rows[i].v, &d.m.lattice);
		rows[i].share = 1.1;
	}
	rows[0].name = "crop of a hundredth";
	rows[0].v.crop = VIEW_CROP_BOX;
	for (int k = 0; k < 4; k++)
		rows[0].v.crop_box[k] = (k < 2 ? lo : hi) + rows[0].v.k[k % 2];
	rows[0].share = 0.05; /* cells at its rim are read entirely */
	rows[1].name = "every 10";
	rows[1].v.every = 10;
	rows[2].name = "thin, lowest";
	rows[2].v.thin = (struct view_thin){11500, VIEW_PICK_LOWEST};
	rows[3].name = "thin, median";
	rows[3].v.thin = (struct view_thin){11500, VIEW_PICK_MEDIAN};
	rows[3].share = 1.6;
	rows[4].name = "thin, highest, cropped";
	rows[4].v = rows[0].v;
	rows[4].v.thin = (struct view_thin){3000, VIEW_PICK_HIGHEST};
	rows[4].share = 0.05;
	for (unsigned i = 0; i < 5; i++)
		for (size_t memory = (size_t)2 << 20; memory <= (size_t)32 << 20; memory *= 16) {
			struct folder to = folder_new();
			struct selection_params p = {.grid = d.reader.grid, .view = &rows[i].v, .memory = memory, .dirfd = to.fd};
			struct selection_counts got;
			struct err err = ERR_INIT;

			bytes_read = 0;
			account_begin();
			io = &counting;
			CHECK(selection_make(&p, &got, &err));
			io = before;
			print_message("%-24s %2zu MiB: takes %zu, reads %.3f of the segment, keeps %llu\n", rows[i].name,
				      memory >> 20, account_taken(), (double)bytes_read / (double)all,
				      (unsigned long long)got.kept);
			assert_true(account_taken() <= memory);
			/* Runs are read again when they are merged. */
			assert_true((double)bytes_read <= rows[i].share * (double)all + 17 * (double)got.kept);
			folder_remove(&to);
		}
	dataset_end(&d);
	set_free(&set);
}

/* ---- how it ends ---- */

static int stop_at_once(void *ctx, uint64_t points)
{
	++*(unsigned *)ctx;
	return 1;
}

static void test_cancel(void **state)
{
	struct set set = (rng = 4, survey(600000, 5000, 3));
	struct dataset d = dataset_of(&set, 1, 1, false);
	struct folder to = folder_new();
	struct view v = VIEW_INIT;
	unsigned calls = 0;
	struct selection_params p = {
		.grid = d.reader.grid, .view = &v, .memory = 2 << 20, .dirfd = to.fd, .progress = stop_at_once, .ctx = &calls};
	struct selection_counts got;
	struct err err = ERR_INIT;

	v.every = 2;
	view_bind(&v, &d.m.lattice);
	assert_int_equal(selection_make(&p, &got, &err), -ERR_CANCELLED);
	v.thin.cell = 3;
	assert_int_equal(selection_make(&p, &got, &err), -ERR_CANCELLED);
	assert_int_equal(calls, 2);
	p.memory = selection_memory_min(d.reader.grid, &v) - 1;
	err = ERR_INIT;
	assert_int_equal(selection_make(&p, &got, &err), -ERR_LIMIT);
	assert_int_equal(folder_files(&to, ""), 0);
	folder_remove(&to);
	dataset_end(&d);
	set_free(&set);
}

struct stop_after {
	uint64_t points;
	unsigned full; /* calls when all are judged */
};

static int stop_in_a_later_pass(void *ctx, uint64_t points)
{
	struct stop_after *s = ctx;

	s->full += points == s->points;
	return s->full == 3;
}

/* One thin cell with very many points is read several times: each pass can be cancelled. */
static void test_cancel_large_cell(void **state)
{
	struct set set = (rng = 4, survey(600000, 5000, 3));
	struct dataset d = dataset_of(&set, 1, 1, false);
	struct folder to = folder_new();
	struct view v = VIEW_INIT;
	struct stop_after stop = {.points = set.n};
	struct selection_params p = {.grid = d.reader.grid,
				     .view = &v,
				     .memory = selection_memory_min(d.reader.grid, &v),
				     .dirfd = to.fd,
				     .progress = stop_in_a_later_pass,
				     .ctx = &stop};
	struct selection_counts got;
	struct err err = ERR_INIT;

	v.keep_withheld = v.keep_noise = true;
	v.thin = (struct view_thin){INT64_C(1) << 62, VIEW_PICK_MEDIAN};
	view_bind(&v, &(struct lattice){.k = {1 << 30, 1 << 30, 0}}); /* all in one cell */
	assert_int_equal(selection_make(&p, &got, &err), -ERR_CANCELLED);
	assert_int_equal(stop.full, 3);
	folder_remove(&to);
	dataset_end(&d);
	set_free(&set);
}

static struct io_table failing;
static int left;

static ssize_t failing_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	if (left-- <= 0) {
		errno = ENOSPC;
		return -1;
	}
	return io_system.pwrite(fd, buf, n, off);
}

/* A full disk at any moment: an error that says so, and no manifest. */
static void test_full_disk(void **state)
{
	struct set set = (rng = 4, survey(200000, 5000, 3));
	struct dataset d = dataset_of(&set, 1, 1, false);
	const struct io_table *before = io;
	struct view v = VIEW_INIT;
	int rc = -1;

	v.every = 2;
	view_bind(&v, &d.m.lattice);
	failing = *io;
	failing.pwrite = failing_pwrite;
	for (int n = 0; rc; n++) {
		struct folder to = folder_new();
		struct selection_params p = {.grid = d.reader.grid, .view = &v, .memory = 1400 << 10, .dirfd = to.fd};
		struct selection_counts got;
		struct err err = ERR_INIT;

		left = n;
		io = &failing;
		rc = selection_make(&p, &got, &err);
		io = before;
		assert_true(!rc || rc == -ERR_NOSPACE);
		assert_int_equal(folder_files(&to, SELECTION_MANIFEST), !rc);
		folder_remove(&to);
		assert_true(n < 200);
	}
	dataset_end(&d);
	set_free(&set);
}

/* A version that did not know the last rule wrote no line for it: its counts are read, and must match their check. */
static void test_older_counts(void **state)
{
	struct set set = (rng = 4, survey(100, 50, 3));
	struct dataset d = dataset_of(&set, 1, 1, false);
	struct folder to = folder_new();
	struct view v = VIEW_INIT;
	struct selection_counts want, got;
	struct err err = ERR_INIT;
	char text[1024] = "", hex[DIGEST_HEX_SIZE], *line;
	size_t n;
	int fd;

	v.every = 2;
	view_bind(&v, &d.m.lattice);
	want = select_into(&to, d.reader.grid, &v, 2 << 20);
	for (unsigned bad = 0; bad < 2; bad++) {
		CHECK(io_open(to.fd, "counts", O_RDONLY, 0, &fd, &err));
		CHECK(io_read_some(fd, text, sizeof text - 1, 0, "counts", &n, &err));
		io_close(fd);
		text[n] = 0;
		line = bad ? strstr(text, "every ") : strstr(text, view_rule_text(VIEW_RULES - 1));
		assert_non_null(line);
		strcpy(line, bad ? "ever 1\n" : "");
		n = strlen(text);
		sprintf(text + n, "check %s\n", digest_hex(digest_hash(text, n), hex));
		CHECK(io_remove(to.fd, "counts", &err));
		CHECK(io_open(to.fd, "counts", O_RDWR | O_CREAT, 0600, &fd, &err));
		CHECK(io_write_at(fd, text, strlen(text), 0, "counts", &err));
		io_close(fd);
		assert_int_equal(selection_counts_read(to.fd, &got, &err), bad ? -ERR_CORRUPT : 0);
		if (!bad)
			assert_memory_equal(&got, &want, sizeof got);
	}
	folder_remove(&to);
	dataset_end(&d);
	set_free(&set);
}

static void test_damaged_counts(void **state)
{
	struct set set = (rng = 4, survey(100, 50, 3));
	struct dataset d = dataset_of(&set, 1, 1, false);
	struct folder to = folder_new();
	struct view v = VIEW_INIT;
	struct selection_counts got;
	struct err err = ERR_INIT;
	int fd;

	v.every = 2;
	view_bind(&v, &d.m.lattice);
	select_into(&to, d.reader.grid, &v, 2 << 20);
	CHECK(io_open(to.fd, "counts", O_RDWR, 0, &fd, &err));
	CHECK(io_write_at(fd, "9", 1, strlen("acut-selection 1\npoints "), "counts", &err));
	io_close(fd);
	assert_int_equal(selection_counts_read(to.fd, &got, &err), -ERR_CORRUPT);
	CHECK(io_remove(to.fd, "counts", &err));
	assert_true(selection_counts_read(to.fd, &got, &err) < 0);
	folder_remove(&to);
	dataset_end(&d);
	set_free(&set);
}

/* The key depends on the generation's content and on the rules that select, not on how duplicates are reduced. A mesh
 * gets its coordinate system from the selection, so the key depends on that, too. */
static void test_key(void **state)
{
	struct set set = (rng = 4, survey(100, 50, 3)), others = survey(100, 50, 3);
	struct dataset d = dataset_of(&set, 1, 1, false), e = dataset_of(&others, 1, 1, false);
	struct view v = VIEW_INIT, w, x;

	v.every = 2;
	view_bind(&v, &d.m.lattice);
	w = v;
	w.duplicates = VIEW_HIGHEST;
	x = v;
	x.returns = VIEW_RETURNS_FIRST;
	assert_true(digest_equal(selection_key(d.reader.grid, &v), selection_key(d.reader.grid, &w)));
	assert_false(digest_equal(selection_key(d.reader.grid, &v), selection_key(d.reader.grid, &x)));
	assert_false(digest_equal(selection_key(d.reader.grid, &v), selection_key(e.reader.grid, &v)));
	for (unsigned i = 0; i < 4; i++) {
		struct grid_manifest m = d.m;
		struct reader other;
		struct err err = ERR_INIT;

		m.segments = d.info;
		if (i == 1)
			snprintf(m.crs, sizeof m.crs, "EPSG:25833");
		if (i == 2)
			snprintf(m.unit_xy, sizeof m.unit_xy, "foot");
		if (i == 3)
			snprintf(m.unit_z, sizeof m.unit_z, "foot");
		CHECK(grid_manifest_write(d.folder.fd, "n", &m, &err));
		other = reader_open(&d.folder, "n", GRID_NEWEST, 1 << 20);
		assert_int_equal(digest_equal(selection_key(d.reader.grid, &v), selection_key(other.grid, &v)), i == 0);
		reader_close(&other);
	}
	dataset_end(&d);
	dataset_end(&e);
	set_free(&set);
	set_free(&others);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_bounds),    cmocka_unit_test(test_cancel),       cmocka_unit_test(test_cancel_large_cell),
		cmocka_unit_test(test_full_disk), cmocka_unit_test(test_older_counts), cmocka_unit_test(test_damaged_counts),
		cmocka_unit_test(test_key),
	};

	no_sync();
	return cmocka_run_group_tests(tests, NULL, NULL);
}
