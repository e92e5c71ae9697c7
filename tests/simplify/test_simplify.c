/*
 * Simplifications against brute force: random points in tiny ranges, several sources and segments, duplicates, views, lines;
 * errors from zero to more than all heights. Every point of the view that is in the mesh of the result is within the error, by
 * exact fractions over all triangles, and the greatest distance is the one that is reported. The result has points of the view
 * only, with their heights, all corners of the hull, and all vertices of lines. It is the same with other memory, regions, order
 * of tasks and interruptions.
 *
 * As a control, the seeds alone, without rounds, must not be within the error often; and a mesh without the points of one round
 * neither. As another, each point that a region adds counts as its own, and nothing is tested around it again: then bounds, or
 * the greatest distance, must be wrong now and then. As a third, all triangles of blocks count as settled.
 *
 * ACUT_FUZZ_CASES: how many; ACUT_FUZZ_SEED: the first.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "geom.h"
#include "repeat.h"
#include "simplify_file.h"
#include "simplify_fixture.h"

static uint64_t cases, kept, positions, rounds, flats, out, controls, wrong, line_vertices, triangles, multi, near, hulls;

/* ---- a case ---- */

static struct set points_of(size_t n, uint32_t range, uint32_t heights, unsigned family)
{
	struct set s = {calloc(n + 1, sizeof *s.pts), calloc(n + 1, sizeof *s.ids), n};

	for (size_t i = 0; i < n; i++) {
		struct point *p = &s.pts[i];

		*p = (struct point){.x = (int32_t)rnd(range) - (int32_t)(range / 2),
				    .y = (int32_t)rnd(range) - 5,
				    .z = (int32_t)rnd(heights),
				    .cls = (uint8_t)(rnd(8) ? 2 : 7),
				    .ret = 0x11};
		if (family == 1)
			p->y = 2 * p->x;
		else if (family == 2 && rnd(3))
			p->z = p->x / 2 + p->y;
		else if (family == 3)
			p->z = (int32_t)(((int64_t)p->x * p->x + (int64_t)p->y * p->y) / (range / 8 + 1));
		else if (family == 4)
			p->z = 3;
		else if (family == 5)
			p->x = p->x < 0 ? 0 : (int32_t)range;
		s.ids[i] = 1 + (uint32_t)rnd(FIXTURE_SOURCES);
	}
	return s;
}

static int64_t random_error(uint32_t heights)
{
	switch (rnd(6)) {
	case 0:
		return 0;
	case 1:
		return INT64_MAX;
	case 2:
		return heights;
	default:
		return (int64_t)rnd(heights / 2 + 1);
	}
}

static const struct point *find(const struct point *pts, size_t n, int32_t x, int32_t y)
{
	for (size_t i = 0; i < n; i++)
		if (pts[i].x == x && pts[i].y == y)
			return &pts[i];
	return NULL;
}

/* Whether p is a corner of the hull: not in a triangle or on a segment of others. */
static bool is_corner(const struct point *all, size_t n, const struct point *p)
{
	const int32_t at[2] = {p->x, p->y};

	/* Some direction has all others strictly on one side; directions to others suffice. */
	for (size_t i = 0; i < n; i++) {
		const int32_t a[2] = {all[i].x, all[i].y};
		bool corner = true;

		if (&all[i] == p || (a[0] == at[0] && a[1] == at[1]))
			continue;
		for (size_t k = 0; corner && k < n; k++) {
			const int32_t b[2] = {all[k].x, all[k].y};
			int side = geom_orient(at, a, b);

			if (b[0] == at[0] && b[1] == at[1])
				continue;
			corner = side > 0 || (!side && ((b[0] > at[0]) == (a[0] > at[0]) && (b[1] > at[1]) == (a[1] > at[1])));
		}
		if (corner)
			return true;
	}
	return n == 1;
}

/* Vertices of lines, corners of the hull that are none: both are in the result. Returns the number of these corners. */
static size_t check_points(const struct point *all, size_t nall, const struct point *pts, size_t n)
{
	size_t corners = 0;

	for (size_t i = 0; i < n; i++) {
		const struct point *p = find(all, nall, pts[i].x, pts[i].y);

		assert_non_null(p);
		assert_memory_equal(p, &pts[i], sizeof *p);
	}
	for (size_t i = 0; i < nall; i++)
		if ((all[i].tag & POINT_LINE) || is_corner(all, nall, &all[i])) {
			line_vertices += (all[i].tag & POINT_LINE) != 0;
			corners += !(all[i].tag & POINT_LINE);
			assert_non_null(find(pts, n, all[i].x, all[i].y));
		}
	return corners;
}

/* The file of the hull has the corners that are no vertices of lines, and nothing else. */
static void check_hull_file(const struct folder *f, const struct point *all, size_t nall)
{
	struct point p[64];
	struct simplify_in in;
	struct err err = ERR_INIT;
	size_t n = 0, corners = 0;

	CHECK(simplify_in_begin(&in, f->fd, "hull", sizeof *p, &err));
	do {
		CHECK(simplify_in_read(&in, p, 64, &n, &err));
		for (size_t i = 0; i < n; i++)
			assert_true(!(p[i].tag & POINT_LINE) && is_corner(all, nall, &p[i]));
	} while (n);
	for (size_t i = 0; i < nall; i++)
		corners += !(all[i].tag & POINT_LINE) && is_corner(all, nall, &all[i]);
	assert_int_equal(in.n, corners);
	simplify_in_end(&in);
}

static bool is_flat(const struct point *all, size_t n)
{
	for (size_t i = 2; i < n; i++) {
		const int32_t a[2] = {all[0].x, all[0].y}, b[2] = {all[1].x, all[1].y}, c[2] = {all[i].x, all[i].y};

		if (geom_orient(a, b, c))
			return false;
	}
	return true;
}

static void check_all(const struct dataset *d, const struct view *view, const struct folder *f, const struct how *how,
		      const struct simplify_report *report)
{
	struct reader chosen = simplify_reader(d, f, SIMPLIFY_MANIFEST);
	struct view rest = view_rest(view);
	size_t nall, n;
	struct point *all = positions_of(&d->reader, view, &nall), *pts = positions_of(&chosen, &rest, &n);
	struct distance far = distance_of(d, &chosen, all, nall, pts, n);
	__int128 most = report->max_error;
	size_t corners;

	assert_int_equal(grid_points(chosen.grid), n);
	assert_int_equal(report->points, nall);
	assert_int_equal(report->kept, n);
	assert_int_equal(report->records, grid_points(d->reader.grid));
	corners = check_points(all, nall, pts, n);
	if (is_flat(all, nall)) {
		assert_int_equal(n, nall);
		assert_int_equal(report->largest, 0);
		flats++;
	} else {
		assert_int_equal(report->hull, corners);
		assert_true(far.n <= most * far.d);
		assert_int_equal(report->largest, (uint64_t)((far.n * 1000 + far.d - 1) / far.d));
		near += report->largest && report->largest < 1000 * (uint64_t)report->max_error;
		assert_true(d->lines || !far.outside);
		if (how->max_points)
			assert_true(n <= how->max_points);
		out += far.outside;
	}
	kept += n;
	positions += nall;
	rounds += report->rounds;
	triangles += far.triangles;
	free(all);
	free(pts);
	reader_close(&chosen);
}

static struct digest content_of(const struct dataset *d, const struct folder *f)
{
	struct reader chosen = simplify_reader(d, f, SIMPLIFY_MANIFEST);
	struct digest content = grid_content(chosen.grid);

	reader_close(&chosen);
	return content;
}

/* The seeds alone. */
static void check_control(const struct dataset *d, const struct view *view, const struct how *how)
{
	struct how seeds = *how;
	struct simplify_report report;
	struct view rest = view_rest(view);
	struct folder f;

	seeds.no_rounds = true;
	f = simplify_in_folder(d, view, &seeds, &report);
	if (!folder_files(&f, "chosen-0-0-0")) {
		folder_remove(&f);
		return;
	}
	struct reader chosen = simplify_reader(d, &f, "chosen-0-0-0");
	size_t nall, n;
	struct point *all = positions_of(&d->reader, view, &nall), *pts = positions_of(&chosen, &rest, &n);
	struct distance far = distance_of(d, &chosen, all, nall, pts, n);

	controls++;
	wrong += far.n > (__int128)how->max_error * far.d;
	free(all);
	free(pts);
	reader_close(&chosen);
	folder_remove(&f);
}

/* With a number of points the file of the hull stays until the end. */
static void check_hull(const struct dataset *d, const struct view *view, const struct how *how)
{
	struct how seeds = *how;
	struct simplify_report report;
	struct folder f;

	seeds.no_rounds = true;
	seeds.max_points = 1 << 20;
	f = simplify_in_folder(d, view, &seeds, &report);
	/* A view without triangles has ended. */
	if (folder_files(&f, "hull")) {
		size_t nall;
		struct point *all = positions_of(&d->reader, view, &nall);

		check_hull_file(&f, all, nall);
		free(all);
		hulls++;
	}
	folder_remove(&f);
}

/* Whether the bound, or the greatest distance, is wrong. */
static bool is_wrong(const struct dataset *d, const struct view *view, const struct how *how)
{
	struct simplify_report report;
	struct view rest = view_rest(view);
	struct folder f = simplify_in_folder(d, view, how, &report);
	struct reader chosen = simplify_reader(d, &f, SIMPLIFY_MANIFEST);
	size_t nall, n;
	struct point *all = positions_of(&d->reader, view, &nall), *pts = positions_of(&chosen, &rest, &n);
	struct distance far = distance_of(d, &chosen, all, nall, pts, n);

	free(all);
	free(pts);
	reader_close(&chosen);
	folder_remove(&f);
	return far.n > (__int128)how->max_error * far.d || report.largest != (uint64_t)((far.n * 1000 + far.d - 1) / far.d);
}

static struct view random_view(const struct dataset *d)
{
	struct view v = VIEW_INIT;
	struct err err = ERR_INIT;

	if (rnd(3) == 0)
		v.duplicates = VIEW_HIGHEST;
	if (rnd(3) == 0)
		CHECK(view_set_classes(&v, "2", &err));
	view_bind(&v, &grid_manifest(d->reader.grid)->lattice);
	return v;
}

static struct how random_how(uint32_t heights)
{
	struct how h = {.max_error = random_error(heights), .block = 4 + (uint32_t)rnd(40), .load = 4 + (uint32_t)rnd(40)};

	h.segments = (uint32_t)rnd(3);
	if (rnd(4) == 0)
		h.load = 0;
	if (rnd(4) == 0)
		h.block = 0;
	/* Windows and regions without room. */
	if (rnd(3) == 0)
		h.room = 1 + (uint32_t)rnd(12);
	if (rnd(5) == 0)
		h.grow = 1 + (uint32_t)rnd(60);
	if (rnd(3) == 0)
		h.near = 8 + (uint32_t)rnd(60);
	h.fill = (uint8_t)rnd(4);
	return h;
}

static void run_case(uint64_t seed, bool lines)
{
	uint32_t range, heights;
	struct chain_lines line;
	struct set s;
	size_t n;
	bool big;
	struct dataset d;
	struct view view;
	struct how how, other;
	struct simplify_report report = {0}, again = {0};
	struct folder f, g;

	rng = seed;
	range = 2 + (uint32_t)(1 << (1 + rnd(6)));
	heights = 1 + (uint32_t)rnd(rnd(2) ? 6 : 60);
	n = rnd(12) ? 1 + rnd(150) : 1 + rnd(4);
	/* Enough for regions with an inside. */
	big = rnd(25) == 0;
	if (big) {
		range = 66;
		n = 500 + rnd(1500);
	}
	s = points_of(n, range, heights, (unsigned)rnd(8));
	if (lines)
		chain_lines_make(&rng, &s, NULL, &line);
	lines = lines && line.nvertex;
	d = dataset_of(&s, 1 + (unsigned)rnd(3), lines ? &line : NULL);
	view = random_view(&d);
	how = random_how(heights);
	/* Blocks with settled triangles inside. */
	if (big && rnd(3)) {
		how.block = 60 + (uint32_t)rnd(700);
		how.load = 20 + (uint32_t)rnd(300);
	}
	if (rnd(5) == 0)
		how.max_points = d.reader.grid ? 1 + rnd(grid_points(d.reader.grid)) : 1;
	if (how.max_points) {
		/* At least what any error leaves. */
		how.max_points += 100 + (uint64_t)(lines ? line.nvertex : 0);
		multi++;
	}
	f = simplify_in_folder(&d, &view, &how, &report);
	check_all(&d, &view, &f, &how, &report);
	other = how;
	other.more = rnd(2) ? 0 : 16 << 20;
	other.shuffle = true;
	other.fill = (uint8_t)((how.fill + 1 + rnd(3)) % 4);
	/* Windows find the same triangles, but a group that needs both may count some of them twice. */
	if (!how.room && rnd(2))
		other.near = 0;
	other.stop = rnd(2) ? 40 : 0;
	if (rnd(8) == 0)
		other.threads = 2 + (unsigned)rnd(2);
	g = simplify_in_folder(&d, &view, &other, &again);
	assert_true(digest_equal(content_of(&d, &f), content_of(&d, &g)));
	assert_int_equal(report.rounds, again.rounds);
	assert_int_equal(report.max_error, again.max_error);
	assert_int_equal(report.largest, again.largest);
	assert_memory_equal(report.removed, again.removed, sizeof report.removed);
	if (!how.max_points && rnd(4) == 0)
		check_control(&d, &view, &how);
	if (rnd(4) == 0)
		check_hull(&d, &view, &how);
	folder_remove(&f);
	folder_remove(&g);
	dataset_end(&d);
	set_free(&s);
	cases++;
}

static void run_many(uint64_t usual, bool lines)
{
	uint64_t n = repeat_cases(usual), first = repeat_first();

	fixture_begin();
	cases = kept = positions = rounds = flats = out = controls = wrong = line_vertices = triangles = multi = near = hulls = 0;
	for (uint64_t i = 0; i < n; i++)
		run_case(first + i, lines);
	print_message(
		"%s%llu cases, %llu of %llu points kept, %llu rounds, %llu triangles, %llu flat, %llu with a number of points, "
		"%llu vertices of lines, %llu points out of the mesh; control: %llu of %llu wrong\n",
		lines ? "lines: " : "", (unsigned long long)cases, (unsigned long long)kept, (unsigned long long)positions,
		(unsigned long long)rounds, (unsigned long long)triangles, (unsigned long long)flats, (unsigned long long)multi,
		(unsigned long long)line_vertices, (unsigned long long)out, (unsigned long long)wrong,
		(unsigned long long)controls);
	print_message(
		"%u points around which nothing is tested again, all regions tested again %u times; stars found nearby %u times, by "
		"windows %u times; %u first rounds of some seeds\n",
		fixture_settled, fixture_again, fixture_nearby, fixture_windows, fixture_strips);
	assert_true(n < 100 || (wrong > controls / 20 && rounds && flats && near && hulls && kept < positions));
	assert_true(n < 100 || !lines || (out && line_vertices));
	/* Most points that regions add are theirs alone; all regions are tested again only if the greatest error is unknown. */
	assert_true(n < 300 || (fixture_settled && fixture_again && fixture_windows && fixture_strips));
	assert_true(n < 300 || lines || fixture_nearby); /* these lines are everywhere */
	assert_true(n < 300 || fixture_again < rounds);
}

static void test_points(void **state)
{
	(void)state;
	run_many(1000, false);
}

static void test_lines(void **state)
{
	(void)state;
	run_many(1000, true);
}

/* Some breaklines, and places without. */
static void few_lines(const struct set *s, struct chain_lines *ret)
{
	size_t most = 1 + rnd(4);

	chain_lines_make(&rng, s, NULL, ret);
	ret->n = ret->n < most ? ret->n : most;
	ret->far = 0;
	for (size_t i = 0; i < ret->n; i++)
		ret->piece[i].turns = 0;
}

/* Many points with these limits: the result is right. Returns in how many of n cases it is wrong with what `spoil` does. */
static uint64_t run_large(uint64_t n, bool lines, void (*limits)(struct how *), void (*spoil)(struct how *))
{
	uint64_t spoiled = 0;

	fixture_begin();
	for (uint64_t i = 0; i < n; i++) {
		struct view view = VIEW_INIT;
		struct chain_lines line = {.nvertex = 0};
		struct how how = {0};
		struct set s;
		struct dataset d;

		rng = repeat_first() + i;
		s = points_of(900, 66, 60, (unsigned)rnd(8));
		limits(&how);
		if (lines)
			few_lines(&s, &line);
		d = dataset_of(&s, 1, line.nvertex ? &line : NULL);
		view_bind(&view, &grid_manifest(d.reader.grid)->lattice);
		assert_false(is_wrong(&d, &view, &how));
		spoil(&how);
		spoiled += is_wrong(&d, &view, &how);
		dataset_end(&d);
		set_free(&s);
	}
	return spoiled;
}

static void small_regions(struct how *how)
{
	how->block = 8;
	how->load = 6 + (uint32_t)rnd(30);
	how->max_error = 1 + (int64_t)rnd(30);
}

static void all_inward(struct how *how)
{
	how->inward = true;
}

/* Small regions. In a control all points that regions add count as theirs alone. */
static void test_seams(void **state)
{
	uint64_t n = repeat_cases(1000) / 8, spoiled = run_large(n, false, small_regions, all_inward);

	(void)state;
	print_message("%u points around which nothing is tested again; control: %llu of %llu wrong\n", fixture_settled,
		      (unsigned long long)spoiled, (unsigned long long)n);
	assert_true(n < 37 || spoiled);
}

static void large_blocks(struct how *how)
{
	how->block = 60 + (uint32_t)rnd(200);
	how->load = 20 + (uint32_t)rnd(200);
	how->max_error = 1 + (int64_t)rnd(20);
}

static void all_settled(struct how *how)
{
	how->loose = true;
}

/* Blocks with settled triangles. In a control all of their triangles count as such. */
static void test_strips(void **state)
{
	(void)state;
	for (unsigned lines = 0; lines < 2; lines++) {
		uint64_t n = repeat_cases(1000) / 16, spoiled = run_large(n, lines, large_blocks, all_settled);

		print_message(
			"%s%u first rounds of some seeds, stars found nearby %u times, by windows %u times; control: %llu of %llu "
			"wrong\n",
			lines ? "lines: " : "", fixture_strips, fixture_nearby, fixture_windows, (unsigned long long)spoiled,
			(unsigned long long)n);
		assert_true(n < 18 || (spoiled && fixture_strips >= n / 2 && fixture_nearby && fixture_windows));
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_points),
		cmocka_unit_test(test_lines),
		cmocka_unit_test(test_seams),
		cmocka_unit_test(test_strips),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
