/*
 * The whole engine in one process, without daemon: points to a segment on disk, plan, domains, emitter. Small
 * coordinate ranges, duplicates, collinear strips, full-range corners, many tiny regions: for any load, the mesh is
 * that of one single region, its digests agree, also if they are only added up, and a verifier that shares no code
 * accepts it.
 *
 * ACUT_FUZZ_CASES sets the number of random sets (default 2,000).
 */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "grid_stage.h"
#include "ledger.h"
#include "pipe.h"
#include "pipe_inner.h"
#include "pipe_priv.h"
#include "tri.h"
#include "verify.h"
#include "repeat.h"

static uint64_t seed;
static char folder[64];
static int dirfd_;

static uint32_t rnd(uint32_t n)
{
	seed = seed * 6364136223846793005u + 1442695040888963407u;
	return n ? (uint32_t)((seed >> 33) % n) : 0;
}

struct mesh {
	struct mesh_vertex *vertex;
	uint32_t (*triangle)[3];
	size_t nvertex, ntriangle;
	struct pipe_totals totals;
	size_t split;        /* leaves that were split */
	struct digest order; /* of the blocks, with their vertices and triangles in order */
	int status;
	char error[sizeof(((struct err *)0)->message)];
};

static struct digest blocks_and(struct digest before, const struct mesh_block *b)
{
	const struct digest all[] = {before, digest_hash(b->vertex, b->nnew * sizeof *b->vertex),
				     digest_hash(b->foreign, b->nforeign * sizeof *b->foreign),
				     digest_hash(b->triangle, b->ntriangle * sizeof *b->triangle)};

	return digest_hash(all, sizeof all);
}

static int collect(void *ctx, const struct mesh_block *b, struct err *err)
{
	struct mesh *m = ctx;
	uint32_t i, k;

	(void)err;
	assert_int_equal(b->first, m->nvertex);
	m->order = blocks_and(m->order, b);
	m->vertex = realloc(m->vertex, (m->nvertex + b->nnew + 1) * sizeof *m->vertex);
	memcpy(m->vertex + m->nvertex, b->vertex, b->nnew * sizeof *m->vertex);
	m->nvertex += b->nnew;
	m->triangle = realloc(m->triangle, (m->ntriangle + b->ntriangle + 1) * sizeof *m->triangle);
	for (i = 0; i < b->ntriangle; i++, m->ntriangle++)
		for (k = 0; k < 3; k++) {
			uint32_t c = b->triangle[i][k];

			assert_true(c < b->nforeign + b->nnew);
			m->triangle[m->ntriangle][k] = (uint32_t)(c < b->nforeign ? b->foreign[c] : b->first + c - b->nforeign);
		}
	return 0;
}

static void mesh_free(struct mesh *m)
{
	free(m->vertex);
	free(m->triangle);
}

/* One sealed segment and its manifest "m". */
static struct grid *cache_make(const struct point *pts, size_t n, struct ledger *ledger)
{
	struct grid_stage_params params = {.dirfd = dirfd_, .name = "s", .memory = 1 << 20};
	struct grid_source source = {.id = 1, .added = 1, .points = n, .name = "test"};
	struct grid_manifest manifest = {.lattice = {{1, -2}, {1, -2}, {0, 0, 0}}, .generation = 1};
	struct grid_segment_info info;
	struct grid_stage *stage = NULL;
	struct grid *grid = NULL;
	struct err err = ERR_INIT;

	assert_int_equal(grid_stage_new(&params, &stage, &err), 0);
	assert_int_equal(grid_stage_source(stage, 1, &err), 0);
	assert_int_equal(grid_stage_add(stage, pts, n, &err), 0);
	assert_int_equal(grid_stage_seal(stage, &info, &err), 0);
	grid_stage_free(stage);
	strcpy(manifest.crs, "unknown");
	strcpy(manifest.unit_xy, "unknown");
	strcpy(manifest.unit_z, "unknown");
	manifest.segments = &info;
	manifest.nsegments = 1;
	manifest.sources = &source;
	manifest.nsources = 1;
	assert_int_equal(grid_manifest_write(dirfd_, "m", &manifest, &err), 0);
	assert_int_equal(grid_open(dirfd_, "m", 1, ledger, 1 << 20, &grid, &err), 0);
	return grid;
}

static const struct pipe_known *known_of(const struct cut_plan *plan, size_t i, struct pipe_known *ret)
{
	*ret = (struct pipe_known){.sites = plan->leaf[i].known ? plan->sites : NULL, .flat = plan->leaf[i].flat};
	return ret;
}

/* Every leaf in order; a region that does not fit is split, as the daemon does. */
static int run_leaves(struct grid *grid, const struct view *view, struct cut_plan *plan, const struct pipe_budget *budget,
		      struct grid_reader *reader, struct pipe_emitter *emitter, struct pipe_emitter *sums, struct mesh *m,
		      struct err *err)
{
	struct mesh_sink sink = {m, collect};
	void *memory = aligned_alloc(64, (budget->domain_bytes + 63) & ~(size_t)63);
	struct pipe_known known;
	struct mesh_domain domain;
	uint64_t need;
	int r = 0;

	for (size_t i = 0; !r && i < plan->n; i++) {
		r = pipe_domain(grid, view, &plan->leaf[i].region, known_of(plan, i, &known), budget, memory, &domain, &need,
				err);
		while (r == PIPE_E_SPLIT) {
			r = cut_plan_split(plan, i, reader, need, budget->cap, err);
			if (!r)
				r = pipe_domain(grid, view, &plan->leaf[i].region, known_of(plan, i, &known), budget, memory,
						&domain, &need, err);
		}
		if (!r)
			r = pipe_emit(sums, &domain, &plan->leaf[i].region, NULL, err);
		if (!r)
			r = pipe_emit(emitter, &domain, &plan->leaf[i].region, &sink, err);
	}
	free(memory);
	return r;
}

static void mesh_make(struct grid *grid, const struct view *view, uint32_t load, uint32_t cap, struct mesh *m)
{
	size_t reader_size = grid_reader_bytes(grid);
	struct pipe_budget budget = {.load = load, .cap = cap, .threads = 1, .domain_bytes = pipe_domain_bytes(cap, reader_size)};
	struct pipe_emitter *emitter = NULL, *sums = NULL;
	struct pipe_totals added;
	struct grid_reader *reader = NULL;
	struct cut_plan plan = {0};
	struct err err = ERR_INIT;
	void *memory = malloc(reader_size);
	struct mesh_counts scanned;
	bool flat;

	*m = (struct mesh){0};
	assert_int_equal(grid_reader_new(grid, memory, reader_size, &reader, &err), 0);
	assert_int_equal(pipe_emitter_new(&grid_manifest(grid)->lattice, 1 << 17, dirfd_, &emitter, &err), 0);
	assert_int_equal(pipe_emitter_new(&grid_manifest(grid)->lattice, 1 << 17, dirfd_, &sums, &err), 0);
	pipe_emitter_sums(sums, true);
	m->status = cut_plan_make(reader, load, &plan, &err);
	assert_int_equal(pipe_flat_scan(reader, view, &flat, &scanned, &err), 0);
	if (flat)
		cut_plan_make_flat(&plan);
	m->split = plan.n;
	if (!m->status)
		m->status = run_leaves(grid, view, &plan, &budget, reader, emitter, sums, m, &err);
	if (!m->status)
		m->status = pipe_emitter_finish(emitter, &m->totals, &err);
	m->split = plan.n - m->split;
	/* The totals without emission are the same. */
	if (!m->status) {
		assert_int_equal(pipe_emitter_finish(sums, &added, &err), 0);
		assert_memory_equal(&added, &m->totals, sizeof added);
	}
	pipe_emitter_free(sums);
	memcpy(m->error, err.message, sizeof m->error);
	if (m->status && m->status != -ERR_LIMIT)
		fail_msg("seed %llu: %s", (unsigned long long)seed, err.message);
	cut_plan_done(&plan);
	pipe_emitter_free(emitter);
	grid_reader_free(reader);
	free(memory);
}

static size_t make_points(struct point *pts, uint64_t which)
{
	static const int32_t corner[] = {INT32_MIN, INT32_MIN + 1, 0, INT32_MAX - 1, INT32_MAX};
	uint32_t range = 1 + rnd(6), n = 1 + rnd(which % 10 == 9 ? 200 : 40), kind = rnd(6);

	for (uint32_t i = 0; i < n; i++) {
		int32_t x = (int32_t)rnd(range), y = (int32_t)rnd(range);

		switch (kind) {
		case 0:
			x = corner[rnd(5)];
			y = corner[rnd(5)];
			break;
		case 1: /* a collinear strip and similar */
			y = x * 3 - 7;
			break;
		case 2: /* two far clusters */
			x += rnd(2) ? 2000000000 : -2000000000;
			break;
		case 3: /* around a high cut */
			x -= 3;
			y = (int32_t)rnd(3) - 1;
			break;
		case 4:
			x = (int32_t)rnd(1000);
			y = (int32_t)rnd(1000);
			break;
		}
		pts[i] = (struct point){.x = x, .y = y, .z = (int32_t)rnd(50), .cls = (uint8_t)(1 + rnd(3)), .ret = 0x11};
	}
	return n;
}

static void check_same(const struct mesh *a, const struct mesh *b)
{
	assert_true(digest_equal(a->totals.digest, b->totals.digest));
	assert_true(digest_equal(a->totals.vertex_digest, b->totals.vertex_digest));
	assert_int_equal(a->totals.hull, b->totals.hull);
	assert_int_equal(a->totals.counts.used, b->totals.counts.used);
	assert_int_equal(a->totals.counts.most.points, b->totals.counts.most.points);
	assert_true(a->totals.counts.most.x == b->totals.counts.most.x && a->totals.counts.most.y == b->totals.counts.most.y);
	assert_memory_equal(a->totals.counts.removed, b->totals.counts.removed, sizeof a->totals.counts.removed);
}

static void check_verified(const struct mesh *m, const struct view *view, struct point *pts, size_t n)
{
	struct verify_mesh mesh = {(const int32_t(*)[3])m->vertex, (const uint32_t(*)[3])m->triangle, m->nvertex, m->ntriangle};
	struct verify_report report;
	struct err err = ERR_INIT;

	assert_int_equal(verify_mesh(&mesh, &report, &err), 0);
	if (report.fault == VERIFY_GOOD)
		assert_int_equal(verify_points(&mesh, view, pts, n, &report, &err), 0);
	if (report.fault != VERIFY_GOOD)
		fail_msg("seed %llu: %s", (unsigned long long)seed, report.text);
}

/* The position that most points share, by brute force. */
static void check_most(const struct mesh *m, const struct point *pts, size_t n)
{
	struct mesh_most most = {0};

	for (size_t i = 0; i < n; i++) {
		uint64_t here = 0;

		for (size_t k = 0; k < n; k++)
			here += pts[k].x == pts[i].x && pts[k].y == pts[i].y;
		mesh_most_add(&most, here > 1 ? here : 0, pts[i].x, pts[i].y);
	}
	assert_int_equal(m->totals.counts.most.points, most.points);
	assert_true(m->totals.counts.most.x == most.x && m->totals.counts.most.y == most.y);
}

static void test_fuzz(void **state)
{
	uint64_t n = repeat_cases(2000), meshes = 0;
	struct point pts[256];

	(void)state;
	for (uint64_t i = 0; i < n; i++) {
		struct ledger *ledger = ledger_new(1 << 26);
		struct view view = VIEW_INIT;
		struct mesh whole, parts;
		struct grid *grid;
		size_t count;

		seed = i * 7919 + 1;
		count = make_points(pts, i);
		if (rnd(3) == 0)
			view.duplicates = VIEW_HIGHEST;
		grid = cache_make(pts, count, ledger);
		mesh_make(grid, &view, 1 << 15, 1 << 15, &whole);
		assert_int_equal(whole.status, 0);
		check_most(&whole, pts, count);
		check_verified(&whole, &view, pts, count); /* sorts and reduces them */
		for (uint32_t k = 0; k < 3; k++) {
			mesh_make(grid, &view, 1 + rnd(8), 1 << 14, &parts);
			assert_int_equal(parts.status, 0);
			check_same(&whole, &parts);
			mesh_free(&parts);
			meshes++;
		}
		mesh_free(&whole);
		grid_close(grid);
		ledger_free(ledger);
	}
	print_message("%llu sets, %llu partitions\n", (unsigned long long)n, (unsigned long long)meshes);
}

static int setup(void **state)
{
	(void)state;
	/* In memory if possible, because thousands of small segments are fsynced. */
	strcpy(folder, access("/dev/shm", W_OK) ? "/tmp/acut-engine-XXXXXX" : "/dev/shm/acut-engine-XXXXXX");
	if (!mkdtemp(folder))
		return -1;
	dirfd_ = open(folder, O_RDONLY | O_DIRECTORY);
	return dirfd_ < 0;
}

static int teardown(void **state)
{
	(void)state;
	close(dirfd_);
	return repeat_remove(folder);
}

/*
 * On a parabola an empty region beside it sees half of all points: more than fits a domain's first, small scratch, so
 * its halo is found again with all the memory. Nothing is split for it, because it fits the cap.
 */
static void test_wide_halo(void **state)
{
	enum { N = 120000, CAP = 1 << 18 };
	struct ledger *ledger = ledger_new(1 << 28);
	struct point *pts = calloc(N, sizeof *pts);
	struct view view = VIEW_INIT;
	struct mesh whole, parts;
	struct grid *grid;

	(void)state;
	for (int32_t i = 0; i < N; i++) {
		int32_t x = i - N / 2;

		pts[i] = (struct point){.x = x, .y = (int32_t)((int64_t)x * (x - 1) / 2 - 1000000000), .cls = 2, .ret = 0x11};
	}
	grid = cache_make(pts, N, ledger);
	mesh_make(grid, &view, CAP, CAP, &whole);
	mesh_make(grid, &view, 1 << 15, CAP, &parts);
	assert_int_equal(whole.status, 0);
	assert_int_equal(parts.status, 0);
	assert_int_equal(parts.split, 0);
	check_same(&whole, &parts);
	mesh_free(&whole);
	mesh_free(&parts);
	grid_close(grid);
	ledger_free(ledger);
	free(pts);
}

/* n points of a row of shapes without triangles. */
static struct point flat_point(const char *shape, int32_t i)
{
	struct point p = {.z = i % 7, .cls = 2, .ret = 0x11};

	if (!strcmp(shape, "one position")) {
		p.x = p.y = -5;
	} else if (!strcmp(shape, "two positions")) {
		p.x = i % 2 ? INT32_MAX : INT32_MIN;
	} else if (!strcmp(shape, "axis")) {
		p.x = 77;
		p.y = i * 31 - 60000;
	} else if (!strcmp(shape, "diagonal")) {
		p.x = p.y = i - 1000;
	} else { /* slanted, each position twice */
		p.x = i / 2 * 2000;
		p.y = i / 2 * -3001 + 17;
	}
	return p;
}

/* A row with a large radius hides positions on both of its sides, through which regions do not see it without weights. With them
 * they depend on all of the row, and halving leaves too much. With a small radius there is a mesh. */
static void test_wide_weights(void **state)
{
	enum { ROW = 20000, FEW = 200, N = ROW + FEW + 3 };
	struct point *pts = calloc(N, sizeof *pts);
	struct view view = VIEW_INIT, small = VIEW_INIT;
	struct ledger *ledger = ledger_new(UINT64_C(1) << 30);
	struct grid *grid;
	struct mesh m;

	(void)state;
	for (int i = 0; i < N; i++)
		pts[i] = (struct point){.x = 6000, .y = i, .cls = 2, .ret = 0x11};
	for (int i = ROW; i < ROW + FEW; i++)
		pts[i] = (struct point){.x = i % 2 ? 5000 : 7000, .y = i % FEW * (ROW / FEW), .ret = 0x11};
	for (int i = ROW + FEW; i < N; i++)
		pts[i] = (struct point){.x = 1000000, .y = i % 3 * (ROW / 3), .ret = 0x11};
	assert_true(view_weight_set(&view, 2, 100000) && view_weight_set(&small, 2, 10));
	grid = cache_make(pts, N, ledger);
	mesh_make(grid, &view, 1 << 13, 1 << 14, &m);
	assert_int_equal(m.status, -ERR_LIMIT);
	assert_non_null(strstr(m.error, "because of the radii of --weight"));
	mesh_free(&m);
	mesh_make(grid, &small, 1 << 13, 1 << 14, &m);
	assert_int_equal(m.status, 0);
	mesh_free(&m);
	grid_close(grid);
	ledger_free(ledger);
	free(pts);
}

/* Vertices and no triangles: every position once, for any load; and triangles as soon as one is off the line. */
static void test_flat(void **state)
{
	static const char *const shape[] = {"one position", "two positions", "axis", "diagonal", "slanted"};
	enum { N = 4001 };
	struct point *pts = calloc(N + 1, sizeof *pts);

	(void)state;
	for (size_t s = 0; s < sizeof shape / sizeof *shape; s++) {
		struct ledger *ledger = ledger_new(1 << 26);
		struct view view = VIEW_INIT;
		struct mesh whole, parts;
		struct grid *grid;

		for (int32_t i = 0; i < N; i++)
			pts[i] = flat_point(shape[s], i);
		grid = cache_make(pts, N, ledger);
		mesh_make(grid, &view, 1 << 15, 1 << 15, &whole);
		mesh_make(grid, &view, 50, 1 << 14, &parts);
		assert_true(!whole.status && !parts.status);
		assert_true(!whole.ntriangle && !whole.totals.hull && digest_is_zero(whole.totals.digest));
		assert_int_equal(whole.nvertex, s < 2 ? s + 1 : s == 4 ? N / 2 + 1 : N);
		check_verified(&whole, &view, pts, N);
		check_verified(&parts, &view, pts, N);
		check_same(&whole, &parts);
		mesh_free(&whole);
		mesh_free(&parts);
		grid_close(grid);
		pts[N] = (struct point){.x = 3, .y = -4, .cls = 2, .ret = 0x11};
		grid = cache_make(pts, N + 1, ledger);
		mesh_make(grid, &view, 1 << 15, 1 << 15, &whole);
		assert_int_equal(whole.status, 0);
		assert_true(whole.ntriangle || s == 0);
		check_verified(&whole, &view, pts, N + 1);
		mesh_free(&whole);
		grid_close(grid);
		ledger_free(ledger);
	}
	free(pts);
}

/* Points of the order test: scattered, with equal positions, and a regular grid, which the kernel makes in another way. */
static size_t order_points(unsigned kind, struct point *pts)
{
	enum { SIDE = 60 };

	for (uint32_t i = 0; i < SIDE * SIDE; i++)
		pts[i] = (struct point){.x = kind ? (int32_t)(i % SIDE) * 10 : (int32_t)rnd(500),
					.y = kind ? (int32_t)(i / SIDE) * 10 : (int32_t)rnd(500),
					.z = (int32_t)rnd(50),
					.cls = 2,
					.ret = 0x11};
	return SIDE * SIDE;
}

/* Streams are resumed, and files of a cluster written by several tasks, by the numbers of vertices and triangles. */
static void test_order(void **state)
{
	static const char kernel[] = "kernel 5", *const want[] = {"50734be1aa8db4e236aa6001e342c6a1",
								  "509656e2b815bc83879a09a6401a7184"};
	struct point *pts = calloc(3600, sizeof *pts);
	char hex[DIGEST_HEX_SIZE];

	(void)state;
	for (unsigned kind = 0; kind < 2; kind++) {
		struct ledger *ledger = ledger_new(1 << 26);
		struct view view = VIEW_INIT;
		struct mesh mesh;
		struct grid *grid;

		seed = 1;
		grid = cache_make(pts, order_points(kind, pts), ledger);
		mesh_make(grid, &view, 500, 1 << 14, &mesh);
		assert_int_equal(mesh.status, 0);
		if (strcmp(digest_hex(mesh.order, hex), want[kind]) != 0 || strcmp(PIPE_KERNEL, kernel) != 0)
			fail_msg("the order of blocks has changed: raise PIPE_KERNEL in engine/pipe/pipe.h, and change it and "
				 "the digest here, set %u: %s",
				 kind, hex);
		mesh_free(&mesh);
		grid_close(grid);
		ledger_free(ledger);
	}
	free(pts);
}

static int by_number(const void *a, const void *b)
{
	const int32_t *p = a, *q = b;

	return (*p > *q) - (*p < *q);
}

/* The box of most points against sorted coordinates, and the position with the most points. */
static void test_inner(void **state)
{
	static const size_t counts[] = {1, 5999, 6000, 25000};
	struct point *pts = calloc(25000, sizeof *pts);
	int32_t *sorted = malloc(25000 * sizeof *sorted);

	(void)state;
	for (uint32_t i = 0; i < 16; i++) {
		struct ledger *ledger = ledger_new(1 << 26);
		struct pipe_inspected in = {.points = counts[i % 4]};
		struct pipe_inspect_params params = {0};
		struct grid_reader *reader = NULL;
		struct err err = ERR_INIT;
		struct grid *grid;
		void *memory;

		seed = i;
		for (size_t k = 0; k < in.points; k++) {
			uint32_t far = rnd(2000);
			int32_t range = i < 8 ? 3000 : 4;

			pts[k] = (struct point){.x = far == 0 ? INT32_MIN : (int32_t)rnd((uint32_t)range),
						.y = far == 1 ? INT32_MAX : -(int32_t)rnd(7000),
						.z = far == 2 ? INT32_MIN :
						     far == 3 ? INT32_MAX :
								(int32_t)rnd(500),
						.ret = 0x11};
		}
		grid = cache_make(pts, in.points, ledger);
		params.lattice = &grid_manifest(grid)->lattice;
		memory = malloc(grid_reader_bytes(grid));
		assert_int_equal(grid_reader_new(grid, memory, grid_reader_bytes(grid), &reader, &err), 0);
		assert_int_equal(pipe_inner(reader, &params, &in, &err), 0);
		for (unsigned axis = 0; axis < 3; axis++) {
			size_t beyond = in.points / 6000;
			const double scale = 100; /* both scales of the lattice are a hundredth */

			for (size_t k = 0; k < in.points; k++)
				sorted[k] = axis == 0 ? pts[k].x : axis == 1 ? pts[k].y : pts[k].z;
			qsort(sorted, in.points, sizeof *sorted, by_number);
			assert_true(in.inner_min[axis] == sorted[beyond] / scale);
			assert_true(in.inner_max[axis] == sorted[in.points - 1 - beyond] / scale);
		}
		assert_true(i < 8 || in.points < 100 || in.most.points > 1);
		grid_reader_free(reader);
		free(memory);
		grid_close(grid);
		ledger_free(ledger);
	}
	free(sorted);
	free(pts);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_wide_halo), cmocka_unit_test(test_wide_weights),
					   cmocka_unit_test(test_flat),      cmocka_unit_test(test_order),
					   cmocka_unit_test(test_inner),     cmocka_unit_test(test_fuzz)};

	return cmocka_run_group_tests(tests, setup, teardown);
}
