/*
 * The lattice of a set of inputs of which those that cannot be on it are left out, one by one: what lattice_choose says of the
 * inputs that are left, in the time of a few sorts for all of them.
 */
#ifndef LATTICE_SET_H
#define LATTICE_SET_H

#include <stddef.h>

#include "lattice.h"

struct lattice_set;

/* `inputs` are borrowed until the end. NULL: no memory. */
struct lattice_set *lattice_set_new(const struct lattice_input *inputs, size_t n);
/* As lattice_choose. *ret_which: of -ERR_INPUT, which input does not fit; the number of all inputs if it is about none. */
int lattice_set_choose(struct lattice_set *, const struct decimal *scale_xy, const struct decimal *scale_z, struct lattice *ret,
		       size_t *ret_which, struct err *err);
/* Once each. */
void lattice_set_leave(struct lattice_set *, size_t which);
size_t lattice_set_left(const struct lattice_set *);
/* What it did so far: comparisons, and inputs passed by. For tests. */
uint64_t lattice_set_steps(const struct lattice_set *);
struct lattice_set *lattice_set_free(struct lattice_set *);

#endif
