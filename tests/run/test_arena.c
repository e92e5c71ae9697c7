/*
 * Arenas: as many as threads, however many domains; unmapped when others lack memory, and at the end of a run, however it ends.
 * With a reader a few more, likewise. The end of the service asserts that all is returned.
 *
 * Linked with --wrap of what run_domain.c calls in run_arena.c, of run_free, and failing_domain.h.
 */
#include "failing_domain.h"
#include "fixture.h"

#include "job_priv.h"
#include "run_priv.h"

enum { THREADS = 2, POINTS = 400000 };

static struct {
	atomic_uint asked, own, put, bare;
	unsigned made, passed; /* with a reader: domains submitted; those that got the arena of another one */
	unsigned huge, stored; /* those in huge pages; those that wait for the reader in files */
	atomic_bool want;      /* from the first returned arena on, somebody else lacks memory */
	struct sched_task hungry;
	atomic_uint fed, fed_at; /* it has its memory; and how many had been asked for then */
} seen;

uint64_t __real_run_arena_ask(struct run_domain *d, bool own);
bool __real_run_arena_take(struct run_domain *d);
void __real_run_arena_put(struct run_domain *d);

uint64_t __wrap_run_arena_ask(struct run_domain *d, bool own);
bool __wrap_run_arena_take(struct run_domain *d);
void __wrap_run_arena_put(struct run_domain *d);

uint64_t __wrap_run_arena_ask(struct run_domain *d, bool own)
{
	uint64_t bytes = __real_run_arena_ask(d, own);

	seen.asked++;
	seen.own += bytes > 0;
	return bytes;
}

bool __wrap_run_arena_take(struct run_domain *d)
{
	bool is = __real_run_arena_take(d);

	seen.bare += !is;
	return is;
}

static void eat(struct sched_task *t)
{
	seen.fed_at = seen.asked;
	seen.fed++;
}

static void eaten(struct sched_task *t)
{
	if (t->ran)
		sched_give(h.sched, t->name, t->bytes);
}

/* Asks for all that is free, and a little that the run holds. */
static void be_hungry(void)
{
	if (!atomic_exchange(&seen.want, false))
		return;
	seen.hungry = (struct sched_task){.run = eat,
					  .done = eaten,
					  .owner = {.uid = 1001, .flow = UINT64_MAX},
					  .priority = SCHED_FIRST,
					  .name = LEDGER_DOMAIN,
					  .bytes = ledger_available(h.ledger, LEDGER_DOMAIN) + 1};
	sched_submit(h.sched, &seen.hungry);
}

void __wrap_run_arena_put(struct run_domain *d)
{
	seen.put++;
	be_hungry();
	__real_run_arena_put(d);
}

bool __real_run_arena_inherit(struct run_domain *d);
bool __wrap_run_arena_inherit(struct run_domain *d);

bool __wrap_run_arena_inherit(struct run_domain *d)
{
	bool is = __real_run_arena_inherit(d);

	seen.asked++;
	seen.made++;
	seen.passed += is;
	seen.huge += d->huge;
	if (is)
		be_hungry();
	return is;
}

void __real_run_domain_store(struct run_domain *d);
void __wrap_run_domain_store(struct run_domain *d);

void __wrap_run_domain_store(struct run_domain *d)
{
	seen.stored++;
	__real_run_domain_store(d);
}

struct run *__real_run_free(struct run *w);
struct run *__wrap_run_free(struct run *w);

/* No arena is left, however the run ended. */
struct run *__wrap_run_free(struct run *w)
{
	if (w) {
		assert_null(w->arenas.free);
		assert_int_equal(w->arenas.owned, 0);
		assert_int_equal(w->arenas.charged, 0);
	}
	return __real_run_free(w);
}

static int open_seen(void **state)
{
	int r = setup(state);

	memset(&seen, 0, sizeof seen);
	memset(&making, 0, sizeof making);
	run_huge_count = 1 << 15;
	return r;
}

static void go_round(void **state)
{
	struct dataset *d = push("valley", POINTS, 1);
	struct job *job = submit(d, false, "");

	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_done);
	assert_true(seen.asked > 3 * THREADS);
	assert_in_range(seen.own, 1, THREADS);
	assert_int_equal(seen.put, seen.asked);
	assert_int_equal(seen.bare, 0);
	assert_int_equal(ledger_held(h.ledger, LEDGER_DOMAIN), 0);
	dataset_release(d);
}

/* The same survey in a service with an empty store. */
static void given_up(void **state)
{
	char digest[2][DIGEST_HEX_SIZE];

	for (int i = 0; i < 2; i++) {
		struct dataset *d;
		struct job *job;

		if (i) {
			assert_int_equal(teardown(state), 0);
			assert_int_equal(open_seen(state), 0);
		}
		d = push("valley", POINTS, 1);
		seen.want = i == 1;
		job = submit(d, false, "");
		turn_until_final(job);
		assert_int_equal(info_of(job).state, JOB_done);
		assert_int_equal(info_of(job).report->domains_reused, 0);
		snprintf(digest[i], sizeof digest[i], "%s", info_of(job).report->digest);
		dataset_release(d);
	}
	/* Memory was taken away while domains were still to be made, and they took memory of their own again. */
	assert_int_equal(seen.fed, 1);
	assert_true(seen.fed_at < seen.asked);
	assert_true(seen.bare > 0 && seen.own > THREADS);
	assert_string_equal(digest[0], digest[1]);
	assert_int_equal(ledger_held(h.ledger, LEDGER_DOMAIN), 0);
}

static void stopped(void **state)
{
	/* From before the first domain has run. */
	for (unsigned puts = 0; puts < 6; puts++) {
		char name[16];
		struct dataset *d;
		struct job *job;

		snprintf(name, sizeof name, "d%u", puts);
		d = push(name, POINTS, puts);
		memset(&seen, 0, sizeof seen);
		memset(&making, 0, sizeof making);
		job = submit(d, false, "");
		turn_until((seen.asked && seen.put >= puts) || job_state_final(info_of(job).state));
		job_cancel(job);
		turn_until(!service_active(h.service));
		assert_true(puts > 2 || info_of(job).state == JOB_cancelled);
		assert_int_equal(ledger_held(h.ledger, LEDGER_DOMAIN), 0);
		dataset_release(d);
	}
}

/* It holds the arena, its own or a borrowed one. */
static void split_or_failed(void **state)
{
	char whole[DIGEST_HEX_SIZE] = "";
	uint64_t domains = 0;

	for (unsigned at = 0; at < 7; at++)
		for (unsigned fails = 0; fails < 2; fails++) {
			struct dataset *d;
			struct job *job;

			assert_int_equal(teardown(state), 0);
			assert_int_equal(open_seen(state), 0);
			d = push("valley", POINTS / 2, 1);
			atomic_store(fails ? &making.fail_at : &making.split_at, at);
			job = submit(d, false, "");
			turn_until_final(job);
			turn_until(!service_active(h.service));
			assert_int_equal(info_of(job).state, fails && at ? JOB_failed : JOB_done);
			if (!fails && !at) {
				snprintf(whole, sizeof whole, "%s", info_of(job).report->digest);
				domains = info_of(job).report->domains;
			} else if (!fails) {
				assert_string_equal(info_of(job).report->digest, whole);
				assert_int_equal(info_of(job).report->domains, domains + 1);
			}
			assert_int_equal(ledger_held(h.ledger, LEDGER_DOMAIN), 0);
			dataset_release(d);
		}
}

/* With a reader: while nobody else wants memory, few domains map their own. */
static void passed_on(void **state)
{
	static struct reader r; /* static: a failed test ends before the reader */

	for (int want = 0; want < 2; want++) {
		struct dataset *d;
		struct job *job;

		assert_int_equal(teardown(state), 0);
		assert_int_equal(open_seen(state), 0);
		run_huge_count = 0;
		r = (struct reader){.output.calls = &reader_calls};
		d = push("", POINTS, 1);
		seen.want = want;
		job = submit(d, true, VIEW);
		job_fetch(job, &r.output);
		turn_until(r.ends);
		assert_false(r.failed);
		assert_int_equal(r.triangles, r.totals.triangles);
		assert_int_equal(r.totals.triangles, 2 * r.totals.vertices - r.totals.hull - 2);
		assert_true(seen.made > 4 * THREADS);
		if (want) {
			assert_int_equal(seen.fed, 1);
			assert_true(seen.fed_at < seen.asked);
		} else {
			assert_true(seen.made - seen.passed <= THREADS + 4);
		}
		job_leave(job);
		turn_until(!service_active(h.service));
		assert_int_equal(ledger_held(h.ledger, LEDGER_DOMAIN), 0);
		dataset_release(d);
	}
}

/* Of a user who may not have all memory, no arena passes to another domain, and small domains have small pages. */
static void limited(void **state)
{
	static struct reader r;
	struct dataset *d;
	struct job *job;

	(void)state;
	h.service->core->p.limits.user.memory = 90;
	run_huge_count = 0;
	r = (struct reader){.output.calls = &reader_calls};
	d = push("", POINTS, 1);
	job = submit(d, true, VIEW);
	job_fetch(job, &r.output);
	turn_until(r.ends);
	assert_false(r.failed);
	assert_true(seen.made > 4 * THREADS);
	assert_int_equal(seen.passed, 0);
	assert_int_equal(seen.huge, 0);
	job_leave(job);
	turn_until(!service_active(h.service));
	dataset_release(d);
}

/* Of 16 domains the twelfth is being sent, three wait, and with the last one they fill the window. */
enum { SLOW_FROM = 12 };

static void send_some(struct run_output *o)
{
	struct reader *r = (struct reader *)o;

	r->slow = r->blocks == SLOW_FROM;
	r_send(o);
}

/* Results that wait for a slow reader have their arenas, which fill the window. Without what is behind the results there is room
 * for all, so none goes to a file. */
static void waits_in_memory(void **state)
{
	static struct reader r;
	static struct run_output_calls calls_of;
	struct dataset *d;
	struct job *job;
	uint64_t since;

	(void)state;
	run_huge_count = 0;
	calls_of = reader_calls;
	calls_of.send = send_some;
	r = (struct reader){.output.calls = &calls_of};
	d = push("", POINTS / 2, 1);
	job = submit(d, true, VIEW);
	job_fetch(job, &r.output);
	turn_until(r.sending && seen.made == 16);
	since = clock_mono_ns();
	turn_until(clock_since(since) > 3 * RUN_STALL_SECONDS);
	assert_int_equal(seen.made, 16);
	assert_int_equal(seen.stored, 0);
	assert_int_equal(r.spools, 0);
	read_on(&r);
	turn_until(r.ends);
	assert_false(r.failed);
	job_leave(job);
	turn_until(!service_active(h.service));
	dataset_release(d);
}

/* The reader is slow after some blocks, and leaves. */
static void left(void **state)
{
	static struct reader r;

	for (int blocks = 1; blocks < 8; blocks += 3) {
		struct dataset *d;
		struct job *job;

		assert_int_equal(teardown(state), 0);
		assert_int_equal(open_seen(state), 0);
		run_huge_count = 0;
		r = (struct reader){.output.calls = &reader_calls};
		d = push("", POINTS / 2, 1);
		job = submit(d, true, VIEW);
		job_fetch(job, &r.output);
		turn_until(r.blocks >= blocks || r.ends);
		job_cancel(job);
		turn_until(r.ends);
		job_leave(job);
		turn_until(!service_active(h.service));
		assert_int_equal(ledger_held(h.ledger, LEDGER_DOMAIN), 0);
		dataset_release(d);
	}
}

#define TEST(f) cmocka_unit_test_setup_teardown(f, open_seen, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {TEST(go_round),  TEST(given_up), TEST(stopped), TEST(split_or_failed),
					   TEST(passed_on), TEST(left),     TEST(limited), TEST(waits_in_memory)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
