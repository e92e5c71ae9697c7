/*
 * The service: loading, the tick, and stopping. Who may have what of the memory, and when, is in admit.c.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backup.h"
#include "clock.h"
#include "dataset_rewrite.h"
#include "geoids.h"
#include "io.h"
#include "job_fetch.h"
#include "job_priv.h"
#include "log.h"
#include "history.h"
#include "recency.h"
#include "store.h"

/* Of jobs that are over: so many, for so long. */
enum { JOBS_KEPT = 20000, JOBS_DAYS = 30, AGED_MAX = 64 };
/* Of jobs that are over so many stay as they are. */
enum { JOBS_WARM = 64 };
#define COUNT_SECONDS 0.5
#define DAY_US INT64_C(86400000000)
#define AGE_US INT64_C(3600000000) /* how often the oldest are looked for */

/* ---- starting ---- */

static int load_dataset(void *ctx, const struct catalogue_dataset *row, struct err *err)
{
	return dataset_load(ctx, row, err);
}

static int load_job(void *ctx, const struct catalogue_job *row, struct err *err)
{
	return job_load(ctx, row, err);
}

struct loaded {
	uint64_t id;
	struct dataset *dataset;
};

static int by_id(const void *a, const void *b)
{
	uint64_t x = ((const struct loaded *)a)->id, y = ((const struct loaded *)b)->id;

	return x < y ? -1 : x > y;
}

struct dataset *dataset_loaded(struct jobs *j, uint64_t id)
{
	const struct loaded *hit;
	struct dataset *d;
	size_t n = 0;

	for (d = j->loaded ? NULL : j->datasets; d; d = d->next)
		n++;
	if (n)
		j->loaded = calloc(n, sizeof *j->loaded);
	for (d = n && j->loaded ? j->datasets : NULL; d; d = d->next)
		j->loaded[j->nloaded++] = (struct loaded){d->id, d};
	if (j->loaded) {
		/* Where none was removed they stand by their numbers. */
		n = (size_t)(id - j->loaded[0].id);
		if (n < j->nloaded && j->loaded[n].id == id)
			return j->loaded[n].dataset;
		hit = bsearch(&(struct loaded){.id = id}, j->loaded, j->nloaded, sizeof *j->loaded, by_id);
		return hit ? hit->dataset : NULL;
	}
	for (d = j->datasets; d && d->id != id; d = d->next)
		;
	return d;
}

/* A push that a crash ended: what was durable of it waits to be taken up, the rest is removed (sweep_all). */
static int load_push(void *ctx, const struct catalogue_push *row, struct err *err)
{
	struct jobs *j = ctx;
	struct dataset *d = dataset_loaded(j, row->dataset);
	bool stays = false;
	int r = 0;

	if (d) {
		struct err why = ERR_INIT;

		d->sweep = true;
		r = rewrite_row(row) ? 0 : pending_load(d, row, &stays, &why);
		if (r == -ERR_NOMEM || r == -ERR_BUSY || r == -ERR_LIMIT) {
			*err = why;
			return r;
		}
		if (r) {
			log_event_err(LOG_EVENT_UNREADABLE,
				      &(struct log_about){.push = row->id, .dataset = d->name, ABOUT_USER(row->uid)},
				      "what an interrupted push left cannot be read: it stays as it is", &why);
			d->unswept = stays = true;
			r = 0;
		}
		d->swept_once |= !stays;
	}
	if (row->dataset > j->last_dataset)
		j->last_dataset = row->dataset;
	if (!r && !stays)
		r = catalogue_drop_push(j->core->p.catalogue, row->id, NULL, NULL, err);
	return r;
}

/* Selections that a crash cut short. */
static int sweep_selected(struct jobs *j, struct err *err)
{
	int fd, r = core_selected_folder(j->core, &fd, err);

	if (r)
		return r;
	r = io_folder_sweep(fd, SPACE_SELECTION_TEMP, err);
	io_close(fd);
	return r;
}

/* A dataset that is damaged keeps nobody from the others. */
static int sweep_one(struct dataset *d, bool goes, struct err *err)
{
	struct err why = ERR_INIT;
	int r = dataset_sweep(d, !d->swept_once && !goes, &why);

	if (!r || r == -ERR_NOMEM || r == -ERR_BUSY || r == -ERR_LIMIT) {
		*err = why;
		return r;
	}
	log_event_err(LOG_EVENT_UNREADABLE, ABOUT_DATASET(d),
		      "what interrupted pushes left in a dataset stays: it cannot be told from what belongs to it", &why);
	return goes ? (*err = why, r) : 0;
}

/* Folders that a push left something in. A dataset without a generation and without a pending push never
 * was, unless it was created so. */
static int sweep_all(struct jobs *j, struct err *err)
{
	struct dataset **at = &j->datasets, *d;
	bool gone = false;
	char name[32];
	int r = 0;

	while (!r && (d = *at)) {
		bool goes = !d->generation && !d->pending && !dataset_created(d);

		goes = goes && !d->unswept;
		if ((d->sweep || goes) && !d->unswept)
			r = sweep_one(d, goes, err);
		if (r || !goes) {
			at = &d->next;
			continue;
		}
		snprintf(name, sizeof name, "%llu", (unsigned long long)d->id);
		if (io->unlinkat(j->core->datafd, name, AT_REMOVEDIR) != 0)
			r = err_sys(err, errno, "cannot remove the folder of a dataset");
		else
			r = catalogue_drop_dataset(j->core->p.catalogue, d->id, NULL, NULL, err);
		gone = true;
		*at = d->next;
		dataset_free(d);
	}
	/* Rows go when the catalogue starts, by which time folders cannot come back. */
	return !r && gone ? io_sync(j->core->datafd, "the folder of datasets", err) : r;
}

static int open_folders(struct jobs *j, struct err *err)
{
	int r = geoids_open(j->core->p.statefd, &j->geoidsfd, err);

	if (!r)
		r = geoids_count(j, err);
	/* What is in a folder is as safe as the folder's name; a start that was cut short may have made it. */
	if (!r)
		r = io_sync(j->core->p.statefd, "the state folder", err);
	/* Of versions that nobody reads any more. */
	if (!r)
		r = store_sweep(j->core->domainsfd, err);
	if (!r)
		r = backup_sweep(j->core->p.statefd, err);
	if (!r)
		r = sweep_selected(j, err);
	return r;
}

struct orphans {
	struct jobs *jobs;
	uint64_t last;
};

/* Of a dataset that was removed when its folder could not be. Numbers that this catalogue has not given are not its own:
 * whoever lost the catalogue has not lost the points. */
static int sweep_orphan(void *ctx, const struct dirent *e, struct err *err)
{
	const struct orphans *o = ctx;
	struct err why = ERR_INIT;
	uint64_t id;
	char *end;

	id = strtoull(e->d_name, &end, 10);
	if (*end || !id || id > o->last)
		return 0;
	if (dataset_loaded(o->jobs, id))
		return 0;
	log_event(LOG_EVENT_DATASET_GONE, NULL, "the folder of dataset number %llu, which was removed, goes",
		  (unsigned long long)id);
	if (io_folder_remove(o->jobs->core->datafd, e->d_name, &why))
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "a dataset's folder stays behind", &why);
	return 0;
}

/* ---- what the core asks ---- */

static uint64_t history_held(void *ctx)
{
	return history_bytes(ctx);
}

static bool forget_finished(void *ctx, uint32_t uid, uint64_t more)
{
	return jobs_forget_one(ctx, HISTORY_BYTES, uid, more);
}

static void disk_used(void *ctx, void (*add)(void *to, uint32_t uid, uint64_t bytes), void *to)
{
	for (const struct dataset *d = ((struct jobs *)ctx)->datasets; d; d = d->next) {
		add(to, d->uid, d->bytes);
		for (const struct pending *q = d->pending; q; q = q->next)
			add(to, q->uid, disk_points_bytes(q->points));
	}
}

/* Fractions of the memory: 1/n. */
enum { RECENCY_PART = 1024, SUMMARIES_PART = 256 };

int jobs_new(const struct jobs_params *p, struct jobs **ret, struct err *err)
{
	struct catalogue_reader reader = {.dataset = load_dataset, .job = load_job, .push = load_push};
	struct jobs *j = calloc(1, sizeof *j);
	uint64_t last[3];
	int r;

	if (!j)
		return err_set(err, ERR_NOMEM, "no memory for jobs");
	j->changed = p->changed;
	j->changed_ctx = p->ctx;
	j->geoidsfd = -1;
	r = core_new(&p->core, &j->core, err);
	if (r) {
		jobs_free(j);
		return r;
	}
	j->core->history = (struct core_history){j, history_held, forget_finished};
	j->core->used = (struct core_used){j, disk_used};
	r = admission_new(j->core, &j->admission, err);
	if (r) {
		jobs_free(j);
		return r;
	}
	reader.ctx = j;
	j->recency = recency_new(p->core.ledger, sizeof(struct store_id), RECENCY_PART);
	j->summaries = recency_new(p->core.ledger, sizeof(struct pipe_summary), SUMMARIES_PART);
	r = open_folders(j, err);
	j->core->loading = true;
	if (!r)
		r = catalogue_load(p->core.catalogue, &reader, last, err);
	if (!r)
		r = io_list(j->core->datafd, ".", sweep_orphan, &(struct orphans){j, last[0]}, err);
	free(j->loaded);
	j->loaded = NULL;
	j->last_loaded = NULL;
	j->core->loading = false;
	free(j->spare);
	j->spare = NULL;
	if (!r)
		r = sweep_all(j, err);
	if (!r)
		r = catalogue_start(p->core.catalogue, err);
	if (r) {
		jobs_free(j);
		return r;
	}
	if (last[0] > j->last_dataset)
		j->last_dataset = last[0];
	j->last_job = last[1];
	j->core->last_push = last[2];
	verified_load(j);
	deferred_begin(j->core);
	core_clear(j->core);
	job_plan_sweep(j);
	disk_count(j); /* the first who asks is held against it */
	*ret = j;
	return 0;
}

struct jobs *jobs_free(struct jobs *j)
{
	struct dataset *d;
	struct job *job;

	if (!j)
		return NULL;
	if (j->core)
		deferred_drop(j->core);
	dataset_old_forget(j);
	while ((job = j->jobs)) {
		/* The datasets go next, whoever uses them. */
		job->dataset = NULL;
		job_free(job);
	}
	history_free(j);
	deletions_free(j);
	while ((d = j->datasets)) {
		j->datasets = d->next;
		dataset_free(d);
	}
	io_close(j->geoidsfd);
	recency_free(j->recency);
	recency_free(j->summaries);
	admission_free(j->admission);
	core_free(j->core);
	free(j);
	return NULL;
}

/* ---- running ---- */

/* Removes it for good. Not of those at work. */
static bool forget(struct jobs *j, struct job *job)
{
	struct err err = ERR_INIT;

	return job && job->guest && !job_remove(job, &err);
}

static bool idle(const struct job *job)
{
	return !job->run && !job->fetches && !job->waiting_row;
}

static bool over(const struct job *job)
{
	return job_state_final(job->state) && idle(job) && !job->removed && !job->bound;
}

void jobs_put_away(struct jobs *j)
{
	struct job *job, *next;

	for (job = j->jobs; job; job = next) {
		next = job->next;
		if (over(job))
			history_keep(job);
	}
}

bool jobs_forget_one(struct jobs *j, enum history_kind kind, uint32_t uid, uint64_t more)
{
	struct err err = ERR_INIT;
	struct job *job;

	for (job = j->jobs; job && !(job->removed && idle(job) && job_state_final(job->state)); job = job->next)
		;
	/* Whose they are counts, not where they lie: those that are warm as well. */
	if (!job)
		jobs_put_away(j);
	if (!job && forget(j, history_of_most(j, kind, uid, more)))
		return true;
	for (job = job ? job : j->jobs; job; job = job->next)
		if (job_state_final(job->state) && idle(job) && !job->bound && (job->removed || !job_remove(job, &err)))
			break;
	if (!job)
		return false;
	job_plan_drop(job);
	job_free(job);
	return true;
}

/* Jobs that are over are listed for so long, and so many of them. */
static void forget_old(struct jobs *j)
{
	int64_t now = clock_real_us();
	unsigned n = 0;

	while (history_count(j) > JOBS_KEPT && forget(j, history_of_most(j, HISTORY_JOBS, 0, 0)))
		;
	if (now - j->aged_us < AGE_US && now >= j->aged_us)
		return;
	/* Some at a time, and no more until these are written: each is a change of the catalogue, which has room for so many,
	 * and whoever comes then would wait for the disk, with all others behind him. */
	if (catalogue_busy(j->core->p.catalogue))
		return;
	while (n < AGED_MAX && forget(j, history_oldest(j, now - JOBS_DAYS * DAY_US)))
		n++;
	if (n < AGED_MAX)
		j->aged_us = now;
}

/* Removed jobs go when nothing of theirs is left; the oldest that are over leave the ones at work. */
static void put_away(struct jobs *j)
{
	struct job *job, *next;
	unsigned warm = 0;

	for (job = j->jobs; job; job = next) {
		next = job->next;
		if (job->removed && idle(job) && (job_state_final(job->state) || !job->dataset || job->state == JOB_queued)) {
			job_plan_drop(job);
			job_free(job);
		} else if (over(job)) {
			warm++;
		}
	}
	for (job = j->jobs; warm > JOBS_WARM && job; job = next) {
		next = job->next;
		if (over(job) && history_keep(job))
			warm--;
	}
	forget_old(j);
	history_round(j);
}

static void settle(struct jobs *j)
{
	struct push *p, *next;
	struct job *job;

	for (job = j->jobs; job; job = job->next)
		job_settle(job);
	job_plans_settle(j);
	admission_stages(j->admission);
	dataset_prune_settle(j);
	dataset_merge_settle(j);
	dataset_changes_settle(j);
	dataset_verbs_settle(j);
	dataset_old_settle(j);
	for (p = j->pushes; p; p = next) {
		next = push_next(p);
		push_retry(p);
	}
	slots_settle(j->admission);
	put_away(j);
	deletions_settle(j);
	admission_relieve(j->admission);
}

void jobs_settle(struct jobs *j)
{
	THREAD_LOOP_ONLY();
	settle(j);
	if (charge_make_room(j->core))
		settle(j);
}

/* Domains that were used since then are those of jobs that run. */
static void count_running(struct jobs *j)
{
	double longest = -1;
	const struct job *job;

	for (job = j->jobs; job; job = job->next)
		if (job->run && job->begun_ns && clock_since(job->begun_ns) > longest)
			longest = clock_since(job->begun_ns);
	space_running_since(j->core->space, longest < 0 ? INT64_MAX : clock_real_us() - (int64_t)(longest * 1e6));
}

/* Somebody has begun something. */
static bool jobs_begun(const struct jobs *j)
{
	uint32_t running, waiting;

	jobs_count(j, &running, &waiting);
	return running || waiting || j->pushes || j->plans;
}

void jobs_tick(struct jobs *j)
{
	struct push *p, *next;
	struct job *job;

	THREAD_LOOP_ONLY();
	/* Index pages are given back without a word. */
	if (sched_starved(j->core->p.sched))
		sched_give(j->core->p.sched, LEDGER_INDEX, 0);
	for (job = j->jobs; job; job = job->next)
		job_tick(job);
	for (p = j->pushes; p; p = next) {
		next = push_next(p);
		push_tick(p);
	}
	cache_verify_tick(j);
	if (clock_since(j->counted_ns) >= COUNT_SECONDS) {
		j->counted_ns = clock_mono_ns();
		disk_count(j);
		count_running(j);
	}
	if (deferred_over(j->core, jobs_begun(j)))
		disk_look(j->core, jobs_active(j));
	else
		disk_mend(j->core);
	datasets_tick(j);
	dataset_prune_tick(j);
	if (j->merge)
		dataset_rewrite_tick(j->merge);
	jobs_settle(j);
}

/* More than so many tasks in the background, or anything else. */
static bool anything(const struct jobs *j, unsigned background, bool queued)
{
	struct job *job;

	if (j->pushes || j->plans || j->core->background > background || sched_busy(j->core->p.sched) > background ||
	    catalogue_busy(j->core->p.catalogue))
		return true;
	for (job = j->jobs; job; job = job->next)
		if (job->run || job->fetches || (queued && !job_state_final(job->state)))
			return true;
	return false;
}

bool jobs_resting(const struct jobs *j)
{
	return deferred_waits(j->core);
}

bool jobs_active(const struct jobs *j)
{
	/* That the file systems are asked is no work: a daemon that ends when it is idle would never be. */
	return anything(j, j->core->disk.asking, true);
}

void jobs_park(struct jobs *j)
{
	struct job *job;

	THREAD_LOOP_ONLY();
	j->core->parking = true;
	deferred_end(j->core);
	dataset_prunes_park(j);
	if (j->merge)
		dataset_rewrite_cancel(j->merge);
	job_plans_park(j);
	for (job = j->jobs; job; job = job->next) {
		if (job->bound)
			job_cancel(job);
		job_fetch_park(job);
	}
	jobs_settle(j);
}

bool jobs_parked(const struct jobs *j)
{
	return j->core->parking && !anything(j, 0, false);
}

void jobs_abandon(struct jobs *j)
{
	struct err err = ERR_INIT;
	struct push *p;

	for (p = j->pushes; p; p = push_next(p))
		push_remove_files(p);
	if (io_folder_empty(j->core->onestepfd, &err) || io_folder_empty(j->core->tempfd, &err))
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "temporary files stay behind until the next start", &err);
}

void jobs_count(const struct jobs *j, uint32_t *ret_running, uint32_t *ret_waiting)
{
	uint32_t running = 0, waiting = 0;
	struct job *job;

	for (job = j->jobs; job; job = job->next) {
		if (job->run)
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
