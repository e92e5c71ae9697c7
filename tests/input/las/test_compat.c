/* Points in LASzip's compatibility mode: they are those of the original file, point by point. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "fixture.h"
#include "point.h"

enum { N = 700 };

static const struct input_options defaults;

/* All points; what the header says in *ret_info. */
static struct input_points read_all(const struct bytes *b, const char *name, struct input_info *ret_info)
{
	struct input_points pts, part;
	struct err err = ERR_INIT;
	struct input *in;
	int fd = fixture_fd(b->at, b->size);
	size_t n = 0;

	fixture_points_new(&pts, N);
	if (input_open(fd, name, &defaults, &in, &err))
		fail_msg("%s: %s", name, err.message);
	do {
		part = (struct input_points){.raw = pts.raw + n,
					     .cls = pts.cls + n,
					     .ret = pts.ret + n,
					     .flags = pts.flags + n,
					     .cap = N - n < 64 ? N - n : 64};
		if (input_read(in, &part, &err))
			fail_msg("%s: %s", name, err.message);
		n += part.n;
	} while (part.n);
	pts.n = n;
	*ret_info = *input_info(in);
	input_close(in);
	close(fd);
	return pts;
}

static void same_points(const struct las_spec *s, bool laz)
{
	struct bytes original = fixture_las(s), compat = fixture_compat(s, laz);
	struct input_info info, ignored;
	struct input_points a = read_all(&original, "original.las", &ignored), b = read_all(&compat, "compat.las", &info);
	unsigned high = 0, overlap = 0;
	uint64_t returns[16] = {0};
	char text[64];

	assert_int_equal(a.n, s->n);
	assert_int_equal(b.n, s->n);
	assert_memory_equal(a.raw, b.raw, s->n * sizeof *a.raw);
	assert_memory_equal(a.cls, b.cls, s->n);
	assert_memory_equal(a.ret, b.ret, s->n);
	assert_memory_equal(a.flags, b.flags, s->n);
	for (size_t i = 0; i < s->n; i++) {
		high += b.cls[i] > 31;
		overlap += b.flags[i] & POINT_OVERLAP ? 1 : 0;
		returns[b.ret[i] & 15]++;
	}
	assert_true(high > s->n / 2 && overlap > s->n / 4);
	assert_memory_equal(info.returns + 1, returns + 1, 15 * sizeof *returns);
	snprintf(text, sizeof text, ": LAS 1.4 point format %u in compatibility mode", s->format);
	assert_non_null(strstr(info.variant, text));
	assert_true(laz || !info.warning[0]);
	fixture_points_free(&a);
	fixture_points_free(&b);
	free(original.at);
	free(compat.at);
}

static void every_format(void **state)
{
	for (unsigned format = 6; format <= 10; format++) {
		for (unsigned extra = 0; extra < 9; extra += 4) {
			const struct las_spec s = {.minor = 4, .format = format, .n = N, .extra = extra};

			same_points(&s, false);
			same_points(&s, true);
		}
	}
}

/* Class 12 is overlap in older points; here only the flag says it. */
static void class_12(void **state)
{
	struct las_spec s = {.minor = 4, .format = 6, .n = 2};
	struct bytes b = fixture_compat(&s, false);
	uint8_t *record = b.at + b.size - 33;
	struct input_info info;
	struct input_points pts;

	record[15] = 12;
	record[28 + 3] = 0; /* class */
	record[28 + 4] = 0; /* flags */
	pts = read_all(&b, "a.las", &info);
	assert_int_equal(pts.cls[1], 12);
	assert_int_equal(pts.flags[1], 0);
	fixture_points_free(&pts);
	free(b.at);
}

/* Where the fields are not named, or lie outside of the record, the points are the older ones, and that is said. */
static void fields_that_are_not_there(void **state)
{
	struct las_spec s = {.minor = 4, .format = 6, .n = 20, .extra = 4};
	const size_t vlr = 227 + 54 + 156 + 54; /* the attributes */
	const struct {
		size_t at;
		uint8_t byte;
	} broken[] = {
		{vlr + 192 + 4, 'x'},   /* another name */
		{vlr + 192 * 2 + 2, 3}, /* two bytes */
		{vlr + 3, 5},           /* so many before the others that the last is behind the record */
		{vlr + 3, 255},         {vlr + 192 * 4 + 4, 'x'}, {227 + 54 + 156 + 18, 5}, /* no attributes at all */
	};

	for (size_t i = 0; i < sizeof broken / sizeof *broken; i++) {
		struct bytes b = fixture_compat(&s, false);
		struct input_info info;
		struct input_points pts;

		b.at[broken[i].at] = broken[i].byte;
		pts = read_all(&b, "a.las", &info);
		assert_int_equal(pts.n, s.n);
		for (size_t k = 0; k < pts.n; k++)
			assert_true(pts.cls[k] < 32);
		assert_non_null(strstr(info.warning, "in compatibility mode, but"));
		assert_string_equal(info.variant, "LAS 1.2, point format 1, 37 bytes");
		fixture_points_free(&pts);
		free(b.at);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_format),
		cmocka_unit_test(class_12),
		cmocka_unit_test(fields_that_are_not_there),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
