/*
 * Regions: roots, splits, ranges of keys, texts, and the owner test for circumcentres on cuts or far away.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "cut_owner.h"
#include "geom.h"
#include "point.h"
#include "tiling.h"

static int32_t num(uint64_t v)
{
	return (int32_t)(uint32_t)v;
}

static void root_is_small(void **state)
{
	static const struct {
		int32_t box[4];
		unsigned w;
	} row[] = {
		{{5, 7, 5, 7}, 0},
		{{-1, 0, 0, 1}, 3}, /* across the highest cut: 2 above it, and 1 for the margin */
		{{1, 1, 2, 2}, 2},
		{{0, 0, 1, 1}, 3},            /* beginning at a cut: there is a margin beyond it */
		{{7, 7, 8, 8}, 2},            /* the aligned square would have side 16 */
		{{-900, -900, 900, 900}, 12}, /* a margin of 226 */
		{{-800, -800, 800, 800}, 11},
		{{0, 0, 1000000, 1000000}, 22},
		{{130000, 130000, 900000, 900000}, 20},
		{{INT32_MIN, INT32_MIN, INT32_MAX, INT32_MAX}, 32},
		{{INT32_MIN, 0, INT32_MIN, 0}, 0},
		{{INT32_MAX - 1, INT32_MAX, INT32_MAX, INT32_MAX}, 2},
	};

	for (size_t i = 0; i < sizeof(row) / sizeof(row[0]); i++) {
		struct cut_region r;

		cut_region_root(row[i].box, &r);
		assert_int_equal(r.wx, row[i].w);
		assert_int_equal(r.wy, row[i].w);
		assert_int_equal(r.inf, 15);
		assert_true(cut_region_holds(&r, row[i].box[0], row[i].box[1]));
		assert_true(cut_region_holds(&r, row[i].box[2], row[i].box[3]));
	}
}

/* A region with points does not reach the root's side: a margin of an eighth of the data's longer side is between, as
 * far as the lattice allows. */
static void root_has_room(void **state)
{
	uint64_t seed = 3;

	(void)state;
	for (unsigned i = 0; i < 20000; i++) {
		unsigned shift = (unsigned)(random_next(&seed) % 32);
		int64_t at[4], w, room, ext[2];
		struct cut_region r;
		int32_t box[4];

		for (unsigned a = 0; a < 2; a++) {
			at[a] = num(random_next(&seed));
			at[2 + a] = at[a] + (int64_t)(random_next(&seed) >> 32 >> shift);
			at[2 + a] = at[2 + a] > INT32_MAX ? INT32_MAX : at[2 + a];
			ext[a] = at[2 + a] - at[a];
		}
		if (!ext[0] && !ext[1])
			continue;
		for (unsigned k = 0; k < 4; k++)
			box[k] = (int32_t)at[k];
		cut_region_root(box, &r);
		w = (int64_t)1 << r.wx;
		room = (ext[0] > ext[1] ? ext[0] : ext[1]) / 8;
		for (unsigned a = 0; a < 2; a++) {
			int64_t low = (int64_t)(a ? r.y : r.x) + INT32_MIN;

			assert_true(low < at[a] - room || low == INT32_MIN);
			assert_true(low + w - 1 > at[2 + a] + room || low + w - 1 == INT32_MAX);
			/* Not much larger than necessary: ten eighths, and as much again if they are badly placed,
			 * rounded up to a power of two. */
			assert_true(w < 8 * (room + 2) * 8);
		}
	}
}

static void random_region(uint64_t *seed, struct cut_region *ret)
{
	unsigned shift = (unsigned)(random_next(seed) % 32);
	int32_t x = num(random_next(seed)), y = num(random_next(seed));
	int64_t x1 = x + (int64_t)(random_next(seed) >> 32 >> shift), y1 = y + (int64_t)(random_next(seed) >> 32 >> shift);
	int32_t box[4] = {x, y, (int32_t)(x1 > INT32_MAX ? INT32_MAX : x1), (int32_t)(y1 > INT32_MAX ? INT32_MAX : y1)};
	unsigned depth = (unsigned)(random_next(seed) % 10);
	struct cut_region half[2];

	cut_region_root(box, ret);
	for (; depth > 0 && cut_region_split(ret, half); depth--)
		*ret = half[random_next(seed) & 1];
}

/* A position near the region's border, inside or outside. */
static void position_near(uint64_t *seed, const struct cut_region *r, int32_t ret[2])
{
	uint64_t wx = (uint64_t)1 << r->wx, wy = (uint64_t)1 << r->wy;
	uint64_t dx = random_next(seed), dy = random_next(seed);

	dx = dx & 1 ? (dx >> 1) % wx : dx & 2 ? wx - 3 + (dx >> 2) % 6 : (dx >> 2) % 6 - 3;
	dy = dy & 1 ? (dy >> 1) % wy : dy & 2 ? wy - 3 + (dy >> 2) % 6 : (dy >> 2) % 6 - 3;
	ret[0] = num((r->x + dx) ^ 0x80000000u);
	ret[1] = num((r->y + dy) ^ 0x80000000u);
}

static void way_up_is_the_way_down(void **state)
{
	const int32_t box[4] = {-1000, 5, 70000, 1 << 20};
	uint64_t seed = 11;

	(void)state;
	for (unsigned i = 0; i < 2000; i++) {
		unsigned depth = (unsigned)(random_next(&seed) % 20), most = (unsigned)(random_next(&seed) % 5);
		struct cut_region way[32], half[2], got[5];
		size_t n = 0, k;

		cut_region_root(box, &way[0]);
		for (; n < depth && cut_region_split(&way[n], half); n++)
			way[n + 1] = half[random_next(&seed) & 1];
		k = cut_region_above(&way[0], &way[n], got, most);
		assert_int_equal(k, n < most ? n : most);
		while (k-- > 0)
			assert_true(cut_region_same(&got[k], &way[n - 1 - k]));
		/* A region that is not below the root has no ancestors up to it. */
		assert_int_equal(cut_region_above(&way[n], &way[0], got, 5), 0);
	}
}

static void ranges_are_the_box(void **state)
{
	uint64_t seed = 3;

	for (unsigned i = 0; i < 20000; i++) {
		struct cut_region r, back, half[2];
		struct cut_range range[4];
		char text[CUT_REGION_TEXT_SIZE], again[CUT_REGION_TEXT_SIZE];
		int64_t box[4];
		unsigned n;

		random_region(&seed, &r);
		n = cut_region_ranges(&r, range);
		assert_in_range(n, 1, 4);
		for (unsigned k = 1; k < n; k++)
			assert_true(range[k - 1].hi < range[k].lo);
		snprintf(again, sizeof again, "%u:%u:%u:%u:%u", r.x, r.y, r.wx, r.wy, r.inf);
		assert_string_equal(cut_region_text(&r, text), again);
		assert_true(cut_region_parse(cut_region_text(&r, text), &back));
		assert_string_equal(text, cut_region_text(&back, again));
		cut_region_box(&r, box);
		for (unsigned k = 0; k < 4; k++) {
			int32_t at[2];
			uint64_t key;
			bool in = false;

			position_near(&seed, &r, at);
			key = point_morton(at[0], at[1]);
			for (unsigned j = 0; j < n; j++)
				in = in || (key >= range[j].lo && key <= range[j].hi);
			assert_int_equal(in, cut_region_holds(&r, at[0], at[1]));
			if (in)
				assert_true(2 * (int64_t)at[0] > box[0] && 2 * (int64_t)at[0] < box[2] &&
					    2 * (int64_t)at[1] > box[1] && 2 * (int64_t)at[1] < box[3]);
			if (cut_region_split(&r, half))
				assert_int_equal(in, cut_region_holds(&half[0], at[0], at[1]) +
							     cut_region_holds(&half[1], at[0], at[1]));
		}
	}
}

static void rubbish_is_no_region(void **state)
{
	static const char *const bad[] = {
		"",
		"1:2:3:4",
		"0:0:1:1:15 ",
		" 0:0:1:1:15",
		"00:0:1:1:15",
		"0:0:33:33:15",
		"0:0:3:5:15",
		"0:0:5:4:15",
		"1:0:1:1:14",
		"3:0:2:2:15",
		"4294967295:0:1:1:15",
		"0:0:1:1:16",
		"0:0:1:1:-1",
		"4294967296:0:1:1:15",
		"0:0:1:1:15:0",
		"2:1:1:2:15",
		"0:0:1:1:1515151515151515151515151515151515151515151515151515151515151515",
	};
	struct cut_region r;

	for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++)
		assert_false(cut_region_parse(bad[i], &r));
	assert_true(cut_region_parse("0:0:32:32:15", &r));
	assert_true(cut_region_parse("1:0:1:1:15", &r));
}

static void same_owner(const struct cut_region *r, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	struct cut_owner owner;

	cut_owner_init(&owner, r);
	assert_int_equal(cut_owner_has(&owner, a, b, c), cut_region_owns(r, a, b, c));
}

/* Half the triangles of a unit grid have their centre on a possible cut: exactly one side owns each. */
static void ties_have_one_owner(void **state)
{
	for (int32_t step = 1; step <= 7; step += 2)
		for (int32_t at = -20; at < 20; at++)
			for (unsigned i = 0; i < 4; i++) {
				int32_t x = at, y = at * 3 - 7, d = step;
				const int32_t p[4][2] = {{x, y}, {x + d, y}, {x + d, y + d}, {x, y + d}};
				const int32_t *a = p[i], *b = p[(i + 1) % 4], *c = p[(i + 2) % 4];
				/* The cell whose border goes through the centre, and its neighbours. */
				struct cut_region root = {0, 0, 32, 32, 15};
				unsigned owners = 0;

				for (unsigned depth = 0; depth < 64; depth++) {
					struct cut_region half[2];

					if (!cut_region_split(&root, half))
						break;
					owners = cut_region_owns(&half[0], a, b, c) + cut_region_owns(&half[1], a, b, c);
					same_owner(&half[0], a, b, c);
					same_owner(&half[1], a, b, c);
					assert_int_equal(owners, 1);
					root = half[cut_region_owns(&half[1], a, b, c)];
				}
				assert_int_equal(owners, 1);
			}
}

/* The fast test agrees with the exact one: triangles of all sizes and shapes around a region of side 2^w, with circles
 * that touch its borders from inside and outside. */
static void quick_owner_is_exact(void **state)
{
	uint64_t seed = 5;
	unsigned owned = 0;

	for (unsigned i = 0; i < 400000; i++) {
		uint8_t w = (uint8_t)(random_next(&seed) % 31), inf = (uint8_t)(random_next(&seed) % 16);
		uint32_t size = (uint32_t)1 << (random_next(&seed) % (w + 2u)), side = (uint32_t)1 << w;
		struct cut_region r = {side, side, w, w, i % 4 ? 0 : inf};
		struct cut_owner owner;
		int32_t p[3][2];
		bool has;

		for (unsigned k = 0; k < 3; k++)
			for (unsigned axis = 0; axis < 2; axis++) {
				uint64_t at = random_next(&seed) % (2 * (uint64_t)size + 1);

				/* Near a corner of the region, or flat. */
				at += side - size + (i & 1 ? side / 2 : 0);
				if (axis && i % 8 == 2)
					at = side + (uint32_t)(p[k][0] + (INT64_C(1) << 31)) % 3;
				p[k][axis] = (int32_t)((int64_t)at - (INT64_C(1) << 31));
			}
		if (geom_orient(p[0], p[1], p[2]) <= 0)
			continue;
		cut_owner_init(&owner, &r);
		has = cut_owner_has(&owner, p[0], p[1], p[2]);
		assert_int_equal(has, cut_region_owns(&r, p[0], p[1], p[2]));
		owned += has;
	}
	assert_true(owned > 1000 && owned < 300000);
}

/* Slivers of the full square have centres up to 2^97 away: infinite sides contain them, large numbers would not. */
static void far_centres_have_one_owner(void **state)
{
	uint64_t seed = 9;

	for (unsigned i = 0; i < 20000; i++) {
		int32_t p[3][2];
		struct cut_region r = {0, 0, 32, 32, 15}, half[2];

		for (unsigned k = 0; k < 3; k++) {
			int32_t t = num(random_next(&seed)), e = (int32_t)(random_next(&seed) % 3) - 1;

			p[k][0] = t;
			p[k][1] = i & 1 ? t / 2 + e : num(random_next(&seed));
		}
		if (geom_orient(p[0], p[1], p[2]) == 0)
			continue;
		if (geom_orient(p[0], p[1], p[2]) < 0) {
			int32_t t[2] = {p[0][0], p[0][1]};

			memcpy(p[0], p[1], sizeof(t));
			memcpy(p[1], t, sizeof(t));
		}
		assert_true(cut_region_owns(&r, p[0], p[1], p[2]));
		while (cut_region_split(&r, half)) {
			bool low = cut_region_owns(&half[0], p[0], p[1], p[2]);
			int64_t box[4];

			assert_int_equal(low + cut_region_owns(&half[1], p[0], p[1], p[2]), 1);
			same_owner(&half[0], p[0], p[1], p[2]);
			same_owner(&half[1], p[0], p[1], p[2]);
			r = half[!low];
			/* The filter in doubles agrees with the exact sign on every finite border. */
			cut_region_box(&r, box);
			for (unsigned side = 0; side < 4; side++)
				if (box[side] != INT64_MIN && box[side] != INT64_MAX)
					assert_int_equal(geom_cut_side(p[0], p[1], p[2], box[side], side % 2 == 0),
							 side < 2 ? 1 : -1);
		}
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(root_is_small),          cmocka_unit_test(root_has_room),
		cmocka_unit_test(way_up_is_the_way_down), cmocka_unit_test(ranges_are_the_box),
		cmocka_unit_test(rubbish_is_no_region),   cmocka_unit_test(ties_have_one_owner),
		cmocka_unit_test(quick_owner_is_exact),   cmocka_unit_test(far_centres_have_one_owner),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
