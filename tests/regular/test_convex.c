/*
 * Points in convex position, with weights: every region depends on positions all around, and nearly every disc is as large as the
 * survey. The domains of small regions are the mesh of one region, with a bounded number of steps; each of them can be cancelled,
 * and so can an area.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "grid_fixture.h"
#include "pipe.h"
#include "pipe_priv.h"

enum { REACH = 80, LOAD = 4096, CAP = 1 << 14, WHOLE = 1 << 15 };

static struct folder folder;
static struct reader reader;
static struct set set;

/* ---- domains ---- */

/* Calls of `progress`, at the last of which it cancels. */
struct watch {
	unsigned calls, last;
};

static int watch(void *ctx)
{
	struct watch *w = ctx;

	return ++w->calls == w->last;
}

static int domain_of(const struct view *view, const struct cut_region *region, uint32_t cap, struct watch *w, void *memory,
		     struct mesh_domain *ret, struct err *err)
{
	const struct pipe_budget budget = {
		.load = LOAD, .cap = cap, .domain_bytes = pipe_domain_bytes(cap, grid_reader_bytes(reader.grid)), .threads = 1};
	const struct pipe_known known = {.progress = watch, .ctx = w};
	uint64_t need;

	return pipe_domain(reader.grid, view, region, &known, &budget, memory, ret, &need, err);
}

static void *memory_of(uint32_t cap)
{
	void *memory = aligned_alloc(64, (pipe_domain_bytes(cap, grid_reader_bytes(reader.grid)) + 63) & ~(size_t)63);

	assert_non_null(memory);
	return memory;
}

static struct digest whole(const struct view *view, const struct cut_region *root)
{
	void *memory = memory_of(WHOLE);
	struct err err = ERR_INIT;
	struct mesh_domain d;
	struct watch w = {0};

	assert_int_equal(domain_of(view, root, WHOLE, &w, memory, &d, &err), 0);
	assert_int_equal(d.ntriangle, set.n - 2);
	free(memory);
	return d.digest;
}

static void regions(struct cut_plan *ret, struct cut_region *ret_root)
{
	struct err err = ERR_INIT;
	int32_t box[4];

	assert_true(grid_box(reader.grid, box));
	cut_region_root(box, ret_root);
	CHECK(cut_plan_make(reader.r, LOAD, ret, &err));
	assert_true(ret->n > 4);
}

static void domains_are_made_fast(void **state)
{
	static const int32_t radius[] = {1, 30, 600};
	void *memory = memory_of(CAP);
	struct cut_region root;
	struct cut_plan plan;

	(void)state;
	regions(&plan, &root);
	for (unsigned i = 0; i < 3; i++) {
		struct digest sum = {0, 0}, all;
		struct view view = VIEW_INIT;
		struct err err = ERR_INIT;
		struct watch w = {0};
		uint64_t read = 0;

		view_weight_set(&view, 2, radius[i]);
		all = whole(&view, &root);
		for (size_t k = 0; k < plan.n; k++) {
			struct mesh_domain d;

			CHECK(domain_of(&view, &plan.leaf[k].region, CAP, &w, memory, &d, &err));
			digest_add(&sum, d.digest);
			read += d.counts.points_read;
		}
		assert_true(digest_equal(sum, all));
		print_message("radius %d: %zu positions, %zu domains, %u calls, %llu records read\n", radius[i], set.n, plan.n,
			      w.calls, (unsigned long long)read);
		assert_in_range(w.calls, plan.n, 10 * plan.n);
		assert_true(read < 8 * plan.n * set.n);
		view_done(&view);
	}
	cut_plan_done(&plan);
	free(memory);
}

/* At any call. */
static void cancel(const struct view *view, const struct cut_region *region, uint32_t cap, unsigned least)
{
	void *memory = memory_of(cap);
	struct mesh_domain d;
	struct err err = ERR_INIT;
	struct watch all = {0};

	CHECK(domain_of(view, region, cap, &all, memory, &d, &err));
	assert_true(all.calls >= least);
	for (unsigned i = 1; i <= all.calls; i++) {
		struct watch w = {.last = i};

		err = ERR_INIT;
		assert_int_equal(domain_of(view, region, cap, &w, memory, &d, &err), -ERR_CANCELLED);
		assert_int_equal(err.code, ERR_CANCELLED);
		assert_int_equal(w.calls, i);
	}
	free(memory);
}

static void any_call_cancels(void **state)
{
	struct view view = VIEW_INIT;
	struct cut_region root;
	struct cut_plan plan;

	(void)state;
	regions(&plan, &root);
	view_weight_set(&view, 2, 600);
	cancel(&view, &plan.leaf[0].region, CAP, 2);
	cancel(&view, &root, WHOLE, 2);
	view.window = VIEW_CROP_BOX;
	for (unsigned k = 0; k < 4; k++)
		view.window_box[k] = k < 2 ? INT32_MIN : INT32_MAX;
	cancel(&view, &root, WHOLE, 1);
	cut_plan_done(&plan);
	view_done(&view);
}

static int set_up(void **state)
{
	struct grid_segment_info segment;
	struct grid_manifest m;
	struct err err = ERR_INIT;

	(void)state;
	no_sync();
	folder = folder_new();
	set = set_polygon(REACH);
	stage_sources(&folder, &set, 1, &segment);
	m = manifest_of(&segment, 1, 1);
	manifest_count(&m, &set);
	CHECK(grid_manifest_write(folder.fd, "m", &m, &err));
	free(m.sources);
	reader = reader_open(&folder, "m", 1, 1 << 22);
	return 0;
}

static int tear_down(void **state)
{
	(void)state;
	reader_close(&reader);
	set_free(&set);
	folder_remove(&folder);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(domains_are_made_fast), cmocka_unit_test(any_call_cancels)};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
