/*
 * Slow and simple: GMP integers, determinants expanded from their definition in absolute coordinates.
 */
#include "oracle.h"

#include <gmp.h>

enum { RANK_BITS = 100, MAX_POINTS = 4 };

static int lexicographic(const int32_t *a, const int32_t *b)
{
	if (a[0] != b[0])
		return a[0] < b[0] ? -1 : 1;
	return a[1] < b[1] ? -1 : a[1] > b[1];
}

/* The lifts of n positions, less their weights, times M^4. */
static void lifts(mpz_t lift[], const int32_t *const p[], const int64_t w[], unsigned n, bool perturbed)
{
	mpz_t eps;

	mpz_init(eps);
	for (unsigned i = 0; i < n; i++) {
		unsigned rank = 0;

		for (unsigned j = 0; j < n; j++)
			rank += lexicographic(p[j], p[i]) < 0;
		mpz_init_set_si(lift[i], p[i][0]);
		mpz_mul_si(lift[i], lift[i], p[i][0]);
		mpz_set_si(eps, p[i][1]);
		mpz_mul_si(eps, eps, p[i][1]);
		mpz_add(lift[i], lift[i], eps);
		mpz_set_si(eps, w[i]);
		mpz_sub(lift[i], lift[i], eps);
		mpz_mul_2exp(lift[i], lift[i], 4 * RANK_BITS);
		mpz_set_ui(eps, 1);
		mpz_mul_2exp(eps, eps, rank * RANK_BITS);
		if (perturbed)
			mpz_add(lift[i], lift[i], eps);
	}
	mpz_clear(eps);
}

static void lifts_clear(mpz_t lift[], unsigned n)
{
	for (unsigned i = 0; i < n; i++)
		mpz_clear(lift[i]);
}

/* The determinant of three rows (x, y, 1). */
static void det3(mpz_t ret, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	const int32_t *const p[3] = {a, b, c};
	mpz_t term;

	mpz_init(term);
	mpz_set_si(ret, 0);
	for (unsigned i = 0; i < 3; i++) {
		mpz_set_si(term, p[i][0]);
		mpz_mul_si(term, term, p[(i + 1) % 3][1]);
		mpz_add(ret, ret, term);
		mpz_set_si(term, p[i][1]);
		mpz_mul_si(term, term, p[(i + 1) % 3][0]);
		mpz_sub(ret, ret, term);
	}
	mpz_clear(term);
}

int oracle_orient(const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	mpz_t det;
	int sign;

	mpz_init(det);
	det3(det, a, b, c);
	sign = mpz_sgn(det);
	mpz_clear(det);
	return sign;
}

int oracle_power(const int32_t *const p[4], const int64_t w[4], bool perturbed)
{
	mpz_t lift[MAX_POINTS], det, minor;
	int sign;

	mpz_inits(det, minor, NULL);
	lifts(lift, p, w, 4, perturbed);
	/* Along the third column: signs + - + - from the top. */
	for (unsigned i = 0; i < 4; i++) {
		const int32_t *rest[3];
		unsigned n = 0;

		for (unsigned j = 0; j < 4; j++)
			if (j != i)
				rest[n++] = p[j];
		det3(minor, rest[0], rest[1], rest[2]);
		mpz_mul(minor, minor, lift[i]);
		if (i % 2)
			mpz_sub(det, det, minor);
		else
			mpz_add(det, det, minor);
	}
	sign = mpz_sgn(det);
	lifts_clear(lift, 4);
	mpz_clears(det, minor, NULL);
	return sign;
}

/* 2 (b - a) . o = lift b - lift a, 2 (c - a) . o = lift c - lift a. */
int oracle_power_side(const int32_t *const p[3], const int64_t w[3], int64_t c2, bool vertical, bool perturbed)
{
	const int32_t *a = p[0], *b = p[1], *c = p[2];
	int64_t b0 = (int64_t)b[0] - a[0], b1 = (int64_t)b[1] - a[1];
	int64_t c0 = (int64_t)c[0] - a[0], c1 = (int64_t)c[1] - a[1];
	mpz_t lift[MAX_POINTS], num, den, term;
	int sign;

	mpz_inits(num, den, term, NULL);
	lifts(lift, p, w, 3, perturbed);
	mpz_sub(lift[1], lift[1], lift[0]);
	mpz_sub(lift[2], lift[2], lift[0]);
	mpz_mul_si(num, lift[1], vertical ? c1 : c0);
	mpz_mul_si(term, lift[2], vertical ? b1 : b0);
	mpz_sub(num, num, term);
	if (!vertical)
		mpz_neg(num, num);
	/* o = num / den with den = 2 (b0 c1 - b1 c0) M^4; compare 2 o with c2. */
	mpz_set_si(den, b0);
	mpz_mul_si(den, den, c1);
	mpz_set_si(term, b1);
	mpz_mul_si(term, term, c0);
	mpz_sub(den, den, term);
	sign = mpz_sgn(den);
	mpz_mul_2exp(den, den, 4 * RANK_BITS);
	mpz_mul_si(den, den, c2);
	sign *= mpz_cmp(num, den) > 0 ? 1 : mpz_cmp(num, den) < 0 ? -1 : 0;
	lifts_clear(lift, 3);
	mpz_clears(num, den, term, NULL);
	return sign;
}

int oracle_incircle(const int32_t a[2], const int32_t b[2], const int32_t c[2], const int32_t d[2], bool perturbed)
{
	const int32_t *const p[4] = {a, b, c, d};
	const int64_t w[4] = {0};

	return oracle_power(p, w, perturbed);
}

int oracle_cut_side(const int32_t a[2], const int32_t b[2], const int32_t c[2], int64_t c2, bool vertical, bool perturbed)
{
	const int32_t *const p[3] = {a, b, c};
	const int64_t w[3] = {0};

	return oracle_power_side(p, w, c2, vertical, perturbed);
}
