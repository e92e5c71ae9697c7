/*
 * Pending pushes that are removed: discarded by their user or by the owner, also in a removed dataset, or too many.
 */
#include <errno.h>

#include "pending.h"

static struct discarded discarded;

static void on_discarded(void *token, const struct err *why, const struct discarded *d)
{
	*(int *)token = why ? -(int)why->code : 1;
	discarded = *d;
}

/* 1, or the error. */
static int discard_as(const struct peer *who, bool all)
{
	int answered = 0;

	dataset_discard(h.service->datasets, "a", who, all, on_discarded, &answered);
	turn_until(answered);
	return answered;
}

/* Expects that so many pushes with so many files are gone. */
static void discard(const struct peer *who, bool all, unsigned pushes, unsigned files)
{
	assert_int_equal(discard_as(who, all), 1);
	assert_int_equal(discarded.pushes, pushes);
	assert_int_equal(discarded.files, files);
	assert_int_equal(discarded.bytes > 0, pushes > 0);
}

static uint64_t counted(void)
{
	struct space_stat stat;

	space_stat(h.service->core->space, &stat);
	return stat.kind[SPACE_PENDING].bytes;
}

/* Those of one user, or of all; never what an open push has taken over. */
static void test_discard(void **state)
{
	uint64_t dropped = log_event_count(LOG_EVENT_PUSH_DROPPED), ids[2], bytes;
	struct dataset *d;
	struct push *open;

	for (unsigned way = 0; way < 2; way++) {
		push_all("5");
		discard(&me, true, 0, 0);
		interrupt_of(&bert, "01");
		bytes = counted();
		interrupt("12");
		interrupt("3");
		expect(3, 5, 1);
		begin_of(&me);
		open = got.push;
		assert_int_equal(probe(3), PUSH_ADOPTED);
		expect(2, 4, 1);
		d = dataset_find(h.service->datasets, "a", &me);
		assert_int_equal(pushes_into(h.service->pushes, d, me.uid, false, ids, 2), 1);
		assert_int_equal(pushes_into(h.service->pushes, d, bert.uid, false, ids, 2), 0);
		assert_int_equal(pushes_into(h.service->pushes, d, bert.uid, true, ids, 2), 1);
		discard(&me, way, 1 + way, 2 + 2 * way);
		assert_int_equal(info().pending, !way);
		discard(&me, way, 0, 0);
		got.push = open;
		leave();
		expect(2 - way, 3 - 2 * way, 1);
		if (way)
			restart();
		discard(&me, false, 1, 1);
		assert_int_equal(counted(), way ? 0 : bytes);
		expect(!way, way ? 0 : 2, 1);
		restart();
		expect(!way, way ? 0 : 2, 1);
		push_all("123");
		expect_known("123", PUSH_NEW);
		if (!way) {
			/* The other one's is whole. */
			push_of(&bert, "01");
			expect_known("0", PUSH_ADOPTED);
		}
		expect(0, 0, 5 - way);
		no_leftovers();
		teardown(state);
		setup(state);
	}
	assert_int_equal(log_event_count(LOG_EVENT_PUSH_DROPPED), dropped + 5);
}

static int removals;

static void on_removed(void *token, const struct err *why, struct dataset *d)
{
	assert_null(why);
	removals++;
}

/* The user of a pending push in a removed dataset reaches it by the name, also if another dataset has that now, of the same owner
 * or of another one. */
static void test_discard_removed(void **state)
{
	const struct dataset_action_params remove = {.action = DATASET_REMOVE, .name = "a", .as = "", .peer = me};
	const struct peer other = {.uid = 1002, .pid = 3};
	uint64_t bytes;

	for (unsigned way = 0; way < 3; way++) {
		if (way)
			push_all("5");
		interrupt("2");
		interrupt_of(&bert, "01");
		removals = 0;
		dataset_act(h.service->datasets, &remove, on_removed, NULL);
		turn_until(removals);
		restart();
		bytes = counted();
		assert_true(bytes > 0);
		/* One who has none does not learn of it. */
		assert_int_equal(discard_as(&other, false), -ERR_NOTFOUND);
		assert_int_equal(discard_as(&other, true), -ERR_NOTFOUND);
		if (way == 1)
			push_all("3");
		if (way == 2) {
			push_of(&bert, "3");
			assert_int_equal(discard_as(&me, true), -ERR_PERM);
			assert_int_equal(discarded.pushes, 0);
			assert_int_equal(counted(), bytes);
		}
		discard(&bert, false, 1, 2);
		assert_true(counted() > 0 && counted() < bytes);
		discard(&me, way < 2, 1, 1);
		assert_int_equal(counted(), 0);
		/* Without a generation it goes, too. */
		turn_until(!service_active(h.service));
		assert_int_equal(datasets_first(h.service->datasets) != NULL, way > 0);
		restart();
		assert_int_equal(datasets_first(h.service->datasets) != NULL, way > 0);
		teardown(state);
		setup(state);
	}
}

static atomic_bool unlink_fails;

static int failing_unlinkat(int dirfd, const char *path, int flags)
{
	if (unlink_fails && strstr(path, ".pending")) {
		errno = EIO;
		return -1;
	}
	return unlinkat(dirfd, path, flags);
}

/* What cannot be removed, beginning with the list of its files, is pending as before, and nothing is said to be discarded. */
static void test_discard_fails(void **state)
{
	uint64_t dropped = log_event_count(LOG_EVENT_PUSH_DROPPED), bytes;
	int answered = 0;

	interrupt("01");
	interrupt("2");
	bytes = counted();
	unlink_fails = true;
	dataset_discard(h.service->datasets, "a", &me, false, on_discarded, &answered);
	expect(0, 0, 0);
	turn_until(answered);
	unlink_fails = false;
	assert_int_equal(answered, -ERR_IO);
	expect(2, 3, 0);
	assert_int_equal(counted(), bytes);
	assert_int_equal(log_event_count(LOG_EVENT_PUSH_DROPPED), dropped);
	push_all("01");
	expect_known("01", PUSH_ADOPTED);
	discard(&me, false, 1, 1);
	expect(0, 0, 2);
	no_leftovers();
}

/* The oldest of more than a user may have is dropped; another user has as many. */
static void test_most(void **state)
{
	uint64_t dropped = log_event_count(LOG_EVENT_PUSH_DROPPED);

	interrupt_of(&bert, "5");
	interrupt("0");
	for (unsigned i = 0; i < PENDING_MOST; i++) {
		replace_file(1, text_file(EACH, 100 + i));
		interrupt("1");
	}
	turn_until(info().pending == PENDING_MOST + 1);
	assert_int_equal(log_event_count(LOG_EVENT_PUSH_DROPPED), dropped + 1);
	push_all("01");
	expect_known("0", PUSH_NEW);
	expect_known("1", PUSH_ADOPTED);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(test_discard),
		TEST(test_discard_removed),
		TEST(test_discard_fails),
		TEST(test_most),
	};
	struct io_table table = io_system;

	table.unlinkat = failing_unlinkat;
	io = &table; /* while there is no other thread */
	return cmocka_run_group_tests(tests, NULL, NULL);
}
