/* Small meshes in random order and blocks of any size, and a format that keeps what it gets: for the steps between a stream and
 * the writers. */
#ifndef SMALL_MESH_H
#define SMALL_MESH_H

#include "digest.h"
#include "outputs.h"

enum {
	SMALL_SIDE = 7,
	SMALL_POINTS = SMALL_SIDE * SMALL_SIDE,
	SMALL_TRIANGLES = 2 * (SMALL_SIDE - 1) * (SMALL_SIDE - 1),
	SMALL_K = 1000, /* of x; twice as much of y; the scale is 0.1 */
};

extern struct small_mesh {
	int32_t at[SMALL_POINTS][3];
	uint32_t triangle[SMALL_TRIANGLES][3];
	bool gone[SMALL_TRIANGLES]; /* by the test: it is to be left out */
	unsigned w, h, n;
	uint64_t lines; /* which edges are pieces of lines (small_is_piece); 0: none */
} small;
bool small_is_piece(uint32_t a, uint32_t b); /* between two points: an eighth of the edges */
extern const struct format small_format;

/* A new mesh; coordinates are multiples of `step`. */
void small_make(uint64_t *seed, int32_t step);
struct digest small_digest(bool kept);
int small_send(const struct acut_mesh_sink *, uint64_t *seed);
/* Exactly those came that are not gone, with their digest. Returns how many are gone. */
unsigned small_check(const struct outputs_report *);
const char *small_trimmed(void); /* what the writer was told */

#endif
