/*
 * Files cut at every byte, and with bytes changed at random: every one ends in points or in one clear
 * error, and the memory taken is that of input_bytes(), whatever the file says. Run it under sanitizers.
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

#include "account.h"
#include "clock.h"
#include "fixture.h"
#include "io.h"

#define WKT                                                                                                 \
	"COMPD_CS[\"c\",PROJCS[\"p\",GEOGCS[\"g\",UNIT[\"degree\",0.0174532925199433]],UNIT[\"metre\",1]]," \
	"VERT_CS[\"v\",UNIT[\"metre\",1]]]"

static const struct input_options defaults, truncated = {.accept_truncated = true, .planar = true};

enum { KINDS = 3, BATCH = 64, BATCH_BYTES = BATCH * (24 + 3) };

static void check(const void *bytes, size_t size, const struct input_options *options)
{
	struct outcome out;

	account_begin();
	out = fixture_read(bytes, size, "a.las", options, BATCH);
	assert_true(account_taken() <= input_bytes() + BATCH_BYTES);
	assert_true(out.code < ERR_COUNT);
	if (out.code) {
		assert_int_equal(out.err.code, out.code);
		assert_true(out.err.message[0] && !strcmp(out.err.file, "a.las"));
	}
	assert_true(out.points * 20 <= size); /* no more points than bytes for them */
}

static struct bytes sample(int kind)
{
	static const struct las_spec specs[] = {
		{.minor = 2, .format = 1, .n = 20, .wkt = WKT, .gap = 5},
		{.minor = 4, .format = 6, .n = 20, .wkt = WKT, .wkt_behind = true, .encoding = 16, .extra = 3},
		{.minor = 3, .format = 4, .n = 20, .encoding = 2},
	};

	return fixture_las(&specs[kind]);
}

static void cut_at_every_byte(void **state)
{
	for (int kind = 0; kind < KINDS; kind++) {
		struct bytes b = sample(kind);

		for (size_t n = 0; n <= b.size; n++) {
			struct outcome out = fixture_read(b.at, n, "a.las", &defaults, BATCH);

			check(b.at, n, &truncated);
			/* only what lies behind the last point may be missing */
			if (out.code == 0)
				assert_int_equal(out.points, 20);
			else
				assert_int_equal(out.code, n >= 227 && out.err.offset == 96 ? ERR_INPUT : ERR_TRUNCATED);
		}
		free(b.at);
	}
}

static void random_changes(void **state)
{
	uint64_t seed = 20240607;
	unsigned read = 0;

	for (int round = 0; round < 20000; round++) {
		struct bytes b = sample(round % KINDS);
		unsigned n = 1 + fixture_random(&seed) % 8;

		for (unsigned i = 0; i < n; i++) {
			/* half of them in the header, where they hurt */
			size_t range = fixture_random(&seed) % 2 && b.size > 400 ? 400 : b.size;
			size_t at = fixture_random(&seed) % range;
			static const uint8_t odd[] = {0, 1, 0x7f, 0x80, 0xff};

			b.at[at] = fixture_random(&seed) % 2 ? odd[fixture_random(&seed) % sizeof odd] :
							       (uint8_t)fixture_random(&seed);
		}
		if (fixture_random(&seed) % 4 == 0)
			b.size -= fixture_random(&seed) % b.size;
		check(b.at, b.size, round % 2 ? &defaults : &truncated);
		read += fixture_read(b.at, b.size, "a.las", &truncated, BATCH).code == 0;
		free(b.at);
	}
	assert_true(read > 1000 && read < 19000); /* the changes reach both ends */
}

static void random_text(void **state)
{
	static const char alphabet[] = "0123456789.-+eE ,;\t\n\r#%/naif";
	uint64_t seed = 7;
	char text[200];

	for (int round = 0; round < 20000; round++) {
		size_t n = fixture_random(&seed) % sizeof text;
		struct outcome out;

		for (size_t i = 0; i < n; i++)
			text[i] = fixture_random(&seed) % 50 ?
					  alphabet[fixture_random(&seed) % (round % 2 ? 15 : sizeof alphabet - 1)] :
					  (char)fixture_random(&seed);
		account_begin();
		out = fixture_read(text, n, "a.xyz", &defaults, BATCH);
		assert_true(account_taken() <= input_bytes() + BATCH_BYTES);
		if (out.code)
			assert_true(out.err.message[0] && ((out.err.offset >= 1 && out.err.offset <= n + 1) ||
							   !strncmp(out.err.message, "this is ", 8)));
	}
}

/* A header of 4 GiB of records, a sparse file: bounded reading, bounded memory. */
static void four_gigabytes_of_records(void **state)
{
	struct las_spec s = {.minor = 4, .format = 6, .vlrs_more = UINT32_MAX};
	struct bytes b = fixture_las(&s);
	int fd = fixture_fd(b.at, b.size);
	struct outcome out;

	assert_int_equal(pwrite(fd, "\xff\xff\xff\xff", 4, 96), 4);
	assert_int_equal(pwrite(fd, "\x77\x01\0\0\0\0\0\0\xff\xff\xff\xff", 12, 235), 12); /* records behind, too */
	assert_int_equal(ftruncate(fd, (off_t)5 << 30), 0);
	account_begin();
	out = fixture_read_fd(fd, "a.las", &defaults, BATCH);
	assert_int_equal(out.code, 0);
	assert_int_equal(out.points, 0);
	assert_true(account_taken() <= input_bytes() + BATCH_BYTES);
	assert_true(account_read() < 64 << 20); /* not the five gigabytes */
	close(fd);
	free(b.at);
}

static void file_calls_fail(void **state)
{
	static const char text[] = "1 2 3\n4 5 6\n7 8 9\n";

	fixture_faults_begin();
	for (int kind = 0; kind <= KINDS; kind++) {
		struct bytes b = kind < KINDS ? sample(kind) : (struct bytes){(uint8_t *)text, sizeof text - 1};
		const char *name = kind < KINDS ? "a.las" : "a.xyz";
		struct outcome out;

		fixture_faults.at_most = 0;
		for (fixture_faults.fail_at = 1;; fixture_faults.fail_at++) {
			fixture_faults.calls = 0;
			out = fixture_read(b.at, b.size, name, &defaults, BATCH);
			if (fixture_faults.calls < fixture_faults.fail_at)
				break;
			assert_int_equal(out.code, ERR_IO);
			assert_string_equal(out.err.file, name);
		}
		assert_int_equal(out.code, 0);
		assert_true(fixture_faults.fail_at > 5);
		fixture_faults.fail_at = 0;
		for (fixture_faults.at_most = 1; fixture_faults.at_most < 60; fixture_faults.at_most += 7)
			assert_int_equal(fixture_read(b.at, b.size, name, &defaults, BATCH).points, kind < KINDS ? 20 : 3);
		if (kind < KINDS)
			free(b.at);
	}
	fixture_faults_end();
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(cut_at_every_byte),         cmocka_unit_test(random_changes),  cmocka_unit_test(random_text),
		cmocka_unit_test(four_gigabytes_of_records), cmocka_unit_test(file_calls_fail),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
