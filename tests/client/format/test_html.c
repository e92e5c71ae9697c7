/* The page, read back without a browser: every vertex and triangle of its lines, its facts, and what is refused. */
#include <json-c/json.h>
#include <libdeflate.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "cursor.h"
#include "page.h"
#include "readback.h"
#include "repeat.h"

static const struct format_options plain = {0};

/* The text of the element with this id. */
static char *element(const char *page, const char *id)
{
	char mark[40];
	const char *at;

	snprintf(mark, sizeof(mark), "id=\"%s\">", id);
	at = strstr(page, mark);
	assert_non_null(at);
	at += strlen(mark);
	assert_null(strstr(at, mark));
	return strndup(at, (size_t)(strstr(at, "</") - at));
}

static int digit(char c)
{
	static const char all[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
	const char *at = strchr(all, c);

	assert_true(c && at);
	return (int)(at - all);
}

/* A line of base64, inflated; the number of bytes. */
static size_t inflate(const char *line, size_t n, uint8_t **ret)
{
	struct libdeflate_decompressor *d = libdeflate_alloc_decompressor();
	size_t bytes = 0, room = 4 << 20, size;
	uint8_t *packed = malloc(n);
	uint32_t bits = 0;

	assert_int_equal(n % 4, 0);
	*ret = malloc(room);
	while (n && line[n - 1] == '=')
		n--;
	for (size_t i = 0; i < n; i++) {
		bits = bits << 6 | (uint32_t)digit(line[i]);
		if (i % 4)
			packed[bytes++] = (uint8_t)(bits >> (6 - 2 * (i % 4)));
	}
	assert_int_equal(libdeflate_deflate_decompress(d, packed, bytes, *ret, room, &size), LIBDEFLATE_SUCCESS);
	libdeflate_free_decompressor(d);
	free(packed);
	return size;
}

static uint64_t number(const uint8_t **at)
{
	uint64_t n = 0;

	for (int shift = 0;; shift += 7) {
		uint8_t byte = *(*at)++;

		n |= (uint64_t)(byte & 127) << shift;
		if (byte < 128)
			return n;
	}
}

static int64_t difference(const uint8_t **at)
{
	uint64_t n = number(at);

	return n & 1 ? -(int64_t)(n >> 1) - 1 : (int64_t)(n >> 1);
}

/* Calls `each` for the bytes of each line of an element. */
static void each_line(const char *page, const char *id, void (*each)(struct readback_mesh *, const uint8_t **),
		      struct readback_mesh *m)
{
	char *text = element(page, id), *rest, *line;

	for (line = strtok_r(text, " \n", &rest); line; line = strtok_r(NULL, " \n", &rest)) {
		uint8_t *bytes;
		size_t size = inflate(line, strlen(line), &bytes);
		const uint8_t *at = bytes;

		each(m, &at);
		assert_ptr_equal(at, bytes + size);
		free(bytes);
	}
	free(text);
}

static void read_vertices(struct readback_mesh *m, const uint8_t **at)
{
	uint64_t n = number(at);

	m->vertex = realloc(m->vertex, (m->nvertex + n) * sizeof(*m->vertex));
	for (int j = 0; j < 3; j++) {
		int64_t v = 0;

		for (uint64_t i = 0; i < n; i++) {
			v += difference(at);
			assert_true(v == (int32_t)v);
			m->vertex[m->nvertex + i][j] = (int32_t)v;
		}
	}
	m->nvertex += n;
}

static uint64_t domains[64]; /* of the lines of faces */
static size_t lines;

static void read_faces(struct readback_mesh *m, const uint8_t **at)
{
	uint64_t n = number(at), v = 0;

	assert_true(lines < 64);
	domains[lines++] = number(at);
	m->triangle = realloc(m->triangle, (m->ntriangle + n) * sizeof(*m->triangle));
	for (uint64_t i = 0; i < n; i++)
		m->triangle[m->ntriangle + i][0] = v += number(at);
	for (int j = 1; j < 3; j++)
		for (uint64_t i = 0; i < n; i++)
			m->triangle[m->ntriangle + i][j] = m->triangle[m->ntriangle + i][0] - number(at);
	m->ntriangle += n;
}

static int by_numbers(const void *a, const void *b)
{
	return memcmp(a, b, 3 * sizeof(uint64_t));
}

/* In one order, each from its greatest number on. */
static void sort(struct readback_mesh *m)
{
	for (uint64_t i = 0; i < m->ntriangle; i++) {
		uint64_t *t = m->triangle[i], u[3];
		int most = t[1] > t[0] ? 1 : 0;

		most = t[2] > t[most] ? 2 : most;
		for (int j = 0; j < 3; j++)
			u[j] = t[(most + j) % 3];
		memcpy(t, u, sizeof(u));
	}
	if (m->ntriangle)
		qsort(m->triangle, m->ntriangle, sizeof(*m->triangle), by_numbers);
}

static void expect_mesh(const char *page, const struct meshes *m)
{
	struct readback_mesh want = readback_flat(m), got = {NULL, NULL, 0, 0};

	lines = 0;
	each_line(page, "vertices", read_vertices, &got);
	each_line(page, "faces", read_faces, &got);
	assert_int_equal(got.nvertex, want.nvertex);
	assert_int_equal(got.ntriangle, want.ntriangle);
	if (want.nvertex)
		assert_memory_equal(got.vertex, want.vertex, want.nvertex * sizeof(*want.vertex));
	sort(&got);
	sort(&want);
	if (want.ntriangle)
		assert_memory_equal(got.triangle, want.triangle, want.ntriangle * sizeof(*want.triangle));
	readback_flat_done(&got);
	readback_flat_done(&want);
}

static struct json_object *facts(const char *page)
{
	char *text = element(page, "facts");
	struct json_object *o = json_tokener_parse(text);

	assert_non_null(o);
	free(text);
	return o;
}

/* "axes/0/q" */
static const char *fact(struct json_object *at, const char *path)
{
	char text[100], *rest, *word;

	snprintf(text, sizeof(text), "%s", path);
	for (word = strtok_r(text, "/", &rest); word; word = strtok_r(NULL, "/", &rest)) {
		if (json_object_is_type(at, json_type_array))
			at = json_object_array_get_idx(at, (size_t)atoi(word));
		else if (!json_object_object_get_ex(at, word, &at))
			return NULL;
	}
	return json_object_get_string(at);
}

static void test_mesh(void **state)
{
	static const struct meshes_spec *const spec[] = {&readback_small, &readback_large, &meshes_many};

	for (unsigned i = 0; i < 6; i++) {
		struct meshes m;
		size_t size;
		char *page;

		meshes_make(&m, spec[i / 2]);
		page = i % 2 ? readback_piped("html", &m, &plain, &size) : readback_text("html", "m.html", &m, &plain, &size);
		assert_int_equal(strlen(page), size);
		expect_mesh(page, &m);
		assert_int_equal(lines, i / 2 == 1 ? 3 : m.nblock); /* 65,536 triangles in a line at most */
		for (size_t j = 1; j < m.nblock; j++)
			assert_true(domains[j] != domains[j - 1]);
		free(page);
		meshes_done(&m);
	}
}

/* Differences of all of 32 bits. */
static void test_far(void **state)
{
	struct meshes m;
	size_t size;
	char *page;

	meshes_make(&m, &meshes_many);
	for (uint32_t i = 0; i < m.block[1].nnew; i++)
		for (int j = 0; j < 3; j++)
			((int32_t(*)[3])(uintptr_t)m.block[1].vertex)[i][j] = (i + (uint32_t)j) % 2 ? INT32_MAX : INT32_MIN;
	page = readback_text("html", "m.html", &m, &plain, &size);
	expect_mesh(page, &m);
	free(page);
	meshes_done(&m);
}

static void test_empty(void **state)
{
	struct meshes_spec spec = readback_small;

	for (spec.columns = 2; spec.columns--;) {
		struct meshes m;
		struct json_object *o;
		size_t size;
		char *page;

		meshes_make(&m, &spec);
		page = readback_text("html", "m.html", &m, &plain, &size);
		expect_mesh(page, &m);
		o = facts(page);
		assert_string_equal(fact(o, "vertices"), spec.columns ? "33" : "0");
		assert_string_equal(fact(o, "triangles"), "0");
		json_object_put(o);
		free(page);
		meshes_done(&m);
	}
}

/* Coordinates are (number * a + b) / q; comments are those of other formats; no text ends its element. */
static void test_facts(void **state)
{
	struct format_options opt = {.has_origin = true};
	struct meshes m;
	struct json_object *o;
	size_t size;
	char *page;

	decimal_parse("500000.005", &opt.origin[0]);
	meshes_make(&m, &readback_small);
	m.head.view = "view 1 window=box";
	m.head.crs = "</script><!-- \"b\" \\ \xff\n";
	page = readback_text("html", "a <b> & \"c\".html", &m, &opt, &size);
	assert_non_null(strstr(page, "<title>a &lt;b&gt; &amp; &quot;c&quot;</title>"));
	o = facts(page);
	assert_string_equal(fact(o, "format"), "1");
	assert_string_equal(fact(o, "name"), "a <b> & \"c\"");
	assert_string_equal(fact(o, "axes/0/a"), "10");
	assert_string_equal(fact(o, "axes/0/b"), "-5");
	assert_string_equal(fact(o, "axes/0/q"), "1000");
	assert_string_equal(fact(o, "axes/0/decimals"), "3");
	assert_string_equal(fact(o, "axes/1/b"), "400000000");
	assert_string_equal(fact(o, "axes/1/q"), "100");
	assert_string_equal(fact(o, "axes/2/b"), "-12");
	assert_string_equal(fact(o, "vertices"), "1650");
	assert_string_equal(fact(o, "triangles"), "3136");
	assert_string_equal(fact(o, "comments/acut-crs"), "</script><!-- \"b\" \\ ? ");
	assert_string_equal(fact(o, "comments/acut-origin"), "500000.005 0 0");
	assert_string_equal(fact(o, "comments/acut-trimmed"), "window");
	assert_string_equal(fact(o, "comments/acut-digest"), "0123456789abcdef0123456789abcdef fedcba9876543210fedcba9876543210");
	json_object_put(o);
	free(page);
	meshes_done(&m);
}

/* Heights in another unit are fractions; steps above one, and numbers that no double has, are whole numbers all the same. */
static void test_axes(void **state)
{
	struct format_options opt = {.z_unit = "us-survey-foot"};
	struct meshes_spec spec = readback_small;
	struct meshes m;
	struct json_object *o;
	size_t size;
	char *page;

	spec.scale_xy = "50";
	spec.k[0] = INT64_MAX / 100;
	meshes_make(&m, &spec);
	page = readback_text("html", "m.html", &m, &opt, &size);
	o = facts(page);
	assert_string_equal(fact(o, "axes/0/a"), "50");
	assert_string_equal(fact(o, "axes/0/b"), "4611686018427387900"); /* 92233720368547758 * 50 */
	assert_string_equal(fact(o, "axes/0/q"), "1");
	assert_string_equal(fact(o, "axes/0/decimals"), "0");
	assert_string_equal(fact(o, "axes/2/a"), "3937"); /* of 1200 / 1000 */
	assert_string_equal(fact(o, "axes/2/b"), "-47244");
	assert_string_equal(fact(o, "axes/2/q"), "1200000");
	assert_string_equal(fact(o, "comments/acut-units"), "metre us-survey-foot");
	json_object_put(o);
	free(page);
	meshes_done(&m);
}

static void test_limit(void **state)
{
	static const struct {
		uint64_t nvertex, nface;
		const char *said; /* NULL: it fits */
	} row[] = {
		{PAGE_TRIANGLES - 1650, PAGE_TRIANGLES - 3136, NULL},
		{1000, PAGE_TRIANGLES - 1, "a page holds 2000000 triangles at most"},
		{PAGE_TRIANGLES - 1, 0, "a page holds 2000000 vertices at most"},
		{(1ull << 31) + 5, 0, "vertices at most"},
		{0, 1ull << 33, "triangles at most"},
	};

	for (unsigned i = 0; i < sizeof(row) / sizeof(*row); i++) {
		uint8_t saved[FORMAT_SAVED] = {0};
		struct packer to = packer_of(saved, sizeof(saved));
		struct meshes_spec spec = readback_small;
		struct meshes m;
		struct err err;

		packer_u64(&to, row[i].nvertex);
		packer_u64(&to, row[i].nface);
		spec.strip = 32;
		meshes_make(&m, &spec);
		assert_int_equal(readback_late("html", saved, &m, &plain, &err), row[i].said ? -ERR_LIMIT : 0);
		if (row[i].said) {
			assert_non_null(strstr(err.message, row[i].said));
			assert_non_null(strstr(err.hint, "--tile"));
			assert_non_null(strstr(err.hint, "--bbox"));
		}
		meshes_done(&m);
	}
}

/* A mesh that turns out to be too large is given up: nothing of it is kept for --resume. */
static void test_given_up(void **state)
{
	static const struct meshes_spec line = {
		.columns = 1, .rows = 2000002, .strip = 1000000, .step = 1, .scale_xy = "0.01", .scale_z = "0.01"};
	const struct outputs_options ropt = {0};
	struct outputs *run;
	struct acut_mesh_sink sink;
	struct meshes m;
	struct err err = ERR_INIT;
	char dir[64], path[80];

	repeat_folder(dir, sizeof(dir), "page");
	snprintf(path, sizeof(path), "%s/m.html", dir);
	meshes_make(&m, &line);
	assert_int_equal(m.nblock, 3);
	assert_int_equal(outputs_new(&ropt, &run, &err), 0);
	assert_int_equal(outputs_add(run, path, format_find("html"), &plain, &err), 0);
	assert_int_equal(outputs_keep(run, 1, false, &err), 0);
	sink = outputs_sink(run);
	assert_int_equal(sink.head(sink.ctx, &m.head), 0);
	assert_int_equal(meshes_block(&m, &sink, 0), 0);
	assert_int_equal(outputs_save(run, "state", 5, &err), 0);
	assert_true(outputs_saved(run));
	assert_true(meshes_block(&m, &sink, 1) || meshes_block(&m, &sink, 2));
	assert_int_equal(outputs_error(run)->code, ERR_LIMIT);
	assert_false(outputs_saved(run));
	outputs_free(run);
	assert_int_equal(rmdir(dir), 0); /* it is empty */
	meshes_done(&m);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_mesh),     cmocka_unit_test(test_far),  cmocka_unit_test(test_empty),
		cmocka_unit_test(test_facts),    cmocka_unit_test(test_axes), cmocka_unit_test(test_limit),
		cmocka_unit_test(test_given_up),
	};

	return cmocka_run_group_tests(tests, readback_begin, readback_end);
}
