/*
 * The room of jobs with the real engine, in one process: a dataset is pushed, meshed, streamed to a reader
 * who is slow or goes away, and started again over the same folders. The loop is `turn`.
 */
#include <dirent.h>
#include <fcntl.h>
#include <ftw.h>
#include <poll.h>
#include <setjmp.h>
#include <stdatomic.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>
#include <sqlite3.h>

#include "catalogue.h"
#include "clock.h"
#include "job.h"
#include "ledger.h"
#include "push_priv.h"
#include "sched_pool.h"

#define VIEW "view 1"

static const struct job_peer me = {.uid = 1000, .pid = 1};

static struct house {
	char folder[64];
	int statefd, cachefd;
	struct ledger *ledger;
	struct sched *sched;
	struct catalogue *catalogue;
	struct jobs *jobs;
} h;

static void turn(int ms)
{
	struct pollfd p[2] = {{.fd = sched_fd(h.sched), .events = POLLIN},
			      {.fd = catalogue_fd(h.catalogue), .events = POLLIN}};

	poll(p, 2, ms);
	sched_dispatch(h.sched);
	catalogue_dispatch(h.catalogue);
	jobs_settle(h.jobs);
	jobs_tick(h.jobs);
}

/* Turns until `what` is true; fails after twenty seconds. */
#define turn_until(what)                                                                                     \
	do {                                                                                                 \
		uint64_t begun_at = clock_mono_ns();                                                         \
		while (!(what)) {                                                                            \
			if (clock_since(begun_at) > 20)                                                      \
				fail_msg("waited too long for %s", #what);                                   \
			turn(10);                                                                            \
		}                                                                                            \
	} while (0)

static void open_house(uint64_t memory, unsigned threads)
{
	struct jobs_params p = {.threads = threads};
	struct err err = ERR_INIT;
	char path[128];

	snprintf(path, sizeof path, "%s/catalogue.db", h.folder);
	h.statefd = open(h.folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	h.cachefd = dup(h.statefd);
	h.ledger = ledger_new(memory);
	assert_true(ledger_share(h.ledger, LEDGER_MESSAGE, 1 << 20, 0));
	assert_true(ledger_share(h.ledger, LEDGER_CATALOGUE, CATALOGUE_HEAP + CATALOGUE_QUEUE, 0));
	assert_int_equal(sched_new(h.ledger, threads, &h.sched, &err), 0);
	assert_int_equal(catalogue_new(path, h.ledger, &h.catalogue, &err), 0);
	p.ledger = h.ledger;
	p.sched = h.sched;
	p.catalogue = h.catalogue;
	p.statefd = h.statefd;
	p.cachefd = h.cachefd;
	if (jobs_new(&p, &h.jobs, &err))
		fail_msg("%s %s", err.file, err.message);
}

static void close_house(void)
{
	jobs_park(h.jobs);
	turn_until(jobs_parked(h.jobs));
	sched_free(h.sched);
	catalogue_free(h.catalogue);
	jobs_free(h.jobs);
	close(h.statefd);
	close(h.cachefd);
	ledger_free(h.ledger); /* asserts that all was given back */
}

static int remove_one(const char *path, const struct stat *st, int kind, struct FTW *ftw)
{
	return remove(path);
}

static int setup(void **state)
{
	snprintf(h.folder, sizeof h.folder, "/tmp/acut-job-XXXXXX");
	if (!mkdtemp(h.folder))
		return -1;
	open_house(UINT64_C(32) << 20, 2);
	return 0;
}

static int teardown(void **state)
{
	close_house();
	return nftw(h.folder, remove_one, 16, FTW_DEPTH | FTW_PHYS);
}

/* ---- inputs ---- */

/* n positions, made by a fixed rule, as text; a memfd is a regular file. */
static int text_file(unsigned n, unsigned seed)
{
	int fd = memfd_create("points.xyz", MFD_CLOEXEC);
	FILE *f = fdopen(dup(fd), "w");
	uint64_t v = seed * UINT64_C(0x9e3779b97f4a7c15) + 1;

	for (unsigned i = 0; i < n; i++) {
		unsigned x, y;

		v = v * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
		x = (unsigned)(v >> 40);
		v = v * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
		y = (unsigned)(v >> 40);
		fprintf(f, "%u.%02u %u.%02u %u.%02u\n", x / 100, x % 100, y / 100, y % 100, i % 500, i % 100);
	}
	fclose(f);
	return fd;
}

/* ---- a push, step by step ---- */

static struct {
	int answers;
	struct err why;
	struct push *push;
	char lattice[LATTICE_TEXT_SIZE];
	struct push_file file;
	struct push_committed committed;
	uint64_t durable;
	bool aborted;
	enum push_known_as known;
} got;

static void answer(const struct err *why)
{
	got.answers++;
	got.why = why ? *why : ERR_INIT;
}

static void begun(void *token, const struct err *why, const struct push_begun *b)
{
	answer(why);
	got.push = why ? NULL : b->push;
}

static void probed(void *token, const struct err *why, const struct push_probe_result *result)
{
	answer(why);
	got.known = why ? PUSH_NEW : result->known;
}

static void planned(void *token, const struct err *why, const struct push_planned *plan)
{
	answer(why);
	snprintf(got.lattice, sizeof got.lattice, "%s", plan ? plan->lattice : "");
}

static void staged(void *token, const struct err *why, const struct push_file *file)
{
	answer(why);
	if (!why)
		got.file = *file;
}

static void committed(void *token, const struct err *why, const struct push_committed *c)
{
	answer(why);
	if (!why) {
		got.committed = *c;
		dataset_hold(c->dataset);
	}
}

static void aborted(void *token)
{
	answer(NULL);
	got.aborted = true;
}

static void durable(void *ctx, uint64_t files)
{
	got.durable = files;
}

static void progress(void *token, const char *phase, uint64_t points, uint64_t total) {}

static const struct push_calls calls = {begun,     probed,  planned, staged,
					committed, aborted, durable, progress};

#define ask(call)                                                                                            \
	do {                                                                                                 \
		int before = got.answers;                                                                    \
		call;                                                                                        \
		turn_until(got.answers > before);                                                            \
	} while (0)

static void begin(const char *dataset)
{
	struct push_params p = {.dataset = dataset, .peer = me, .calls = &calls};

	memset(&got, 0, sizeof got);
	got.why = ERR_INIT;
	ask(push_begin(h.jobs, &p, NULL));
}

static struct dataset *push(const char *dataset, unsigned n, unsigned seed)
{
	int fd = text_file(n, seed);

	begin(dataset);
	assert_int_equal(got.why.code, 0);
	ask(push_probe(got.push, dup(fd), &(const struct push_input){.name = "a.xyz"}, NULL));
	assert_int_equal(got.why.code, 0);
	ask(push_plan(got.push, NULL));
	assert_int_equal(got.why.code, 0);
	ask(push_file(got.push, fd, &(const struct push_input){.name = "a.xyz"}, NULL));
	assert_int_equal(got.why.code, 0);
	assert_int_equal(got.file.in.points, n);
	ask(push_commit(got.push, NULL));
	if (got.why.code)
		fail_msg("%s %s", got.why.file, got.why.message);
	push_leave(got.push);
	return got.committed.dataset;
}

/* ---- jobs ---- */

static struct job *accepted_job;
static struct err accepted_err;
static int accepts;

static void accepted(void *token, const struct err *why, struct job *job)
{
	accepts++;
	accepted_job = job;
	accepted_err = why ? *why : ERR_INIT;
}

static struct job *submit(struct dataset *d, bool bound, const char *view)
{
	struct job_params p = {.dataset = d, .view = view, .bound = bound, .peer = me};
	int before = accepts;

	job_submit(h.jobs, &p, accepted, NULL);
	turn_until(accepts > before);
	return accepted_job;
}

static struct job_info info_of(const struct job *job)
{
	struct job_info info;

	job_info(job, &info);
	return info;
}

#define turn_until_final(job) turn_until(job_state_final(info_of(job).state))

/* ---- a reader ---- */

struct reader {
	struct job_output output;
	int heads, ends;
	atomic_int blocks, spools;
	bool slow, sending, freed;
	uint64_t sending_ns, triangles;
	struct err why;
	bool failed;
	struct pipe_totals totals;
};

static void r_head(struct job_output *o, const struct job_stream_head *head)
{
	((struct reader *)o)->heads++;
}

static void r_send(struct job_output *o)
{
	struct reader *r = (struct reader *)o;

	if (r->slow) {
		if (!r->sending)
			r->sending_ns = clock_mono_ns();
		r->sending = true;
		return;
	}
	r->sending = false;
	job_output_sent(o);
}

static void r_pause(struct job_output *o) {}

static double r_stalled(struct job_output *o)
{
	struct reader *r = (struct reader *)o;

	return r->sending ? clock_since(r->sending_ns) : 0;
}

static void r_end(struct job_output *o, const struct err *why, const struct pipe_totals *totals,
		  const struct job_report *report)
{
	struct reader *r = (struct reader *)o;

	r->ends++;
	r->failed = why != NULL;
	if (why)
		r->why = *why;
	else
		r->totals = *totals;
}

static void r_encode(struct job_output *o, const struct mesh_block *b)
{
	struct reader *r = (struct reader *)o;

	r->blocks++;
	r->triangles += b->ntriangle;
}

static int r_spool(struct job_output *o, int dirfd, struct err *err)
{
	((struct reader *)o)->spools++;
	o->spooled = true;
	return 0;
}

static int r_refill(struct job_output *o, struct err *err)
{
	return 0;
}

static void r_freed(struct job_output *o)
{
	((struct reader *)o)->freed = true;
}

static const struct job_output_calls reader_calls = {r_head, r_send,   r_pause, r_stalled,
						     r_end,  r_encode, r_spool, r_refill};

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
	for (int i = 0; i < 10; i++)
		turn(10);
	assert_int_equal(sched_busy(h.sched), 0);
	assert_int_equal(r.blocks, 1);
	other = submit(beside, false, VIEW);
	turn_until_final(other);
	assert_int_equal(info_of(other).state, JOB_done);
	assert_int_equal(r.blocks, 1);
	r.slow = r.sending = false;
	job_output_sent(&r.output);
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
		job_output_gone(&r[i].output, r_freed);
	turn_until(!jobs_active(h.jobs));
	dataset_release(other);
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
	job_output_gone(&r.output, r_freed);
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
	assert_null(job_find(h.jobs, id, &me));
	/* Others do not see my jobs, root does. */
	other = submit(d, true, VIEW);
	id = info_of(other).id;
	assert_null(job_find(h.jobs, id, &(struct job_peer){.uid = 1001}));
	assert_ptr_equal(job_find(h.jobs, id, &(struct job_peer){.uid = 0}), other);
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
	job_submit(h.jobs, &p, accepted, NULL);
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
	close_house();
	open_house(UINT64_C(24) << 20, 1);
	done = job_find(h.jobs, ids[0], &me);
	waits = job_find(h.jobs, ids[1], &me);
	assert_non_null(done);
	assert_non_null(waits);
	assert_string_equal(info_of(done).report->digest, digest);
	turn_until_final(waits);
	assert_int_equal(info_of(waits).state, JOB_done);
	assert_int_equal(info_of(waits).report->points, 50000);
	/* The mesh can still be streamed, with the same digest under another budget. */
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
	turn_until(!jobs_active(h.jobs));
	assert_null(dataset_find(h.jobs, "fresh", &me));
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
	turn_until(!jobs_active(h.jobs));
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
	turn_until(!jobs_active(h.jobs));
	assert_int_equal(ledger_held(h.ledger, LEDGER_STAGE), 0);
	dataset_release(d);
}

/* A job that is cancelled while it selects, or waits for another that does, leaves nothing. */
static void selection_cancelled(void **state)
{
	struct dataset *d = push("valley", 400000, 23);
	struct job *a = submit(d, false, "view 1 thin=5000:median");
	struct job *b = submit(d, false, "view 1 thin=5000:median duplicates=highest");

	turn_until(!strcmp(info_of(a).phase, "select") && info_of(a).points_total == 400000);
	job_cancel(b);
	job_cancel(a);
	turn_until(job_state_final(info_of(a).state) && job_state_final(info_of(b).state));
	assert_int_equal(info_of(a).state, JOB_cancelled);
	assert_int_equal(info_of(b).state, JOB_cancelled);
	/* One that was as good as done may be there, whole. */
	assert_int_equal(selections("tmp-"), 0);
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
			uint64_t step = push_crew_step(parts, members), readings = parts / step;

			assert_in_range(step, 1, parts);
			assert_true(readings <= parts / 16 || readings <= 65 * 16);
			assert_true(readings >= members || readings >= parts / 16 || step == 1);
			assert_true(readings <= 1100);
		}
	}
}

int main(void)
{
#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, teardown)
	const struct CMUnitTest tests[] = {
		TEST(push_mesh_fetch), TEST(slow_reader_stops_nobody),
		TEST(reader_gone),     TEST(cancel),
		TEST(no_ground),       TEST(generations),
		TEST(restart),         TEST(refused_descriptors),
		TEST(one_planner),     TEST(changed_file),
		TEST(failed_commit),   TEST(many_slow_readers),
		TEST(selection_made_once), TEST(selection_cancelled),
		cmocka_unit_test(many_parts_in_few_readings),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
