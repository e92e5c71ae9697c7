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

/* The coordinates of one input, according to its header: coordinate = raw * scale + offset. */
struct lattice_input {
	const char *name;
	struct decimal scale[3], offset[3];
	bool has_offset; /* text has none; then k comes from the middle of the boxes */
	/* If its scale is too fine for all boxes together, it may be rounded to a coarser scale, up to this. Zero: it
	 * must not be rounded. */
	struct decimal coarsest[3];
	bool rounds[3]; /* it has digits below its scale */
	bool grows;     /* other inputs may follow later: the chosen scale leaves room for them. The same for all inputs. */
	double min[3], max[3]; /* box of the header, in coordinates; ignored if it is not finite or inverted */
};

/* Chooses the lattice for a set of inputs, independently of their order. `scale`: the requested xy and z scale, or
 * NULL. Without a request it is the finest of all scales; for inputs with the same offset and scale it may be a finer
 * one on which all of their numbers are exact. If that does not fit 32 bits and inputs may be rounded, it is the finest
 * power of ten that fits and divides the scale of the inputs that must not be rounded. For a lattice that grows it is
 * the finest one that also leaves room, or else the coarsest. -ERR_INPUT names the input that cannot be represented
 * (scale 0, negative or not finite; does not fit). */
int lattice_choose(const struct lattice_input *inputs, size_t n, const struct decimal *scale_xy, const struct decimal *scale_z,
		   struct lattice *ret, struct err *err);

bool lattice_equal(const struct lattice *a, const struct lattice *b);
/* Canonical one-line text "SXY SZ KX KY KZ", and back. */
#define LATTICE_TEXT_SIZE 192
char *lattice_text(const struct lattice *, char buf[LATTICE_TEXT_SIZE]);
bool lattice_parse(const char *text, struct lattice *ret);

/* The coordinate of a lattice number, for messages and reports: of x or y (axis 0, 1) or z. */
static inline double lattice_coordinate(const struct lattice *l, int axis, int32_t v)
{
	struct decimal d = axis < 2 ? l->scale_xy : l->scale_z;

	d.mantissa *= v + l->k[axis];
	return decimal_double(d);
}

/* Converts the raw numbers of a file to lattice numbers: floor((raw * a + b) / d + 1/2), exact. */
struct lattice_map {
	struct {
		__int128 a, b, d; /* d > 0; exact if d == 1; a shift by b if also a == 1 */
		bool exact;       /* no raw number is rounded */
	} axis[3];
	struct decimal scale[3]; /* of the lattice, for reports */
};

int lattice_map_init(struct lattice_map *, const struct lattice *, const struct lattice_input *, struct err *err);
/* Converts n raw coordinates. *ret_moved counts the points that were rounded; max_shift (in coordinates, for each axis)
 * keeps the largest rounding. -ERR_LIMIT: number `*ret_bad` does not fit int32. */
int lattice_map_apply(const struct lattice_map *, const int64_t (*raw)[3], size_t n, int32_t (*ret)[3], uint64_t *ret_moved,
		      double max_shift[3], size_t *ret_bad, struct err *err);

#endif
