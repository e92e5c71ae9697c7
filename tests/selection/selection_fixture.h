/* Datasets on disk, and selections of their points, for the tests of selections. */
#ifndef SELECTION_FIXTURE_H
#define SELECTION_FIXTURE_H

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "grid_fixture.h"
#include "lattice.h"
#include "selection.h"

extern uint64_t rng; /* state of rnd */
uint64_t rnd(uint64_t n);
void random_k(int64_t k[3]);

struct dataset {
	struct folder folder;
	struct grid_segment_info info[4];
	struct grid_manifest m;
	struct reader reader;
	bool dead[8];
};

struct dataset dataset_of(const struct set *s, unsigned sources, unsigned segments, bool removal);
void dataset_end(struct dataset *d);
struct selection_counts select_into(const struct folder *to, const struct grid *grid, const struct view *v, size_t memory);
struct set survey(size_t n, int32_t side, int32_t heights);

#endif
