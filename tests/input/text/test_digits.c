/*
 * Numbers of any length, from the text to the lattice, against exact fractions (GMP): rounded once, and counted as moved if and
 * only if they are not on the lattice. With the scale known when the file is opened, through a pipe, and without.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>
#include <gmp.h>

#include "fixture.h"

enum { ROUNDS = 400, LINES = 20, WORD = 80 };

static uint64_t random_state = 1;

static uint32_t pick(uint32_t n)
{
	return fixture_random(&random_state) % n;
}

static void power_ten(mpq_t q, int e)
{
	mpz_ui_pow_ui(mpq_numref(q), 10, (unsigned long)(e > 0 ? e : 0));
	mpz_ui_pow_ui(mpq_denref(q), 10, (unsigned long)(e < 0 ? -e : 0));
}

static void of_decimal(mpq_t ret, struct decimal d)
{
	mpq_t p;

	mpq_init(p);
	mpq_set_si(ret, d.mantissa, 1);
	power_ten(p, d.exponent);
	mpq_mul(ret, ret, p);
	mpq_clear(p);
}

/* The rational number of a text such as "-123.456e-7". */
static void of_text(mpq_t ret, const char *text)
{
	char digits[WORD];
	int n = 0, e = 0;
	bool fraction = false;
	mpq_t p;

	for (; *text && *text != 'e'; text++) {
		if (*text == '.') {
			fraction = true;
			continue;
		}
		digits[n++] = *text;
		e -= fraction;
	}
	digits[n] = 0;
	if (*text)
		e += atoi(text + 1);
	mpq_init(p);
	mpz_set_str(mpq_numref(ret), digits, 10);
	mpz_set_ui(mpq_denref(ret), 1);
	power_ten(p, e);
	mpq_mul(ret, ret, p);
	mpq_clear(p);
}

/* floor(v / scale + 1/2); *ret_moved: v is no multiple of it. */
static int64_t nearest(const mpq_t v, const mpq_t scale, bool *ret_moved)
{
	mpq_t q, half;
	mpz_t f;
	int64_t n;

	mpq_inits(q, half, NULL);
	mpz_init(f);
	mpq_div(q, v, scale);
	*ret_moved = mpz_cmp_ui(mpq_denref(q), 1) != 0;
	mpq_set_ui(half, 1, 2);
	mpq_add(q, q, half);
	mpz_fdiv_q(f, mpq_numref(q), mpq_denref(q));
	n = mpz_get_si(f);
	mpz_clear(f);
	mpq_clears(q, half, NULL);
	return n;
}

/* A number within a few million units of the scale: anything, on the lattice, a middle, or as near to one as many digits say. */
static void number(char ret[WORD], struct decimal scale, int64_t middle)
{
	char text[DECIMAL_TEXT_SIZE];
	struct decimal half = {scale.mantissa * 5, scale.exponent - 1};
	int64_t at = 2 * (middle + (int64_t)pick(4000000) - 2000000) + (pick(2) ? 1 : 0);
	size_t n;

	decimal_scaled_text(half, at, text); /* a lattice point or a middle */
	n = (size_t)snprintf(ret, WORD, "%s%s", text, strchr(text, '.') ? "" : ".");
	switch (pick(4)) {
	case 0:
		break;
	case 1: /* one more in a place far below */
		for (unsigned k = pick(30); k && n < WORD - 2; k--)
			ret[n++] = '0';
		ret[n++] = '1';
		ret[n] = 0;
		break;
	case 2:
		for (unsigned k = pick(30); k && n < WORD - 1; k--)
			ret[n++] = (char)('0' + pick(10));
		ret[n] = 0;
		break;
	default: /* a bit less: the last digit that is not zero goes down, and nines follow */
		while (n && (ret[n - 1] == '0' || ret[n - 1] == '.'))
			n--;
		if (!n || ret[n - 1] == '-' || !strchr(ret, '.') || strchr(ret, '.') >= ret + n)
			break;
		ret[n - 1]--;
		for (unsigned k = 1 + pick(25); k && n < WORD - 1; k--)
			ret[n++] = '9';
		ret[n] = 0;
	}
}

static size_t add_line(char *at, size_t room, char word[3][WORD])
{
	return (size_t)snprintf(at, room, "%s %s %s\n", word[0], word[1], word[2]);
}

static void check(const char *text, char words[][3][WORD], const struct input_options *options, const struct lattice *given)
{
	struct input_points pts;
	struct lattice l;
	struct lattice_map map;
	struct err err = ERR_INIT;
	struct input *in = NULL;
	int32_t got[LINES][3];
	double shift[3] = {0};
	uint64_t moved = 0, want_moved = 0;
	size_t bad;
	mpq_t v, scale;
	int fd = fixture_fd(text, strlen(text));

	if (input_open(fd, "a.xyz", options, &in, &err))
		fail_msg("%s: %s", text, err.message);
	if (given)
		l = *given;
	else if (lattice_choose(&input_info(in)->coords, 1, NULL, NULL, &l, &err))
		fail_msg("%s: %s", text, err.message);
	fixture_points_new(&pts, LINES + 1);
	assert_int_equal(input_read(in, &pts, &err), 0);
	assert_int_equal(pts.n, LINES);
	if (lattice_map_init(&map, &l, &input_info(in)->coords, &err) ||
	    lattice_map_apply(&map, (const int64_t(*)[3])pts.raw, LINES, got, &moved, shift, &bad, &err))
		fail_msg("%s: %s", text, err.message);
	mpq_inits(v, scale, NULL);
	for (int i = 0; i < LINES; i++) {
		bool any = false;

		for (int k = 0; k < 3; k++) {
			bool off;
			int64_t want;

			of_text(v, words[i][k]);
			of_decimal(scale, k < 2 ? l.scale_xy : l.scale_z);
			want = nearest(v, scale, &off) - l.k[k];
			any |= off;
			if (got[i][k] != want)
				fail_msg("%s at %lld e%d: %d, not %lld", words[i][k], (long long)l.scale_xy.mantissa,
					 l.scale_xy.exponent, got[i][k], (long long)want);
		}
		want_moved += any;
	}
	mpq_clears(v, scale, NULL);
	/* rounded by the reader already, to what is its own lattice then */
	if (!input_info(in)->coords.rounds[0] || given)
		assert_int_equal(moved, want_moved);
	fixture_points_free(&pts);
	input_close(in);
	close(fd);
}

static void rounded_once(void **state)
{
	static char words[LINES][3][WORD], text[LINES * 3 * WORD];

	for (int i = 0; i < ROUNDS; i++) {
		struct decimal scale = {1, -(int)pick(12)};
		struct lattice l = {.scale_xy = {1, 0}};
		struct input_options options = {0};
		int64_t middle[3];
		size_t n = 0;

		switch (pick(3)) {
		case 0:
			scale = (struct decimal){1 + pick(1000000), -(int)pick(8) - 4};
			break;
		case 1:
			scale = (struct decimal){INT64_C(9999999999999999) - pick(1000000), -(int)pick(4) - 16};
		}
		for (; scale.mantissa % 10 == 0; scale.mantissa /= 10)
			scale.exponent++;
		l.scale_xy = l.scale_z = options.scale_xy = options.scale_z = scale;
		for (int k = 0; k < 3; k++)
			l.k[k] = middle[k] = ((int64_t)pick(2000000) - 1000000) * (pick(2) ? 10000 : 1);
		for (int line = 0; line < LINES; line++) {
			for (int k = 0; k < 3; k++)
				number(words[line][k], scale, middle[k]);
			n += add_line(text + n, sizeof text - n, words[line]);
		}
		check(text, words, &options, &l);
	}
	(void)state;
}

/* As numpy writes them. */
static void without_a_scale(void **state)
{
	static char words[LINES][3][WORD], text[LINES * 3 * WORD];

	for (int i = 0; i < ROUNDS; i++) {
		struct input_options options = {0};
		double width = (double)(1 + pick(1000000)) / (double)(1 + pick(1000)), at = (double)pick(6000000);
		size_t n = 0;

		for (int line = 0; line < LINES; line++) {
			for (int k = 0; k < 3; k++)
				snprintf(words[line][k], WORD, "%.*e", 18 + (int)pick(20),
					 at + width * (double)pick(1u << 30) / (double)(1u << 30));
			n += add_line(text + n, sizeof text - n, words[line]);
		}
		check(text, words, &options, NULL);
	}
	(void)state;
}

/* Nothing is known of what comes but its beginning. */
static void through_a_pipe(void **state)
{
	static char words[LINES][3][WORD], text[LINES * 3 * WORD];

	for (int i = 0; i < ROUNDS; i++) {
		struct decimal scale = {1 + pick(50), -(int)pick(6)};
		struct lattice l = {.k = {5000, -70000, 3}};
		struct input_options options = {.has_pipe = true};
		size_t n = 0;
		int ends[2];

		for (; scale.mantissa % 10 == 0; scale.mantissa /= 10)
			scale.exponent++;
		l.scale_xy = l.scale_z = options.scale_xy = options.scale_z = scale;
		for (int line = 0; line < LINES; line++) {
			for (int k = 0; k < 3; k++)
				number(words[line][k], scale, l.k[k]);
			n += add_line(text + n, sizeof text - n, words[line]);
		}
		assert_int_equal(pipe(ends), 0);
		close(ends[1]);
		options.pipe = ends[0];
		check(text, words, &options, &l);
		close(ends[0]);
	}
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(rounded_once),
		cmocka_unit_test(without_a_scale),
		cmocka_unit_test(through_a_pipe),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
