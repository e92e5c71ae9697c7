/*
 * Real grids and the kernel: every kind of point set, in one segment and in three that overlap, cut by plans with
 * several loads. The owned triangles of all regions have the digest of the whole; halos are the same for any segments.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "cut.h"
#include "cut_source.h"
#include "cut_valid.h"
#include "digest.h"
#include "grid_fixture.h"
#include "inputs.h"
#include "lineset.h"
#include "tri.h"

enum { N = 20000 };

struct sums {
	struct digest triangles, loaded;
	uint64_t used, halo, ntriangle;
	size_t leaves;
};

static void *arena, *scratch;
static size_t scratch_size;

/* Triangulates the kernel's input; adds what the region owns (NULL: all). */
static void add_owned(struct tri *t, uint32_t n, const struct cut_region *region, struct sums *sums)
{
	struct tri_result r;

	if (tri_run(t, n) == TRI_E_FLAT)
		return;
	tri_result(t, &r);
	for (uint32_t i = 0; i < r.ntriangle; i++) {
		const uint32_t *c = r.triangle[i].corner;
		int64_t corner[3][2];

		if (c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST)
			continue;
		if (region && !cut_region_owns(region, r.xy[c[0]], r.xy[c[1]], r.xy[c[2]]))
			continue;
		for (unsigned k = 0; k < 3; k++) {
			corner[k][0] = r.xy[c[k]][0];
			corner[k][1] = r.xy[c[k]][1];
		}
		digest_add_triangle(&sums->triangles, (const int64_t(*)[2])corner);
		sums->ntriangle++;
	}
}

static void load_all(struct reader *r, uint32_t load, uint32_t cap, struct sums *sums)
{
	const struct view view = VIEW_INIT;
	struct err err = ERR_INIT;
	struct cut_plan plan;

	memset(sums, 0, sizeof(*sums));
	CHECK(cut_plan_make(r->r, load, &plan, &err));
	CHECK(cut_plan_probe_rim(&plan, r->r, &view, cap, scratch, scratch_size, &err));
	sums->leaves = plan.n;
	for (size_t i = 0; i < plan.n; i++) {
		struct tri *t = tri_init(arena, cap);
		struct cut_load l = {.out = tri_input(t), .cap = cap, .scratch = scratch, .scratch_size = scratch_size};
		uint64_t need;

		CHECK(cut_load(r->r, &view, &plan.leaf[i].region, &l, &need, &err));
		assert_true(l.own <= plan.leaf[i].count);
		sums->used += l.own;
		sums->halo += l.counts.halo;
		digest_add(&sums->loaded, digest_hash(l.out, l.n * sizeof(*l.out)));
		add_owned(t, l.n, &plan.leaf[i].region, sums);
	}
	cut_plan_done(&plan);
}

/* A grid of the records: each position once or twice, in one segment or spread over three. */
static struct reader make_grid(struct folder *f, const struct mesh_vertex *v, uint32_t n, unsigned segments)
{
	struct grid_segment_info info[3];
	struct set set[3] = {0};
	struct err err = ERR_INIT;
	struct grid_manifest m;
	struct reader r;

	for (unsigned s = 0; s < segments; s++)
		set[s] = (struct set){calloc(2 * n + 2, sizeof(struct point)), calloc(2 * n + 2, sizeof(uint32_t)), 0};
	for (uint32_t i = 0; i < n; i++)
		for (unsigned k = 0; k < 1 + (i % 10 == 0); k++) {
			/* One point in fifty is in the second segment, one in a thousand in the third: cells that
			 * extend over many regions. */
			unsigned s = segments == 1 ? 0 : (i + k) % 1000 == 7 ? 2 : (i + k) % 50 == 3;

			set[s].ids[set[s].n] = s + 1;
			set[s].pts[set[s].n++] =
				(struct point){.x = v[i].x, .y = v[i].y, .z = v[i].z + (int32_t)k, .cls = 1, .ret = 0x11};
		}
	*f = folder_new();
	for (unsigned s = 0; s < segments; s++) {
		char name[16];

		snprintf(name, sizeof(name), "segment%u", s);
		CHECK(stage_set(f, name, &set[s], 0, &info[s], &err));
		set_free(&set[s]);
	}
	m = manifest_of(info, segments, segments);
	CHECK(grid_manifest_write(f->fd, "manifest", &m, &err));
	free(m.sources);
	r = reader_open(f, "manifest", 1, 1 << 20);
	return r;
}

static void check_kind(const char *kind)
{
	struct sums whole = {0}, got[3];
	uint32_t n;
	struct mesh_vertex *v = input_make(kind, N, 11, &n);
	struct tri *t = tri_init(arena, 2 * N);

	assert_non_null(v);
	memcpy(tri_input(t), v, n * sizeof(*v));
	add_owned(t, n, NULL, &whole);
	for (unsigned segments = 1; segments <= 3; segments += 2) {
		static const uint32_t loads[2] = {3000, 700};
		struct folder f;
		struct reader r = make_grid(&f, v, n, segments);

		for (unsigned k = 0; k < 2; k++) {
			struct sums *s = &got[segments == 1 ? k : 2];

			load_all(&r, loads[k], 2 * N, s);
			assert_int_equal(s->used, n);
			assert_int_equal(s->ntriangle, whole.ntriangle);
			assert_true(digest_equal(s->triangles, whole.triangles));
			/* Positions and heights do not depend on how the records are divided into segments. */
			if (segments == 3 && s->leaves == got[k].leaves)
				assert_true(digest_equal(s->loaded, got[k].loaded));
		}
		reader_close(&r);
		folder_remove(&f);
	}
	print_message("%s: %u positions, %llu triangles; %zu and %zu leaves, halo %.2f %% and %.2f %%\n", kind, n,
		      (unsigned long long)whole.ntriangle, got[0].leaves, got[1].leaves, 100.0 * (double)got[0].halo / n,
		      100.0 * (double)got[1].halo / n);
	free(v);
}

static void parts_are_the_whole(void **state)
{
	scratch_size = cut_load_scratch_bytes(8 * N); /* lines are seen from all sides */
	scratch = malloc(scratch_size);
	arena = aligned_alloc(64, (tri_bytes(2 * N) + 63) & ~(size_t)63);
	assert_non_null(scratch);
	assert_non_null(arena);
	for (unsigned i = 0; i < input_kind_count; i++)
		check_kind(input_kinds[i].name);
	free(arena);
	free(scratch);
}

/* Everything that was live is live, in the same segments: but for another line set it is unknown whether records are marked as
 * before. The sum of pieces of a box comes from the grid. */
static void lines_are_looked_at(void **state)
{
	static const struct grid_lines totals = {.lines = 1, .vertices = 2, .bytes = 4096};
	const struct mesh_vertex v[5] = {{0, 0, 0}, {50, 0, 1}, {0, 50, 2}, {50, 50, 3}, {20, 20, 4}};
	const int32_t box[4] = {0, 0, 60, 60}, far[4] = {30, 30, 60, 60};
	const struct cut_reach nothing = {0};
	struct lineset_piece piece = {{0, 0}, {50, 0}, 0};
	struct err err = ERR_INIT;
	struct grid_manifest m;
	struct cut_region root;
	struct folder f;

	for (unsigned lines = 0; lines < 2; lines++) {
		struct reader r = make_grid(&f, v, 5, 1);
		struct grid_segment_info info = grid_manifest(r.grid)->segments[0];
		struct cut_segment segment[CUT_TRACE_PARTS];
		struct digest sum;
		struct cut_source src;
		struct cut_live live;

		reader_close(&r);
		/* Nothing of them is in the segment. */
		m = manifest_of(&info, 1, 2);
		m.sources[0].points = info.points;
		if (lines) {
			m.sources[1].kind = GRID_LINE_VERTICES;
			m.sources[1].name = "";
			m.sources[1].lines = &totals;
		}
		CHECK(grid_manifest_write(f.fd, "manifest", &m, &err));
		free(m.sources);
		CHECK(lineset_write(f.fd, "lineset-2", &piece, 1, 0, &err));
		r = reader_open(&f, "manifest", 1, 1 << 20);
		cut_source_grid(r.r, &src);
		live.n = (uint32_t)src.parts(src.ctx, live.part, segment, CUT_TRACE_PARTS);
		live.lines = src.lines(src.ctx);
		assert_int_equal(digest_is_zero(live.lines), !lines);
		assert_int_equal(src.line_sum != NULL, lines);
		if (lines) {
			CHECK(src.line_sum(src.ctx, box, &sum, &err));
			assert_false(digest_is_zero(sum));
			CHECK(src.line_sum(src.ctx, far, &sum, &err));
			assert_true(digest_is_zero(sum));
		}
		cut_region_root(info.box, &root);
		assert_true(cut_additions_far(r.grid, &root, &nothing, &live));
		reader_close(&r);
		piece.turns ^= LINESET_LAKE;
		CHECK(lineset_write(f.fd, "lineset-2", &piece, 1, 0, &err));
		r = reader_open(&f, "manifest", 1, 1 << 20);
		assert_int_equal(cut_additions_far(r.grid, &root, &nothing, &live), !lines);
		reader_close(&r);
		folder_remove(&f);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(lines_are_looked_at), cmocka_unit_test(parts_are_the_whole)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
