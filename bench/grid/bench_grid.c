#include "bench_grid.h"

#include <fcntl.h>

#include "err.h"
#include "grid_stage.h"
#include "io.h"
#include "pipe.h"

enum { INDEX = 8 << 20 };

static void no_lap(const char *what, uint64_t points)
{
	(void)what;
	(void)points;
}

static int ingest(int dirfd, const char *path, size_t memory, void (*lap)(const char *what, uint64_t points),
		  struct grid_segment_info *info, struct lattice *lattice, struct err *err)
{
	struct grid_stage_params params = {.dirfd = dirfd, .name = "bench", .memory = memory};
	struct input_options options = {.planar = true};
	struct pipe_ingest_params how = {.lattice = lattice};
	struct pipe_ingested in = {0};
	struct input *input = NULL;
	int fd, r;

	r = io_open(AT_FDCWD, path, O_RDONLY, 0, &fd, err);
	if (!r)
		r = input_open(fd, path, &options, &input, err);
	if (!r)
		r = lattice_choose(&input_info(input)->coords, 1, NULL, NULL, lattice, err);
	if (!r)
		r = grid_stage_new(&params, &how.stage, err);
	if (!r)
		r = grid_stage_source(how.stage, 1, err);
	lap(NULL, 0);
	if (!r)
		r = pipe_ingest(input, &how, &in, err);
	lap("ingest", in.points);
	if (!r)
		r = grid_stage_seal(how.stage, info, err);
	lap("seal", in.points);
	grid_stage_free(how.stage);
	input_close(input);
	return r;
}

int bench_grid(int dirfd, const char *path, size_t memory, struct ledger *ledger, void (*lap)(const char *what, uint64_t points),
	       struct grid_segment_info *ret_info, struct grid **ret, struct err *err)
{
	struct grid_manifest manifest = {.generation = 1, .crs = "unknown", .unit_xy = "unknown", .unit_z = "unknown"};
	struct grid_source source = {.id = 1, .added = 1, .name = "bench"};
	int r = ingest(dirfd, path, memory, lap ? lap : no_lap, ret_info, &manifest.lattice, err);

	if (r)
		return r;
	manifest.segments = ret_info;
	manifest.sources = &source;
	manifest.nsegments = manifest.nsources = 1;
	source.points = ret_info->points;
	r = grid_manifest_write(dirfd, "bench.manifest", &manifest, err);
	return r ? r : grid_open(dirfd, "bench.manifest", 1, ledger, INDEX, ret, err);
}
