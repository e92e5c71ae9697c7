/*
 * The file systems, and the folders of the cache.
 *
 * The model: a worker queries the free space of the file systems every two seconds, or every ten while the daemon is idle. The
 * loop never queries them, since a file system may not answer. One task measures the cache after the start, and again if that
 * failed, whatever is being written, or if the result is inexact, when nothing is; the time between two passes is at least
 * 10 s, and 20 times as long as one takes. A task evicts whenever quota or keep-free are exceeded, also if other programs have
 * filled the disk. If somebody removes a folder of the cache, it is made again under the descriptor that is in use. Its files
 * are derived data, and made again when they are needed.
 */
#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "io.h"
#include "core_priv.h"
#include "log.h"

#define QUERY_SECONDS 2.0
#define QUERY_SECONDS_IDLE 10.0      /* each query wakes a worker */
#define FRESH_SECONDS 1.0            /* younger figures are reported without a query */
#define ANSWER_NS UINT64_C(20000000) /* that the loop waits for a worker's answer */

#define REMEASURE_NS UINT64_C(10000000000) /* between two passes over the cache, at least */
#define REMEASURE_TIMES 20                 /* the duration of the first, which reads all names in the cache; at least, too */

/* ---- measuring and evicting, by a task ---- */

struct cache_work {
	struct sched_task task;
	struct core *core;
	bool measure;
	uint64_t took_ns;
	int r; /* -ERR_CANCELLED until it has run */
	struct err err;
};

static void cache_work_run(struct sched_task *t)
{
	struct cache_work *x = (struct cache_work *)t;
	uint64_t bytes, entries, begun_ns = clock_mono_ns();
	int r = x->measure ? space_measure(x->core->space, &t->cancel, &x->err) : 0;

	x->took_ns = clock_mono_ns() - begun_ns;
	if (!r)
		space_query(x->core->space);
	if (!r && space_is_exceeded(x->core->space))
		r = space_evict(x->core->space, false, &bytes, &entries, &x->err);
	x->r = r;
}

/* Logged once when it begins, and once when it ends. */
static void set_unknown(struct disk *d, const struct cache_work *x)
{
	bool failed = x->r && x->r != -ERR_CANCELLED;

	if (failed && !d->unknown)
		log_event_err(LOG_EVENT_SPACE_UNKNOWN, NULL, "the cache cannot be examined", &x->err);
	else if (d->unknown && x->measure && !x->r)
		log_notice("the cache can be examined again");
	else
		return;
	d->unknown = failed;
}

static void cache_work_done(struct sched_task *t)
{
	struct cache_work *x = (struct cache_work *)t;
	struct disk *d = &x->core->priv->disk;
	uint64_t pause_ns = REMEASURE_TIMES * x->took_ns;

	core_background_done(x->core);
	d->work = NULL;
	set_unknown(d, x);
	if (x->measure)
		d->remeasure_ns = clock_mono_ns() + (pause_ns > REMEASURE_NS ? pause_ns : REMEASURE_NS);
	free(x);
}

static void submit_cache_work(struct core *core, bool measure)
{
	struct cache_work *x = calloc(1, sizeof *x);

	if (!x)
		return;
	x->task = (struct sched_task){.run = cache_work_run,
				      .done = cache_work_done,
				      .owner = {.uid = geteuid()},
				      .priority = SCHED_LAST,
				      .lengthy = true};
	x->core = core;
	x->measure = measure;
	x->r = -ERR_CANCELLED;
	x->err = ERR_INIT;
	core->priv->disk.work = &x->task;
	core_background(core, &x->task);
}

/* ---- querying the file systems ---- */

static void query_run(struct sched_task *t)
{
	space_query(((struct disk_query *)t)->core->space);
}

static void query_done(struct sched_task *t)
{
	struct core *core = ((struct disk_query *)t)->core;
	struct disk *d = &core->priv->disk;

	assert(d->querying);
	core_background_done(core);
	d->querying = false;
	if (t->ran && !core->stopping && d->measured && !d->work && space_is_exceeded(core->space))
		submit_cache_work(core, false);
}

static void submit_query(struct core *core)
{
	struct disk *d = &core->priv->disk;

	if (d->querying || core->stopping)
		return;
	d->query = (struct disk_query){
		.task = {.run = query_run, .done = query_done, .owner = {.uid = geteuid()}, .priority = SCHED_FIRST},
		.core = core,
	};
	d->querying = true;
	d->queried_ns = clock_mono_ns();
	core_background(core, &d->query.task);
}

void disk_query_now(struct core *core)
{
	struct disk *d = &core->priv->disk;

	THREAD_LOOP_ONLY();
	if (clock_since(d->queried_ns) >= FRESH_SECONDS)
		submit_query(core);
	/* The wait counts from the start of the query: one that takes longer delays the loop only once. */
	if (d->querying)
		space_query_wait(core->space, d->queried_ns, d->queried_ns + ANSWER_NS);
}

/* ---- folders ---- */

static bool is_removed(int fd)
{
	return fd >= 0 && io_is_gone(fd);
}

/* Makes `fd` refer to the folder `with`, and closes `with`. */
static int replace_folder(int fd, int with, struct err *err)
{
	int r = dup3(with, fd, O_CLOEXEC) < 0 ? err_sys(err, errno, "a folder of the cache cannot be replaced") : 0;

	io_close(with);
	return r;
}

static int restore_folder(struct core *core, const char *name, int fd, struct err *err)
{
	int with, r;

	if (!is_removed(fd))
		return 0;
	log_event(LOG_EVENT_CACHE_GONE, NULL, "the folder %s of the cache was removed: it is made again", name);
	r = io_make_dir(core->p.cachefd, name, 0700, err);
	if (!r)
		r = io_open(core->p.cachefd, name, O_RDONLY | O_DIRECTORY, 0, &with, err);
	if (!r)
		r = replace_folder(fd, with, err);
	/* The cache has to be measured again. */
	if (!r)
		core->priv->disk.measured = false;
	return r;
}

void disk_restore_folders(struct core *core)
{
	struct err err = ERR_INIT;
	int with, r = 0;

	THREAD_LOOP_ONLY();
	if (is_removed(core->p.cachefd) && core->p.remake_cache) {
		log_event(LOG_EVENT_CACHE_GONE, NULL, "the folder of the cache was removed: it is made again");
		r = core->p.remake_cache(core->p.cache_ctx, &with, &err);
		if (!r)
			r = replace_folder(core->p.cachefd, with, &err);
	}
	if (!r)
		r = restore_folder(core, "one-step", core->onestepfd, &err);
	if (!r)
		r = restore_folder(core, "domains", core->domainsfd, &err);
	if (!r)
		r = restore_folder(core, "tmp", core->tempfd, &err);
	if (r)
		log_event_err(LOG_EVENT_CACHE_GONE, NULL, "the cache", &err);
}

void disk_tick(struct core *core, bool active)
{
	struct disk *d = &core->priv->disk;

	THREAD_LOOP_ONLY();
	disk_restore_folders(core);
	active |= sched_busy(core->p.sched) > 0;
	if (!core->stopping && !d->work &&
	    (!d->measured || (clock_mono_ns() >= d->remeasure_ns && (d->unknown || space_is_inexact(core->space))))) {
		d->measured = true;
		submit_cache_work(core, true);
	}
	if (clock_since(d->queried_ns) >= (active ? QUERY_SECONDS : QUERY_SECONDS_IDLE))
		submit_query(core);
}

void disk_stop(struct core *core)
{
	THREAD_LOOP_ONLY();
	if (core->priv->disk.work)
		sched_cancel(core->p.sched, core->priv->disk.work);
}

bool disk_is_querying(const struct core *core)
{
	return core->priv->disk.querying;
}
