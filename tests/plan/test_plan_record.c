/* Records of a plan: what was packed is unpacked, as its own kind only, and no bit may differ. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <string.h>

#include "plan_record.h"

static const struct plan_head head = {7, 3, 12, {1000, 2000, {4, 5}}, {6, 7}};

static struct cut_leaf make_leaf(void)
{
	static const int32_t box[4] = {0, 0, 1 << 30, 1 << 30};
	struct cut_leaf leaf = {.count = 77, .above = 99, .exact = true, .stuck = 5};

	cut_region_root(box, &leaf.region);
	return leaf;
}

static void pack(unsigned kind, uint8_t record[PLAN_RECORD])
{
	const struct cut_leaf leaf = make_leaf();
	const struct plan_done done = {leaf.region, {1, 2}, {3, 4}, {5, 6}, 7, 8, 9};

	if (kind == PLAN_HEAD)
		plan_head_pack(&head, record);
	else if (kind == PLAN_DONE)
		plan_done_pack(&done, record);
	else
		plan_leaf_pack(kind, &leaf, record);
}

static bool unpacks(unsigned kind, const uint8_t record[PLAN_RECORD])
{
	struct plan_head h;
	struct plan_done done;
	struct cut_leaf leaf;

	if (kind == PLAN_HEAD)
		return plan_head_unpack(record, &h);
	return kind == PLAN_DONE ? plan_done_unpack(record, &done) : plan_leaf_unpack(kind, record, &leaf);
}

static void each_is_its_own_kind(void **state)
{
	uint8_t record[PLAN_RECORD];

	(void)state;
	for (unsigned kind = PLAN_HEAD; kind <= PLAN_DONE; kind++) {
		pack(kind, record);
		for (unsigned as = PLAN_HEAD; as <= PLAN_DONE; as++)
			assert_int_equal(unpacks(as, record), as == kind);
	}
}

static void every_bit_counts(void **state)
{
	uint8_t record[PLAN_RECORD];

	(void)state;
	for (unsigned kind = PLAN_HEAD; kind <= PLAN_DONE; kind++) {
		pack(kind, record);
		for (unsigned bit = 0; bit < 8 * PLAN_RECORD; bit++) {
			record[bit / 8] ^= (uint8_t)(1u << bit % 8);
			assert_false(unpacks(kind, record));
			record[bit / 8] ^= (uint8_t)(1u << bit % 8);
		}
	}
}

static void values_are_the_same(void **state)
{
	const struct cut_leaf leaf = make_leaf();
	uint8_t record[PLAN_RECORD];
	struct plan_head h = {0};
	struct plan_done done;
	struct cut_leaf l;

	(void)state;
	pack(PLAN_HEAD, record);
	assert_true(plan_head_unpack(record, &h));
	assert_memory_equal(&h, &head, sizeof h);
	pack(PLAN_HALF, record);
	assert_true(plan_leaf_unpack(PLAN_HALF, record, &l));
	assert_true(cut_region_same(&l.region, &leaf.region));
	assert_true(l.count == 77 && l.above == 99 && l.exact && l.stuck == 5 && !l.flat);
	pack(PLAN_DONE, record);
	assert_true(plan_done_unpack(record, &done));
	assert_true(cut_region_same(&done.region, &leaf.region) && digest_equal(done.base, (struct digest){1, 2}));
	assert_true(digest_equal(done.list, (struct digest){3, 4}) && digest_equal(done.digest, (struct digest){5, 6}));
	assert_true(done.payload == 7 && done.triangles == 8 && done.bytes == 9);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(each_is_its_own_kind),
		cmocka_unit_test(every_bit_counts),
		cmocka_unit_test(values_are_the_same),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
