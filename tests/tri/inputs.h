/*
 * Point sets with a known seed for the kernel's tests and its benchmark: distinct positions, z = index.
 */
#ifndef INPUTS_H
#define INPUTS_H

#include <stdint.h>

#include "mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

struct input_kind {
	const char *name;
	/* Fills v[0..n), returns how many it made; duplicates are removed afterwards. */
	uint32_t (*fill)(struct mesh_vertex *v, uint32_t n, uint64_t seed);
};

extern const struct input_kind input_kinds[];
extern const unsigned input_kind_count;

/* About n positions (a lattice circle has a fixed number), in Morton order. NULL: no memory, or no such
 * kind. Freed with free(). */
struct mesh_vertex *input_make(const char *name, uint32_t n, uint64_t seed, uint32_t *ret_n);

/* xorshift*: the next 64 bits of a stream. */
uint64_t input_random(uint64_t *state);

/* Fisher and Yates. */
void input_shuffle(struct mesh_vertex *v, uint32_t n, uint64_t seed);

/* Keeps the first of each position, in order. Returns how many remain, 0 without memory. */
uint32_t input_unique(struct mesh_vertex *v, uint32_t n);

#ifdef __cplusplus
}
#endif

#endif
