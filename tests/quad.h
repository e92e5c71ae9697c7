/*
 * Floating-point numbers of 113 bits, for oracles: x86-64 has them as __float128, arm64 as long double.
 */
#ifndef QUAD_H
#define QUAD_H

#include <float.h>

#if LDBL_MANT_DIG >= 113
typedef long double quad;
#else
typedef __float128 quad;
#endif

#endif
