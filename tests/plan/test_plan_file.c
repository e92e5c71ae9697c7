/*
 * Plans in files: a written plan is read back, splits are applied once and in any order, an incomplete split at the end is
 * ignored, and damage anywhere is found.
 */
#include "plan_fixture.h"

static void test_written_is_read(void **state)
{
	static const size_t sizes[] = {1, 2, 40, 61};

	for (size_t k = 0; k < 4; k++) {
		struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
		struct cut_plan p = plan_of(sizes[k]), q;
		struct digest base = write_plan(f, &p, 600);
		struct plan_kept kept;
		size_t seen;

		assert_int_equal(read_plan(&q, &kept, &seen), 0);
		assert_int_equal(q.n, p.n);
		for (size_t i = 0; i < p.n; i++)
			same_leaf(&q.leaf[i], &p.leaf[i]);
		assert_int_equal(kept.load, 500);
		assert_int_equal(kept.cap, 600);
		assert_true(digest_equal(kept.base, base));
		/* Another cap gives other splits, so another stream. */
		assert_false(digest_equal(write_plan(f, &p, 601), base));
		assert_true(digest_equal(write_plan(f, &p, 600), base));
		cut_plan_done(&q);
		cut_plan_done(&p);
		plan_file_free(f);
	}
}

static void test_splits(void **state)
{
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL), *g = plan_file_new(dirfd, 7, 3, true, NULL);
	struct cut_plan p = plan_of(5), q, follower;
	struct cut_leaf half[2], quarter[2];
	struct plan_kept kept;
	struct err err = ERR_INIT;
	struct digest base = write_plan(f, &p, 600);
	size_t seen, none;

	assert_int_equal(plan_file_read(f, &follower, &kept, &none, &err), 0);
	assert_int_equal(none, 0);
	split_leaf(f, &p.leaf[2].region, half);
	split_leaf(f, &half[1].region, quarter);
	/* The same split by another run, and by another process, is in the plan once. */
	split_leaf(f, &p.leaf[2].region, half);
	assert_int_equal(plan_file_read(g, &q, &kept, &seen, &err), 0);
	cut_plan_done(&q);
	split_leaf(g, &p.leaf[2].region, half);
	assert_int_equal(read_plan(&q, &kept, &seen), 0);
	assert_int_equal(q.n, 7);
	same_leaf(&q.leaf[1], &p.leaf[1]);
	same_leaf(&q.leaf[2], &half[0]);
	same_leaf(&q.leaf[3], &quarter[0]);
	same_leaf(&q.leaf[4], &quarter[1]);
	same_leaf(&q.leaf[5], &p.leaf[3]);
	assert_true(digest_equal(kept.base, base));
	/* A follower applies the splits, but not those before `least`. */
	assert_int_equal(plan_file_follow(f, &none, 2, &follower, &err), 0);
	assert_int_equal(none, 2);
	assert_int_equal(follower.n, 7);
	for (size_t i = 0; i < 7; i++)
		same_leaf(&follower.leaf[i], &q.leaf[i]);
	cut_plan_done(&q);
	cut_plan_done(&follower);
	cut_plan_done(&p);
	plan_file_free(f);
	plan_file_free(g);
}

/* Cut at any byte of the last split, the file has no such split; the next split takes its place. */
static void test_torn_split(void **state)
{
	struct cut_plan p = plan_of(4);

	for (size_t cut = 1; cut <= 3 * RECORD; cut += 37) {
		struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL), *g = plan_file_new(dirfd, 7, 3, true, NULL);
		struct cut_leaf half[2];
		struct plan_kept kept;
		struct cut_plan q;
		struct err err = ERR_INIT;
		size_t seen;

		write_plan(f, &p, 600);
		split_leaf(f, &p.leaf[0].region, half);
		split_leaf(f, &p.leaf[1].region, half);
		assert_int_equal(leaves_now(), 6);
		assert_int_equal(plan_file_read(g, &q, &kept, &seen, &err), 0);
		cut_plan_done(&q);
		{
			int fd = openat(dirfd, "plan-7", O_RDWR);

			assert_int_equal(ftruncate(fd, (off_t)(11 * RECORD - cut)), 0);
			close(fd);
		}
		assert_int_equal(leaves_now(), 5);
		plan_file_free(g);
		g = plan_file_new(dirfd, 7, 3, true, NULL);
		assert_int_equal(plan_file_read(g, &q, &kept, &seen, &err), 0);
		split_leaf(g, &p.leaf[3].region, half);
		assert_int_equal(leaves_now(), 6);
		cut_plan_done(&q);
		plan_file_free(f);
		plan_file_free(g);
	}
	cut_plan_done(&p);
}

/* Records of finished domains between splits are read; an incomplete one at the end is ignored. */
static void test_done(void **state)
{
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
	struct cut_plan p = plan_of(4);
	struct cut_leaf half[2];
	struct err err = ERR_INIT;
	struct records t;

	unlinkat(dirfd, "plan-7", 0);
	assert_int_equal(records_now(&t), 0);
	write_plan(f, &p, 600);
	for (uint64_t i = 0; i < 4; i++) {
		struct plan_done d = done_of(&p.leaf[i], i);

		assert_int_equal(plan_file_done(f, &d, 1, &err), 0);
		if (i == 1)
			split_leaf(f, &p.leaf[0].region, half);
	}
	split_leaf(f, &p.leaf[1].region, half);
	assert_int_equal(leaves_now(), 6);
	assert_int_equal(records_now(&t), 4);
	for (uint64_t i = 0; i < 4; i++) {
		struct plan_done d = done_of(&p.leaf[i], i);

		assert_true(cut_region_same(&t.done[i].region, &d.region));
		assert_true(digest_equal(t.done[i].base, d.base) && digest_equal(t.done[i].list, d.list) &&
			    digest_equal(t.done[i].digest, d.digest));
		assert_true(t.done[i].payload == d.payload && t.done[i].triangles == d.triangles && t.done[i].bytes == d.bytes);
	}
	{
		struct plan_done d = done_of(&p.leaf[2], 9);
		int fd = openat(dirfd, "plan-7", O_RDWR);
		off_t end = lseek(fd, 0, SEEK_END);

		assert_int_equal(plan_file_done(f, &d, 1, &err), 0);
		assert_int_equal(records_now(&t), 5);
		assert_int_equal(ftruncate(fd, end + RECORD - 1), 0);
		assert_int_equal(records_now(&t), 4);
		assert_int_equal(leaves_now(), 6);
		close(fd);
	}
	cut_plan_done(&p);
	plan_file_free(f);
}

static void test_damage(void **state)
{
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
	struct cut_plan p = plan_of(4);
	int fd;

	log_init("test", LOG_LEVEL_ERROR);
	write_plan(f, &p, 600);
	fd = openat(dirfd, "plan-7", O_RDWR);
	for (off_t at = 0; at < 5 * RECORD; at += 3) {
		uint8_t byte;

		assert_int_equal(pread(fd, &byte, 1, at), 1);
		byte ^= 16;
		assert_int_equal(pwrite(fd, &byte, 1, at), 1);
		assert_int_equal(leaves_now(), 0);
		byte ^= 16;
		assert_int_equal(pwrite(fd, &byte, 1, at), 1);
	}
	assert_int_equal(leaves_now(), 4);
	assert_int_equal(ftruncate(fd, 5 * RECORD - 1), 0);
	assert_int_equal(leaves_now(), 0);
	close(fd);
	/* A plan of another job or generation. */
	write_plan(f, &p, 600);
	{
		struct plan_file *other = plan_file_new(dirfd, 7, 4, true, NULL);
		struct plan_kept kept;
		struct cut_plan q;
		struct err err = ERR_INIT;
		size_t seen;

		assert_int_equal(plan_file_read(other, &q, &kept, &seen, &err), PLAN_FILE_ABSENT);
		plan_file_free(other);
	}
	assert_int_equal(plan_file_job("plan-7"), 7);
	assert_int_equal(plan_file_job("plan-7.tmp"), 0);
	assert_int_equal(plan_file_job("catalogue"), 0);
	cut_plan_done(&p);
	plan_file_free(f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_written_is_read), cmocka_unit_test(test_splits),
		cmocka_unit_test(test_torn_split),      cmocka_unit_test(test_done),
		cmocka_unit_test(test_damage),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
