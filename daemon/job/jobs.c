/*
 * The house: loading, the shares of the memory, the tick, and stopping.
 *
 * The shares of `memory`: what is small has its part whatever else is held (house_bytes); every walk has a share for its
 * table of unfinished vertices and one for index pages; stages take up to half; domains take what is left
 * when their plan is made. A plan counts on at most what is left beside the stages held then, of which one
 * domain is less than half, and a stage leaves room for two domains of the largest plan that runs: so the
 * first in the queue can always run.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "geoids.h"
#include "io.h"
#include "job_fetch.h"
#include "job_priv.h"
#include "log.h"

#define STARVED_SECONDS 0.3

enum { JOBS_KEPT = 2048 };

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

/* What is not for domains and stages: stacks, the catalogue, messages, and what grows with jobs, files and sources. */
static uint64_t house_bytes(const struct jobs *j)
{
	const unsigned names = 1u << LEDGER_THREAD | 1u << LEDGER_CATALOGUE | 1u << LEDGER_MESSAGE | 1u << LEDGER_JOBS |
			       1u << LEDGER_FILES | 1u << LEDGER_MANIFEST | 1u << LEDGER_PLAN;

	return ledger_claimed(j->p.ledger, names) + 2 * input_bytes();
}

static void share_out(struct jobs *j)
{
	uint64_t total = ledger_total(j->p.ledger);

	j->emitter_share = emitter_share(total);
	j->index_share = index_share(total);
	j->stage_share = total / 2;
	j->walks_max = total < (UINT64_C(64) << 20) ? 4 : 8;
	j->reserve = house_bytes(j);
}

/* ---- walks ---- */

static void each_walk(struct jobs *j, void (*fn)(struct walk *, void *), void *ctx)
{
	struct job_asked_plan *p;
	struct job_fetch *f;
	struct job *job;

	for (job = j->jobs; job; job = job->next) {
		if (job->walk && !job->walk_ended)
			fn(job->walk, ctx);
		for (f = job->fetches; f; f = f->next)
			if (f->walk && !f->walk_ended)
				fn(f->walk, ctx);
	}
	for (p = j->plans; p; p = p->next)
		if (p->walk && !p->walk_ended)
			fn(p->walk, ctx);
}

struct tally {
	unsigned walks, running, opening;
	uint64_t largest;
	const struct dataset *dataset;
};

static void tally_walk(struct walk *w, void *ctx)
{
	struct tally *t = ctx;

	t->walks++;
	t->running += !walk_stalled(w);
	if (walk_domain_bytes(w) > t->largest)
		t->largest = walk_domain_bytes(w);
	t->opening += walk_opens(w, t->dataset);
}

static struct tally tally(struct jobs *j, const struct dataset *d)
{
	struct tally t = {.dataset = d};

	each_walk(j, tally_walk, &t);
	return t;
}

uint64_t jobs_staged(const struct jobs *j)
{
	struct push *p;
	uint64_t bytes = 0;

	for (p = j->pushes; p; p = push_next(p))
		bytes += push_stage_bytes(p);
	return bytes;
}

/* Beside its domains: the table, index pages and what the index keeps of its own, the buffer of a slow
 * reader. */
static uint64_t walk_share(const struct jobs *j)
{
	return j->emitter_share + 2 * j->index_share + JOB_OUTPUT_BUFFER;
}

uint64_t jobs_domain_memory(struct jobs *j)
{
	unsigned walks = tally(j, NULL).walks;
	uint64_t used = house_bytes(j) + jobs_staged(j) + (walks + 1) * walk_share(j);
	uint64_t total = ledger_total(j->p.ledger);

	return total > used ? total - used : 0;
}

uint64_t jobs_memory_alone(const struct jobs *j)
{
	uint64_t used = j->reserve + 2 * walk_share(j), total = ledger_total(j->p.ledger);

	return total > used ? total - used : 0;
}

uint64_t jobs_memory_for(struct jobs *j, const struct grid *grid, uint64_t positions)
{
	uint64_t total = ledger_total(j->p.ledger);
	const uint64_t most = UINT64_C(1) << 40, step = UINT64_C(1) << 20;
	struct pipe_budget b = {0};

	for (; total <= most; total += total < 256 * step ? step : 16 * step) {
		struct err err = ERR_INIT;
		uint64_t used = j->reserve + 2 * (emitter_share(total) + 2 * index_share(total));

		if (total <= used || pipe_budget(total - used, j->p.threads, grid, &b, &err))
			continue;
		if (b.cap >= positions)
			return total;
		if (b.load == pipe_rung[PIPE_RUNGS - 1] && b.threads == j->p.threads)
			break;
	}
	return 0;
}

uint64_t jobs_domain_largest(struct jobs *j)
{
	return tally(j, NULL).largest;
}

bool jobs_opening(struct jobs *j, const struct dataset *d)
{
	return tally(j, d).opening > 0;
}

bool jobs_walk_room(struct jobs *j)
{
	struct tally t;

	/* Found out once for all that wait: there may be thousands. */
	if (j->full)
		return false;
	t = tally(j, NULL);
	/* One domain of the largest plan must fit beside the shares of all walks and the stages, always. */
	j->full = t.running >= j->walks_max || jobs_domain_memory(j) < t.largest + walk_share(j);
	return !j->full;
}

bool jobs_fetch_room(struct jobs *j)
{
	struct tally t = tally(j, NULL);
	/* What a push and a job need must not be held by readers who do not read. */
	uint64_t others = GRID_STAGE_MIN + pipe_ingest_bytes() + t.largest + walk_share(j);

	if (!jobs_walk_room(j))
		return false;
	return t.walks == t.running || jobs_domain_memory(j) >= t.largest + walk_share(j) + others;
}

struct same {
	const struct walk *walk;
	bool found;
};

static void look_same(struct walk *w, void *ctx)
{
	struct same *s = ctx;

	s->found |= walk_selects_same(w, s->walk);
}

bool jobs_selecting(struct jobs *j, const struct walk *w)
{
	struct same s = {.walk = w};

	each_walk(j, look_same, &s);
	return s.found;
}

static void relieve(struct walk *w, void *ctx)
{
	walk_relieve(w, *(const bool *)ctx);
}

/* The first in the queue lacks memory: walks that do not get on give theirs at once, the others when it has
 * waited for a while. */
static void look_starved(struct jobs *j)
{
	bool urgent;

	if (!sched_starved(j->p.sched)) {
		j->starved_ns = 0;
		return;
	}
	if (!j->starved_ns)
		j->starved_ns = clock_mono_ns();
	urgent = clock_since(j->starved_ns) > STARVED_SECONDS;
	each_walk(j, relieve, &urgent);
}

/* ---- starting ---- */

static int folder(int dirfd, const char *name, int *ret, struct err *err)
{
	int r = io_make_dir(dirfd, name, 0700, err);

	return r ? r : io_open(dirfd, name, O_RDONLY | O_DIRECTORY, 0, ret, err);
}

static int load_dataset(void *ctx, const struct catalogue_dataset *row, struct err *err)
{
	return dataset_load(ctx, row, err);
}

static int load_job(void *ctx, const struct catalogue_job *row, struct err *err)
{
	return job_load(ctx, row, err);
}

/* A push that a crash ended: what was durable of it waits to be taken up, the rest is removed (sweep_all). */
static int load_push(void *ctx, const struct catalogue_push *row, struct err *err)
{
	struct jobs *j = ctx;
	struct dataset *d;
	bool stays = false;
	int r = 0;

	for (d = j->datasets; d && d->id != row->dataset; d = d->next)
		;
	if (d) {
		d->sweep = true;
		r = pending_load(d, row, &stays, err);
	}
	if (row->dataset > j->last_dataset)
		j->last_dataset = row->dataset;
	if (!r && !stays)
		r = catalogue_drop_push(j->p.catalogue, row->id, NULL, NULL, err);
	return r;
}

int jobs_selected_folder(struct jobs *j, int *ret_fd, struct err *err)
{
	return folder(j->p.cachefd, "selected", ret_fd, err);
}

/* Selections that a crash cut short. */
static int sweep_selected(struct jobs *j, struct err *err)
{
	int fd, r = jobs_selected_folder(j, &fd, err);

	if (r)
		return r;
	r = folder_sweep(fd, WALK_SELECT_TEMP, err);
	io_close(fd);
	return r;
}

/* Folders that a push left something in. A dataset without a generation and without a pending push never
 * was, unless it was created so. */
static int sweep_all(struct jobs *j, struct err *err)
{
	struct dataset **at = &j->datasets, *d;
	char name[32];
	int r = 0;

	while (!r && (d = *at)) {
		bool goes = !d->generation && !d->pending && !dataset_created(d);

		if (d->sweep || goes)
			r = dataset_sweep(d, err);
		if (r || !goes) {
			at = &d->next;
			continue;
		}
		snprintf(name, sizeof name, "%llu", (unsigned long long)d->id);
		if (io->unlinkat(j->datafd, name, AT_REMOVEDIR) != 0)
			r = err_sys(err, errno, "cannot remove the folder of a dataset");
		else
			r = catalogue_drop_dataset(j->p.catalogue, d->id, NULL, NULL, err);
		*at = d->next;
		dataset_free(d);
	}
	return r;
}

static int open_folders(struct jobs *j, struct err *err)
{
	int r = folder(j->p.statefd, "datasets", &j->datafd, err);

	if (!r)
		r = folder(j->p.cachefd, "one-step", &j->onestepfd, err);
	if (!r)
		r = folder(j->p.cachefd, "domains", &j->domainsfd, err);
	if (!r)
		r = folder(j->p.cachefd, "tmp", &j->tempfd, err);
	if (!r)
		r = folder(j->p.statefd, "plans", &j->plansfd, err);
	if (!r)
		r = geoids_open(j->p.statefd, &j->geoidsfd, err);
	/* Nothing in these outlives a daemon. */
	if (!r)
		r = folder_empty(j->onestepfd, err);
	if (!r)
		r = folder_empty(j->tempfd, err);
	if (!r)
		r = sweep_selected(j, err);
	return r;
}

int jobs_new(const struct jobs_params *p, struct jobs **ret, struct err *err)
{
	struct catalogue_reader reader = {.dataset = load_dataset, .job = load_job, .push = load_push};
	struct jobs *j = calloc(1, sizeof *j);
	uint64_t last[3];
	int r;

	if (!j)
		return err_set(err, ERR_NOMEM, "no memory for jobs");
	j->p = *p;
	j->datafd = j->onestepfd = j->domainsfd = j->tempfd = j->plansfd = j->geoidsfd = -1;
	share_out(j);
	reader.ctx = j;
	r = open_folders(j, err);
	if (!r)
		r = catalogue_load(p->catalogue, &reader, last, err);
	if (!r)
		r = job_plan_sweep(j, err);
	if (!r)
		r = sweep_all(j, err);
	if (!r)
		r = catalogue_start(p->catalogue, err);
	if (r) {
		jobs_free(j);
		return r;
	}
	if (last[0] > j->last_dataset)
		j->last_dataset = last[0];
	j->last_job = last[1];
	j->last_push = last[2];
	*ret = j;
	return 0;
}

struct jobs *jobs_free(struct jobs *j)
{
	struct dataset *d;
	struct job *job;

	if (!j)
		return NULL;
	while ((job = j->jobs)) {
		j->jobs = job->next;
		/* The datasets go next, whoever uses them. */
		job->dataset = NULL;
		job_free(job);
	}
	while ((d = j->datasets)) {
		j->datasets = d->next;
		dataset_free(d);
	}
	io_close(j->datafd);
	io_close(j->onestepfd);
	io_close(j->domainsfd);
	io_close(j->tempfd);
	io_close(j->plansfd);
	io_close(j->geoidsfd);
	free(j);
	return NULL;
}

/* ---- running ---- */

bool jobs_forget_oldest(struct jobs *j)
{
	struct job **at, *job;
	struct err err = ERR_INIT;

	for (at = &j->jobs; (job = *at); at = &job->next)
		if (job_state_final(job->state) && !job->fetches && !job->walk && !job->waiting_row && !job->bound &&
		    (job->removed || !job_remove(job, &err)))
			break;
	if (!job)
		return false;
	*at = job->next;
	job_plan_drop(job);
	job_free(job);
	return true;
}

/* Removed jobs go when nothing of theirs is left; of the finished ones the newest are kept. */
static void forget_jobs(struct jobs *j)
{
	struct job **at = &j->jobs, *job;
	unsigned n = 0;

	for (job = j->jobs; job; job = job->next)
		n++;
	while ((job = *at)) {
		struct err err = ERR_INIT;

		if (n > JOBS_KEPT && job_state_final(job->state) && !job->fetches && !job->removed &&
		    !job->bound && !job_remove(job, &err))
			n--;
		if (job->removed && !job->walk && !job->fetches && !job->waiting_row &&
		    (job_state_final(job->state) || !job->dataset || job->state == JOB_queued)) {
			*at = job->next;
			job_plan_drop(job);
			job_free(job);
		} else {
			at = &job->next;
		}
	}
}

void jobs_settle(struct jobs *j)
{
	struct push *p, *next;
	struct job *job;

	j->full = false;
	for (job = j->jobs; job; job = job->next)
		job_settle(job);
	job_plans_settle(j);
	for (p = j->pushes; p; p = next) {
		next = push_next(p);
		push_retry(p);
	}
	forget_jobs(j);
	look_starved(j);
}

void jobs_tick(struct jobs *j)
{
	struct push *p, *next;
	struct job *job;

	/* Index pages are given back without a word. */
	if (sched_starved(j->p.sched))
		sched_give(j->p.sched, LEDGER_INDEX, 0);
	j->full = false;
	for (job = j->jobs; job; job = job->next)
		job_tick(job);
	for (p = j->pushes; p; p = next) {
		next = push_next(p);
		push_tick(p);
	}
	jobs_settle(j);
}

static bool anything(const struct jobs *j, bool queued)
{
	struct job *job;

	if (j->pushes || j->plans || j->background || sched_busy(j->p.sched) ||
	    catalogue_busy(j->p.catalogue))
		return true;
	for (job = j->jobs; job; job = job->next)
		if (job->walk || job->fetches || (queued && !job_state_final(job->state)))
			return true;
	return false;
}

bool jobs_active(const struct jobs *j)
{
	return anything(j, true);
}

void jobs_park(struct jobs *j)
{
	struct job *job;

	j->parking = true;
	for (job = j->jobs; job; job = job->next) {
		if (job->bound)
			job_cancel(job);
		job_fetch_park(job);
	}
	jobs_settle(j);
}

bool jobs_parked(const struct jobs *j)
{
	return j->parking && !anything(j, false);
}

void jobs_abandon(struct jobs *j)
{
	struct err err = ERR_INIT;
	struct push *p;

	for (p = j->pushes; p; p = push_next(p))
		push_remove_files(p);
	if (folder_empty(j->onestepfd, &err) || folder_empty(j->tempfd, &err))
		log_err(LOG_LEVEL_WARNING, "temporary files stay behind until the next start", &err);
}

void jobs_count(const struct jobs *j, uint32_t *ret_running, uint32_t *ret_waiting)
{
	uint32_t running = 0, waiting = 0;
	struct job *job;

	for (job = j->jobs; job; job = job->next) {
		if (job->walk)
			running++;
		else if (!job_state_final(job->state))
			waiting++;
	}
	*ret_running = running;
	*ret_waiting = waiting;
}

/* A line of the process's status, in bytes; 0: there is none. */
static uint64_t status_bytes(const char *key)
{
	size_t n = strlen(key);
	char line[256];
	unsigned long long kib = 0;
	FILE *f = fopen("/proc/self/status", "re");

	if (!f)
		return 0;
	while (fgets(line, sizeof line, f))
		if (!strncmp(line, key, n) && sscanf(line + n, ": %llu", &kib) == 1)
			break;
	fclose(f);
	return (uint64_t)kib << 10;
}

uint64_t jobs_peak_rss(void)
{
	return status_bytes("VmHWM");
}

uint64_t jobs_rss(void)
{
	return status_bytes("VmRSS");
}
