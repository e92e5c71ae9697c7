/* Pictures: cover, shading and colours of the pixels. */
#include <math.h>
#include <png.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "err.h"
#include "format_dem.h"
#include "written.h"

struct image {
	uint32_t w, h;
	uint8_t *p;
};

static struct image read_png(void)
{
	png_image im = {.version = PNG_IMAGE_VERSION};
	struct image r;

	assert_true(png_image_begin_read_from_file(&im, written_path()));
	im.format = PNG_FORMAT_RGBA;
	r.p = malloc(PNG_IMAGE_SIZE(im));
	assert_true(png_image_finish_read(&im, NULL, r.p, 0, NULL));
	r.w = im.width;
	r.h = im.height;
	return r;
}

/* A rectangle of triangles covers every pixel; a plane has one shade, that of the formula. */
static void test_cover(void **state)
{
	static const uint32_t width[] = {1, 7, 48, 333, 800};
	struct meshes_spec spec = written_grid;

	spec.scale_z = "0.01";
	spec.slope_x = 100; /* rises to the east by 45 degrees: away from the light in the north-west */
	spec.slope_y = 0;
	for (unsigned i = 0; i < 5; i++) {
		const struct format_options opt = {.width = width[i]};
		struct meshes m;
		struct err err = ERR_INIT;
		struct image im;
		int want = (int)lrint(255 * (0.5 + M_SQRT1_2) / sqrt(2));

		meshes_make(&m, &spec);
		assert_int_equal(written_as("png", &m, &opt, NULL, NULL, &err), 0);
		im = read_png();
		assert_int_equal(im.w, width[i]);
		assert_int_equal(im.h, width[i] < 2 ? 1 : (uint32_t)(3200.0 / 4900 * width[i] + 0.5));
		for (uint32_t k = 0; k < im.w * im.h; k++) {
			assert_int_equal(im.p[4 * k + 3], 255);
			if (width[i] > 1)
				assert_in_range(im.p[4 * k], (unsigned)want - 1, (unsigned)want + 1);
		}
		free(im.p);
		meshes_done(&m);
	}
}

/* Slopes towards and away from the light; level ground. */
static void test_light(void **state)
{
	static const struct {
		int sx, sy, low, high;
	} row[] = {
		{0, 0, 180, 181},
		{100, -100, 245, 255},
		{-100, 100, 0, 2},
		{100, 100, 100, 110},
	};

	for (unsigned i = 0; i < 4; i++) {
		struct meshes_spec spec = written_grid;
		const struct format_options opt = {.width = 100};
		struct meshes m;
		struct err err = ERR_INIT;
		struct image im;

		spec.scale_z = "0.01";
		spec.slope_x = row[i].sx;
		spec.slope_y = row[i].sy;
		meshes_make(&m, &spec);
		assert_int_equal(written_as("png", &m, &opt, NULL, NULL, &err), 0);
		im = read_png();
		assert_in_range(im.p[4 * (im.w * (im.h / 2) + im.w / 2)], row[i].low, row[i].high);
		free(im.p);
		meshes_done(&m);
	}
}

/* Outside the mesh it is transparent, inside there is no hole: a disc of random triangles round a centre. */
static void test_fan(void **state)
{
	enum { N = 997 };
	static int32_t v[N + 1][3];
	static uint32_t t[N][3];
	static uint8_t final[N / 8 + 1];
	struct acut_mesh_block b = {.nnew = N + 1,
				    .ntriangle = N,
				    .vertex = (const int32_t(*)[3])v,
				    .triangle = (const uint32_t(*)[3])t,
				    .final = final};
	const struct format_options opt = {.width = 500};
	struct meshes_spec spec = {.scale_xy = "0.01", .scale_z = "1"};
	struct meshes m;
	struct err err = ERR_INIT;
	struct image im;
	const int32_t box[6] = {-1000, -1000, 0, 1000, 1000, 0};

	v[0][0] = v[0][1] = 3;
	for (int i = 0; i < N; i++) {
		v[i + 1][0] = (int32_t)lrint(1000 * cos(2 * M_PI * i / N));
		v[i + 1][1] = (int32_t)lrint(1000 * sin(2 * M_PI * i / N));
		memcpy(t[i], (uint32_t[3]){0, (uint32_t)i + 1, (uint32_t)(i + 1) % N + 1}, 12);
	}
	meshes_make(&m, &spec);
	m.block = &b;
	m.nblock = 1;
	memcpy(m.head.box, box, sizeof(box));
	assert_int_equal(written_as("png", &m, &opt, NULL, NULL, &err), 0);
	im = read_png();
	assert_int_equal(im.w, 500);
	for (uint32_t y = 0; y < im.h; y++) {
		for (uint32_t x = 0; x < im.w; x++) {
			double r = hypot(x + 0.5 - 250, y + 0.5 - 250);
			if (r < 249)
				assert_int_equal(im.p[4 * (y * im.w + x) + 3], 255);
			if (r > 251)
				assert_int_equal(im.p[4 * (y * im.w + x) + 3], 0);
		}
	}
	free(im.p);
	/* a box that is too wide costs its margins only */
	m.head.box[3] = 3000;
	assert_int_equal(written_as("png", &m, &opt, NULL, NULL, &err), 0);
	im = read_png();
	assert_in_range(im.w, 249, 251);
	assert_in_range(im.h, 249, 251);
	free(im.p);
}

/* Each region has its colour; north is up. */
static void test_domains(void **state)
{
	struct meshes_spec spec = written_grid;
	struct format_options opt = {.width = 100, .color = FORMAT_DOMAIN};
	struct meshes m;
	struct err err = ERR_INIT;
	struct image im;
	unsigned colours = 0;

	spec.slope_x = spec.slope_y = 0;
	meshes_make(&m, &spec);
	assert_int_equal(written_as("png", &m, &opt, NULL, NULL, &err), 0);
	im = read_png();
	for (uint32_t y = 1; y < im.h; y++)
		colours += memcmp(im.p + 4 * im.w * y, im.p + 4 * im.w * (y - 1), 3) != 0;
	assert_int_equal(colours + 1, m.nblock);
	free(im.p);
	meshes_done(&m);
	spec.slope_y = 50; /* higher to the north: white above, green below */
	opt.color = FORMAT_ELEVATION;
	meshes_make(&m, &spec);
	assert_int_equal(written_as("png", &m, &opt, NULL, NULL, &err), 0);
	im = read_png();
	assert_true(im.p[0] > im.p[4 * im.w * (im.h - 1)] + 60);
	free(im.p);
	meshes_done(&m);
}

/* A side that is a piece of a line is drawn over everything, and only if that is asked for. */
static void test_lines(void **state)
{
	static const int32_t v[4][3] = {{0, 0, 5}, {100, 0, 5}, {100, 100, 5}, {0, 100, 5}};
	static const uint32_t t[2][3] = {{0, 1, 2}, {0, 2, 3}};
	static const uint8_t final[1] = {15}, flags[2] = {1 << 1, 1 << 2};
	struct acut_mesh_block b = {.nnew = 4, .ntriangle = 2, .vertex = v, .triangle = t, .final = final, .flags = flags};
	struct meshes_spec spec = {.scale_xy = "0.01", .scale_z = "1"};

	(void)state;
	for (unsigned lines = 0; lines < 2; lines++) {
		const struct format_options opt = {.width = 100, .lines = lines};
		struct meshes m;
		struct err err = ERR_INIT;
		struct image im;

		meshes_make(&m, &spec);
		m.block = &b;
		m.nblock = 1;
		m.head.lines = true;
		memcpy(m.head.box, (const int32_t[6]){0, 0, 5, 100, 100, 5}, sizeof m.head.box);
		assert_int_equal(written_as("png", &m, &opt, NULL, NULL, &err), 0);
		im = read_png();
		assert_int_equal(im.w * im.h, 10000);
		for (uint32_t y = 0; y < 100; y++)
			for (uint32_t x = 0; x < 100; x++) {
				const uint8_t *p = im.p + 4 * (y * 100 + x);

				/* from the lower left to the upper right corner; row 0 is the north */
				assert_int_equal(p[0] != p[1], lines && x == 99 - y);
			}
		free(im.p);
	}
}

/* The slope of a picture is that of earlier versions to the last bit: a height is divided, which a product with the reciprocal is
 * not. */
static void test_steep(void **state)
{
	const double height = 0.01, inverse = 1 / 111320.0;

	assert_true(height / 111320 != height * inverse);
	assert_true(format_dem_steep(&(struct acut_mesh_head){.unit_xy = "degree", .unit_z = ""}, height) == height / 111320);
	assert_true(format_dem_steep(&(struct acut_mesh_head){.unit_xy = "metre", .unit_z = "foot"}, height) == height * 0.3048);
	assert_true(format_dem_steep(&(struct acut_mesh_head){.unit_xy = "metre", .unit_z = ""}, height) == height);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_cover),   cmocka_unit_test(test_light), cmocka_unit_test(test_fan),
		cmocka_unit_test(test_domains), cmocka_unit_test(test_lines), cmocka_unit_test(test_steep),
	};

	return written_run(tests, sizeof tests / sizeof *tests);
}
