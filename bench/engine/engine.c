/*
 * Where the engine's time goes, one thread, without daemon: ingest, seal, then each domain, its emission and its
 * digests, CPU time a point. usage: bench-engine FILE.las FOLDER [MEMORY]
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "ledger.h"
#include "parse.h"
#include "pipe.h"

static double cpu(void)
{
	struct timespec t;

	clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
	return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static double last;

static void lap(const char *what, uint64_t points)
{
	double now = cpu();

	printf("%-10s %8.3f s %8.4f us a point\n", what, now - last, (now - last) * 1e6 / (double)(points ? points : 1));
	last = cpu();
}

static int ingest(int dirfd, const char *path, struct grid_segment_info *info, struct lattice *lattice, size_t memory,
		  struct err *err)
{
	struct grid_stage_params params = { .dirfd = dirfd, .name = "bench", .memory = memory };
	struct input_options options = { .planar = true };
	struct grid_stage *stage = NULL;
	struct pipe_ingested in = { 0 };
	struct input *input = NULL;
	int fd, r;

	r = io_open(AT_FDCWD, path, O_RDONLY, 0, &fd, err);
	if (!r)
		r = input_open(fd, path, &options, &input, err);
	if (!r)
		r = lattice_choose(&input_info(input)->coords, 1, NULL, NULL, lattice, err);
	if (!r)
		r = grid_stage_new(&params, &stage, err);
	if (!r)
		r = grid_stage_source(stage, 1, err);
	last = cpu();
	if (!r) {
		const struct pipe_ingest_params how = { .lattice = lattice, .stage = stage };

		r = pipe_ingest(input, &how, &in, err);
	}
	lap("ingest", in.points);
	if (!r)
		r = grid_stage_seal(stage, info, err);
	lap("seal", in.points);
	grid_stage_free(stage);
	input_close(input);
	return r;
}

static int mesh(struct grid *grid, uint64_t memory, int dirfd, struct err *err)
{
	double domains = 0, emission = 0, start;
	size_t reader_size = grid_reader_bytes(grid);
	struct view view = VIEW_INIT;
	struct grid_reader *reader = NULL;
	struct pipe_emitter *emitter = NULL;
	struct cut_plan plan = { 0 };
	struct pipe_budget budget;
	struct pipe_totals totals;
	struct mesh_counts flat;
	struct mesh_domain domain;
	void *block;
	uint64_t need;
	int r;

	r = pipe_budget(memory, 2, grid, &budget, err);
	if (r)
		return r;
	block = aligned_alloc(64, (budget.domain_bytes + 63) & ~(size_t)63);
	r = grid_reader_new(grid, malloc(reader_size), reader_size, &reader, err);
	if (!r)
		r = pipe_plan(grid, &view, &budget, block, &plan, &flat, err);
	if (r == PIPE_E_FLAT)
		r = 0;
	if (!r)
		r = pipe_emitter_new(&grid_manifest(grid)->lattice, 8 << 20, dirfd, &emitter, err);
	lap("plan", grid_points(grid));
	for (size_t i = 0; !r && i < plan.n; i++) {
		start = cpu();
		while ((r = pipe_domain(grid, &view, &plan.leaf[i].region, &budget, block, &domain, &need, err)) == PIPE_E_SPLIT)
			if ((r = cut_plan_split(&plan, i, reader, need, budget.cap, err)))
				break;
		domains += cpu() - start;
		start = cpu();
		if (!r)
			r = pipe_emit(emitter, &domain, &plan.leaf[i].region, NULL, err);
		emission += cpu() - start;
	}
	if (!r)
		r = pipe_emitter_finish(emitter, &totals, err);
	if (r)
		return r;
	printf("%-10s %8.3f s %8.4f us a point\n", "domains", domains, domains * 1e6 / (double)grid_points(grid));
	printf("%-10s %8.3f s %8.4f us a point\n", "emission", emission, emission * 1e6 / (double)grid_points(grid));
	char a[DIGEST_HEX_SIZE], b[DIGEST_HEX_SIZE];
	printf("load %u, %zu domains, halo %.2f %%, %llu triangles, %s %s\n", budget.load, plan.n,
	       100.0 * (double)totals.counts.halo / (double)totals.counts.used, (unsigned long long)totals.triangles,
	       digest_hex(totals.digest, a), digest_hex(totals.vertex_digest, b));
	return 0;
}

int main(int argc, char **argv)
{
	struct grid_manifest manifest = { .generation = 1, .crs = "unknown", .unit_xy = "unknown", .unit_z = "unknown" };
	struct grid_source source = { .id = 1, .added = 1, .name = "bench" };
	struct grid_segment_info info;
	uint64_t memory = 256 << 20;
	struct err err = ERR_INIT;
	struct grid *grid = NULL;
	struct ledger *ledger;
	char text[1600];
	int dirfd, r;

	if (argc < 3 || (argc > 3 && !parse_size(argv[3], &memory))) {
		fputs("usage: bench-engine FILE.las FOLDER [MEMORY]\n", stderr);
		return 2;
	}
	ledger = ledger_new(memory);
	r = io_open(AT_FDCWD, argv[2], O_RDONLY | O_DIRECTORY, 0, &dirfd, &err);
	if (!r)
		r = ingest(dirfd, argv[1], &info, &manifest.lattice, memory / 2, &err);
	manifest.segments = &info;
	manifest.sources = &source;
	manifest.nsegments = manifest.nsources = 1;
	source.points = info.points;
	if (!r)
		r = grid_manifest_write(dirfd, "bench.manifest", &manifest, &err);
	if (!r)
		r = grid_open(dirfd, "bench.manifest", 1, ledger, 8 << 20, &grid, &err);
	if (!r)
		r = mesh(grid, memory * 7 / 8, dirfd, &err);
	grid_close(grid);
	if (r) {
		fprintf(stderr, "bench-engine: %s\n", err_format(&err, text, sizeof text));
		return 1;
	}
	return 0;
}
