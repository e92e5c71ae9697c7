/*
 * The domains of a walk: their memory, and the tasks that make, split, store and emit them.
 *
 * The model: a domain's memory is mapped by the worker that makes it, of the size that was charged; when it
 * is done, what its result does not need is unmapped and given back. A task owns its walk_domain from submit
 * to done; the plan belongs to the worker while `splitting` is set.
 */
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "clock.h"
#include "hints.h"
#include "job_priv.h"
#include "log.h"
#include "store.h"
#include "walk_priv.h"

#define HUGE_PAGE ((size_t)2 << 20)
#define PAGE ((size_t)4096)
/* Positions from which on an arena fills its huge pages. */
#define HUGE_COUNT ((uint64_t)1 << 17)
/* Domains that are made one after the other in the same arenas, from which on that is so too. */
#define HUGE_DOMAINS 64

static struct walk_domain *domain_of(struct sched_task *t)
{
	return (struct walk_domain *)((char *)t - offsetof(struct walk_domain, task));
}

/* ---- memory ---- */

size_t walk_page_round(size_t n)
{
	return (n + PAGE - 1) & ~(PAGE - 1);
}

/* Huge pages save the kernel of the triangulation most of its TLB misses; the mapping starts on one and ends
 * with the budget, so that no page beyond it can become resident. Of a small domain they would clear far more
 * memory than it uses: each of the arena's arrays begins on pages of its own. */
static void *memory_map(size_t size, bool huge)
{
	size_t whole = walk_page_round(size) + HUGE_PAGE, head;
	uint8_t *base = mmap(NULL, whole, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);

	if (base == MAP_FAILED)
		return NULL;
	head = -(uintptr_t)base & (HUGE_PAGE - 1);
	if (head)
		munmap(base, head);
	munmap(base + head + walk_page_round(size), HUGE_PAGE - head);
	madvise(base + head, walk_page_round(size), huge ? MADV_HUGEPAGE : MADV_NOHUGEPAGE);
	return base + head;
}

/* Keeps the first `held` bytes. */
static void memory_trim(struct walk_domain *d, size_t held)
{
	size_t keep = walk_page_round(held);

	if (!d->memory || keep >= d->size)
		return;
	munmap((uint8_t *)d->memory + keep, d->size - keep);
	sched_give(d->walk->jobs->p.sched, LEDGER_DOMAIN, d->size - keep);
	d->size = keep;
	if (!keep)
		d->memory = NULL;
}

static void walk_domain_unmap(struct walk_domain *d)
{
	memory_trim(d, 0);
}

/* ---- the list ---- */

static struct walk_domain *domain_add(struct walk *w, size_t index)
{
	struct walk_domain *d = calloc(1, sizeof *d), **at;
	struct err err = ERR_INIT;

	if (!d) {
		err_set(&err, ERR_NOMEM, "no memory for a domain");
		walk_fail(w, &err);
		return NULL;
	}
	d->walk = w;
	d->index = index;
	d->err = ERR_INIT;
	for (at = &w->domains; *at && (*at)->index < index; at = &(*at)->next)
		;
	d->next = *at;
	*at = d;
	w->ndomains++;
	return d;
}

void walk_domain_release(struct walk_domain *d)
{
	struct walk *w = d->walk;
	struct walk_domain **at;

	for (at = &w->domains; *at != d; at = &(*at)->next)
		;
	*at = d->next;
	w->ndomains--;
	walk_domain_unmap(d);
	free(d);
}

static void submit(struct walk_domain *d, void (*run)(struct sched_task *), void (*done)(struct sched_task *),
		   enum sched_priority priority, uint64_t bytes)
{
	d->task = (struct sched_task){
		.run = run,
		.done = done,
		.owner = d->walk->owner,
		.priority = priority,
		.name = LEDGER_DOMAIN,
		.bytes = bytes,
	};
	d->walk->tasks++;
	sched_submit(d->walk->jobs->p.sched, &d->task);
}

/* ---- making ---- */

/* Domains of a one-step dataset go with it. */
int walk_store(const struct walk *w)
{
	return w->dataset->onestep ? w->dataset->dirfd : w->jobs->domainsfd;
}

bool walk_hint(void *walk, struct digest base, struct digest *ret_list)
{
	struct store_id id;
	bool is = hints_find(((const struct walk *)walk)->jobs->hints, base, &id);

	if (is)
		*ret_list = id.list;
	return is;
}

bool walk_recall(void *walk, struct digest base, struct pipe_summary *ret)
{
	return hints_find(((const struct walk *)walk)->jobs->summaries, base, ret);
}

void walk_remember(void *walk, const struct pipe_summary *summary)
{
	const struct walk *w = walk;

	if (!w->dataset->onestep)
		hints_note(w->jobs->summaries, summary);
}

void walk_used(const struct walk *w, const struct pipe_stored *as, int64_t now_ns)
{
	hints_note(w->jobs->hints, &as->id);
	if (as->used_ns < now_ns - STORE_TOUCH_NS)
		store_touch(walk_store(w), &as->id, now_ns - STORE_TOUCH_NS);
}

/* Of the job's own walk: later streams give the same domains. */
static void tell(struct walk_domain *d)
{
	struct walk *w = d->walk;
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
void walk_tell_damaged(const struct walk *w, unsigned n)
{
	while (n--)
		log_event(LOG_EVENT_DAMAGE_DERIVED, ABOUT_WALK(w), "a stored domain of %s was damaged: it is made again",
			  w->dataset->name);
}

static struct pipe_reuse_params reuse_params(struct walk_domain *d)
{
	struct walk *w = d->walk;

	return (struct pipe_reuse_params){.storefd = walk_store(w),
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
					  .hint = walk_hint,
					  .recall = walk_recall,
					  .remember = w->sums ? walk_remember : NULL,
					  .ctx = w};
}

static bool load(struct walk_domain *d)
{
	struct walk *w = d->walk;
	unsigned damaged = 0;
	struct pipe_reuse_params p = reuse_params(d);
	struct err err = ERR_INIT;
	int r;

	p.damaged = &damaged;
	r = pipe_reuse(&p, &d->domain, &d->as, &d->held, &err);

	walk_tell_damaged(w, damaged);

	if (r < 0)
		log_event_err(LOG_EVENT_STORE_FAILED, ABOUT_WALK(w), "a stored domain cannot be read, it is made again", &err);
	d->stored = !r;
	if (!r)
		walk_used(w, &d->as, 1000 * clock_real_us());
	return !r;
}

static void keep(struct walk_domain *d)
{
	struct walk *w = d->walk;
	struct pipe_summary summary;
	struct err err = ERR_INIT;
	int r;

	d->unstorable = !walk_space_domain(w, d->held);
	if (d->unstorable)
		return;
	r = pipe_keep(walk_store(w), &w->key, &d->region, &d->domain, d->memory, &d->as, &summary, &err);

	d->stored = !r;
	d->unstorable = r != 0;
	walk_space_stored(w, d->held, r ? 0 : d->as.bytes);
	if (!r) {
		hints_note(w->jobs->hints, &d->as.id);
		walk_remember(w, &summary);
		return;
	}
	log_event_err(LOG_EVENT_STORE_FAILED, ABOUT_WALK(w), "a finished domain cannot be stored", &err);
}

static void map(struct walk_domain *d, uint64_t bytes)
{
	d->size = walk_page_round(bytes);
	d->memory = memory_map(d->size, d->huge);
	if (!d->memory)
		d->r = err_set(&d->err, ERR_NOMEM, "no memory for a domain of %zu bytes", d->size);
}

/* What is left of a domain whose sums are all that is wanted. */
static void strip(struct walk_domain *d)
{
	d->domain.triangle = NULL;
	d->domain.link = NULL;
	d->domain.vertex = NULL;
	d->domain.final = NULL;
	d->held = 0;
}

/* Beside the survey and far from it a region has few points, and reads many others for its halo. */
static int make(struct walk_domain *d)
{
	struct walk *w = d->walk;
	const struct pipe_reuse_params p = reuse_params(d);
	struct pipe_known known = {.sites = d->sites};
	struct pipe_before before;

	if (d->changed && !w->rest.window && pipe_before(&p, &before))
		known.before = &before;
	return pipe_domain(w->grid, &w->rest, &d->region, &known, &w->budget, d->memory, &d->domain, &d->need, &d->err);
}

static void make_or_load(struct walk_domain *d)
{
	struct walk *w = d->walk;

	d->made = false;
	if (!w->rest.window && load(d)) {
		tell(d);
		return;
	}
	d->made = true;
	d->r = make(d);
	if (d->r)
		return;
	d->held = pipe_domain_held(&d->domain, d->memory);
	d->unstorable = w->rest.window;
	if (!d->unstorable && w->keep && !atomic_load(&d->task.cancel))
		keep(d);
	if (d->stored)
		tell(d);
}

static void make_run(struct sched_task *t)
{
	struct walk_domain *d = domain_of(t);
	struct walk *w = d->walk;

	d->err = ERR_INIT;
	d->r = 0;
	if (!d->lent)
		map(d, t->bytes);
	else
		d->bare = !walk_arena_take(d);
	if (d->r || d->bare)
		return;
	make_or_load(d);
	if (d->r || !w->sums)
		return;
	strip(d);
	/* Not for the next one where somebody else waits for memory. */
	if (!sched_starved(w->jobs->p.sched))
		walk_arena_put(d);
}

static void make_done(struct sched_task *);

static void make_submit(struct walk_domain *d, enum sched_priority priority, bool own)
{
	const struct walk *w = d->walk;

	/* An arena that serves many domains fills its huge pages; of those it serves some may be larger than this. */
	d->huge = (w->sums ? w->budget.load : d->count) >= HUGE_COUNT || (w->sums && w->plan_n > w->there.leaves + HUGE_DOMAINS);
	submit(d, make_run, make_done, priority,
	       d->walk->sums ? walk_arena_ask(d, own) : walk_page_round(d->walk->budget.domain_bytes));
}

static void make_done(struct sched_task *t)
{
	struct walk_domain *d = domain_of(t);
	struct walk *w = d->walk;

	w->tasks--;
	if (w->sums)
		walk_arena_back(d);
	if (t->ran && !d->memory && !d->put)
		sched_give(w->jobs->p.sched, t->name, t->bytes);
	if (d->bare && t->ran && !w->stopping) {
		make_submit(d, t->priority, true);
		return;
	}
	if (!t->ran || w->stopping) {
		walk_domain_release(d);
		return;
	}
	if (d->r == PIPE_E_SPLIT) {
		walk_domain_unmap(d);
		d->state = DOMAIN_SPLIT;
	} else if (d->r) {
		walk_fail(w, &d->err);
		walk_domain_release(d);
	} else {
		memory_trim(d, d->held);
		w->made += d->made;
		if (d->made)
			tally_domain(w->jobs, d->domain.ntriangle);
		else
			w->jobs->tally.domains_reused++;
		d->state = DOMAIN_READY;
	}
	walk_settle(w);
}

/* Whether its block will not be asked for. */
static bool passes(const struct walk_domain *d)
{
	const struct walk *w = d->walk;

	/* A block has no higher number than its domain has in the plan. */
	return w->output ? d->index < w->output->from : w->keep;
}

static void walk_domain_restart(struct walk_domain *d, enum sched_priority priority)
{
	walk_domain_unmap(d);
	d->state = DOMAIN_MAKING;
	d->stored = false;
	d->front = passes(d);
	make_submit(d, priority, false);
}

struct walk_domain *walk_domain_start(struct walk *w, size_t index, enum sched_priority priority)
{
	struct walk_domain *d = domain_add(w, index);

	if (!d)
		return NULL;
	d->region = w->plan.leaf[index].region;
	d->sites = w->plan.leaf[index].known ? w->plan.sites : NULL;
	d->count = w->plan.leaf[index].count;
	d->looked = w->plan.leaf[index].looked && !w->plan.leaf[index].there;
	d->changed = w->plan.leaf[index].changed;
	walk_domain_restart(d, priority);
	return d;
}

/* ---- splitting ---- */

static void split_run(struct sched_task *t)
{
	struct walk_domain *d = domain_of(t);
	struct walk *w = d->walk;
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
	struct walk_domain *d = domain_of(t), *other;
	struct walk *w = d->walk;
	size_t at = d->index;

	w->tasks--;
	w->splitting = NULL;
	w->plan_n = w->plan.n;
	if (t->ran)
		sched_give(w->jobs->p.sched, t->name, t->bytes);
	if (!t->ran || w->stopping || d->r) {
		if (t->ran && d->r)
			walk_fail(w, &d->err);
		walk_domain_release(d);
		walk_settle(w);
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
	walk_domain_restart(d, SCHED_FIRST);
	walk_domain_start(w, at + 1, SCHED_FIRST);
	walk_settle(w);
}

void walk_domain_split(struct walk_domain *d)
{
	d->walk->splitting = d;
	submit(d, split_run, split_done, SCHED_FIRST, grid_reader_bytes(d->walk->grid));
}

/* ---- storing ---- */

static void store_run(struct sched_task *t)
{
	struct walk_domain *d = domain_of(t);

	if (!d->stored)
		keep(d);
}

static void store_done(struct sched_task *t)
{
	struct walk_domain *d = domain_of(t);
	struct walk *w = d->walk;

	w->tasks--;
	d->state = DOMAIN_READY;
	if (d->stored || w->stopping)
		walk_domain_release(d);
	walk_settle(w);
}

void walk_domain_store(struct walk_domain *d)
{
	if (d->stored) {
		walk_domain_release(d);
		return;
	}
	d->state = DOMAIN_STORING;
	submit(d, store_run, store_done, SCHED_FIRST, 0);
}

/* ---- emitting ---- */

static int take_block(void *ctx, const struct mesh_block *block, struct err *err)
{
	struct walk *w = ctx;

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
	struct walk_domain *d = domain_of(t);
	struct walk *w = d->walk;
	struct mesh_sink sink = {.ctx = w, .block = take_block};

	d->err = ERR_INIT;
	d->r = walk_space_spill(w, &d->err);
	if (!d->r)
		d->r = pipe_emit(w->emitter, &d->domain, &d->region, d->domain.triangle ? &sink : NULL, &d->err);
	if (!d->domain.triangle) {
		w->blocks++;
		d->block = !w->output;
	}
}

static void emit_done(struct sched_task *t)
{
	struct walk_domain *d = domain_of(t);
	struct walk *w = d->walk;
	bool block = d->block;

	w->tasks--;
	w->emitting = NULL;
	w->output_working = false;
	if (w->output_freed)
		walk_output_drop(w);
	if (!t->ran || d->r) {
		if (t->ran)
			walk_fail(w, &d->err);
		walk_domain_release(d);
		walk_settle(w);
		return;
	}
	w->next_emit++;
	w->points += d->domain.counts.points;
	if (block && !w->first_ns)
		w->first_ns = clock_mono_ns();
	if (block && w->output) {
		d->state = DOMAIN_SENDING;
		w->sending = d;
		w->output_busy = true;
		w->sending_ns = clock_mono_ns();
		w->output->calls->send(w->output);
	} else {
		walk_domain_release(d);
	}
	if (w->calls->moved)
		w->calls->moved(w->ctx);
	walk_settle(w);
}

/* Counted only: too little to ask a worker. */
static void count(struct walk_domain *d)
{
	struct walk *w = d->walk;
	struct err err = ERR_INIT;
	int r = pipe_emit(w->emitter, &d->domain, &d->region, NULL, &err);

	if (r)
		walk_fail(w, &err);
	if (d->domain.ntriangle) {
		w->blocks++;
		w->first_ns = w->first_ns ? w->first_ns : clock_mono_ns();
	}
	w->next_emit++;
	w->points += d->domain.counts.points;
	walk_domain_release(d);
	if (w->sums && w->calls->moved)
		w->calls->moved(w->ctx);
}

bool walk_is_there(const struct walk *w, size_t index)
{
	return w->sums && w->plan.leaf[index].there;
}

void walk_domain_emit(struct walk_domain *d)
{
	struct walk *w = d->walk;

	if (!d->domain.ntriangle || w->sums) {
		count(d);
		return;
	}
	if (!d->domain.triangle && w->output && w->blocks >= w->output->from) {
		/* Its reader came, or the plan was split before it: the rest is needed too. */
		walk_domain_restart(d, SCHED_FIRST);
		return;
	}
	d->state = DOMAIN_EMITTING;
	w->emitting = d;
	w->output_working = w->output != NULL;
	submit(d, emit_run, emit_done, SCHED_FIRST, 0);
}
