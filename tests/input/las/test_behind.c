/*
 * LAS headers that are wrong about the number of points and the data after them: pointers that lead into the points, no count, a
 * header that is too short for its version, bytes that belong to nothing.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "account.h"
#include "fixture.h"

static const struct input_options defaults, truncated = {.accept_truncated = true};

enum {
	AT_ENCODING = 6,
	AT_VERSION = 25,
	AT_HEADER_SIZE = 94,
	AT_COUNT = 107,
	AT_WAVEFORM = 227,
	AT_EVLR = 235,
	AT_EVLRS = 243,
	AT_COUNT_14 = 247,
	N = 50
};

#define PROJECTED "PROJCS[\"utm\",UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"32632\"]]"

static void put(uint8_t *at, uint64_t v, int n)
{
	for (int i = 0; i < n; i++, v >>= 8)
		at[i] = (uint8_t)v;
}

static struct outcome read_all(const struct bytes *b, const struct input_options *options)
{
	return fixture_read(b->at, b->size, "a.las", options, 16);
}

static bool warned(const struct outcome *out, const char *text)
{
	return strstr(out->info.warning, text) != NULL;
}

static void a_stale_pointer_to_records(void **state)
{
	for (int at_end = 0; at_end < 2; at_end++) {
		struct las_spec s = {.minor = 4, .format = 7, .n = N, .wkt = at_end ? PROJECTED : NULL, .wkt_behind = at_end};
		struct bytes b = fixture_las(&s);
		struct outcome out;

		put(b.at + AT_EVLR, 375 + 10 * 36 + 5, 8);
		put(b.at + AT_EVLRS, 3, 4);
		out = read_all(&b, &defaults);
		assert_int_equal(out.code, 0);
		assert_int_equal(out.points, N);
		assert_true(warned(&out, "byte 740, where the header says that extended records begin, is in the points"));
		assert_true(warned(&out, "no extended record (3) is read"));
		assert_int_equal(out.info.trailing, at_end ? 60 + strlen(PROJECTED) : 0);
		/* fewer bytes than the count: nothing speaks for it */
		b.size = 375 + 40 * 36;
		out = read_all(&b, &defaults);
		assert_int_equal(out.code, ERR_TRUNCATED);
		free(b.at);
	}
}

/* Records are there: then it is the count that is wrong, whatever the size of the file. */
static void a_pointer_to_records_that_are_there(void **state)
{
	struct las_spec s = {.minor = 4, .format = 6, .n = N, .wkt = PROJECTED, .wkt_behind = true};
	struct bytes b = fixture_las(&s);
	struct outcome out;

	put(b.at + AT_COUNT_14, N + 2, 8);
	out = read_all(&b, &defaults);
	assert_int_equal(out.code, ERR_TRUNCATED);
	assert_int_equal(out.err.offset, 375 + N * 30);
	out = read_all(&b, &truncated);
	assert_int_equal(out.points, N);
	assert_string_equal(out.info.crs.text, "EPSG:32632");
	free(b.at);
}

static void a_stale_pointer_to_waveforms(void **state)
{
	struct las_spec s = {.minor = 4, .format = 9, .n = N, .encoding = 2};
	struct bytes b = fixture_las(&s);
	struct outcome out;

	put(b.at + AT_WAVEFORM, 375 + 20 * 59, 8);
	out = read_all(&b, &defaults);
	assert_int_equal(out.code, 0);
	assert_int_equal(out.points, N);
	assert_true(warned(&out, "where the header says that waveforms begin, is in the points"));
	/* where there are some, the points end before */
	put(b.at + 375 + 20 * 59, 0, 8);
	put(b.at + 375 + 20 * 59 + 8, 0, 8);
	memcpy(b.at + 375 + 20 * 59 + 2, "LASF_Spec\0\0\0\0\0\0\0", 16);
	out = read_all(&b, &defaults);
	assert_int_equal(out.code, ERR_TRUNCATED);
	assert_true(strstr(out.err.message, "holds 20 whole points") != NULL);
	/* what stands behind the end of its name is nothing, if the record ends in the file */
	b.at[375 + 20 * 59 + 2 + 12] = 0xff;
	put(b.at + 375 + 20 * 59 + 20, 4, 8);
	assert_int_equal(read_all(&b, &defaults).code, ERR_TRUNCATED);
	put(b.at + 375 + 20 * 59 + 20, UINT64_MAX - 1, 8);
	assert_int_equal(read_all(&b, &defaults).points, N);
	free(b.at);
}

static void no_count(void **state)
{
	for (unsigned minor = 2; minor <= 4; minor += 2) {
		struct las_spec s = {.minor = minor, .format = minor == 2 ? 1 : 6, .n = N};
		struct bytes b = fixture_las(&s);
		struct outcome out;

		put(b.at + AT_COUNT, 0, 4);
		if (minor == 4)
			put(b.at + AT_COUNT_14, 0, 8);
		out = read_all(&b, &defaults);
		assert_int_equal(out.code, 0);
		assert_int_equal(out.points, 0);
		assert_true(warned(&out, "the header counts no points, but 50 are there, which --accept-truncated reads"));
		assert_false(out.info.has_trailing); /* it was told */
		out = read_all(&b, &truncated);
		assert_int_equal(out.points, N);
		assert_int_equal(out.info.claimed, N);
		/* less than a record is none */
		b.size = fixture_header_size(minor) + 10;
		out = read_all(&b, &defaults);
		assert_string_equal(out.info.warning, "");
		assert_int_equal(out.info.trailing, 10);
		free(b.at);
	}
}

/* As LAS 1.2 has it, in files of later versions: what lies behind byte 227 is points. */
static void a_short_header(void **state)
{
	for (unsigned minor = 3; minor <= 5; minor++) {
		struct las_spec s = {.minor = 2, .format = minor == 3 ? 1 : 6, .n = N};
		struct bytes b = fixture_las(&s);
		struct outcome out;

		b.at[AT_VERSION] = (uint8_t)minor;
		put(b.at + AT_COUNT, N, 4);
		memset(b.at + 227, 0x7f, 400); /* would be counts and pointers of the largest kind */
		out = read_all(&b, &defaults);
		assert_int_equal(out.code, 0);
		assert_int_equal(out.points, N);
		assert_true(warned(&out, "the header has 227 bytes, that of LAS 1."));
		assert_false(warned(&out, ";"));
		/* also one that is all the file has */
		b.size = 227;
		put(b.at + AT_COUNT, 0, 4);
		assert_int_equal(read_all(&b, &defaults).code, 0);
		/* what it says of itself is not there */
		put(b.at + AT_HEADER_SIZE, 300, 2);
		assert_int_equal(read_all(&b, &defaults).code, ERR_TRUNCATED);
		free(b.at);
	}
}

/* A file of 8 TB whose points end early: what is read is what the header accounts for, and the rest is known as such. */
static void sparse(void **state)
{
	const uint64_t size = UINT64_C(8) << 40;

	for (int behind = 0; behind < 2; behind++) {
		struct las_spec s = {.minor = 4, .format = 6, .n = N, .wkt = behind ? PROJECTED : NULL, .wkt_behind = behind};
		struct bytes b = fixture_las(&s);
		int fd = fixture_fd(b.at, b.size);
		struct outcome out;

		if (ftruncate(fd, (off_t)size)) {
			print_message("skipped: no file of 8 TB can be made here\n");
			skip();
		}
		account_begin();
		out = fixture_read_fd(fd, "a.las", &defaults, 16);
		assert_int_equal(out.code, 0);
		assert_int_equal(out.points, N);
		assert_true(account_read() < 1 << 20);
		assert_int_equal(out.info.accounted, b.size);
		assert_int_equal(out.info.bytes, size);
		close(fd);
		free(b.at);
	}
}

static void accounted(void **state)
{
	struct las_spec s = {.minor = 2, .format = 1, .n = N};
	struct bytes b = fixture_las(&s);

	assert_int_equal(read_all(&b, &defaults).info.accounted, b.size);
	put(b.at + AT_COUNT, N - 1, 4);
	assert_int_equal(read_all(&b, &defaults).info.accounted, b.size - 28);
	put(b.at + AT_COUNT, 0, 4);
	assert_int_equal(read_all(&b, &defaults).info.accounted, 227);
	assert_int_equal(read_all(&b, &truncated).info.accounted, b.size);
	free(b.at);
	assert_int_equal(fixture_read("1 2 3\n", 6, "a.xyz", &defaults, 9).info.accounted, 6);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_stale_pointer_to_records),
		cmocka_unit_test(a_pointer_to_records_that_are_there),
		cmocka_unit_test(a_stale_pointer_to_waveforms),
		cmocka_unit_test(no_count),
		cmocka_unit_test(a_short_header),
		cmocka_unit_test(sparse),
		cmocka_unit_test(accounted),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
