/*
 * Plans: leaves that cover the root once, bounds that count positions, errors that name what would suffice; and halos
 * of sets too large for the fuzz test.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "brute.h"
#include "cut_halo.h"
#include "cut_order.h"
#include "err.h"
#include "repeat.h"
#include "sets.h"
#include "tiling.h"

static bool point_less(const void *ctx, const struct point *a, const struct point *b)
{
	return point_compare(a, b) < 0;
}

enum shape { UNIFORM, DIAGONAL, PARABOLA, CLUSTERS, ONE_POSITION, COLUMN, CORRIDOR };

static void make_shape(struct tiling *t, struct cut_source *src, enum shape shape, size_t n, size_t cell_records)
{
	struct point *p = calloc(n, sizeof(*p));
	uint64_t seed = 5;

	assert_non_null(p);
	for (size_t i = 0; i < n; i++) {
		int32_t k = (int32_t)i, r = (int32_t)(random_next(&seed) & 0xfffff), s = (int32_t)(random_next(&seed) & 0xfffff);

		p[i].ret = 0x11;
		p[i].cls = 1;
		p[i].z = k;
		switch (shape) {
		case UNIFORM:
			p[i].x = r;
			p[i].y = s;
			break;
		case DIAGONAL:
			p[i].x = p[i].y = k;
			break;
		case PARABOLA:
			p[i].x = 1000 * k;
			p[i].y = k * k;
			break;
		case CLUSTERS:
			p[i].x = (r & 1023) + (i & 1 ? 1 << 30 : 0);
			p[i].y = (s & 1023) + (i & 1 ? 1 << 29 : 0);
			break;
		case CORRIDOR: /* along a slope of one half, a thousandth as wide as long */
			p[i].x = 1000 * r - s;
			p[i].y = 500 * r + 2 * s;
			break;
		case COLUMN:
			p[i].x = 3;
			p[i].y = k;
			break;
		case ONE_POSITION:
			p[i].x = 77;
			p[i].y = -5;
			break;
		}
	}
	cut_order_sort(p, n, point_less, NULL);
	*t = (struct tiling){.segments = 1, .pts = {p}, .n = {n}, .cell_records = cell_records, .salt = 1};
	tiling_source(t, src);
}

static void shape_done(struct tiling *t)
{
	free(t->pts[0]);
}

static void leaves_cover_once(void **state)
{
	static const enum shape shapes[] = {UNIFORM, DIAGONAL, CLUSTERS};

	for (unsigned s = 0; s < 3; s++) {
		struct cut_source src;
		struct tiling t;
		struct cut_plan plan;
		struct err err = ERR_INIT;
		struct cut_region root;
		int32_t box[4];
		uint64_t sum = 0;
		double area = 0;
		unsigned infinite[4] = {0};

		make_shape(&t, &src, shapes[s], 5000, 40);
		assert_int_equal(cut_plan_make_from(&src, 300, &plan, &err), 0);
		assert_true(src.box(src.ctx, box));
		cut_region_root(box, &root);
		for (size_t i = 0; i < plan.n; i++) {
			const struct cut_region *r = &plan.leaf[i].region;
			uint64_t own = 0;

			for (size_t k = 0; k < t.n[0]; k++)
				own += cut_region_holds(r, t.pts[0][k].x, t.pts[0][k].y) &&
				       (k == 0 || t.pts[0][k].x != t.pts[0][k - 1].x || t.pts[0][k].y != t.pts[0][k - 1].y);
			assert_true(own <= plan.leaf[i].count && plan.leaf[i].count <= 300);
			assert_true(plan.leaf[i].exact && own == plan.leaf[i].count);
			sum += own;
			area += (double)((uint64_t)1 << r->wx) * (double)((uint64_t)1 << r->wy);
			for (unsigned side = 0; side < 4; side++)
				infinite[side] += r->inf >> side & 1;
		}
		assert_true(sum > 300);
		assert_true(area == (double)((uint64_t)1 << root.wx) * (double)((uint64_t)1 << root.wy));
		for (unsigned side = 0; side < 4; side++)
			assert_true(infinite[side] > 0);
		cut_plan_done(&plan);
		shape_done(&t);
	}
}

/* If there are several leaves, the first ones are small, so that triangles are emitted early; the others are as large
 * as allowed. */
static void first_leaves_are_small(void **state)
{
	static const enum shape shapes[] = {UNIFORM, CLUSTERS, CORRIDOR};
	const uint64_t first = 1 << 17;

	for (unsigned s = 0; s < 3; s++) {
		struct cut_source src;
		struct cut_plan plan;
		struct err err = ERR_INIT;
		struct tiling t;
		uint64_t before = 0;
		bool large = false;

		make_shape(&t, &src, shapes[s], 900000, 1000);
		assert_int_equal(cut_plan_make_from(&src, 1 << 19, &plan, &err), 0);
		assert_true(plan.n > 1 && plan.n < 70); /* a single path to a small leaf */
		for (size_t i = 0; i < plan.n; i++) {
			assert_true(plan.leaf[i].count <= (before < first / 2 ? first : 1 << 19));
			before += plan.leaf[i].count;
			large = large || plan.leaf[i].count > first;
		}
		assert_true(large);
		cut_plan_done(&plan);
		/* What fits one leaf is one leaf. */
		assert_int_equal(cut_plan_make_from(&src, 1 << 20, &plan, &err), 0);
		assert_int_equal(plan.n, 1);
		cut_plan_done(&plan);
		shape_done(&t);
	}
}

/* The leaves of a plan, and those of all leaves of a plan with a larger load. */
static void compare_levels(const struct cut_source *src, uint32_t load, uint32_t top, const struct cut_plan *want)
{
	struct cut_plan upper, lower;
	struct err err = ERR_INIT;
	size_t n = 0;

	assert_int_equal(cut_plan_make_from(src, top, &upper, &err), 0);
	for (size_t i = 0; i < upper.n; i++) {
		assert_int_equal(cut_plan_below_from(src, &upper.leaf[i].region, upper.n == 1, load, &lower, &err), 0);
		assert_true(n + lower.n <= want->n);
		assert_int_equal(lower.load, want->load);
		for (size_t k = 0; k < lower.n; k++, n++)
			assert_true(cut_region_same(&lower.leaf[k].region, &want->leaf[n].region) &&
				    lower.leaf[k].count == want->leaf[n].count && lower.leaf[k].exact == want->leaf[n].exact);
		cut_plan_done(&lower);
	}
	assert_int_equal(n, want->n);
	cut_plan_done(&upper);
}

/* Small sets in several segments, where a half may have a larger bound than the whole. */
static void two_levels_of_small_sets(void **state)
{
	uint64_t seed = repeat_first();

	for (uint64_t i = 0; i < repeat_cases(3000); i++) {
		struct cut_source src;
		struct cut_plan plan;
		struct err err = ERR_INIT;
		struct tiling t;
		struct sets set;
		struct view view;

		sets_make(&seed, &set, &view);
		sets_tiling(&seed, &set, &t);
		tiling_source(&t, &src);
		for (unsigned k = 0; k < 3; k++) {
			uint32_t load = 1 + sets_below(&seed, k ? 70 : 9), top = load + sets_below(&seed, k ? 250 : 30);

			assert_int_equal(cut_plan_make_from(&src, load, &plan, &err), 0);
			compare_levels(&src, load, top, &plan);
			cut_plan_done(&plan);
		}
		view_done(&view);
	}
}

static void two_levels_of_large_sets(void **state)
{
	static const enum shape shapes[] = {UNIFORM, DIAGONAL, CLUSTERS, CORRIDOR};
	static const uint32_t loads[] = {1 << 12, 1 << 15, 1 << 16, 1 << 17, (1 << 17) + 1,
					 200000,  1 << 18, 1 << 19, 900000,  1 << 20};
	enum { LOADS = sizeof loads / sizeof *loads };

	for (unsigned s = 0; s < 2; s++) {
		struct cut_source src;
		struct cut_plan plan;
		struct err err = ERR_INIT;
		struct tiling t;

		make_shape(&t, &src, shapes[s], 400000, 1000);
		for (unsigned i = 0; i < LOADS; i++) {
			assert_int_equal(cut_plan_make_from(&src, loads[i], &plan, &err), 0);
			for (unsigned k = i; k < LOADS; k++)
				compare_levels(&src, loads[i], loads[k], &plan);
			cut_plan_done(&plan);
		}
		shape_done(&t);
	}
}

static void many_records_are_one_position(void **state)
{
	struct cut_source src;
	struct tiling t;
	struct cut_plan plan;
	struct err err = ERR_INIT;

	make_shape(&t, &src, ONE_POSITION, 100000, 1000);
	assert_int_equal(cut_plan_make_from(&src, 2, &plan, &err), 0);
	assert_int_equal(plan.n, 1);
	assert_int_equal(plan.leaf[0].count, 1);
	cut_plan_done(&plan);
	t.n[0] = 0;
	assert_int_equal(cut_plan_make_from(&src, 2, &plan, &err), 0);
	assert_int_equal(plan.n, 0);
	cut_plan_done(&plan);
	shape_done(&t);
}

/* The plan's promise: every leaf loads into cap, or the probe has failed before. */
static int probe(enum shape shape, size_t n, uint32_t load, uint32_t cap, size_t *ret_leaves, struct err *err)
{
	struct cut_source src;
	struct tiling t;
	struct cut_plan plan;
	const struct view view = VIEW_INIT;
	size_t size = cut_load_scratch_bytes(cap);
	struct mesh_vertex *out = malloc(cap * sizeof(*out));
	void *scratch = malloc(size);
	uint64_t need, used = 0, halo = 0;
	int rc;

	make_shape(&t, &src, shape, n, 40);
	assert_int_equal(cut_plan_make_from(&src, load, &plan, err), 0);
	rc = cut_plan_probe_from(&src, &view, &plan, cap, scratch, size, err);
	for (size_t i = 0; i < plan.n && rc == 0; i++) {
		struct cut_load l = {.out = out, .cap = cap, .scratch = scratch, .scratch_size = size};

		assert_int_equal(cut_load_from(&src, &view, &plan.leaf[i].region, &l, &need, err), 0);
		used += l.own;
		halo += l.counts.halo;
	}
	*ret_leaves = plan.n;
	if (rc == 0)
		print_message("shape %d: %zu leaves, %llu own, %llu halo\n", shape, plan.n, (unsigned long long)used,
			      (unsigned long long)halo);
	cut_plan_done(&plan);
	shape_done(&t);
	free(out);
	free(scratch);
	return rc;
}

static void probe_lets_real_data_pass(void **state)
{
	struct err err = ERR_INIT;
	size_t leaves;

	assert_int_equal(probe(UNIFORM, 20000, 2000, 2600, &leaves, &err), 0);
	assert_in_range(leaves, 10, 40);
	assert_int_equal(probe(CLUSTERS, 20000, 2000, 2600, &leaves, &err), 0);
}

static void probe_refuses_convex_position(void **state)
{
	static const enum shape shapes[] = {DIAGONAL, PARABOLA};

	for (unsigned i = 0; i < 2; i++) {
		struct err err = ERR_INIT;
		size_t leaves;

		assert_int_equal(probe(shapes[i], 20000, 2000, 4000, &leaves, &err), -ERR_LIMIT);
		assert_non_null(strstr(err.message, "of 20000 points"));
		assert_non_null(strstr(err.message, "the budget carries 4000"));
		assert_true(err.need > 0);
		/* With enough memory for all of them it succeeds. */
		err = ERR_INIT;
		assert_int_equal(probe(shapes[i], 20000, 2000, 60000, &leaves, &err), 0);
	}
}

static void splits_end(void **state)
{
	struct cut_source src;
	struct tiling t;
	struct cut_plan plan;
	struct err err = ERR_INIT;
	struct cut_region root;
	int32_t box[4];
	unsigned levels = 0;
	int rc;

	make_shape(&t, &src, UNIFORM, 2000, 40);
	/* No progress at all: one split for comparison, then eight levels. */
	assert_int_equal(cut_plan_make_from(&src, 2000, &plan, &err), 0);
	while ((rc = cut_plan_split_from(&src, &plan, plan.n - 1, 99000, 5000, &err)) == 0)
		levels++;
	assert_int_equal(rc, -ERR_LIMIT);
	assert_int_equal(levels, 8);
	assert_int_equal(plan.n, 9);
	assert_non_null(strstr(err.message, "99000 must be in memory"));
	assert_int_equal(err.need, 99000);
	cut_plan_done(&plan);
	/* Three percent for each level is progress: it continues to the ends of the lattice. */
	err = ERR_INIT;
	levels = 0;
	assert_int_equal(cut_plan_make_from(&src, 2000, &plan, &err), 0);
	for (uint64_t need = 99000; cut_plan_split_from(&src, &plan, 0, need, 5000, &err) == 0; need = need * 97 / 100)
		levels++;
	assert_true(src.box(src.ctx, box));
	cut_region_root(box, &root);
	assert_int_equal(levels, 2 * root.wx);
	cut_plan_done(&plan);
	shape_done(&t);
}

/* The sweep with more hits than one batch, against the rounds; every site of a parabola is a neighbour. */
static void sweep_finds_what_rounds_find(void **state)
{
	static const enum shape shapes[] = {PARABOLA, UNIFORM, DIAGONAL};
	const struct view view = VIEW_INIT;
	size_t size = cut_load_scratch_bytes(100000);
	void *scratch[2] = {malloc(size), malloc(size)};
	unsigned many = 0;

	for (unsigned s = 0; s < 3; s++) {
		struct cut_source src;
		struct tiling t;
		struct cut_plan plan;
		struct err err = ERR_INIT;

		make_shape(&t, &src, shapes[s], 10000, 8);
		assert_int_equal(cut_plan_make_from(&src, 3000, &plan, &err), 0);
		assert_true(plan.n > 1);
		for (size_t i = 0; i < plan.n; i++) {
			const struct point *pts[2];
			uint32_t n[2];
			uint64_t need, cells[2], points;

			for (unsigned k = 0; k < 2; k++) {
				struct cut_halo *h = cut_halo_init(scratch[k], size, &src, &view, &plan.leaf[i].region, false);

				if (k)
					cut_halo_limit(h, 1, 20);
				assert_int_equal(cut_halo_find(h, &pts[k], &n[k], &need, &err), 0);
				cut_halo_stats(h, &cells[k], &points);
			}
			assert_int_equal(n[0], n[1]);
			assert_memory_equal(pts[0], pts[1], n[0] * sizeof(struct point));
			many += s == 0 && cells[1] > 300;
		}
		assert_true(s > 0 || many > 3);
		cut_plan_done(&plan);
		shape_done(&t);
	}
	free(scratch[0]);
	free(scratch[1]);
}

/* One border sees every site, the others few: the chains share the scratch. */
static void one_chain_takes_the_room(void **state)
{
	const struct view view = VIEW_INIT;
	size_t size = cut_halo_bytes(0);
	void *scratch = malloc(size);
	struct cut_source src;
	struct tiling t;
	struct err err = ERR_INIT;
	struct cut_region root, half[2], quarter[2];
	const struct point *pts;
	const int32_t some[4] = {2100, 2100, 14000, 14000}, all[4] = {9000, 9000, 56000, 56000};
	uint64_t need = 0;
	uint32_t m;

	make_shape(&t, &src, COLUMN, 13000, 40);
	cut_region_root(some, &root); /* of side 16384, from 0 on */
	assert_true(cut_region_split(&root, half));
	assert_true(cut_region_split(&half[0], quarter));
	/* The quarter contains the lower 8192 of the column. Its upper border sees two sites, the right one those of
	 * its side; all of them go to the same chain if own sites are unknown. */
	for (unsigned known = 0; known < 2; known++) {
		struct cut_halo *h = cut_halo_init(scratch, size, &src, &view, &quarter[known], false);

		assert_int_equal(cut_halo_find(h, &pts, &m, &need, &err), 0);
		assert_int_equal(m, 1);
	}
	/* What cannot fit fails with a number. */
	shape_done(&t);
	make_shape(&t, &src, DIAGONAL, 60000, 40);
	cut_region_root(all, &root); /* of side 65536 */
	assert_true(cut_region_split(&root, half));
	assert_int_equal(cut_halo_find(cut_halo_init(scratch, size, &src, &view, &half[0], false), &pts, &m, &need, &err),
			 CUT_E_FULL);
	assert_in_range(need, 16384 / 2, 60000);
	assert_null(cut_halo_init(scratch, size - 1, &src, &view, &half[0], false));
	shape_done(&t);
	free(scratch);
}

/* A region inside uniform data reads its neighbours, not the dataset. */
static void halos_read_little(void **state)
{
	const struct view view = VIEW_INIT;
	struct cut_source src;
	struct tiling t;
	struct cut_plan plan;
	struct err err = ERR_INIT;
	uint64_t need, cells = 0, points = 0, own = 0;
	struct mesh_vertex *out = malloc(20000 * sizeof(*out));
	size_t size = cut_load_scratch_bytes(20000);
	void *scratch = malloc(size);

	make_shape(&t, &src, UNIFORM, 100000, 100);
	assert_int_equal(cut_plan_make_from(&src, 8000, &plan, &err), 0);
	for (size_t i = 0; i < plan.n; i++) {
		struct cut_load l = {.out = out, .cap = 20000, .scratch = scratch, .scratch_size = size};

		assert_int_equal(cut_load_from(&src, &view, &plan.leaf[i].region, &l, &need, &err), 0);
		cells += l.counts.cells_read;
		points += l.counts.points_read;
		own += l.own;
		assert_true(l.counts.halo < 700);
	}
	print_message("%zu leaves, %llu own, %llu halo cells, %.2f x read\n", plan.n, (unsigned long long)own,
		      (unsigned long long)cells, (double)points / (double)own);
	assert_true(points < 2 * own);
	cut_plan_done(&plan);
	shape_done(&t);
	free(out);
	free(scratch);
}

/* A thin strip along a diagonal: what the leaves beside it see is read once, and what they load is the same. */
static void corridors_read_little(void **state)
{
	const struct view view = VIEW_INIT;
	const uint32_t loads[] = {4000, 10000};

	for (unsigned k = 0; k < 2; k++) {
		uint32_t cap = loads[k] + loads[k] / 8 + 4096;
		size_t size = (size_t)64 * cap + 2000000;
		struct mesh_vertex *out[2] = {malloc(cap * sizeof(*out[0])), malloc(cap * sizeof(*out[1]))};
		uint64_t need, points = 0, own = 0, known = 0, apart = 0;
		void *scratch = malloc(size);
		struct err err = ERR_INIT;
		struct cut_source src;
		struct cut_plan plan;
		struct tiling t;

		make_shape(&t, &src, CORRIDOR, 50000, 100);
		assert_int_equal(cut_plan_make_from(&src, loads[k], &plan, &err), 0);
		assert_int_equal(cut_plan_probe_from(&src, &view, &plan, cap, scratch, size, &err), 0);
		assert_non_null(plan.sites);
		assert_true(cut_sites_bytes(plan.sites) < (size_t)CUT_SITES_BYTES * cap * 5 / 4);
		points = plan.points_read;
		for (size_t i = 0; i < plan.n; i++) {
			struct cut_load l[2];

			for (unsigned how = 0; how < 2; how++) {
				l[how] = (struct cut_load){.out = out[how], .cap = cap, .scratch = scratch, .scratch_size = size};
				l[how].sites = how && plan.leaf[i].known ? plan.sites : NULL;
				assert_int_equal(cut_load_from(&src, &view, &plan.leaf[i].region, &l[how], &need, &err), 0);
			}
			assert_int_equal(l[0].n, l[1].n);
			assert_memory_equal(out[0], out[1], l[0].n * sizeof(*out[0]));
			apart += l[0].counts.points_read;
			points += l[1].counts.points_read;
			own += l[1].own;
			known += plan.leaf[i].known;
		}
		print_message("%zu leaves, %llu of them known, %.2f x read, %.2f x apart\n", plan.n, (unsigned long long)known,
			      (double)points / (double)own, (double)apart / (double)own);
		assert_true(known > 3);
		assert_true(points < 3 * own);
		assert_true(apart > points);
		cut_plan_done(&plan);
		shape_done(&t);
		free(scratch);
		free(out[0]);
		free(out[1]);
	}
}

/* For large leaves at the rim of ordinary data the index alone suffices. */
static void probe_reads_nothing_it_need_not(void **state)
{
	const struct view view = VIEW_INIT;
	uint32_t load = 16000, cap = load + load / 8 + 4096;
	size_t size = (size_t)64 * cap;
	void *scratch = malloc(size);
	struct err err = ERR_INIT;
	struct cut_source src;
	struct cut_plan plan;
	struct tiling t;

	make_shape(&t, &src, UNIFORM, 100000, 40);
	assert_int_equal(cut_plan_make_from(&src, load, &plan, &err), 0);
	t.reads = 0;
	assert_int_equal(cut_plan_probe_from(&src, &view, &plan, cap, scratch, size, &err), 0);
	assert_true(plan.n > 7);
	assert_int_equal(t.reads, 0);
	assert_int_equal(plan.cells_read, 0);
	cut_plan_done(&plan);
	shape_done(&t);
	free(scratch);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(leaves_cover_once),
		cmocka_unit_test(first_leaves_are_small),
		cmocka_unit_test(two_levels_of_small_sets),
		cmocka_unit_test(two_levels_of_large_sets),
		cmocka_unit_test(many_records_are_one_position),
		cmocka_unit_test(probe_lets_real_data_pass),
		cmocka_unit_test(probe_refuses_convex_position),
		cmocka_unit_test(splits_end),
		cmocka_unit_test(sweep_finds_what_rounds_find),
		cmocka_unit_test(one_chain_takes_the_room),
		cmocka_unit_test(halos_read_little),
		cmocka_unit_test(corridors_read_little),
		cmocka_unit_test(probe_reads_nothing_it_need_not),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
