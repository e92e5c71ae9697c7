/*
 * The pieces of one window for several threads: a square of a survey whose cells it cuts, divided. There are enough pieces, none
 * is much larger than its share, together they have the triangles of one piece, and each is done after a few rounds: a side
 * between cells has no more to read than one through the middle of cells. What is empty between clusters is no piece.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "err.h"
#include "random.h"
#include "tiling.h"
#include "window_area.h"

/* CELLS: on each axis, of 2^BITS a side. */
enum { CELLS = 24, BITS = 10, EACH = 1000, CAP = 1 << 19, WALKS = 5, SPARSE = 16 };

static struct view view = {.window = VIEW_CROP_BOX, .window_box = {4500, 4500, 19500, 19500}};
static struct point records[CELLS][CELLS][EACH];
static struct grid_cell cell[CELLS][CELLS];
static struct point few[SPARSE];
static struct grid_cell sparse; /* over all of them, if it has points */
static unsigned walks;

static int by_place(const void *a, const void *b)
{
	return point_compare(a, b);
}

static void make_cell(unsigned cx, unsigned cy)
{
	uint64_t seed = 1 + cx * 1000 + cy;
	struct grid_cell *c = &cell[cy][cx];
	struct point *p = records[cy][cx];

	*c = (struct grid_cell){.count = EACH, .distinct = EACH, .place = cy * CELLS + cx};
	for (unsigned i = 0; i < EACH; i++) {
		uint64_t r = random_next(&seed);

		p[i] = (struct point){.x = (int32_t)((cx << BITS) + (r & 1023)), .y = (int32_t)((cy << BITS) + (r >> 20 & 1023))};
		for (unsigned k = 0; k < 2; k++) {
			int32_t v = k ? p[i].y : p[i].x;

			c->box[k] = i && c->box[k] < v ? c->box[k] : v;
			c->box[2 + k] = i && c->box[2 + k] > v ? c->box[2 + k] : v;
		}
	}
	qsort(p, EACH, sizeof *p, by_place);
}

static int walk(void *ctx, uint64_t lo, uint64_t hi, const struct grid_visitor *v, struct err *err)
{
	int r = 0;

	walks++;
	for (unsigned i = 0; i < CELLS * CELLS && !r; i++)
		r = v->cell(v->ctx, &cell[i / CELLS][i % CELLS]);
	return r || !sparse.count ? r : v->cell(v->ctx, &sparse);
}

static int read_records(void *ctx, const struct grid_cell *c, grid_points_fn fn, void *sink, struct err *err)
{
	if (c->place == sparse.place && sparse.count)
		return fn(sink, few, SPARSE, err);
	return fn(sink, records[c->place / CELLS][c->place % CELLS], EACH, err);
}

static bool box(void *ctx, int32_t ret[4])
{
	const int32_t all[4] = {0, 0, (CELLS << BITS) - 1, (CELLS << BITS) - 1};

	memcpy(ret, all, sizeof all);
	return true;
}

static const struct cut_source src = {.walk = walk, .read = read_records, .box = box};

static const struct cut_region plane = {.wx = 32, .wy = 32};

/* A small window in an arena of that size. */
static void small_window(uint32_t cap, struct digest *ret)
{
	const struct view little = {.window = VIEW_CROP_BOX, .window_box = {9000, 9000, 10000, 10000}};
	void *memory = aligned_alloc(64, (tri_bytes(cap) + window_area_tables(cap) + 127) & ~(size_t)63);
	const struct window_from from = {
		.src = &src, .view = &little, .region = &plane, .cap = cap, .memory = memory, .room = tri_bytes(cap)};
	const int64_t k[3] = {0, 0, 0};
	struct err err = ERR_INIT;
	struct mesh_domain d;
	uint64_t need;

	assert_non_null(memory);
	assert_int_equal(window_domain_from(&from, k, &d, &need, &err), 0);
	assert_in_range(d.ntriangle, 1000, 3000);
	*ret = d.digest;
	free(memory);
}

/* A cell with few points that reaches over all others makes the spacing of points look large. A window in it needs no more
 * memory than without. */
static void beside_sparse(void **state)
{
	struct digest alone, both;

	(void)state;
	small_window(1 << 13, &alone);
	sparse = (struct grid_cell){.count = SPARSE, .distinct = SPARSE, .place = CELLS * CELLS};
	for (unsigned i = 0; i < SPARSE; i++)
		few[i] = (struct point){.x = i < SPARSE / 2 ? (int32_t)i : (CELLS << BITS) - 1 - (int32_t)i,
					.y = i < SPARSE / 2 ? (int32_t)i : (CELLS << BITS) - 1 - (int32_t)i};
	box(NULL, sparse.box);
	small_window(1 << 13, &both);
	sparse.count = 0;
	assert_true(digest_equal(alone, both));
}

struct sum {
	struct digest digest;
	uint64_t triangles, cells;
};

/* The triangles of all pieces of a plan. */
static struct sum mesh(const struct cut_source *of, const struct view *in, const struct cut_plan *plan)
{
	void *memory = aligned_alloc(64, (tri_bytes(CAP) + window_area_tables(CAP) + 127) & ~(size_t)63);
	struct sum sum = {.triangles = 0};
	const int64_t k[3] = {0, 0, 0};

	assert_non_null(memory);
	for (size_t i = 0; i < plan->n; i++) {
		const struct window_from from = {.src = of,
						 .view = in,
						 .region = &plan->leaf[i].region,
						 .cap = CAP,
						 .memory = memory,
						 .room = tri_bytes(CAP)};
		struct err err = ERR_INIT;
		struct mesh_domain d;
		uint64_t need;

		walks = 0;
		assert_int_equal(window_domain_from(&from, k, &d, &need, &err), 0);
		assert_in_range(walks, 0, WALKS);
		digest_add(&sum.digest, d.digest);
		sum.triangles += d.ntriangle;
		sum.cells += d.counts.cells_read;
	}
	free(memory);
	return sum;
}

/* In the order of the plane's halvings: the emitter numbers vertices in it, and has few that are open when neighbours follow each
 * other. */
static void plan_of(const struct cut_source *of, const struct view *in, unsigned pieces, struct cut_plan *ret)
{
	struct point before = {0}, corner;
	struct err err = ERR_INIT;

	assert_int_equal(window_plan_from(of, in, CAP, pieces, ret, &err), 0);
	for (size_t i = 0; i < ret->n; i++, before = corner) {
		const struct cut_region *r = &ret->leaf[i].region;

		corner = (struct point){.x = (int32_t)(r->x ^ 1u << 31), .y = (int32_t)(r->y ^ 1u << 31)};
		assert_true(!i || point_compare(&before, &corner) < 0);
	}
}

static void divides(void **state)
{
	struct cut_plan one, plan;
	struct sum whole, parts;

	(void)state;
	plan_of(&src, &view, 1, &one);
	assert_int_equal(one.n, 1);
	whole = mesh(&src, &view, &one);
	assert_in_range(whole.triangles, 400000, 500000);
	for (unsigned pieces = 2; pieces <= 8; pieces *= 2) {
		uint64_t most = 0;

		plan_of(&src, &view, pieces, &plan);
		assert_in_range(plan.n, pieces / 2 + 1, 2 * pieces + 2);
		for (size_t i = 0; i < plan.n; i++)
			most = plan.leaf[i].count > most ? plan.leaf[i].count : most;
		assert_in_range(most, 1, 2 * one.leaf[0].count / (pieces + 1));
		parts = mesh(&src, &view, &plan);
		assert_true(digest_equal(parts.digest, whole.digest));
		assert_int_equal(parts.triangles, whole.triangles);
		assert_in_range(parts.cells, whole.cells, 3 * whole.cells);
		cut_plan_done(&plan);
	}
	cut_plan_done(&one);
}

/* What a thread would do in no time is not divided. */
static void small(void **state)
{
	const struct view little = {.window = VIEW_CROP_BOX, .window_box = {9000, 9000, 11500, 11500}};
	struct cut_plan plan;

	(void)state;
	plan_of(&src, &little, 8, &plan);
	assert_int_equal(plan.n, 1);
	assert_in_range(plan.leaf[0].count, 9000, 1 << 14);
	cut_plan_done(&plan);
}

/* A survey in the lower or upper corner of what the window has of the plane, because the window reaches further or a point lies
 * far off, is shared by the threads as one that fills the window. Only a few pieces have no positions. */
static void far_points(void **state)
{
	enum { COUNT = 200000, SIDE = 1 << 14, TIMES = 16, LAST = TIMES * SIDE - 1 };
	static struct point lower[COUNT + 1], upper[COUNT + 1];
	struct tiling t = {.n = {COUNT + 1}, .segments = 1, .cell_records = 1000};
	struct cut_source far;
	struct cut_plan one, plan;
	uint64_t seed = 1;

	(void)state;
	for (int i = 0; i < COUNT; i++) {
		lower[i].x = (int32_t)(random_next(&seed) % SIDE);
		lower[i].y = (int32_t)(random_next(&seed) % SIDE);
	}
	qsort(lower, COUNT, sizeof *lower, by_place);
	tiling_source(&t, &far);
	for (int times = 2; times <= TIMES; times *= 2)
		for (unsigned way = 0; way < 4; way++) {
			const bool stray = way & 1, up = way & 2;
			const int32_t reach = times * SIDE - 1, from = up ? LAST - reach : 0;
			const struct view reaching = {.window = VIEW_CROP_BOX,
						      .window_box = {from, from, from + reach, from + reach}};
			size_t with = 0;

			/* The far point makes the data reach as far as the window, or is itself in it. */
			lower[COUNT].x = lower[COUNT].y = stray ? reach : LAST;
			for (int i = 0; i <= COUNT; i++)
				upper[COUNT - i] = (struct point){.x = LAST - lower[i].x, .y = LAST - lower[i].y};
			t.pts[0] = up ? upper : lower;
			plan_of(&far, &reaching, 8, &plan);
			for (size_t i = 0; i < plan.n; i++) {
				assert_in_range(plan.leaf[i].count, 0, COUNT / 4);
				with += plan.leaf[i].count > 1;
			}
			assert_in_range(with, 8, 12);
			assert_in_range(plan.n - with, 0, 9);
			if (stray && times == 4) {
				plan_of(&far, &reaching, 1, &one);
				assert_int_equal(one.n, 1);
				assert_true(
					digest_equal(mesh(&far, &reaching, &plan).digest, mesh(&far, &reaching, &one).digest));
				cut_plan_done(&one);
			}
			cut_plan_done(&plan);
		}
}

/* Two clusters far from each other, each larger than a thread's share. To divide one, the plane is halved dozens of times, and
 * each half without positions would read some of both clusters. So they stay whole, and little is read twice. */
static void far_clusters(void **state)
{
	enum { CLUSTER = 20000, SIDE = 1 << 20, FAR = 1 << 30 };
	static struct point pts[2 * CLUSTER];
	const struct view nearly = {.window = VIEW_CROP_BOX, .window_box = {1000 - FAR, 1000 - FAR, FAR - 1000, FAR - 1000}};
	struct tiling t = {.pts = {pts}, .n = {2 * CLUSTER}, .segments = 1, .cell_records = 1000};
	struct cut_source far;
	struct cut_plan plan;
	const struct view left = {.window = VIEW_CROP_BOX, .window_box = {-FAR, -FAR, 2 * SIDE - 1 - FAR, SIDE - 1 - FAR}};
	uint64_t seed = 1;

	(void)state;
	for (int i = 0; i < 2 * CLUSTER; i++) {
		const int32_t from = i < CLUSTER ? -FAR : FAR - SIDE;

		pts[i].x = from + (int32_t)(random_next(&seed) % SIDE);
		pts[i].y = from + (int32_t)(random_next(&seed) % SIDE);
	}
	qsort(pts, 2 * CLUSTER, sizeof *pts, by_place);
	tiling_source(&t, &far);
	plan_of(&far, &nearly, 8, &plan);
	assert_int_equal(plan.n, 2);
	assert_in_range(mesh(&far, &nearly, &plan).triangles, 75000, 80000);
	assert_in_range(t.read_points, 2 * CLUSTER, 3 * CLUSTER);
	cut_plan_done(&plan);

	/* With as much space beside it, one of them is divided. */
	plan_of(&far, &left, 8, &plan);
	assert_in_range(plan.n, 3, 4);
	cut_plan_done(&plan);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(divides), cmocka_unit_test(small), cmocka_unit_test(beside_sparse),
					   cmocka_unit_test(far_points), cmocka_unit_test(far_clusters)};

	for (unsigned i = 0; i < CELLS * CELLS; i++)
		make_cell(i % CELLS, i / CELLS);
	return cmocka_run_group_tests(tests, NULL, NULL);
}
