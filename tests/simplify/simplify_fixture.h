/* Datasets on disk, simplifications of them, and what they must be, by brute force. */
#ifndef SIMPLIFY_FIXTURE_H
#define SIMPLIFY_FIXTURE_H

#include <setjmp.h>
#include <stdatomic.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "chain_lines.h"
#include "grid_fixture.h"
#include "simplify.h"

extern uint64_t rng; /* state of rnd */
uint64_t rnd(uint64_t n);

enum { FIXTURE_SEGMENTS = 4, FIXTURE_SOURCES = 4, FIXTURE_LINES = FIXTURE_SOURCES + 1 };

struct dataset {
	struct folder folder;
	struct grid_segment_info info[FIXTURE_SEGMENTS];
	struct reader reader;
	const struct chain_lines *lines; /* NULL: none */
};

/* `lines` may be NULL. Sources of the set are 1 to FIXTURE_SOURCES. */
struct dataset dataset_of(struct set *, unsigned segments, const struct chain_lines *lines);
void dataset_end(struct dataset *);

/* How a simplification is made. */
struct how {
	int64_t max_error;
	uint64_t max_points;
	size_t more;                                      /* memory beyond the least */
	uint32_t load, block, segments, room, grow, near; /* for struct simplify; 0: as usual */
	uint8_t fill;                                     /* what memory has at first, for struct simplify */
	bool shuffle;                                     /* tasks in any order */
	unsigned stop;                                    /* it is freed and opened again with this chance in a hundred */
	unsigned threads;                                 /* that do tasks; 0: one */
	bool inward;                                      /* all points that regions add count as theirs alone: wrong */
	bool loose;                                       /* all triangles of blocks count as settled: wrong */
	bool no_rounds;                                   /* ends with the seeds: `folder` then has the grid of these only */
};
/* Of all that were made: points that were added around which no later round tests; rounds that tested all regions again. */
extern atomic_uint fixture_settled, fixture_again;
/* Groups of stars whose triangles were found from points nearby, and by windows; first rounds that had not all seeds. */
extern atomic_uint fixture_nearby, fixture_windows, fixture_strips;
/* Nothing is synced, and folders are in memory. */
void fixture_begin(void);
/* Makes it in a new folder. */
struct folder simplify_in_folder(const struct dataset *, const struct view *, const struct how *, struct simplify_report *ret);
/* The result. */
struct reader simplify_reader(const struct dataset *, const struct folder *, const char *manifest);

/* The positions of a view, as a scan gives them, duplicates reduced; in order. To be freed. */
struct point *positions_of(const struct reader *, const struct view *, size_t *ret_n);

/* The greatest distance of the positions to the mesh of the chosen points, as a fraction; points that are in no triangle. */
struct distance {
	__int128 n, d;
	size_t outside, tested;
	uint64_t triangles;
};
struct distance distance_of(const struct dataset *, const struct reader *chosen, const struct point *all, size_t nall,
			    const struct point *pts, size_t n);

#endif
