/* Inputs and lattices from texts, for the tests of lattices. */
#ifndef LATTICE_INPUT_H
#define LATTICE_INPUT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "lattice.h"

static inline struct decimal dec(const char *text)
{
	struct decimal d;

	assert_true(decimal_parse(text, &d));
	return d;
}

/* An input with the same numbers on x and y. */
static inline struct lattice_input input(const char *name, const char *scale, const char *offset, double min, double max)
{
	struct lattice_input in = {.name = name, .has_offset = offset != NULL};

	for (int a = 0; a < 3; a++) {
		in.scale[a] = dec(scale);
		in.offset[a] = dec(offset ? offset : "0");
		in.min[a] = min;
		in.max[a] = max;
	}
	return in;
}

static inline struct lattice lattice_of(const char *text)
{
	struct lattice l;

	assert_true(lattice_parse(text, &l));
	return l;
}

#endif
