/*
 * Pixels against brute force: every centre by the signs of all edges, every height as a fraction.
 *
 * The meshes are made by inserting points into one or two triangles, so slivers, points on edges, and centres on edges and
 * vertices are everyday.
 */
#include <gmp.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "dem_priv.h"
#include "area_code.h"
#include "err.h"
#include "outfile.h"
#include "random.h"
#include "repeat.h"

typedef __int128 i128;

enum { MOST = 120 };
struct mesh {
	int32_t vertex[MOST][3];
	unsigned nvertex;
	uint32_t triangle[2 * MOST][3];
	unsigned ntriangle, nstart; /* the first ones, before any point was inserted */
	uint32_t start[2][3];
};

static uint64_t seed;

static i128 cross(const int32_t *a, const int32_t *b, i128 x, i128 y, i128 unit)
{
	return ((i128)b[0] - a[0]) * (y - a[1] * unit) - ((i128)b[1] - a[1]) * (x - a[0] * unit);
}

static int32_t height_below(int32_t most)
{
	return (int32_t)((int64_t)random_below(&seed, 2 * (uint64_t)most + 1) - most);
}

/* Splits the triangles that have the point. */
static void insert(struct mesh *m, int32_t x, int32_t y, int32_t z)
{
	unsigned n = m->ntriangle, v = m->nvertex;

	for (unsigned i = 0; i < v; i++)
		if (m->vertex[i][0] == x && m->vertex[i][1] == y)
			return;
	memcpy(m->vertex[v], (int32_t[3]){x, y, z}, sizeof(m->vertex[v]));
	for (unsigned i = 0; i < n; i++) {
		uint32_t t[3], part[3][3];
		int on = -1;
		bool inside = true;

		memcpy(t, m->triangle[i], sizeof(t));
		for (int k = 0; k < 3; k++) {
			i128 side = cross(m->vertex[t[k]], m->vertex[t[(k + 1) % 3]], x, y, 1);
			inside &= side >= 0;
			on = side == 0 ? k : on;
			memcpy(part[k], (uint32_t[3]){t[k], t[(k + 1) % 3], v}, sizeof(part[k]));
		}
		if (!inside)
			continue;
		m->nvertex = v + 1;
		for (int k = 0, first = 1; k < 3; k++) {
			if (k == on)
				continue;
			memcpy(first ? m->triangle[i] : m->triangle[m->ntriangle++], part[k], sizeof(part[k]));
			first = 0;
		}
	}
}

static void make_mesh(struct mesh *m, int32_t range, int32_t unit, int32_t height)
{
	int32_t side = 1 + (int32_t)random_below(&seed, (uint64_t)range);
	int32_t corner[4][2] = {{0, 0}, {side, 0}, {side, side}, {0, side}};
	unsigned points = (unsigned)random_below(&seed, 30);

	memset(m, 0, sizeof(*m));
	for (int i = 0; i < 4; i++) {
		memcpy(m->vertex[i], corner[i], sizeof(corner[i]));
		m->vertex[i][2] = height_below(height);
	}
	m->nvertex = 4;
	memcpy(m->triangle[0], (uint32_t[3]){0, 1, 2}, 12);
	memcpy(m->triangle[1], (uint32_t[3]){2, 3, 0}, 12);
	m->ntriangle = m->nstart = 2 - (unsigned)random_below(&seed, 2);
	memcpy(m->start, m->triangle, sizeof(m->start));
	while (points--)
		insert(m, (int32_t)random_below(&seed, (uint64_t)side + 1), (int32_t)random_below(&seed, (uint64_t)side + 1),
		       height_below(height));
	for (unsigned i = 0; i < m->nvertex; i++) {
		m->vertex[i][0] = (m->vertex[i][0] - range / 2) * unit;
		m->vertex[i][1] = (m->vertex[i][1] - range / 2) * unit;
	}
}

/* Of a centre at x / (2q), y / (2q) lattice units, relative to `k`. */
static bool owns(const struct mesh *m, const uint32_t t[3], i128 x, i128 y, i128 q2)
{
	for (int i = 0; i < 3; i++) {
		const int32_t *a = m->vertex[t[i]], *b = m->vertex[t[(i + 1) % 3]];
		i128 side = cross(a, b, x, y, q2);
		bool falls = b[1] < a[1], west = b[1] == a[1] && b[0] < a[0];

		if (side < 0 || (side == 0 && !falls && !west))
			return false;
	}
	return true;
}

static void set128(mpz_t z, i128 v)
{
	unsigned __int128 u = v < 0 ? -(unsigned __int128)v : (unsigned __int128)v;
	uint64_t word[2] = {(uint64_t)u, (uint64_t)(u >> 64)};

	mpz_import(z, 2, -1, 8, 0, 0, word);
	if (v < 0)
		mpz_neg(z, z);
}

/* The float nearest to a fraction, by comparing it with those around. */
static float nearest(const mpq_t exact)
{
	float best = (float)mpq_get_d(exact), near[3] = {nextafterf(best, -INFINITY), best, nextafterf(best, INFINITY)};
	mpq_t off, least;

	mpq_inits(off, least, NULL);
	for (int i = 0; i < 3; i++) {
		uint32_t bits;
		int side;

		mpq_set_d(off, near[i]);
		mpq_sub(off, off, exact);
		mpq_abs(off, off);
		side = i ? mpq_cmp(off, least) : -1;
		memcpy(&bits, &near[i], sizeof(bits));
		if (side < 0 || (side == 0 && !(bits & 1))) {
			best = near[i];
			mpq_set(least, off);
		}
	}
	mpq_clears(off, least, NULL);
	return best;
}

static void set_decimal(mpq_t q, struct decimal d)
{
	mpz_ui_pow_ui(mpq_denref(q), 10, d.exponent < 0 ? (unsigned long)-d.exponent : 0);
	mpz_ui_pow_ui(mpq_numref(q), 10, d.exponent > 0 ? (unsigned long)d.exponent : 0);
	mpz_mul_si(mpq_numref(q), mpq_numref(q), d.mantissa);
	mpq_canonicalize(q);
}

/* Heights in barycentric coordinates. */
static float height(const struct mesh *m, const uint32_t t[3], i128 x, i128 y, i128 q2, int64_t k, struct decimal scale,
		    const struct dem_options *opt)
{
	mpq_t sum, part;
	i128 whole = 0;
	float ret;

	mpq_inits(sum, part, NULL);
	for (int i = 0; i < 3; i++) {
		i128 w = cross(m->vertex[t[(i + 1) % 3]], m->vertex[t[(i + 2) % 3]], x, y, q2);

		whole += w;
		set128(mpq_numref(part), w);
		mpz_set_ui(mpq_denref(part), 1);
		mpz_mul_si(mpq_numref(part), mpq_numref(part), m->vertex[t[i]][2] + k);
		mpq_add(sum, sum, part);
	}
	set128(mpq_numref(part), whole);
	mpz_set_ui(mpq_denref(part), 1);
	mpq_div(sum, sum, part);
	set_decimal(part, scale);
	mpq_mul(sum, sum, part);
	mpq_set_si(part, opt->z_num, (unsigned long)opt->z_den);
	mpq_canonicalize(part);
	mpq_mul(sum, sum, part);
	ret = nearest(sum);
	mpq_clears(sum, part, NULL);
	return ret;
}

static const char *const scales[] = {"1", "0.01", "0.001", "0.25", "3", "1e2"};
static const struct decimal cells[] = {{1, 0}, {2, 0}, {3, 0}, {5, -1}, {25, -1}, {7, 0}, {3, -1}};
static const int64_t units[][2] = {{1, 1}, {1250, 381}, {381, 1250}, {3937, 1200}, {1200, 3937}};

/* The pixel of local numbers; NAN where nothing was drawn. */
static float pixel(const struct dem *d, int64_t x, int64_t y)
{
	uint64_t row = (uint64_t)(d->grid.count[1] - 1 - y);
	struct err err = ERR_INIT;
	float *tile;

	assert_int_equal(dem_store_tile(d->store, (uint32_t)(x / DEM_TILE), (uint32_t)(row / DEM_TILE), true, &tile, &err), 0);
	return tile ? tile[row % DEM_TILE * DEM_TILE + (uint64_t)x % DEM_TILE] : NAN;
}

struct made {
	struct mesh mesh;
	struct dem_options opt;
	struct acut_mesh_head head;
	struct decimal scale_z;
	char view[200];
	bool windowed;
	int64_t window[4];
};

static void make(struct made *c)
{
	int32_t range = 1 + (int32_t)random_below(&seed, 14), unit = 1, half = range / 2;
	const int64_t *ratio = units[random_below(&seed, 3) ? 0 : random_below(&seed, 5)];
	const int64_t *ratio_z = units[random_below(&seed, 3) ? 0 : random_below(&seed, 5)];

	memset(c, 0, sizeof(*c));
	if (!random_below(&seed, 4))
		unit = (int32_t)(INT32_MAX / 16 - (int64_t)random_below(&seed, 100));
	make_mesh(&c->mesh, range, unit, random_below(&seed, 3) ? 1000 : INT32_MAX);
	c->head = (struct acut_mesh_head){.scale_xy = scales[random_below(&seed, 6)], .scale_z = scales[random_below(&seed, 6)]};
	for (int i = 0; i < 3; i++)
		c->head.k[i] = random_below(&seed, 2) ? 0 : (int64_t)random_below(&seed, 2000000000) - 1000000000;
	for (int i = 0; i < 2; i++) {
		c->head.box[i] = -(half + (int32_t)random_below(&seed, 2)) * unit;
		c->head.box[i + 3] = (range - half + (int32_t)random_below(&seed, 2)) * unit;
	}
	c->opt = (struct dem_options){.cell = cells[random_below(&seed, 7)],
				      .cell_num = ratio[0],
				      .cell_den = ratio[1],
				      .z_num = ratio_z[0],
				      .z_den = ratio_z[1],
				      .cache = 2};
	assert_true(decimal_parse(c->head.scale_xy, &c->scale_z));
	c->opt.cell.mantissa *= c->scale_z.mantissa * unit;
	c->opt.cell.exponent += c->scale_z.exponent;
	assert_true(decimal_parse(c->head.scale_z, &c->scale_z));
	c->windowed = !random_below(&seed, 3);
	for (int i = 0; i < 4; i++)
		c->window[i] = c->head.k[i & 1] + ((int64_t)random_below(&seed, (uint64_t)range + 2) - half) * unit;
	for (int i = 0; i < 2; i++) {
		int64_t low = c->window[i] < c->window[i + 2] ? c->window[i] : c->window[i + 2];

		c->window[i + 2] ^= c->window[i] ^ low;
		c->window[i] = low;
	}
	snprintf(c->view, sizeof(c->view), "view 1 window=box:%lld,%lld,%lld,%lld", (long long)c->window[0],
		 (long long)c->window[1], (long long)c->window[2], (long long)c->window[3]);
	if (c->windowed)
		c->head.view = c->view;
}

/* The centre, a little to the east and south, in the window. */
static bool in_window(const struct made *c, i128 x, i128 y, i128 q2)
{
	return !c->windowed || (x >= (c->window[0] - c->head.k[0]) * q2 && x < (c->window[2] - c->head.k[0]) * q2 &&
				y > (c->window[1] - c->head.k[1]) * q2 && y <= (c->window[3] - c->head.k[1]) * q2);
}

static void check(const struct made *c, const struct dem *d)
{
	const struct dem_grid *g = &d->grid;
	const struct mesh *m = &c->mesh;
	i128 q2 = 2 * g->q;

	for (int64_t y = 0; y < g->count[1]; y++) {
		for (int64_t x = 0; x < g->count[0]; x++) {
			i128 cx = (2 * (i128)(g->first[0] + x) + 1) * g->p - q2 * c->head.k[0];
			i128 cy = (2 * (i128)(g->first[1] + y) + 1) * g->p - q2 * c->head.k[1];
			const uint32_t *owner = NULL;
			unsigned owners = 0, inside = 0;
			float got = pixel(d, x, y), want;

			for (unsigned i = 0; i < m->nstart; i++)
				inside += owns(m, m->start[i], cx, cy, q2);
			for (unsigned i = 0; i < m->ntriangle; i++)
				if (owns(m, m->triangle[i], cx, cy, q2)) {
					owners++;
					owner = m->triangle[i];
				}
			assert_int_equal(owners, inside);
			if (!owner || !in_window(c, cx, cy, q2)) {
				assert_true(isnan(got));
				continue;
			}
			want = height(m, owner, cx, cy, q2, c->head.k[2], c->scale_z, &c->opt);
			assert_memory_equal(&got, &want, sizeof(got));
		}
	}
}

static void one(uint64_t number, uint64_t *pixels)
{
	struct outfile *out = NULL;
	struct dem *d = NULL;
	struct made c;
	struct err err = ERR_INIT;
	char path[] = "/dev/null";

	seed = number;
	make(&c);
	assert_int_equal(outfile_new(path, false, &out, &err), 0);
	assert_int_equal(dem_new(out, &d, &err), 0);
	assert_int_equal(dem_head(d, &c.head, &c.opt, &err), 0);
	for (unsigned i = 0; i < c.mesh.ntriangle; i++) {
		const uint32_t *t = c.mesh.triangle[i];
		unsigned turn = (unsigned)random_below(&seed, 3);

		assert_int_equal(dem_triangle(d, c.mesh.vertex[t[turn]], c.mesh.vertex[t[(turn + 1) % 3]],
					      c.mesh.vertex[t[(turn + 2) % 3]], &err),
				 0);
	}
	if (d->grid.count[0] * d->grid.count[1] < 2000) {
		check(&c, d);
		*pixels += (uint64_t)(d->grid.count[0] * d->grid.count[1]);
	}
	dem_free(d);
	outfile_free(out);
}

static void test_brute_force(void **state)
{
	uint64_t first = repeat_first(), n = repeat_cases(20000), pixels = 0;

	for (uint64_t i = first; i < first + n; i++)
		one(i, &pixels);
	assert_true(pixels > n);
}

/* Heights in the middle between two floats, of both signs and nearly zero, go through the fraction. */
static void test_ties(void **state)
{
	const int32_t heights[][2] = {
		{1 << 24, (1 << 24) + 2}, {(1 << 24) + 2, (1 << 24) + 4}, {-(1 << 24) - 2, -(1 << 24)}, {-3, 3}};
	const float want[] = {(1 << 24), (1 << 24) + 4, -(1 << 24), 0};

	for (int i = 0; i < 4; i++) {
		const struct acut_mesh_head head = {.scale_xy = "1", .scale_z = "1", .box = {0, 0, 0, 2, 2, 0}};
		const struct dem_options opt = {.cell = {2, 0}, .cell_num = 1, .cell_den = 1, .z_num = 1, .z_den = 1};
		/* The centre (1, 1) is in the middle of the edge from a to b. */
		const int32_t a[3] = {0, 0, heights[i][0]}, b[3] = {2, 2, heights[i][1]}, c[3] = {2, 0, 7};
		struct outfile *out = NULL;
		struct dem *d = NULL;
		struct err err = ERR_INIT;
		float got;

		assert_int_equal(outfile_new("/dev/null", false, &out, &err), 0);
		assert_int_equal(dem_new(out, &d, &err), 0);
		assert_int_equal(dem_head(d, &head, &opt, &err), 0);
		assert_int_equal(dem_triangle(d, a, c, b, &err), 0);
		got = pixel(d, 0, 0);
		assert_memory_equal(&got, &want[i], sizeof(got));
		dem_free(d);
		outfile_free(out);
	}
}

static void test_big(void **state)
{
	struct dem_big a = dem_big_of(-5), b = dem_big_of((i128)1 << 126), c;

	dem_big_ten(&b, 20);
	c = dem_big_sum(&a, &b);
	assert_int_equal(dem_big_compare(&c, &b), -1);
	a.negative = false;
	c = dem_big_sum(&c, &a);
	assert_int_equal(dem_big_compare(&c, &b), 0);
	b.negative = true;
	assert_int_equal(dem_big_compare(&b, &a), -1);
	c = dem_big_sum(&c, &b);
	a = dem_big_of(0);
	assert_int_equal(dem_big_compare(&c, &a), 0);
	assert_true(dem_big_double(1, -1, 1) == 0.1);
	assert_true(dem_big_double(-381, -3, 1250) == -0.381 / 1250);
	assert_true(dem_big_double(123456789, 3, 7) == 123456789000.0 / 7);
	assert_true(dem_big_double(((i128)1 << 60) + 1, 0, 1) == 0x1p60);
	assert_true(dem_big_double(((i128)1 << 53) + 1, 0, 1) == 0x1p53); /* a tie */
	assert_true(dem_big_double(((i128)1 << 53) + 3, 0, 1) == 0x1p53 + 4);
	for (uint64_t i = 1; i < 2000; i++) {
		seed = i;
		int64_t n = (int64_t)(random_next(&seed) >> 12);
		uint64_t q = 1 + random_below(&seed, 1u << 20);
		assert_true(dem_big_double(n, 0, q) == (double)n / (double)q);
	}
}

/* What a lattice cannot have is refused, and says so. */
/* The view of a window that is a triangle with a corner at (far, 0). */
static const char *far_view(int64_t far, char buf[256])
{
	size_t n = (size_t)sprintf(buf, "view 1 window=area:+");

	n += area_code_put(0, buf + n);
	n += area_code_put(0, buf + n);
	n += area_code_put(far, buf + n);
	n += area_code_put(0, buf + n);
	n += area_code_put(-far, buf + n);
	n += area_code_put(1, buf + n);
	buf[n] = 0;
	return buf;
}

static void test_refused(void **state)
{
	char far[2][256];
	const struct {
		struct decimal cell;
		const char *words, *view;
		int code;
	} row[] = {{{0, 0}, "--cell", NULL},
		   {{-1, 0}, "--cell", NULL},
		   {{123456789123, -13}, "too many digits", NULL},
		   {{1, -9}, "too many digits", NULL},
		   {{1, 30}, "too many digits", NULL},
		   {{1, -5}, "too small", NULL},
		   {{3333, -4}, "too far out", far_view(INT64_C(1) << 60, far[0])},
		   {{1, 0}, "the window of the stream's view", far_view(INT64_C(1) << 62, far[1]), -ERR_PROTO},
		   {{1, 0}, "the window of the stream's view", "view 1 window=area:+abc", -ERR_PROTO},
		   {{1, 0}, "the window of the stream's view", "view 1 window=area:", -ERR_PROTO},
		   {{1, 0}, "the window of the stream's view", "view 1 window=disc:1,2,3", -ERR_PROTO}};

	for (size_t i = 0; i < sizeof(row) / sizeof(*row); i++) {
		const struct acut_mesh_head head = {.scale_xy = "0.01",
						    .scale_z = "0.01",
						    .view = row[i].view,
						    .box = {INT32_MIN, INT32_MIN, 0, INT32_MAX, INT32_MAX, 0}};
		const struct dem_options opt = {.cell = row[i].cell, .cell_num = 1, .cell_den = 1, .z_num = 1, .z_den = 1};
		struct dem *d = NULL;
		struct err err = ERR_INIT;

		assert_int_equal(dem_new(NULL, &d, &err), 0);
		assert_int_equal(dem_head(d, &head, &opt, &err), row[i].code ? row[i].code : -ERR_USAGE);
		assert_non_null(strstr(err.message, row[i].words));
		dem_free(d);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_brute_force), cmocka_unit_test(test_ties),
					   cmocka_unit_test(test_big), cmocka_unit_test(test_refused)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
