/*
 * The room of jobs with the real engine, in one process: a dataset is pushed, meshed, streamed to a reader
 * who is slow or goes away, and started again over the same folders. The loop is `turn`.
 */
#include "fixture.h"

#include <malloc.h>
#include <signal.h>
#include <sys/resource.h>

#include "job_priv.h"
#include "log.h"
#include "run_priv.h"

/* ---- tests ---- */

static void push_mesh_fetch(void **state)
{
	static struct reader r; /* outlives a failed test */

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

/* A reader who takes nothing: what its mesh cannot keep in its window goes to files, the rest as soon as others need
 * the memory; the stream is whole. */
static void slow_reader_stops_nobody(void **state)
{
	static struct reader r; /* outlives a failed test */

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

/* However many readers take nothing: a push and a job go on. */
static void many_slow_readers(void **state)
{
	enum { READERS = 40 };
	static struct reader r[READERS]; /* outlive a failed test */
	struct dataset *d = push("much", 200000, 15), *other;
	struct job *job = submit(d, false, VIEW);
	uint64_t since;

	turn_until_final(job);
	for (int i = 0; i < READERS; i++) {
		r[i] = (struct reader){.output.calls = &reader_calls, .slow = true};
		job_fetch(job, &r[i].output);
	}
	for (since = clock_mono_ns(); clock_since(since) < 3;)
		turn(10);
	other = push("other", 1000, 16);
	job = submit(other, false, VIEW);
	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_done);
	for (int i = 0; i < READERS; i++)
		run_output_gone(&r[i].output, r_freed);
	turn_until(!service_active(h.service));
	dataset_release(other);
	dataset_release(d);
}

/* A job whose row cannot be written is refused: nobody sees it, so it must not work either. */
static void refused_is_not_run(void **state)
{
	struct dataset *d = push("valley", 1000, 1);
	struct rlimit was, none;
	uint64_t done = log_event_count(LOG_EVENT_JOB_DONE);

	turn_until(!service_active(h.service));
	/* No file may grow: so the catalogue cannot. */
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

/* A reader who goes away ends the stream only. */
static void reader_gone(void **state)
{
	static struct reader r; /* outlives a failed test */

	r = (struct reader){.output.calls = &reader_calls, .slow = true};
	struct dataset *d = push("", 100000, 3);
	struct job *job = submit(d, true, VIEW);

	job_fetch(job, &r.output);
	turn_until(r.sending);
	run_output_gone(&r.output, r_freed);
	turn_until(r.freed);
	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_done);
	assert_int_equal(r.ends, 0);
	job_leave(job);
	dataset_release(d);
}

static void cancel(void **state)
{
	static struct reader r; /* outlives a failed test */

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
	/* A later stream of it ends with the same. */
	r = (struct reader){.output.calls = &reader_calls};
	job_fetch(job, &r.output);
	turn_until(r.ends);
	assert_int_equal(r.why.code, ERR_CANCELLED);
	id = info_of(job).id;
	job_leave(job);
	turn(0);
	assert_null(job_find(h.service->jobs, id, &me));
	/* Others do not see my jobs, root does. */
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
	/* A crop leaves most points unjudged: it is still the classes that are missing. */
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

/* A second push is a second generation on the first one's lattice; both can be meshed. */
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

/* What is in the catalogue goes on after a restart; what was not committed is gone. */
static void restart(void **state)
{
	struct dataset *d = push("kept", 50000, 8);
	struct job *done = submit(d, false, VIEW), *waits;
	struct view view = VIEW_INIT;
	char *text, digest[DIGEST_HEX_SIZE];
	static struct reader r; /* outlives a failed test */

	r = (struct reader){.output.calls = &reader_calls};
	uint64_t ids[2];
	int fd = text_file(1000, 9);

	turn_until_final(done);
	snprintf(digest, sizeof digest, "%s", info_of(done).report->digest);
	view.surface = true;
	text = view_text(&view);
	waits = submit(d, false, text);
	free(text);
	ids[0] = info_of(done).id;
	ids[1] = info_of(waits).id;
	begin("kept");
	ask(push_probe(got.push, dup(fd), &(const struct push_input){.name = "b.xyz"}, NULL));
	ask(push_plan(got.push, NULL));
	ask(push_file(got.push, fd, &(const struct push_input){.name = "b.xyz"}, NULL));
	push_leave(got.push);
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
	/* The mesh can still be streamed, with the same digest under another budget. */
	done = job_find(h.service->jobs, ids[0], &me);
	assert_non_null(done);
	job_fetch(done, &r.output);
	turn_until(r.ends);
	assert_false(r.failed);
}

static void refused_descriptors(void **state)
{
	int ends[2], fd;

	begin("");
	assert_int_equal(pipe(ends), 0);
	ask(push_probe(got.push, ends[0], &(const struct push_input){.name = "pipe"}, NULL));
	assert_int_equal(got.why.code, ERR_INPUT);
	assert_string_equal(got.why.file, "pipe");
	assert_non_null(strstr(got.why.message, "is a pipe, not a regular file"));
	close(ends[1]);
	ask(push_probe(got.push, open("/tmp", O_RDONLY), &(const struct push_input){.name = "folder"}, NULL));
	assert_int_equal(got.why.code, ERR_INPUT);
	fd = open(h.folder, O_TMPFILE | O_WRONLY, 0600);
	ask(push_probe(got.push, fd, &(const struct push_input){.name = "writer"}, NULL));
	assert_int_equal(got.why.code, ERR_PERM);
	ask(push_probe(got.push, open("/dev/zero", O_RDONLY), &(const struct push_input){.name = "device"}, NULL));
	assert_int_equal(got.why.code, ERR_INPUT);
	/* The push goes on, but there is nothing to plan from. */
	ask(push_plan(got.push, NULL));
	assert_int_equal(got.why.code, ERR_USAGE);
	ask(push_commit(got.push, NULL));
	assert_int_equal(got.why.code, ERR_INPUT);
	ask(push_abort(got.push, NULL));
	assert_true(got.aborted);
	push_leave(got.push);
	begin("../escape");
	assert_int_equal(got.why.code, ERR_USAGE);
}

/* What is kept of a file beyond what was taken for it: an error of the plan, a coordinate system of its own. */
static void kept_of_files_is_charged(void **state)
{
	enum { FILES = 64 };
	static struct push_ask a; /* large */
	struct push_probed out = {.name = (char *)"out.las"};
	struct err err = ERR_INIT, again;
	char name[16];
	uint64_t used = 0;

	err_set(&err, ERR_INPUT, "it lies %0200d", 1);
	err_add_place(&err, 227, "box");
	err_add_hint(&err, "leave it %0100d", 2);
	err_add_file(&err, out.name);
	assert_int_equal(push_leave_out(&out, &err), 0);
	/* It makes no source. */
	assert_in_range(malloc_usable_size(out.why), 1, 3 * sizeof(struct grid_source) + 240);
	push_left_out(&out, &again);
	free(out.why);
	assert_int_equal(again.code, err.code);
	assert_int_equal(again.offset, 227);
	assert_string_equal(again.file, err.file);
	assert_string_equal(again.field, err.field);
	assert_string_equal(again.message, err.message);
	assert_string_equal(again.hint, err.hint);

	begin("");
	a = (struct push_ask){.name = name, .path = (char *)"", .columns = (char *)"yxz", .info = {.format = "xyz"}};
	for (unsigned i = 0; i < 2 * FILES; i++) {
		err = ERR_INIT;
		snprintf(name, sizeof name, "%u.las", i);
		if (i >= FILES)
			snprintf(a.info.crs.text, sizeof a.info.crs.text, "system %u", i);
		if (i == FILES)
			used = got.push->table_used;
		assert_int_equal(push_remember_probe(got.push, &a, &err), 0);
		/* Each system is kept once: asked for again, it is the same. */
		assert_ptr_equal(push_find_probe(got.push, name)->crs, push_keep_crs(got.push, &a.info.crs));
		assert_int_equal(got.push->ncrs, i < FILES ? 1 : i - FILES + 2);
	}
	assert_string_equal(push_find_probe(got.push, name)->reading, "xyz columns=yxz");
	assert_int_equal(got.push->ntexts, 2); /* that, and nothing overridden */
	/* That of the file, and that of the dataset's plane. */
	assert_true(got.push->table_used >= 2 * used + 2 * FILES * sizeof(struct crs_info));
	assert_true(got.push->table_bytes + 4096 >= got.push->table_used);
	push_leave(got.push);
}

/* Files are left out one by one: whoever does not want the push any more need not wait for the last of very many. */
static void nobody_waits_for_the_plan_of_a_cancelled_push(void **state)
{
	static const char *const names[] = {"0.las", "1.las", "2.las"};
	static struct push_ask a;
	struct err err = ERR_INIT;

	for (unsigned cancelled = 0; cancelled < 2; cancelled++) {
		unsigned out = 0;

		begin("");
		for (unsigned i = 0; i < 3; i++) {
			a = (struct push_ask){.name = (char *)names[i], .path = (char *)"", .info = {.format = "las"}};
			for (unsigned k = 0; k < 3; k++)
				a.info.coords.scale[k] = (struct decimal){0, 0};
			err = ERR_INIT;
			assert_int_equal(push_remember_probe(got.push, &a, &err), 0);
		}
		atomic_store(&got.push->cancel, cancelled);
		err = ERR_INIT;
		assert_int_equal(push_choose_lattice(got.push, &err), -ERR_INPUT);
		for (unsigned i = 0; i < 3; i++)
			out += push_find_probe(got.push, names[i])->why != NULL;
		assert_int_equal(out, cancelled ? 0 : 2);
		push_leave(got.push);
	}
}

/* Two pushes into a new dataset: only one fixes the lattice. */
static void one_planner(void **state)
{
	struct push *first;
	int fd = text_file(100, 10);

	begin("fresh");
	first = got.push;
	ask(push_probe(first, dup(fd), &(const struct push_input){.name = "a.xyz"}, NULL));
	ask(push_plan(first, NULL));
	assert_int_equal(got.why.code, 0);
	begin("fresh");
	ask(push_probe(got.push, fd, &(const struct push_input){.name = "a.xyz"}, NULL));
	ask(push_plan(got.push, NULL));
	assert_int_equal(got.why.code, ERR_BUSY);
	push_leave(got.push);
	push_leave(first);
	turn_until(!service_active(h.service));
	assert_null(dataset_find(h.service->datasets, "fresh", &me));
}

/* A push with one staged file, ready to be committed. */
static struct push *staged_push(const char *dataset, unsigned n, unsigned seed)
{
	int fd = text_file(n, seed);

	begin(dataset);
	ask(push_probe(got.push, dup(fd), &(const struct push_input){.name = "a.xyz"}, NULL));
	ask(push_plan(got.push, NULL));
	ask(push_file(got.push, fd, &(const struct push_input){.name = "a.xyz"}, NULL));
	assert_int_equal(got.why.code, 0);
	return got.push;
}

/* A commit that the catalogue refused takes nothing with it that a later commit made. */
static void failed_commit(void **state)
{
	struct dataset *d = push("two", 500, 12);
	struct push *loses = staged_push("two", 300, 13), *wins = staged_push("two", 200, 14);
	char path[128];
	struct job *job;
	sqlite3 *other;

	turn_until(!catalogue_busy(h.catalogue));
	snprintf(path, sizeof path, "%s/catalogue.db", h.folder);
	assert_int_equal(sqlite3_open(path, &other), SQLITE_OK);
	assert_int_equal(sqlite3_exec(other, "BEGIN IMMEDIATE", NULL, NULL, NULL), SQLITE_OK);
	ask(push_commit(loses, NULL));
	assert_int_equal(got.why.code, ERR_BUSY);
	assert_int_equal(sqlite3_close(other), SQLITE_OK);
	ask(push_commit(wins, NULL));
	assert_int_equal(got.why.code, 0);
	assert_int_equal(got.committed.generation, 2);
	push_leave(loses);
	push_leave(wins);
	turn_until(!service_active(h.service));
	job = submit(d, false, VIEW);
	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_done);
	assert_int_equal(info_of(job).report->points, 700);
	dataset_release(got.committed.dataset);
	dataset_release(d);
}

static void changed_file(void **state)
{
	int fd = text_file(100, 11);

	begin("");
	ask(push_probe(got.push, dup(fd), &(const struct push_input){.name = "a.xyz"}, NULL));
	ask(push_plan(got.push, NULL));
	assert_int_equal(pwrite(fd, "1 2 3\n", 6, lseek(fd, 0, SEEK_END)), 6);
	ask(push_file(got.push, fd, &(const struct push_input){.name = "a.xyz"}, NULL));
	assert_int_equal(got.why.code, ERR_CHANGED);
	ask(push_file(got.push, text_file(5, 1), &(const struct push_input){.name = "never-probed.xyz"}, NULL));
	assert_int_equal(got.why.code, ERR_USAGE);
	push_leave(got.push);
}

/* ---- views that select ---- */

/* Folders of selections whose names begin so. */
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

/* Two jobs that want the same selection beside a push that holds its stage: it is made once, both are done, the
 * memory is back. */
static void selection_made_once(void **state)
{
	struct dataset *d = push("valley", 120000, 21);
	struct push *holds = staged_push("other", 1000, 22);
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

/* A selection that is held where it begins, on its worker. */
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

/* A job that is cancelled while it selects, or waits for another that does, leaves nothing. */
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
	/* Of a cropped survey nothing may be left: done, and said. */
	a = submit(d, false, "view 1 crop=box:-9,-9,-8,-8");
	turn_until_final(a);
	assert_int_equal(info_of(a).state, JOB_done);
	assert_int_equal(info_of(a).report->triangles, 0);
	assert_int_equal(info_of(a).report->removed[VIEW_BY_CROP], 400000);
	assert_non_null(strstr(info_of(a).report->note, "fewer than three"));
	dataset_release(d);
}

/* Whoever reads some parts looks through the list of all: their number times that of readings stays near to one. */
static void many_parts_in_few_readings(void **state)
{
	for (uint64_t parts = 2; parts < UINT64_C(1) << 40; parts = parts * 7 / 4 + 1) {
		for (unsigned members = 1; members <= 65; members += members < 4 ? 1 : 61) {
			uint64_t step = push_helpers_step(parts, members), readings = parts / step;

			assert_in_range(step, 1, parts);
			assert_true(readings <= parts / 16 || readings <= 65 * 16);
			assert_true(readings >= members || readings >= parts / 16 || step == 1);
			assert_true(readings <= 1100);
		}
	}
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
		TEST(refused_is_not_run),
		TEST(reader_gone),
		TEST(cancel),
		TEST(no_ground),
		TEST(generations),
		TEST(restart),
		TEST(refused_descriptors),
		TEST(one_planner),
		TEST(changed_file),
		TEST(kept_of_files_is_charged),
		TEST(nobody_waits_for_the_plan_of_a_cancelled_push),
		TEST(failed_commit),
		TEST(many_slow_readers),
		TEST(selection_made_once),
		TEST(selection_cancelled),
		cmocka_unit_test(many_parts_in_few_readings),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
