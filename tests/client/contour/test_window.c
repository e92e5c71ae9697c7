/* Lines that are cut at a window: what is inside, against the whole; windows side by side; a window without an end on the border.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <cmocka.h>

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

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_cut)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
