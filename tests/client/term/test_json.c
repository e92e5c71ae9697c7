/* JSON of lists is written without printf: what comes out is what printf would write, to the last digit. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <cmocka.h>

#include "err.h"
#include "ctl_report.h"
#include "term_json.h"

static char *written(void (*put)(struct term_json *, const void *), const void *what)
{
	char *text = NULL;
	size_t n;
	struct term_json j = {.out = open_memstream(&text, &n), .list = true};

	put(&j, what);
	term_json_line(&j);
	fclose(j.out);
	assert_int_equal(text[n - 1], '\n');
	text[n - 1] = 0;
	return text;
}

static void put_number(struct term_json *j, const void *v)
{
	term_json_number(j, NULL, *(const double *)v);
}

static void put_u64(struct term_json *j, const void *v)
{
	term_json_u64(j, NULL, *(const uint64_t *)v);
}

static void put_i64(struct term_json *j, const void *v)
{
	term_json_i64(j, NULL, *(const int64_t *)v);
}

static void put_time(struct term_json *j, const void *v)
{
	term_json_time(j, NULL, *(const int64_t *)v);
}

static void put_text(struct term_json *j, const void *v)
{
	term_json_text(j, "k\"", v);
}

static void put_lattice(struct term_json *j, const void *v)
{
	ctl_report_lattice(j, v);
}

static void check(void (*put)(struct term_json *, const void *), const void *what, const char *wanted)
{
	char *text = written(put, what);

	assert_string_equal(text, wanted);
	free(text);
}

static void number_is(double v)
{
	char buf[40];

	for (int digits = 6; digits <= 17; digits++) {
		snprintf(buf, sizeof buf, "%.*g", digits, v);
		if (strtod(buf, NULL) == v)
			break;
	}
	check(put_number, &v, buf);
}

static void numbers(void **state)
{
	static const double some[] = {
		0,        1,   -1,     0.5,       0.1,     1e-4, 0.000099, 0.00012,  0.000001, 999999.999999, 1e6,
		123456.7, 100, 100.01, 1.0000001, 1.0 / 3, 2e-7, 1e300,    0.025279, 0.04606,  1234567.25};
	uint64_t x = 88172645463325252u;

	for (size_t i = 0; i < sizeof some / sizeof *some; i++) {
		number_is(some[i]);
		number_is(nextafter(some[i], 1e9));
	}
	for (int i = 0; i < 100000; i++) {
		x ^= x << 13;
		x ^= x >> 7;
		x ^= x << 17;
		number_is((double)(x >> 24 >> i % 40) / 1e6);
	}
	check(put_number, &(const double){INFINITY}, "null");
}

static void integers(void **state)
{
	check(put_u64, &(const uint64_t){0}, "0");
	check(put_u64, &(const uint64_t){10}, "10");
	check(put_u64, &(const uint64_t){UINT64_MAX}, "18446744073709551615");
	check(put_i64, &(const int64_t){INT64_MIN}, "-9223372036854775808");
	check(put_i64, &(const int64_t){-1}, "-1");
	check(put_i64, &(const int64_t){0}, "0");
}

static void times(void **state)
{
	for (int64_t us = 1; us < INT64_C(8000000000000000); us = us * 3 + 86399999999) {
		time_t s = (time_t)(us / 1000000);
		char wanted[40];
		struct tm tm;

		strftime(wanted, sizeof wanted, "\"%Y-%m-%dT%H:%M:%SZ\"", gmtime_r(&s, &tm));
		check(put_time, &us, wanted);
		check(put_time, &us, wanted);
	}
	check(put_time, &(const int64_t){0}, "null");
}

static void texts(void **state)
{
	check(put_text, "", "\"k\\\"\":\"\"");
	check(put_text, "a\"b\\c/d~ !\x7f\n", "\"k\\\"\":\"a\\\"b\\\\c/d~ !\\u007f\\u000a\"");
	check(put_text, "Grüße\xff\xc3", "\"k\\\"\":\"Grüße\\ufffd\\ufffd\"");
	check(put_lattice, "0.01 0.01 50000000 540000000 0",
	      "\"lattice\":{\"scale_xy\":0.01,\"scale_z\":0.01,\"offset\":[500000,5400000,0]}");
	check(put_lattice, "0.01 0.01 5 5", "\"lattice\":null");
	check(put_lattice, "0.01 0.01 5 5 x", "\"lattice\":null");
	check(put_lattice, "", "\"lattice\":null");
	check(put_lattice, "00000000000000000000000000000000000000000000000000000001 1 1 1 1", "\"lattice\":null");
}

/* What must be escaped, byte by byte; `c`: no part of a longer character. */
static const char *escaped(unsigned char c, char buf[16])
{
	if (c == '"' || c == '\\')
		snprintf(buf, 16, "\\%c", c);
	else if (c < 0x20 || c == 0x7f)
		snprintf(buf, 16, "\\u%04x", c);
	else
		snprintf(buf, 16, c < 0x80 ? "%c" : "\\ufffd", c);
	return buf;
}

/* Each byte at each place of texts of many lengths: they are looked at several bytes at once. The same as a key. */
static void odd_places(void **state)
{
	enum { MOST = 40 };

	for (unsigned c = 1; c < 256; c++)
		for (unsigned len = 1; len <= MOST; len += 1 + len / 6)
			for (unsigned at = 0; at < len; at++) {
				char text[MOST + 1], wanted[2 * MOST + 32], one[16], *got, *as_key;
				struct term_json j = {.list = true};
				size_t n;

				memset(text, 'w', len);
				text[len] = 0;
				text[at] = (char)c;
				escaped((unsigned char)c, one);
				snprintf(wanted, sizeof wanted, "\"k\\\"\":\"%.*s%s%s\"", (int)at, text, one, text + at + 1);
				check(put_text, text, wanted);
				if (len > 17)
					continue;
				j.out = open_memstream(&got, &n);
				term_json_bool(&j, text, true);
				term_json_line(&j);
				fclose(j.out);
				assert_true(asprintf(&as_key, "%s:true\n", wanted + strlen("\"k\\\"\":")) > 0);
				assert_string_equal(got, as_key);
				free(got);
				free(as_key);
			}
}

/* Keys of the source, and those that only look so. */
static void keys(void **state)
{
	const char *const rule = "of a \"table\"";
	char *text;
	size_t n;
	struct term_json j = {.out = open_memstream(&text, &n), .list = true};

	term_json_open(&j, NULL, '{');
	term_json_text(&j, "", NULL);
	term_json_number(&j, "zero", 0);
	term_json_number(&j, "minus", -0.0);
	term_json_u64(&j, rule, 9);
	term_json_i64(&j, "a\\b", -10);
	term_json_literal(&j, "Höhe", "[]");
	term_json_known(&j, "none", "unknown");
	term_json_known(&j, "some", "unknowns");
	term_json_close(&j, '}');
	term_json_line(&j);
	fclose(j.out);
	assert_string_equal(text, "{\"\":null,\"zero\":0,\"minus\":-0,\"of a \\\"table\\\"\":9,\"a\\\\b\":-10,\"Höhe\":[],"
				  "\"none\":null,\"some\":\"unknowns\"}\n");
	free(text);
}

/* Each byte of short keys and texts is where it was. */
static void short_ones(void **state)
{
	static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ";

	for (size_t len = 0; len < sizeof letters; len++) {
		char word[sizeof letters], *text, *wanted;
		size_t n;
		struct term_json j = {.out = open_memstream(&text, &n), .list = true};

		memcpy(word, letters, len);
		word[len] = 0;
		term_json_open(&j, NULL, '{');
		term_json_u64(&j, word, UINT64_C(12345678901234567890) >> len);
		term_json_text(&j, word, word);
		term_json_close(&j, '}');
		term_json_line(&j);
		fclose(j.out);
		assert_true(asprintf(&wanted, "{\"%s\":%llu,\"%s\":\"%s\"}\n", word, 12345678901234567890ull >> len, word, word) >
			    0);
		assert_string_equal(text, wanted);
		free(text);
		free(wanted);
	}
}

/* Keys and texts of all lengths around what is held back; lines for two streams in turns. */
static void lengths(void **state)
{
	enum { MOST = 20000 };
	char *text[2] = {0}, *word = test_malloc(MOST + 1), *at[2];
	size_t n[2];
	struct term_json j[2] = {{.out = open_memstream(&text[0], &n[0]), .list = true},
				 {.out = open_memstream(&text[1], &n[1]), .list = true}};

	memset(word, 'w', MOST);
	for (int step = 0; step < 2; step++) {
		at[0] = text[0], at[1] = text[1];
		for (size_t len = 1; len < MOST; len = len * 3 / 2 + 1) {
			word[len] = 0;
			for (int k = 0; k < 2 && !step; k++) {
				term_json_open(&j[k], NULL, '{');
				term_json_text(&j[k], word, word);
				term_json_u64(&j[k], "n", len);
			}
			for (int k = 0; k < 2 && !step; k++) {
				term_json_close(&j[k], '}');
				term_json_line(&j[k]);
			}
			for (int k = 0; k < 2 && step; k++) {
				char *wanted;
				int size = asprintf(&wanted, "{\"%s\":\"%s\",\"n\":%zu}\n", word, word, len);

				assert_memory_equal(at[k], wanted, size);
				at[k] += size;
				free(wanted);
			}
			word[len] = 'w';
		}
		for (int k = 0; k < 2 && !step; k++)
			fclose(j[k].out);
	}
	assert_int_equal(at[0] - text[0], n[0]);
	test_free(word);
	free(text[0]);
	free(text[1]);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(numbers),    cmocka_unit_test(integers), cmocka_unit_test(times),      cmocka_unit_test(texts),
		cmocka_unit_test(odd_places), cmocka_unit_test(keys),     cmocka_unit_test(short_ones), cmocka_unit_test(lengths),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
