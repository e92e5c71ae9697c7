/* Files of the writers, read back by separate code and compared with the mesh; and the parts that writers share. */
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "format_axis.h"
#include "format_digits.h"
#include "outputs_priv.h"
#include "written.h"

static char *slurp(size_t *ret_size)
{
	FILE *f = fopen(written_path(), "rb");
	struct stat st;
	char *text;

	assert_non_null(f);
	fstat(fileno(f), &st);
	text = calloc(1, (size_t)st.st_size + 1);
	assert_int_equal(fread(text, 1, (size_t)st.st_size, f), st.st_size);
	fclose(f);
	*ret_size = (size_t)st.st_size;
	return text;
}

struct ply {
	char *text;
	uint64_t nvertex, nface;
	const double *v;
	const uint8_t *f;
	size_t face; /* bytes of one */
};

static struct ply read_ply(void)
{
	struct ply p;
	size_t size, header;
	const char *at;
	double *v;

	p.text = slurp(&size);
	assert_memory_equal(p.text, "ply\nformat binary_little_endian 1.0\n", 36);
	at = strstr(p.text, "element vertex ");
	assert_non_null(at);
	p.nvertex = strtoull(at + 15, NULL, 10);
	at = strstr(p.text, "element face ");
	p.nface = strtoull(at + 13, NULL, 10);
	at = strstr(at, "property list uchar int vertex_indices\n");
	assert_non_null(at);
	p.face = strstr(at, "\nproperty ushort edges\n") ? 15 : 13;
	at = strstr(at, "\nend_header\n");
	assert_non_null(at);
	header = (size_t)(at + 12 - p.text);
	assert_int_equal(size, header + p.nvertex * 24 + p.nface * p.face);
	v = malloc(p.nvertex * 24 + 1);
	memcpy(v, p.text + header, p.nvertex * 24);
	p.v = v;
	p.f = (const uint8_t *)p.text + header + p.nvertex * 24;
	return p;
}

static void done_ply(struct ply *p)
{
	free((void *)p->v);
	free(p->text);
}

/* Every vertex and face of the mesh, in the order of the stream. */
static void test_ply(void **state)
{
	const struct format_options opt = {0};
	struct meshes m;
	struct ply p;
	struct err err = ERR_INIT;
	uint64_t v = 0, f = 0;

	meshes_make(&m, &written_grid);
	assert_int_equal(written_as("ply", &m, &opt, NULL, NULL, &err), 0);
	p = read_ply();
	assert_int_equal(p.nvertex, m.tail.vertices);
	assert_int_equal(p.nface, m.tail.triangles);
	for (size_t i = 0; i < m.nblock; i++) {
		const struct acut_mesh_block *b = &m.block[i];
		for (uint32_t j = 0; j < b->nnew; j++, v++) {
			assert_true(p.v[3 * v] == (b->vertex[j][0] + 50000000) / 100.0);
			assert_true(p.v[3 * v + 1] == (b->vertex[j][1] + 400000000) / 100.0);
			assert_true(p.v[3 * v + 2] == (b->vertex[j][2] - 12) / 1000.0);
		}
		for (uint32_t j = 0; j < b->ntriangle; j++, f++) {
			assert_int_equal(p.f[13 * f], 3);
			for (int c = 0; c < 3; c++) {
				uint32_t l = b->triangle[j][c];
				int32_t got;
				memcpy(&got, p.f + 13 * f + 1 + 4 * c, 4);
				assert_int_equal(got, l < b->nforeign ? b->foreign[l] : b->first + l - b->nforeign);
			}
		}
	}
	assert_non_null(strstr(p.text, "comment acut-lattice 0.01 0.001 50000000 400000000 -12\n"));
	assert_non_null(strstr(p.text, "comment acut-crs EPSG:26910 second line\n"));
	assert_non_null(strstr(p.text, "comment acut-units metre metre\n"));
	assert_non_null(strstr(p.text, "comment acut-digest 0123456789abcdef0123456789abcdef "
				       "fedcba9876543210fedcba9876543210\n"));
	done_ply(&p);
	meshes_done(&m);
}

/* OBJ and PLY say the same; OBJ's decimals are exact. */
static void test_obj(void **state)
{
	const struct format_options opt = {0};
	struct meshes m;
	struct err err = ERR_INIT;
	size_t size;
	char *text, *line, *rest;
	uint64_t v = 0, f = 0;

	meshes_make(&m, &written_grid);
	assert_int_equal(written_as("obj", &m, &opt, NULL, NULL, &err), 0);
	text = slurp(&size);
	assert_non_null(strstr(text, "\nv 499930.00 4000001.23 -0.012\n"));
	for (line = strtok_r(text, "\n", &rest); line; line = strtok_r(NULL, "\n", &rest)) {
		unsigned a, b, c;
		v += line[0] == 'v';
		if (line[0] == 'f') {
			assert_int_equal(sscanf(line, "f %u %u %u", &a, &b, &c), 3);
			assert_true(a && b && c && a <= v && b <= v && c <= v);
			f++;
		}
	}
	assert_int_equal(v, m.tail.vertices);
	assert_int_equal(f, m.tail.triangles);
	free(text);
	meshes_done(&m);
}

/* Two orders of one mesh give the same bytes, whether the sort fits its memory or not. */
static void test_canonical(void **state)
{
	size_t formats;
	const struct format *const *row = format_rows(&formats);

	for (size_t n = 0; n < formats; n++) {
		struct format_options opt = meshes_options(row[n]);
		char *first = NULL;
		size_t first_size = 0;

		opt.canonical = true;
		if (!(row[n]->takes & FORMAT_CANONICAL))
			continue;
		for (int i = 0; i < 4; i++) {
			const struct outputs_options ropt = {.sort_memory = i & 2 ? 200000 : 0};
			struct meshes_spec spec = written_grid;
			struct meshes m;
			struct err err = ERR_INIT;
			size_t size;
			char *text;

			spec.columns = 170;
			spec.rows = 90;
			spec.shuffle = i & 1;
			spec.strip = i & 1 ? 11 : 4;
			meshes_make(&m, &spec);
			assert_int_equal(written_as(row[n]->name, &m, &opt, &ropt, NULL, &err), 0);
			text = slurp(&size);
			if (!first) {
				first = text;
				first_size = size;
			} else {
				assert_int_equal(size, first_size);
				assert_memory_equal(text, first, size);
				free(text);
			}
			meshes_done(&m);
		}
		free(first);
	}
}

/* Vertices by (x, y); triangles start at their smallest number, sorted, still counter-clockwise. */
static void test_canonical_order(void **state)
{
	const struct format_options opt = {.canonical = true};
	const struct outputs_options ropt = {.sort_memory = 200000};
	struct meshes_spec spec = written_grid;
	struct meshes m;
	struct err err = ERR_INIT;
	struct ply p;
	uint32_t before[3] = {0, 0, 0};

	spec.shuffle = 1;
	spec.columns = 200;
	spec.rows = 150;
	meshes_make(&m, &spec);
	assert_int_equal(written_as("ply", &m, &opt, &ropt, NULL, &err), 0);
	p = read_ply();
	assert_int_equal(p.nvertex, m.tail.vertices);
	assert_int_equal(p.nface, m.tail.triangles);
	for (uint64_t i = 1; i < p.nvertex; i++) {
		const double *a = p.v + 3 * (i - 1), *b = a + 3;
		assert_true(a[0] < b[0] || (a[0] == b[0] && a[1] < b[1]));
	}
	for (uint64_t i = 0; i < p.nface; i++) {
		uint32_t t[3];
		const double *a, *b, *c;
		memcpy(t, p.f + 13 * i + 1, 12);
		assert_true(t[0] < t[1] && t[0] < t[2]);
		if (i) {
			assert_true(memcmp(t, before, 12));
			assert_true(t[0] > before[0] ||
				    (t[0] == before[0] && (t[1] > before[1] || (t[1] == before[1] && t[2] > before[2]))));
		}
		memcpy(before, t, 12);
		a = p.v + 3 * t[0], b = p.v + 3 * t[1], c = p.v + 3 * t[2];
		assert_true((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0);
	}
	done_ply(&p);
	meshes_done(&m);
}

/* Positions on a line: their vertices, in order, and no face. */
static void test_line(void **state)
{
	const struct outputs_options ropt = {.edges = true};
	struct meshes_spec spec = {.columns = 1,
				   .rows = 300,
				   .strip = 299,
				   .x0 = 5,
				   .y0 = -9,
				   .step = 700,
				   .slope_y = 1,
				   .scale_xy = "0.01",
				   .scale_z = "1"};
	struct outputs_report report;
	struct meshes m;
	struct err err = ERR_INIT;

	meshes_make(&m, &spec);
	for (unsigned canonical = 0; canonical < 2; canonical++) {
		const struct format_options opt = {.canonical = canonical};
		struct ply p;

		assert_int_equal(written_as("ply", &m, &opt, &ropt, &report, &err), 0);
		assert_true(report.median_edge == 0 && report.longest_edge == 0 && report.long_share == 0);
		p = read_ply();
		assert_int_equal(p.nvertex, 300);
		assert_int_equal(p.nface, 0);
		assert_true(p.v[0] == 0.05 && p.v[3 * 299 + 1] == 299 * 7 - 0.09 && p.v[3 * 299 + 2] == 299);
		done_ply(&p);
	}
	meshes_done(&m);
}

/* One vertex far from a grid of 3.00: its triangles are most of the area, and only then. A stream may say two of one position. */
static void test_long_share(void **state)
{
	const struct format_options opt = {0};
	const struct outputs_options ropt = {.edges = true};
	static const struct {
		int32_t by;
		double share;
	} row[] = {{0, 0}, {-300, 0}, {14000, 0}, {16000, 0.017}, {30000000, 0.96}};
	struct meshes_spec spec = written_grid;
	struct err err = ERR_INIT;

	spec.step = 300;
	spec.strip = spec.rows - 1;
	for (unsigned i = 0; i < sizeof(row) / sizeof(*row); i++) {
		struct outputs_report report;
		struct meshes m;

		meshes_make(&m, &spec);
		((int32_t(*)[3])(uintptr_t)m.block[0].vertex)[spec.columns * spec.rows - 1][0] += row[i].by;
		assert_int_equal(written_as("ply", &m, &opt, &ropt, &report, &err), 0);
		assert_true(fabs(report.median_edge / 3 - 1) < 0.05);
		assert_true(report.long_share >= row[i].share && report.long_share <= row[i].share + 0.03);
		assert_true(row[i].share > 0 || report.long_share == 0);
		meshes_done(&m);
	}
}

/* The limit is exact: an edge of just that length stays, a shorter limit by one digit drops it. */
static void test_max_edge(void **state)
{
	const struct format_options opt = {0};
	struct outputs_options ropt = {.max_edge.given = true, .edges = true};
	struct meshes_spec spec = written_grid;
	struct outputs_report report;
	struct meshes m;
	struct err err = ERR_INIT;
	uint64_t all;

	spec.step = 300; /* squares of 3.00; diagonal sqrt(18) = 4.2426406871... */
	meshes_make(&m, &spec);
	all = m.tail.triangles;
	assert_true(decimal_parse("4.2426406872", &ropt.max_edge.value));
	assert_int_equal(written_as("ply", &m, &opt, &ropt, &report, &err), 0);
	assert_int_equal(report.left_out.triangles, 0);
	assert_true(fabs(report.longest_edge - sqrt(18)) < 1e-9);
	assert_true(fabs(report.median_edge / 3 - 1) < 0.05);
	assert_true(decimal_parse("4.2426406871", &ropt.max_edge.value));
	assert_int_equal(written_as("ply", &m, &opt, &ropt, &report, &err), 0);
	assert_int_equal(report.left_out.triangles, all);
	assert_true(fabs(report.left_out.area - (double)all * 4.5) < 1e-6);
	assert_true(decimal_parse("1e300", &ropt.max_edge.value) == false ||
		    written_as("ply", &m, &opt, &ropt, &report, &err) == 0);
	meshes_done(&m);
	spec.step = 500; /* 5.00 and 7.0710678: rational limits */
	meshes_make(&m, &spec);
	assert_true(decimal_parse("8", &ropt.max_edge.value));
	assert_int_equal(written_as("obj", &m, &opt, &ropt, &report, &err), 0);
	assert_int_equal(report.left_out.triangles, 0);
	assert_true(decimal_parse("-1", &ropt.max_edge.value));
	assert_int_equal(written_as("obj", &m, &opt, &ropt, &report, &err), -ERR_USAGE);
	meshes_done(&m);
}

/* Two triangles with the same hull: only the one with the long edge goes. */
static void test_max_edge_equal(void **state)
{
	static const int32_t v[][3] = {{0, 0, 0}, {300, 0, 0}, {0, 400, 0}, {-4000, 200, 0}};
	static const uint32_t t[][3] = {{0, 1, 2}, {0, 2, 3}};
	static const uint8_t final[] = {15};
	struct acut_mesh_block b = {.nnew = 4, .ntriangle = 2, .vertex = v, .triangle = t, .final = final};
	const struct format_options opt = {0};
	struct outputs_options ropt = {.max_edge.given = true};
	struct outputs_report report;
	struct meshes_spec spec = {.scale_xy = "0.01", .scale_z = "1"};
	struct meshes m;
	struct err err = ERR_INIT;
	struct ply p;

	meshes_make(&m, &spec);
	m.block = &b;
	m.nblock = 1;
	assert_true(decimal_parse("5", &ropt.max_edge.value)); /* the hypotenuse is 5.00 exactly */
	assert_int_equal(written_as("ply", &m, &opt, &ropt, &report, &err), 0);
	assert_int_equal(report.left_out.triangles, 1);
	assert_true(fabs(report.left_out.area - 80) < 1e-9);
	p = read_ply();
	assert_int_equal(p.nvertex, 4);
	assert_int_equal(p.nface, 1);
	done_ply(&p);
	assert_true(decimal_parse("4.999999999", &ropt.max_edge.value));
	assert_int_equal(written_as("ply", &m, &opt, &ropt, &report, &err), 0);
	assert_int_equal(report.left_out.triangles, 2);
}

/* Which sides are pieces of lines: any symmetric rule of their ends, lattice numbers. */
static bool is_piece(const int64_t *a, const int64_t *b)
{
	return ((a[0] + b[0] + 3 * (a[1] + b[1])) / 100 % 7 + 7) % 7 < 3;
}

static void mark(struct meshes *m)
{
	int32_t(*at)[3] = calloc(m->tail.vertices, sizeof *at);

	m->head.lines = true;
	for (size_t i = 0; i < m->nblock; i++) {
		struct acut_mesh_block *b = &m->block[i];
		uint8_t *flags = calloc(b->ntriangle + 1, 1);

		memcpy(at + b->first, b->vertex, b->nnew * sizeof *at);
		for (uint32_t t = 0; t < b->ntriangle; t++) {
			uint32_t *corner = (uint32_t *)(uintptr_t)b->triangle[t], was[3];

			memcpy(was, corner, sizeof was);
			for (unsigned k = 0; k < 3; k++)
				corner[k] = was[(k + t) % 3]; /* any corner is the first */
			for (unsigned k = 0; k < 3; k++) {
				int64_t end[2][2];

				for (unsigned e = 0; e < 2; e++) {
					uint32_t l = b->triangle[t][(k + 1 + e) % 3];
					const int32_t *v = at[l < b->nforeign ? b->foreign[l] : b->first + l - b->nforeign];

					end[e][0] = v[0] + m->head.k[0];
					end[e][1] = v[1] + m->head.k[1];
				}
				flags[t] |= (uint8_t)(is_piece(end[0], end[1]) << k);
			}
		}
		b->flags = flags;
	}
	free(at);
}

/* Flags go with their sides through all that chooses triangles and turns them. In half of the rows triangles have long edges, so
 * that
 * --trim-hull keeps them aside, and leaves out none. */
static void test_edges(void **state)
{
	static const struct {
		bool canonical;
		const char *max_edge, *trim_hull;
	} row[] = {{false, NULL, NULL}, {true, NULL, NULL},   {false, "1.5", NULL},
		   {true, "1.5", NULL}, {false, NULL, "1.2"}, {true, NULL, "1.2"}};

	for (size_t k = 0; k < sizeof row / sizeof *row; k++) {
		const struct format_options opt = {.canonical = row[k].canonical};
		struct outputs_options ropt = {.max_edge.given = row[k].max_edge, .trim_hull.given = row[k].trim_hull};
		struct meshes m;
		struct err err = ERR_INIT;
		uint64_t marked = 0;
		struct ply p;

		meshes_make(&m, &written_grid);
		mark(&m);
		if (row[k].max_edge)
			assert_true(decimal_parse(row[k].max_edge, &ropt.max_edge.value));
		if (row[k].trim_hull)
			assert_true(decimal_parse(row[k].trim_hull, &ropt.trim_hull.value));
		assert_int_equal(written_as("ply", &m, &opt, &ropt, NULL, &err), 0);
		p = read_ply();
		assert_int_equal(p.face, 15);
		assert_int_equal(p.nface, m.tail.triangles);
		for (uint64_t i = 0; i < p.nface; i++) {
			const uint8_t *f = p.f + i * p.face;
			int64_t end[3][2];

			for (unsigned j = 0; j < 3; j++) {
				uint32_t v;

				memcpy(&v, f + 1 + 4 * j, 4);
				end[j][0] = llrint(p.v[3 * (uint64_t)v] * 100);
				end[j][1] = llrint(p.v[3 * (uint64_t)v + 1] * 100);
			}
			for (unsigned j = 0; j < 3; j++) {
				bool is = is_piece(end[(j + 1) % 3], end[(j + 2) % 3]);

				assert_int_equal(f[13] >> j & 1, is);
				marked += is;
			}
		}
		assert_true(marked > p.nface / 8);
		done_ply(&p);
		for (size_t i = 0; i < m.nblock; i++)
			free((void *)m.block[i].flags);
		meshes_done(&m);
	}
}

static void test_origin(void **state)
{
	struct format_options opt = {.has_origin = true};
	struct meshes m;
	struct err err = ERR_INIT;
	struct ply p;

	meshes_make(&m, &written_grid);
	assert_true(decimal_parse("500000.005", &opt.origin[0]));
	assert_true(decimal_parse("4000000", &opt.origin[1]));
	assert_true(decimal_parse("-1.5", &opt.origin[2]));
	assert_int_equal(written_as("ply", &m, &opt, NULL, NULL, &err), 0);
	p = read_ply();
	assert_true(p.v[0] == -70.005);
	assert_true(p.v[1] == 1.23);
	assert_true(p.v[2] == 1.488);
	assert_non_null(strstr(p.text, "comment acut-origin 500000.005 4000000 -1.5\n"));
	done_ply(&p);
	opt = (struct format_options){.origin_auto = true};
	assert_int_equal(written_as("ply", &m, &opt, NULL, NULL, &err), 0);
	p = read_ply();
	/* x from -7000 to -2100, middle -4550; z from -100000 to 100000, middle 0 */
	assert_true(p.v[0] == -24.5);
	assert_true(p.v[2] == 0);
	assert_non_null(strstr(p.text, "comment acut-origin 499954.5 "));
	done_ply(&p);
	opt = (struct format_options){.has_origin = true};
	assert_true(decimal_parse("0.0000000000000000001", &opt.origin[0]));
	assert_int_equal(written_as("ply", &m, &opt, NULL, NULL, &err), -ERR_USAGE);
	meshes_done(&m);
}

/* The fast conversion against the slow one, at many scales and ends of the range. */
static void expect_digits(uint64_t n)
{
	char want[32], got[40];

	snprintf(want, sizeof(want), "%" PRIu64, n);
	*format_digits_put(n, got) = 0;
	assert_string_equal(got, want);
	for (int i = 1; i <= 8; i++) {
		snprintf(want, sizeof(want), "%08" PRIu64, n % 100000000);
		*format_digits_last((uint32_t)(n % 100000000), i, got) = 0;
		assert_string_equal(got, want + 8 - i);
	}
}

static void test_digits(void **state)
{
	uint64_t n = 1;

	for (uint64_t i = 0; i < 100000; i++)
		expect_digits(i);
	for (uint64_t power = 1, i = 0; i < 20; i++, power *= 10) {
		expect_digits(power - 1);
		expect_digits(power);
		expect_digits(power + 1);
	}
	expect_digits(UINT64_MAX);
	for (int i = 0; i < 200000; i++) {
		n = n * 6364136223846793005u + 1442695040888963407u;
		expect_digits(n >> n % 64);
	}
}

static void test_axis(void **state)
{
	static const char *const scale[] = {
		"1", "0.1", "0.01", "0.001", "1e-7", "0.00025", "0.0003048006096", "25", "1e-22", "1e5", "0.333333333333333"};
	static const int64_t k[] = {0, 1, -1, 6000000000, -123456789012345, 12345678901234567, 4611686018427387904};

	for (unsigned i = 0; i < sizeof(scale) / sizeof(*scale); i++) {
		for (unsigned j = 0; j < sizeof(k) / sizeof(*k); j++) {
			struct acut_mesh_head head = {.scale_xy = scale[i], .scale_z = scale[i], .k = {k[j], k[j], k[j]}};
			const struct format_options opt = {0};
			struct format_axis axis[3];
			struct err err = ERR_INIT;
			struct decimal s;

			assert_true(decimal_parse(scale[i], &s));
			assert_int_equal(format_axis_init(axis, &head, &opt, &err), 0);
			for (int n = 0; n < 200; n++) {
				int32_t x = n == 0 ? INT32_MIN :
					    n == 1 ? INT32_MAX :
					    n == 2 ? 0 :
						     (int32_t)(random() * 2 - RAND_MAX);
				int32_t v[1][3] = {{x, x, x}};
				double want = decimal_scaled_double(s, x + k[j]), got[3];
				char text[FORMAT_COORDINATE * 2], *end;

				assert_true(format_axis_value(&axis[0], x) == want);
				format_axis_values(axis, (const int32_t(*)[3])v, 1, got);
				assert_true(got[0] == want && got[2] == want);
				*format_axis_text(&axis[0], x, text) = 0;
				assert_true(strtod(text, &end) == want && !*end);
				assert_true(strlen(text) < FORMAT_COORDINATE);
			}
		}
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_digits),
		cmocka_unit_test(test_ply),
		cmocka_unit_test(test_obj),
		cmocka_unit_test(test_canonical),
		cmocka_unit_test(test_canonical_order),
		cmocka_unit_test(test_line),
		cmocka_unit_test(test_long_share),
		cmocka_unit_test(test_max_edge),
		cmocka_unit_test(test_max_edge_equal),
		cmocka_unit_test(test_edges),
		cmocka_unit_test(test_origin),
		cmocka_unit_test(test_axis),
	};

	return written_run(tests, sizeof tests / sizeof *tests);
}
