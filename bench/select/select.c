/*
 * What the selection of a view costs: CPU time of one thread a point of the dataset, and how much of the segment is
 * read. usage: bench-select FILE.las FOLDER [MEMORY]. The file is in metres and centimetres, as acut-synth writes it:
 * eight points a square metre, so that a thin cell of 2.5 m has 50.
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bench_grid.h"
#include "err.h"
#include "io.h"
#include "parse.h"
#include "pipe.h"
#include "selection.h"

static struct io_table counting;
static uint64_t bytes_read;

static ssize_t counting_pread(int fd, void *buf, size_t n, off_t off)
{
	bytes_read += n;
	return io_system.pread(fd, buf, n, off);
}

static double seconds(clockid_t id)
{
	struct timespec t;

	clock_gettime(id, &t);
	return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static int one(const char *name, const struct grid *grid, const struct view *view, size_t memory, int dirfd, uint64_t segment,
	       struct err *err)
{
	struct selection_params p = {.grid = grid, .view = view, .memory = memory, .dirfd = dirfd};
	double cpu = seconds(CLOCK_THREAD_CPUTIME_ID), wall = seconds(CLOCK_MONOTONIC), points = (double)grid_points(grid);
	struct selection_counts got;
	int r;

	bytes_read = 0;
	r = selection_make(&p, &got, err);
	if (r)
		return r;
	printf("%-24s %10llu kept  %7.3f s CPU %7.3f s wall  %7.4f us a point  read %.3f of the segment\n", name,
	       (unsigned long long)got.kept, seconds(CLOCK_THREAD_CPUTIME_ID) - cpu, seconds(CLOCK_MONOTONIC) - wall,
	       (seconds(CLOCK_THREAD_CPUTIME_ID) - cpu) * 1e6 / points, (double)bytes_read / (double)segment);
	return 0;
}

static int all(const struct grid *grid, size_t memory, int dirfd, const struct grid_segment_info *info, struct err *err)
{
	static const char *const thin[] = {"thin, lowest", "thin, highest", "thin, median"};
	const int32_t *box = info->box;
	struct view crop = VIEW_INIT, every, pick;
	int r;

	view_bind(&crop, &grid_manifest(grid)->lattice);
	every = pick = crop;
	crop.crop = VIEW_CROP_BOX;
	for (int k = 0; k < 2; k++) {
		int64_t side = (int64_t)box[k + 2] - box[k];

		crop.crop_box[k] = box[k] + side / 2 + crop.k[k];
		crop.crop_box[k + 2] = crop.crop_box[k] + side / 10;
	}
	every.every = 10;
	r = one("crop of a hundredth", grid, &crop, memory, dirfd, info->bytes, err);
	if (!r)
		r = one("every 10", grid, &every, memory, dirfd, info->bytes, err);
	for (int i = 0; !r && i < 3; i++) {
		pick.thin = (struct view_thin){250, (uint8_t)i};
		r = one(thin[i], grid, &pick, memory, dirfd, info->bytes, err);
	}
	pick.thin.cell = 100000000;
	if (!r)
		r = one("one thin cell, median", grid, &pick, memory, dirfd, info->bytes, err);
	return r;
}

int main(int argc, char **argv)
{
	struct grid_segment_info info;
	uint64_t memory = 64 << 20;
	struct err err = ERR_INIT;
	struct grid *grid = NULL;
	char text[1600];
	int dirfd, r;

	if (argc < 3 || (argc > 3 && !parse_size(argv[3], &memory))) {
		fputs("usage: bench-select FILE.las FOLDER [MEMORY]\n", stderr);
		return 2;
	}
	counting = io_system;
	counting.pread = counting_pread;
	io = &counting;
	r = io_open(AT_FDCWD, argv[2], O_RDONLY | O_DIRECTORY, 0, &dirfd, &err);
	if (!r)
		r = bench_grid(dirfd, argv[1], 256 << 20, NULL, NULL, &info, &grid, &err);
	if (!r)
		r = all(grid, memory, dirfd, &info, &err);
	grid_close(grid);
	if (r) {
		fprintf(stderr, "bench-select: %s\n", err_format(&err, text, sizeof text));
		return 1;
	}
	return 0;
}
