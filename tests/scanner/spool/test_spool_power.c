/*
 * Power cuts during a capture: it runs once over the logging disk of tests/faults, and is cut at every entry of the
 * log, with none, all or some of the sectors that were not synced. What was reported as durable by then must exist,
 * byte for byte; nothing else may be returned than what was written; and the spool can be continued and ended.
 *
 * Two controls, without fsync of files and of folders, must lose data, or the test would prove nothing.
 */
#include "spool_make.h"

#include <sys/stat.h>
#include <unistd.h>

#include "disk_states.h"
#include "io.h"
#include "repeat.h"

enum { RECORDS = 120, EVERY = 17 };

static char folder[64];
static size_t entries;
static const struct disk_entry *disk;

static void play(void)
{
	struct spool_head head;
	struct spool_writer *w;
	struct err err = ERR_INIT;
	char path[96];

	make_head(&head);
	snprintf(path, sizeof(path), "%s/a.spool", folder);
	fault_log_start(folder);
	assert_int_equal(spool_create(path, &head, &w, &err), 0);
	fault_mark(1);
	for (uint64_t i = 0; i < RECORDS; i++) {
		make_append(w, i);
		if (i % EVERY == 5) {
			assert_int_equal(spool_sync(w, &err), 0);
			fault_mark(i + 2); /* so many, minus one */
		}
	}
	assert_int_equal(spool_end(w, &err), 0);
	fault_mark(RECORDS + 2);
	fault_log_stop();
	spool_writer_free(w);
	unlink(path);
	spool_head_clear(&head);
	entries = fault_log(&disk);
}

static uint64_t mark_before(size_t at)
{
	uint64_t mark = 0;

	for (size_t i = 0; i < at; i++)
		if (disk[i].op == DISK_MARK)
			mark = disk[i].n;
	return mark;
}

/* True: everything promised exists. What exists is always correct. */
static bool one(const struct disk_cut *cut)
{
	uint64_t mark = mark_before(cut->at), promised = mark ? mark - 1 : 0;
	char path[96];
	struct make_seen seen;
	struct spool_writer *w;
	struct spool_head head;
	struct err err = ERR_INIT;
	bool kept;

	snprintf(path, sizeof(path), "%s/a.spool", folder);
	disk_state_make(cut, folder);
	if (access(path, F_OK))
		return !mark;
	make_read_all(path, RECORDS, &seen);
	assert_true(!seen.error || !mark || cut->no_file_sync);
	kept = !seen.error || !mark;
	if (!seen.error) {
		uint64_t before = seen.records;

		kept = promised <= RECORDS ? seen.prefix >= promised : seen.tail.ended && seen.records == RECORDS;
		if (!seen.tail.ended) {
			if (spool_continue(path, &head, &w, &err))
				fail_msg("cut at %zu, %llu: %s", cut->at, (unsigned long long)cut->seed, err.message);
			assert_int_equal(spool_end(w, &err), 0);
			spool_writer_free(w);
			spool_head_clear(&head);
			make_read_all(path, seen.next, &seen);
			assert_int_equal(seen.records, before);
			assert_true(seen.tail.ended);
			assert_int_equal(seen.tail.torn, 0);
		}
	}
	unlink(path);
	return kept;
}

static unsigned long run(struct disk_cut cut, unsigned seeds)
{
	unsigned long lost = 0;

	for (cut.at = 1; cut.at <= entries; cut.at++)
		for (cut.seed = 0; cut.seed < seeds; cut.seed++) {
			struct disk_cut c = cut;

			c.seed = cut.seed < 2 ? cut.seed : cut.at * 131 + cut.seed;
			if (!one(&c)) {
				lost++;
				if (!c.no_file_sync && !c.no_folder_sync)
					printf("lost: cut at %zu, %llu\n", c.at, (unsigned long long)c.seed);
			}
		}
	return lost;
}

static void test_cuts(void **state)
{
	assert_int_equal(run((struct disk_cut){0}, 6), 0);
	printf("%zu entries cut 6 ways\n", entries);
}

static void test_controls(void **state)
{
	assert_true(run((struct disk_cut){.no_file_sync = true}, 2) > 20);
	assert_true(run((struct disk_cut){.no_folder_sync = true}, 1) > 20);
}

static int setup(void **state)
{
	repeat_folder(folder, sizeof folder, "spool-power");
	fault_io_start();
	play();
	return 0;
}

static int teardown(void **state)
{
	return rmdir(folder);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_cuts), cmocka_unit_test(test_controls)};

	return cmocka_run_group_tests(tests, setup, teardown);
}
