/* Range and digits of the numbers of three axes, of which a text's raw unit is chosen (input_place.c). */
#include "input_text_parts.h"

#include <math.h>

static double number_double(struct input_number n)
{
	struct decimal d = {n.mantissa, n.exponent};

	return decimal_double(d);
}

/* For places from -15 to 0 and at most 18 digits. The quotient of doubles below 2^53 is rounded exactly; the few other numbers
 * are converted with integers. Deep numbers may make the box inexact. */
static double coordinate(struct input_number n)
{
	static const double power[] = {1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15};
	int64_t m = n.mantissa;

	if (n.exponent <= 0 && m < (int64_t)1 << 53 && m > -((int64_t)1 << 53) && n.exponent >= -15)
		return (double)m / power[-n.exponent];
	if (n.deep && n.exponent <= 0 && n.exponent >= -15)
		return (double)m / power[-n.exponent];
	return number_double(n);
}

void input_extents_begin(struct input_extent axis[3])
{
	for (int i = 0; i < 3; i++)
		axis[i] = (struct input_extent){.min = INFINITY, .max = -INFINITY};
}

void input_extents_add(struct input_extent axis[3], const struct input_number n[3], uint64_t line)
{
	for (int i = 0; i < 3; i++) {
		double v = coordinate(n[i]);

		if (n[i].written < axis[i].written)
			axis[i].written = n[i].written;
		if (n[i].deep)
			axis[i].deep = true;
		if (n[i].exponent < axis[i].needed) {
			axis[i].needed = n[i].exponent;
			axis[i].line = line;
		}
		if (v < axis[i].min)
			axis[i].min = v;
		if (v > axis[i].max)
			axis[i].max = v;
	}
}
