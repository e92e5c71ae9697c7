#include "selection_fixture.h"

#include <stdlib.h>

uint64_t rng;

uint64_t rnd(uint64_t n)
{
	return random_below(&rng, n);
}

void random_k(int64_t k[3])
{
	static const int64_t far[] = {
		0, 1, -1, 5, -123456789, INT64_C(1) << 40, -(INT64_C(1) << 40), (INT64_C(1) << 59) + 3, -(INT64_C(1) << 59) - 3};

	for (int i = 0; i < 3; i++)
		k[i] = far[rnd(9)];
}

struct dataset dataset_of(const struct set *s, unsigned sources, unsigned segments, bool removal)
{
	struct dataset d = {.folder = folder_new()};
	struct err err = ERR_INIT;

	stage_sources(&d.folder, s, segments, d.info);
	d.m = manifest_of(d.info, segments, sources);
	random_k(d.m.lattice.k);
	d.m.generation = 2;
	manifest_count(&d.m, s);
	for (unsigned i = 0; i < sources; i++)
		if (removal && rnd(2)) {
			d.m.sources[i].removed = 2;
			d.dead[i + 1] = true;
		}
	CHECK(grid_manifest_write(d.folder.fd, "m", &d.m, &err));
	d.reader = reader_open(&d.folder, "m", GRID_NEWEST, 1 << 20);
	return d;
}

void dataset_end(struct dataset *d)
{
	reader_close(&d->reader);
	free(d->m.sources);
	folder_remove(&d->folder);
}

struct selection_counts select_into(const struct folder *to, const struct grid *grid, const struct view *v, size_t memory)
{
	struct selection_params p = {.grid = grid, .view = v, .memory = memory, .dirfd = to->fd};
	struct selection_counts got = {0}, again = {0};
	struct err err = ERR_INIT;

	CHECK(selection_make(&p, &got, &err));
	CHECK(selection_counts_read(to->fd, &again, &err));
	assert_memory_equal(&got, &again, sizeof got);
	return got;
}

struct set survey(size_t n, int32_t side, int32_t heights)
{
	struct set s = {.pts = calloc(n, sizeof *s.pts), .ids = calloc(n, sizeof *s.ids), .n = n};

	for (size_t i = 0; i < n; i++) {
		s.pts[i] = (struct point){
			(int32_t)rnd((uint64_t)side), (int32_t)rnd((uint64_t)side), (int32_t)rnd((uint64_t)heights), 2, 0x11, 0};
		s.ids[i] = 1;
	}
	return s;
}
