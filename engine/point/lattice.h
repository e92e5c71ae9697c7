/*
 * The lattice of a dataset: coordinate = (X + k) * scale, X int32, k int64, scale a decimal; x and y
 * share one scale (algorithm.md 1). "Absolute lattice number" is X + k.
 */
#ifndef LATTICE_H
#define LATTICE_H

#include <stdbool.h>
#include <stdint.h>

#include "decimal.h"

struct err;

struct lattice {
	struct decimal scale_xy, scale_z;
	int64_t k[3];
};

/* What one input's header says of its coordinates: coordinate = raw * scale + offset. */
struct lattice_input {
	const char *name;
	struct decimal scale[3], offset[3];
	bool has_offset; /* text has none: k comes from the middle of the boxes */
	/* Where its scale is too fine for all boxes together it may be rounded to a coarser one, up to this. Zero: it may not. */
	struct decimal coarsest[3];
	bool rounds[3]; /* it has digits below its scale */
	bool grows;     /* others may come beside it later: a scale that is chosen leaves room for them. The same for all. */
	double min[3], max[3]; /* the header's box, in coordinates; ignored if not finite or inverted */
};

/* The lattice for a set of inputs (order does not matter). `scale` NULL, or the wanted xy and z scale. Unless wanted it is
 * the finest of all scales, or, of inputs of one offset and scale, a finer one on which all of their numbers lie. Where that does
 * not fit into 32 bits and inputs may be rounded, it is the finest power of ten that does and that divides the scale of those
 * that may not; of a lattice that grows the finest that leaves room as well, if one does, else the coarsest. -ERR_INPUT names the
 * input that cannot be represented (scale 0, negative, not finite; does not fit). */
int lattice_choose(const struct lattice_input *inputs, size_t n, const struct decimal *scale_xy, const struct decimal *scale_z,
		   struct lattice *ret, struct err *err);

bool lattice_equal(const struct lattice *a, const struct lattice *b);
/* Canonical one-line text "SXY SZ KX KY KZ", and back. */
#define LATTICE_TEXT_SIZE 192
char *lattice_text(const struct lattice *, char buf[LATTICE_TEXT_SIZE]);
bool lattice_parse(const char *text, struct lattice *ret);

/* How raw numbers of one file become lattice numbers: floor((raw * a + b) / d + 1/2), exact. */
struct lattice_map {
	struct {
		__int128 a, b, d; /* d > 0; exact if d == 1; a shift by b if a == 1 too */
		bool exact;       /* every raw number maps without rounding */
	} axis[3];
	struct decimal scale[3]; /* of the lattice, for reports */
};

int lattice_map_init(struct lattice_map *, const struct lattice *, const struct lattice_input *, struct err *err);
/* n raw coordinates to lattice numbers; *ret_moved counts points that were rounded, max_shift (in
 * coordinates, per axis) keeps the largest. -ERR_LIMIT: number `*ret_bad` does not fit int32. */
int lattice_map_apply(const struct lattice_map *, const int64_t (*raw)[3], size_t n, int32_t (*ret)[3], uint64_t *ret_moved,
		      double max_shift[3], size_t *ret_bad, struct err *err);

#endif
