/*
 * Every N-th file call fails, N = 1, 2, ... until there are not so many: once, and for ever, with an error, or a transfer
 * by half; ours, and SQLite's. A service is opened, two files are pushed, a third push is interrupted and discarded, a job is
 * done and its mesh is streamed; then files of lines come, and one of them is reverted. What must hold: whoever asked gets an
 * answer, right or a typed error that says something; when the fault is gone the same can be done again, with the right mesh;
 * nothing is left, neither descriptors nor files; a file whose fsync failed is not trusted.
 *
 * ACUT_FAULT_EVERY: how many calls apart the points are that are tried (3).
 */
#include "scene.h"

#include <errno.h>

static char want[DIGEST_HEX_SIZE], want_lines[DIGEST_HEX_SIZE];
static unsigned long first_call, every, step, reached;
static struct fault_plan plan;
static const char *plan_text;

static unsigned long at_of(unsigned long i)
{
	return first_call + i * step;
}

static void typed(const char *what, const struct err *err)
{
	static const enum err_code fine[] = {ERR_IO, ERR_NOSPACE, ERR_BUSY, ERR_LIMIT, ERR_PERM, ERR_CORRUPT, ERR_CANCELLED};

	for (unsigned i = 0; i < sizeof fine / sizeof *fine; i++)
		if (err->code == fine[i] && *err->message)
			return;
	printf("%s: no good error: %d \"%s\"\n", what, (int)err->code, err->message);
	_exit(1);
}

static void lift(void)
{
	unsigned long lost = fault_distrusted();

	if (!plan.at)
		return; /* calls are only counted */
	reached += fault_failed();
	must(!lost);
	fault_plan(NULL);
}

/* Turns until it is so; what waits for a fault to go is shown that it went. */
#define turn_or_lift(what)                                  \
	do {                                                \
		double since_ = seconds();                  \
		while (!(what) && seconds() - since_ < 0.3) \
			turn(10);                           \
		if (!(what))                                \
			lift();                             \
		turn_until(what);                           \
	} while (0)

static void try_push(void)
{
	static const unsigned seed[2] = {1, 2};

	for (int tries = 0;; tries++) {
		int r = push_some("a", seed, 2, 2, true, NULL);

		if (r)
			typed("push", &got.why);
		push_end();
		if (!r)
			return;
		turn_until(!service_active(h.service));
		if (tries)
			lift();
		must(tries < 4);
	}
}

static void try_lines(const char *name, unsigned seed)
{
	for (int tries = 0;; tries++) {
		int r = push_lines("a", name, seed, false);

		if (r)
			typed("push of lines", &got.why);
		push_end();
		if (!r)
			return;
		turn_until(!service_active(h.service));
		if (tries)
			lift();
		must(tries < 4);
	}
}

static void try_revert(uint64_t generation)
{
	struct dataset *d = dataset_find(h.service->datasets, "a", &me);

	for (int tries = 0;; tries++) {
		ask(dataset_revert(d, generation, &me, reverted, NULL));
		if (!got.why.code)
			return;
		typed("revert", &got.why);
		turn_until(!service_active(h.service));
		if (tries)
			lift();
		must(tries < 4);
	}
}

static void discarded(void *token, const struct err *why, const struct discarded *d)
{
	answer(why);
}

static void interrupt_push(void)
{
	static const unsigned seed = 3;

	if (push_some("a", &seed, 1, 1, false, NULL))
		typed("interrupted push", &got.why);
	push_end();
	turn_until(!service_active(h.service));
}

/* What an interrupted push left goes. */
static void try_discard(void)
{
	for (int tries = 0;; tries++) {
		ask(dataset_discard(h.service->datasets, "a", &me, false, discarded, NULL));
		must(got.why.code || !dataset_find(h.service->datasets, "a", &me)->pending);
		if (!got.why.code)
			return;
		typed("discard", &got.why);
		turn_until(!service_active(h.service));
		if (tries)
			lift();
		must(tries < 4);
	}
}

static struct job *try_job(void)
{
	for (int tries = 0;; tries++) {
		struct job *job = submit_at(dataset_find(h.service->datasets, "a", &me), 0, VIEW);

		if (!job) {
			typed("submit", &accepted_err);
		} else {
			turn_or_lift(job_state_final(info_of(job).state));
			if (info_of(job).state == JOB_done)
				return job;
			typed("job", info_of(job).err);
		}
		if (tries)
			lift();
		must(tries < 4);
	}
}

static void try_fetch(struct job *job)
{
	static struct reader r; /* outlives it */

	for (int tries = 0;; tries++) {
		r = (struct reader){.output.calls = &reader_calls};
		job_fetch(job, &r.output);
		turn_or_lift(r.ends);
		if (!r.failed) {
			char hex[DIGEST_HEX_SIZE];

			must(!strcmp(digest_hex(r.totals.digest, hex), want));
			must(r.triangles == r.totals.triangles);
			return;
		}
		typed("fetch", &r.why);
		if (tries)
			lift();
		must(tries < 4);
	}
}

static void all_of_it(void)
{
	char digest[DIGEST_HEX_SIZE];
	struct err err = ERR_INIT;
	struct job *job;
	int r;

	for (int tries = 0; (r = service_try_open(SCENE_MEMORY, 2, &err)); tries++) {
		typed("start", &err);
		err = ERR_INIT;
		if (tries)
			lift();
		must(tries < 4);
	}
	try_push();
	interrupt_push();
	try_discard();
	job = try_job();
	snprintf(digest, sizeof digest, "%s", info_of(job).report->digest);
	if (!*want)
		snprintf(want, sizeof want, "%s", digest);
	must(!strcmp(digest, want));
	try_fetch(job);
	try_lines("1.txt", 1);
	try_lines("2.txt", 2);
	try_revert(2);
	job = try_job();
	snprintf(digest, sizeof digest, "%s", info_of(job).report->digest);
	if (!*want_lines)
		snprintf(want_lines, sizeof want_lines, "%s", digest);
	must(!strcmp(digest, want_lines) && strcmp(digest, want));
	turn_until(!service_active(h.service));
}

static void one_point(unsigned long i)
{
	static const unsigned seed[2] = {1, 2};
	unsigned fds = open_files();
	enum push_known_as known[2];
	char digest[DIGEST_HEX_SIZE];

	/* Where removing fails too, for ever, something stays in the store until it is evicted, and a manifest until the next
	 * commit. */
	after_crash = keeps_manifests = plan.for_ever && (plan.kinds & 1u << FAULT_UNLINK);
	new_folder(i);
	fault_log_start(h.folder);
	plan.at = at_of(i);
	fault_plan(&plan);
	all_of_it();
	lift();
	close_service();
	/* As good as new. An interrupted push that could not be ended is pending again. */
	open_service(SCENE_MEMORY, 2);
	try_discard();
	must(!push_some("a", seed, 2, 2, true, known));
	must(known[0] == PUSH_KNOWN && known[1] == PUSH_KNOWN);
	push_end();
	mesh_at("a", 0, digest);
	must(!strcmp(digest, want_lines));
	mesh_at("a", 1, digest);
	must(!strcmp(digest, want));
	/* A new generation, so that what could not be removed is. */
	must(!push_lines("a", "3.txt", 3, false));
	push_end();
	turn_until(!service_active(h.service));
	close_service();
	must(open_files() == fds);
	must(clean());
	drop_folder();
}

static void tell(unsigned long i, int status)
{
	printf("%s, call %lu: status %x\n", plan_text, at_of(i), status);
}

/* How many calls there are when none fails. */
static unsigned long count(void)
{
	unsigned long n;

	new_folder(0);
	plan.at = 0;
	fault_plan(&plan);
	all_of_it();
	close_service();
	n = fault_calls();
	drop_folder();
	return n;
}

static unsigned long points, findings;

static void series(const char *text, unsigned kinds, int error, bool for_ever, bool half)
{
	unsigned long all, n, bad;

	plan = (struct fault_plan){.kinds = kinds, .error = error, .for_ever = for_ever, .half = half};
	plan_text = text;
	all = count();
	first_call = 1 + (unsigned long)setting("ACUT_FAULT_FIRST", 0);
	step = all > 100 ? every : 1;
	n = all / step;
	/* Where no call is counted none fails either. */
	bad = n || first_call > 1 ? each_apart(n, one_point, tell) : 1;
	printf("%-34s %4lu calls, %4lu points, %lu findings\n", text, all, n, bad);
	points += n;
	findings += bad;
}

int main(void)
{
	const unsigned writing =
		1u << FAULT_WRITE | 1u << FAULT_TRUNCATE | 1u << FAULT_OPEN | 1u << FAULT_MKDIR | 1u << FAULT_RENAME;
	double begun = seconds();

	log_init("errors", setting("ACUT_FAULT_LOG", 0) ? LOG_LEVEL_INFO : LOG_LEVEL_ERROR);
	every = (unsigned long)setting("ACUT_FAULT_EVERY", 3);
	fault_io_start();
	scene_begin();
	series("EIO once", FAULT_OURS, EIO, false, false);
	series("EIO for ever", FAULT_OURS, EIO, true, false);
	series("ENOSPC once", writing, ENOSPC, false, true);
	series("ENOSPC for ever", writing, ENOSPC, true, true);
	series("EDQUOT for ever", writing, EDQUOT, true, false);
	series("EROFS for ever", writing, EROFS, true, false);
	series("EMFILE once", 1u << FAULT_OPEN, EMFILE, false, false);
	series("fsync, EIO once", 1u << FAULT_SYNC, EIO, false, false);
	series("catalogue, EIO once", FAULT_SQL, EIO, false, false);
	series("catalogue, EIO for ever", FAULT_SQL, EIO, true, false);
	series("catalogue, ENOSPC for ever", 1u << FAULT_SQL_WRITE, ENOSPC, true, true);
	printf("%lu error points: %lu findings, %.1f s\n", points, findings, seconds() - begun);
	scene_end();
	return findings != 0;
}
