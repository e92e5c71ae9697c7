/* GLB, read back by json-c: chunks, bounds, floats in the order of east, height, south, indices; and what is refused. */
#include <json-c/json.h>
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

struct glb {
	struct json_object *json;
	const char *bin; /* NULL: there is none */
	uint32_t size;   /* of it */
	char *text;
};

static uint32_t u32_at(const char *at)
{
	uint32_t v;

	memcpy(&v, at, 4);
	return v;
}

static struct glb parse(char *text, size_t size)
{
	struct glb g = {.text = text};
	uint32_t json = u32_at(text + 12);
	char *copy;

	assert_memory_equal(text, "glTF", 4);
	assert_int_equal(u32_at(text + 4), 2);
	assert_int_equal(u32_at(text + 8), size);
	assert_int_equal(json % 4, 0);
	assert_memory_equal(text + 16, "JSON", 4);
	copy = strndup(text + 20, json);
	assert_int_equal(strlen(copy), json); /* no zero in it */
	g.json = json_tokener_parse(copy);
	free(copy);
	assert_non_null(g.json);
	if (size > 20 + json) {
		g.size = u32_at(text + 20 + json);
		assert_memory_equal(text + 24 + json, "BIN", 4);
		g.bin = text + 28 + json;
		assert_int_equal(28 + json + g.size, size);
	}
	return g;
}

static void done(struct glb *g)
{
	json_object_put(g->json);
	free(g->text);
}

/* "accessors/0/count"; NULL: there is none. */
static struct json_object *get(const struct glb *g, const char *path)
{
	char text[100], *rest, *word;
	struct json_object *at = g->json;

	snprintf(text, sizeof(text), "%s", path);
	for (word = strtok_r(text, "/", &rest); word && at; word = strtok_r(NULL, "/", &rest)) {
		if (json_object_is_type(at, json_type_array))
			at = json_object_array_get_idx(at, (size_t)atoi(word));
		else if (!json_object_object_get_ex(at, word, &at))
			at = NULL;
	}
	return at;
}

static int64_t number(const struct glb *g, const char *path)
{
	struct json_object *o = get(g, path);

	assert_non_null(o);
	return json_object_get_int64(o);
}

/* Positions are those of the lattice less `origin`, in steps, as floats. */
static void expect_positions(const struct glb *g, const struct readback_mesh *f, const int32_t origin[3])
{
	float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
	static const int axis[3] = {0, 2, 1};

	assert_int_equal(number(g, "accessors/0/count"), f->nvertex);
	assert_int_equal(number(g, "accessors/0/componentType"), 5126);
	assert_string_equal(json_object_get_string(get(g, "accessors/0/type")), "VEC3");
	assert_int_equal(number(g, "bufferViews/0/byteLength"), 12 * f->nvertex);
	for (uint64_t i = 0; i < f->nvertex; i++) {
		float p[3];

		memcpy(p, g->bin + 12 * i, 12);
		for (int j = 0; j < 3; j++) {
			double want = (f->vertex[i][axis[j]] - origin[axis[j]]) / (j == 1 ? 1000.0 : 100.0);

			assert_true(p[j] == (float)(j == 2 ? -want : want));
			low[j] = fminf(low[j], p[j]);
			high[j] = fmaxf(high[j], p[j]);
		}
	}
	for (int j = 0; j < 3; j++) {
		char path[40];

		snprintf(path, sizeof(path), "accessors/0/min/%d", j);
		assert_true((float)json_object_get_double(get(g, path)) == low[j]);
		snprintf(path, sizeof(path), "accessors/0/max/%d", j);
		assert_true((float)json_object_get_double(get(g, path)) == high[j]);
	}
}

static void expect_indices(const struct glb *g, const struct readback_mesh *f)
{
	int64_t at = number(g, "bufferViews/1/byteOffset");

	assert_int_equal(at % 4, 0);
	assert_true((uint64_t)at >= 12 * f->nvertex);
	assert_int_equal(number(g, "bufferViews/1/byteLength"), 12 * f->ntriangle);
	assert_int_equal(number(g, "buffers/0/byteLength"), at + 12 * (int64_t)f->ntriangle);
	assert_int_equal(number(g, "buffers/0/byteLength"), g->size);
	assert_int_equal(number(g, "accessors/1/count"), 3 * f->ntriangle);
	assert_int_equal(number(g, "accessors/1/componentType"), 5125);
	assert_int_equal(number(g, "meshes/0/primitives/0/indices"), 1);
	for (uint64_t i = 0; i < 3 * f->ntriangle; i++)
		assert_int_equal(u32_at(g->bin + at + 4 * (int64_t)i), f->triangle[i / 3][i % 3]);
}

static void expect_written(const struct meshes_spec *spec)
{
	const int32_t origin[3] = {spec->x0 + spec->step * (int32_t)(spec->columns - 1) / 2,
				   spec->y0 + spec->step * (int32_t)(spec->rows - 1) / 2, 0};
	struct meshes m;
	struct readback_mesh f;
	size_t size;
	struct glb g;

	meshes_make(&m, spec);
	f = readback_flat(&m);
	g.text = readback_text("glb", "m.glb", &m, &automatic, &size);
	g = parse(g.text, size);
	expect_positions(&g, &f, origin);
	expect_indices(&g, &f);
	assert_true(json_object_get_boolean(get(&g, "materials/0/doubleSided")));
	readback_same_piped("glb", &m, &automatic, g.text, size);
	done(&g);
	readback_flat_done(&f);
	meshes_done(&m);
}

static void test_mesh(void **state)
{
	expect_written(&readback_small);
	expect_written(&readback_large);
}

static void test_extras(void **state)
{
	struct format_options opt = {.has_origin = true};
	struct meshes m;
	size_t size;
	struct glb g;
	float x;

	decimal_parse("500000.005", &opt.origin[0]);
	decimal_parse("4000000", &opt.origin[1]);
	meshes_make(&m, &readback_small);
	m.head.crs = "a \"b\" \\ \xc3\xa4 \xff\n";
	g.text = readback_text("glb", "m.glb", &m, &opt, &size);
	g = parse(g.text, size);
	assert_string_equal(json_object_get_string(get(&g, "asset/version")), "2.0");
	assert_string_equal(json_object_get_string(get(&g, "asset/extras/acut-origin")), "500000.005 4000000 0");
	assert_string_equal(json_object_get_string(get(&g, "asset/extras/acut-crs")), "a \"b\" \\ \xc3\xa4 ? ");
	assert_string_equal(json_object_get_string(get(&g, "asset/extras/acut-units")), "metre metre");
	assert_string_equal(json_object_get_string(get(&g, "asset/extras/acut-digest")),
			    "0123456789abcdef0123456789abcdef fedcba9876543210fedcba9876543210");
	memcpy(&x, g.bin, 4);
	assert_true(x == -70.005f);
	/* zero is not within these */
	assert_true((float)json_object_get_double(get(&g, "accessors/0/max/0")) == -21.005f);
	assert_true((float)json_object_get_double(get(&g, "accessors/0/min/0")) == -70.005f);
	done(&g);
	meshes_done(&m);
}

/* glTF has no empty arrays: points where there is no triangle, and nothing at all without vertices. */
static void test_empty(void **state)
{
	struct meshes_spec spec = readback_small;
	struct meshes m;
	struct readback_mesh f;
	size_t size;
	struct glb g;

	spec.columns = 1;
	meshes_make(&m, &spec);
	f = readback_flat(&m);
	g.text = readback_text("glb", "m.glb", &m, &automatic, &size);
	g = parse(g.text, size);
	expect_positions(&g, &f, (int32_t[]){-7000, 123 + 1600, 0});
	assert_int_equal(number(&g, "meshes/0/primitives/0/mode"), 0);
	assert_null(get(&g, "meshes/0/primitives/0/indices"));
	assert_null(get(&g, "accessors/1"));
	assert_int_equal(number(&g, "buffers/0/byteLength"), g.size);
	done(&g);
	readback_flat_done(&f);
	meshes_done(&m);
	spec.columns = 0;
	meshes_make(&m, &spec);
	for (int piped = 0; piped < 2; piped++) {
		g.text = piped ? readback_piped("glb", &m, &automatic, &size) :
				 readback_text("glb", "m.glb", &m, &automatic, &size);
		g = parse(g.text, size);
		assert_null(g.bin);
		assert_null(get(&g, "meshes"));
		assert_null(get(&g, "buffers"));
		assert_non_null(get(&g, "scenes/0"));
		done(&g);
	}
	meshes_done(&m);
}

/* A step of the lattice must not be lost. */
static void test_floats(void **state)
{
	static const struct {
		int64_t k;               /* of x */
		int32_t width, top;      /* in steps */
		int origin;              /* 1: given, 2: auto */
		const char *said, *hint; /* NULL: it is written */
	} row[] = {
		{0, 16777216, 0, 0, NULL, NULL},
		{0, 16777217, 0, 0, "x is up to 167772.17: off by", "--origin auto"},
		{-16777217, 100, 0, 0, "x is up to 167772.17: off by", "--origin auto"},
		{50000000, 1000, 0, 0, "x is up to 500010: off by", "--origin auto"},
		{50000000, 1000, 0, 1, NULL, NULL},
		{80000000, 1000, 0, 1, "from the origin: off by", "--origin auto"},
		{50000000, 1000, 0, 2, NULL, NULL},
		{50000000, 33554432, 0, 2, NULL, NULL},
		{50000000, 33554436, 0, 2, "from the origin: off by", "--crop"},
		{0, 1000, 16777216, 0, NULL, NULL},
		{0, 1000, 16777217, 0, "z is up to 16777.217: off by", "--origin X,Y,Z"},
	};

	for (unsigned i = 0; i < 2 * sizeof(row) / sizeof(*row); i++) {
		const char *const name = i % 2 ? "stl" : "glb";
		struct format_options opt = {.has_origin = row[i / 2].origin == 1, .origin_auto = row[i / 2].origin == 2};
		struct meshes_spec spec = {
			.columns = 2, .rows = 2, .strip = 1, .step = 1, .scale_xy = "0.01", .scale_z = "0.001"};
		struct meshes m;
		struct err err;

		decimal_parse("500000", &opt.origin[0]);
		spec.k[0] = row[i / 2].k;
		meshes_make(&m, &spec);
		m.head.box[3] = row[i / 2].width;
		((int32_t(*)[3])(uintptr_t)m.block[0].vertex)[3][2] = row[i / 2].top;
		assert_int_equal(readback_write(name, "m", &m, &opt, &err), row[i / 2].said ? -ERR_USAGE : 0);
		if (row[i / 2].said) {
			assert_non_null(strstr(err.message, row[i / 2].said));
			assert_non_null(strstr(err.message, i % 2 ? "STL has 32-bit floats" : "GLB has 32-bit floats"));
			assert_non_null(strstr(err.hint, row[i / 2].hint));
		}
		meshes_done(&m);
	}
}

/* The box of a mesh is not that of its window, or of what is left of it: what is written counts. */
static void test_floats_of_part(void **state)
{
	static const struct {
		const char *view;
		bool trims;
		int32_t x, z; /* of one vertex, in steps */
		bool automatic;
		const char *said, *hint; /* NULL: it is written */
	} row[] = {
		{"crop=off", false, 1, 1, false, "x is up to 335544.36", "--origin auto"},
		{"crop=off window=box:0,0,1,1", false, 1, 1, false, NULL, NULL},
		{"crop=off", true, 1, 1, false, NULL, NULL},
		{"crop=off", true, 16777216, 1, false, NULL, NULL},
		{"crop=off", true, 16777217, 1, false, "x is up to 167772.17: off by", "--origin auto"},
		{"crop=off window=box:0,0,1,1", false, -16777217, 1, false, "x is up to 167772.17: off by", "--origin auto"},
		{"crop=off", true, 1, 16777217, false, "z is up to 16777.217: off by", "--origin X,Y,Z"},
		{"crop=off", true, -1, 1, true, "from the origin: off by", "near what is written"},
	};

	for (unsigned i = 0; i < 2 * sizeof(row) / sizeof(*row); i++) {
		const struct format_options opt = {.origin_auto = row[i / 2].automatic};
		const struct outputs_options trims = {.max_edge = {.given = row[i / 2].trims, .value = {1, 9}}};
		struct meshes_spec spec = {
			.columns = 2, .rows = 2, .strip = 1, .step = 1, .scale_xy = "0.01", .scale_z = "0.001"};
		struct meshes m;
		struct err err;
		int32_t *v;

		meshes_make(&m, &spec);
		m.head.view = row[i / 2].view;
		m.head.box[3] = 33554436;
		v = ((int32_t(*)[3])(uintptr_t)m.block[0].vertex)[3];
		v[0] = row[i / 2].x;
		v[2] = row[i / 2].z;
		assert_int_equal(readback_write_with(i % 2 ? "stl" : "glb", "m", &m, &opt, &trims, &err),
				 row[i / 2].said ? -ERR_USAGE : 0);
		if (row[i / 2].said) {
			assert_non_null(strstr(err.message, row[i / 2].said));
			assert_non_null(strstr(err.hint, row[i / 2].hint));
		}
		meshes_done(&m);
	}
}

/* Sizes have 32 bits: 12 bytes a vertex and a triangle, and what is around them. */
static void test_limit(void **state)
{
	static const struct {
		uint64_t nvertex, nface;
		bool fits;
	} row[] = {
		{100000000, 257000000, true}, {100000000, 258000000, false}, {357913000, 0, false},
		{UINT32_MAX, 0, false},       {0, 1ull << 60, false},
	};

	for (unsigned i = 0; i < sizeof(row) / sizeof(*row); i++) {
		uint8_t saved[FORMAT_SAVED] = {0};
		struct packer to = packer_of(saved, sizeof(saved));
		struct meshes m;
		struct err err;

		packer_u64(&to, row[i].nvertex);
		packer_u64(&to, row[i].nface);
		packer_u64(&to, 1000);
		meshes_make(&m, &readback_small);
		assert_int_equal(readback_late("glb", saved, &m, &automatic, &err), row[i].fits ? 0 : -ERR_LIMIT);
		if (!row[i].fits)
			assert_non_null(strstr(err.message, "a GLB file cannot be larger than 4 GiB"));
		meshes_done(&m);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_mesh),   cmocka_unit_test(test_extras),         cmocka_unit_test(test_empty),
		cmocka_unit_test(test_floats), cmocka_unit_test(test_floats_of_part), cmocka_unit_test(test_limit),
	};

	return cmocka_run_group_tests(tests, readback_begin, readback_end);
}
