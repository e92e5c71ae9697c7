/*
 * How the memory is divided. slot.c decides which run gets the next slot; sched_queue.c decides which task gets the next worker
 * and the next free bytes.
 *
 * Shares of `memory`: the fixed part (service_bytes) is kept for small things, whatever else is held. Each run with a slot has a
 * share for its table of unfinished vertices and its index pages. Stages take up to half. Domains take what is left.
 *
 * Claim: the first task in the queue can always run at some time. Memory is held in two ways.
 * - For long: the fixed part, the shares of runs with slots, the stages of pushes. Nobody waits for these while holding other
 *   memory. A run gets its slot, with its whole share, at once, and releases it before it waits for more than its plan can have
 *   (run_requeue). A push that waits for a stage, or for memory for more names, holds only the names of its files; if only such
 *   pushes are left, the youngest is refused (push_must_refuse).
 * - For a while: what a task takes when it starts (a domain, a plan, a selection, buffers to read a file). It ends without asking
 *   for more. What it leaves in memory, a finished domain, goes to the store when others lack memory, by tasks that need no
 *   memory and so never wait behind one that does. A plan is made by two tasks, of which the second needs no memory.
 *
 * Let F be the memory that is not held for long. F is always at least what the largest single task of any run with a slot takes:
 * a slot is granted only if F stays that large (check_fit), a stage leaves twice that (admission_stage_available), and a plan's
 * domains take at most half of F when it is made. The first task in the queue that lacks memory has a claim on all that comes
 * free. So it fits when the tasks before it have ended. Tasks that belong to no run (inspection, a file larger than expected) are
 * refused if they could exceed F (admission_check_size). Helpers that read parts of a file take only idle memory, and never have
 * a claim.
 */
#include <stdlib.h>

#include "admission_priv.h"
#include "clock.h"
#include "pipe.h"

#define STARVED_SECONDS 0.3

static uint64_t clamp(uint64_t v, uint64_t low, uint64_t high)
{
	return v < low ? low : v > high ? high : v;
}

static uint64_t emitter_share(uint64_t total)
{
	return clamp(total / 64, 384 << 10, 32 << 20);
}

static uint64_t index_share(uint64_t total)
{
	return clamp(total / 64, 256 << 10, 32 << 20);
}

/* What domains and stages cannot have: stacks, the catalogue, messages, streams, and what grows with jobs and sources.
 * admission_staged_bytes includes what pushes keep of their files. */
static uint64_t service_bytes(const struct admission *a)
{
	const unsigned names = 1u << LEDGER_THREAD | 1u << LEDGER_CATALOGUE | 1u << LEDGER_MESSAGE | 1u << LEDGER_JOBS |
			       1u << LEDGER_MANIFEST | 1u << LEDGER_PLAN | 1u << LEDGER_PIPE;

	return ledger_claimed(a->core->p.ledger, names) + 2 * input_bytes();
}

int admission_new(struct core *core, struct admission **ret, struct err *err)
{
	struct admission *a = calloc(1, sizeof *a);
	uint64_t total = ledger_total(core->p.ledger);

	if (!a)
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	a->core = core;
	a->emitter_share = emitter_share(total);
	a->index_share = index_share(total);
	a->stage_share = total / 2;
	a->runs_max = total < (UINT64_C(64) << 20) ? 4 : 8;
	a->fixed = service_bytes(a);
	a->fixed_proportional =
		ledger_claimed(core->p.ledger, 1u << LEDGER_MESSAGE | 1u << LEDGER_JOBS | 1u << LEDGER_PLAN | 1u << LEDGER_PIPE);
	*ret = a;
	return 0;
}

struct admission *admission_free(struct admission *a)
{
	free(a);
	return NULL;
}

/* ---- runs ---- */

void admission_add_run(struct admission *a, struct admission_run *r)
{
	struct admission_run **at;

	THREAD_LOOP_ONLY();
	for (at = &a->runs; *at; at = &(*at)->next)
		;
	r->next = NULL;
	*at = r;
}

void admission_remove_run(struct admission *a, struct admission_run *r)
{
	struct admission_run **at;

	THREAD_LOOP_ONLY();
	for (at = &a->runs; *at && *at != r; at = &(*at)->next)
		;
	if (*at)
		*at = r->next;
}

void admission_each_run(struct admission *a, void (*fn)(struct admission_run *, void *), void *ctx)
{
	struct admission_run *r, *next;

	THREAD_LOOP_ONLY();
	for (r = a->runs; r; r = next) {
		next = r->next;
		fn(r, ctx);
	}
}

struct admission_tally admission_tally(struct admission *a, uint32_t uid)
{
	struct admission_tally t = {0};

	THREAD_LOOP_ONLY();
	for (const struct admission_run *r = a->runs; r; r = r->next) {
		struct admission_view view = r->calls->view(r);

		if (!view.has_slot)
			continue;
		t.runs++;
		t.running += !view.stalled;
		t.own += view.uid == uid;
		t.own_running += view.uid == uid && !view.stalled;
		t.largest = view.task_bytes > t.largest ? view.task_bytes : t.largest;
	}
	return t;
}

uint64_t admission_domain_largest(struct admission *a)
{
	return admission_tally(a, 0).largest;
}

bool admission_opens(struct admission *a, const struct dataset *d)
{
	const struct admission_run *r;

	THREAD_LOOP_ONLY();
	for (r = a->runs; r && !r->calls->opens(r, d); r = r->next)
		;
	return r != NULL;
}

static bool is_starved_long(const struct admission *a)
{
	return a->starved_ns && clock_since(a->starved_ns) > STARVED_SECONDS;
}

void admission_relieve(struct admission *a)
{
	struct admission_run *r, *next;
	bool urgent;

	THREAD_LOOP_ONLY();
	if (!sched_starved(a->core->p.sched)) {
		a->starved_ns = 0;
		return;
	}
	if (!a->starved_ns)
		a->starved_ns = clock_mono_ns();
	/* Runs that make no progress release their memory at once; the others when the task has waited for a while. */
	urgent = is_starved_long(a);
	for (r = a->runs; r; r = next) {
		next = r->next;
		r->calls->relieve(r, urgent);
	}
}

bool admission_memory_is_awaited(const struct admission *a)
{
	for (const struct slot *p = a->slots; p; p = p->next)
		if (p->wait == SLOT_MEMORY)
			return true;
	return a->next_stage || is_starved_long(a);
}

/* ---- amounts ---- */

static uint64_t run_share(uint64_t total)
{
	return emitter_share(total) + 2 * index_share(total) + ADMISSION_OUTPUT;
}

uint64_t admission_share(const struct admission *a)
{
	return run_share(ledger_total(a->core->p.ledger));
}

uint64_t admission_domain_memory(struct admission *a)
{
	uint64_t used = service_bytes(a) + admission_staged_bytes(a) + (admission_tally(a, 0).runs + 1) * admission_share(a);
	uint64_t total = ledger_total(a->core->p.ledger);

	return total > used ? total - used : 0;
}

uint64_t admission_emitter_share(const struct admission *a)
{
	return a->emitter_share;
}

uint64_t admission_index_share(const struct admission *a)
{
	return a->index_share;
}

/* For the tasks of the only run, if the memory were `total`. */
static uint64_t alone_bytes(const struct admission *a, uint64_t total)
{
	/* The parts that are set aside are in proportion to the total. */
	double part = (double)a->fixed_proportional * ((double)total / (double)ledger_total(a->core->p.ledger));
	uint64_t used = a->fixed - a->fixed_proportional + (uint64_t)part + 2 * run_share(total);

	return total > used ? total - used : 0;
}

uint64_t admission_alone_bytes(const struct admission *a)
{
	return alone_bytes(a, ledger_total(a->core->p.ledger));
}

bool admission_is_alone(struct admission *a)
{
	return admission_tally(a, 0).runs <= 1 && !admission_staged_bytes(a);
}

/* For the lowest rung, on a dataset of one segment. */
uint64_t admission_plan_min(void)
{
	return pipe_budget_min(NULL);
}

enum { MEGA = 1 << 20 };
static const uint64_t total_max = UINT64_C(1) << 40;

static uint64_t next_total(uint64_t total)
{
	return (total / MEGA + (total < UINT64_C(256) * MEGA ? 1 : 16)) * MEGA;
}

uint64_t admission_memory_for(struct admission *a, const struct grid *grid, uint64_t positions)
{
	uint64_t total = ledger_total(a->core->p.ledger), need;
	struct pipe_budget b;

	THREAD_LOOP_ONLY();
	for (; total <= total_max; total = next_total(total)) {
		const struct pipe_wide wide = {alone_bytes(a, total), PIPE_MADE_AND_SENT, positions, 0};
		struct err err = ERR_INIT;

		if (!pipe_budget_wide(&wide, grid, &b, &need, &err))
			return total;
		if (need == UINT64_MAX)
			break;
	}
	return 0;
}

int admission_check_size(struct admission *a, uint64_t bytes, const char *what, struct err *err)
{
	uint64_t total = ledger_total(a->core->p.ledger), have = admission_alone_bytes(a);

	THREAD_LOOP_ONLY();
	if (bytes <= have)
		return 0;
	while (total < total_max && alone_bytes(a, total) < bytes)
		total = next_total(total);
	err_set(err, ERR_LIMIT, "%s needs %llu KiB of memory, %llu KiB are all that can be free of memory=%lluM", what,
		(unsigned long long)(bytes >> 10), (unsigned long long)(have >> 10),
		(unsigned long long)(ledger_total(a->core->p.ledger) >> 20));
	return err_add_hint(err, "run with memory=%lluM or more", (unsigned long long)(total >> 20));
}
