/*
 * The signs of engine/geom again, from their definition, with numbers of any size: every position is lifted to (x^2 +
 * y^2) * M^4 + M^rank, where ranks are by lexicographic order among the given positions, and M = 2^100 is larger than
 * any cofactor. Shares no formula with geom.h.
 */
#ifndef ORACLE_H
#define ORACLE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

int oracle_orient(const int32_t a[2], const int32_t b[2], const int32_t c[2]);

/* The sign of the 4 x 4 determinant of rows x, y, lift, 1. `perturbed` false: without the powers of M. */
int oracle_incircle(const int32_t a[2], const int32_t b[2], const int32_t c[2], const int32_t d[2], bool perturbed);

/* The point of equal power to a, b, c (Cramer), against the cut c2 / 2. Any orientation. */
int oracle_cut_side(const int32_t a[2], const int32_t b[2], const int32_t c[2], int64_t c2, bool vertical, bool perturbed);

/* The same with weights, which are subtracted from the lifts. */
int oracle_power(const int32_t *const p[4], const int64_t w[4], bool perturbed);
int oracle_power_side(const int32_t *const p[3], const int64_t w[3], int64_t c2, bool vertical, bool perturbed);

#ifdef __cplusplus
}
#endif

#endif
