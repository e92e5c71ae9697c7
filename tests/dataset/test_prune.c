/* Prune: generations that stay can be read as before, what nobody needs is removed from the disk, and readers continue. */
#include "segments.h"

static struct pruned pruned_got;

static void pruned(void *token, const struct err *why, const struct pruned *p)
{
	answer(why);
	if (p)
		pruned_got = *p;
}

static void prune(const char *name, uint64_t keep, uint64_t older)
{
	memset(&pruned_got, 0, sizeof pruned_got);
	ask(dataset_prune(named(name), keep, older, &me, pruned, NULL));
}

static void prune_all(void **state)
{
	struct mesh was, third;
	uint64_t before;

	dataset_release(push("old", 30000, 1)); /* generation 1 */
	dataset_release(push("old", 30000, 2)); /* generation 2 */
	dataset_release(push("old", 20000, 3)); /* generation 3 */
	third = mesh_of("old", 3);
	revert("old", 2); /* generation 4: without the second push */
	was = mesh_of("old", 4);
	assert_int_equal(was.points, 50000);
	idle();
	before = dataset_of("old").bytes;

	/* No source is dead before generation 3, but fewer generations can be read. */
	prune("old", 0, 3);
	assert_int_equal(got.why.code, 0);
	assert_int_equal(pruned_got.generations, 2);
	assert_int_equal(pruned_got.points, 0);
	assert_int_equal(dataset_of("old").oldest, 3);
	assert_int_equal(dataset_of("old").bytes, before);
	same_mesh("old", 3, &third);
	assert_null(mesh_job("old", 2));
	assert_int_equal(accepted_err.code, ERR_NOTFOUND);

	prune("old", 1, 0);
	assert_int_equal(got.why.code, 0);
	assert_int_equal(pruned_got.generations, 1);
	assert_int_equal(pruned_got.points, 30000);
	assert_int_equal(pruned_got.files, 1);
	assert_int_equal(pruned_got.oldest, 4);
	assert_true(pruned_got.bytes > 30000 * 16 && pruned_got.bytes == before - dataset_of("old").bytes);
	idle();
	folder_is_tidy("old");
	assert_int_equal(dataset_of("old").segments, 2);
	same_mesh("old", 4, &was);

	/* Again: nothing is left to prune. A restart changes nothing. */
	prune("old", 1, 0);
	assert_int_equal(got.why.code, 0);
	assert_int_equal(pruned_got.generations + pruned_got.points + pruned_got.bytes, 0);
	close_service();
	open_service(UINT64_C(24) << 20, 1);
	assert_int_equal(dataset_of("old").oldest, 4);
	assert_null(mesh_job("old", 3));
	same_mesh("old", 4, &was);
	/* The numbers of sources continue. */
	dataset_release(push("old", 100, 9));
	assert_int_equal(mesh_of("old", 5).points, 50100);
}

/* Out of a segment with points of several pushes. */
static void prune_of_merged(void **state)
{
	struct mesh was;

	for (unsigned i = 1; i <= 4; i++)
		dataset_release(push("mixed", 2000, i));
	idle();
	assert_int_equal(dataset_of("mixed").segments, 1);
	revert("mixed", 2);
	was = mesh_of("mixed", 5);
	assert_int_equal(was.points, 6000);
	prune("mixed", 1, 0);
	assert_int_equal(got.why.code, 0);
	assert_int_equal(pruned_got.points, 2000);
	assert_int_equal(pruned_got.segments, 1);
	idle();
	folder_is_tidy("mixed");
	same_mesh("mixed", 5, &was);
	close_service();
	open_service(UINT64_C(24) << 20, 1);
	same_mesh("mixed", 5, &was);
}

/* The last source is dead: its number is not given again. */
static void prune_last(void **state)
{
	struct mesh was;

	dataset_release(push("last", 3000, 1));
	dataset_release(push("last", 3000, 2));
	revert("last", 2);
	was = mesh_of("last", 3);
	prune("last", 1, 0);
	assert_int_equal(got.why.code, 0);
	idle();
	assert_int_equal(dataset_of("last").segments, 1);
	folder_is_tidy("last");
	close_service();
	open_service(UINT64_C(24) << 20, 1);
	same_mesh("last", 3, &was);
	dataset_release(push("last", 50, 5));
	assert_int_equal(mesh_of("last", 4).points, 3050);
	assert_int_equal(named("last")->next_source, 4);
}

static void prune_refused(void **state)
{
	static struct reader r; /* static: a failed test ends before the reader */
	struct job *job;
	struct mesh was;
	char number[32];

	r = (struct reader){.output.calls = &reader_calls, .slow = true};
	dataset_release(push("used", 30000, 1));
	dataset_release(push("used", 3000, 2));
	was = mesh_of("used", 1);
	prune("used", 1, 1);
	assert_int_equal(got.why.code, ERR_USAGE);
	prune("used", 0, 0);
	assert_int_equal(got.why.code, ERR_USAGE);
	prune("used", 0, 3);
	assert_int_equal(got.why.code, ERR_NOTFOUND);

	struct job_params p = {.dataset = named("used"), .view = VIEW, .generation = 1, .bound = true, .peer = me};
	int before = accepts;

	job_submit(h.service->jobs, &p, accepted, NULL);
	turn_until(accepts > before);
	job = accepted_job;
	job_fetch(job, &r.output);
	turn_until(r.sending);
	prune("used", 1, 0);
	assert_int_equal(got.why.code, ERR_BUSY);
	snprintf(number, sizeof number, "%llu", (unsigned long long)info_of(job).id);
	assert_non_null(strstr(got.why.message, number));
	assert_int_equal(dataset_of("used").oldest, 1);
	read_on(&r);
	turn_until(r.ends);
	job_leave(job);
	same_mesh("used", 1, &was);
}

/* A reader of a generation that is pruned continues. */
static void prune_under_a_reader(void **state)
{
	static struct reader r; /* static: a failed test ends before the reader */
	struct job *job;

	dataset_release(push("read", 60000, 1));
	dataset_release(push("read", 60000, 2));
	revert("read", 1);
	job = mesh_job("read", 2);
	turn_until_final(job);
	r = (struct reader){.output.calls = &reader_calls, .slow = true};
	job_fetch(job, &r.output);
	turn_until(r.sending);
	prune("read", 1, 0);
	assert_int_equal(got.why.code, 0);
	assert_int_equal(pruned_got.points, 60000);
	read_on(&r);
	turn_until(r.ends);
	assert_false(r.failed);
	assert_int_equal(r.triangles, r.totals.triangles);
	idle();
	folder_is_tidy("read");
}

/* No file is removed between the moment when its name is read and its opening. */
static void old_files_stay_while_named(void **state)
{
	struct dataset *d;
	uint64_t bytes;

	dataset_release(push("name", 3000, 1));
	dataset_release(push("name", 3000, 2));
	revert("name", 1);
	idle();
	d = named("name");
	dataset_read_begin(d);
	prune("name", 1, 0);
	assert_int_equal(got.why.code, 0);
	for (int i = 0; i < 20; i++)
		turn(5);
	assert_int_equal(dataset_of("name").segments, 1);
	assert_int_equal(files_of("name", "push-", &bytes), 2);
	assert_int_equal(files_of("name", "manifest-", &bytes), 2);
	dataset_read_end(d);
	turn(0);
	idle();
	folder_is_tidy("name");
}

static void prune_cancelled(void **state)
{
	struct prune *p;
	uint64_t bytes;
	int before;

	h.service->datasets->merge_after_ns = UINT64_MAX;
	dataset_release(push("give", 150000, 1));
	dataset_release(push("give", 150000, 2));
	revert("give", 1);
	h.service->datasets->merge_after_ns = 0;
	bytes = dataset_of("give").bytes;
	gate_close();
	before = got.answers;
	p = dataset_prune(named("give"), 1, 0, &me, pruned, NULL);
	assert_non_null(p);
	step();
	assert_int_equal(got.answers, before);
	dataset_prune_cancel(p);
	gate_open();
	turn_until(got.answers > before);
	assert_int_equal(got.why.code, ERR_CANCELLED);
	assert_int_equal(dataset_of("give").oldest, 1);
	assert_int_equal(dataset_of("give").bytes, bytes);
	idle();
	folder_is_tidy("give");
}

/* A prune that waits for memory can be cancelled, too. */
static void prune_cancelled_while_it_waits(void **state)
{
	struct prune *p;
	uint64_t taken;
	int before;

	dataset_release(push("wait", 30000, 1));
	revert("wait", 1);
	idle();
	taken = ledger_available(h.ledger, LEDGER_STAGE) - (512 << 10); /* enough for a manifest */
	assert_true(ledger_take(h.ledger, LEDGER_STAGE, taken));
	before = got.answers;
	p = dataset_prune(named("wait"), 1, 0, &me, pruned, NULL);
	assert_non_null(p);
	for (int i = 0; i < 20; i++)
		turn(5);
	assert_int_equal(got.answers, before);
	dataset_prune_cancel(p);
	assert_int_equal(got.answers, before + 1);
	assert_int_equal(got.why.code, ERR_CANCELLED);
	ledger_give(h.ledger, LEDGER_STAGE, taken);
	idle();
	assert_int_equal(dataset_of("wait").oldest, 1);
	folder_is_tidy("wait");
}

int main(void)
{
#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, gate_teardown)
	const struct CMUnitTest tests[] = {
		TEST(prune_all),       TEST(prune_last),
		TEST(prune_refused),   TEST(prune_under_a_reader),
		TEST(prune_cancelled), TEST(prune_cancelled_while_it_waits),
		TEST(prune_of_merged), TEST(old_files_stay_while_named),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
