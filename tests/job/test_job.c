/*
 * Jobs with the real engine, in one process: a dataset is pushed, meshed, and streamed to a reader that may be slow or leave; a
 * restart continues over the same folders. The loop is `turn`.
 */
#include "fixture.h"

#include <limits.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include "io.h"
#include "job_priv.h"
#include "log.h"
#include "run_priv.h"

static void push_mesh_fetch(void **state)
{
	static struct reader r; /* static: a failed test ends before the reader */

	r = (struct reader){.output.calls = &reader_calls};
	struct dataset *d = push("valley", 120000, 1);
	struct job *job = submit(d, false, "");
	char hex[DIGEST_HEX_SIZE];
	struct job_info info;

	turn_until_final(job);
	info = info_of(job);
	assert_int_equal(info.state, JOB_done);
	assert_int_equal(info.report->points, 120000);
	assert_int_equal(info.report->used, info.report->vertices);
	assert_true(info.report->domains > 1);
	/* Euler: triangles = 2 vertices - hull - 2. */
	assert_int_equal(info.report->triangles, 2 * info.report->vertices - info.report->hull - 2);
	assert_ptr_equal(submit(d, false, VIEW), job);
	job_fetch(job, &r.output);
	turn_until(r.ends);
	assert_false(r.failed);
	assert_int_equal(r.heads, 1);
	assert_int_equal(r.triangles, info.report->triangles);
	assert_string_equal(digest_hex(r.totals.digest, hex), info.report->digest);
	dataset_release(d);
}

/* A reader takes nothing. What does not fit the window of its mesh goes to files, the rest as soon as others need the memory; the
 * stream is complete in the end. */
static void slow_reader_stops_nobody(void **state)
{
	static struct reader r; /* static: a failed test ends before the reader */

	r = (struct reader){.output.calls = &reader_calls, .slow = true};
	struct dataset *d = push("", 200000, 2), *beside = push("beside", 100000, 3);
	struct job *job = submit(d, true, VIEW), *other;

	job_fetch(job, &r.output);
	turn_until(r.sending);
	turn_until(r.spools);
	turn_until(sched_busy(h.sched) == 0);
	for (int i = 0; i < 10; i++) {
		struct sched_flow flow;

		turn(10);
		sched_flow(h.sched, job->run->owner.flow, &flow);
		assert_int_equal(flow.running + flow.waiting, 0);
	}
	assert_int_equal(r.blocks, 1);
	other = submit(beside, false, VIEW);
	turn_until_final(other);
	assert_int_equal(info_of(other).state, JOB_done);
	assert_int_equal(r.blocks, 1);
	read_on(&r);
	turn_until(r.ends);
	assert_false(r.failed);
	assert_int_equal(r.triangles, r.totals.triangles);
	assert_int_equal(info_of(job).state, JOB_done);
	job_leave(job);
	dataset_release(beside);
	dataset_release(d);
}

/* Many readers take nothing; a push and a job continue. */
static void many_slow_readers(void **state)
{
	enum { READERS = 40 };
	static struct reader r[READERS]; /* static: a failed test ends before the readers */
	struct dataset *d = push("much", 200000, 15), *other;
	struct job *job = submit(d, false, VIEW);
	unsigned still = 0;

	turn_until_final(job);
	for (int i = 0; i < READERS; i++) {
		r[i] = (struct reader){.output.calls = &reader_calls, .slow = true};
		job_fetch(job, &r[i].output);
	}
	/* Each goes as far as it may: then no task runs any more. */
	turn_until((still = sched_busy(h.sched) ? 0 : still + 1) == 20);
	assert_true(r[0].sending);
	other = push("other", 1000, 16);
	job = submit(other, false, VIEW);
	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_done);
	for (int i = 0; i < READERS; i++)
		run_output_close(&r[i].output, r_freed);
	turn_until(!service_active(h.service));
	dataset_release(other);
	dataset_release(d);
}

static atomic_int plans_synced, early_blocks;

static int noting_fsync(int fd)
{
	char link[32], path[PATH_MAX] = "";
	int r = io_system.fsync(fd);

	snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
	if (readlink(link, path, sizeof path - 1) > 0 && strstr(path, "/plan-"))
		plans_synced++;
	return r;
}

static void encode_synced(struct run_output *o, const struct mesh_block *b)
{
	early_blocks += plans_synced != 1;
	r_encode(o, b);
}

/* The plan of a mesh is durable before its first block leaves, whether it was read or made. Nothing waits for the disk if none
 * leaves. */
static void plan_before_block(void **state)
{
	static const char *const views[] = {VIEW, "view 1 window=box:-100000,-100000,100000,100000"};
	static struct reader r; /* static: a failed test ends before the reader */
	struct run_output_calls waiting = reader_calls;
	struct dataset *d = push("valley", 120000, 1);
	char name[32];

	(void)state;
	waiting.encode = encode_synced;
	for (size_t i = 0; i < sizeof views / sizeof *views; i++) {
		struct job *job;
		uint64_t id;

		plans_synced = early_blocks = 0;
		job = submit(d, false, views[i]);
		id = info_of(job).id;
		turn_until_final(job);
		assert_int_equal(info_of(job).state, JOB_done);
		assert_int_equal(plans_synced, 0);
		for (int lost = 0; lost < 2; lost++) {
			snprintf(name, sizeof name, "plans/plan-%llu", (unsigned long long)id);
			assert_true(!lost || unlinkat(h.statefd, name, 0) == 0);
			plans_synced = 0;
			r = (struct reader){.output.calls = &waiting};
			job_fetch(job_find(h.service->jobs, id, &me), &r.output);
			turn_until(r.ends);
			assert_false(r.failed);
			assert_true(r.blocks > 0);
			assert_int_equal(early_blocks, 0);
		}
	}
	dataset_release(d);
}

/* A job whose row cannot be written is refused. Nobody sees it, so it must not run either. */
static void refused_is_not_run(void **state)
{
	struct dataset *d = push("valley", 1000, 1);
	struct rlimit was, none;
	uint64_t done = log_event_count(LOG_EVENT_JOB_DONE);

	turn_until(!service_active(h.service));
	/* No file may grow, so the catalogue cannot be written. */
	signal(SIGXFSZ, SIG_IGN);
	getrlimit(RLIMIT_FSIZE, &was);
	none = (struct rlimit){.rlim_cur = 0, .rlim_max = was.rlim_max};
	setrlimit(RLIMIT_FSIZE, &none);
	submit(d, false, "");
	setrlimit(RLIMIT_FSIZE, &was);
	assert_null(accepted_job);
	assert_true(accepted_err.code == ERR_IO || accepted_err.code == ERR_NOSPACE);
	turn_until(!h.service->jobs->jobs);
	assert_int_equal(log_event_count(LOG_EVENT_JOB_DONE), done);
	turn_until_final(submit(d, false, ""));
	assert_int_equal(log_event_count(LOG_EVENT_JOB_DONE), done + 1);
	dataset_release(d);
}

/* A reader that leaves ends its stream only. */
static void reader_gone(void **state)
{
	static struct reader r; /* static: a failed test ends before the reader */

	r = (struct reader){.output.calls = &reader_calls, .slow = true};
	struct dataset *d = push("", 100000, 3);
	struct job *job = submit(d, true, VIEW);

	job_fetch(job, &r.output);
	turn_until(r.sending);
	run_output_close(&r.output, r_freed);
	turn_until(r.freed);
	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_done);
	assert_int_equal(r.ends, 0);
	job_leave(job);
	dataset_release(d);
}

static void cancel(void **state)
{
	static struct reader r; /* static: a failed test ends before the reader */

	r = (struct reader){.output.calls = &reader_calls, .slow = true};
	struct dataset *d = push("", 100000, 4);
	struct job *job = submit(d, true, VIEW);
	struct err err = ERR_INIT;
	struct job *other;
	uint64_t id;

	job_fetch(job, &r.output);
	turn_until(r.sending);
	assert_int_equal(job_remove(job, &err), -ERR_BUSY);
	job_cancel(job);
	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_cancelled);
	assert_int_equal(r.ends, 1);
	assert_int_equal(r.why.code, ERR_CANCELLED);
	/* A later stream of the job ends in the same way. */
	r = (struct reader){.output.calls = &reader_calls};
	job_fetch(job, &r.output);
	turn_until(r.ends);
	assert_int_equal(r.why.code, ERR_CANCELLED);
	id = info_of(job).id;
	job_leave(job);
	turn(0);
	assert_null(job_find(h.service->jobs, id, &me));
	/* Other users do not see the job; root does. */
	other = submit(d, true, VIEW);
	id = info_of(other).id;
	assert_null(job_find(h.service->jobs, id, &(struct peer){.uid = 1001}));
	assert_ptr_equal(job_find(h.service->jobs, id, &(struct peer){.uid = 0}), other);
	job_leave(other);
	dataset_release(d);
}

static void no_ground(void **state)
{
	struct dataset *d = push("rock", 1000, 5);
	struct view view = VIEW_INIT;
	char *text;
	struct job *job;

	view.ground = true;
	text = view_text(&view);
	job = submit(d, false, text);
	free(text);
	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_failed);
	assert_int_equal(info_of(job).err->code, ERR_INPUT);
	assert_non_null(strstr(info_of(job).err->hint, "PDAL"));
	/* A crop removes most points before their class is judged. The missing classes are still the reason. */
	view.crop = VIEW_CROP_BOX;
	memcpy(view.crop_box, (const int64_t[]){0, 0, 8000000, 8000000}, sizeof view.crop_box);
	for (int i = 0; i < 2; i++) {
		text = view_text(&view);
		job = submit(d, false, text);
		free(text);
		turn_until_final(job);
		assert_int_equal(info_of(job).err->code, ERR_INPUT);
		assert_true(!strstr(info_of(job).err->hint, "PDAL") == (i == 1));
		memcpy(view.crop_box, (const int64_t[]){INT32_MAX, 0, INT32_MAX, 0}, sizeof view.crop_box);
	}
	assert_null(submit(d, false, "rubbish"));
	assert_true(accepted_err.code != 0);
	dataset_release(d);
}

/* A second push makes a second generation on the lattice of the first; both can be meshed. */
static void generations(void **state)
{
	struct dataset *d = push("two", 5000, 6);
	struct job_params p = {.dataset = d, .view = VIEW, .generation = 1, .peer = me};
	struct dataset_info info;
	struct job *old, *new;
	int before;

	dataset_release(d);
	assert_ptr_equal(push("two", 3000, 7), d);
	assert_int_equal(got.committed.generation, 2);
	dataset_info(d, &info);
	assert_int_equal(info.points, 8000);
	assert_int_equal(info.files, 2);
	assert_string_equal(info.lattice, got.lattice);
	new = submit(d, false, VIEW);
	before = accepts;
	job_submit(h.service->jobs, &p, accepted, NULL);
	turn_until(accepts > before);
	old = accepted_job;
	assert_ptr_not_equal(old, new);
	turn_until_final(old);
	turn_until_final(new);
	assert_int_equal(info_of(old).report->points, 5000);
	assert_int_equal(info_of(new).report->points, 8000);
	dataset_release(d);
}

/* After a restart, what the catalogue has continues; what was not committed is absent. */
static void restart(void **state)
{
	struct dataset *d = push("kept", 50000, 8);
	struct job *done = submit(d, false, VIEW), *waits;
	struct view view = VIEW_INIT;
	char *text, digest[DIGEST_HEX_SIZE];
	static struct reader r; /* static: a failed test ends before the reader */

	r = (struct reader){.output.calls = &reader_calls};
	uint64_t ids[2];

	turn_until_final(done);
	snprintf(digest, sizeof digest, "%s", info_of(done).report->digest);
	view.surface = true;
	text = view_text(&view);
	waits = submit(d, false, text);
	free(text);
	ids[0] = info_of(done).id;
	ids[1] = info_of(waits).id;
	push_leave(stage_file_as("kept", "b.xyz", text_file(1000, 9)));
	dataset_release(d);
	close_service();
	open_service(UINT64_C(24) << 20, 1);
	done = job_find(h.service->jobs, ids[0], &me);
	waits = job_find(h.service->jobs, ids[1], &me);
	assert_non_null(done);
	assert_non_null(waits);
	assert_string_equal(info_of(done).report->digest, digest);
	turn_until_final(waits);
	assert_int_equal(info_of(waits).state, JOB_done);
	assert_int_equal(info_of(waits).report->points, 50000);
	/* The mesh can be streamed again, with the same digest under another budget. */
	done = job_find(h.service->jobs, ids[0], &me);
	assert_non_null(done);
	job_fetch(done, &r.output);
	turn_until(r.ends);
	assert_false(r.failed);
}

/* ---- views that select ---- */

/* Number of selections whose folder begins with `prefix`. */
static unsigned selections(const char *prefix)
{
	char path[128];
	struct dirent *e;
	unsigned n = 0;
	DIR *dir;

	snprintf(path, sizeof path, "%s/selected", h.folder);
	dir = opendir(path);
	assert_non_null(dir);
	while ((e = readdir(dir)))
		n += *e->d_name != '.' && !strncmp(e->d_name, prefix, strlen(prefix));
	closedir(dir);
	return n;
}

/* Two jobs need the same selection while a push holds its stage: the selection is made once, both jobs finish, and the memory is
 * returned. */
static void selection_made_once(void **state)
{
	struct dataset *d = push("valley", 120000, 21);
	struct push *holds = stage_file_as("other", "a.xyz", text_file(1000, 22));
	struct job *a = submit(d, false, "view 1 every=3");
	struct job *b = submit(d, false, "view 1 every=3 duplicates=highest");
	struct job_info info;
	uint64_t sum = 0;

	assert_ptr_not_equal(a, b);
	turn_until(job_state_final(info_of(a).state) && job_state_final(info_of(b).state));
	info = info_of(a);
	assert_int_equal(info.state, JOB_done);
	assert_int_equal(info_of(b).state, JOB_done);
	assert_string_equal(info.report->digest, info_of(b).report->digest);
	assert_int_equal(selections(""), 1);
	assert_int_equal(info.report->points, 120000);
	assert_in_range(info.report->used, 38000, 42000);
	for (int i = 0; i < VIEW_RULES; i++)
		sum += info.report->removed[i];
	assert_int_equal(sum + info.report->used, 120000);
	assert_int_equal(info.report->removed[VIEW_BY_EVERY], info_of(b).report->removed[VIEW_BY_EVERY]);
	push_leave(holds);
	turn_until(!service_active(h.service));
	assert_int_equal(ledger_held(h.ledger, LEDGER_STAGE), 0);
	dataset_release(d);
}

/* A selection that waits where it begins, on its worker. */
static atomic_bool hold, held;

int __real_run_space_select_begin(struct run *w, uint64_t memory, struct err *err);
int __wrap_run_space_select_begin(struct run *w, uint64_t memory, struct err *err);

int __wrap_run_space_select_begin(struct run *w, uint64_t memory, struct err *err)
{
	while (hold) {
		held = true;
		poll(NULL, 0, 1);
	}
	return __real_run_space_select_begin(w, memory, err);
}

static bool selects(const struct job *job)
{
	return !strcmp(info_of(job).phase, "select") && info_of(job).points_total == 400000;
}

/* A job that is cancelled during its selection, or while it waits for that of another job, leaves nothing. */
static void selection_cancelled(void **state)
{
	struct dataset *d = push("valley", 400000, 23);
	struct job *a, *b;

	hold = true;
	a = submit(d, false, "view 1 thin=5000:median");
	b = submit(d, false, "view 1 thin=5000:median duplicates=highest");
	turn_until(held && selects(a) && selects(b));
	job_cancel(b);
	job_cancel(a);
	hold = false;
	turn_until(job_state_final(info_of(a).state) && job_state_final(info_of(b).state));
	assert_int_equal(info_of(a).state, JOB_cancelled);
	assert_int_equal(info_of(b).state, JOB_cancelled);
	assert_int_equal(selections(""), 0);
	assert_int_equal(ledger_held(h.ledger, LEDGER_STAGE), 0);
	/* A crop may leave no point: the job is done, with a note. */
	a = submit(d, false, "view 1 crop=box:-9,-9,-8,-8");
	turn_until_final(a);
	assert_int_equal(info_of(a).state, JOB_done);
	assert_int_equal(info_of(a).report->triangles, 0);
	assert_int_equal(info_of(a).report->removed[VIEW_BY_CROP], 400000);
	assert_non_null(strstr(info_of(a).report->note, "fewer than three"));
	dataset_release(d);
}

static int let_teardown(void **state)
{
	hold = false;
	return teardown(state);
}

int main(void)
{
#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, let_teardown)
	const struct CMUnitTest tests[] = {
		TEST(push_mesh_fetch),
		TEST(slow_reader_stops_nobody),
		TEST(plan_before_block),
		TEST(refused_is_not_run),
		TEST(reader_gone),
		TEST(cancel),
		TEST(no_ground),
		TEST(generations),
		TEST(restart),
		TEST(many_slow_readers),
		TEST(selection_made_once),
		TEST(selection_cancelled),
	};

	static struct io_table table;

	/* Before the first thread. */
	table = io_system;
	table.fsync = noting_fsync;
	io = &table;
	return cmocka_run_group_tests(tests, NULL, NULL);
}
