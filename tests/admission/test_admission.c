/*
 * The order of admission: users, priorities, large and small jobs side by side, and short memory. The tests count jobs, and tasks
 * that a gate lets through one by one, never time.
 */
#include "gate.h"
#include "dataset_priv.h"

#include "admission_priv.h"
#include "job_priv.h"
#include "run_priv.h"

enum { HUNDRED = 100 };

static struct job *submit_as(uint32_t uid, struct dataset *d, const char *view, const char *priority)
{
	struct job_params p = {.dataset = d, .view = view, .fresh = true, .priority = priority, .peer = rights_of_user(uid, 1)};
	int before = accepts;

	job_submit(h.service->jobs, &p, accepted, NULL);
	turn_until(accepts > before);
	return accepted_job;
}

static void collect(void *token, const struct err *why, struct job *job)
{
	assert_null(why);
	*(struct job **)token = job;
}

/* All at once, each with a view of its own, so that none finds its domains in the store. */
static void submit_many(uint32_t uid, struct dataset *d, struct job **jobs, unsigned n, const char *priority)
{
	for (unsigned i = 0; i < n; i++) {
		char view[64];
		struct job_params p = {.dataset = d, .view = view, .priority = priority, .peer = rights_of_user(uid, 1)};

		snprintf(view, sizeof view, "view 1 zmin=%u", 1 + i);
		jobs[i] = NULL;
		job_submit(h.service->jobs, &p, collect, &jobs[i]);
	}
	for (unsigned i = 0; i < n; i++)
		turn_until(jobs[i]);
}

/* A job of one step, as `acutctl mesh` has: it is there at once, without a row. */
static struct job *one_step(uint32_t uid, struct dataset *d, const char *priority, struct reader *r)
{
	struct job_params p = {
		.dataset = d, .view = "view 1 zmin=777", .bound = true, .priority = priority, .peer = rights_of_user(uid, 1)};
	struct job *job = NULL;

	*r = (struct reader){.output.calls = &reader_calls};
	job_submit(h.service->jobs, &p, collect, &job);
	assert_non_null(job);
	job_fetch(job, &r->output);
	return job;
}

/*
 * Until it is over. It waits for the tasks that run already when it comes, which is one domain's time (behind the gate
 * none does), and then goes before all but one of others; so does each of its tasks, which follow one another.
 */
static void step_beside(struct job *job)
{
	unsigned since = gate.noted, before = 0, own, others;
	uint64_t flow = 0;

	while (!job_state_final(info_of(job).state)) {
		step();
		flow = job->run ? job->run->owner.flow : flow;
	}
	assert_int_equal(info_of(job).state, JOB_done);
	own = steps_of(flow, since);
	/* Tasks of no flow are the service's own: it looks at the disk every few seconds, whoever waits. */
	others = gate.noted - since - own - steps_of(0, since);
	assert_in_range(own, 1, 8);
	for (unsigned i = since; gate.flow[i] != flow; i++)
		before += gate.flow[i] != 0;
	if (before > 1 || others > own + 1)
		fail_msg("%u tasks of others began before its first, %u beside its %u", before, others, own);
}

static unsigned count_over(struct job **jobs, unsigned n)
{
	unsigned over = 0;

	for (unsigned i = 0; i < n; i++)
		over += job_state_final(info_of(jobs[i]).state);
	return over;
}

/* Of many finished jobs the oldest are packed, so a finished one is searched for again (job_find). */
static struct job_info info_of_number(uint64_t id, uint32_t uid)
{
	struct job *job = job_find(h.service->jobs, id, &(struct peer){.uid = uid});

	assert_non_null(job);
	return info_of(job);
}

static void all_done(struct job **jobs, unsigned n)
{
	struct {
		uint64_t id;
		uint32_t uid;
	} job[HUNDRED];

	assert_true(n <= HUNDRED);
	for (unsigned i = 0; i < n; i++) {
		job[i].id = info_of(jobs[i]).id;
		job[i].uid = jobs[i]->peer.uid;
	}
	for (unsigned i = 0; i < n; i++) {
		turn_until(job_state_final(info_of_number(job[i].id, job[i].uid).state));
		assert_int_equal(info_of_number(job[i].id, job[i].uid).state, JOB_done);
	}
}

/* ---- users ---- */

/* One user's hundred jobs, then one of another: it is done before more than a few of them are. */
static void hundred_against_one(void **state)
{
	struct dataset *d = push("shared", 20000, 1);
	struct job *hundred[HUNDRED], *one;
	static struct reader r; /* outlives a failed test */
	unsigned over;

	gate_close();
	submit_many(1000, d, hundred, HUNDRED, NULL);
	step_until(count_over(hundred, HUNDRED) >= 3);
	one = one_step(1001, d, NULL, &r);
	over = count_over(hundred, HUNDRED);
	assert_true(over < HUNDRED / 4);
	step_beside(one);
	over = count_over(hundred, HUNDRED) - over;
	if (over > 2)
		fail_msg("%u of the hundred came before the one", over);
	job_leave(one);
	gate_open();
	all_done(hundred, HUNDRED);
	dataset_release(d);
}

/* A job of another user, and one of the same, end while the huge one before them is at a fraction. */
static void small_behind_huge(void **state)
{
	struct dataset *huge = push("huge", 900000, 2), *small = push("small", 1000, 3);
	struct job *job, *other;
	static struct reader r; /* outlives a failed test */

	gate_close();
	job = submit_as(1000, huge, "", NULL);
	step_until(info_of(job).domains_done > 0);
	for (uint32_t uid = 1000; uid < 1002; uid++) {
		other = one_step(uid, small, NULL, &r);
		step_beside(other);
		job_leave(other);
	}
	assert_true(info_of(job).domains_total >= 32);
	assert_true(info_of(job).domains_done * 4 < info_of(job).domains_total * 3);
	gate_open();
	all_done(&job, 1);
	dataset_release(huge);
	dataset_release(small);
}

/* A run that gives way begins again, ends with the same mesh, and never seems to go back. */
static void gives_way(void **state)
{
	struct dataset *d = push("valley", 300000, 4);
	struct job *first = submit_as(1000, d, "", NULL), *job;
	uint64_t points = 0;
	unsigned ways = 0;

	all_done(&first, 1);
	gate_close();
	/* Nothing of it in the store. */
	job = submit_as(1000, d, "view 1 zmin=1", NULL);
	while (!job_state_final(info_of(job).state)) {
		struct job_info info;

		step();
		info = info_of(job);
		if (info.state == JOB_meshing && info.domains_done >= 2 + 2 * ways && ways < 3 && run_can_yield(job->run)) {
			run_yield(job->run);
			ways++;
		}
		info = info_of(job);
		assert_true(info.points_done >= points);
		assert_true(job_state_final(info.state) || !info.points_done || info.points_done <= info.points_total ||
			    !info.points_total);
		points = info.points_done;
	}
	assert_int_equal(ways, 3);
	gate_open();
	assert_int_equal(info_of(job).state, JOB_done);
	assert_int_equal(info_of(job).report->points, 300000);
	first = submit_as(1000, d, "view 1 zmin=1", NULL);
	all_done(&first, 1);
	assert_string_equal(info_of(first).report->digest, info_of(job).report->digest);
	dataset_release(d);
}

/* Where a user has the places, and another has none: one is given back. */
static void way_is_made(void **state)
{
	struct dataset *d = push("valley", 600000, 5), *small = push("small", 1000, 6);
	static struct reader r; /* outlives a failed test */
	struct job *jobs[4];
	unsigned without = 0;

	gate_close();
	jobs[0] = submit_as(1000, d, "", NULL);
	jobs[1] = submit_as(1000, d, "view 1 zmin=1", NULL);
	step_until(info_of(jobs[0]).state == JOB_meshing && info_of(jobs[1]).state == JOB_meshing);
	/* As if the memory carried these two and no more. */
	h.service->admission->runs_max = 1;
	jobs[3] = submit_as(1000, small, "", NULL);
	jobs[2] = one_step(1001, small, NULL, &r);
	/* A user without a running job is next, although the other came first. */
	assert_int_equal(info_of(jobs[2]).position, 1);
	assert_int_equal(info_of(jobs[3]).position, 2);
	step_until(job_state_final(info_of(jobs[2]).state));
	assert_int_equal(info_of(jobs[2]).state, JOB_done);
	/* One of the two has none now, and waits for it. */
	for (int i = 0; i < 2; i++)
		without += jobs[i]->run && !jobs[i]->run->has_slot && jobs[i]->slot.requested;
	assert_int_equal(without, 1);
	h.service->admission->runs_max = 4;
	gate_open();
	all_done(jobs, 4);
	job_leave(jobs[2]);
	dataset_release(d);
	dataset_release(small);
}

/* ---- priorities ---- */

static void priorities(void **state)
{
	struct dataset *d = push("shared", 20000, 7);
	struct job *low[20], *normal, *high;
	static struct reader r[2]; /* outlive a failed test */
	unsigned before;
	uint64_t id;

	assert_null(submit_as(1000, d, "", "urgent"));
	assert_int_equal(accepted_err.code, ERR_USAGE);
	/* As of nice: anybody may go behind others, not before them. */
	if (geteuid() != 1000) {
		assert_null(submit_as(1000, d, "", "high"));
		assert_int_equal(accepted_err.code, ERR_PERM);
	}
	gate_close();
	submit_many(1000, d, low, 20, "low");
	normal = one_step(1000, d, NULL, &r[0]);
	high = one_step(geteuid(), d, "high", &r[1]);
	before = count_over(low, 20);
	assert_int_equal(info_of(high).priority, JOB_PRIORITY_HIGH);
	step_until(job_state_final(info_of(normal).state) && job_state_final(info_of(high).state));
	/* The jobs that had begun, and one start in sixteen. */
	assert_true(count_over(low, 20) - before <= 2);
	gate_open();
	job_leave(normal);
	job_leave(high);
	/* The row keeps it. */
	id = info_of(low[19]).id;
	dataset_release(d);
	close_service();
	open_service(UINT64_C(32) << 20, 2);
	low[19] = job_find(h.service->jobs, id, &(struct peer){.uid = 1000});
	assert_non_null(low[19]);
	assert_int_equal(info_of(low[19]).priority, JOB_PRIORITY_LOW);
	turn_until_final(low[19]);
	assert_int_equal(info_of(low[19]).state, JOB_done);
}

/* Waiting jobs report what they wait for, and their position. */
static void says_why(void **state)
{
	struct dataset *huge = push("huge", 20000, 8);
	struct job *jobs[6];
	unsigned waits = 0;

	gate_close();
	for (int i = 0; i < 6; i++)
		jobs[i] = submit_as(1000, huge, i % 2 ? "view 1 zmin=1" : "", NULL);
	turn_out();
	for (unsigned i = 0; i < 6; i++) {
		struct job_info info = info_of(jobs[i]);

		if (info.state != JOB_queued)
			continue;
		waits++;
		assert_int_equal(info.position, waits);
		assert_non_null(strstr(info.waiting, "its turn"));
	}
	assert_true(waits >= 3);
	for (unsigned i = 0; i < 6; i++)
		job_cancel(jobs[i]);
	turn_until(count_over(jobs, 6) == 6);
	gate_open();
	assert_int_equal(info_of(jobs[5]).position, 0);
	assert_string_equal(info_of(jobs[5]).waiting, "");
	dataset_release(huge);
}

/* ---- memory ---- */

/* What can never fit is refused with the number that does. */
static void never_and_the_number(void **state)
{
	const uint64_t bytes = UINT64_C(100) << 20;
	struct err err = ERR_INIT;
	unsigned long long mega = 0;
	const char *number;

	assert_int_equal(admission_check_size(h.service->admission, bytes, "a test", &err), -ERR_LIMIT);
	number = strstr(err.hint, "memory=");
	assert_non_null(number);
	assert_int_equal(sscanf(number, "memory=%lluM", &mega), 1);
	assert_in_range(mega, 101, 160);
	/* It may be a little more than what would just do, never less. */
	for (int i = 0; i < 2; i++) {
		close_service();
		open_service((i ? mega : mega - mega / 16) << 20, 2);
		assert_int_equal(admission_check_size(h.service->admission, bytes, "a test", &err), i ? 0 : -ERR_LIMIT);
	}
}

static int planned_n, inspected_n;

static void plan_told(void *token, const struct err *why, const struct job_plan *plan)
{
	planned_n++;
	assert_null(why);
	assert_true(plan->points > 0);
}

static void inspect_told(void *token, const struct err *why, const struct inspect_result *result)
{
	inspected_n++;
	assert_null(why);
}

/* Twenty jobs of all kinds, plans, inspections, streams and a push at once, of three users, with the least memory. */
static void all_kinds_in_little(void **state)
{
	static const char *const view[] = {"", "view 1 zmin=2", "view 1 every=3", "view 1 duplicates=highest",
					   "view 1 crop=box:0,0,9000000,9000000"};
	static struct reader r[4]; /* outlive a failed test */
	struct dataset *d[2], *late;
	struct job *jobs[20];

	close_service();
	/* As acutd has it: who asks is heard, whatever domains hold. */
	service_aside = 384 << 10;
	open_service(UINT64_C(24) << 20, 2);
	service_aside = 0;
	planned_n = inspected_n = 0;
	d[0] = push("large", 120000, 9);
	d[1] = push("small", 5000, 10);
	for (unsigned i = 0; i < 20; i++) {
		struct peer peer = {.uid = 1000 + i % 3, .pid = 1};

		jobs[i] = submit_as(peer.uid, d[i % 4 == 3], view[i % 5], i % 7 ? NULL : "low");
		if (i % 5 == 0) {
			job_plan(h.service->jobs, d[0], 0, view[i % 4], &peer, plan_told, NULL);
			inspect_file(h.service->core, &(struct inspect_input){text_file(2000, i), "a.xyz", "", "", false}, &peer,
				     inspect_told, NULL);
			r[i / 5] = (struct reader){.output.calls = &reader_calls, .slow = i == 0};
			job_fetch(jobs[i], &r[i / 5].output);
		}
	}
	late = push("late", 20000, 11);
	all_done(jobs, 20);
	turn_until(planned_n == 4 && inspected_n == 4 && r[1].ends && r[2].ends && r[3].ends);
	for (int i = 1; i < 4; i++)
		assert_false(r[i].failed);
	run_output_close(&r[0].output, r_freed);
	turn_until(!service_active(h.service));
	assert_int_equal(ledger_held(h.ledger, LEDGER_DOMAIN), 0);
	assert_int_equal(ledger_held(h.ledger, LEDGER_EMITTER), 0);
	dataset_release(late);
	dataset_release(d[0]);
	dataset_release(d[1]);
}

/* A stream whose client leaves while it seeks a place gets none. */
static void leaves_before_its_place(void **state)
{
	struct dataset *d = push("valley", 20000, 13);
	struct job *job = submit_as(1000, d, "", NULL);
	static struct reader r; /* outlives a failed test */

	turn_until_final(job);
	r = (struct reader){.output.calls = &reader_calls};
	job_fetch(job, &r.output);
	run_output_close(&r.output, r_freed);
	assert_true(r.freed);
	/* Another request, before the round of the loop ends. */
	slots_grant(h.service->admission);
	turn_until(!service_active(h.service));
	assert_int_equal(r.heads + r.ends, 0);
	dataset_release(d);
}

/* As if domains held all that there is, and all that comes free, but what a push is itself. */
static void take_all(uint64_t *held)
{
	uint64_t room = ledger_available(h.ledger, LEDGER_INPUT), least = *held ? 0 : PUSH_BYTES + PENDING_BYTES;

	if (room > least && ledger_take(h.ledger, LEDGER_INPUT, room - least))
		*held += room - least;
}

/* Until no worker has anything to do, nor will have: whatever comes free from then on is given by the test. */
static void turn_quiet(void)
{
	uint64_t begun_at = clock_mono_ns();

	for (int still = 0; still < 20;) {
		turn(5);
		still = sched_busy(h.sched) || catalogue_busy(h.catalogue) ? 0 : still + 1;
		if (clock_since(begun_at) > 100)
			fail_msg("the workers never rest");
	}
}

/* One more push, with all memory taken: true if it is not answered. */
static bool waits(const struct push_params *p, uint64_t *held)
{
	memset(&got, 0, sizeof got);
	take_all(held);
	push_begin(h.service->pushes, p, NULL);
	for (int i = 0; i < 20; i++) {
		take_all(held);
		turn(5);
	}
	if (!got.answers)
		return true;
	if (got.why.code)
		fail_msg("the push did not wait: %s; %u runs, %u KiB free", got.why.message,
			 admission_tally(h.service->admission, 0).runs,
			 (unsigned)(ledger_available(h.ledger, LEDGER_INPUT) >> 10));
	push_leave(got.push);
	sched_give(h.sched, LEDGER_INPUT, *held);
	*held = 0;
	return false;
}

/* A push for which there is no memory now, not even to read the manifest or to keep it in mind, waits for jobs. */
static void push_waits(void **state)
{
	struct push_params p = {.dataset = "valley", .peer = me, .calls = &calls};
	static struct reader r; /* outlives a failed test */
	struct dataset *d;
	struct job *job;

	r = (struct reader){.output.calls = &reader_calls, .slow = true};
	close_service();
	open_service(UINT64_C(24) << 20, 2);
	d = push("valley", 600000, 12);
	/* Its reader keeps it at work, however fast the machine is. */
	job = submit(d, true, VIEW);
	job_fetch(job, &r.output);
	turn_until(r.sending);
	turn_quiet();
	/* The first leaves while it waits. */
	for (int leaves = 1; leaves >= 0; leaves--) {
		uint64_t held = 0;

		assert_int_equal(info_of(job).state, JOB_meshing);
		/* What the job gives back between two looks may go to the push: then it did not lack memory, and the next one
		 * may. */
		for (int tries = 0; !waits(&p, &held); tries++) {
			assert_true(tries < 20);
			turn_until(!pushes_open(h.service->pushes));
		}
		if (leaves)
			push_leave(h.service->pushes->first);
		else
			sched_give(h.sched, LEDGER_INPUT, held);
		turn_until(got.answers);
		assert_true(leaves ? got.why.code != 0 : got.why.code == 0);
		if (leaves)
			sched_give(h.sched, LEDGER_INPUT, held);
	}
	push_leave(got.push);
	read_on(&r);
	all_done(&job, 1);
	turn_until(!service_active(h.service));
	assert_int_equal(ledger_held(h.ledger, LEDGER_FILES), 0);
	assert_int_equal(ledger_held(h.ledger, LEDGER_MANIFEST), 0);
	dataset_release(d);
}

/* A plan that has no room beside those of others waits for them; alone, it is refused. */
static void plan_waits(void **state)
{
	const uint64_t most = 64 << 10;
	struct dataset *d = push("valley", 20000, 13);
	struct job *job;

	assert_true(ledger_reserve(h.ledger, LEDGER_PLAN, 0, most));
	assert_true(ledger_take(h.ledger, LEDGER_PLAN, most));
	job = submit_as(1001, d, "", NULL);
	for (int i = 0; i < 40; i++) {
		turn(5);
		assert_false(job_state_final(info_of(job).state));
	}
	sched_give(h.sched, LEDGER_PLAN, most);
	all_done(&job, 1);
	dataset_release(d);
}

static void plan_never(void **state)
{
	struct dataset *d = push("valley", 20000, 14);
	struct job *job;

	assert_true(ledger_reserve(h.ledger, LEDGER_PLAN, 0, 64));
	job = submit_as(1001, d, "", NULL);
	turn_until_final(job);
	assert_int_equal(info_of(job).state, JOB_failed);
	assert_int_equal(info_of(job).err->code, ERR_LIMIT);
	dataset_release(d);
}

int main(void)
{
#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, gate_teardown)
	const struct CMUnitTest tests[] = {
		TEST(hundred_against_one),  TEST(small_behind_huge),   TEST(gives_way),
		TEST(way_is_made),          TEST(priorities),          TEST(says_why),
		TEST(never_and_the_number), TEST(all_kinds_in_little), TEST(push_waits),
		TEST(plan_waits),           TEST(plan_never),          TEST(leaves_before_its_place),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
