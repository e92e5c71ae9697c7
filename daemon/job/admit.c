/*
 * Who may have what of the memory. (Who is next for a place: slots.c. Who is next for a worker and for bytes that
 * come free: sched_queue.c.)
 *
 * The shares of `memory`: what is small has its part whatever else is held (service_bytes); every run at work has a share
 * for its table of unfinished vertices and one for index pages; stages take up to half; domains take what is left.
 *
 * Why the first in the queue can always run. What is held falls into two kinds:
 *   - for long: the fixed part, the shares of the runs at work, the stages of pushes. Nothing of it is waited for
 *     while holding other memory: a run gets its place, that is all of its share, at once (slots.c), and gives it
 *     back before it waits for more than its plan can have (run_retreat); a push waits for its stage, and for
 *     room for more names, holding no more than the names of its files; where only such pushes are left the youngest is
 *     refused (push_room).
 *   - for a while: what a task takes when it starts (a domain, a plan, a selection, buffers to read a file). It ends
 *     without asking for more; what it leaves in memory (a finished domain) goes to the store when others lack
 *     memory (run_relieve), by tasks that need none and so are never behind one that waits. A plan is made by two tasks, of which
 * the second needs none either (run_plan.c). Let F be the memory without what is held for long. Then at any time F is at least
 * what the largest single task of any run at work takes: a place is given only where F stays so large (room_for), a stage leaves
 * twice that (admit_stage), and a plan's domains are at most half of F when it is made. The first task in the queue that lacks
 * memory has a claim on all that comes free (sched_queue.c). So when those before it have ended, it fits. Tasks that
 * are no run's (inspection, a file larger than was thought) are refused where they could be larger than F can
 * become (admit_never). Helpers that read a file in parts only take what is idle, and never have a claim.
 */
#include "clock.h"
#include "job_priv.h"
#include "run_priv.h"

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

/* What is not for domains and stages: stacks, the catalogue, messages, streams, and what grows with jobs and sources. What pushes
 * keep of their files is in jobs_staged. */
static uint64_t service_bytes(const struct jobs *j)
{
	const unsigned names = 1u << LEDGER_THREAD | 1u << LEDGER_CATALOGUE | 1u << LEDGER_MESSAGE | 1u << LEDGER_JOBS |
			       1u << LEDGER_MANIFEST | 1u << LEDGER_PLAN | 1u << LEDGER_PIPE;

	return ledger_claimed(j->p.ledger, names) + 2 * input_bytes();
}

void admit_init(struct jobs *j)
{
	uint64_t total = ledger_total(j->p.ledger);

	j->emitter_share = emitter_share(total);
	j->index_share = index_share(total);
	j->stage_share = total / 2;
	j->runs_max = total < (UINT64_C(64) << 20) ? 4 : 8;
	j->reserve = service_bytes(j);
	j->reserve_part =
		ledger_claimed(j->p.ledger, 1u << LEDGER_MESSAGE | 1u << LEDGER_JOBS | 1u << LEDGER_PLAN | 1u << LEDGER_PIPE);
}

/* ---- what is held ---- */

void jobs_each_run(struct jobs *j, void (*fn)(struct run *, void *), void *ctx)
{
	struct job_asked_plan *p;
	struct job_fetch *f;
	struct job *job;

	for (job = j->jobs; job; job = job->next) {
		if (job->run && !job->run_ended)
			fn(job->run, ctx);
		for (f = job->fetches; f; f = f->next)
			if (f->run && !f->run_ended)
				fn(f->run, ctx);
	}
	for (p = j->plans; p; p = p->next)
		if (p->run && !p->run_ended)
			fn(p->run, ctx);
}

struct look {
	struct admit_tally t;
	uint32_t uid;
	const struct dataset *dataset;
};

static void tally_run(struct run *w, void *ctx)
{
	struct look *l = ctx;
	bool ours = w->owner.uid == l->uid, stalled = run_stalled(w);

	l->t.opening += run_opens(w, l->dataset);
	if (!w->placed)
		return;
	l->t.runs++;
	l->t.running += !stalled;
	l->t.own += ours;
	l->t.own_running += ours && !stalled;
	if (run_domain_bytes(w) > l->t.largest)
		l->t.largest = run_domain_bytes(w);
	/* It has come back for so much, and has no plan yet. */
	if (w->state < RUN_PLANNING && w->slot->need > l->t.largest)
		l->t.largest = w->slot->need;
}

struct admit_tally admit_tally(struct jobs *j, uint32_t uid)
{
	struct look l = {.uid = uid};

	jobs_each_run(j, tally_run, &l);
	return l.t;
}

uint64_t jobs_domain_largest(struct jobs *j)
{
	return admit_tally(j, 0).largest;
}

bool jobs_opening(struct jobs *j, const struct dataset *d)
{
	struct look l = {.dataset = d};

	jobs_each_run(j, tally_run, &l);
	return l.t.opening > 0;
}

uint64_t jobs_staged(const struct jobs *j)
{
	struct push *p;
	uint64_t bytes = j->rewriting;

	for (p = j->pushes; p; p = push_next(p))
		bytes += push_stage_bytes(p);
	return bytes;
}

/* ---- what is left ---- */

static uint64_t share_of(uint64_t total)
{
	return emitter_share(total) + 2 * index_share(total) + JOB_OUTPUT_BUFFER;
}

/* Beside its domains: the table, index pages and what the index keeps of its own, the buffer of a slow reader. */
uint64_t admit_share(const struct jobs *j)
{
	return share_of(ledger_total(j->p.ledger));
}

uint64_t jobs_domain_memory(struct jobs *j)
{
	uint64_t used = service_bytes(j) + jobs_staged(j) + (admit_tally(j, 0).runs + 1) * admit_share(j);
	uint64_t total = ledger_total(j->p.ledger);

	return total > used ? total - used : 0;
}

/* With that memory, what domains of the only run have. */
static uint64_t alone(const struct jobs *j, uint64_t total)
{
	/* The parts that are set aside are in proportion to the memory. */
	double part = (double)j->reserve_part * ((double)total / (double)ledger_total(j->p.ledger));
	uint64_t used = j->reserve - j->reserve_part + (uint64_t)part + 2 * share_of(total);

	return total > used ? total - used : 0;
}

uint64_t admit_alone(const struct jobs *j)
{
	return alone(j, ledger_total(j->p.ledger));
}

bool admit_only(struct jobs *j)
{
	return admit_tally(j, 0).runs <= 1 && !jobs_staged(j);
}

/* Of a plan of the lowest rung on a dataset of one segment. */
uint64_t admit_least(void)
{
	return pipe_budget_min(NULL);
}

enum { MEGA = 1 << 20 };
static const uint64_t most = UINT64_C(1) << 40;

static uint64_t larger(uint64_t total)
{
	return (total / MEGA + (total < UINT64_C(256) * MEGA ? 1 : 16)) * MEGA;
}

uint64_t jobs_memory_for(struct jobs *j, const struct grid *grid, uint64_t positions)
{
	uint64_t total = ledger_total(j->p.ledger);
	struct pipe_budget b = {0};

	for (; total <= most; total = larger(total)) {
		struct err err = ERR_INIT;

		if (pipe_budget(alone(j, total), j->p.threads, grid, &b, &err))
			continue;
		if (b.cap >= positions)
			return total;
		if (b.load == pipe_load[PIPE_LOADS - 1] && b.threads == j->p.threads)
			break;
	}
	return 0;
}

int admit_never(struct jobs *j, uint64_t bytes, const char *what, struct err *err)
{
	uint64_t total = ledger_total(j->p.ledger), have = admit_alone(j);

	if (bytes <= have)
		return 0;
	while (total < most && alone(j, total) < bytes)
		total = larger(total);
	err_set(err, ERR_LIMIT, "%s needs %llu KiB of memory, %llu KiB are all that can be free of memory=%lluM", what,
		(unsigned long long)(bytes >> 10), (unsigned long long)(have >> 10),
		(unsigned long long)(ledger_total(j->p.ledger) >> 20));
	return err_add_hint(err, "run with memory=%lluM or more", (unsigned long long)(total >> 20));
}

/* ---- stages ---- */

uint64_t admit_stage(struct jobs *j, uint64_t least)
{
	uint64_t left = jobs_domain_memory(j), head = 2 * jobs_domain_largest(j);

	/* A job that runs, or comes, must be able to finish beside it, one domain at a time. */
	head = head > admit_least() ? head : admit_least();
	left = left > head ? left - head : 0;
	left = left < j->stage_share ? left : j->stage_share;
	return left >= least ? left : 0;
}

static unsigned stages_of(const struct jobs *j, uint32_t uid)
{
	unsigned n = 0;

	for (const struct push *p = j->pushes; p; p = push_next(p))
		n += push_uid(p) == uid && push_has_stage(p);
	return n;
}

/* Of those that wait for one, and whose user may have one more: whose user has the fewest, then was served least, then who came
 * first. */
static struct push *stage_next(struct jobs *j)
{
	struct push *p, *best = NULL;
	unsigned have = 0;
	int64_t service = 0;

	for (p = j->pushes; p; p = push_next(p)) {
		unsigned n;
		int64_t s;

		if (!push_wants_stage(p) || !push_stage_fits(p))
			continue;
		n = stages_of(j, push_uid(p));
		s = sched_service(j->p.sched, push_uid(p));
		/* The list is by age, the youngest first. */
		if (best && (n > have || (n == have && s > service)))
			continue;
		best = p;
		have = n;
		service = s;
	}
	return best;
}

void admit_stages(struct jobs *j)
{
	THREAD_LOOP_ONLY();
	do {
		j->stage_turn = stage_next(j);
		if (j->stage_turn)
			push_retry(j->stage_turn);
	} while (j->stage_turn && !push_wants_stage(j->stage_turn));
}

bool admit_stage_awaited(const struct jobs *j, uint32_t uid)
{
	const struct push *p = j->stage_turn;

	return p && push_uid(p) != uid && !stages_of(j, push_uid(p));
}

/* ---- who yields ---- */

static void relieve(struct run *w, void *ctx)
{
	run_relieve(w, *(const bool *)ctx);
}

/* The first in the queue lacks memory: runs that do not get on give theirs at once, the others when it has
 * waited for a while. */
void admit_relieve(struct jobs *j)
{
	bool urgent;

	THREAD_LOOP_ONLY();
	if (!sched_starved(j->p.sched)) {
		j->starved_ns = 0;
		return;
	}
	if (!j->starved_ns)
		j->starved_ns = clock_mono_ns();
	urgent = clock_since(j->starved_ns) > STARVED_SECONDS;
	jobs_each_run(j, relieve, &urgent);
}

struct same {
	const struct run *run;
	bool found;
};

static void look_same(struct run *w, void *ctx)
{
	struct same *s = ctx;

	s->found |= run_selects_same(w, s->run);
}

bool jobs_selecting(struct jobs *j, const struct run *w)
{
	struct same s = {.run = w};

	jobs_each_run(j, look_same, &s);
	return s.found;
}
