/* The smaller parts of base: errors, the log's levels, ledger, cursor, clock, parsing. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "clock.h"
#include "cursor.h"
#include "err.h"
#include "ledger.h"
#include "log.h"
#include "parse.h"
#include "utf8.h"

static void test_err(void **state)
{
	struct err err = ERR_INIT;
	char text[900];

	assert_int_equal(err_add_hint(&err, "nothing is wrong"), 0);
	assert_string_equal(err.hint, "");
	assert_int_equal(err_set(&err, ERR_INPUT, "scale is %d", 0), -ERR_INPUT);
	assert_int_equal(err_set(&err, ERR_IO, "later"), -ERR_INPUT); /* the first wins */
	assert_int_equal(err_add_file(&err, "a.las"), -ERR_INPUT);
	err_add_file(&err, "b.las");
	err_add_place(&err, 131, "x scale");
	err_add_place(&err, 7, "other");
	err_add_hint(&err, "mend it");
	assert_string_equal(err_format(&err, text, sizeof text), "a.las: byte 131, x scale: scale is 0 (mend it)");
	err_clear(&err);
	assert_int_equal(err_sys(&err, ENOSPC, "cannot write"), -ERR_NOSPACE);
	assert_string_equal(err_format(&err, text, sizeof text), "cannot write: No space left on device");
	err_format(&err, text, 10);
	assert_int_equal(strlen(text), 9);
	(void)state;
}

static void test_err_long(void **state)
{
	struct err err = ERR_INIT;
	char text[2000];

	for (size_t i = 0; i + 1 < sizeof text; i += 2)
		memcpy(text + i, "\xc3\xa9", 2);
	text[1998] = '\0';
	err_set(&err, ERR_INPUT, "%s", text);
	err_add_file(&err, text);
	err_add_hint(&err, "%s", text);
	assert_int_equal(strlen(err.message) % 2, 0); /* never half of a character */
	assert_int_equal(strlen(err.file) % 2, 0);
	assert_int_equal(strlen(err.hint) % 2, 0);
	assert_true(strlen(err.message) >= sizeof err.message - 3);
	(void)state;
}

static void test_err_table(void **state)
{
	for (int c = 0; c < ERR_COUNT; c++)
		assert_int_equal(err_from_wire_name(err_wire_name((enum err_code)c)), c);
	assert_int_equal(err_from_wire_name("what"), ERR_INTERNAL);
	assert_int_equal(err_exit_status(ERR_USAGE), 2);
	assert_int_equal(err_exit_status(ERR_NODAEMON), 69);
	assert_int_equal(err_exit_status((enum err_code)1000), 1);
	(void)state;
}

static void test_log(void **state)
{
	char line[400] = "";
	int ends[2], saved = dup(STDERR_FILENO);
	enum log_level level = LOG_LEVEL_ERROR;
	struct err err = ERR_INIT;

	assert_true(log_parse_level("notice", &level));
	assert_int_equal(level, LOG_LEVEL_NOTICE);
	assert_false(log_parse_level("loud", &level));
	assert_int_equal(pipe(ends), 0);
	dup2(ends[1], STDERR_FILENO);
	log_init("acutd", LOG_LEVEL_INFO);
	errno = 5;
	log_debug("not seen");
	log_info("file a\nb");
	err_set(&err, ERR_INPUT, "bad");
	log_err(LOG_LEVEL_ERROR, "job 1", &err);
	assert_int_equal(errno, 5);
	dup2(saved, STDERR_FILENO);
	close(saved);
	close(ends[1]);
	ssize_t n = read(ends[0], line, sizeof line - 1);

	close(ends[0]);
	assert_true(n > 0);
	assert_string_equal(line, "acutd: info: file a?b\nacutd: error: job 1: bad\n");
	(void)state;
}

static void *ledger_churn(void *arg)
{
	for (int i = 0; i < 20000; i++)
		if (ledger_take(arg, LEDGER_STAGE, 600))
			ledger_give(arg, LEDGER_STAGE, 600);
	return NULL;
}

/* The reserve of a name is available whatever the others hold, and no name gets more than its limit. */
static void test_ledger_shares(void **state)
{
	struct ledger *l = ledger_new(1000);

	assert_true(ledger_reserve(l, LEDGER_MESSAGE, 100, 300));
	assert_false(ledger_reserve(l, LEDGER_MESSAGE, 100, 0));
	assert_false(ledger_reserve(l, LEDGER_JOBS, 901, 0));
	assert_true(ledger_reserve(l, LEDGER_JOBS, 200, 0));
	assert_int_equal(ledger_left(l), 700);
	assert_int_equal(ledger_available(l, LEDGER_DOMAIN), 700);
	assert_int_equal(ledger_available(l, LEDGER_MESSAGE), 300);
	assert_int_equal(ledger_available(l, LEDGER_JOBS), 900);
	assert_false(ledger_take(l, LEDGER_DOMAIN, 701));
	assert_true(ledger_take(l, LEDGER_DOMAIN, 700));
	assert_true(ledger_take(l, LEDGER_MESSAGE, 60));
	assert_int_equal(ledger_available(l, LEDGER_MESSAGE), 40);
	assert_true(ledger_take(l, LEDGER_MESSAGE, 40));
	assert_false(ledger_take(l, LEDGER_MESSAGE, 1));
	assert_false(ledger_take(l, LEDGER_JOBS, UINT64_MAX));
	assert_true(ledger_take(l, LEDGER_JOBS, 200));
	assert_int_equal(ledger_peak_all(l), 1000);
	ledger_give(l, LEDGER_DOMAIN, 700);
	assert_int_equal(ledger_left(l), 700);
	/* Beyond its reserve, from what the others leave, up to its limit. */
	assert_false(ledger_take(l, LEDGER_MESSAGE, 201));
	assert_true(ledger_take(l, LEDGER_MESSAGE, 200));
	assert_int_equal(ledger_left(l), 500);
	assert_int_equal(ledger_claimed(l, 1u << LEDGER_MESSAGE | 1u << LEDGER_DOMAIN), 300);
	ledger_give(l, LEDGER_MESSAGE, 290);
	assert_int_equal(ledger_left(l), 700);
	assert_int_equal(ledger_claimed(l, 1u << LEDGER_MESSAGE), 100);
	assert_int_equal(ledger_peak(l, LEDGER_MESSAGE), 300);
	ledger_give(l, LEDGER_MESSAGE, 10);
	ledger_give(l, LEDGER_JOBS, 200);
	assert_int_equal(ledger_left(l), 700);
	assert_null(ledger_free(l));
	(void)state;
}

static void test_ledger(void **state)
{
	struct ledger *l = ledger_new(1000);
	pthread_t thread[3];

	assert_true(ledger_take(l, LEDGER_PIPE, 400));
	assert_false(ledger_take(l, LEDGER_STAGE, 601));
	assert_false(ledger_take(l, LEDGER_STAGE, UINT64_MAX));
	assert_int_equal(ledger_left(l), 600);
	assert_true(ledger_take(l, LEDGER_STAGE, 600));
	assert_int_equal(ledger_held(l, LEDGER_STAGE), 600);
	ledger_give(l, LEDGER_STAGE, 600);
	for (int i = 0; i < 3; i++)
		pthread_create(&thread[i], NULL, ledger_churn, l);
	for (int i = 0; i < 3; i++)
		pthread_join(thread[i], NULL);
	ledger_give(l, LEDGER_PIPE, 400);
	assert_int_equal(ledger_left(l), ledger_total(l));
	assert_int_equal(ledger_peak(l, LEDGER_PIPE), 400);
	assert_int_equal(ledger_peak(l, LEDGER_STAGE), 600);
	assert_int_equal(ledger_peak_all(l), 1000);
	for (int i = 0; i < LEDGER_NAMES; i++)
		assert_true(strcmp(ledger_name_text((enum ledger_name)i), "unknown") != 0);
	assert_null(ledger_free(l));
	assert_null(ledger_free(NULL));
	(void)state;
}

static void test_cursor(void **state)
{
	uint8_t bytes[64];
	struct packer p = packer_of(bytes, sizeof bytes);

	packer_u8(&p, 0xfe);
	packer_u16(&p, 0xfedc);
	packer_u32(&p, 0xfedcba98u);
	packer_u64(&p, 0xfedcba9876543210u);
	packer_i32(&p, -2);
	packer_i64(&p, INT64_MIN);
	packer_f64(&p, -0.1);
	packer_zero(&p, 3);
	packer_bytes(&p, "abc", 3);
	assert_false(p.bad);
	assert_int_equal(packer_size(&p), 41);
	assert_int_equal(bytes[1], 0xdc); /* little-endian */
	struct cursor c = cursor_of(bytes, packer_size(&p));

	assert_int_equal(cursor_u8(&c), 0xfe);
	assert_int_equal(cursor_u16(&c), 0xfedc);
	assert_int_equal(cursor_u32(&c), 0xfedcba98u);
	assert_true(cursor_u64(&c) == 0xfedcba9876543210u);
	assert_int_equal(cursor_i32(&c), -2);
	assert_true(cursor_i64(&c) == INT64_MIN);
	assert_true(cursor_f64(&c) == -0.1);
	cursor_skip(&c, 3);
	assert_int_equal(cursor_left(&c), 3);
	assert_int_equal(cursor_u32(&c), 0); /* one byte short */
	assert_true(c.bad);
	assert_int_equal(cursor_u8(&c), 0); /* sticky, though three are left */
	assert_int_equal(cursor_left(&c), 0);
	p = packer_of(bytes, 3);
	packer_u16(&p, 1);
	packer_u16(&p, 1);
	assert_true(p.bad);
	packer_u8(&p, 1);
	assert_int_equal(packer_size(&p), 2);
	c = cursor_of(NULL, 0);
	assert_false(c.bad);
	cursor_u8(&c);
	assert_true(c.bad);
	(void)state;
}

static void test_clock(void **state)
{
	uint64_t t = clock_mono_ns();

	usleep(2000);
	assert_true(clock_since(t) >= 0.002 && clock_since(t) < 60);
	assert_true(clock_since(UINT64_MAX) == 0);
	assert_true(clock_real_us() > INT64_C(1500000000000000));
	(void)state;
}

static void test_parse_integers(void **state)
{
	static const char *const bad[] = {"", " 1", "1 ", "+", "-", "0x1", "1.0", "18446744073709551616"};
	uint64_t u = 7;
	int64_t i = 7;

	for (size_t k = 0; k < sizeof bad / sizeof bad[0]; k++) {
		assert_false(parse_u64(bad[k], &u));
		assert_false(parse_i64(bad[k], &i));
	}
	assert_false(parse_u64("-1", &u));
	assert_false(parse_i64("9223372036854775808", &i));
	assert_false(parse_i64("-9223372036854775809", &i));
	assert_true(u == 7 && i == 7);
	assert_true(parse_u64("18446744073709551615", &u) && u == UINT64_MAX);
	assert_true(parse_i64("-9223372036854775808", &i) && i == INT64_MIN);
	assert_true(parse_i64("+5", &i) && i == 5);
	(void)state;
}

static void test_parse_units(void **state)
{
	static const char *const bad[] = {"", "M", "-1", "1X", "1MM", "1 M", "nan", "1e30P", "-0M", "0x10K"};
	uint64_t u = 7;
	double d = 7;
	char text[32];

	for (size_t k = 0; k < sizeof bad / sizeof bad[0]; k++) {
		assert_false(parse_size(bad[k], &u));
		assert_false(parse_seconds(bad[k], &d));
	}
	assert_true(u == 7 && d == 7);
	assert_true(parse_many("12", &u) && u == 12);
	assert_true(parse_many("12k", &u) && u == 12000);
	assert_true(parse_many("1.5M", &u) && u == 1500000);
	assert_true(parse_many("2G", &u) && u == UINT64_C(2000000000));
	assert_false(parse_many("1.0001k", &u) || parse_many("M", &u) || parse_many("-1k", &u) || parse_many("1m", &u) ||
		     parse_many("10000000G", &u) || parse_many("", &u) ||
		     parse_many("0000000000000000000000000000000000000012k", &u));
	assert_true(parse_size("24M", &u) && u == 24u << 20);
	assert_true(parse_size("1.5G", &u) && u == 3ull << 29);
	assert_true(parse_size("512k", &u) && u == 512u << 10);
	assert_true(parse_size("100", &u) && u == 100);
	assert_false(parse_size("1.5", &u));
	assert_true(parse_seconds("90", &d) && d == 90);
	assert_true(parse_seconds("1.5m", &d) && d == 90);
	assert_true(parse_seconds("2h", &d) && d == 7200);
	assert_true(parse_seconds("7d", &d) && d == 604800);
	assert_true(parse_seconds("1e10", &d) && d == 1e10);
	assert_false(parse_seconds("10000000001", &d)); /* more does not fit nanoseconds */
	assert_false(parse_seconds("300000d", &d));
	assert_false(parse_seconds("1e308d", &d));
	assert_true(parse_double("-1.5e3", &d) && d == -1500);
	assert_false(parse_double("1e999", &d));
	assert_false(parse_double("inf", &d));
	assert_false(parse_double("1.5x", &d));
	assert_string_equal(parse_size_text(0, text), "0 bytes");
	assert_string_equal(parse_size_text(1288490189, text), "1.2 GB");
	assert_string_equal(parse_size_text(340u << 20, text), "340 MB");
	assert_string_equal(parse_size_text(1048575, text), "1.0 MB");
	(void)state;
}

/* As in RFC 3629: by the range of the number. */
static size_t utf8_put(uint32_t c, uint8_t buf[4])
{
	size_t n = c < 0x80 ? 1 : c < 0x800 ? 2 : c < 0x10000 ? 3 : 4;

	for (size_t i = n; i-- > 1; c >>= 6)
		buf[i] = (uint8_t)(0x80 | (c & 0x3f));
	buf[0] = (uint8_t)(n == 1 ? c : (0xf00u >> n) | c);
	return n;
}

static void test_utf8_end(void **state)
{
	(void)state;
	assert_string_equal(utf8_end("abc", 3), "abc");
	assert_string_equal(utf8_end("abc", 2), "bc");
	assert_string_equal(utf8_end("a\u00e9\u20ac", 5), "\u00e9\u20ac");
	assert_string_equal(utf8_end("a\u00e9\u20ac", 4), "\u20ac");
	assert_string_equal(utf8_end("a\u00e9\u20ac", 2), "");
	assert_string_equal(utf8_end("", 0), "");
}

static void test_utf8(void **state)
{
	uint8_t s[4];
	unsigned pairs = 0, triples = 0, fours = 0;

	for (uint32_t c = 0; c < 0x110000; c++) {
		size_t n = utf8_put(c, s);
		bool character = c < 0xd800 || c > 0xdfff, control = c < 0x20 || (c >= 0x7f && c < 0xa0);

		assert_int_equal(utf8_length(s, SIZE_MAX), character ? n : 0);
		assert_int_equal(utf8_length(s, n - 1), 0);
		assert_int_equal(utf8_printable(s, n), character && !control ? n : 0);
		if (character)
			assert_int_equal(utf8_code(s, n), c);
	}
	/* as many as there are numbers: nothing else is a character */
	for (uint32_t v = 0; v < 1 << 24; v++) {
		memcpy(s, (uint8_t[]){(uint8_t)(v >> 16), (uint8_t)(v >> 8), (uint8_t)v}, 3);
		pairs += !s[2] && utf8_length(s, 3) == 2;
		triples += utf8_length(s, 3) == 3;
		s[3] = s[2];
		s[2] = (uint8_t[]){0x7f, 0x80, 0xbf, 0xc0}[v & 3];
		fours += utf8_length(s, 4) == 4;
	}
	assert_int_equal(pairs, 0x800 - 0x80);
	assert_int_equal(triples, 0x10000 - 0x800 - 0x800);
	assert_int_equal(fours, 0x100000 / 0x1000 * 32);
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_utf8_end), cmocka_unit_test(test_utf8),           cmocka_unit_test(test_err),
		cmocka_unit_test(test_err_long), cmocka_unit_test(test_err_table),      cmocka_unit_test(test_log),
		cmocka_unit_test(test_ledger),   cmocka_unit_test(test_ledger_shares),  cmocka_unit_test(test_cursor),
		cmocka_unit_test(test_clock),    cmocka_unit_test(test_parse_integers), cmocka_unit_test(test_parse_units),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
