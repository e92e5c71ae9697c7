/*
 * Simplified lines, by exact arithmetic: each vertex that left is within the tolerance of the segment in its place; segments meet
 * only where what they replace does; rings stay rings. Lines by chance, that cross and touch, and those of surfaces, with cells
 * of any size; and the same lines whatever the blocks and the memory. Built with tree_blind.c, which finds no vertex in any
 * triangle, the judge must find faults: "blind" is the one argument.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "contour_simplify.h"
#include "err.h"
#include "outfile.h"
#include "repeat.h"
#include "simplified.h"
#include "surface.h"

static bool blind;
static size_t met, left; /* by all tests */

static void judge(const struct simplified *s, size_t n, double tolerance)
{
	struct faults f = simplified_faults(s, n, tolerance);

	for (size_t i = 0; i < n; i++)
		left += s[i].n - s[i].m;
	assert_int_equal(f.far, 0);
	assert_int_equal(f.ends, 0);
	met += f.met + f.collapsed;
	if (!blind) {
		assert_int_equal(f.met, 0);
		assert_int_equal(f.collapsed, 0);
	}
}

static void simplified_done(struct simplified *s, size_t n)
{
	for (size_t i = 0; i < n; i++) {
		free(s[i].at);
		free(s[i].kept);
	}
	free(s);
}

/* ---- lines by chance ---- */

/* A walk over a small grid, without a point that is the one before; many meet. Or a ring around a place, of which few do. */
static struct simplified any_line(int64_t size)
{
	struct simplified s = {.n = 2 + (size_t)surface_random(30), .closed = surface_random(2)};
	bool walk = surface_random(2);
	double x = (double)surface_random((uint64_t)size), y = (double)surface_random((uint64_t)size), r = 1;

	s.n = s.closed && s.n < 3 ? 3 : s.n;
	s.at = calloc(s.n, sizeof(*s.at));
	r += (double)surface_random((uint64_t)size);
	for (size_t i = 0; i < s.n; i++) {
		double turn = 6.283185307 * (double)i / (double)s.n, part = r * (0.7 + 0.1 * (double)surface_random(4));

		if (i && walk) {
			s.at[i][0] = s.at[i - 1][0] + (int64_t)surface_random(5) - 2;
			s.at[i][1] = s.at[i - 1][1] + (int64_t)surface_random(5) - 2;
		} else {
			s.at[i][0] = llrint(x + part * cos(turn));
			s.at[i][1] = llrint(y + part * sin(turn));
		}
		if (s.closed && i + 1 == s.n)
			memcpy(s.at[i], s.at[0], sizeof(*s.at));
		if (i && !memcmp(s.at[i], s.at[i - 1], sizeof(*s.at))) {
			s.n--;
			i--;
		}
	}
	return s;
}

static int by_place(const void *a, const void *b)
{
	const struct contour_vertex *p = a, *q = b;

	return p->at[0] != q->at[0] ? (p->at[0] < q->at[0] ? -1 : 1) : p->at[1] < q->at[1] ? -1 : p->at[1] > q->at[1];
}

static size_t vertices_of(const struct simplified *s, size_t n, struct contour_vertex *to)
{
	size_t all = 0;

	for (size_t i = 0; i < n; i++)
		for (size_t k = 0; k < s[i].n; k++, all++)
			to[all] = (struct contour_vertex){.number = all * CONTOUR_MARKS + (k ? 0 : CONTOUR_FIRST) +
								    (k + 1 == s[i].n ? CONTOUR_LAST : 0) +
								    (s[i].closed ? CONTOUR_RING : 0),
							  .at = {(double)s[i].at[k][0], (double)s[i].at[k][1]}};
	qsort(to, all, sizeof(*to), by_place);
	return all;
}

static void test_lines(void **ctx)
{
	struct contour_vertex *v = calloc(12 * 32, sizeof(*v));
	struct err err = ERR_INIT;

	for (unsigned seed = 0; seed < repeat_cases(8000); seed++) {
		const double tolerance = 0.3 * (1 + seed % 20);
		struct contour_cell *cell;
		bool kept[12 * 32];
		struct simplified *s;
		size_t n, all;

		surface_seed(seed);
		n = 1 + (size_t)surface_random(12);
		s = calloc(n, sizeof(*s));
		for (size_t i = 0; i < n; i++) {
			s[i] = any_line(4 + (int64_t)(seed / 20 % 60));
			if (s[i].n < 2) { /* it was one place */
				free(s[i--].at);
				n--;
			}
		}
		all = vertices_of(s, n, v);
		assert_int_equal(contour_cell_new(12 * 32, tolerance, &cell, &err), 0);
		if (all)
			contour_cell_simplify(cell, v, all);
		for (size_t i = 0; i < all; i++)
			kept[v[i].number / CONTOUR_MARKS] = contour_cell_keeps(cell, i);
		for (size_t i = 0, at = 0; i < n; at += s[i++].n) {
			s[i].kept = calloc(s[i].n, sizeof(*s[i].kept));
			for (size_t k = 0; k < s[i].n; k++)
				if (kept[at + k])
					s[i].kept[s[i].m++] = k;
		}
		judge(s, n, tolerance);
		contour_cell_free(cell);
		simplified_done(s, n);
	}
	free(v);
}

/* The upper line is looked at first, with the middle of the lower one in its triangle; when that has left, it leaves, too. */
static void test_waits(void **ctx)
{
	static const double at[6][2] = {{0, 0}, {5, 3}, {10, 0}, {2, -5}, {5, 1.5}, {8, -5}};
	struct contour_vertex v[6];
	struct contour_cell *cell;
	struct err err = ERR_INIT;

	for (size_t i = 0; i < 6; i++) {
		v[i] = (struct contour_vertex){.number = i * CONTOUR_MARKS + (i % 3 == 0 ? CONTOUR_FIRST :
									      i % 3 == 2 ? CONTOUR_LAST :
											   0)};
		memcpy(v[i].at, at[i], sizeof(v[i].at));
	}
	for (unsigned tolerance = 4; tolerance < 9; tolerance += 4) {
		assert_int_equal(contour_cell_new(6, tolerance, &cell, &err), 0);
		contour_cell_simplify(cell, v, 6);
		for (size_t i = 0; i < 6; i++)
			assert_int_equal(contour_cell_keeps(cell, i), i % 3 != 1 || tolerance < 8);
		contour_cell_free(cell);
	}
}

/* ---- surfaces ---- */

static const double unit = 0x1p-39; /* all coordinates are multiples of it */

static bool is_near(const double *a, const double *b, const double *q, double tolerance)
{
	long double x = (long double)b[0] - a[0], y = (long double)b[1] - a[1], length = x * x + y * y;
	long double u = (long double)q[0] - a[0], v = (long double)q[1] - a[1], part = (u * x + v * y) / length;

	part = part < 0 ? 0 : part > 1 ? 1 : part;
	u -= part * x;
	v -= part * y;
	return u * u + v * v <= (long double)tolerance * tolerance;
}

static bool all_near(const double (*at)[2], size_t from, size_t to, double tolerance)
{
	for (size_t i = from + 1; i < to; i++)
		if (!is_near(at[from], at[to], at[i], tolerance))
			return false;
	return true;
}

/* Which points of a line are those of the simplified one: a place may be in it twice, so all ways are tried. Of point k of `now`,
 * from[k][i] is 1 more than the index of the point before it, if it can be point i of `was`. */
static void match(struct simplified *s, const double (*was)[2], const double (*now)[2], double tolerance)
{
	size_t *from = calloc(s->n * s->m, sizeof(*from)), at = s->n - 1;

	from[0] = 1;
	assert_memory_equal(was[0], now[0], sizeof(*was));
	for (size_t k = 1; k < s->m; k++)
		for (size_t i = k; i < s->n; i++)
			for (size_t before = i; before-- && !from[k * s->n + i];)
				if (from[(k - 1) * s->n + before] && !memcmp(was[i], now[k], sizeof(*was)) &&
				    all_near(was, before, i, tolerance))
					from[k * s->n + i] = before + 1;
	for (size_t k = s->m; k--; at = from[k * s->n + at] - 1) {
		assert_true(from[k * s->n + at] > 0);
		s->kept[k] = at;
	}
	free(from);
}

static void check(const struct lines *was, const struct lines *now, const struct way *way)
{
	const double origin[2] = {floor((double)way->k[0] / 100), floor((double)way->k[1] / 100)}, tolerance = way->simplify;
	const double(*p)[2] = (const double(*)[2])was->point, (*q)[2] = (const double(*)[2])now->point;
	struct simplified *s = calloc(was->n + 1, sizeof(*s));

	assert_int_equal(was->n, now->n);
	for (size_t i = 0; i < was->n; p += was->line[i].points, q += now->line[i++].points) {
		s[i] = (struct simplified){.n = was->line[i].points, .m = now->line[i].points, .closed = was->line[i].closed};
		assert_int_equal(now->line[i].closed, s[i].closed);
		assert_int_equal(now->line[i].level, was->line[i].level);
		assert_true(now->line[i].length <= was->line[i].length + 1e-9);
		s[i].at = calloc(s[i].n, sizeof(*s[i].at));
		s[i].kept = calloc(s[i].n, sizeof(*s[i].kept));
		for (size_t k = 0; k < s[i].n; k++)
			for (int axis = 0; axis < 2; axis++)
				s[i].at[k][axis] = (int64_t)((p[k][axis] - origin[axis]) / unit);
		match(&s[i], p, q, tolerance);
	}
	judge(s, was->n, tolerance / unit);
	assert_int_equal(was->npoint - now->npoint, now->left_out);
	simplified_done(s, was->n);
}

static void test_surfaces(void **ctx)
{
	static const struct decimal interval[] = {{1, -2}, {15, -3}, {7, -3}, {1, -2}, {3, -2}};
	static const double tolerances[] = {0.001, 0.05, 0.2, 0.5, 1.5, 10};

	for (unsigned seed = 0; seed < repeat_cases(1500); seed++) {
		struct way way = {.interval = interval[seed % 5], .k = {1000000, 2000000}};
		struct lines was, now, other;
		struct surface s;

		surface_seed(seed);
		surface_make(&s, 2 + (uint32_t)surface_random(7), 2 + (uint32_t)surface_random(7), 2 + (int32_t)(seed / 5 % 9), 1,
			     seed % 3 == 0);
		for (int i = 0; i < 2 && seed % 7 == 0; i++)
			way.k[i] = (1ll << 21) * 100 * (i + 1) - 300; /* where the upper half of a key changes */
		surface_lines(&s, &way, &was);
		way.simplify = tolerances[seed / 3 % 6];
		way.cell = seed % 4 ? 2 + (unsigned)surface_random(60) : 0;
		surface_lines(&s, &way, &now);
		check(&was, &now, &way);
		way.blocks = 1 + (uint32_t)surface_random(9);
		way.segments = 4 + (unsigned)surface_random(40);
		surface_lines(&s, &way, &other);
		lines_same(&now, &other);
		lines_done(&was);
		lines_done(&now);
		lines_done(&other);
		surface_done(&s);
	}
}

/* More vertices than the sort has memory for, in many cells; and many in one place. */
static void test_large(void **ctx)
{
	struct way way = {.interval = {1, -2}}, tight = {.interval = {1, -2}, .blocks = 40, .segments = 1000, .pages = 2};
	struct lines was, now, other;
	struct surface s;
	size_t points;

	surface_seed(2);
	surface_make(&s, 120, 120, 12, 1, false);
	surface_lines(&s, &way, &was);
	for (unsigned cell = 0; cell < 3000; cell += 1000) {
		way.simplify = tight.simplify = 0.1;
		way.cell = tight.cell = cell;
		tight.sort_memory = 1;
		surface_lines(&s, &way, &now);
		surface_lines(&s, &tight, &other);
		lines_same(&now, &other);
		assert_int_equal(was.n, now.n);
		points = now.npoint;
		assert_true(was.npoint > 100000 && points < was.npoint * 9 / 10 && now.left_out == was.npoint - points);
		lines_done(&now);
		lines_done(&other);
	}
	lines_done(&was);
	/* Saddles at a level: lines touch in each. */
	for (uint32_t i = 0; i < s.nvertex; i++)
		s.vertex[i][2] = (i % 120 + i / 120) % 2 ? 5 : 4 + (int32_t)(i % 120 % 2) * 2;
	way.simplify = tight.simplify = 3;
	way.cell = tight.cell = 2;
	surface_lines(&s, &way, &now);
	surface_lines(&s, &tight, &other);
	lines_same(&now, &other);
	lines_done(&now);
	lines_done(&other);
	surface_done(&s);
}

/* A long line that is straight or nearly: each segment replaces as many vertices as it may. */
static void test_straight(void **ctx)
{
	for (int bent = 0; bent < 2; bent++) {
		struct way way = {.interval = {1, 0}, .base = {55, -2}, .simplify = 0.5};
		struct surface s;
		struct lines now;

		surface_seed(3);
		surface_make(&s, 5000, 2, 1, 1, false);
		for (uint32_t i = 0; i < s.nvertex; i++) {
			s.vertex[i][0] = (int32_t)(i % 5000 * 100);
			s.vertex[i][1] = i < 5000 ? 0 : 100;
			s.vertex[i][2] = i < 5000 ? 0 : bent && i % 2 ? 10 : 15;
		}
		surface_lines(&s, &way, &now);
		assert_int_equal(now.n, 1);
		assert_true(now.left_out > 4000 && now.npoint < 100);
		lines_done(&now);
		surface_done(&s);
	}
}

/* Not 0 at the last of so many calls. */
static int count_down(void *ctx)
{
	return --*(int *)ctx == 0;
}

/* Whenever it is interrupted it ends, and what it had is free. *ret_lines: how many there are. Returns the calls that it takes.
 */
static int interrupt(const struct surface *s, double simplify, int *ret_lines)
{
	const struct acut_mesh_head head = {.scale_xy = "0.01", .scale_z = "0.01"};
	int calls = 0, r = -ERR_CANCELLED;

	while (r) {
		int left_calls = ++calls;
		struct contour_options opt = {.interval = {{1, -2}, 1, 1},
					      .base = {{5, -3}, 1, 1},
					      .z_num = 1,
					      .z_den = 1,
					      .simplify = simplify,
					      .cell = 20,
					      .interrupted = count_down,
					      .ctx = &left_calls};
		struct acut_mesh_block b = {
			.nnew = s->nvertex, .ntriangle = s->ntriangle, .triangle = (const uint32_t(*)[3])s->triangle};
		struct contour_line line;
		struct err err = ERR_INIT;
		struct outfile *out;
		struct contour *c;

		for (int i = 0; i < 2; i++)
			opt.axis[i] = (struct contour_axis){.a = 1, .e = -2, .whole = true, .scale = {1, -2}};
		assert_int_equal(outfile_spool(NULL, &out, &err), 0);
		assert_int_equal(contour_new(out, &c, &err), 0);
		assert_int_equal(contour_head(c, &head, &opt, &err), 0);
		assert_int_equal(contour_block(c, &b, (const int32_t(*)[3])s->vertex, &err), 0);
		r = contour_join(c, &err);
		assert_true(!r || r == -ERR_CANCELLED);
		assert_true((!r && simplify > 0) == (contour_simplified(c).left_out > 0));
		left_calls = 0;
		for (*ret_lines = 0; !r && !contour_next(c, &line, &err) && line.points;)
			++*ret_lines;
		contour_free(c);
		outfile_free(out);
	}
	return calls;
}

static void test_interrupted(void **ctx)
{
	struct surface s;
	int without, with, lines;

	surface_seed(4);
	surface_make(&s, 8, 8, 9, 1, false);
	without = interrupt(&s, 0, &lines);
	with = interrupt(&s, 0.3, &lines);
	assert_true(lines > 5 && with > without + 2 * lines + 10); /* when a line is taken, and in each cell */
	surface_done(&s);
}

int main(int argc, char **argv)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_lines),    cmocka_unit_test(test_waits),
					   cmocka_unit_test(test_surfaces), cmocka_unit_test(test_large),
					   cmocka_unit_test(test_straight), cmocka_unit_test(test_interrupted)};
	const struct CMUnitTest control[] = {cmocka_unit_test(test_lines), cmocka_unit_test(test_surfaces)};
	int failed;

	blind = argc > 1 && !strcmp(argv[1], "blind");
	failed = blind ? cmocka_run_group_tests(control, NULL, NULL) : cmocka_run_group_tests(tests, NULL, NULL);
	printf("%zu vertices left, %zu faults\n", left, met);
	return failed || !left || (blind && met < 100);
}
