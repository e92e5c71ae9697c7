/* The Morton key (nesting, order, inverse) and the sort (against qsort with an independent comparison). */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "point.h"
#include "random.h"

static uint64_t random_state = 9;

static uint64_t rnd(void)
{
	return random_next(&random_state);
}

/* Bit by bit, as described in point.h. */
static uint64_t morton_again(int32_t x, int32_t y)
{
	uint64_t ux = (uint64_t)((int64_t)x + 2147483648), uy = (uint64_t)((int64_t)y + 2147483648), key = 0;

	for (int i = 0; i < 32; i++)
		key |= (ux >> i & 1) << (2 * i + 1) | (uy >> i & 1) << (2 * i);
	return key;
}

static void test_morton(void **state)
{
	static const int32_t ends[] = {INT32_MIN, INT32_MIN + 1, -1, 0, 1, INT32_MAX - 1, INT32_MAX};

	for (int i = 0; i < 100049; i++) {
		int32_t x = i < 49 ? ends[i / 7] : (int32_t)rnd(), y = i < 49 ? ends[i % 7] : (int32_t)rnd(), bx, by;
		uint64_t key = point_morton(x, y);

		assert_true(key == morton_again(x, y));
		point_from_morton(key, &bx, &by);
		assert_true(bx == x && by == y);
	}
	assert_true(point_morton(INT32_MIN, INT32_MIN) == 0);
	assert_true(point_morton(INT32_MAX, INT32_MAX) == UINT64_MAX);
	(void)state;
}

/* A range of keys that share their first bits is an aligned box: x is split first, then y. */
static void test_morton_nests(void **state)
{
	for (int i = 0; i < 20000; i++) {
		unsigned low = (unsigned)(rnd() % 64);
		uint64_t key = rnd() >> low << low, width = UINT64_C(1) << low;
		int32_t x0, y0, x1, y1, x, y;

		point_from_morton(key, &x0, &y0);
		point_from_morton(key + (width - 1), &x1, &y1);
		assert_true((uint32_t)x1 - (uint32_t)x0 == (uint32_t)((UINT64_C(1) << low / 2) - 1));
		assert_true((uint32_t)y1 - (uint32_t)y0 == (uint32_t)((UINT64_C(1) << (low + 1) / 2) - 1));
		point_from_morton(key + rnd() % width, &x, &y);
		assert_true(x >= x0 && x <= x1 && y >= y0 && y <= y1);
	}
	(void)state;
}

/* The order of runs, implemented again over plain fields. */
static int order_again(const void *va, const void *vb)
{
	const struct point *a = va, *b = vb;
	uint64_t ka = morton_again(a->x, a->y), kb = morton_again(b->x, b->y);
	int64_t fa[] = {a->z, a->cls, a->ret, a->tag & 15, a->tag >> 4};
	int64_t fb[] = {b->z, b->cls, b->ret, b->tag & 15, b->tag >> 4};

	if (ka != kb)
		return ka < kb ? -1 : 1;
	for (int i = 0; i < 5; i++)
		if (fa[i] != fb[i])
			return fa[i] < fb[i] ? -1 : 1;
	return 0;
}

enum family { FULL, SMALL, TWO, ONE, CLUSTERS, TIES, COLUMN, STAIRS, FAMILIES };

static struct point make(enum family f)
{
	uint64_t a = rnd(), b = rnd(), c = rnd();
	struct point p = {(int32_t)a, (int32_t)b, (int32_t)c, (uint8_t)(a >> 40), (uint8_t)(b >> 40), (uint16_t)(c >> 40)};

	switch (f) {
	case SMALL:
		p.x = (int32_t)(a % 1000) - 500;
		p.y = (int32_t)(b % 1000) - 500;
		break;
	case TWO:
		p.x = a % 2 ? 7 : -7;
		p.y = 3;
		break;
	case ONE:
	case TIES:
		p.x = p.y = INT32_MIN;
		if (f == TIES) {
			p.z = (int32_t)(c % 3) - 1;
			p.cls = (uint8_t)(a % 2);
			p.ret = (uint8_t)(b % 2);
			p.tag = (uint16_t)(c % 4 + (a % 4 << 4));
		}
		break;
	case CLUSTERS:
		p.x = (int32_t)((a >> 8) % 50) + (a % 100 ? 0 : INT32_MAX - 50);
		p.y = (int32_t)((b >> 8) % 50);
		break;
	case COLUMN:
		p.x = 5;
		break;
	case STAIRS: /* most have the first key; at each digit some of the others differ */
		point_from_morton(a % 8 ? 0 : UINT64_C(1) << b % 64, &p.x, &p.y);
		break;
	default:
		break;
	}
	return p;
}

static void test_sort(void **state)
{
	static const size_t sizes[] = {0, 1, 2, 3, 23, 24, 25, 26, 47, 48, 49, 50, 1000, 32767, 32768, 32769, 200000};
	struct point *a = malloc(200000 * sizeof *a), *b = malloc(200000 * sizeof *b), *s = malloc(200000 * sizeof *s);

	for (int f = 0; f < FAMILIES; f++) {
		for (size_t k = 0; k < sizeof sizes / sizeof sizes[0]; k++) {
			size_t n = sizes[k];

			for (size_t i = 0; i < n; i++)
				a[i] = b[i] = make((enum family)f);
			point_sort(a, s, n);
			if (n)
				qsort(b, n, sizeof *b, order_again);
			assert_memory_equal(a, b, n * sizeof *a);
			point_sort(a, s, n); /* sorted already */
			assert_memory_equal(a, b, n * sizeof *a);
		}
	}
	free(a);
	free(b);
	free(s);
	(void)state;
}

static void *sort_stairs(void *arg)
{
	static struct point pts[100], scratch[100];
	size_t n = 0;

	(void)arg;
	for (; n < 30; n++)
		pts[n] = (struct point){INT32_MIN, INT32_MIN, (int32_t)n, 0, 0, 0};
	for (unsigned bit = 0; bit < 64; bit++, n++)
		point_from_morton(UINT64_C(1) << bit, &pts[n].x, &pts[n].y);
	point_sort(pts, scratch, n);
	return NULL;
}

/* Keys that share all digits but one keep the recursion deep; a stack filled with a known byte shows how far it reaches. */
static void test_stack(void **state)
{
	enum { STACK = 256 << 10, MOST = 48 << 10, FILL = 0xa5 };
	unsigned char *stack = aligned_alloc(4096, STACK);
	pthread_attr_t attr;
	pthread_t thread;
	size_t unused = 0;

#ifdef __SANITIZE_THREAD__
	free(stack);
	skip(); /* its threads need larger stacks */
#endif
	assert_non_null(stack);
	memset(stack, FILL, STACK);
	assert_int_equal(pthread_attr_init(&attr), 0);
	assert_int_equal(pthread_attr_setstack(&attr, stack, STACK), 0);
	assert_int_equal(pthread_create(&thread, &attr, sort_stairs, NULL), 0);
	assert_int_equal(pthread_join(thread, NULL), 0);
	pthread_attr_destroy(&attr);
	while (unused < STACK && stack[unused] == FILL)
		unused++;
	assert_in_range(STACK - unused, 1 << 10, MOST);
	free(stack);
	(void)state;
}

static void test_compare(void **state)
{
	for (int i = 0; i < 100000; i++) {
		struct point a = make((enum family)(i % FAMILIES)), b = i % 3 ? make((enum family)(i % FAMILIES)) : a;

		if (i % 5 == 0)
			b.tag ^= (uint16_t)(1u << (rnd() % 16));
		assert_int_equal(point_compare(&a, &b), order_again(&a, &b));
		assert_int_equal(point_compare(&b, &a), -point_compare(&a, &b));
	}
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_morton), cmocka_unit_test(test_morton_nests), cmocka_unit_test(test_sort),
		cmocka_unit_test(test_stack),  cmocka_unit_test(test_compare),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
