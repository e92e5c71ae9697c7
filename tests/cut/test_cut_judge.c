/* The cached result of a view for a kind of point is the view's result for each point, whatever kinds come, in whatever
 * order. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include "cut_judge.h"
#include "tiling.h"

static void as_the_view_says(void **state)
{
	uint64_t seed = 5, by_kind = 0, kept = 0, all = 0;

	(void)state;
	for (unsigned i = 0; i < 200; i++) {
		struct view view = VIEW_INIT;
		struct cut_judge judge;
		uint64_t how = random_next(&seed);

		view.keep_noise = how & 1;
		view.keep_withheld = how >> 1 & 1;
		view.drop_overlap = how >> 2 & 1;
		view.surface = how >> 3 & 1;
		view.has_zmin = (how >> 4 & 3) == 0;
		view.has_zmax = (how >> 6 & 3) == 0;
		view.every = (how >> 8 & 3) == 0 ? 3 : 0;
		cut_judge_init(&judge, &view);
		by_kind += judge.by_kind;
		for (unsigned k = 0; k < 1000; k++) {
			/* A hundred kinds: they repeat, and some share a slot. */
			uint64_t pool = i * 100 + random_next(&seed) % 100, kind = random_next(&pool), what = random_next(&seed);
			struct point p = {.x = (int32_t)(what & 63),
					  .y = (int32_t)(what >> 6 & 63),
					  .z = (int32_t)(what >> 12 & 3) - 1,
					  .cls = (uint8_t)(kind & 31),
					  .ret = (uint8_t)(kind >> 5),
					  .tag = (uint16_t)(kind >> 13 & 31)};

			assert_int_equal(cut_judge(&judge, &p), view_judge(&view, &p));
			kept += view_judge(&view, &p) == VIEW_KEPT;
			all++;
		}
	}
	assert_in_range(by_kind, 20, 180);
	assert_in_range(kept, all / 10, all / 10 * 9);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(as_the_view_says)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
