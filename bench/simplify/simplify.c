/*
 * What a simplification costs and keeps, one thread, without daemon: CPU time of a plain mesh of the same view, of each step, and
 * of the mesh of the result; the share of the points that greedy insertion into one block of all points keeps, and that of the
 * result. usage: bench-simplify FILE.las FOLDER CLASSES ERROR... ("" for all classes; errors in the unit of z; q0.1: without
 * greedy insertion; n1000: a number of points)
 */
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bench_grid.h"
#include "err.h"
#include "io.h"
#include "pipe.h"
#include "simplify.h"
#include "simplify_greedy.h"

enum { MEMORY = 128 << 20 };

static double now(void)
{
	struct timespec t;

	clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
	return (double)t.tv_sec + (double)t.tv_nsec / 1e9;
}

/* As the daemon makes it for a client that discards it: plan, domains, emission without a sink. */
static int mesh(const struct grid *grid, const struct view *view, void *memory, double *ret_seconds, struct pipe_totals *ret,
		struct err *err)
{
	struct pipe_budget budget;
	struct pipe_emitter *emitter = NULL;
	struct cut_plan plan = {.n = 0};
	struct mesh_domain domain;
	struct mesh_counts flat;
	double start = now();
	uint64_t need;
	int r = pipe_budget(2 * MEMORY, 1, grid, &budget, err);

	if (!r)
		r = pipe_plan(grid, view, &budget, memory, &plan, &flat, err);
	if (!r)
		r = pipe_emitter_new(&grid_manifest(grid)->lattice, 64 << 20, AT_FDCWD, &emitter, err);
	for (size_t i = 0; !r && i < plan.n; i++) {
		r = pipe_domain(grid, view, &plan.leaf[i].region, NULL, &budget, memory, &domain, &need, err);
		if (!r)
			r = pipe_emit(emitter, &domain, &plan.leaf[i].region, NULL, err);
	}
	if (!r)
		r = pipe_emitter_finish(emitter, ret, err);
	pipe_emitter_free(emitter);
	cut_plan_done(&plan);
	*ret_seconds = now() - start;
	return r;
}

/* ---- strictly greedy: one block ---- */

struct all {
	const struct view *view;
	struct point *pts;
	size_t n;
};

static int gather(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct all *a = ctx;

	(void)err;
	a->pts = realloc(a->pts, (a->n + n) * sizeof *a->pts);
	for (size_t i = 0; i < n; i++) {
		bool again = a->n && a->pts[a->n - 1].x == pts[i].x && a->pts[a->n - 1].y == pts[i].y;

		if (view_judge(a->view, &pts[i]) != VIEW_KEPT || (again && !view_prefers(a->view, &pts[i], &a->pts[a->n - 1])))
			continue;
		a->n -= again;
		a->pts[a->n++] = pts[i];
	}
	return 0;
}

static int greedy(const struct grid *grid, const struct view *view, int64_t error, double *ret_seconds, uint64_t *ret,
		  struct err *err)
{
	size_t bytes = grid_reader_bytes(grid);
	struct all all = {.view = view};
	struct simplify_greedy g;
	struct grid_reader *reader;
	void *memory;
	int r = grid_reader_new(grid, malloc(bytes), bytes, &reader, err);

	if (!r)
		r = grid_scan(reader, 0, UINT64_MAX, gather, &all, err);
	if (r)
		return r;
	memory = aligned_alloc(64, (simplify_greedy_bytes((uint32_t)all.n) + 63) & ~(size_t)63);
	g = (struct simplify_greedy){
		.pts = all.pts, .n = (uint32_t)all.n, .least = (uint64_t)error << SIMPLIFY_KEY_SHIFT, .step = 500};
	*ret_seconds = now();
	simplify_greedy_run(&g, memory);
	*ret_seconds = now() - *ret_seconds;
	*ret = g.npick + g.nhull;
	free(memory);
	free(all.pts);
	return 0;
}

/* ---- the simplification ---- */

static int steps(struct simplify *s, void *memory, struct err *err)
{
	struct simplify_state state;
	double start;
	int r = 0;

	do {
		start = now();
		simplify_state(s, &state);
		for (uint32_t i = 0; !r && i < simplify_tasks(s); i++)
			r = simplify_task(s, i, memory, err);
		printf("    %s %u-%u: %u tasks %.3f s", simplify_step_text(state.step), state.attempt, state.round,
		       simplify_tasks(s), now() - start);
		start = now();
		if (!r)
			r = simplify_next(s, err);
		printf(", next %.3f s; %" PRIu64 " chosen, %" PRIu64 " new\n", now() - start, state.chosen, state.added);
	} while (!r);
	return r == SIMPLIFY_E_DONE ? 0 : r;
}

static int one(int dirfd, const struct grid *grid, const struct view *view, int64_t error, uint64_t most, bool strict_too,
	       double plain, void *memory, struct err *err)
{
	struct simplify_params p = {
		.grid = grid, .view = view, .max_error = error, .max_points = most, .memory = MEMORY, .index_memory = 8 << 20};
	struct simplify_report report;
	struct pipe_totals totals;
	struct simplify *s = NULL;
	struct grid *result = NULL;
	struct view rest = view_rest(view);
	double cost = now(), last = 0, strict = 0;
	uint64_t kept = 0;
	int r = io_folder_remove(dirfd, "simplified", err);

	if (!r)
		r = io_make_dir(dirfd, "simplified", 0700, err);
	if (!r)
		r = io_open(dirfd, "simplified", O_RDONLY | O_DIRECTORY, 0, &p.dirfd, err);
	if (!r)
		r = simplify_open(&p, &s, err);
	if (!r)
		r = steps(s, memory, err);
	simplify_free(s);
	cost = now() - cost;
	if (!r)
		r = simplify_report_read(p.dirfd, &report, err);
	if (!r)
		r = grid_open(p.dirfd, SIMPLIFY_MANIFEST, GRID_NEWEST, NULL, 8 << 20, &result, err);
	if (!r)
		r = mesh(result, &rest, memory, &last, &totals, err);
	if (!r && !most && strict_too)
		r = greedy(grid, view, error, &strict, &kept, err);
	if (r)
		return r;
	grid_close(result);
	printf("error %" PRId64 ": %" PRIu64 " of %" PRIu64 " points, %.2f %%; seeds %" PRIu64 ", %" PRIu64 " rounds, %" PRIu64
	       " attempts, %.2f tests a point; %.3f s and %.3f s for its mesh, %.2f times the plain mesh",
	       report.max_error, report.kept, report.points, 100.0 * (double)report.kept / (double)report.points, report.seeds,
	       report.rounds, report.attempts, (double)report.tested / (double)report.points, cost, last, (cost + last) / plain);
	if (kept)
		printf("; greedy %.2f %% (%.2f s), %.3f of it", 100.0 * (double)kept / (double)report.points, strict,
		       (double)report.kept / (double)kept);
	printf("\n");
	return 0;
}

static int all(int dirfd, int argc, char **argv, struct err *err)
{
	void *memory = aligned_alloc(2 << 20, 2 * MEMORY);
	struct grid_segment_info info;
	struct pipe_totals totals;
	struct view view = VIEW_INIT;
	struct grid *grid = NULL;
	double plain;
	int r = bench_grid(dirfd, argv[1], MEMORY, NULL, NULL, &info, &grid, err);

	if (r)
		return r;
	if (*argv[3])
		r = view_set_classes(&view, argv[3], err);
	view_bind(&view, &grid_manifest(grid)->lattice);
	if (!r)
		r = mesh(grid, &view, memory, &plain, &totals, err);
	if (!r)
		r = mesh(grid, &view, memory, &plain, &totals, err);
	if (!r)
		printf("%s: %" PRIu64 " points, plain mesh %.3f s, %.3f us a point\n", argv[1], totals.counts.used, plain,
		       plain * 1e6 / (double)totals.counts.used);
	for (int i = 4; !r && i < argc; i++) {
		bool most = argv[i][0] == 'n';  /* n1000: a number of points */
		bool quick = argv[i][0] == 'q'; /* q0.1: without greedy insertion into one block */

		r = one(dirfd, grid, &view,
			most ? 0 :
			       (int64_t)(strtod(argv[i] + quick, NULL) / decimal_double(grid_manifest(grid)->lattice.scale_z) +
					 1e-6),
			most ? strtoull(argv[i] + 1, NULL, 10) : 0, !quick, plain, memory, err);
	}
	grid_close(grid);
	free(memory);
	return r;
}

int main(int argc, char **argv)
{
	struct err err = ERR_INIT;
	char text[1600];
	int dirfd, r;

	if (argc < 5) {
		fputs("usage: bench-simplify FILE.las FOLDER CLASSES ERROR|qERROR|nPOINTS...\n", stderr);
		return 2;
	}
	r = io_open(AT_FDCWD, argv[2], O_RDONLY | O_DIRECTORY, 0, &dirfd, &err);
	if (!r)
		r = all(dirfd, argc, argv, &err);
	if (!r)
		return 0;
	fprintf(stderr, "bench-simplify: %s\n", err_format(&err, text, sizeof text));
	return 1;
}
