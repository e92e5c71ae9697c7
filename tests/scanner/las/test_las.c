/* The LAS that is written to pipes, read by acut's own reader: coordinates, systems, counts. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "input.h"
#include "las.h"

static struct crs_info system_of(const char *text, const char *unit_z)
{
	struct err err = ERR_INIT;
	struct crs_info c;

	assert_int_equal(crs_assume_text(text, strlen(text), &c, &err), 0);
	if (unit_z)
		snprintf(c.unit_z, sizeof c.unit_z, "%s", unit_z);
	crs_info_settle(&c);
	return c;
}

/* Each is read back as the same. */
static void wkt(void **state)
{
	static const struct {
		const char *text, *unit_z;
	} of[] = {
		{"EPSG:32632", "metre"},
		{"EPSG:32733", NULL},
		{"EPSG:25832 + EPSG:7837", NULL},
		{"EPSG:32632 + EPSG:5030", "metre"},
		{"EPSG:5041", "metre"},
		{"EPSG:5042", "metre"},
		{"EPSG:2154", "metre"},
		{"EPSG:3035", "metre"},
		{"EPSG:2263", "us-survey-foot"},
		{"EPSG:31370", "metre"},
		{"EPSG:27700 + EPSG:5701", NULL},
		{"EPSG:26910 + EPSG:5703", NULL},
		{"EPSG:3031", "metre"},
		{"a plane of our own", "metre"},
		{"a plane + a datum, of heights", NULL},
		{"NAD83(CSRS) / UTM zone 10N", "metre"},
		{"EPSG:32632 + orthometric height (egm96-5)", "metre"},
		{"EPSG:5514", "foot"},
	};
	struct err err = ERR_INIT;
	char text[LAS_WKT_MAX];
	struct crs_info c, back;
	size_t n;

	for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
		c = system_of(of[i].text, of[i].unit_z);
		if (las_wkt(&c, text, &n, &err))
			fail_msg("%s: %s", of[i].text, err.message);
		assert_true(n && !text[n - 1]);
		assert_true(crs_read_wkt(text, n - 1, &back));
		assert_string_equal(back.text, c.text);
		assert_string_equal(back.unit_xy, c.unit_xy);
		assert_string_equal(back.unit_z, c.unit_z);
		if (c.system.method)
			assert_true(crs_system_same(&c.system, &back.system));
	}
	c = system_of("a \"quoted\" plane", NULL);
	assert_int_equal(las_wkt(&c, text, &n, &err), -ERR_UNSUPPORTED);
	crs_info_clear(&c);
	err = ERR_INIT;
	assert_int_equal(las_wkt(&c, text, &n, &err), 0);
	assert_int_equal(n, 0);
	snprintf(c.unit_xy, sizeof c.unit_xy, "metre");
	snprintf(c.unit_z, sizeof c.unit_z, "metre");
	assert_int_equal(las_wkt(&c, text, &n, &err), 0);
	assert_true(crs_read_wkt(text, n - 1, &back));
	assert_string_equal(back.text, "unknown");
	assert_string_equal(back.unit_xy, "metre");
	assert_string_equal(back.unit_z, "metre");
}

static void places(void **state)
{
	const double first[3] = {512345.6789, 5412345.6784, 301.0005}, far[3] = {512345, 5412345, 3e6};
	struct las_frame f = las_frame_of(first);
	struct err err = ERR_INIT;
	int32_t at[3];

	assert_true(f.offset[0] == 1000000 && f.offset[1] == 5000000 && f.offset[2] == 0);
	assert_int_equal(las_place(&f, first, at, &err), 0);
	assert_int_equal(at[0], 512345679 - 1000000000);
	assert_int_equal(at[1], 412345678);
	assert_int_equal(at[2], 301001);
	assert_int_equal(las_place(&f, far, at, &err), -ERR_LIMIT);
	/* what the factor of a telegram can make of a range */
	for (int i = 0; i < 6; i++) {
		double lost[3] = {512345, 5412345, 301};

		lost[i % 3] = i < 3 ? 3e35 : -3e35;
		f = las_frame_of(lost);
		err_clear(&err);
		assert_int_equal(las_place(&f, lost, at, &err), -ERR_LIMIT);
	}
}

static void file(void **state)
{
	static const double point[3][3] = {
		{499999.9994, 5400000.25, -3.5}, {500001.001, 5400007.125, 12.0004}, {500000, 5399999, 0}};
	struct las_params p = {.id = {1, 2, 3}, .made_s = 1709209815};
	const struct input_options options = {.format = "las"};
	struct crs_info c = system_of("EPSG:32632 + EPSG:5030", "metre");
	static uint8_t head[LAS_HEAD_MAX];
	uint8_t record[LAS_RECORD];
	char path[] = "/tmp/acut-las-XXXXXX";
	struct err err = ERR_INIT;
	struct input *in = NULL;
	const struct input_info *info;
	size_t n;
	int fd = mkstemp(path);
	double gps;

	unlink(path);
	p.system = &c;
	p.frame = las_frame_of(point[0]);
	for (int i = 0; i < 3; i++) {
		int32_t at[3];

		assert_int_equal(las_place(&p.frame, point[i], at, &err), 0);
		las_summary_add(&p.summary, at);
	}
	assert_int_equal(las_head(&p, head, &n, &err), 0);
	assert_int_equal(write(fd, head, n), n);
	for (int i = 0; i < 3; i++) {
		int32_t at[3];

		las_place(&p.frame, point[i], at, &err);
		las_record(record, at, i ? 0.5f : NAN, 393245033.5 + i);
		assert_int_equal(write(fd, record, sizeof record), sizeof record);
	}
	memcpy(&gps, record + 22, 8);
	assert_true(gps == 393245035.5);
	assert_int_equal(record[12] | record[13] << 8, 32768);
	assert_int_equal(head[90] | head[91] << 8, 60); /* 2024-02-29 */
	assert_int_equal(head[92] | head[93] << 8, 2024);
	assert_int_equal(input_open(fd, "made.las", &options, &in, &err), 0);
	info = input_info(in);
	assert_int_equal(info->claimed, 3);
	assert_string_equal(info->warning, "");
	assert_string_equal(info->crs.text, "EPSG:32632 + EPSG:5030");
	assert_string_equal(info->crs.unit_z, "metre");
	assert_true(info->coords.min[0] == 499999.999 && info->coords.max[0] == 500001.001);
	assert_true(info->coords.min[1] == 5399999 && info->coords.max[1] == 5400007.125);
	assert_true(info->coords.min[2] == -3.5 && info->coords.max[2] == 12);
	assert_int_equal(info->trailing, 0);
	input_close(in);
	close(fd);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(wkt), cmocka_unit_test(places), cmocka_unit_test(file)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
