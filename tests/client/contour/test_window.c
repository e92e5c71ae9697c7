/* Lines that are cut at a window: what is inside, against the whole; windows side by side; a window without an end on the border;
 * polygons with holes, several ones, and what is outside of them. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "area_code.h"
#include "repeat.h"
#include "surface.h"

/* In coordinates: local lattice numbers are 100 times these, from 10000 and 20000 on. */
struct box {
	double low[2], high[2];
};

static double clipped(const double p[2], const double q[2], const struct box *b)
{
	double from = 0, to = 1, x = q[0] - p[0], y = q[1] - p[1];

	for (int i = 0; i < 2; i++) {
		double d = q[i] - p[i], low = b->low[i] - p[i], high = b->high[i] - p[i];

		if (d == 0 && (low > 0 || high <= 0))
			return 0;
		if (d != 0) {
			from = fmax(from, fmin(low / d, high / d));
			to = fmin(to, fmax(low / d, high / d));
		}
	}
	return to > from ? (to - from) * sqrt(x * x + y * y) : 0;
}

static double length_in(const struct lines *l, const struct box *b)
{
	const double(*at)[2] = (const double(*)[2])l->point;
	double sum = 0;

	for (size_t i = 0; i < l->n; at += l->line[i++].points)
		for (uint64_t k = 0; k + 1 < l->line[i].points; k++)
			sum += clipped(at[k], at[k + 1], b);
	return sum;
}

static double length_of(const struct lines *l)
{
	double sum = 0;

	for (size_t i = 0; i < l->n; i++)
		sum += l->line[i].length;
	return sum;
}

static bool on_border(const double at[2], const struct box *b)
{
	return at[0] == b->low[0] || at[0] == b->high[0] || at[1] == b->low[1] || at[1] == b->high[1];
}

static void check(const struct surface *s, const struct lines *whole, int x0, int y0, int x1, int y1, const struct way *from,
		  double *ret_length)
{
	const struct box b = {{10000 + x0 / 100.0, 20000 + y0 / 100.0}, {10000 + x1 / 100.0, 20000 + y1 / 100.0}};
	struct lines part, other;
	struct way way = *from;
	char view[128];
	const double(*at)[2];

	snprintf(view, sizeof(view), "view 1 window=box:%d,%d,%d,%d", 1000000 + x0, 2000000 + y0, 1000000 + x1, 2000000 + y1);
	way.view = view;
	surface_lines(s, &way, &part);
	*ret_length = length_of(&part);
	assert_true(fabs(*ret_length - length_in(whole, &b)) < 1e-6);
	at = (const double(*)[2])part.point;
	for (size_t i = 0; i < part.n; at += part.line[i++].points) {
		const struct contour_line *l = &part.line[i];

		for (uint64_t k = 0; k < l->points; k++)
			for (int j = 0; j < 2; j++)
				assert_true(at[k][j] >= b.low[j] && at[k][j] <= b.high[j]);
		assert_true(l->closed || (on_border(at[0], &b) && on_border(at[l->points - 1], &b)));
	}
	way.blocks = 5;
	way.segments = 10;
	surface_lines(s, &way, &other);
	lines_same(&part, &other);
	lines_done(&part);
	lines_done(&other);
}

static void test_cut(void **ctx)
{
	for (unsigned seed = 0; seed < repeat_cases(400); seed++) {
		struct way way = {.interval = {seed % 2 ? 1 : 15, seed % 2 ? -2 : -3}};
		double a, b, c, d;
		struct surface s;
		struct lines whole;
		int x = 200 + (int)(seed * 7 % 150), y = 220 + (int)(seed * 13 % 170);

		surface_seed(seed);
		surface_make(&s, 8, 8, seed % 5 + 2, 1, false);
		if (seed % 3 == 0) /* corners on borders */
			for (uint32_t i = 0; i < s.nvertex; i++) {
				s.vertex[i][0] -= s.vertex[i][0] % 50;
				s.vertex[i][1] -= s.vertex[i][1] % 50;
				x -= x % 50;
				y -= y % 50;
			}
		surface_lines(&s, &way, &whole);
		check(&s, &whole, 150, 150, x, y, &way, &a);
		check(&s, &whole, x, 150, 500, y, &way, &b);
		check(&s, &whole, 150, y, x, 500, &way, &c);
		check(&s, &whole, x, y, 500, 500, &way, &d);
		assert_true(fabs(a + b + c + d - length_in(&whole, &(struct box){{10001.5, 20001.5}, {10005, 20005}})) < 1e-6);
		lines_done(&whole);
		surface_done(&s);
	}
}

/* ---- polygons ---- */

enum { RINGS = 5, CORNERS = 12 };

struct polygons {
	unsigned nring, n[RINGS];
	bool shell[RINGS];
	int64_t at[RINGS][CORNERS][2]; /* lattice numbers, from 1000000 and 2000000 on */
};

/* Around a middle, so that some rings are simple, with corners on those of the surface or its lines now and then. */
static void make_polygons(struct polygons *p, unsigned seed)
{
	*p = (struct polygons){.nring = 1 + seed % RINGS};
	for (unsigned r = 0; r < p->nring; r++) {
		int64_t middle[2] = {(int64_t)surface_random(600) + 50, (int64_t)surface_random(600) + 50},
			unit = seed % 4 ? 1 : 50;

		p->shell[r] = !r || surface_random(2);
		p->n[r] = 3 + (unsigned)surface_random(CORNERS - 2);
		for (unsigned i = 0; i < p->n[r]; i++) {
			double way = 6.28 * i / p->n[r], far = 20 + (double)surface_random(400);

			p->at[r][i][0] = 1000000 + (middle[0] + (int64_t)(far * cos(way))) / unit * unit;
			p->at[r][i][1] = 2000000 + (middle[1] + (int64_t)(far * sin(way))) / unit * unit;
		}
	}
}

/* The text of the window; `around`: another polygon is around all, and these are what it has not. */
static void view_of(const struct polygons *p, bool around, char *to)
{
	static const int64_t outer[4][2] = {{900000, 1900000}, {1100000, 1900000}, {1100000, 2100000}, {900000, 2100000}};
	int64_t last[2] = {0, 0};

	to += sprintf(to, "view 1 window=area:");
	for (unsigned r = 0; r < p->nring + around; r++) {
		unsigned of = r - around, n = around && !r ? 4 : p->n[of];

		*to++ = around ? (r ? '-' : '+') : (p->shell[of] ? '+' : '-');
		for (unsigned i = 0; i < n; i++)
			for (int k = 0; k < 2; k++) {
				int64_t v = around && !r ? outer[i][k] : p->at[of][i][k];

				to += area_code_put(v - last[k], to);
				last[k] = v;
			}
	}
	*to = 0;
}

/* Moved by nothing that counts, as the rule is. */
static bool has(const struct polygons *p, const double at[2])
{
	bool any = false, shell = false;
	double x = at[0] * 100 + 1e-5, y = at[1] * 100 + 1e-7;

	for (unsigned r = 0; r < p->nring; r++) {
		bool in = false;

		for (unsigned i = 0; i < p->n[r]; i++) {
			const int64_t *a = p->at[r][i], *b = p->at[r][(i + 1) % p->n[r]];
			double part = (y - (double)a[1]) / (double)(b[1] - a[1]);

			if (((double)a[1] <= y) != ((double)b[1] <= y))
				in ^= x < (double)a[0] + part * (double)(b[0] - a[0]);
		}
		any |= shell && p->shell[r];
		shell = p->shell[r] ? in : shell && !in;
	}
	return any | shell;
}

static int by_value(const void *a, const void *b)
{
	const double *p = a, *q = b;

	return (*p > *q) - (*p < *q);
}

/* Divided at all edges; a part counts if its middle is inside. */
static double length_inside(const struct polygons *p, const double a[2], const double b[2])
{
	double part[RINGS * CORNERS + 2] = {0, 1}, sum = 0, way[2] = {b[0] - a[0], b[1] - a[1]};
	size_t n = 2;

	for (unsigned r = 0; r < p->nring; r++)
		for (unsigned i = 0; i < p->n[r]; i++) {
			const int64_t *e = p->at[r][i], *f = p->at[r][(i + 1) % p->n[r]];
			double from[2] = {(double)e[0] / 100, (double)e[1] / 100};
			double edge[2] = {(double)(f[0] - e[0]) / 100, (double)(f[1] - e[1]) / 100};
			double t =
				((from[0] - a[0]) * edge[1] - (from[1] - a[1]) * edge[0]) / (way[0] * edge[1] - way[1] * edge[0]);

			if (t > 0 && t < 1)
				part[n++] = t;
		}
	qsort(part, n, sizeof(*part), by_value);
	for (size_t i = 0; i + 1 < n; i++) {
		double t = (part[i] + part[i + 1]) / 2, middle[2] = {a[0] + way[0] * t, a[1] + way[1] * t};

		if (has(p, middle))
			sum += (part[i + 1] - part[i]) * sqrt(way[0] * way[0] + way[1] * way[1]);
	}
	return sum;
}

static bool on_edge(const struct polygons *p, const double at[2])
{
	for (unsigned r = 0; r < p->nring; r++)
		for (unsigned i = 0; i < p->n[r]; i++) {
			const int64_t *e = p->at[r][i], *f = p->at[r][(i + 1) % p->n[r]];
			double x = (double)(f[0] - e[0]), y = (double)(f[1] - e[1]), size = sqrt(x * x + y * y);
			double dx = at[0] * 100 - (double)e[0], dy = at[1] * 100 - (double)e[1];

			if (fabs(dx * y - dy * x) < 1e-5 * size && dx * x + dy * y > -1 && dx * x + dy * y < size * size + 1)
				return true;
		}
	return false;
}

static void check_part(const struct surface *s, const struct way *from, const struct polygons *p, const struct lines *part)
{
	struct way way = *from;
	const double(*at)[2] = (const double(*)[2])part->point;
	struct lines other;

	for (size_t i = 0; i < part->n; at += part->line[i++].points) {
		const struct contour_line *l = &part->line[i];

		assert_true(l->closed || (on_edge(p, at[0]) && on_edge(p, at[l->points - 1])));
	}
	way.blocks = 5;
	way.segments = 10;
	surface_lines(s, &way, &other);
	lines_same(part, &other);
	lines_done(&other);
}

static void test_polygons(void **ctx)
{
	double all = 0;

	for (unsigned seed = 0; seed < repeat_cases(400); seed++) {
		struct way way = {.interval = {seed % 2 ? 1 : 15, seed % 2 ? -2 : -3}};
		char view[8192];
		struct polygons p;
		struct surface s;
		struct lines whole, in, out;
		const double(*at)[2];
		double want = 0;

		surface_seed(seed);
		surface_make(&s, 9, 9, (int)(seed % 5) + 2, 1, false);
		for (uint32_t i = 0; i < s.nvertex && seed % 3 == 0; i++) {
			s.vertex[i][0] -= s.vertex[i][0] % 50;
			s.vertex[i][1] -= s.vertex[i][1] % 50;
		}
		make_polygons(&p, seed);
		surface_lines(&s, &way, &whole);
		at = (const double(*)[2])whole.point;
		for (size_t i = 0; i < whole.n; at += whole.line[i++].points)
			for (uint64_t k = 0; k + 1 < whole.line[i].points; k++)
				want += length_inside(&p, at[k], at[k + 1]);
		view_of(&p, false, view);
		way.view = view;
		surface_lines(&s, &way, &in);
		assert_true(fabs(length_of(&in) - want) <= 1e-9 * want + 1e-9);
		all += want;
		if (seed % 4) /* inside of the surface */
			for (unsigned r = 0; r < p.nring; r++)
				for (unsigned i = 0; i < p.n[r]; i++)
					for (int k = 0; k < 2; k++) {
						int64_t low = 1000000 * (k + 1) + 50, high = low + 700;

						p.at[r][i][k] = p.at[r][i][k] < low  ? low :
								p.at[r][i][k] > high ? high :
										       p.at[r][i][k];
					}
		for (unsigned r = 0; r < p.nring; r++)
			p.shell[r] = true;
		view_of(&p, false, view);
		lines_done(&in);
		surface_lines(&s, &way, &in);
		if (seed % 4)
			check_part(&s, &way, &p, &in);
		view_of(&p, true, view);
		surface_lines(&s, &way, &out);
		want = length_of(&whole);
		assert_true(fabs(length_of(&in) + length_of(&out) - want) <= 1e-9 * want);
		lines_done(&whole);
		lines_done(&in);
		lines_done(&out);
		surface_done(&s);
	}
	assert_true(all > 1000);
	(void)ctx;
}

/* Tiles, of sides that are lattice steps and corners on their borders, or not: the lines of the whole, and those of as many
 * windows. */
static void test_tiles(void **ctx)
{
	static const uint64_t side[][2] = {{100, 1}, {50, 1}, {130, 1}, {1000, 3}};

	for (unsigned seed = 0; seed < repeat_cases(400); seed++) {
		struct way way = {.interval = {seed % 2 ? 1 : 15, seed % 2 ? -2 : -3}};
		const uint64_t *tile = side[seed / 2 % 4];
		struct surface s;
		struct lines whole, tiles, window;
		size_t lines = 0;

		surface_seed(seed);
		surface_make(&s, 6, 6, (int)(seed % 5) + 2, 1, false);
		for (uint32_t i = 0; i < s.nvertex && seed % 3 == 0; i++) {
			s.vertex[i][0] -= s.vertex[i][0] % 50;
			s.vertex[i][1] -= s.vertex[i][1] % 50;
		}
		surface_lines(&s, &way, &whole);
		way.tile_p = tile[0];
		way.tile_q = tile[1];
		way.blocks = seed % 5;
		way.segments = 10 + seed % 20;
		surface_lines(&s, &way, &tiles);
		assert_true(fabs(length_of(&tiles) - length_of(&whole)) <= 1e-9 * length_of(&whole));
		way.tile_p = 0;
		for (uint64_t y = 2000000 / tile[0]; y <= 2000700 / tile[0] && tile[1] == 1; y++)
			for (uint64_t x = 1000000 / tile[0]; x <= 1000700 / tile[0]; x++) {
				char view[128];

				snprintf(view, sizeof(view), "view 1 window=box:%llu,%llu,%llu,%llu",
					 (unsigned long long)(x * tile[0]), (unsigned long long)(y * tile[0]),
					 (unsigned long long)((x + 1) * tile[0]), (unsigned long long)((y + 1) * tile[0]));
				way.view = view;
				surface_lines(&s, &way, &window);
				lines += window.n;
				lines_done(&window);
			}
		assert_true(tile[1] > 1 || lines == tiles.n);
		lines_done(&whole);
		lines_done(&tiles);
		surface_done(&s);
	}
	(void)ctx;
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_cut), cmocka_unit_test(test_polygons),
					   cmocka_unit_test(test_tiles)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
