/* DXF, read back pair by pair (a code, a value): single faces, polyface meshes, extents, comments. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "cursor.h"
#include "readback.h"

struct pair {
	int code;
	char value[128];
};

/* The next pair; code -1: the end. */
static struct pair next(const char **at)
{
	struct pair p = {.code = -1};
	char *end;

	if (!**at)
		return p;
	p.code = (int)strtol(*at, &end, 10);
	assert_int_equal(*end, '\n');
	*at = end + 1;
	end = strchr(*at, '\n');
	assert_non_null(end);
	snprintf(p.value, sizeof(p.value), "%.*s", (int)(end - *at), *at);
	*at = end + 1;
	return p;
}

static void expect_pair(const char **at, int code, const char *value)
{
	struct pair p = next(at);

	assert_int_equal(p.code, code);
	assert_string_equal(p.value, value);
}

/* Up to and with this pair. */
static void skip_to(const char **at, int code, const char *value)
{
	struct pair p;

	do {
		p = next(at);
		assert_true(p.code >= 0);
	} while (p.code != code || strcmp(p.value, value));
}

static void expect_point(const char **at, int corner, const int32_t v[3], const int64_t k[3])
{
	for (int j = 0; j < 3; j++) {
		struct pair p = next(at);
		const char *number = p.value;

		assert_int_equal(p.code, 10 * (j + 1) + corner);
		assert_int_equal(readback_number(&number, j < 2 ? 2 : 3), v[j] + k[j]);
		assert_int_equal(*number, 0);
	}
}

static const char *expect_begin(const char *text)
{
	const char *at = text;

	expect_pair(&at, 999, "acut-lattice 0.01 0.001 50000000 400000000 -12");
	expect_pair(&at, 999, "acut-crs EPSG:26910 second line");
	skip_to(&at, 2, "HEADER");
	expect_pair(&at, 9, "$ACADVER");
	expect_pair(&at, 1, "AC1009");
	skip_to(&at, 2, "TABLES");
	skip_to(&at, 0, "LAYER");
	skip_to(&at, 2, "TIN");
	skip_to(&at, 0, "ENDSEC");
	expect_pair(&at, 0, "SECTION");
	expect_pair(&at, 2, "ENTITIES");
	return at;
}

static void expect_end(const char *at)
{
	expect_pair(&at, 0, "ENDSEC");
	expect_pair(&at, 999, "acut-digest 0123456789abcdef0123456789abcdef fedcba9876543210fedcba9876543210");
	expect_pair(&at, 0, "EOF");
	assert_int_equal(*at, 0);
}

static void expect_extents(const char *text, const int32_t low[3], const int32_t high[3], const int64_t k[3])
{
	const char *at = text;

	for (int i = 0; i < 2; i++) {
		skip_to(&at, 9, i ? "$EXTMAX" : "$EXTMIN");
		for (int j = 0; j < 3; j++) {
			struct pair p = next(&at);

			assert_int_equal(p.code, 10 * (j + 1));
			assert_true(strtod(p.value, NULL) == (double)((i ? high : low)[j] + k[j]) / (j < 2 ? 100.0 : 1000.0));
		}
	}
}

static void expect_faces(const char *text, const struct readback_mesh *f, const int64_t k[3])
{
	const char *at = expect_begin(text);

	for (uint64_t i = 0; i < f->ntriangle; i++) {
		expect_pair(&at, 0, "3DFACE");
		expect_pair(&at, 8, "TIN");
		for (int j = 0; j < 4; j++)
			expect_point(&at, j, f->vertex[f->triangle[i][j < 3 ? j : 2]], k);
	}
	expect_end(at);
}

static void expect_written(const struct meshes_spec *spec)
{
	const int32_t low[3] = {spec->x0, spec->y0, spec->slope_y * (int32_t)(spec->rows - 1)};
	const int32_t high[3] = {spec->x0 + spec->step * (int32_t)(spec->columns - 1),
				 spec->y0 + spec->step * (int32_t)(spec->rows - 1), spec->slope_x * (int32_t)(spec->columns - 1)};
	const struct format_options opt = {0};
	struct meshes m;
	struct readback_mesh f;
	size_t size;
	char *text;

	meshes_make(&m, spec);
	f = readback_flat(&m);
	text = readback_text("dxf", "m.dxf", &m, &opt, &size);
	expect_faces(text, &f, spec->k);
	expect_extents(text, low, high, spec->k);
	free(text);
	text = readback_piped("dxf", &m, &opt, &size);
	expect_faces(text, &f, spec->k);
	assert_null(strstr(text, "$EXT"));
	free(text);
	readback_flat_done(&f);
	meshes_done(&m);
}

static void test_faces(void **state)
{
	expect_written(&readback_small);
	expect_written(&readback_large);
}

/* Extents are of the corners, whatever the head says; they may be longer than its texts by a sign. */
static void test_extents(void **state)
{
	static const int32_t v[][3] = {{-1, 0, 0}, {3, 0, -5}, {0, 4, 2}, {900000, 900000, 900000}};
	static const uint32_t t[][3] = {{0, 1, 2}};
	static const uint8_t final[] = {15};
	struct acut_mesh_block b = {.nnew = 4, .ntriangle = 1, .vertex = v, .triangle = t, .final = final};
	const struct format_options opt = {0};
	struct meshes m;
	size_t size;
	char *text;

	meshes_make(&m, &(struct meshes_spec){.scale_xy = "0.01", .scale_z = "1"});
	memcpy(m.head.box, (int32_t[]){-99, 0, -9, 99, 4, 9}, sizeof(m.head.box));
	m.block = &b;
	m.nblock = 1;
	text = readback_text("dxf", "m.dxf", &m, &opt, &size);
	assert_non_null(strstr(
		text, "9\n$EXTMIN\n10\n-0.0100000000\n20\n0.00000000000\n30\n-5.00000000000\n9\n$EXTMAX\n10\n0.03000000000\n20\n"
		      "0.04000000000\n30\n2.000000000000\n0\n"));
	free(text);
}

/* Texts inside of a mesh may be longer than those of the ends of its box: trailing zeros are dropped. */
static void test_extents_of_long_scales(void **state)
{
	static const int32_t v[][3] = {{-1, 0, 0}, {3, 0, -5}, {0, 7, 2}};
	static const uint32_t t[][3] = {{0, 1, 2}};
	static const uint8_t final[] = {7};
	struct acut_mesh_block b = {.nnew = 3, .ntriangle = 1, .vertex = v, .triangle = t, .final = final};
	const struct format_options opt = {0};
	struct meshes m;
	size_t size;
	char *text, *other;

	meshes_make(&m, &(struct meshes_spec){.scale_xy = "0.3048006096012192", .scale_z = "0.3048006096012192"});
	memcpy(m.head.box, (int32_t[]){-100000000, 0, -1000000, 100000000, 100000000, 1000000}, sizeof(m.head.box));
	m.block = &b;
	m.nblock = 1;
	text = readback_text("dxf", "m.dxf", &m, &opt, &size);
	assert_non_null(strstr(text, "9\n$EXTMIN\n10\n-0.3048006096012192"));
	assert_non_null(strstr(text, "\n9\n$EXTMAX\n10\n0.9144018288036576"));
	assert_non_null(strstr(text, "0\n0\nENDSEC\n0\nSECTION\n2\nTABLES\n"));
	/* They depend on the triangles alone, not on the box of the whole mesh. */
	memcpy(m.head.box, (int32_t[]){-1, 0, -5, 3, 7, 2}, sizeof(m.head.box));
	other = readback_text("dxf", "m.dxf", &m, &opt, &size);
	assert_string_equal(text, other);
	free(other);
	free(text);
	b.ntriangle = 0;
	text = readback_text("dxf", "m.dxf", &m, &opt, &size);
	assert_non_null(strstr(text, "9\n$EXTMIN\n10\n0.000000"));
	free(text);
}

/* Reads the meshes; their faces must be the triangles in order. How many meshes there are. */
static unsigned expect_polyfaces(const char *text, const struct readback_mesh *f, const int64_t k[3])
{
	const char *at = expect_begin(text), *before = at;
	unsigned count = 0;
	uint64_t i = 0;

	for (struct pair p = next(&at); strcmp(p.value, "ENDSEC"); before = at, p = next(&at), count++) {
		int nvertex, nface;
		const char **vertex;

		assert_string_equal(p.value, "POLYLINE");
		expect_pair(&at, 8, "TIN");
		expect_pair(&at, 66, "1");
		skip_to(&at, 70, "64");
		p = next(&at);
		assert_int_equal(p.code, 71);
		nvertex = atoi(p.value);
		p = next(&at);
		assert_int_equal(p.code, 72);
		nface = atoi(p.value);
		assert_in_range(nvertex, 3, 32767);
		assert_in_range(nface, 1, 32767);
		vertex = calloc((size_t)nvertex + 1, sizeof(*vertex));
		for (int j = 1; j <= nvertex; j++) {
			expect_pair(&at, 0, "VERTEX");
			expect_pair(&at, 8, "TIN");
			vertex[j] = at;
			skip_to(&at, 70, "192");
		}
		for (int j = 0; j < nface; j++, i++) {
			expect_pair(&at, 0, "VERTEX");
			skip_to(&at, 70, "128");
			for (int c = 0; c < 3; c++) {
				const char *point;

				p = next(&at);
				assert_int_equal(p.code, 71 + c);
				assert_in_range(atoi(p.value), 1, nvertex);
				point = vertex[atoi(p.value)];
				expect_point(&point, 0, f->vertex[f->triangle[i][c]], k);
			}
		}
		free(vertex);
		expect_pair(&at, 0, "SEQEND");
		expect_pair(&at, 8, "TIN");
	}
	assert_int_equal(i, f->ntriangle);
	expect_end(before);
	return count;
}

static void test_polyface(void **state)
{
	static const struct {
		const struct meshes_spec *spec;
		unsigned meshes; /* a block, or 32,767 faces */
		bool canonical;
	} row[] = {{&readback_small, 7, false}, {&readback_large, 6, false}, {&readback_large, 0, true}};

	for (unsigned i = 0; i < 3; i++) {
		const struct format_options opt = {.polyface = true, .canonical = row[i].canonical};
		struct meshes m;
		struct readback_mesh f;
		size_t size, vertices = 0;
		char *text;

		meshes_make(&m, row[i].spec);
		f = readback_flat(&m);
		text = readback_text("dxf", "m.dxf", &m, &opt, &size);
		assert_non_null(strstr(text, "\n999\nacut-polyface a mesh ends with a block of the stream, or at 32767"));
		if (!row[i].canonical)
			assert_int_equal(expect_polyfaces(text, &f, row[i].spec->k), row[i].meshes);
		/* vertices are shared within a mesh */
		for (const char *at = text; (at = memmem(at, size - (size_t)(at - text), "\n70\n192\n", 8)); at++)
			vertices++;
		assert_in_range(vertices, f.nvertex, f.nvertex * 5 / 4);
		free(text);
		readback_flat_done(&f);
		meshes_done(&m);
	}
}

/* Triangles that share nothing: here the number of vertices is what ends a mesh. Numbers of vertices may be any. */
static void test_polyface_vertices(void **state)
{
	enum { N = 25000 };
	static int32_t v[3 * N][3];
	static uint32_t t[N][3];
	static uint8_t final[3 * N / 8 + 1];
	struct acut_mesh_block b = {.nnew = 3 * N,
				    .ntriangle = N,
				    .vertex = (const int32_t(*)[3])v,
				    .triangle = (const uint32_t(*)[3])t,
				    .final = final};
	const struct format_options opt = {.polyface = true};
	struct meshes_spec spec = readback_small;
	struct readback_mesh f = {.vertex = v, .nvertex = 3 * N, .triangle = calloc(N, sizeof(*f.triangle)), .ntriangle = N};
	struct meshes m;
	size_t size;
	char *text;

	spec.columns = 0;
	meshes_make(&m, &spec);
	m.block = &b;
	m.nblock = 1;
	for (uint32_t i = 0; i < 3 * N; i++) {
		memcpy(v[i], (int32_t[]){(int32_t)i, (int32_t)(i % 3), -(int32_t)i}, sizeof(v[i]));
		t[i / 3][i % 3] = i;
		f.triangle[i / 3][i % 3] = i;
	}
	for (int i = 0; i < 2; i++) {
		b.first = i ? 1ull << 40 : 0;
		text = readback_text("dxf", "m.dxf", &m, &opt, &size);
		assert_int_equal(expect_polyfaces(text, &f, spec.k), 3); /* 10,922 triangles each */
		free(text);
	}
	free(f.triangle);
}

/* A part that was written the other way is not continued. */
static void test_polyface_resumed(void **state)
{
	const struct format_options opt = {.polyface = true}, plain = {0};

	for (uint64_t i = 0; i < 2; i++) {
		uint8_t saved[FORMAT_SAVED] = {0};
		struct packer to = packer_of(saved, sizeof(saved));
		struct meshes m;
		struct err err;

		packer_u64(&to, 100); /* where the extents are */
		packer_u64(&to, i);
		meshes_make(&m, &readback_small);
		assert_int_equal(readback_late("dxf", saved, &m, i ? &opt : &plain, &err), 0);
		assert_int_equal(readback_late("dxf", saved, &m, i ? &plain : &opt, &err), -ERR_USAGE);
		assert_non_null(strstr(err.message, i ? "with --polyface" : "without --polyface"));
		meshes_done(&m);
	}
}

static void test_text(void **state)
{
	struct format_options opt = {.has_origin = true};
	struct meshes m;
	size_t size;
	char *text;

	decimal_parse("500000.005", &opt.origin[0]);
	meshes_make(&m, &readback_small);
	m.head.crs = "M\xc3\xbcnchen\n0\nEOF";
	text = readback_text("dxf", "m.dxf", &m, &opt, &size);
	assert_non_null(
		strstr(text, "\n999\nacut-crs M?nchen 0 EOF\n999\nacut-units metre metre\n999\nacut-origin 500000.005 0 0\n"));
	assert_non_null(strstr(text, "\n3DFACE\n8\nTIN\n10\n-70.005\n20\n4000001.23\n30\n-0.012\n11\n"));
	for (size_t i = 0; i < size; i++)
		assert_true((text[i] >= ' ' && text[i] < 0x7f) || text[i] == '\n');
	free(text);
	meshes_done(&m);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_faces),
		cmocka_unit_test(test_extents),
		cmocka_unit_test(test_extents_of_long_scales),
		cmocka_unit_test(test_text),
		cmocka_unit_test(test_polyface),
		cmocka_unit_test(test_polyface_vertices),
		cmocka_unit_test(test_polyface_resumed),
	};

	return cmocka_run_group_tests(tests, readback_begin, readback_end);
}
