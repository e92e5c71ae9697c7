/*
 * Decimals against other arithmetic: digit strings in fixed point, long multiplication by hand, and doubles printed in
 * full by "%.*f" (exact in glibc).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "decimal.h"
#include "random.h"

enum { WHOLE = 60, PART = 260, ALL = WHOLE + PART };

/* An unsigned number: digit[0] is the lowest, digit[PART] the ones. */
struct fixed {
	uint8_t digit[ALL];
};

static uint64_t random_state = 1;

static uint64_t rnd(void)
{
	return random_next(&random_state);
}

static struct fixed fixed_of_double(double v)
{
	static char text[ALL + 400];
	struct fixed f = {0};
	int n = snprintf(text, sizeof text, "%.*f", PART, fabs(v));
	const char *point = strchr(text, '.');

	assert_true(point - text <= WHOLE);
	for (int i = 0; i < PART; i++)
		f.digit[PART - 1 - i] = (uint8_t)(point[1 + i] - '0');
	for (int i = 0; i < point - text; i++)
		f.digit[PART + i] = (uint8_t)(point[-1 - i] - '0');
	assert_int_equal(n, point - text + 1 + PART);
	return f;
}

/* |a| * |b| * 10^e by long multiplication of digits. */
static struct fixed fixed_of_product(int64_t a, int64_t b, int e)
{
	char ta[24], tb[24];
	unsigned long product[48] = {0};
	struct fixed f = {0};
	int na = snprintf(ta, sizeof ta, "%llu", a < 0 ? -(unsigned long long)a : (unsigned long long)a);
	int nb = snprintf(tb, sizeof tb, "%llu", b < 0 ? -(unsigned long long)b : (unsigned long long)b);

	for (int i = 0; i < na; i++)
		for (int j = 0; j < nb; j++)
			product[i + j] += (unsigned long)(ta[na - 1 - i] - '0') * (unsigned long)(tb[nb - 1 - j] - '0');
	for (int i = 0; i < 47; i++) {
		product[i + 1] += product[i] / 10;
		product[i] %= 10;
	}
	for (int i = 0; i < 48; i++) {
		if (!product[i])
			continue;
		assert_true(PART + e + i >= 0 && PART + e + i < ALL);
		f.digit[PART + e + i] = (uint8_t)product[i];
	}
	return f;
}

static int fixed_compare(const struct fixed *a, const struct fixed *b)
{
	for (int i = ALL - 1; i >= 0; i--)
		if (a->digit[i] != b->digit[i])
			return a->digit[i] < b->digit[i] ? -1 : 1;
	return 0;
}

static struct fixed fixed_distance(const struct fixed *a, const struct fixed *b)
{
	struct fixed f = {0};
	int borrow = 0;

	if (fixed_compare(a, b) < 0)
		return fixed_distance(b, a);
	for (int i = 0; i < ALL; i++) {
		int d = a->digit[i] - b->digit[i] - borrow;

		borrow = d < 0;
		f.digit[i] = (uint8_t)(d + 10 * borrow);
	}
	return f;
}

/* v is the double nearest to a * b * 10^e, and the even one if two are equally near. */
static void assert_nearest(double v, int64_t a, int64_t b, int e)
{
	struct fixed exact = fixed_of_product(a, b, e), here = fixed_of_double(v);
	struct fixed off = fixed_distance(&exact, &here);
	double beside[2] = {nextafter(fabs(v), INFINITY), nextafter(fabs(v), 0)};
	uint64_t bits;

	memcpy(&bits, &v, sizeof bits);
	for (int i = 0; i < 2; i++) {
		struct fixed other = fixed_of_double(beside[i]), far = fixed_distance(&exact, &other);
		int order = fixed_compare(&off, &far);

		if (v == 0 && beside[i] == 0)
			continue;
		assert_true(order < 0 || (order == 0 && (bits & 1) == 0));
	}
	assert_true(v == 0 || (v < 0) == ((a < 0) != (b < 0)));
}

static void test_scaled_double(void **state)
{
	for (int i = 0; i < 60000; i++) {
		struct decimal d = {(int64_t)(rnd() >> (1 + rnd() % 63)), (int32_t)(rnd() % 34) - 26};
		int64_t n = (int64_t)(rnd() >> (rnd() % 64)) >> (rnd() % 2 * 20);

		if (d.mantissa % 10 == 0)
			d.mantissa++;
		if (d.mantissa > 100000000000000000)
			d.mantissa /= 1000;
		if (d.mantissa % 10 == 0)
			d.mantissa++;
		if (rnd() % 4 == 0)
			d.mantissa = -d.mantissa;
		assert_nearest(decimal_scaled_double(d, n), d.mantissa, n, d.exponent);
	}
	(void)state;
}

static void test_scaled_double_ties(void **state)
{
	/* 2^53 + 1 is between two doubles; 2^53 + 3, too, with the even one above. */
	struct decimal one = {1, 0}, half = {5, -1};

	assert_true(decimal_scaled_double(one, (INT64_C(1) << 53) + 1) == 0x1p53);
	assert_true(decimal_scaled_double(one, (INT64_C(1) << 53) + 3) == 0x1p53 + 4);
	assert_true(decimal_scaled_double(half, (INT64_C(1) << 54) + 2) == 0x1p53);
	assert_true(decimal_scaled_double(half, INT64_MIN) == -0x1p62);
	assert_true(decimal_scaled_double((struct decimal){0, 0}, 5) == 0);
	assert_false(signbit(decimal_scaled_double((struct decimal){-5, 0}, 0)));
	(void)state;
}

/* The exact text, read digit by digit, is the product. */
static void test_scaled_text(void **state)
{
	char buf[DECIMAL_TEXT_SIZE];

	for (int i = 0; i < 60000; i++) {
		struct decimal d = {(int64_t)(rnd() % 100000000000000000u >> (rnd() % 56)) | 1, (int32_t)(rnd() % 49) - 40};
		int64_t n = (int64_t)rnd() >> (rnd() % 64);
		struct fixed want = fixed_of_product(d.mantissa, n, d.exponent), got = {0};
		char *t = decimal_scaled_text(d, n, buf), *point = strchr(t, '.');
		size_t len = strlen(t);

		assert_true(len < DECIMAL_TEXT_SIZE);
		assert_null(strchr(t, 'e'));
		assert_int_equal(t[0] == '-', n < 0);
		t += t[0] == '-';
		assert_true(t[0] != '.' && (t[0] != '0' || t[1] == '.' || !t[1]));
		assert_true(!point || (point[1] && t[strlen(t) - 1] != '0'));
		int whole = (int)(point ? point - t : (long)strlen(t));

		for (int k = 0; k < whole; k++)
			got.digit[PART + whole - 1 - k] = (uint8_t)(t[k] - '0');
		for (int k = 1; point && point[k]; k++)
			got.digit[PART - k] = (uint8_t)(point[k] - '0');
		assert_int_equal(fixed_compare(&want, &got), 0);
	}
	(void)state;
}

static void test_from_double(void **state)
{
	static const struct {
		double v;
		const char *text;
	} rows[] = {
		{0, "0"},
		{-0.0, "0"},
		{0.01, "0.01"},
		{0.001, "0.001"},
		{1e-7, "0.0000001"},
		{-2.5, "-2.5"},
		{0.3048006096012192, "3048006096012192e-16"},
		{100, "100"},
		{1e22, "1e22"},
		{5e-324, "5e-324"},
		{0.1 + 0.2, "30000000000000004e-17"},
		{1.7976931348623157e308, "17976931348623157e292"},
	};
	char buf[DECIMAL_TEXT_SIZE];
	struct decimal d = {7, 7};

	for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
		assert_true(decimal_from_double(rows[i].v, &d));
		assert_string_equal(decimal_text(d, buf), rows[i].text);
	}
	for (int i = 0; i < 20000; i++) {
		uint64_t bits = rnd();
		double v;

		memcpy(&v, &bits, sizeof v);
		if (!isfinite(v))
			continue;
		assert_true(decimal_from_double(v, &d));
		assert_true(decimal_double(d) == v);
		assert_true(d.mantissa == 0 || d.mantissa % 10);
	}
	d = (struct decimal){7, 7};
	assert_false(decimal_from_double(NAN, &d));
	assert_false(decimal_from_double(-INFINITY, &d));
	assert_int_equal(d.mantissa, 7);
	(void)state;
}

static void test_parse(void **state)
{
	static const struct {
		const char *text;
		int64_t mantissa;
		int32_t exponent;
	} good[] = {
		{".5", 5, -1},
		{"-.0010", -1, -3},
		{"+.5e3", 5, 2},
		{"0", 0, 0},
		{"-0.000", 0, 0},
		{"1", 1, 0},
		{"+1.50", 15, -1},
		{"100", 1, 2},
		{"100.5", 1005, -1},
		{"0.001", 1, -3},
		{"1e-3", 1, -3},
		{"1E+3", 1, 3},
		{"-12.5e1", -125, 0},
		{"0e99999999999", 0, 0},
		{"9223372036854775807", INT64_MAX, 0},
		{"0009.9000", 99, -1},
		{"10000000000000000000000", 1, 22},
		{"1.00000000000000000000000", 1, 0},
		{"0.0000000000000000000000000001", 1, -28},
	};
	static const char *const bad[] = {
		"",
		"-",
		"+",
		".",
		".e5",
		"-.",
		"1..5",
		"5.",
		"1e",
		"1e+",
		"1e5 ",
		" 1",
		"1 ",
		"0x10",
		"inf",
		"nan",
		"1,5",
		"--1",
		"1.2.3",
		"9223372036854775808",
		"12345678901234567891",
		"1e10000",
		"1e-10000",
		"1e99999999999999999999",
		"1_0",
	};
	struct decimal d;

	for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
		assert_true(decimal_parse(good[i].text, &d));
		assert_int_equal(d.mantissa, good[i].mantissa);
		assert_int_equal(d.exponent, good[i].exponent);
	}
	d = (struct decimal){7, 7};
	for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
		assert_false(decimal_parse(bad[i], &d));
		assert_int_equal(d.mantissa, 7);
	}
	(void)state;
}

static void test_text_round_trip(void **state)
{
	char buf[DECIMAL_TEXT_SIZE];

	for (int i = 0; i < 50000; i++) {
		struct decimal d = {(int64_t)rnd() >> (rnd() % 64), (int32_t)(rnd() % 81) - 40}, e;

		if (d.mantissa == INT64_MIN || d.mantissa % 10 == 0)
			continue;
		assert_true(decimal_parse(decimal_text(d, buf), &e));
		assert_int_equal(d.mantissa, e.mantissa);
		assert_int_equal(d.exponent, e.exponent);
	}
	(void)state;
}

static void test_compare(void **state)
{
	for (int i = 0; i < 50000; i++) {
		struct decimal a = {(int64_t)(rnd() >> (rnd() % 63 + 1)), (int32_t)(rnd() % 30) - 20};
		struct decimal b =
			rnd() % 3 ? (struct decimal){(int64_t)(rnd() >> (rnd() % 63 + 1)), (int32_t)(rnd() % 30) - 20} : a;

		if (rnd() % 4 == 0 && b.mantissa < INT64_MAX / 10) {
			b.mantissa *= 10;
			b.exponent--;
			b.mantissa += (int64_t)(rnd() % 3) - 1;
		}
		struct fixed fa = fixed_of_product(a.mantissa, 1, a.exponent), fb = fixed_of_product(b.mantissa, 1, b.exponent);
		int sa = rnd() % 2 ? 1 : -1, sb = rnd() % 4 ? sa : -sa, want;

		a.mantissa *= sa;
		b.mantissa *= sb;
		int signs = (a.mantissa > 0) - (a.mantissa < 0), other = (b.mantissa > 0) - (b.mantissa < 0);

		want = signs != other ? (signs > other) - (signs < other) : signs * fixed_compare(&fa, &fb);
		assert_int_equal(decimal_compare(a, b), want);
	}
	assert_int_equal(decimal_compare((struct decimal){1, 9999}, (struct decimal){INT64_MAX, -9999}), 1);
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_scaled_double), cmocka_unit_test(test_scaled_double_ties),
		cmocka_unit_test(test_scaled_text),   cmocka_unit_test(test_from_double),
		cmocka_unit_test(test_parse),         cmocka_unit_test(test_text_round_trip),
		cmocka_unit_test(test_compare),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
