/*
 * Exact decimals: the scales and offsets of survey files, and lattice numbers as text and doubles. value = mantissa *
 * 10^exponent. Normalized: no trailing zero in the mantissa; zero is {0, 0}.
 */
#ifndef DECIMAL_H
#define DECIMAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct decimal {
	int64_t mantissa;
	int32_t exponent;
};

#define DECIMAL_TEXT_SIZE 48

/* The shortest decimal that is read back as `v`. False if v is not finite. */
bool decimal_from_double(double v, struct decimal *ret);
/* Strict: the whole text is [+-](digits[.digits]|.digits)[(e|E)[+-]digits]. False if it is malformed or out of range. */
bool decimal_parse(const char *text, struct decimal *ret);
/* Canonical text of a decimal: plain notation for exponents -12..12, otherwise mantissa "e" exponent. */
char *decimal_text(struct decimal, char buf[DECIMAL_TEXT_SIZE]);
int decimal_compare(struct decimal a, struct decimal b); /* exact; -1, 0, 1 */
double decimal_double(struct decimal d);                 /* nearest double */

/* n * scale for a lattice number n: the nearest double, or exact decimal text (without an exponent for the scales of
 * lattices, 10^-40 to 10^8). */
double decimal_scaled_double(struct decimal scale, int64_t n);
char *decimal_scaled_text(struct decimal scale, int64_t n, char buf[DECIMAL_TEXT_SIZE]);

/* floor(v * 10^exponent * up / (down * step) + 1/2), clamped to DECIMAL_STEPS_MOST: the nearest multiple of a step. up and down
 * are below 2^31; step > 0. False: it was clamped. */
#define DECIMAL_STEPS_MOST (INT64_C(1) << 62)
bool decimal_steps(__int128 v, int64_t exponent, int64_t up, int64_t down, struct decimal step, int64_t *ret);
/* Likewise without the 1/2: the whole steps that are not above it. */
bool decimal_steps_down(__int128 v, int64_t exponent, int64_t up, int64_t down, struct decimal step, int64_t *ret);

#endif
