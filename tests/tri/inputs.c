/*
 * Point sets with a known seed: the distributions for which the kernel is measured, and those that are difficult. All
 * are integers; floating point is rounded to the lattice.
 */
#include "inputs.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

uint64_t input_random(uint64_t *state)
{
	uint64_t x = *state;

	x ^= x >> 12;
	x ^= x << 25;
	x ^= x >> 27;
	*state = x;
	return x * UINT64_C(0x2545f4914f6cdd1d);
}

static double uniform01(uint64_t *s)
{
	return (double)(input_random(s) >> 11) * 0x1p-53;
}

static double gauss(uint64_t *s)
{
	double u = 1.0 - uniform01(s), v = uniform01(s);

	return sqrt(-2 * log(u)) * cos(6.283185307179586 * v);
}

static void put(struct mesh_vertex *v, double x, double y)
{
	v->x = (int32_t)floor(x + 0.5);
	v->y = (int32_t)floor(y + 0.5);
}

static uint32_t fill_uniform(struct mesh_vertex *v, uint32_t n, uint64_t s)
{
	for (uint32_t i = 0; i < n; i++) {
		v[i].x = (int32_t)(input_random(&s) >> 40);
		v[i].y = (int32_t)(input_random(&s) >> 40);
	}
	return n;
}

static uint32_t fill_full(struct mesh_vertex *v, uint32_t n, uint64_t s)
{
	for (uint32_t i = 0; i < n; i++) {
		v[i].x = (int32_t)(input_random(&s) >> 32);
		v[i].y = (int32_t)(input_random(&s) >> 32);
	}
	return n;
}

static uint32_t grid_step(struct mesh_vertex *v, uint32_t n, int32_t step)
{
	uint32_t side = (uint32_t)sqrt((double)n);

	for (uint32_t i = 0; i < side * side; i++) {
		v[i].x = (int32_t)(i % side) * step;
		v[i].y = (int32_t)(i / side) * step;
	}
	return side * side;
}

/* As wide as 2^24 for any size: step 16777 for a million points, 5305 for ten million. */
static uint32_t fill_grid(struct mesh_vertex *v, uint32_t n, uint64_t s)
{
	return grid_step(v, n, (int32_t)(16777216 / sqrt((double)n)));
}

static uint32_t fill_holes(struct mesh_vertex *v, uint32_t n, uint64_t s)
{
	uint32_t all = grid_step(v, n, 1), left = 0;
	double side = sqrt((double)n), x[12], y[12], r[12];

	for (unsigned h = 0; h < 12; h++) {
		x[h] = side * uniform01(&s);
		y[h] = side * uniform01(&s);
		r[h] = side * 0.15 * uniform01(&s);
	}
	for (uint32_t i = 0; i < all; i++) {
		unsigned h = 0;

		while (h < 12 && hypot(v[i].x - x[h], v[i].y - y[h]) > r[h])
			h++;
		if (h == 12 && input_random(&s) % 50)
			v[left++] = v[i];
	}
	return left;
}

/*
 * An airborne survey in millimetres: swaths of 120 m with 30 % overlap, flown there and back; a zig-zag
 * mirror, denser at its turns; six points a square metre, 4 cm of jitter.
 */
static uint32_t fill_scan(struct mesh_vertex *v, uint32_t n, uint64_t s)
{
	double side = 1000 * sqrt(n / 6.0 * 0.7), swath = 120000, step = swath * 0.7;
	uint32_t strips = (uint32_t)ceil(side / step), strip_n, line = 240;

	strips = strips ? strips : 1;
	strip_n = n / strips;
	for (uint32_t i = 0; i < strips * strip_n; i++) {
		uint32_t strip = i / strip_n, k = i % strip_n;
		double t = fmod((double)k / line, 2.0), phase = t < 1 ? t : 2 - t;
		double across = swath * (0.5 - 0.5 * cos(3.141592653589793 * (0.15 + 0.7 * phase)) / 0.891);
		double along = side * k / strip_n;

		put(&v[i], strip * step + across + 40 * gauss(&s), (strip & 1 ? side - along : along) + 40 * gauss(&s));
	}
	return strips * strip_n;
}

static uint32_t fill_cluster(struct mesh_vertex *v, uint32_t n, uint64_t s)
{
	enum { CENTRES = 1000 };
	double x[CENTRES], y[CENTRES], size[CENTRES], sum[CENTRES], all = 0;

	for (unsigned k = 0; k < CENTRES; k++) {
		x[k] = 0x1p24 * uniform01(&s);
		y[k] = 0x1p24 * uniform01(&s);
		size[k] = exp2(10 + 10 * uniform01(&s));
		sum[k] = all += pow(k + 1, -1.1);
	}
	for (uint32_t i = 0; i < n; i++) {
		double pick = all * uniform01(&s);
		unsigned lo = 0, hi = CENTRES - 1;

		while (lo < hi) {
			unsigned mid = (lo + hi) / 2;

			if (sum[mid] < pick)
				lo = mid + 1;
			else
				hi = mid;
		}
		put(&v[i], x[lo] + size[lo] * gauss(&s), y[lo] + size[lo] * gauss(&s));
	}
	return n;
}

/*
 * Every lattice position of the circle of radius 5^3 * 13 * 17 * 29 * 37 * 41: the Gaussian integers of that
 * norm, one for each way to share the factors p = (a + bi)(a - bi) out; 4 * 7 * 3^5 = 6 804 in all.
 */
static uint32_t fill_circle(struct mesh_vertex *v, uint32_t n, uint64_t s)
{
	static const struct {
		int64_t a, b;
		unsigned power;
	} factor[] = {{2, 1, 6}, {3, 2, 2}, {4, 1, 2}, {5, 2, 2}, {6, 1, 2}, {5, 4, 2}};
	enum { FACTORS = sizeof(factor) / sizeof(factor[0]), ALL = 7 * 3 * 3 * 3 * 3 * 3 };
	uint32_t made = 0;

	for (unsigned share = 0; share < ALL; share++) {
		int64_t x = 1, y = 0;

		for (unsigned f = 0, rest = share; f < FACTORS; rest /= factor[f++].power + 1)
			for (unsigned k = 0; k < factor[f].power; k++) {
				int64_t b = k < rest % (factor[f].power + 1) ? factor[f].b : -factor[f].b;
				int64_t u = x * factor[f].a - y * b;

				y = x * b + y * factor[f].a;
				x = u;
			}
		for (unsigned turn = 0; turn < 4 && made < n; turn++) {
			int64_t u = -y;

			v[made].x = (int32_t)x;
			v[made++].y = (int32_t)y;
			y = x;
			x = u;
		}
	}
	input_shuffle(v, made, s);
	return made;
}

static uint32_t fill_parabola(struct mesh_vertex *v, uint32_t n, uint64_t s)
{
	n = n < 46000 ? n : 46000;
	for (uint32_t i = 0; i < n; i++) {
		v[i].x = (int32_t)i - 23000;
		v[i].y = v[i].x * v[i].x;
	}
	input_shuffle(v, n, s | 1);
	return n;
}

static uint32_t fill_ring(struct mesh_vertex *v, uint32_t n, uint64_t s)
{
	for (uint32_t i = 0; i < n; i++) {
		double a = 6.283185307179586 * uniform01(&s), r = 1e7 * (1 + 1e-5 * uniform01(&s));

		put(&v[i], r * cos(a), r * sin(a));
	}
	return n;
}

static uint32_t fill_two(struct mesh_vertex *v, uint32_t n, uint64_t s)
{
	for (uint32_t i = 0; i < n; i++) {
		double at = i & 1 ? 1e9 : -1e9;

		put(&v[i], at + 1e4 * gauss(&s), at / 3 + 1e4 * gauss(&s));
	}
	return n;
}

/* All on one line except the last one: a fan around it. */
static uint32_t fill_fan(struct mesh_vertex *v, uint32_t n, uint64_t s)
{
	for (uint32_t i = 0; i < n; i++) {
		v[i].x = (int32_t)i;
		v[i].y = 2 * (int32_t)i;
	}
	if (n)
		v[n - 1].x += 1000;
	return n;
}

static uint32_t fill_cross(struct mesh_vertex *v, uint32_t n, uint64_t s)
{
	for (uint32_t i = 0; i < n; i++) {
		int32_t at = (int32_t)(i / 2) - (int32_t)(n / 4);

		v[i].x = i & 1 ? 7 * at : at;
		v[i].y = i & 1 ? -at : 3 * at;
	}
	return n;
}

const struct input_kind input_kinds[] = {
	{"uniform", fill_uniform},   {"scan", fill_scan}, {"grid", fill_grid}, {"cluster", fill_cluster},
	{"holes", fill_holes},       {"full", fill_full}, {"ring", fill_ring}, {"circle", fill_circle},
	{"parabola", fill_parabola}, {"two", fill_two},   {"fan", fill_fan},   {"cross", fill_cross},
};
const unsigned input_kind_count = sizeof(input_kinds) / sizeof(input_kinds[0]);

void input_shuffle(struct mesh_vertex *v, uint32_t n, uint64_t seed)
{
	for (uint32_t i = n; i > 1; i--) {
		uint32_t j = (uint32_t)(input_random(&seed) % i);
		struct mesh_vertex t = v[i - 1];

		v[i - 1] = v[j];
		v[j] = t;
	}
}

struct place {
	int32_t x, y;
	uint32_t index;
};

static int place_compare(const void *a, const void *b)
{
	const struct place *p = a, *q = b;

	if (p->x != q->x)
		return p->x < q->x ? -1 : 1;
	if (p->y != q->y)
		return p->y < q->y ? -1 : 1;
	return p->index < q->index ? -1 : p->index > q->index;
}

uint32_t input_unique(struct mesh_vertex *v, uint32_t n)
{
	struct place *place = malloc(n ? n * sizeof(*place) : 1);
	unsigned char *drop = calloc(n ? n : 1, 1);
	uint32_t left = 0;

	for (uint32_t i = 0; place && drop && i < n; i++)
		place[i] = (struct place){v[i].x, v[i].y, i};
	if (place && drop) {
		qsort(place, n, sizeof(*place), place_compare);
		for (uint32_t i = 1; i < n; i++)
			if (place[i].x == place[i - 1].x && place[i].y == place[i - 1].y)
				drop[place[i].index] = 1;
		for (uint32_t i = 0; i < n; i++)
			if (!drop[i])
				v[left++] = v[i];
	}
	free(place);
	free(drop);
	return left;
}

static int morton_compare(const void *a, const void *b)
{
	const struct mesh_vertex *p = a, *q = b;
	uint32_t dx = (uint32_t)p->x ^ (uint32_t)q->x, dy = (uint32_t)p->y ^ (uint32_t)q->y;
	bool by_y = dx < dy && dx < (dx ^ dy);

	return by_y ? (p->y > q->y) - (p->y < q->y) : (p->x > q->x) - (p->x < q->x);
}

struct mesh_vertex *input_make(const char *name, uint32_t n, uint64_t seed, uint32_t *ret_n)
{
	struct mesh_vertex *v = malloc(n ? n * sizeof(*v) : 1);

	for (unsigned k = 0; v && k < input_kind_count; k++) {
		if (strcmp(input_kinds[k].name, name))
			continue;
		*ret_n = input_unique(v, input_kinds[k].fill(v, n, seed * 2 + 1));
		qsort(v, *ret_n, sizeof(*v), morton_compare);
		for (uint32_t i = 0; i < *ret_n; i++)
			v[i].z = (int32_t)i;
		return v;
	}
	free(v);
	return NULL;
}
