/*
 * The verifier: good meshes pass, and each kind of fault, introduced one at a time, is reported as such. Good meshes
 * come from brute force: all triples whose circle contains no point, ties by the rule in docs/design/algorithm.md 1,
 * with determinants for small numbers only. With weights they are regular, by the rule in docs/design/weights.md.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "geom_power.h"
#include "random.h"
#include "verify.h"

enum { MOST = 40, TRIANGLES = 4 * MOST };

struct mesh {
	int32_t vertex[MOST][3];
	uint32_t triangle[TRIANGLES][3];
	size_t nvertex, ntriangle;
	int64_t weight[MOST];
	bool weighted;
};

static uint64_t random_state = 23;

static uint64_t rnd(void)
{
	return random_next(&random_state);
}

static int64_t orient(const int32_t *a, const int32_t *b, const int32_t *c)
{
	return (int64_t)(b[0] - a[0]) * (c[1] - a[1]) - (int64_t)(b[1] - a[1]) * (c[0] - a[0]);
}

/* As a 3x3 determinant by the first row, for coordinates below 2^12. */
static int64_t circle(const int32_t *a, const int32_t *b, const int32_t *c, const int32_t *d)
{
	int64_t m[3][3];
	const int32_t *p[3] = {a, b, c};

	for (int i = 0; i < 3; i++) {
		m[i][0] = p[i][0] - d[0];
		m[i][1] = p[i][1] - d[1];
		m[i][2] = m[i][0] * m[i][0] + m[i][1] * m[i][1];
	}
	return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
	       m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

static bool comes_later(const int32_t *a, const int32_t *b)
{
	return a[0] > b[0] || (a[0] == b[0] && a[1] > b[1]);
}

static bool in_circle_strictly(const int32_t *a, const int32_t *b, const int32_t *c, const int32_t *d)
{
	int64_t s = circle(a, b, c, d);
	const int32_t *h = comes_later(a, b) ? a : b;

	if (s)
		return s > 0;
	h = comes_later(c, h) ? c : h;
	if (comes_later(d, h))
		return false;
	return h == c ? orient(a, b, d) > 0 : h == b ? orient(a, d, c) > 0 : orient(d, b, c) > 0;
}

/* d is below the plane through the lifted a, b, c. Ties: each height is raised, that of a later position by far more. */
static bool is_below(const struct mesh *m, const uint32_t v[4], bool *ret_tie)
{
	const int32_t *p[4], *d = m->vertex[v[3]];
	int64_t raise[4], det;
	unsigned order[4] = {0, 1, 2, 3};

	for (int i = 0; i < 4; i++)
		p[i] = m->vertex[v[i]];
	for (int i = 0; i < 3; i++)
		raise[i] = orient(d, p[(i + 1) % 3], p[(i + 2) % 3]);
	raise[3] = -(raise[0] + raise[1] + raise[2]);
	det = circle(p[0], p[1], p[2], d);
	for (int i = 0; i < 4; i++)
		det -= m->weight[v[i]] * raise[i];
	*ret_tie = det == 0;
	for (int i = 0; i < 4; i++)
		for (int k = i + 1; k < 4; k++)
			if (comes_later(p[order[k]], p[order[i]])) {
				unsigned o = order[i];

				order[i] = order[k];
				order[k] = o;
			}
	for (int i = 0; i < 4 && !det; i++)
		det = raise[order[i]];
	return det > 0;
}

static void triangulate(struct mesh *m)
{
	bool tie;
	uint32_t n = (uint32_t)m->nvertex;

	m->ntriangle = 0;
	for (uint32_t a = 0; a < n; a++) {
		for (uint32_t b = a + 1; b < n; b++) {
			for (uint32_t c = a + 1; c < n; c++) {
				bool empty = b != c && orient(m->vertex[a], m->vertex[b], m->vertex[c]) > 0;

				for (uint32_t d = 0; d < n && empty; d++)
					empty = d == a || d == b || d == c ||
						!(m->weighted ? is_below(m, (const uint32_t[4]){a, b, c, d}, &tie) :
								in_circle_strictly(m->vertex[a], m->vertex[b], m->vertex[c],
										   m->vertex[d]));
				if (!empty)
					continue;
				uint32_t *t = m->triangle[m->ntriangle++];

				t[0] = a;
				t[1] = b;
				t[2] = c;
			}
		}
	}
}

/* n distinct positions in [0, range) x [0, range). */
static struct mesh random_mesh(size_t n, int32_t range)
{
	struct mesh m = {.nvertex = 0};

	while (m.nvertex < n) {
		int32_t x = (int32_t)(rnd() % (uint64_t)range), y = (int32_t)(rnd() % (uint64_t)range);
		bool fresh = true;

		for (size_t i = 0; i < m.nvertex; i++)
			fresh = fresh && (m.vertex[i][0] != x || m.vertex[i][1] != y);
		if (!fresh)
			continue;
		m.vertex[m.nvertex][0] = x;
		m.vertex[m.nvertex][1] = y;
		m.vertex[m.nvertex++][2] = (int32_t)(rnd() % 100);
	}
	triangulate(&m);
	return m;
}

static struct verify_report verified(const struct mesh *m)
{
	struct verify_mesh v = {(const int32_t(*)[3])m->vertex, (const uint32_t(*)[3])m->triangle, m->nvertex, m->ntriangle};
	struct verify_report r;
	struct err err = ERR_INIT;

	v.weight = m->weighted ? m->weight : NULL;
	assert_int_equal(verify_mesh(&v, &r, &err), 0);
	return r;
}

static void fault_is(const struct mesh *m, enum verify_fault want)
{
	struct verify_report r = verified(m);

	if (r.fault != want)
		print_error("%s (%s), not %s\n", verify_fault_text(r.fault), r.text, verify_fault_text(want));
	assert_int_equal(r.fault, want);
	assert_int_equal(r.text[0] != '\0', want != VERIFY_GOOD);
}

/* A mesh suitable for faults: inner vertices, a triangle away from the boundary. */
static struct mesh mesh_for_faults(void)
{
	return random_mesh(30, 1000);
}

static void test_good(void **state)
{
	for (int round = 0; round < 150; round++) {
		struct mesh m = random_mesh(3 + rnd() % 30, round % 3 == 0 ? 7 : round % 3 == 1 ? 30 : 2000);
		struct verify_report r = verified(&m);

		if (!m.ntriangle)
			continue; /* collinear */
		assert_int_equal(r.fault, VERIFY_GOOD);
		assert_int_equal(m.ntriangle, 2 * m.nvertex - 2 - r.hull);
		assert_int_equal(r.edges, r.inner + r.hull);
	}
	(void)state;
}

/* A piece in place of a diagonal: the two triangles of a convex quadrilateral the other way round. */
static void test_pieces(void **state)
{
	static const int32_t vertex[4][3] = {{0, 0, 1}, {10, 0, 2}, {11, 9, 3}, {0, 10, 4}};
	/* Delaunay has the side from 1 to 3. */
	static const uint32_t triangle[2][3] = {{0, 1, 2}, {2, 3, 0}};
	static const struct {
		uint8_t edges[2];
		enum verify_fault fault;
	} rows[] = {
		{{1 << 1, 1 << 1}, VERIFY_GOOD}, {{0, 0}, VERIFY_DELAUNAY},           {{1 << 1, 0}, VERIFY_PIECE},
		{{0, 1 << 1}, VERIFY_PIECE},     {{1 << 0, 1 << 0}, VERIFY_DELAUNAY}, {{1 << 1 | 1, 1 << 1}, VERIFY_GOOD},
	};

	(void)state;
	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct verify_mesh m = {vertex, triangle, 4, 2, .edges = rows[i].edges};
		struct verify_report r;
		struct err err = ERR_INIT;

		assert_int_equal(verify_mesh(&m, &r, &err), 0);
		assert_int_equal(r.fault, rows[i].fault);
		assert_int_equal(r.pieces, __builtin_popcount(rows[i].edges[0] & 5) + __builtin_popcount(rows[i].edges[1] & 5) +
						   ((rows[i].edges[0] | rows[i].edges[1]) >> 1 & rows[i].edges[0] >> 1 & 1));
	}
}

/* Ends of pieces need not be points, and points may be missing; other vertices must be points. */
static void test_points_beside_lines(void **state)
{
	static const int32_t vertex[4][3] = {{0, 0, 1}, {10, 0, 2}, {11, 9, 3}, {0, 10, 4}};
	static const uint32_t triangle[2][3] = {{0, 1, 2}, {2, 3, 0}};
	static const uint8_t edges[2] = {1 << 1, 1 << 1};
	static const struct {
		struct point pts[3];
		enum verify_fault fault;
	} rows[] = {
		{{{.x = 10, .y = 0, .z = 2}, {.x = 0, .y = 10, .z = 4}, {.x = 5, .y = 4, .z = 9}}, VERIFY_GOOD},
		{{{.x = 10, .y = 0, .z = 2}, {.x = 0, .y = 10, .z = 4}, {.x = 0, .y = 0, .z = 9}}, VERIFY_GOOD},
		{{{.x = 10, .y = 0, .z = 7}, {.x = 0, .y = 10, .z = 4}, {.x = 5, .y = 4, .z = 9}}, VERIFY_HEIGHT},
		{{{.x = 10, .y = 0, .z = 2}, {.x = 5, .y = 5, .z = 4}, {.x = 5, .y = 4, .z = 9}}, VERIFY_EXTRA},
	};

	(void)state;
	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct verify_mesh m = {vertex, triangle, 4, 2, .edges = edges};
		const struct view view = VIEW_INIT;
		struct verify_report r = {0};
		struct err err = ERR_INIT;
		struct point pts[3];

		memcpy(pts, rows[i].pts, sizeof pts);
		assert_int_equal(verify_points(&m, &view, pts, 3, &r, &err), 0);
		assert_int_equal(r.fault, rows[i].fault);
	}
}

static void test_empty(void **state)
{
	struct mesh m = {.nvertex = 0};

	fault_is(&m, VERIFY_GOOD);
	for (int32_t i = 0; i < 4; i++)
		memcpy(m.vertex[i], (int32_t[3]){i * 7, i * -3, i}, sizeof m.vertex[i]);
	for (m.nvertex = 1; m.nvertex <= 4; m.nvertex++)
		fault_is(&m, VERIFY_GOOD); /* a line has vertices only */
	m.nvertex = 4;
	m.vertex[3][1]++;
	fault_is(&m, VERIFY_UNUSED);
	(void)state;
}

static void test_index(void **state)
{
	struct mesh m = mesh_for_faults();

	m.triangle[5][1] = (uint32_t)m.nvertex;
	fault_is(&m, VERIFY_INDEX);
	m = mesh_for_faults();
	m.triangle[5][1] = m.triangle[5][2];
	fault_is(&m, VERIFY_INDEX);
	(void)state;
}

static void test_orientation(void **state)
{
	struct mesh m = mesh_for_faults(), flat = {.vertex = {{0, 0, 0}, {1, 1, 0}, {2, 2, 0}}, .nvertex = 3, .ntriangle = 1};
	uint32_t t = m.triangle[7][0];

	m.triangle[7][0] = m.triangle[7][1];
	m.triangle[7][1] = t;
	fault_is(&m, VERIFY_ORIENTATION);
	flat.triangle[0][1] = 1;
	flat.triangle[0][2] = 2;
	fault_is(&flat, VERIFY_ORIENTATION);
	flat.vertex[0][0] = flat.vertex[0][1] = INT32_MIN; /* the full range; off the line by one */
	flat.vertex[1][0] = flat.vertex[1][1] = INT32_MAX;
	flat.vertex[2][0] = -1;
	flat.vertex[2][1] = 0;
	fault_is(&flat, VERIFY_GOOD);
	flat.vertex[2][1] = -1;
	fault_is(&flat, VERIFY_ORIENTATION);
	(void)state;
}

static void test_edge(void **state)
{
	struct mesh m = mesh_for_faults();

	memcpy(m.triangle[m.ntriangle++], m.triangle[3], sizeof m.triangle[3]);
	fault_is(&m, VERIFY_EDGE);
	(void)state;
}

static void test_unused(void **state)
{
	struct mesh m = mesh_for_faults();

	m.nvertex++;
	fault_is(&m, VERIFY_UNUSED);
	(void)state;
}

static bool on_rim(const struct mesh *m, uint32_t v)
{
	size_t leaving = 0, closed = 0;

	for (size_t t = 0; t < m->ntriangle; t++) {
		for (int i = 0; i < 3; i++) {
			if (m->triangle[t][i] != v)
				continue;
			uint32_t b = m->triangle[t][(i + 1) % 3];

			leaving++;
			for (size_t u = 0; u < m->ntriangle; u++)
				for (int k = 0; k < 3; k++)
					closed += m->triangle[u][k] == b && m->triangle[u][(k + 1) % 3] == v;
		}
	}
	return leaving != closed;
}

static void drop_triangle(struct mesh *m, size_t t)
{
	memcpy(m->triangle[t], m->triangle[--m->ntriangle], sizeof m->triangle[t]);
}

static void test_boundary(void **state)
{
	struct mesh m = mesh_for_faults(), two = random_mesh(10, 500);
	size_t t = 0, n = two.nvertex;

	while (on_rim(&m, m.triangle[t][0]) || on_rim(&m, m.triangle[t][1]) || on_rim(&m, m.triangle[t][2]))
		t++;
	drop_triangle(&m, t); /* a hole */
	fault_is(&m, VERIFY_BOUNDARY);
	for (size_t i = 0; i < n; i++) { /* the same mesh again, beside it */
		memcpy(two.vertex[n + i], two.vertex[i], sizeof two.vertex[i]);
		two.vertex[n + i][0] += 1000;
	}
	n = two.ntriangle;
	for (size_t i = 0; i < n; i++)
		for (int k = 0; k < 3; k++)
			two.triangle[n + i][k] = two.triangle[i][k] + (uint32_t)two.nvertex;
	two.nvertex *= 2;
	two.ntriangle *= 2;
	fault_is(&two, VERIFY_BOUNDARY);
	m = random_mesh(30, 1000);
	for (t = 0; t < m.ntriangle; t++) { /* a notch that reaches the boundary again at its tip */
		struct mesh cut = m;
		const uint32_t *v = m.triangle[t];
		int rim = on_rim(&m, v[0]) + on_rim(&m, v[1]) + on_rim(&m, v[2]);

		drop_triangle(&cut, t);
		if (rim == 1)
			fault_is(&cut, VERIFY_BOUNDARY);
	}
	(void)state;
}

static const int32_t ring[12][2] = {{12, 0},  {10, 6},   {6, 10},   {0, 12},  {-6, 10}, {-10, 6},
				    {-12, 0}, {-10, -6}, {-6, -10}, {0, -12}, {6, -10}, {10, -6}};

/* A ribbon of two rows that winds more than once, with two of its inner vertices (at the same position) identified:
 * each edge, angle and the single boundary loop are in order, but it is not a disc. */
static void test_euler(void **state)
{
	enum { STEPS = 19 };
	static int32_t vertex[3 * STEPS][3];
	static uint32_t triangle[4 * STEPS][3];
	struct verify_mesh m = {(const int32_t(*)[3])vertex, (const uint32_t(*)[3])triangle, 3 * STEPS, 0};
	struct verify_report r;
	struct err err = ERR_INIT;

	for (uint32_t s = 0; s < STEPS; s++)
		for (uint32_t row = 0; row < 3; row++) /* row 0 is outside */
			for (int a = 0; a < 2; a++)
				vertex[3 * s + row][a] = ring[s % 12][a] * (int32_t)(4 - row);
	for (uint32_t s = 0; s + 1 < STEPS; s++) {
		for (uint32_t row = 0; row < 2; row++) {
			uint32_t a = 3 * s + row, b = a + 3;
			uint32_t quad[2][3] = {{a, b, a + 1}, {b, b + 1, a + 1}};

			memcpy(triangle[m.ntriangle], quad, sizeof quad);
			m.ntriangle += 2;
		}
	}
	assert_int_equal(verify_mesh(&m, &r, &err), 0);
	assert_int_equal(r.fault, VERIFY_CONVEX); /* a disc, although an odd one */
	for (size_t t = 0; t < m.ntriangle; t++)
		for (int i = 0; i < 3; i++) {
			if (triangle[t][i] == 3 * 15 + 1)
				triangle[t][i] = 3 * 3 + 1; /* one turn earlier */
			else if (triangle[t][i] == 3 * STEPS - 1)
				triangle[t][i] = 3 * 15 + 1; /* the number that became free */
		}
	memcpy(vertex[3 * 15 + 1], vertex[3 * STEPS - 1], sizeof vertex[0]);
	m.nvertex--;
	assert_int_equal(verify_mesh(&m, &r, &err), 0);
	assert_int_equal(r.fault, VERIFY_EULER);
	(void)state;
}

static void test_convex(void **state)
{
	struct mesh m = mesh_for_faults(), fan = {.nvertex = 25, .ntriangle = 24};
	int seen = 0;

	for (size_t t = 0; t < m.ntriangle; t++) {
		struct mesh cut = m;
		const uint32_t *v = m.triangle[t];

		if (on_rim(&m, v[0]) + on_rim(&m, v[1]) + on_rim(&m, v[2]) != 2)
			continue;
		drop_triangle(&cut, t);
		struct verify_report r = verified(&cut);

		assert_int_not_equal(r.fault, VERIFY_GOOD);
		seen += r.fault == VERIFY_CONVEX;
	}
	assert_true(seen > 0);
	for (uint32_t i = 0; i < 24; i++) { /* a fan that goes around its middle twice */
		memcpy(fan.vertex[i + 1], ring[i % 12], sizeof ring[0]);
		fan.triangle[i][1] = i + 1;
		fan.triangle[i][2] = (i + 1) % 24 + 1;
	}
	struct verify_report r = verified(&fan);

	assert_int_equal(r.fault, VERIFY_CONVEX);
	assert_non_null(strstr(r.text, "turns 2 times"));
	fan.nvertex = 14; /* once around, slit open from the middle to the rim */
	fan.ntriangle = 12;
	r = verified(&fan);
	assert_int_equal(r.fault, VERIFY_CONVEX);
	assert_string_equal(r.text, "the boundary is not convex at vertex 0");
	(void)state;
}

/* The other diagonal of triangles t and u, across side k / 3 of t and side k % 3 of u, if that makes two triangles. */
static bool flip(const struct mesh *m, size_t t, size_t u, int k, struct mesh *ret, uint32_t ret_quad[4])
{
	const uint32_t *p = m->triangle[t], *q = m->triangle[u];
	uint32_t a = p[k / 3], b = p[(k / 3 + 1) % 3], c = p[(k / 3 + 2) % 3], d = q[(k + 2) % 3];

	if (q[k % 3] != b || q[(k + 1) % 3] != a || orient(m->vertex[c], m->vertex[a], m->vertex[d]) <= 0 ||
	    orient(m->vertex[d], m->vertex[b], m->vertex[c]) <= 0)
		return false;
	*ret = *m;
	memcpy(ret->triangle[t], (uint32_t[3]){c, a, d}, sizeof ret->triangle[0]);
	memcpy(ret->triangle[u], (uint32_t[3]){d, b, c}, sizeof ret->triangle[0]);
	memcpy(ret_quad, (uint32_t[4]){a, b, c, d}, 4 * sizeof *ret_quad);
	return true;
}

/* The other diagonal of each pair of neighbours that form a convex quadrilateral. */
static void test_delaunay_and_tie(void **state)
{
	int flips[2] = {0, 0};

	for (int round = 0; round < 40; round++) {
		struct mesh m = random_mesh(20, round % 2 ? 6 : 500);

		for (size_t t = 0; t < m.ntriangle; t++) {
			for (size_t u = 0; u < m.ntriangle; u++) {
				for (int k = 0; k < 9; k++) {
					struct mesh bad;
					uint32_t v[4];

					if (!flip(&m, t, u, k, &bad, v))
						continue;
					bool tie = circle(m.vertex[v[0]], m.vertex[v[1]], m.vertex[v[2]], m.vertex[v[3]]) == 0;

					fault_is(&bad, tie ? VERIFY_TIE : VERIFY_DELAUNAY);
					flips[tie]++;
				}
			}
		}
	}
	assert_true(flips[0] > 100 && flips[1] > 100);
	(void)state;
}

/* A mesh with weights, without the vertices that are hidden; *ret_hidden: how many. */
static struct mesh weighted_mesh(size_t n, int32_t range, size_t *ret_hidden)
{
	struct mesh m = random_mesh(n, range);
	uint32_t to[MOST], kept = 0;
	bool used[MOST] = {false};
	int64_t one = (int64_t)(rnd() % 4);

	m.weighted = true;
	for (size_t v = 0; v < m.nvertex; v++) {
		int64_t radius = rnd() % 2 ? 0 : range > 6 ? (int64_t)(rnd() % (uint64_t)range) : one;

		m.weight[v] = radius * radius;
	}
	triangulate(&m);
	for (size_t t = 0; t < m.ntriangle; t++)
		for (int k = 0; k < 3; k++)
			used[m.triangle[t][k]] = true;
	for (size_t v = 0; v < m.nvertex && m.ntriangle; v++) {
		if (!used[v])
			continue;
		memcpy(m.vertex[kept], m.vertex[v], sizeof m.vertex[0]);
		m.weight[kept] = m.weight[v];
		to[v] = kept++;
	}
	*ret_hidden = m.ntriangle ? m.nvertex - kept : 0;
	m.nvertex = m.ntriangle ? kept : m.nvertex;
	for (size_t t = 0; t < m.ntriangle; t++)
		for (int k = 0; k < 3; k++)
			m.triangle[t][k] = to[m.triangle[t][k]];
	return m;
}

/* A mesh with weights, then with one edge flipped, with one weight changed, and without weights. */
static void test_weights(void **state)
{
	size_t all = 0, flips[2] = {0, 0}, changed = 0, plain = 0;

	for (int round = 0; round < 200; round++) {
		size_t hidden;
		struct mesh m = weighted_mesh(3 + rnd() % 20, round % 3 == 0 ? 6 : round % 3 == 1 ? 20 : 600, &hidden), bad;
		uint32_t quad[4];
		bool tie;

		if (!m.ntriangle)
			continue;
		fault_is(&m, VERIFY_GOOD);
		all += hidden;
		for (size_t t = 0; t < m.ntriangle; t++)
			for (size_t u = 0; u < m.ntriangle; u++)
				for (int k = 0; k < 9; k++) {
					if (!flip(&m, t, u, k, &bad, quad))
						continue;
					is_below(&m, quad, &tie);
					fault_is(&bad, tie ? VERIFY_TIE : VERIFY_POWER);
					flips[tie]++;
				}
		bad = m;
		bad.weight[rnd() % m.nvertex] += 1 << 20;
		changed += verified(&bad).fault == VERIFY_POWER;
		bad = m;
		bad.weighted = false;
		plain += verified(&bad).fault == VERIFY_DELAUNAY;
	}
	assert_true(all > 300 && flips[0] > 500 && flips[1] > 30 && changed > 100 && plain > 50);
	(void)state;
}

/* The kernel's predicate has other arithmetic. Few places, and the full range with the greatest weights. */
static void test_power(void **state)
{
	uint64_t ties = 0;

	for (int round = 0; round < 400000; round++) {
		static const int64_t weights[4] = {0, 1, 25, GEOM_WEIGHT_MOST};
		static const int32_t ends[6] = {INT32_MIN, INT32_MIN + 1, -1, 0, INT32_MAX - 1, INT32_MAX};
		int32_t at[4][3] = {{0}};
		const int32_t *p[4] = {at[0], at[1], at[2], at[3]};
		struct geom_weighted g[4];
		int64_t w[4];
		bool tie, distinct = true;

		for (int i = 0; i < 4; i++) {
			for (int k = 0; k < 2; k++)
				at[i][k] = round % 3 == 0 ? (int32_t)(rnd() % 7) :
					   round % 3 == 1 ? (int32_t)rnd() :
							    ends[rnd() % 6];
			w[i] = weights[rnd() % (round % 3 ? 4 : 2)];
			g[i] = (struct geom_weighted){at[i], w[i]};
			for (int k = 0; k < i; k++)
				distinct = distinct && memcmp(at[i], at[k], sizeof at[0]);
		}
		if (!distinct || geom_orient(at[0], at[1], at[2]) <= 0)
			continue;
		assert_int_equal(verify_power(p, w, &tie), geom_power(g[0], g[1], g[2], g[3]));
		ties += tie;
	}
	assert_true(ties > 500);
	(void)state;
}

/* Differences of 2^32: intermediate values exceed 2^127. Centre and three corners, then moved off. */
static void test_full_range(void **state)
{
	struct mesh m = {.nvertex = 4, .ntriangle = 2, .triangle = {{0, 1, 3}, {0, 3, 2}}};
	const int32_t lo = INT32_MIN, hi = INT32_MAX;
	const int32_t square[4][3] = {{lo, lo, 0}, {hi, lo, 0}, {lo, hi, 0}, {hi, hi, 0}};

	memcpy(m.vertex, square, sizeof square);
	fault_is(&m, VERIFY_TIE); /* from lower left to upper right: touches the last vertex */
	m.vertex[1][0]--;         /* the corners 0 3 and 1 2 no longer on one circle */
	fault_is(&m, VERIFY_DELAUNAY);
	m.vertex[1][0]++;
	m.vertex[3][0]--;
	fault_is(&m, VERIFY_GOOD);
	(void)state;
}

static enum verify_fault compared(const struct mesh *m, const struct view *view, struct point *pts, size_t n,
				  struct verify_report *r)
{
	struct verify_mesh v = {(const int32_t(*)[3])m->vertex, (const uint32_t(*)[3])m->triangle, m->nvertex, m->ntriangle};
	struct err err = ERR_INIT;

	*r = verified(m);
	assert_int_equal(r->fault, VERIFY_GOOD);
	assert_int_equal(verify_points(&v, view, pts, n, r, &err), 0);
	return r->fault;
}

static size_t points_of(const struct mesh *m, struct point *pts)
{
	for (size_t i = 0; i < m->nvertex; i++)
		pts[i] = (struct point){m->vertex[i][0], m->vertex[i][1], m->vertex[i][2], 2, 0x11, 0};
	return m->nvertex;
}

static void test_points(void **state)
{
	struct mesh m = mesh_for_faults();
	struct view lowest = VIEW_INIT, highest = VIEW_INIT;
	struct point pts[MOST + 4];
	struct verify_report r;
	size_t n = points_of(&m, pts);

	highest.duplicates = VIEW_HIGHEST;
	assert_int_equal(compared(&m, &lowest, pts, n, &r), VERIFY_GOOD);
	assert_true(r.points == n && r.positions == n);
	pts[n] = pts[n / 2];
	pts[n].z += 5; /* a duplicate above */
	assert_int_equal(compared(&m, &lowest, pts, n + 1, &r), VERIFY_GOOD);
	assert_true(r.points == n + 1 && r.positions == n);
	n = points_of(&m, pts);
	pts[n] = pts[n / 2];
	pts[n].z += 5;
	assert_int_equal(compared(&m, &highest, pts, n + 1, &r), VERIFY_HEIGHT);
	n = points_of(&m, pts);
	pts[3].z++;
	assert_int_equal(compared(&m, &lowest, pts, n, &r), VERIFY_HEIGHT);
	assert_true(r.place[0] == m.vertex[3][0] && r.place[1] == m.vertex[3][1]);
	n = points_of(&m, pts);
	pts[n] = (struct point){5000, 5000, 0, 0, 0, 0};
	assert_int_equal(compared(&m, &lowest, pts, n + 1, &r), VERIFY_MISSING);
	assert_int_equal(r.place[0], 5000);
	n = points_of(&m, pts);
	assert_int_equal(compared(&m, &lowest, pts, n - 1, &r), VERIFY_EXTRA);
	assert_int_equal(r.place[0], m.vertex[n - 1][0]);
	assert_int_equal(compared(&m, &lowest, pts, 0, &r), VERIFY_EXTRA);
	(void)state;
}

static void test_points_without_mesh(void **state)
{
	struct mesh none = {.nvertex = 0};
	struct view view = VIEW_INIT;
	struct point pts[5];
	struct verify_report r;

	for (int i = 0; i < 5; i++)
		pts[i] = (struct point){i * 3, i * 2, i, 0, 0, 0};
	assert_int_equal(compared(&none, &view, pts, 5, &r), VERIFY_MISSING);
	assert_int_equal(compared(&none, &view, pts, 0, &r), VERIFY_GOOD);
	for (none.nvertex = 0; none.nvertex < 5; none.nvertex++)
		memcpy(none.vertex[none.nvertex], (int32_t[3]){pts[none.nvertex].x, pts[none.nvertex].y, pts[none.nvertex].z},
		       12);
	assert_int_equal(compared(&none, &view, pts, 5, &r), VERIFY_GOOD);
	none.nvertex = 4;
	assert_int_equal(compared(&none, &view, pts, 5, &r), VERIFY_MISSING);
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_good),
		cmocka_unit_test(test_pieces),
		cmocka_unit_test(test_points_beside_lines),
		cmocka_unit_test(test_empty),
		cmocka_unit_test(test_index),
		cmocka_unit_test(test_orientation),
		cmocka_unit_test(test_edge),
		cmocka_unit_test(test_unused),
		cmocka_unit_test(test_boundary),
		cmocka_unit_test(test_euler),
		cmocka_unit_test(test_convex),
		cmocka_unit_test(test_delaunay_and_tie),
		cmocka_unit_test(test_weights),
		cmocka_unit_test(test_power),
		cmocka_unit_test(test_full_range),
		cmocka_unit_test(test_points),
		cmocka_unit_test(test_points_without_mesh),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
