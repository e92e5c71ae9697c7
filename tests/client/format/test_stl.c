/* STL, read back: corners, normals, count, the origin in the header. What its floats cannot hold: test_glb.c. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "cursor.h"
#include "readback.h"

static const struct format_options automatic = {.origin_auto = true};

static void expect_normal(const float n[3], const float p[9])
{
	double a[3], b[3], c[3], length = 0;

	for (int i = 0; i < 3; i++) {
		a[i] = (double)p[3 + i] - (double)p[i];
		b[i] = (double)p[6 + i] - (double)p[i];
	}
	c[0] = a[1] * b[2] - a[2] * b[1];
	c[1] = a[2] * b[0] - a[0] * b[2];
	c[2] = a[0] * b[1] - a[1] * b[0];
	for (int i = 0; i < 3; i++)
		length += c[i] * c[i];
	assert_true(n[2] > 0); /* counter-clockwise from above */
	for (int i = 0; i < 3; i++)
		assert_true(fabs(n[i] - c[i] / sqrt(length)) < 1e-4);
}

static void expect_written(const struct meshes_spec *spec)
{
	const int32_t origin[3] = {spec->x0 + spec->step * (int32_t)(spec->columns - 1) / 2,
				   spec->y0 + spec->step * (int32_t)(spec->rows - 1) / 2, 0};
	struct meshes m;
	struct readback_mesh f;
	size_t size;
	char *text;
	uint32_t n;

	meshes_make(&m, spec);
	f = readback_flat(&m);
	text = readback_text("stl", "m.stl", &m, &automatic, &size);
	memcpy(&n, text + 80, 4);
	assert_int_equal(n, f.ntriangle);
	assert_int_equal(size, 84 + 50 * f.ntriangle);
	for (uint64_t i = 0; i < f.ntriangle; i++) {
		float v[12];

		memcpy(v, text + 84 + 50 * i, sizeof(v));
		for (int j = 0; j < 9; j++) {
			int32_t steps = f.vertex[f.triangle[i][j / 3]][j % 3] - origin[j % 3];

			assert_true(v[3 + j] == (float)(steps / (j % 3 < 2 ? 100.0 : 1000.0)));
		}
		expect_normal(v, v + 3);
		assert_memory_equal(text + 84 + 50 * i + 48, "\0\0", 2);
	}
	readback_same_piped("stl", &m, &automatic, text, size);
	free(text);
	readback_flat_done(&f);
	meshes_done(&m);
}

static void test_mesh(void **state)
{
	expect_written(&readback_small);
	expect_written(&readback_large);
}

static void test_header(void **state)
{
	struct format_options opt = {.has_origin = true};
	struct meshes m;
	size_t size;
	char *text;

	decimal_parse("500000.005", &opt.origin[0]);
	decimal_parse("4000000", &opt.origin[1]);
	meshes_make(&m, &readback_small);
	text = readback_text("stl", "m.stl", &m, &opt, &size);
	assert_string_equal(text, "acut-origin 500000.005 4000000 0");
	free(text);
	meshes_done(&m);
	/* without an origin it is not "solid", which would be the start of an ASCII file */
	meshes_make(&m, &(struct meshes_spec){.scale_xy = "0.01", .scale_z = "1"});
	opt = (struct format_options){0};
	text = readback_text("stl", "m.stl", &m, &opt, &size);
	assert_string_equal(text, "acut");
	assert_int_equal(size, 84);
	free(text);
	meshes_done(&m);
}

static void test_limit(void **state)
{
	for (uint64_t more = 0; more < 2; more++) {
		uint8_t saved[FORMAT_SAVED] = {0};
		struct packer to = packer_of(saved, sizeof(saved));
		struct meshes m;
		struct err err;

		meshes_make(&m, &readback_small);
		packer_u64(&to, UINT32_MAX - m.block[0].ntriangle + more);
		assert_int_equal(readback_late("stl", saved, &m, &automatic, &err), more ? -ERR_LIMIT : 0);
		if (more)
			assert_non_null(strstr(err.message, "STL cannot count more than 4294967295 triangles"));
		meshes_done(&m);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_mesh),
		cmocka_unit_test(test_header),
		cmocka_unit_test(test_limit),
	};

	return cmocka_run_group_tests(tests, readback_begin, readback_end);
}
