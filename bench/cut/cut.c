/*
 * What cutting costs: read amplification, halo share and CPU time of loading every domain of a plan, over
 * real grids in a temporary folder. `bench-cut [POINTS [INPUT]]`.
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
#include "inputs.h"

static const char *const names[] = {"bench.acut", "bench"};

static double now(void)
{
	struct timespec t;

	clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
	return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void must(int rc, const struct err *err)
{
	char text[1200];

	if (rc == 0)
		return;
	fprintf(stderr, "bench-cut: %s\n", rc < 0 ? err_format(err, text, sizeof(text)) : "a domain does not fit");
	exit(1);
}

/* Thin strips, along an axis and not. */
static struct mesh_vertex *corridor(const char *kind, uint32_t n, uint32_t *ret_n)
{
	/* Directions of the lattice; pipelines are 300 km by 500 m in centimetres. */
	static const struct {
		const char *kind;
		int64_t x, y, norm, length, width;
	} strips[] = {
		{"corridor", 2, 1, 2, 1000000000, 1000000},
		{"pipeline", 1, 0, 1, 30000000, 50000},
		{"pipeline-diagonal", 7, 7, 10, 30000000, 50000},
		{"pipeline-slanted", 4, 3, 5, 30000000, 50000},
	};
	unsigned k = 3;

	struct mesh_vertex *v = malloc(n * sizeof(*v));
	uint64_t seed = 3;

	while (strcmp(strips[k].kind, kind))
		k--;
	for (uint32_t i = 0; v && i < n; i++) {
		int64_t along = (int64_t)(input_random(&seed) % (uint64_t)strips[k].length) - strips[k].length / 2,
			across = (int64_t)(input_random(&seed) % (uint64_t)strips[k].width) - strips[k].width / 2;

		v[i] = (struct mesh_vertex){(int32_t)((strips[k].x * along - strips[k].y * across) / strips[k].norm),
					    (int32_t)((strips[k].y * along + strips[k].x * across) / strips[k].norm), 0};
	}
	*ret_n = v ? input_unique(v, n) : 0;
	return v;
}

static struct grid *make(int dirfd, const struct mesh_vertex *v, uint32_t n)
{
	const struct grid_stage_params params = {.dirfd = dirfd, .name = names[1], .memory = (size_t)256 << 20};
	struct grid_source source = {.id = 1, .added = 1, .points = n, .name = "bench"};
	struct grid_segment_info info;
	struct grid_manifest m = {.lattice = {.scale_xy = {1, -2}, .scale_z = {1, -2}},
				  .unit_xy = "metre",
				  .unit_z = "metre",
				  .generation = 1,
				  .segments = &info,
				  .nsegments = 1,
				  .sources = &source,
				  .nsources = 1};
	struct err err = ERR_INIT;
	struct grid_stage *stage;
	struct grid *grid;

	must(grid_stage_new(&params, &stage, &err), &err);
	must(grid_stage_source(stage, 1, &err), &err);
	for (uint32_t i = 0; i < n; i++) {
		const struct point p = {.x = v[i].x, .y = v[i].y, .z = v[i].z, .cls = 1, .ret = 0x11};

		must(grid_stage_add(stage, &p, 1, &err), &err);
	}
	must(grid_stage_seal(stage, &info, &err), &err);
	grid_stage_free(stage);
	must(grid_manifest_write(dirfd, names[0], &m, &err), &err);
	must(grid_open(dirfd, names[0], 1, NULL, 64 << 20, &grid, &err), &err);
	return grid;
}

static int drop(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	(void)pts, (void)err;
	*(uint64_t *)ctx += n;
	return 0;
}

static void measure(const char *kind, const struct grid *grid, uint32_t load)
{
	const struct view view = VIEW_INIT;
	uint32_t cap = load + load / 8 + 4096; /* as pipe_budget */
	size_t reader_size = grid_reader_bytes(grid), scratch_size = (size_t)64 * cap;
	void *reader_memory = malloc(reader_size), *scratch = malloc(scratch_size);
	struct mesh_vertex *out = malloc(cap * sizeof(*out));
	uint64_t own = 0, halo = 0, read = 0, cells = 0, scanned = 0, refused = 0, known = 0;
	double planned, probed, scan, loaded;
	struct grid_reader *reader;
	struct err err = ERR_INIT;
	struct cut_plan plan;

	if (!reader_memory || !scratch || !out)
		exit(1);
	must(grid_reader_new(grid, reader_memory, reader_size, &reader, &err), &err);
	planned = now();
	must(cut_plan_make(reader, load, &plan, &err), &err);
	planned = now() - planned;
	probed = now();
	must(cut_plan_probe_rim(&plan, reader, &view, cap, scratch, scratch_size, &err), &err);
	probed = now() - probed;
	scan = now();
	for (size_t i = 0; i < plan.n; i++) {
		struct cut_range range[4];
		unsigned n = cut_region_ranges(&plan.leaf[i].region, range);

		for (unsigned k = 0; k < n; k++)
			must(grid_scan(reader, range[k].lo, range[k].hi, drop, &scanned, &err), &err);
	}
	scan = now() - scan;
	loaded = now();
	for (size_t i = 0; i < plan.n; i++) {
		struct cut_load l = {.out = out,
				     .cap = cap,
				     .scratch = scratch,
				     .scratch_size = scratch_size,
				     .sites = plan.leaf[i].known ? plan.sites : NULL};
		uint64_t need;
		int rc = cut_load(reader, &view, &plan.leaf[i].region, &l, &need, &err);

		refused += rc == CUT_E_FULL;
		must(rc < 0 ? rc : 0, &err);
		own += l.own;
		halo += l.counts.halo;
		read += l.counts.points_read;
		cells += l.counts.cells_read;
	}
	loaded = now() - loaded;
	for (size_t i = 0; i < plan.n; i++)
		known += plan.leaf[i].known;
	printf("| %s | %u | %zu | %llu | %.1f | %.2f | %.2f | %.2f | %.0f | %.3f | %.3f | %.2f | %.2f |%s\n", kind, load, plan.n,
	       (unsigned long long)known, (double)cut_sites_bytes(plan.sites) / 1024, (double)plan.points_read / (double)scanned,
	       (double)read / (double)scanned, 100.0 * (double)halo / (double)own, (double)cells / (double)plan.n,
	       1e6 * scan / (double)own, 1e6 * (loaded - scan) / (double)own, 1e3 * planned, 1e3 * probed,
	       refused ? " (some do not fit)" : "");
	fflush(stdout);
	cut_plan_done(&plan);
	grid_reader_free(reader);
	free(out);
	free(scratch);
	free(reader_memory);
}

int main(int argc, char **argv)
{
	static const char *const kinds[] = {"uniform", "scan",     "grid",     "cluster",           "two",
					    "holes",   "corridor", "pipeline", "pipeline-diagonal", "pipeline-slanted"};
	static const uint32_t loads[] = {1 << 15, 1 << 17, 1 << 19, 1 << 20}; /* the ladder */
	uint32_t want = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 1000000;
	char path[] = "/tmp/acut-bench-cut-XXXXXX";
	int dirfd = mkdtemp(path) ? open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;

	if (dirfd < 0)
		return 1;
	printf("| input, %u points | load | domains | known | sites KiB | read by the plan / own | by domains / own | halo %% | halo cells a domain | own us/point | "
	       "halo us/point | plan ms | probe ms |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
	       want);
	for (size_t i = 0; i < sizeof(kinds) / sizeof(kinds[0]); i++) {
		uint32_t n;

		if (argc > 2 && strcmp(kinds[i], argv[2]))
			continue;
		struct mesh_vertex *v = strstr(kinds[i], "corridor") || strstr(kinds[i], "pipeline") ?
						corridor(kinds[i], want, &n) :
						input_make(kinds[i], want, 1, &n);
		struct grid *grid;
		char file[64];

		if (!v)
			return 1;
		grid = make(dirfd, v, n);
		free(v);
		for (unsigned k = 0; k < sizeof(loads) / sizeof(loads[0]) && loads[k] < n; k++)
			measure(kinds[i], grid, loads[k]);
		snprintf(file, sizeof(file), "%s", grid_manifest(grid)->segments[0].file);
		grid_close(grid);
		unlinkat(dirfd, file, 0);
		unlinkat(dirfd, names[0], 0);
	}
	close(dirfd);
	rmdir(path);
	return 0;
}
