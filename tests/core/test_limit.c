/* Bytes on the disk by user: what counts with whom, and how much is left. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "core_priv.h"

enum { ANNA = 1001, BERT = 1002, PENDING = 82000 };

/* What was pushed: a dataset of one user, an interrupted push of another. */
struct listed {
	uint64_t dataset, pending;
};

static void each(void *ctx, core_usage_fn *add, void *to)
{
	const struct listed *l = ctx;

	add(to, ANNA, l->dataset, false);
	add(to, BERT, l->pending, true);
}

static uint64_t has(struct core *core, uint32_t uid)
{
	uint64_t bytes, most;

	limit_disk_of(core, uid, 0, &bytes, &most);
	assert_int_equal(most, 100000);
	return bytes;
}

/* An interrupted push counts with who pushed, not with the owner of the dataset; grids and what is taken beside it. */
static void whose_disk(void **state)
{
	const struct limit_geoid grids[] = {{BERT, 1000}, {BERT, 500}, {ANNA, 7}};
	struct listed listed = {.dataset = 5000, .pending = PENDING};
	struct core_private priv = {0};
	struct core core = {.p.limits.user.disk = {.n = 100000, .unit = SPACE_BYTES}, .usage = {&listed, each}, .priv = &priv};
	const uint64_t pending = PENDING;
	struct err err = ERR_INIT;

	limit_init(&priv);
	limit_recount(&core);
	limit_geoids(&core, grids, 3);
	assert_int_equal(has(&core, ANNA), 5007);
	assert_int_equal(has(&core, BERT), pending + 1500);
	/* The refusal says what can be discarded, if there is anything. */
	assert_int_equal(limit_disk_take(&core, ANNA, false, 100000, "it", &err), -ERR_LIMIT);
	assert_null(strstr(err.hint, "dataset discard"));
	err_clear(&err);
	assert_int_equal(limit_disk_take(&core, BERT, false, 100000, "it", &err), -ERR_LIMIT);
	assert_non_null(strstr(err.hint, "interrupted pushes have 80 KB of it (acutctl dataset discard)"));
	err_clear(&err);
	/* Rows outlive a count by what it does not know. */
	assert_int_equal(limit_disk_take(&core, BERT, false, 10, "it", &err), 0);
	listed.pending = 0;
	limit_recount(&core);
	assert_int_equal(has(&core, BERT), 1510);
	/* There is room to the last byte, and what is refused takes nothing. */
	assert_int_equal(limit_disk_take(&core, BERT, false, 100000 - 1509, "it", &err), -ERR_LIMIT);
	assert_string_equal(err.field, "user-disk");
	assert_int_equal(limit_disk_take(&core, BERT, false, 100000 - 1510, "it", &err), 0);
	assert_int_equal(limit_disk_take(&core, BERT, false, 1, "it", &err), -ERR_LIMIT);
	limit_disk_give(&core, BERT, 100000 - 1510);
	/* What was taken and lies there now: in one step. And back. */
	listed.pending = PENDING;
	limit_release_and_recount(&core, BERT, 10, ANNA, 0);
	assert_int_equal(has(&core, BERT), pending + 1500);
	listed.pending = 0;
	limit_release_and_recount(&core, BERT, -(int64_t)pending, ANNA, -5);
	assert_int_equal(has(&core, BERT), pending + 1500);
	assert_int_equal(has(&core, ANNA), 5012);
	/* Also while there is no limit: what was taken under one is given back. */
	core.p.limits.user.disk.unit = SPACE_UNLIMITED;
	limit_release_and_recount(&core, BERT, (int64_t)pending, ANNA, 5);
	core.p.limits.user.disk.unit = SPACE_BYTES;
	limit_recount(&core);
	limit_geoids(&core, grids, 0);
	limit_recount(&core);
	assert_int_equal(has(&core, BERT), 0);
	assert_int_equal(priv.limits.n, 1);
	limit_done(&priv);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(whose_disk)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
