/*
 * The lattice of a set of inputs, while inputs that do not fit are removed one by one. The result is that of
 * lattice_choose for the remaining inputs; all removals together take the time of a few sorts.
 */
#ifndef LATTICE_SET_H
#define LATTICE_SET_H

#include <stddef.h>

#include "lattice.h"

struct lattice_set;

/* `inputs` are borrowed until the end. NULL: no memory. */
struct lattice_set *lattice_set_new(const struct lattice_input *inputs, size_t n);
/* As lattice_choose. *ret_which: for -ERR_INPUT, the input that does not fit; the number of inputs if the error is
 * about none. */
int lattice_set_choose(struct lattice_set *, const struct decimal *scale_xy, const struct decimal *scale_z, struct lattice *ret,
		       size_t *ret_which, struct err *err);
/* Removes an input; once for each. */
void lattice_set_remove(struct lattice_set *, size_t which);
size_t lattice_set_left(const struct lattice_set *);
/* Comparisons and skipped inputs so far. For tests. */
uint64_t lattice_set_steps(const struct lattice_set *);
struct lattice_set *lattice_set_free(struct lattice_set *);

#endif
