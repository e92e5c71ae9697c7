/*
 * selection_make against brute force: random points in tiny ranges and at the ends of int32, several segments, removed
 * sources, random views, absolute numbers far from zero on either side, as little memory as possible. The selected
 * grid must hold exactly the points that a sort over the whole set chooses, and the counts must be those of the set.
 *
 * ACUT_FUZZ_CASES sets the number of random sets (default 3,000).
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "account.h"
#include "io.h"
#include "selection_fixture.h"
#include "view_area.h"
#include "repeat.h"

/* ---- the expected result, by sorting everything ---- */

struct entry {
	int64_t cx, cy;
	struct point p;
};

static int64_t floor_div(int64_t a, int64_t b)
{
	int64_t q = a / b;

	return a % b && a < 0 ? q - 1 : q;
}

static int pick_sign;

static int by_cell_and_rank(const void *a, const void *b)
{
	const struct entry *x = a, *y = b;

#define DECIDE(f, g, sign) \
	if ((f) != (g))    \
		return ((f) < (g) ? -1 : 1) * (sign);
	DECIDE(x->cx, y->cx, 1)
	DECIDE(x->cy, y->cy, 1)
	DECIDE(x->p.z, y->p.z, pick_sign)
	DECIDE(x->p.cls, y->p.cls, 1)
	DECIDE(x->p.ret, y->p.ret, 1)
	DECIDE(x->p.tag, y->p.tag, 1)
	DECIDE(x->p.x, y->p.x, 1)
	DECIDE(x->p.y, y->p.y, 1)
	return 0;
}

static int by_order(const void *a, const void *b)
{
	return point_compare(a, b);
}

static bool outside(const struct view *v, const struct point *p)
{
	int64_t x = p->x + v->k[0], y = p->y + v->k[1];

	if (v->crop == VIEW_CROP_AREA)
		return !view_area_has(v->area, x, y);
	return v->crop && (x < v->crop_box[0] || y < v->crop_box[1] || x > v->crop_box[2] || y > v->crop_box[3]);
}

/* Copies the live points (all except those of `dead` sources) to `out`; counts as in the report. */
static size_t brute(const struct set *s, const bool *dead, const struct view *v, struct point *out, struct selection_counts *ret)
{
	struct entry *e = calloc(s->n + 1, sizeof *e);
	size_t n = 0, kept = 0, group;

	memset(ret, 0, sizeof *ret);
	for (size_t i = 0; i < s->n; i++) {
		enum view_rule rule = view_judge(v, &s->pts[i]);

		if (dead[s->ids[i]])
			continue;
		ret->points++;
		if (outside(v, &s->pts[i]))
			rule = VIEW_BY_CROP;
		if (rule != VIEW_KEPT) {
			ret->removed[rule]++;
			continue;
		}
		e[n] = (struct entry){.p = s->pts[i]};
		if (v->thin.cell) {
			e[n].cx = floor_div(s->pts[i].x + v->k[0], v->thin.cell);
			e[n].cy = floor_div(s->pts[i].y + v->k[1], v->thin.cell);
		} else {
			e[n].cx = (int64_t)n;
		}
		n++;
	}
	pick_sign = v->thin.pick == VIEW_PICK_HIGHEST ? -1 : 1;
	qsort(e, n, sizeof *e, by_cell_and_rank);
	for (size_t i = 0; i < n; i += group) {
		for (group = 1; i + group < n && e[i].cx == e[i + group].cx && e[i].cy == e[i + group].cy; group++)
			;
		out[kept++] = e[v->thin.pick == VIEW_PICK_MEDIAN ? i + (group - 1) / 2 : i].p;
		ret->removed[VIEW_BY_THIN] += group - 1;
	}
	qsort(out, kept, sizeof *out, by_order);
	ret->kept = kept;
	free(e);
	return kept;
}

/* ---- sets and views ---- */

static int32_t coordinate(uint64_t shape)
{
	static const int32_t ends[] = {INT32_MIN, INT32_MIN + 1, -1, 0, 1, INT32_MAX - 1, INT32_MAX};

	switch (shape) {
	case 0:
		return (int32_t)rnd(4);
	case 1:
		return (int32_t)rnd(40) - 20;
	case 2:
		return (int32_t)rnd(1000) - 100;
	case 3:
		return ends[rnd(7)];
	case 4:
		return (int32_t)(uint32_t)random_next(&rng);
	default:
		return 7;
	}
}

static struct set random_set(unsigned sources)
{
	size_t n = rnd(8) ? rnd(400) : rnd(6000);
	uint64_t sx = rnd(6), sy = rnd(6), sz = rnd(6);
	struct set s = {.pts = calloc(n + 1, sizeof *s.pts), .ids = calloc(n + 1, sizeof *s.ids), .n = n};

	for (size_t i = 0; i < n; i++) {
		s.pts[i] = (struct point){coordinate(sx),
					  coordinate(sy),
					  coordinate(sz),
					  (uint8_t)("\2\2\2\7\22\10\1"[rnd(7)]),
					  (uint8_t)(rnd(3) | rnd(3) << 4),
					  (uint16_t)(rnd(4) ? 0 : rnd(16))};
		s.ids[i] = 1 + (uint32_t)rnd(sources);
	}
	return s;
}

static int64_t near(const struct set *s, const struct view *v, int axis)
{
	const struct point *p = &s->pts[s->n ? rnd(s->n) : 0];

	return (axis ? p->y : p->x) + v->k[axis] + (int64_t)rnd(5) - 2;
}

static void random_crop(const struct set *s, struct view *v)
{
	struct err err = ERR_INIT;
	int64_t a[2], b[2];

	for (int k = 0; k < 2; k++) {
		a[k] = near(s, v, k);
		b[k] = near(s, v, k);
		v->crop_box[k] = a[k] < b[k] ? a[k] : b[k];
		v->crop_box[k + 2] = a[k] < b[k] ? b[k] : a[k];
	}
	v->crop = VIEW_CROP_BOX;
	if (rnd(3))
		return;
	v->area = view_area_new();
	CHECK(view_area_ring(v->area, true, &err));
	for (uint64_t i = 0, n = 3 + rnd(4); i < n; i++)
		CHECK(view_area_corner(v->area, near(s, v, 0), near(s, v, 1), &err));
	CHECK(view_area_end(v->area, &err));
	view_area_bounds(v->area, v->crop_box);
	v->crop = VIEW_CROP_AREA;
}

static struct view random_view(const struct set *s, const struct lattice *lattice)
{
	static const int64_t cells[] = {1, 2, 3, 5, 17, 100, 1 << 20, INT64_C(1) << 31, INT64_C(1) << 33, INT64_C(1) << 62};
	struct view v = VIEW_INIT;
	struct err err = ERR_INIT;

	view_bind(&v, lattice);
	v.keep_withheld = rnd(2);
	v.keep_noise = rnd(2);
	v.drop_overlap = !rnd(4);
	v.returns = (uint8_t)(rnd(3) ? 0 : rnd(3));
	if (!rnd(4))
		CHECK(view_set_classes(&v, "2,7", &err));
	if (!rnd(4)) {
		v.has_zmin = true;
		v.zmin = v.k[2];
	}
	if (!rnd(2))
		random_crop(s, &v);
	if (!rnd(4))
		v.every = 2 + rnd(6);
	if (rnd(4)) {
		v.thin.cell = cells[rnd(10)];
		v.thin.pick = (uint8_t)rnd(3);
	}
	return v;
}

static struct gather all_of(const struct folder *from, const struct lattice *lattice)
{
	struct reader r = reader_open(from, SELECTION_MANIFEST, GRID_NEWEST, 1 << 20);
	struct gather g = {0};
	struct err err = ERR_INIT;

	CHECK(grid_scan(r.r, 0, UINT64_MAX, gather_sink, &g, &err));
	assert_true(lattice_equal(&grid_manifest(r.grid)->lattice, lattice));
	assert_string_equal(grid_manifest(r.grid)->crs, "EPSG:26910");
	assert_string_equal(grid_manifest(r.grid)->unit_xy, "metre");
	assert_int_equal(grid_points(r.grid), g.n);
	reader_close(&r);
	return g;
}

static void one_case(uint64_t seed)
{
	unsigned sources, segments;
	struct selection_counts want, got;
	struct point *points;
	struct gather found;
	struct folder to;
	struct dataset d;
	struct view view;
	struct set set;
	size_t n;

	rng = seed;
	sources = 1 + (unsigned)rnd(7);
	segments = 1 + (unsigned)rnd(3);
	set = random_set(sources);
	d = dataset_of(&set, sources, segments, rnd(2));
	view = random_view(&set, &d.m.lattice);
	points = calloc(set.n + 1, sizeof *points);
	n = brute(&set, d.dead, &view, points, &want);
	to = folder_new();
	got = select_into(&to, d.reader.grid, &view,
			  selection_memory_min(d.reader.grid, &view) + (rnd(2) ? rnd(4096) : rnd(1 << 20)));
	found = all_of(&to, &d.m.lattice);
	if (found.n != n || memcmp(found.pts ? found.pts : points, points, n * sizeof *points))
		fail_msg("seed %llu: %zu points selected, not these %zu", (unsigned long long)seed, found.n, n);
	for (int i = 0; i < VIEW_RULES; i++)
		if (got.removed[i] != want.removed[i])
			fail_msg("seed %llu: %llu removed by %s, not %llu", (unsigned long long)seed,
				 (unsigned long long)got.removed[i], view_rule_text(i), (unsigned long long)want.removed[i]);
	assert_int_equal(got.points, want.points);
	assert_int_equal(got.kept, want.kept);
	/* Manifest, segment and counts, nothing else. */
	assert_int_equal(folder_files(&to, ""), 3);
	folder_remove(&to);
	free(found.pts);
	free(points);
	view_done(&view);
	dataset_end(&d);
	set_free(&set);
}

static void test_random(void **state)
{
	uint64_t cases = repeat_cases(3000);

	for (uint64_t i = 0; i < cases; i++)
		one_case(i + 1);
}

/* ---- a set that needs many rectangles, and thin cells larger than the table ---- */

/* For any memory: one thin cell of all points with few heights (ties by the whole record, more than fit any table),
 * large cells, small ones; each pick. */
static void test_large(void **state)
{
	static const int64_t cells[] = {7, 100, 3000, INT64_C(1) << 40};
	static const size_t more[] = {0, 50000, 8 << 20};
	struct set set = (rng = 77, survey(60000, 4000, 3));
	struct point *points = calloc(set.n, sizeof *points);
	struct dataset d = dataset_of(&set, 1, 1, false);
	struct selection_counts want, got;
	struct view v = VIEW_INIT;

	view_bind(&v, &d.m.lattice);
	for (unsigned c = 0; c < 4; c++)
		for (unsigned pick = 0; pick < 3; pick++) {
			size_t n;

			v.thin = (struct view_thin){cells[c], (uint8_t)pick};
			n = brute(&set, d.dead, &v, points, &want);
			for (unsigned k = 0; k < 3; k++) {
				struct folder to = folder_new();
				struct gather found;

				got = select_into(&to, d.reader.grid, &v, selection_memory_min(d.reader.grid, &v) + more[k]);
				assert_memory_equal(&got, &want, sizeof got);
				found = all_of(&to, &d.m.lattice);
				assert_int_equal(found.n, n);
				assert_memory_equal(found.pts, points, n * sizeof *points);
				free(found.pts);
				folder_remove(&to);
			}
		}
	free(points);
	dataset_end(&d);
	set_free(&set);
}

/* One position with the same record many times: no digit of the rank distinguishes them. */
static void test_all_equal(void **state)
{
	struct set set = (rng = 5, survey(9000, 1, 1));
	struct dataset d = dataset_of(&set, 1, 1, false);
	struct view v = VIEW_INIT;

	view_bind(&v, &d.m.lattice);
	v.thin = (struct view_thin){1000, VIEW_PICK_MEDIAN};
	struct folder to = folder_new();
	struct selection_counts got = select_into(&to, d.reader.grid, &v, selection_memory_min(d.reader.grid, &v));
	struct gather found = all_of(&to, &d.m.lattice);

	assert_int_equal(got.kept, 1);
	assert_int_equal(got.removed[VIEW_BY_THIN], 8999);
	assert_memory_equal(found.pts, set.pts, sizeof *set.pts);
	free(found.pts);
	folder_remove(&to);
	dataset_end(&d);
	set_free(&set);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_random),
		cmocka_unit_test(test_large),
		cmocka_unit_test(test_all_equal),
	};

	no_sync();
	return cmocka_run_group_tests(tests, NULL, NULL);
}
