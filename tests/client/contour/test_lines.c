/*
 * Lines against an independent computation: each segment of each triangle, with its direction, is in exactly one line; what hangs
 * together is one line; lines end at the border of the mesh only; and they are the same whatever the blocks and the memory.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <stdio.h>
#include <cmocka.h>

#include "contour_priv.h"
#include "err.h"
#include "outfile.h"
#include "quad.h"
#include "repeat.h"
#include "surface.h"

/* The levels that are tried, in hundredths: base + i * interval of heights + 50. */
struct levels {
	struct decimal interval, base;
	int64_t num, den, off; /* level i is at lattice height (i * num + off) / den */
};
static const struct levels levels[] = {
	{{1, -2}, {0, 0}, 1, 1, -50},      /* each lattice step */
	{{2, -2}, {1, -2}, 2, 1, -49},     /* each other one */
	{{1, -1}, {0, 0}, 10, 1, -50},     /* on steps and past them */
	{{15, -3}, {0, 0}, 3, 2, -50 * 2}, /* on steps and between them */
	{{1, -2}, {5, -3}, 2, 2, -99},     /* between steps only */
	{{7, -3}, {-1, 0}, 7, 10, -1500},
};

struct segment {
	double at[4];
	int64_t level;
	uint32_t edge[4]; /* crossings: a pair of vertices each */
};

static int by_place(const void *a, const void *b)
{
	const struct segment *p = a, *q = b;

	if (p->level != q->level)
		return p->level < q->level ? -1 : 1;
	return memcmp(p->at, q->at, sizeof(p->at));
}

/* The coordinate where the edge has the level, rounded once. */
static double place(int32_t from, int32_t to, int32_t zfrom, int32_t zto, const struct levels *l, int64_t level, int64_t k)
{
	__int128 d = (__int128)((int64_t)zto - zfrom) * l->den, n = level * l->num + l->off - zfrom * l->den;
	__int128 sum = (from + k) * d + ((int64_t)to - from) * n;

	return (double)((quad)sum / (quad)(d * 100));
}

static void crossing(const struct surface *s, uint32_t a, uint32_t b, const struct levels *l, int64_t level, double at[2],
		     uint32_t edge[2])
{
	static const int64_t k[2] = {1000000, 2000000};

	for (int i = 0; i < 2; i++)
		at[i] = place(s->vertex[a][i], s->vertex[b][i], s->vertex[a][2], s->vertex[b][2], l, level, k[i]);
	edge[0] = a < b ? a : b;
	edge[1] = a < b ? b : a;
}

static bool is_up(const struct surface *s, uint32_t v, const struct levels *l, int64_t level)
{
	return s->vertex[v][2] * l->den >= level * l->num + l->off;
}

/* All segments of the mesh, those without a length too. */
static struct segment *segments_of(const struct surface *s, const struct levels *l, int64_t from, int64_t to, size_t *ret_n)
{
	struct segment *all = calloc((size_t)s->ntriangle * (size_t)(to - from + 1) + 1, sizeof(*all));
	size_t n = 0;

	for (uint32_t t = 0; t < s->ntriangle; t++) {
		for (int64_t level = from; level <= to; level++) {
			struct segment *g = &all[n];

			g->level = level;
			for (int i = 0, ends = 0; i < 3; i++) {
				uint32_t a = s->triangle[t][i], b = s->triangle[t][(i + 1) % 3];

				if (is_up(s, a, l, level) == is_up(s, b, l, level))
					continue;
				/* counter-clockwise, the edge that leaves what is up is where a line comes in */
				crossing(s, a, b, l, level, g->at + (is_up(s, a, l, level) ? 0 : 2),
					 g->edge + (is_up(s, a, l, level) ? 0 : 2));
				n += ++ends == 2;
			}
		}
	}
	*ret_n = n;
	return all;
}

static size_t with_length(struct segment *all, size_t n)
{
	size_t m = 0;

	for (size_t i = 0; i < n; i++)
		if (memcmp(all[i].at, all[i].at + 2, sizeof(double[2])))
			all[m++] = all[i];
	qsort(all, m, sizeof(*all), by_place);
	return m;
}

static struct segment *of_lines(const struct lines *lines, size_t *ret_n)
{
	struct segment *all = calloc(lines->npoint + 1, sizeof(*all));
	const double(*at)[2] = (const double(*)[2])lines->point;
	size_t n = 0;

	for (size_t i = 0; i < lines->n; at += lines->line[i++].points) {
		for (uint64_t k = 0; k + 1 < lines->line[i].points; k++) {
			all[n].level = lines->line[i].level;
			memcpy(all[n++].at, at[k], sizeof(double[4]));
		}
	}
	*ret_n = n;
	return all;
}

/* ---- what hangs together ---- */

struct graph {
	struct node {
		int64_t level;
		uint32_t edge[2], parent, degree;
		double at[2];
		bool length, used; /* of a root: some segment has a length */
		uint32_t ends;     /* of a root: crossings of one segment */
	} * node;
	size_t size;
};

static uint32_t node_of(struct graph *g, const struct segment *s, int end)
{
	uint64_t hash = ((uint64_t)s->edge[2 * end] << 32 | s->edge[2 * end + 1]) * 0x9e3779b97f4a7c15u ^ (uint64_t)s->level * 77;
	size_t i = (size_t)(hash >> 20) % g->size;

	for (; g->node[i].used; i = (i + 1) % g->size)
		if (g->node[i].level == s->level && !memcmp(g->node[i].edge, s->edge + 2 * end, 8))
			return (uint32_t)i;
	g->node[i] = (struct node){.level = s->level, .parent = (uint32_t)i, .used = true};
	memcpy(g->node[i].edge, s->edge + 2 * end, 8);
	memcpy(g->node[i].at, s->at + 2 * end, 16);
	return (uint32_t)i;
}

static uint32_t root_of(struct graph *g, uint32_t i)
{
	while (g->node[i].parent != i)
		i = g->node[i].parent = g->node[g->node[i].parent].parent;
	return i;
}

static void count_lines(const struct segment *all, size_t n, size_t *ret_open, size_t *ret_closed)
{
	struct graph g = {.size = 4 * n + 16};

	g.node = calloc(g.size, sizeof(*g.node));
	*ret_open = *ret_closed = 0;
	for (size_t i = 0; i < n; i++) {
		uint32_t a = node_of(&g, &all[i], 0), b = node_of(&g, &all[i], 1), ra = root_of(&g, a), rb = root_of(&g, b);
		bool length = memcmp(all[i].at, all[i].at + 2, sizeof(double[2])) != 0;

		g.node[a].degree++;
		g.node[b].degree++;
		length |= g.node[ra].length || g.node[rb].length;
		g.node[ra].parent = rb;
		g.node[rb].length = length;
	}
	for (uint32_t i = 0; i < g.size; i++) {
		assert_true(!g.node[i].used || g.node[i].degree == 1 || g.node[i].degree == 2);
		if (g.node[i].used && g.node[i].degree == 1)
			g.node[root_of(&g, i)].ends++;
	}
	for (uint32_t i = 0; i < g.size; i++) {
		struct node *root = &g.node[i];

		if (!root->used || root->parent != i || !root->length)
			continue;
		assert_true(root->ends == 0 || root->ends == 2);
		*(root->ends ? ret_open : ret_closed) += 1;
	}
	free(g.node);
}

/* ---- tests ---- */

static void check(const struct surface *s, const struct levels *l, const struct lines *lines)
{
	size_t n, m, got_n, open, closed, got_closed = 0;
	const double(*at)[2] = (const double(*)[2])lines->point;
	struct segment *all = segments_of(s, l, -100, 400, &n), *got = of_lines(lines, &got_n);

	count_lines(all, n, &open, &closed);
	m = with_length(all, n);
	qsort(got, got_n, sizeof(*got), by_place);
	assert_int_equal(got_n, m);
	for (size_t i = 0; i < m; i++) {
		assert_int_equal(all[i].level, got[i].level);
		assert_memory_equal(all[i].at, got[i].at, sizeof(got[i].at));
	}
	for (size_t i = 0; i < lines->n; at += lines->line[i++].points) {
		const struct contour_line *line = &lines->line[i];

		got_closed += line->closed;
		if (line->closed)
			assert_memory_equal(at[0], at[line->points - 1], sizeof(*at));
		assert_true(!i || line->level >= lines->line[i - 1].level);
	}
	assert_int_equal(got_closed, closed);
	assert_int_equal(lines->n - got_closed, open);
	free(all);
	free(got);
}

static void test_brute_force(void **ctx)
{
	static const int32_t heights[] = {2, 3, 5, 40}, step[] = {1, 1, 2, 3};

	for (unsigned seed = 0; seed < repeat_cases(3000); seed++) {
		const struct levels *l = &levels[seed % (sizeof(levels) / sizeof(*levels))];
		struct way way = {.interval = l->interval, .base = l->base};
		struct lines one, other;
		struct surface s;

		surface_seed(seed);
		surface_make(&s, 2 + (uint32_t)surface_random(6), 2 + (uint32_t)surface_random(6), heights[seed / 7 % 4],
			     step[seed / 28 % 4], seed % 3 == 0);
		surface_lines(&s, &way, &one);
		check(&s, l, &one);
		way.blocks = 1 + (uint32_t)surface_random(9);
		way.segments = 4 + (unsigned)surface_random(40);
		surface_lines(&s, &way, &other);
		lines_same(&one, &other);
		lines_done(&one);
		lines_done(&other);
		surface_done(&s);
	}
}

/* More pieces than there is memory for, and lines that do not fit the reader's buffer. */
static void test_large(void **ctx)
{
	const struct levels *l = &levels[3];
	struct way way = {.interval = l->interval, .base = l->base};
	struct lines one, other;
	struct surface s;
	uint64_t most = 0;

	surface_seed(1);
	surface_make(&s, 150, 150, 3, 2, false);
	surface_lines(&s, &way, &one);
	check(&s, l, &one);
	for (size_t i = 0; i < one.n; i++)
		most = one.line[i].points > most ? one.line[i].points : most;
	way.blocks = 40;
	way.segments = 16;
	way.pages = 2;
	surface_lines(&s, &way, &other);
	lines_same(&one, &other);
	lines_done(&other);
	lines_done(&one);
	surface_done(&s);
	/* a spiral would do, too: one line around all of it */
	surface_make(&s, 3000, 3, 1, 1, false);
	for (uint32_t i = 0; i < s.nvertex; i++)
		s.vertex[i][2] = i / 3000 == 1 && i % 3000 > 0 && i % 3000 < 2999 ? 10 : 0;
	way = (struct way){.interval = {1, 0}, .base = {55, -2}};
	surface_lines(&s, &way, &one);
	assert_int_equal(one.n, 1);
	assert_true(one.line[0].closed && one.line[0].points > 8192);
	assert_string_equal(one.height[0], "0.55");
	way.blocks = 500;
	way.segments = 32;
	way.pages = 1;
	surface_lines(&s, &way, &other);
	lines_same(&one, &other);
	lines_done(&other);
	lines_done(&one);
	surface_done(&s);
	assert_true(most > 100);
}

/* Heights of levels as text, exact. */
static void test_heights(void **ctx)
{
	static const struct {
		struct decimal interval, base;
		const char *first, *last;
	} rows[] = {
		{{1, 0}, {0, 0}, "1", "2"},          {{5, -1}, {0, 0}, "1", "2.5"},  {{1, 0}, {25, -2}, "1.25", "2.25"},
		{{1, 0}, {-75, -2}, "1.25", "2.25"}, {{7, -1}, {3, -1}, "1", "2.4"}, {{1, 1}, {-1, 0}, NULL, NULL},
	};

	for (unsigned i = 0; i < sizeof(rows) / sizeof(*rows); i++) {
		struct way way = {.interval = rows[i].interval, .base = rows[i].base};
		struct surface s;
		struct lines lines;

		surface_make(&s, 2, 2, 1, 1, false);
		for (unsigned v = 0; v < 4; v++)
			s.vertex[v][2] = v % 2 ? 200 : 5; /* heights are 0.5 more: 0.55 to 2.5 */
		surface_lines(&s, &way, &lines);
		assert_true((lines.n > 0) == (rows[i].first != NULL));
		if (lines.n) {
			assert_string_equal(lines.height[0], rows[i].first);
			assert_string_equal(lines.height[lines.n - 1], rows[i].last);
		}
		lines_done(&lines);
		surface_done(&s);
	}
}

/* Heights in other units: rounded, without an exponent, and no two alike. */
static void test_converted(void **ctx)
{
	static const struct {
		struct decimal interval;
		const char *text[3]; /* of levels 0, 1 and 181 */
	} rows[] = {
		{{1, 0}, {"0", "3.28084", "593.832021"}},
		{{1, -1}, {"0", "0.328084", "59.383202"}},
		{{1, -7}, {"0", "0.000000328", "0.000059383"}},
	};
	static const int64_t level[] = {0, 1, 181};

	for (unsigned i = 0; i < sizeof(rows) / sizeof(*rows); i++) {
		const struct acut_mesh_head head = {.scale_xy = "0.01", .scale_z = "0.01", .k = {0, 0, 0}};
		struct contour_options opt = {
			.interval = {rows[i].interval, 10000, 3048}, .base = {{0, 0}, 1, 1}, .z_num = 10000, .z_den = 3048};
		char text[DECIMAL_TEXT_SIZE], before[DECIMAL_TEXT_SIZE] = "";
		struct err err = ERR_INIT;
		struct outfile *out;
		struct contour *c;

		assert_int_equal(outfile_spool(NULL, &out, &err), 0);
		assert_int_equal(contour_new(out, &c, &err), 0);
		assert_int_equal(contour_head(c, &head, &opt, &err), 0);
		for (unsigned k = 0; k < 3; k++) {
			assert_string_equal(contour_height_text(c, level[k], text), rows[i].text[k]);
			assert_true(contour_height(c, level[k]) == strtod(text, NULL));
		}
		for (int64_t k = -2000; k < 2000; k++) {
			assert_string_not_equal(contour_height_text(c, k, text), before);
			assert_null(strchr(text, 'e'));
			memcpy(before, text, sizeof(text));
		}
		contour_free(c);
		outfile_free(out);
	}
}

/* Quotients at and beside the middle between two doubles, of numbers of all sizes. */
static void test_nearest(void **ctx)
{
	surface_seed(5);
	for (unsigned i = 0; i < 100000; i++) {
		int64_t d = (int64_t)surface_random(1ull << 31) << (i % 29) | 3, m = (int64_t)surface_random(1ull << 31) << 22;
		__int128 middle;

		m |= 1ll << 53; /* of two doubles that are 2 apart, m is the even or the odd one */
		m = (m | (int64_t)surface_random(1ull << 22)) & ~1ll;
		middle = (__int128)(m + 1) * d;
		assert_true(contour_nearest(middle + 1, d) == (double)(m + 2));
		assert_true(contour_nearest(middle - 1, d) == (double)m);
		assert_true(contour_nearest(middle, d) == (double)(m % 4 ? m + 2 : m));
		assert_true(contour_nearest(-middle - 1, d) == -(double)(m + 2));
		assert_true(contour_nearest(m / 3, d) == (double)(m / 3) / (double)d || d >= 1ll << 53);
	}
	assert_true(contour_nearest(0, 7) == 0);
}

static int always(void *ctx)
{
	return 1;
}

static void test_interrupted(void **ctx)
{
	const struct acut_mesh_head head = {.scale_xy = "0.01", .scale_z = "0.01"};
	struct contour_options opt = {
		.interval = {{1, -2}, 1, 1}, .base = {{0, 0}, 1, 1}, .z_num = 1, .z_den = 1, .interrupted = always};
	static const int32_t vertex[3][3] = {{0, 0, 0}, {10, 0, 5}, {0, 10, 9}};
	static const uint32_t triangle[1][3] = {{0, 1, 2}};
	const struct acut_mesh_block b = {.nnew = 3, .ntriangle = 1, .triangle = triangle};
	struct err err = ERR_INIT;
	struct outfile *out;
	struct contour *c;

	assert_int_equal(outfile_spool(NULL, &out, &err), 0);
	assert_int_equal(contour_new(out, &c, &err), 0);
	assert_int_equal(contour_head(c, &head, &opt, &err), 0);
	assert_int_equal(contour_block(c, &b, vertex, &err), 0);
	assert_int_equal(contour_join(c, &err), -ERR_CANCELLED);
	contour_free(c);
	outfile_free(out);
}

/* One triangle with many levels: it is interrupted, and too many are refused. */
static void test_many_levels(void **ctx)
{
	static const struct {
		int32_t high;
		bool interrupted;
		int result;
	} rows[] = {{900, false, 0},
		    {900, true, -ERR_CANCELLED},
		    {CONTOUR_LEVELS, false, 0},
		    {CONTOUR_LEVELS + 1, false, -ERR_USAGE}};
	const struct acut_mesh_head head = {.scale_xy = "0.01", .scale_z = "0.01"};

	for (unsigned i = 0; i < sizeof(rows) / sizeof(*rows); i++) {
		struct contour_options opt = {.interval = {{1, -2}, 1, 1},
					      .base = {{0, 0}, 1, 1},
					      .z_num = 1,
					      .z_den = 1,
					      .segments = 64,
					      .interrupted = rows[i].interrupted ? always : NULL};
		const int32_t vertex[3][3] = {{0, 0, 0}, {10, 0, 5}, {0, 10, rows[i].high}};
		static const uint32_t triangle[1][3] = {{0, 1, 2}};
		const struct acut_mesh_block b = {.nnew = 3, .ntriangle = 1, .triangle = triangle};
		struct err err = ERR_INIT;
		struct outfile *out;
		struct contour *c;

		assert_int_equal(outfile_spool(NULL, &out, &err), 0);
		assert_int_equal(contour_new(out, &c, &err), 0);
		assert_int_equal(contour_head(c, &head, &opt, &err), 0);
		assert_int_equal(contour_block(c, &b, vertex, &err), rows[i].result);
		contour_free(c);
		outfile_free(out);
	}
}

/* A triangle that comes twice is no mesh. */
static void test_no_mesh(void **ctx)
{
	struct surface s;
	struct way way = {.interval = {1, -2}};

	for (uint32_t blocks = 1; blocks < 3; blocks++) {
		const struct acut_mesh_head head = {.scale_xy = "0.01", .scale_z = "0.01"};
		struct contour_options opt = {.interval = {way.interval, 1, 1}, .base = {{0, 0}, 1, 1}, .z_num = 1, .z_den = 1};
		struct acut_mesh_block b = {.ntriangle = blocks == 1 ? 2 : 1};
		struct err err = ERR_INIT;
		uint32_t twice[2][3];
		struct outfile *out;
		struct contour *c;
		int r = 0;

		surface_make(&s, 2, 2, 1, 1, false);
		s.vertex[0][2] = 10;
		for (int i = 0; i < 2; i++)
			memcpy(twice[i], s.triangle[0], sizeof(*twice));
		s.vertex[s.triangle[0][0]][2] = 20;
		b.nnew = s.nvertex;
		b.triangle = (const uint32_t(*)[3])twice;
		assert_int_equal(outfile_spool(NULL, &out, &err), 0);
		assert_int_equal(contour_new(out, &c, &err), 0);
		assert_int_equal(contour_head(c, &head, &opt, &err), 0);
		for (uint32_t i = 0; i < blocks && !r; i++)
			r = contour_block(c, &b, (const int32_t(*)[3])s.vertex, &err);
		assert_int_equal(r ? r : contour_join(c, &err), -ERR_PROTO);
		contour_free(c);
		outfile_free(out);
		surface_done(&s);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_brute_force), cmocka_unit_test(test_large),
					   cmocka_unit_test(test_heights),     cmocka_unit_test(test_nearest),
					   cmocka_unit_test(test_interrupted), cmocka_unit_test(test_no_mesh),
					   cmocka_unit_test(test_converted),   cmocka_unit_test(test_many_levels)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
