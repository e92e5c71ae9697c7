/* A mesh as a tree of tiles for the page: leaves have its triangles, inner nodes grids of heights with a known error
 * (docs/design/page.md). */
#ifndef LEVELS_H
#define LEVELS_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

struct err;
struct outfile;
struct outfile_folder;

enum { LEVELS_LEAF = 65536 }; /* triangles of a leaf, at most */

struct levels_options {
	const struct outfile_folder *folder; /* gets the tiles */
	const struct outfile *beside;        /* nameless files are made there */
	uint64_t memory;                     /* of the sorts; 0: 8 MiB */
	unsigned leaf;                       /* for tests: triangles of a leaf; 0: LEVELS_LEAF */
	int (*interrupted)(void *ctx);       /* not 0: give up; called while tiles are made; may be NULL */
	void *ctx;
};

struct levels;
int levels_new(const struct levels_options *, struct levels **ret, struct err *err);
/* x1, y1 to x2, y2 of all vertices: before the first triangle. */
int levels_box(struct levels *, const int32_t low[2], const int32_t high[2], struct err *err);
/* Counter-clockwise. */
int levels_triangle(struct levels *, const int32_t *const corner[3], struct err *err);
/* Makes the tiles. `stamp` is in each of them, so that none of another mesh is taken for one of this. */
int levels_make(struct levels *, const char *stamp, struct err *err);
/* The member "levels" of the facts of the page. */
void levels_facts(const struct levels *, FILE *);
uint64_t levels_bytes(const struct levels *);
size_t levels_tiles(const struct levels *);
/* The name of tile i, for outfile_folder_clear. */
const char *levels_name(void *levels, size_t i, char *buf);
struct levels *levels_free(struct levels *);

#endif
