/* The facts on which the choice of a lattice depends. They come from one pass over the inputs (lattice.c), or are
 * updated while inputs are left out (lattice_set.c). Internal. */
#ifndef LATTICE_FACTS_H
#define LATTICE_FACTS_H

#include <stdbool.h>

#include "lattice.h"

/* Orders of inputs on one axis, of which only the first input matters: the finest scale, the widest box, and so on.
 * Some are only over inputs with a valid box, or with an offset, or over those that must not be rounded (BY_EXACT) or
 * may be (BY_COARSEST). */
enum lattice_order {
	LATTICE_BY_SCALE,
	LATTICE_BY_EXACT,
	LATTICE_BY_COARSEST,
	LATTICE_BY_OFFSET,
	LATTICE_BY_MIN,
	LATTICE_BY_MAX,
	LATTICE_BY_WIDTH,
	LATTICE_BY_FAR,
};
#define LATTICE_ORDERS (LATTICE_BY_FAR + 1)

struct lattice_facts {
	const struct lattice_input *bad;                      /* the first input with an invalid scale; NULL: none */
	const struct lattice_input *first[3][LATTICE_ORDERS]; /* NULL: no input is in this order */
	bool scales_differ[3];
	bool alike; /* all have the same offset and scale */
	bool grows; /* as in the inputs */
};

bool lattice_scales_good(const struct lattice_input *);
bool lattice_alike(const struct lattice_input *, const struct lattice_input *);
bool lattice_in_order(const struct lattice_input *, unsigned axis, enum lattice_order);
int lattice_compare(const struct lattice_input *, const struct lattice_input *, unsigned axis, enum lattice_order);
int lattice_decide(const struct lattice_facts *, const struct decimal *scale_xy, const struct decimal *scale_z,
		   struct lattice *ret, struct err *err);

#endif
