/* What the choice of a lattice depends on, however it is found: by one pass over the inputs, or kept while inputs are left out.
 * Internal. */
#ifndef LATTICE_FACTS_H
#define LATTICE_FACTS_H

#include <stdbool.h>

#include "lattice.h"

/* Orders of inputs on one axis; the first is what counts: the finest scale, the widest box ... Of good boxes only, or of
 * inputs that have an offset, or of those that may not be rounded (BY_EXACT) or may (BY_COARSEST). */
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
	const struct lattice_input *bad;                      /* the first with a scale that is none; NULL: they are good */
	const struct lattice_input *first[3][LATTICE_ORDERS]; /* NULL: none is in that order */
	bool scales_differ[3];
	bool alike; /* all have one (offset, scale) */
	bool grows; /* as of each */
};

bool lattice_scales_good(const struct lattice_input *);
bool lattice_alike(const struct lattice_input *, const struct lattice_input *);
bool lattice_in_order(const struct lattice_input *, unsigned axis, enum lattice_order);
int lattice_compare(const struct lattice_input *, const struct lattice_input *, unsigned axis, enum lattice_order);
int lattice_decide(const struct lattice_facts *, const struct decimal *scale_xy, const struct decimal *scale_z,
		   struct lattice *ret, struct err *err);

#endif
