/*
 * What many segments cost a reader: one set of points as 1, 10, 60 ... segments, and the CPU time to open it, to
 * walk its index, to scan it whole and in 256 parts, to plan it, to find the halos of all its regions, and to triangulate
 * them. Every segment is everywhere, as if each push saw the whole area, or with --tiles each is a square beside the others, as
 * far as the number is one of a square. usage: bench-segments [--tiles] FOLDER [POINTS [SEGMENTS...]]
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "cut.h"
#include "err.h"
#include "grid.h"
#include "grid_stage.h"
#include "mesh.h"
#include "pipe.h"
#include "point.h"
#include "view.h"

static bool tiles;

enum { SIDE = 1 << 22, SOURCES = 4096, STAGE = 64 << 20, CAP = 1 << 18, LOAD = 1 << 15, MESH = 64 << 20 };

static double now(void)
{
	struct timespec t;

	clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
	return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static void check(int r, const struct err *err)
{
	if (r >= 0)
		return;
	fprintf(stderr, "bench-segments: %s %s\n", err->file, err->message);
	exit(1);
}

/* Moves a point of the whole area into the tile of the segment. */
static void into_tile(struct point *p, unsigned number, unsigned segments)
{
	unsigned side = 1;

	while (side * side < segments)
		side++;
	p->x = (int32_t)((p->x + number % side * (int64_t)SIDE) / side);
	p->y = (int32_t)((p->y + number / side * (int64_t)SIDE) / side);
}

static void make_segment(int dirfd, unsigned number, unsigned segments, uint64_t first, uint64_t n, struct grid_segment_info *ret)
{
	char name[32];
	struct grid_stage_params p = {.dirfd = dirfd, .name = name, .memory = STAGE, .temporary = true};
	struct grid_stage *s;
	struct err err = ERR_INIT;

	snprintf(name, sizeof name, "part%u", number);
	check(grid_stage_new(&p, &s, &err), &err);
	check(grid_stage_source(s, number + 1, &err), &err);
	for (uint64_t i = first; i < first + n; i++) {
		uint64_t v = (i + 1) * UINT64_C(0x9e3779b97f4a7c15);

		v = (v ^ v >> 31) * UINT64_C(0xbf58476d1ce4e5b9);
		struct point pt = {
			.x = (int32_t)(v >> 42), .y = (int32_t)(v >> 20 & (SIDE - 1)), .z = (int32_t)(i & 1023), .cls = 2};

		if (tiles)
			into_tile(&pt, number, segments);
		check(grid_stage_add(s, &pt, 1, &err), &err);
	}
	check(grid_stage_seal(s, ret, &err), &err);
	grid_stage_free(s);
}

static void make(int dirfd, unsigned segments, uint64_t points)
{
	struct grid_segment_info *info = calloc(segments, sizeof *info);
	struct grid_source *sources = calloc(segments, sizeof *sources);
	struct grid_manifest m = {.lattice = {.scale_xy = {1, -2}, .scale_z = {1, -2}},
				  .crs = "unknown",
				  .unit_xy = "metre",
				  .unit_z = "metre",
				  .generation = 1,
				  .segments = info,
				  .nsegments = segments,
				  .sources = sources,
				  .nsources = segments};
	struct err err = ERR_INIT;

	for (unsigned i = 0; i < segments; i++) {
		uint64_t first = points * i / segments;

		make_segment(dirfd, i, segments, first, points * (i + 1) / segments - first, &info[i]);
		sources[i] = (struct grid_source){.id = i + 1, .added = 1, .points = info[i].points};
	}
	check(grid_manifest_write(dirfd, "manifest", &m, &err), &err);
	free(info);
	free(sources);
}

static int count_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	*(uint64_t *)ctx += n;
	return 0;
}

static int count_cell(void *ctx, const struct grid_cell *cell)
{
	++*(uint64_t *)ctx;
	return 0;
}

static double scans(struct grid_reader *r, unsigned parts)
{
	uint64_t each = (UINT64_C(1) << 44) / parts, base = UINT64_C(3) << 62, n = 0;
	double from = now();
	struct err err = ERR_INIT;

	if (parts == 1)
		check(grid_scan(r, 0, UINT64_MAX, count_points, &n, &err), &err);
	for (unsigned i = 0; parts > 1 && i < parts; i++)
		check(grid_scan(r, base + i * each, base + (i + 1) * each - 1, count_points, &n, &err), &err);
	return now() - from;
}

static double triangulate(const struct grid *g, const struct view *view, const struct cut_plan *plan)
{
	struct pipe_budget budget;
	struct err err = ERR_INIT;
	uint64_t need;
	void *memory;
	double from;

	check(pipe_budget(MESH, 1, g, &budget, &err), &err);
	memory = aligned_alloc(64, (budget.domain_bytes + 63) & ~(size_t)63);
	from = now();
	for (size_t i = 0; i < plan->n; i++) {
		struct mesh_domain domain;

		check(pipe_domain(g, view, &plan->leaf[i].region, NULL, &budget, memory, &domain, &need, &err), &err);
	}
	from = now() - from;
	free(memory);
	return from;
}

static void measure(int dirfd, unsigned segments)
{
	struct cut_plan plan = {0};
	struct view view = VIEW_INIT;
	const struct grid_visitor v = {.cell = count_cell, .ctx = &(uint64_t){0}};
	size_t scratch_bytes = cut_load_scratch_bytes(CAP);
	void *memory, *scratch = malloc(scratch_bytes);
	struct mesh_vertex *out = malloc(CAP * sizeof *out);
	uint64_t need;
	struct err err = ERR_INIT;
	struct grid_reader *r;
	struct grid *g;
	double t[7], from = now();

	check(grid_open(dirfd, "manifest", GRID_NEWEST, NULL, 4 << 20, &g, &err), &err);
	t[0] = now() - from;
	memory = malloc(grid_reader_bytes(g));
	check(grid_reader_new(g, memory, grid_reader_bytes(g), &r, &err), &err);
	scans(r, 1); /* into the page cache */
	from = now();
	check(grid_walk(r, 0, UINT64_MAX, &v, &err), &err);
	t[1] = now() - from;
	t[2] = scans(r, 1);
	t[3] = scans(r, 256);
	from = now();
	check(cut_plan_make(r, LOAD, &plan, &err), &err);
	t[4] = now() - from;
	view_bind(&view, &grid_manifest(g)->lattice);
	from = now();
	for (size_t i = 0; i < plan.n; i++) {
		struct cut_load load = {.out = out, .cap = CAP, .scratch = scratch, .scratch_size = scratch_bytes};

		check(cut_load(r, &view, &plan.leaf[i].region, &load, &need, &err), &err);
	}
	t[5] = now() - from;
	t[6] = triangulate(g, &view, &plan);
	printf("%8u %9zu %9.4f %9.4f %9.3f %9.3f %9.4f %9.3f %9.3f %9zu\n", segments, plan.n, t[0], t[1], t[2], t[3], t[4], t[5],
	       t[6], grid_reader_bytes(g) >> 10);
	cut_plan_done(&plan);
	grid_reader_free(r);
	free(memory);
	free(scratch);
	free(out);
	grid_close(g);
}

int main(int argc, char **argv)
{
	if (argc > 1 && strcmp(argv[1], "--tiles") == 0) {
		tiles = true;
		argv++;
		argc--;
	}

	uint64_t points = argc > 2 ? strtoull(argv[2], NULL, 10) : 1000000;
	unsigned some[8] = {1, 10, 60}, n = 3;
	int dirfd = argc > 1 ? open(argv[1], O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;

	if (dirfd < 0 || !points || argc > 11) {
		fputs("usage: bench-segments [--tiles] FOLDER [POINTS [SEGMENTS...]]\n", stderr);
		return 2;
	}
	for (int i = 3; i < argc; i++) {
		some[i - 3] = (unsigned)strtoul(argv[i], NULL, 10);
		n = (unsigned)i - 2;
	}
	puts("segments   regions    open s    walk s    scan s  parts s    plan s   loads s    mesh s  reader K");
	for (unsigned i = 0; i < n && some[i] && some[i] <= SOURCES; i++) {
		make(dirfd, some[i], points);
		measure(dirfd, some[i]);
	}
	return 0;
}
