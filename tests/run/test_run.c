/*
 * A run of which only sums are needed: several workers search the store for its leaves, and the last leaves are made by size. The
 * result is that of any other run.
 *
 * Linked with --wrap of run_domain_start, pipe_refine_step, pipe_plan_probe and pipe_store, and failing_domain.h.
 */
#include "failing_domain.h"
#include "fixture.h"

#include "job_priv.h"
#include "run_priv.h"
#include "repeat.h"

enum { THREADS = 2, POINTS = 1000000, MORE = 20000 };

/* ---- what is observed and changed ---- */

static struct {
	/* On the loop: */
	unsigned begun, last,
		turned; /* domains; those among the last ones; of these, those that were not the first of the remaining ones */
	unsigned again; /* started again */
	bool light, first_last; /* by the plan its first leaf is the smallest; it was started last */
	atomic_bool full;       /* nothing can be stored */
	/* On workers that search: */
	pthread_mutex_t lock;
	pthread_cond_t came;
	const void *memory[THREADS]; /* of each member */
	unsigned members, looks;
	bool together; /* no search begins before two members have come */
	bool closed;   /* no search begins at all */
	int fails;     /* the error of the third search; 0: none */
} seen = {.lock = PTHREAD_MUTEX_INITIALIZER, .came = PTHREAD_COND_INITIALIZER};

struct run_domain *__real_run_domain_start(struct run *w, size_t index, enum sched_priority priority);
struct run_domain *__wrap_run_domain_start(struct run *w, size_t index, enum sched_priority priority);

static bool in_list(const struct run *w, size_t index)
{
	const struct run_domain *d;

	for (d = w->domains; d && d->index != index; d = d->next)
		;
	return d;
}

struct run_domain *__wrap_run_domain_start(struct run *w, size_t index, enum sched_priority priority)
{
	const struct cut_leaf *leaf = w->plan.leaf;
	size_t left = 0, first = SIZE_MAX;
	uint64_t most = 0;
	bool changed = false;

	/* A domain that was finished and released for others comes back from the store. */
	seen.again += index < w->next_start;
	if (index < w->next_start)
		return __real_run_domain_start(w, index, priority);
	for (size_t i = w->next_start; i < w->plan.n; i++) {
		if (leaf[i].there || in_list(w, i))
			continue;
		first = left++ ? first : i;
		most = leaf[i].count > most ? leaf[i].count : most;
		changed |= leaf[i].changed;
	}
	seen.begun++;
	seen.first_last = !index && left == 1;
	if (left <= 8 * w->budget.threads && left + w->ndomains <= run_domains_most) {
		seen.last++;
		seen.turned += index != first;
		assert_true(leaf[index].changed == changed);
		assert_true(changed || leaf[index].count == most);
	} else {
		assert_int_equal(index, first);
	}
	return __real_run_domain_start(w, index, priority);
}

int __real_pipe_plan_probe(const struct grid *grid, const struct view *v, const struct pipe_budget *budget, void *memory,
			   const atomic_bool *cancel, struct cut_plan *plan, struct err *err);
int __wrap_pipe_plan_probe(const struct grid *grid, const struct view *v, const struct pipe_budget *budget, void *memory,
			   const atomic_bool *cancel, struct cut_plan *plan, struct err *err);

int __real_pipe_store(int storefd, const struct pipe_key *key, const struct cut_region *region, const struct mesh_domain *domain,
		      const void *memory, struct pipe_stored *ret, struct pipe_summary *summary, struct err *err);
int __wrap_pipe_store(int storefd, const struct pipe_key *key, const struct cut_region *region, const struct mesh_domain *domain,
		      const void *memory, struct pipe_stored *ret, struct pipe_summary *summary, struct err *err);

int __wrap_pipe_store(int storefd, const struct pipe_key *key, const struct cut_region *region, const struct mesh_domain *domain,
		      const void *memory, struct pipe_stored *ret, struct pipe_summary *summary, struct err *err)
{
	return seen.full ? err_set(err, ERR_IO, "the test's disk is gone") :
			   __real_pipe_store(storefd, key, region, domain, memory, ret, summary, err);
}

/* The search has ended. */
int __wrap_pipe_plan_probe(const struct grid *grid, const struct view *v, const struct pipe_budget *budget, void *memory,
			   const atomic_bool *cancel, struct cut_plan *plan, struct err *err)
{
	int r = __real_pipe_plan_probe(grid, v, budget, memory, cancel, plan, err);

	for (size_t i = 0; !r && seen.light && i < plan->n; i++)
		plan->leaf[i].count = i ? plan->leaf[i].count + 1 : 0;
	return r;
}

int __real_pipe_refine_step(struct pipe_refine *f, const struct pipe_reuse_params *p, struct err *err);
int __wrap_pipe_refine_step(struct pipe_refine *f, const struct pipe_reuse_params *p, struct err *err);

static bool known(const void *memory)
{
	for (unsigned i = 0; i < seen.members; i++)
		if (seen.memory[i] == memory)
			return true;
	return false;
}

int __wrap_pipe_refine_step(struct pipe_refine *f, const struct pipe_reuse_params *p, struct err *err)
{
	int fails;

	pthread_mutex_lock(&seen.lock);
	if (seen.members < THREADS && !known(p->memory)) {
		seen.memory[seen.members++] = p->memory;
		pthread_cond_broadcast(&seen.came);
	}
	while (seen.closed || (seen.together && seen.members < THREADS))
		pthread_cond_wait(&seen.came, &seen.lock);
	fails = ++seen.looks == 3 ? seen.fails : 0;
	pthread_mutex_unlock(&seen.lock);
	return fails ? err_set(err, (enum err_code) - fails, "the test's disk is gone") : __real_pipe_refine_step(f, p, err);
}

static void look_anew(bool together, bool closed, int fails)
{
	pthread_mutex_lock(&seen.lock);
	seen.members = seen.looks = 0;
	seen.together = together;
	seen.closed = closed;
	seen.fails = fails;
	pthread_cond_broadcast(&seen.came);
	pthread_mutex_unlock(&seen.lock);
	seen.begun = seen.last = seen.turned = seen.again = 0;
	making.made = making.split_at = 0;
	seen.light = seen.first_last = false;
}

static unsigned lookers(void)
{
	unsigned n;

	pthread_mutex_lock(&seen.lock);
	n = seen.members;
	pthread_mutex_unlock(&seen.lock);
	return n;
}

/* ---- a survey, and a small change in one corner ---- */

static int corner_file(unsigned seed)
{
	int fd = memfd_create("more.xyz", MFD_CLOEXEC);
	FILE *f = fdopen(dup(fd), "w");
	uint64_t v = seed * UINT64_C(0x9e3779b97f4a7c15) + 1;

	for (unsigned i = 0; i < MORE; i++) {
		v = v * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
		fprintf(f, "%u.%02u %u.%02u %u.00\n", (unsigned)(v >> 33) % 20000, i % 100, (unsigned)(v >> 20) % 20000, i % 97,
			i % 500);
	}
	fclose(f);
	return fd;
}

static struct job_info mesh(struct dataset *d)
{
	struct job *job = submit(d, false, "");

	turn_until_final(job);
	turn_until(!service_active(h.service));
	assert_int_equal(info_of(job).state, JOB_done);
	assert_int_equal(ledger_held(h.ledger, LEDGER_DOMAIN), 0);
	return info_of(job);
}

static void last_by_size(void **state)
{
	struct dataset *d = push("valley", POINTS, 1);

	look_anew(false, false, 0);
	mesh(d);
	assert_true(seen.begun > 8 * THREADS);
	assert_int_equal(seen.last, 8 * THREADS);
	assert_true(seen.turned);
	dataset_release(d);
}

/* Returns the number of its domains. */
static uint64_t mesh_crowded(void **state, unsigned most, unsigned split_at, char digest[DIGEST_HEX_SIZE])
{
	struct job_info info;
	struct dataset *d;

	assert_int_equal(teardown(state), 0);
	assert_int_equal(setup(state), 0);
	d = push("valley", POINTS / 6, 3);
	look_anew(false, false, 0);
	making.split_at = split_at;
	seen.light = true;
	run_domains_most = most;
	info = mesh(d);
	run_domains_most = 64;
	assert_int_equal(seen.again, 0);
	snprintf(digest, DIGEST_HEX_SIZE, "%s", info.report->digest);
	dataset_release(d);
	return info.report->domains;
}

/* As many domains as the window holds wait for one that is the smallest, is made last and counted first; and one has to be
 * split. */
static void crowded(void **state)
{
	char whole[DIGEST_HEX_SIZE], digest[DIGEST_HEX_SIZE];
	uint64_t domains;
	unsigned all;

	domains = mesh_crowded(state, 64, 0, whole);
	all = seen.begun;
	assert_true(all > THREADS + 4 && all <= 8 * THREADS && seen.first_last);
	for (unsigned most = all - 1; most <= all + 1; most++)
		for (unsigned at = 1; at <= all; at += at == 2 && all > 9 ? all - 8 : repeat_step(3)) {
			assert_int_equal(mesh_crowded(state, most, at, digest), domains + 1);
			assert_string_equal(digest, whole);
		}
}

/* Two runs lack memory and cannot store what they made: a finished domain without memory is not released for the other. */
static void side_by_side(void **state)
{
	uint64_t domains = 0;
	struct dataset *d[2];
	struct job *job[2];

	close_service();
	open_service(UINT64_C(24) << 20, 4);
	for (unsigned i = 0; i < 2; i++)
		d[i] = push(i ? "ridge" : "valley", POINTS, 1 + i);
	look_anew(false, false, 0);
	seen.full = true;
	for (unsigned i = 0; i < 2; i++)
		job[i] = submit(d[i], false, "");
	for (unsigned i = 0; i < 2; i++)
		turn_until_final(job[i]);
	seen.full = false;
	turn_until(!service_active(h.service));
	for (unsigned i = 0; i < 2; i++) {
		assert_int_equal(info_of(job[i]).state, JOB_done);
		assert_int_equal(info_of(job[i]).report->domains_reused, 0);
		domains += info_of(job[i]).report->domains;
		dataset_release(d[i]);
	}
	assert_true(domains > 4 * 8);
	assert_int_equal(making.made, domains);
}

/* Each in a generation of its own with something to make; in the end the result is the same as without a store. */
static void together(void **state)
{
	static const int fails[] = {0, -ERR_IO, -ERR_BUSY};
	enum { TIMES = sizeof fails / sizeof *fails };
	char digest[DIGEST_HEX_SIZE], name[16];
	struct job_info info;
	struct dataset *d = push("valley", POINTS, 1);
	struct job *job;

	look_anew(false, false, 0);
	mesh(d);
	for (unsigned i = 0; i < TIMES; i++) {
		snprintf(name, sizeof name, "more%u", i);
		dataset_release(d);
		d = push_file_as("valley", name, corner_file(i));
		look_anew(true, false, fails[i]);
		/* It waits for the memory of another plan. */
		assert_true(ledger_take(h.ledger, LEDGER_PLAN, 4096));
		info = mesh(d);
		ledger_give(h.ledger, LEDGER_PLAN, 4096);
		assert_int_equal(lookers(), THREADS);
		assert_true(seen.looks >= 3 && seen.begun && (fails[i] || seen.begun < 48));
		assert_true(info.report->domains_reused > info.report->domains / 2);
		snprintf(digest, sizeof digest, "%s", info.report->digest);
	}
	/* Stopped during the search, and then finished as if nothing had happened. */
	dataset_release(d);
	d = push_file_as("valley", "stopped", corner_file(TIMES));
	look_anew(false, true, 0);
	job = submit(d, false, "");
	turn_until(lookers() == THREADS || job_state_final(info_of(job).state));
	job_cancel(job);
	turn(10);
	look_anew(false, false, 0);
	turn_until(!service_active(h.service));
	assert_int_equal(info_of(job).state, JOB_cancelled);
	assert_int_equal(seen.begun, 0);
	assert_int_equal(ledger_held(h.ledger, LEDGER_DOMAIN), 0);
	assert_int_equal(ledger_held(h.ledger, LEDGER_PLAN), 0);
	snprintf(digest, sizeof digest, "%s", mesh(d).report->digest);
	dataset_release(d);

	assert_int_equal(teardown(state), 0);
	assert_int_equal(setup(state), 0);
	dataset_release(push("valley", POINTS, 1));
	for (unsigned i = 0; i < TIMES; i++) {
		snprintf(name, sizeof name, "more%u", i);
		dataset_release(push_file_as("valley", name, corner_file(i)));
	}
	d = push_file_as("valley", "stopped", corner_file(TIMES));
	info = mesh(d);
	assert_int_equal(info.report->domains_reused, 0);
	assert_string_equal(info.report->digest, digest);
	dataset_release(d);
}

/* A domain that takes long is told that its job was cancelled. */
static void cancelled(void **state)
{
	struct dataset *d = push("valley", POINTS, 1);
	struct job *job;

	(void)state;
	making.endless_at = making.made + 2;
	job = submit(d, false, "");
	turn_until(making.in_endless);
	assert_false(making.cancelled);
	job_cancel(job);
	turn_until(!service_active(h.service));
	assert_true(making.cancelled);
	assert_int_equal(info_of(job).state, JOB_cancelled);
	making.endless_at = 0;
	dataset_release(d);
}

#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {TEST(last_by_size), TEST(crowded), TEST(side_by_side), TEST(together),
					   TEST(cancelled)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
