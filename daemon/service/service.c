/* Makes the rooms, calls them in the loop, and stops them. */
#include "service.h"

#include <stdlib.h>

#include "clock.h"
#include "health.h"
#include "io.h"
#include "store.h"

#define COUNT_SECONDS 0.5

/* ---- starting ---- */

static int load_dataset(void *ctx, const struct catalogue_dataset *row, struct err *err)
{
	return datasets_load(((struct service *)ctx)->datasets, row, err);
}

static int load_job(void *ctx, const struct catalogue_job *row, struct err *err)
{
	return job_load(((struct service *)ctx)->jobs, row, err);
}

static int load_push(void *ctx, const struct catalogue_push *row, struct err *err)
{
	return datasets_load_push(((struct service *)ctx)->datasets, row, err);
}

/* Removes selections that a crash left unfinished. */
static int sweep_selections(const struct core *core, struct err *err)
{
	int fd, r = core_selected_folder(core, &fd, err);

	if (r)
		return r;
	r = io_folder_sweep(fd, SPACE_SELECTION_TEMP, err);
	io_close(fd);
	return r;
}

static int make_rooms(struct service *s, const struct service_params *p, struct err *err)
{
	struct jobs_params jobs = {.changed = p->changed, .ctx = p->ctx};
	int r = core_new(&p->core, &s->core, err);

	if (!r)
		r = admission_new(s->core, &s->admission, err);
	if (!r)
		r = datasets_new(s->core, s->admission, &s->datasets, err);
	if (!r)
		r = runs_new(s->core, s->admission, &s->runs, err);
	if (!r) {
		jobs.core = s->core;
		jobs.admission = s->admission;
		jobs.datasets = s->datasets;
		jobs.runs = s->runs;
		r = jobs_new(&jobs, &s->jobs, err);
	}
	if (!r)
		r = geoids_new(s->core, &s->geoids, err);
	if (!r)
		r = pushes_new(s->core, s->admission, s->datasets, s->geoids, &s->pushes, err);
	/* An earlier start may have made the folder and ended before it was synced. */
	if (!r)
		r = io_sync(s->core->p.statefd, "the state folder", err);
	/* Removes stored domains of versions that are not read any more. */
	if (!r)
		r = store_sweep(s->core->domainsfd, err);
	if (!r)
		r = copies_new(s->core, s->datasets, &s->copies, err);
	if (!r)
		r = sweep_selections(s->core, err);
	if (!r)
		r = maintenance_new(s->core, s->datasets, s->jobs, &s->maintenance, err);
	return r ? r : health_new(&s->health, err);
}

static int load_catalogue(struct service *s, uint64_t last[3], struct err *err)
{
	const struct catalogue_reader reader = {.dataset = load_dataset, .job = load_job, .push = load_push, .ctx = s};
	int r;

	s->core->loading = true;
	r = catalogue_load(s->core->p.catalogue, &reader, last, err);
	if (!r)
		r = datasets_loaded(s->datasets, last[0], err);
	s->core->loading = false;
	return r ? r : catalogue_start(s->core->p.catalogue, err);
}

int service_new(const struct service_params *p, struct service **ret, struct err *err)
{
	struct service *s = calloc(1, sizeof *s);
	uint64_t last[3];
	int r;

	if (!s)
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	r = make_rooms(s, p, err);
	if (!r)
		r = load_catalogue(s, last, err);
	if (r) {
		service_free(s);
		return r;
	}
	s->core->last_push = last[2];
	deferred_begin(s->core);
	core_sweep_cache(s->core);
	jobs_loaded(s->jobs, last[1]);
	datasets_count(s->datasets); /* limits of users hold from the first request on */
	*ret = s;
	return 0;
}

struct service *service_free(struct service *s)
{
	if (!s)
		return NULL;
	if (s->core)
		deferred_cancel_all(s->core);
	health_free(s->health);
	maintenance_free(s->maintenance);
	copies_free(s->copies);
	pushes_free(s->pushes);
	geoids_free(s->geoids);
	jobs_free(s->jobs);
	runs_free(s->runs);
	datasets_free(s->datasets);
	admission_free(s->admission);
	core_free(s->core);
	free(s);
	return NULL;
}

/* ---- running ---- */

static void settle_rooms(struct service *s)
{
	jobs_settle(s->jobs);
	admission_grant_stages(s->admission);
	datasets_settle(s->datasets);
	pushes_settle(s->pushes);
	slots_grant(s->admission);
	jobs_tidy(s->jobs);
	admission_relieve(s->admission);
}

void service_settle(struct service *s)
{
	THREAD_LOOP_ONLY();
	settle_rooms(s);
	if (charge_reclaim(s->core))
		settle_rooms(s);
}

/* Domains that were used since the longest running job began count as in use. */
static void update_running_since(const struct service *s)
{
	double longest = jobs_longest(s->jobs);

	space_running_since(s->core->space, longest < 0 ? INT64_MAX : clock_real_us() - (int64_t)(longest * 1e6));
}

/* A client has begun something. */
static bool has_client_work(const struct service *s)
{
	uint32_t running, waiting;

	jobs_count(s->jobs, &running, &waiting);
	return running || waiting || pushes_open(s->pushes) || jobs_busy(s->jobs, false);
}

void service_tick(struct service *s)
{
	THREAD_LOOP_ONLY();
	/* Readers release index pages without waking the tasks that wait for memory. */
	if (sched_starved(s->core->p.sched))
		sched_give(s->core->p.sched, LEDGER_INDEX, 0);
	jobs_tick(s->jobs);
	pushes_tick(s->pushes);
	sched_watch(s->core->p.sched, SCHED_HOLD_SECONDS);
	maintenance_tick(s->maintenance);
	if (clock_since(s->counted_ns) >= COUNT_SECONDS) {
		s->counted_ns = clock_mono_ns();
		datasets_count(s->datasets);
		update_running_since(s);
	}
	if (deferred_tick(s->core, has_client_work(s)))
		disk_tick(s->core, service_active(s));
	else
		disk_restore_folders(s->core);
	datasets_tick(s->datasets);
	service_settle(s);
}

/* More than so many background tasks, or other work. */
static bool has_work(const struct service *s, unsigned background, bool queued)
{
	const struct core *core = s->core;

	return pushes_open(s->pushes) || core->background > background || sched_busy(core->p.sched) > background ||
	       catalogue_busy(core->p.catalogue) || jobs_busy(s->jobs, queued);
}

bool service_is_deferring(const struct service *s)
{
	return deferred_is_pending(s->core);
}

bool service_active(const struct service *s)
{
	/* The periodic query of the file systems does not count, or a daemon with idle-exit would never be idle. */
	return has_work(s, disk_is_querying(s->core), true);
}

/* ---- stopping ---- */

void service_stop(struct service *s)
{
	THREAD_LOOP_ONLY();
	s->core->stopping = true;
	deferred_cancel_all(s->core);
	disk_stop(s->core);
	datasets_park(s->datasets);
	jobs_park(s->jobs);
	service_settle(s);
}

bool service_is_stopped(const struct service *s)
{
	return s->core->stopping && !has_work(s, 0, false);
}

void service_abandon(struct service *s)
{
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	pushes_abandon(s->pushes);
	if (io_folder_empty(s->core->onestepfd, &err) || io_folder_empty(s->core->tempfd, &err))
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "temporary files stay behind until the next start", &err);
}

/* ---- limits ---- */

void service_set_limits(struct service *s, const struct core_limits *limits)
{
	struct core *core = s->core;

	THREAD_LOOP_ONLY();
	core->p.limits = *limits;
	space_set_limits(core->space, limits->disk, limits->keep_free);
	datasets_expire(s->datasets);
	limit_recount(core);
}
