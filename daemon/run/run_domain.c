/*
 * The domains of a run: their memory, and the tasks that make, split, store and emit them.
 *
 * The model: a domain's memory is mapped by the worker that makes it, of the size that was charged; when it
 * is done, what its result does not need is unmapped and given back. A task owns its run_domain from submit
 * to done; the plan belongs to the worker while `splitting` is set.
 */
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "clock.h"
#include "log.h"
#include "recency.h"
#include "store.h"
#include "run_priv.h"

#define HUGE_PAGE ((size_t)2 << 20)
#define PAGE ((size_t)4096)
/* Positions from which on an arena fills its huge pages. */
#define HUGE_COUNT ((uint64_t)1 << 17)
/* Domains that are made one after the other in the same arenas, from which on that is so too. */
#define HUGE_DOMAINS 64

static struct run_domain *domain_of(struct sched_task *t)
{
	return (struct run_domain *)((char *)t - offsetof(struct run_domain, task));
}

/* ---- memory ---- */

size_t run_page_round(size_t n)
{
	return (n + PAGE - 1) & ~(PAGE - 1);
}

/* Huge pages save the kernel of the triangulation most of its TLB misses; the mapping starts on one and ends
 * with the budget, so that no page beyond it can become resident. Of a small domain they would clear far more
 * memory than it uses: each of the arena's arrays begins on pages of its own. */
static void *memory_map(size_t size, bool huge)
{
	size_t whole = run_page_round(size) + HUGE_PAGE, head;
	uint8_t *base = mmap(NULL, whole, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);

	if (base == MAP_FAILED)
		return NULL;
	head = -(uintptr_t)base & (HUGE_PAGE - 1);
	if (head)
		munmap(base, head);
	munmap(base + head + run_page_round(size), HUGE_PAGE - head);
	madvise(base + head, run_page_round(size), huge ? MADV_HUGEPAGE : MADV_NOHUGEPAGE);
	return base + head;
}

/* Keeps the first `held` bytes. */
static void memory_trim(struct run_domain *d, size_t held)
{
	size_t keep = run_page_round(held);

	if (!d->memory || keep >= d->size)
		return;
	munmap((uint8_t *)d->memory + keep, d->size - keep);
	sched_give(d->run->runs->core->p.sched, LEDGER_DOMAIN, d->size - keep);
	d->size = keep;
	if (!keep)
		d->memory = NULL;
}

static void run_domain_unmap(struct run_domain *d)
{
	memory_trim(d, 0);
}

/* ---- the list ---- */

static struct run_domain *domain_add(struct run *w, size_t index)
{
	struct run_domain *d = calloc(1, sizeof *d), **at;
	struct err err = ERR_INIT;

	if (!d) {
		err_set(&err, ERR_NOMEM, "no memory for a domain");
		run_fail(w, &err);
		return NULL;
	}
	d->run = w;
	d->index = index;
	d->err = ERR_INIT;
	for (at = &w->domains; *at && (*at)->index < index; at = &(*at)->next)
		;
	d->next = *at;
	*at = d;
	w->ndomains++;
	return d;
}

void run_domain_release(struct run_domain *d)
{
	struct run *w = d->run;
	struct run_domain **at;

	for (at = &w->domains; *at != d; at = &(*at)->next)
		;
	*at = d->next;
	w->ndomains--;
	run_domain_unmap(d);
	free(d);
}

static void submit(struct run_domain *d, void (*run)(struct sched_task *), void (*done)(struct sched_task *),
		   enum sched_priority priority, uint64_t bytes)
{
	d->task = (struct sched_task){
		.run = run,
		.done = done,
		.owner = d->run->owner,
		.priority = priority,
		.name = LEDGER_DOMAIN,
		.bytes = bytes,
	};
	d->run->tasks++;
	sched_submit(d->run->runs->core->p.sched, &d->task);
}

/* ---- making ---- */

/* Domains of a one-step dataset go with it. */
int run_store(const struct run *w)
{
	return w->dataset->onestep ? w->dataset->dirfd : w->runs->core->domainsfd;
}

bool run_recent(void *run, struct digest base, struct digest *ret_list)
{
	struct store_id id;
	bool is = recency_find(((const struct run *)run)->runs->recency, base, &id);

	if (is)
		*ret_list = id.list;
	return is;
}

bool run_recall(void *run, struct digest base, struct pipe_summary *ret)
{
	return recency_find(((const struct run *)run)->runs->summaries, base, ret);
}

void run_remember(void *run, const struct pipe_summary *summary)
{
	const struct run *w = run;

	if (!w->dataset->onestep)
		recency_note(w->runs->summaries, summary);
}

void run_used(const struct run *w, const struct pipe_stored *as, int64_t now_ns)
{
	recency_note(w->runs->recency, &as->id);
	if (as->used_ns < now_ns - STORE_TOUCH_NS)
		store_touch(run_store(w), &as->id, now_ns - STORE_TOUCH_NS);
}

/* Of the job's own run: later streams give the same domains. */
static void tell(struct run_domain *d)
{
	struct run *w = d->run;
	struct plan_done done = {.region = d->region,
				 .base = d->as.id.base,
				 .list = d->as.id.list,
				 .digest = d->as.digest,
				 .payload = d->as.payload,
				 .triangles = d->as.triangles,
				 .bytes = d->as.bytes};
	struct err err = ERR_INIT;

	if (w->file && w->keep && !w->lazy && plan_file_done(w->file, &done, 1, &err))
		log_err(LOG_LEVEL_DEBUG, "a finished domain is not noted in the plan", &err);
}

/* Any thread. Each of them, so that they are counted. */
void run_tell_damaged(const struct run *w, unsigned n)
{
	while (n--)
		log_event(LOG_EVENT_DAMAGE_DERIVED, ABOUT_RUN(w), "a stored domain of %s was damaged: it is made again",
			  w->dataset->name);
}

static struct pipe_reuse_params reuse_params(struct run_domain *d)
{
	struct run *w = d->run;

	return (struct pipe_reuse_params){.storefd = run_store(w),
					  .grid = w->grid,
					  .view = &w->rest,
					  .key = &w->key,
					  .region = &d->region,
					  .cap = w->budget.cap,
					  .memory = d->memory,
					  .size = d->size,
					  .light = d->front,
					  .sums = w->sums,
					  .after_ns = d->looked ? w->there.looked_ns : 0,
					  .hint = run_recent,
					  .recall = run_recall,
					  .remember = w->sums ? run_remember : NULL,
					  .ctx = w};
}

static bool load(struct run_domain *d)
{
	struct run *w = d->run;
	unsigned damaged = 0;
	struct pipe_reuse_params p = reuse_params(d);
	struct err err = ERR_INIT;
	int r;

	p.damaged = &damaged;
	r = pipe_reuse(&p, &d->domain, &d->as, &d->held, &err);

	run_tell_damaged(w, damaged);

	if (r < 0)
		log_event_err(LOG_EVENT_STORE_FAILED, ABOUT_RUN(w), "a stored domain cannot be read, it is made again", &err);
	d->stored = !r;
	if (!r)
		run_used(w, &d->as, 1000 * clock_real_us());
	return !r;
}

static void keep(struct run_domain *d)
{
	struct run *w = d->run;
	struct pipe_summary summary;
	struct err err = ERR_INIT;
	int r;

	d->unstorable = !run_space_domain(w, d->held);
	if (d->unstorable)
		return;
	r = pipe_store(run_store(w), &w->key, &d->region, &d->domain, d->memory, &d->as, &summary, &err);

	d->stored = !r;
	d->unstorable = r != 0;
	run_space_stored(w, d->held, r ? 0 : d->as.bytes);
	if (!r) {
		recency_note(w->runs->recency, &d->as.id);
		run_remember(w, &summary);
		return;
	}
	log_event_err(LOG_EVENT_STORE_FAILED, ABOUT_RUN(w), "a finished domain cannot be stored", &err);
}

static void map(struct run_domain *d, uint64_t bytes)
{
	d->size = run_page_round(bytes);
	d->memory = memory_map(d->size, d->huge);
	if (!d->memory)
		d->r = err_set(&d->err, ERR_NOMEM, "no memory for a domain of %zu bytes", d->size);
}

/* What is left of a domain whose sums are all that is wanted. */
static void strip(struct run_domain *d)
{
	d->domain.triangle = NULL;
	d->domain.link = NULL;
	d->domain.vertex = NULL;
	d->domain.final = NULL;
	d->held = 0;
}

/* Beside the survey and far from it a region has few points, and reads many others for its halo. */
static int make(struct run_domain *d)
{
	struct run *w = d->run;
	const struct pipe_reuse_params p = reuse_params(d);
	struct pipe_known known = {.sites = d->sites, .flat = d->flat};
	struct pipe_before before;

	if (d->changed && !w->rest.window && pipe_before(&p, &before))
		known.before = &before;
	return pipe_domain(w->grid, &w->rest, &d->region, &known, &w->budget, d->memory, &d->domain, &d->need, &d->err);
}

static void make_or_load(struct run_domain *d)
{
	struct run *w = d->run;

	d->made = false;
	if (!w->rest.window && !d->flat && load(d)) {
		tell(d);
		return;
	}
	d->made = true;
	d->r = make(d);
	if (d->r)
		return;
	d->held = pipe_domain_held(&d->domain, d->memory);
	d->unstorable = w->rest.window || d->flat;
	if (!d->unstorable && w->keep && !atomic_load(&d->task.cancel))
		keep(d);
	if (d->stored)
		tell(d);
}

static void make_run(struct sched_task *t)
{
	struct run_domain *d = domain_of(t);
	struct run *w = d->run;

	d->err = ERR_INIT;
	d->r = 0;
	if (!d->lent)
		map(d, t->bytes);
	else
		d->bare = !run_arena_take(d);
	if (d->r || d->bare)
		return;
	make_or_load(d);
	if (d->r || !w->sums)
		return;
	strip(d);
	/* Not for the next one where somebody else waits for memory. */
	if (!sched_starved(w->runs->core->p.sched))
		run_arena_put(d);
}

static void make_done(struct sched_task *);

static void make_submit(struct run_domain *d, enum sched_priority priority, bool own)
{
	const struct run *w = d->run;

	/* An arena that serves many domains fills its huge pages; of those it serves some may be larger than this. */
	d->huge = (w->sums ? w->budget.load : d->count) >= HUGE_COUNT || (w->sums && w->plan_n > w->there.leaves + HUGE_DOMAINS);
	submit(d, make_run, make_done, priority,
	       d->run->sums ? run_arena_ask(d, own) : run_page_round(d->run->budget.domain_bytes));
}

static void make_done(struct sched_task *t)
{
	struct run_domain *d = domain_of(t);
	struct run *w = d->run;

	w->tasks--;
	if (w->sums)
		run_arena_back(d);
	if (t->ran && !d->memory && !d->put)
		sched_give(w->runs->core->p.sched, t->name, t->bytes);
	if (d->bare && t->ran && !w->stopping) {
		make_submit(d, t->priority, true);
		return;
	}
	if (!t->ran || w->stopping) {
		run_domain_release(d);
		return;
	}
	if (d->r == PIPE_E_SPLIT) {
		run_domain_unmap(d);
		d->state = DOMAIN_SPLIT;
	} else if (d->r) {
		run_fail(w, &d->err);
		run_domain_release(d);
	} else {
		memory_trim(d, d->held);
		w->made += d->made;
		if (d->made)
			tally_domain(w->runs->core, d->domain.ntriangle);
		else
			w->runs->core->tally.domains_reused++;
		d->state = DOMAIN_READY;
	}
	run_settle(w);
}

/* Whether its block will not be asked for. */
static bool passes(const struct run_domain *d)
{
	const struct run *w = d->run;

	/* A block has no higher number than its domain has in the plan. */
	return w->output ? d->index < w->output->from : w->keep;
}

static void run_domain_restart(struct run_domain *d, enum sched_priority priority)
{
	run_domain_unmap(d);
	d->state = DOMAIN_MAKING;
	d->stored = false;
	d->front = passes(d);
	make_submit(d, priority, false);
}

struct run_domain *run_domain_start(struct run *w, size_t index, enum sched_priority priority)
{
	struct run_domain *d = domain_add(w, index);

	if (!d)
		return NULL;
	d->region = w->plan.leaf[index].region;
	d->sites = w->plan.leaf[index].known ? w->plan.sites : NULL;
	d->count = w->plan.leaf[index].count;
	d->looked = w->plan.leaf[index].checked && !w->plan.leaf[index].there;
	d->changed = w->plan.leaf[index].changed;
	d->flat = w->plan.leaf[index].flat;
	run_domain_restart(d, priority);
	return d;
}

/* ---- splitting ---- */

static void split_run(struct sched_task *t)
{
	struct run_domain *d = domain_of(t);
	struct run *w = d->run;
	struct grid_reader *reader = NULL;
	size_t size = grid_reader_bytes(w->grid);
	void *memory = aligned_alloc(64, (size + 63) & ~(size_t)63);

	d->err = ERR_INIT;
	if (!memory) {
		d->r = err_set(&d->err, ERR_NOMEM, "no memory to read the grid");
		return;
	}
	d->r = grid_reader_new(w->grid, memory, size, &reader, &d->err);
	if (!d->r)
		d->r = pipe_plan_split(&w->plan, d->index, reader, &w->rest, d->need, w->budget.cap, &d->err);
	/* Before a half of it is made, for good. */
	if (!d->r && w->file)
		d->r = plan_file_split(w->file, &d->region, &w->plan.leaf[d->index], &d->err);
	grid_reader_free(reader);
	free(memory);
}

static void split_done(struct sched_task *t)
{
	struct run_domain *d = domain_of(t), *other;
	struct run *w = d->run;
	size_t at = d->index;

	w->tasks--;
	w->splitting = NULL;
	w->plan_n = w->plan.n;
	if (t->ran)
		sched_give(w->runs->core->p.sched, t->name, t->bytes);
	if (!t->ran || w->stopping || d->r) {
		if (t->ran && d->r)
			run_fail(w, &d->err);
		run_domain_release(d);
		run_settle(w);
		return;
	}
	for (other = w->domains; other; other = other->next)
		if (other->index > at)
			other->index++;
	w->next_start += at < w->next_start;
	d->region = w->plan.leaf[at].region;
	d->sites = NULL;
	d->looked = d->changed = false;
	d->count = w->plan.leaf[at].count;
	run_domain_restart(d, SCHED_FIRST);
	run_domain_start(w, at + 1, SCHED_FIRST);
	run_settle(w);
}

void run_domain_split(struct run_domain *d)
{
	d->run->splitting = d;
	submit(d, split_run, split_done, SCHED_FIRST, grid_reader_bytes(d->run->grid));
}

/* ---- storing ---- */

static void store_run(struct sched_task *t)
{
	struct run_domain *d = domain_of(t);

	if (!d->stored)
		keep(d);
}

static void store_done(struct sched_task *t)
{
	struct run_domain *d = domain_of(t);
	struct run *w = d->run;

	w->tasks--;
	d->state = DOMAIN_READY;
	if (d->stored || w->stopping)
		run_domain_release(d);
	run_settle(w);
}

void run_domain_store(struct run_domain *d)
{
	if (d->stored) {
		run_domain_release(d);
		return;
	}
	d->state = DOMAIN_STORING;
	submit(d, store_run, store_done, SCHED_FIRST, 0);
}

/* ---- emitting ---- */

static int take_block(void *ctx, const struct mesh_block *block, struct err *err)
{
	struct run *w = ctx;

	w->blocks = block->index + 1;
	/* Blocks that its reader has already are passed only. */
	if (w->output && block->index < w->output->from)
		return 0;
	w->emitting->block = true;
	if (w->output)
		w->output->calls->encode(w->output, block);
	return 0;
}

static void emit_run(struct sched_task *t)
{
	struct run_domain *d = domain_of(t);
	struct run *w = d->run;
	struct mesh_sink sink = {.ctx = w, .block = take_block};

	d->err = ERR_INIT;
	d->r = run_space_spill(w, &d->err);
	if (!d->r)
		d->r = pipe_emit(w->emitter, &d->domain, &d->region, d->domain.triangle ? &sink : NULL, &d->err);
	if (!d->domain.triangle) {
		w->blocks++;
		d->block = !w->output;
	}
}

static void emit_done(struct sched_task *t)
{
	struct run_domain *d = domain_of(t);
	struct run *w = d->run;
	bool block = d->block;

	w->tasks--;
	w->emitting = NULL;
	w->output_working = false;
	if (w->output_freed)
		run_output_drop(w);
	if (!t->ran || d->r) {
		if (t->ran)
			run_fail(w, &d->err);
		run_domain_release(d);
		run_settle(w);
		return;
	}
	w->next_emit++;
	w->points += d->domain.counts.points;
	if (d->domain.ntriangle && !w->first_ns)
		w->first_ns = clock_mono_ns();
	if (block && w->output) {
		d->state = DOMAIN_SENDING;
		w->sending = d;
		w->output_busy = true;
		w->sending_ns = clock_mono_ns();
		w->output->calls->send(w->output);
	} else {
		run_domain_release(d);
	}
	if (w->calls->moved)
		w->calls->moved(w->ctx);
	run_settle(w);
}

/* Counted only: too little to ask a worker. */
static void count(struct run_domain *d)
{
	struct run *w = d->run;
	struct err err = ERR_INIT;
	int r = pipe_emit(w->emitter, &d->domain, &d->region, NULL, &err);

	if (r)
		run_fail(w, &err);
	w->blocks += d->domain.nvertex > 0;
	if (d->domain.ntriangle && !w->first_ns)
		w->first_ns = clock_mono_ns();
	w->next_emit++;
	w->points += d->domain.counts.points;
	run_domain_release(d);
	if (w->sums && w->calls->moved)
		w->calls->moved(w->ctx);
}

bool run_is_there(const struct run *w, size_t index)
{
	return w->sums && w->plan.leaf[index].there;
}

void run_domain_emit(struct run_domain *d)
{
	struct run *w = d->run;

	if (!d->domain.nvertex || w->sums) {
		count(d);
		return;
	}
	if (!d->domain.triangle && w->output && w->blocks >= w->output->from) {
		/* Its reader came, or the plan was split before it: the rest is needed too. */
		run_domain_restart(d, SCHED_FIRST);
		return;
	}
	d->state = DOMAIN_EMITTING;
	w->emitting = d;
	w->output_working = w->output != NULL;
	submit(d, emit_run, emit_done, SCHED_FIRST, 0);
}
