/*
 * The definitions of EPSG numbers: those of real surveys, checked by hand, and messages about files with other units. --dump
 * prints all definitions, one line for each number, for epsg_table.py.
 */
#include <stdarg.h>
#include <setjmp.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "crs.h"
#include "crs_parts.h"
#include "err.h"

static const struct {
	unsigned code;
	const char *name, *unit;
} projected[] = {
	{3005, "NAD83 / BC Albers", "metre"},
	{2948, "NAD83(CSRS) / MTM zone 6", "metre"},
	{2229, "NAD83 / California zone 5 (ftUS)", "us-survey-foot"},
	{2263, "NAD83 / New York Long Island (ftUS)", "us-survey-foot"},
	{2222, "NAD83 / Arizona East (ft)", "foot"},
	{31983, "SIRGAS 2000 / UTM zone 23S", "metre"},
	{3763, "ETRS89 / Portugal TM06", "metre"},
	{3003, "Monte Mario / Italy zone 1", "metre"},
	{3045, "ETRS89 / UTM zone 33N (N-E)", "metre"},
	{4647, "ETRS89 / UTM zone 32N (zE-N)", "metre"},
	{6677, "JGD2011 / Japan Plane Rectangular CS IX", "metre"},
	{2446, "JGD2000 / Japan Plane Rectangular CS IV", "metre"},
	{31256, "MGI / Austria GK East", "metre"},
	{6514, "NAD83(2011) / Montana", "metre"},
	{3102, "American Samoa 1962 / American Samoa Lambert", "us-survey-foot"},
	{2155, "American Samoa 1962 / American Samoa Lambert", "us-survey-foot"}, /* deprecated */
	{2314, "Trinidad 1903 / Trinidad Grid (ftCla)", "unknown"},
};

static void projected_numbers(void **state)
{
	struct crs_info info;
	char text[32];
	struct err err = ERR_INIT;

	for (size_t i = 0; i < sizeof projected / sizeof *projected; i++) {
		snprintf(text, sizeof text, "EPSG:%u", projected[i].code);
		assert_int_equal(crs_assume_text(text, strlen(text), &info, &err), 0);
		assert_int_equal(info.plane, CRS_PLANE_PROJECTED);
		assert_string_equal(info.text, text);
		assert_string_equal(info.unit_xy, projected[i].unit);
		assert_string_equal(info.unit_z, "unknown");
		assert_string_equal(crs_epsg_name(projected[i].code), projected[i].name);
	}
	assert_string_equal(crs_epsg_name(0), "");
	assert_string_equal(crs_epsg_name(1), "");
	assert_string_equal(crs_epsg_name(~0U), "");
}

static void other_kinds(void **state)
{
	static const struct {
		const char *said;
		enum crs_plane plane;
		const char *text, *unit_xy, *unit_z;
	} rows[] = {
		{"EPSG:5972", CRS_PLANE_PROJECTED, "EPSG:25832 + EPSG:5941", "metre", "metre"},
		{"EPSG:8360", CRS_PLANE_GEOGRAPHIC, "EPSG:4258 + EPSG:8357", "degree", "metre"},
		{"EPSG:2263 + EPSG:6360", CRS_PLANE_PROJECTED, "EPSG:2263 + EPSG:6360", "us-survey-foot", "us-survey-foot"},
		{"EPSG:2229 + EPSG:5754", CRS_PLANE_PROJECTED, "EPSG:2229 + EPSG:5754", "us-survey-foot", "unknown"},
		{"EPSG:4979", CRS_PLANE_GEOGRAPHIC, "EPSG:4979", "degree", "metre"},
		{"EPSG:4326", CRS_PLANE_GEOGRAPHIC, "EPSG:4326", "degree", "unknown"},
		{"EPSG:4807", CRS_PLANE_GEOGRAPHIC, "EPSG:4807", "unknown", "unknown"}, /* grad */
		{"EPSG:4978", CRS_PLANE_GEOCENTRIC, "EPSG:4978", "metre", "metre"},
		{"EPSG:9895", CRS_PLANE_PROJECTED, "EPSG:9895", "metre", "metre"}, /* with heights of its own */
	};
	struct err err = ERR_INIT;
	struct crs_info info;

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		assert_int_equal(crs_assume_text(rows[i].said, strlen(rows[i].said), &info, &err), 0);
		assert_int_equal(info.plane, rows[i].plane);
		assert_string_equal(info.text, rows[i].text);
		assert_string_equal(info.unit_xy, rows[i].unit_xy);
		assert_string_equal(info.unit_z, rows[i].unit_z);
	}
}

static void names(void **state)
{
	static const struct {
		const char *name;
		unsigned code;
	} rows[] = {
		{"NAD83 / California zone 5 (ftUS)", 2229},
		{"nad83 / new york long island (FTUS)", 2263},
		{"American Samoa 1962 / American Samoa Lambert", 3102}, /* not the deprecated ones */
		{"ETRS89-extended / LAEA Europe", 3035},
		{"ETRS89 / LAEA Europe", 3035},
		{"BD72 / Belgian Lambert 72", 31370},
		{"NAD83 / California", 0},
		{"WGS 84", 0},
		{"", 0},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
		assert_int_equal(crs_epsg_of_name(rows[i].name, strlen(rows[i].name)), rows[i].code);
}

static void remarks(void **state)
{
	static const uint16_t metres[] = {1, 1, 0, 3, 1024, 0, 1, 1, 3072, 0, 1, 2229, 3076, 0, 1, 9001};
	static const uint16_t plain[] = {1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 2229};
	static const uint16_t clarke[] = {1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 2314};
	static const uint16_t heights[] = {1, 1, 0, 4, 1024, 0, 1, 1, 3072, 0, 1, 25832, 4096, 0, 1, 6360, 4099, 0, 1, 9001};
	static const uint16_t nobody[] = {1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 31};
	static const uint16_t nothing[] = {1, 1, 0, 3, 1024, 0, 1, 1, 3072, 0, 1, 2154, 4096, 0, 1, 5000};
	static const struct {
		const uint16_t *keys;
		size_t size;
		const char *unit_xy, *unit_z, *remark;
	} rows[] = {
		{metres, sizeof metres, "metre", "unknown",
		 "x and y are taken as metre, but EPSG:2229 (NAD83 / California zone 5 (ftUS)) is in the unit us-survey-foot"},
		{plain, sizeof plain, "us-survey-foot", "unknown", ""},
		{clarke, sizeof clarke, "unknown", "unknown",
		 "EPSG:2314 (Trinidad 1903 / Trinidad Grid (ftCla)) is in the unit Clarke's foot, which acut does not know"},
		{heights, sizeof heights, "metre", "metre",
		 "z is taken as metre, but EPSG:6360 (NAVD88 height (ftUS)) is in the unit us-survey-foot"},
		{nobody, sizeof nobody, "unknown", "unknown", "EPSG:31 is no system that acut knows of EPSG: check the number"},
		{nothing, sizeof nothing, "metre", "unknown", "EPSG:5000 is no system that acut knows of EPSG: check the number"},
	};
	static const struct {
		const char *text, *remark;
	} said[] = {
		{"EPSG:2154 + EPSG:5720", ""},
		{"EPSG:2154 + orthometric height (egm96)", ""},
		{"EPSG:5720", "EPSG:5720 (NGF-IGN69 height) is a system of heights, not of x and y"},
		{"EPSG:32631 + EPSG:32632", "EPSG:32632 (WGS 84 / UTM zone 32N) is no system of heights"},
		/* heights above an ellipsoid, as files put them */
		{"EPSG:32631 + EPSG:4979", "z is taken as unknown, but EPSG:4979 (WGS 84) is in the unit metre"},
		{"EPSG:32631 + EPSG:5030", ""},
		{"EPSG:32631 + EPSG:5103", ""},
	};
	struct err err = ERR_INIT;
	char text[384], small[20];
	struct crs_info info;

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		const struct crs_records records = {.keys = {rows[i].keys, rows[i].size}};

		crs_read(&records, &info);
		assert_string_equal(info.unit_xy, rows[i].unit_xy);
		assert_string_equal(info.unit_z, rows[i].unit_z);
		crs_epsg_remark(&info, text, sizeof text);
		assert_string_equal(text, rows[i].remark);
	}
	for (size_t i = 0; i < sizeof said / sizeof *said; i++) {
		assert_int_equal(crs_assume_text(said[i].text, strlen(said[i].text), &info, &err), 0);
		crs_epsg_remark(&info, text, sizeof text);
		assert_string_equal(text, said[i].remark);
	}
	crs_read(&(struct crs_records){.keys = {heights, sizeof heights}}, &info);
	crs_epsg_remark(&info, small, sizeof small);
	assert_int_equal(strlen(small), sizeof small - 1);
	crs_info_clear(&info);
	crs_epsg_remark(&info, text, sizeof text);
	assert_string_equal(text, "");
}

static int dump(void)
{
	struct crs_info info;
	unsigned plane, heights;

	for (unsigned code = 1; code < 1000000; code++) {
		if (crs_epsg_system(code, &info))
			printf("%u\t%s\t%d\t%s\t%s\n", code, crs_epsg_name(code), (int)info.plane, info.unit_xy, info.unit_z);
		else if (crs_epsg_compound(code, &plane, &heights))
			printf("%u\t%s\tcompound\t%u\t%u\n", code, crs_epsg_name(code), plane, heights);
		else if (*crs_epsg_name(code))
			printf("%u\t%s\tvertical\t%s\n", code, crs_epsg_name(code), crs_epsg_height_unit(code));
	}
	return 0;
}

int main(int argc, char **argv)
{
	static const struct CMUnitTest tests[] = {
		cmocka_unit_test(projected_numbers),
		cmocka_unit_test(other_kinds),
		cmocka_unit_test(names),
		cmocka_unit_test(remarks),
	};

	if (argc > 1 && !strcmp(argv[1], "--dump"))
		return dump();
	return cmocka_run_group_tests(tests, NULL, NULL);
}
