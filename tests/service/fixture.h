/*
 * The rooms of the daemon with the real engine, in one process: a service over a folder of its own, inputs, a push step by step,
 * jobs, and a reader that may be slow. The loop is `turn`.
 */
#ifndef FIXTURE_H
#define FIXTURE_H

/* Each test uses some of it. */
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wunused-variable"

#include <dirent.h>
#include <fcntl.h>
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
#include "ledger.h"
#include "push_priv.h"
#include "sched_pool.h"
#include "service.h"
#include "repeat.h"

#define VIEW "view 1"

static const struct peer me = {.uid = 1000, .pid = 1};

static struct fixture {
	char folder[64];
	int statefd, cachefd;
	struct ledger *ledger;
	struct sched *sched;
	struct catalogue *catalogue;
	struct service *service;
} h;

static void turn(int ms)
{
	struct pollfd p[2] = {{.fd = sched_fd(h.sched), .events = POLLIN}, {.fd = catalogue_fd(h.catalogue), .events = POLLIN}};

	poll(p, 2, ms);
	sched_dispatch(h.sched);
	catalogue_dispatch(h.catalogue);
	service_settle(h.service);
	service_tick(h.service);
}

/* Turns until `what` is true; fails after a hundred seconds (sanitizers are slow). */
#define turn_until(what)                                                   \
	do {                                                               \
		uint64_t begun_at = clock_mono_ns();                       \
		while (!(what)) {                                          \
			if (clock_since(begun_at) > 100)                   \
				fail_msg("waited too long for %s", #what); \
			turn(10);                                          \
		}                                                          \
	} while (0)

/* Memory for datasets, jobs and pushes: the most that they may be charged (0: no limit), and the part that is kept for them. */
static uint64_t service_most, service_aside;

static double service_defer; /* core_params.defer_seconds */

static void open_service(uint64_t memory, unsigned threads)
{
	struct service_params p = {.core = {.threads = threads, .defer_seconds = service_defer}};
	struct err err = ERR_INIT;
	char path[128];

	snprintf(path, sizeof path, "%s/catalogue.db", h.folder);
	h.statefd = open(h.folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	h.cachefd = dup(h.statefd);
	h.ledger = ledger_new(memory);
	assert_true(ledger_reserve(h.ledger, LEDGER_MESSAGE, 1 << 20, 0));
	assert_true(ledger_reserve(h.ledger, LEDGER_CATALOGUE, CATALOGUE_HEAP + CATALOGUE_QUEUE, 0));
	assert_true(ledger_reserve(h.ledger, LEDGER_JOBS, service_aside, service_most));
	assert_int_equal(sched_new(h.ledger, threads, &h.sched, &err), 0);
	assert_int_equal(catalogue_new(path, h.ledger, &h.catalogue, &err), 0);
	p.core.ledger = h.ledger;
	p.core.sched = h.sched;
	p.core.catalogue = h.catalogue;
	p.core.statefd = h.statefd;
	p.core.cachefd = h.cachefd;
	if (service_new(&p, &h.service, &err))
		fail_msg("%s %s", err.file, err.message);
}

static void close_service(void)
{
	service_stop(h.service);
	turn_until(service_is_stopped(h.service));
	sched_free(h.sched);
	catalogue_free(h.catalogue);
	service_free(h.service);
	close(h.statefd);
	close(h.cachefd);
	ledger_free(h.ledger); /* asserts that all was given back */
}

static int setup(void **state)
{
	repeat_folder(h.folder, sizeof h.folder, "job");
	open_service(UINT64_C(32) << 20, 2);
	return 0;
}

static int teardown(void **state)
{
	close_service();
	return repeat_remove(h.folder);
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

/* A line of n vertices at the positions of text_file, which crosses itself. */
static int lines_file(unsigned n, unsigned seed)
{
	int points = text_file(n, seed), fd = memfd_create("lines.txt", MFD_CLOEXEC);
	FILE *from = fdopen(points, "r"), *f = fdopen(dup(fd), "w");
	char row[128];

	rewind(from);
	fprintf(f, "acut-lines 1\nfeature %u hard\nline\n", seed);
	while (fgets(row, sizeof row, from))
		fputs(row, f);
	fclose(from);
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

static void progress(void *token, const char *phase, uint64_t points, uint64_t total, const char *waiting) {}

static const struct push_calls calls = {begun, probed, planned, staged, committed, aborted, durable, progress};

#define ask(call)                                 \
	do {                                      \
		int before = got.answers;         \
		call;                             \
		turn_until(got.answers > before); \
	} while (0)

static void begin(const char *dataset)
{
	struct push_params p = {.dataset = dataset, .peer = me, .calls = &calls};

	memset(&got, 0, sizeof got);
	got.why = ERR_INIT;
	ask(push_begin(h.service->pushes, &p, NULL));
}

/* A push with one file, staged and not committed. The file is closed. */
static struct push *stage_input(const char *dataset, const struct push_input *input, int fd)
{
	begin(dataset);
	assert_int_equal(got.why.code, 0);
	ask(push_probe(got.push, dup(fd), input, NULL));
	assert_int_equal(got.why.code, 0);
	ask(push_plan(got.push, NULL));
	assert_int_equal(got.why.code, 0);
	ask(push_file(got.push, fd, input, NULL));
	assert_int_equal(got.why.code, 0);
	return got.push;
}

static struct push *stage_file_as(const char *dataset, const char *file, int fd)
{
	const struct push_input input = {.name = file};

	return stage_input(dataset, &input, fd);
}

/* The file is closed. */
static struct dataset *push_file_as(const char *dataset, const char *file, int fd)
{
	stage_file_as(dataset, file, fd);
	ask(push_commit(got.push, NULL));
	if (got.why.code)
		fail_msg("%s %s", got.why.file, got.why.message);
	push_leave(got.push);
	return got.committed.dataset;
}

static struct dataset *push(const char *dataset, unsigned n, unsigned seed)
{
	struct dataset *d = push_file_as(dataset, "a.xyz", text_file(n, seed));

	assert_int_equal(got.file.in.points, n);
	return d;
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

	job_submit(h.service->jobs, &p, accepted, NULL);
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
	struct run_output output;
	int heads, ends;
	atomic_int blocks, spools;
	bool slow, sending, paused, freed;
	uint64_t sending_ns, triangles;
	struct err why;
	bool failed;
	struct pipe_totals totals;
};

static void r_head(struct run_output *o, const struct run_head *head)
{
	((struct reader *)o)->heads++;
}

static void r_send(struct run_output *o)
{
	struct reader *r = (struct reader *)o;

	r->paused = false;
	if (r->slow) {
		if (!r->sending)
			r->sending_ns = clock_mono_ns();
		r->sending = true;
		return;
	}
	r->sending = false;
	run_output_sent(o);
}

/* A worker is in its block, until it is sent again. */
static void r_pause(struct run_output *o)
{
	((struct reader *)o)->paused = true;
}

/* A slow one is slow no longer: it takes what it was sent, or what it is sent when no worker is in it any more. */
static void read_on(struct reader *r)
{
	r->slow = false;
	if (r->sending && !r->paused)
		r_send(&r->output);
}

static double r_stalled(struct run_output *o)
{
	struct reader *r = (struct reader *)o;

	return r->sending ? clock_since(r->sending_ns) : 0;
}

static void r_end(struct run_output *o, const struct err *why, const struct pipe_totals *totals, const struct job_report *report)
{
	struct reader *r = (struct reader *)o;

	r->ends++;
	r->failed = why != NULL;
	if (why)
		r->why = *why;
	else
		r->totals = *totals;
}

static void r_encode(struct run_output *o, const struct mesh_block *b)
{
	struct reader *r = (struct reader *)o;

	r->blocks++;
	r->triangles += b->ntriangle;
}

static int r_spool(struct run_output *o, int dirfd, struct err *err)
{
	((struct reader *)o)->spools++;
	o->spooled = true;
	return 0;
}

static int r_refill(struct run_output *o, struct err *err)
{
	return 0;
}

static void r_freed(struct run_output *o)
{
	((struct reader *)o)->freed = true;
}

static const struct run_output_calls reader_calls = {r_head, r_send, r_pause, r_stalled, r_end, r_encode, r_spool, r_refill};

#endif
