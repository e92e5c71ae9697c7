/*
 * The service's side of the disk (space.h): what its lists say of what lies there, the task in the background that
 * measures and evicts, and the cache's folders when somebody has removed them.
 *
 * The model: each half second the sums of datasets and pending pushes go to the accounts. A worker asks the file systems every
 * two seconds what they have, every ten while the daemon is idle, as the loop must not: one that hangs keeps that worker. A task
 * reads what is derived once after the start, and evicts whenever quota or keep-free do not hold, also when it is other programs
 * that have filled the disk. A folder of the cache that is gone is made again under the descriptor that everybody has of it, so
 * whoever comes next finds it; what was in it is derived, and made again by whoever needs it.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "io.h"
#include "job_priv.h"
#include "log.h"

#define COUNT_SECONDS 0.5
#define LOOK_SECONDS 2.0
#define LOOK_SECONDS_IDLE 10.0 /* each look wakes a worker */
#define NOW_SECONDS 1.0
#define ANSWER_NS UINT64_C(20000000) /* that the loop waits for a worker's answer */

uint64_t disk_points_bytes(uint64_t points)
{
	/* 16 bytes a point, and a twelfth for tables and index; of few points pages that are not full. */
	const uint64_t most = UINT64_MAX / 64;

	points = points < most ? points : most;
	return points * 16 + points * 16 / 12 + (64 << 10);
}

/* ---- counting ---- */

void disk_count(struct jobs *j)
{
	uint64_t bytes[SPACE_KINDS] = {0};
	const struct dataset *d;
	const struct pending *q;

	for (d = j->datasets; d; d = d->next) {
		bytes[d->onestep ? SPACE_ONESTEP : d->removed_us ? SPACE_REMOVED : SPACE_DATASETS] += d->bytes;
		for (q = d->pending; q; q = q->next)
			bytes[SPACE_PENDING] += disk_points_bytes(q->points);
	}
	space_set(j->space, SPACE_DATASETS, bytes[SPACE_DATASETS]);
	space_set(j->space, SPACE_REMOVED, bytes[SPACE_REMOVED]);
	space_set(j->space, SPACE_ONESTEP, bytes[SPACE_ONESTEP]);
	space_set(j->space, SPACE_PENDING, bytes[SPACE_PENDING]);
	limit_count(j);
}

/* Domains that were used since then are those of jobs that run. */
static void count_running(struct jobs *j)
{
	double longest = -1;
	const struct job *job;

	for (job = j->jobs; job; job = job->next)
		if (job->run && job->begun_ns && clock_since(job->begun_ns) > longest)
			longest = clock_since(job->begun_ns);
	space_running_since(j->space, longest < 0 ? INT64_MAX : clock_real_us() - (int64_t)(longest * 1e6));
}

/* ---- in the background ---- */

struct tidy {
	struct sched_task task;
	struct jobs *jobs;
	bool measures;
};

static void tidy_run(struct sched_task *t)
{
	struct tidy *x = (struct tidy *)t;
	struct err err = ERR_INIT;
	uint64_t bytes, entries;
	int r = x->measures ? space_measure(x->jobs->space, &err) : 0;

	if (!r)
		space_ask(x->jobs->space);
	if (!r && space_over(x->jobs->space))
		r = space_evict(x->jobs->space, false, &bytes, &entries, &err);
	if (r)
		log_event_err(LOG_EVENT_SPACE_UNKNOWN, NULL, "the cache cannot be looked through", &err);
}

static void tidy_done(struct sched_task *t)
{
	struct tidy *x = (struct tidy *)t;

	x->jobs->background--;
	x->jobs->disk.busy = false;
	free(x);
}

static void tidy(struct jobs *j, bool measures)
{
	struct tidy *x = calloc(1, sizeof *x);

	if (!x)
		return;
	x->task = (struct sched_task){
		.run = tidy_run, .done = tidy_done, .owner = {.uid = geteuid()}, .priority = SCHED_LAST, .lengthy = true};
	x->jobs = j;
	x->measures = measures;
	j->disk.busy = true;
	j->background++;
	sched_submit(j->p.sched, &x->task);
}

/* ---- asking the file systems ---- */

static struct jobs *jobs_of(struct sched_task *t)
{
	return (struct jobs *)((char *)t - offsetof(struct jobs, disk.ask));
}

static void ask_run(struct sched_task *t)
{
	space_ask(jobs_of(t)->space);
}

static void ask_done(struct sched_task *t)
{
	struct jobs *j = jobs_of(t);

	j->background--;
	j->disk.asking = false;
	if (t->ran && !j->parking && j->disk.begun && !j->disk.busy && space_over(j->space))
		tidy(j, false);
}

static void ask(struct jobs *j)
{
	struct disk *d = &j->disk;

	if (d->asking || j->parking)
		return;
	d->ask = (struct sched_task){.run = ask_run, .done = ask_done, .owner = {.uid = geteuid()}, .priority = SCHED_FIRST};
	d->asking = true;
	d->asked_ns = clock_mono_ns();
	j->background++;
	sched_submit(j->p.sched, &d->ask);
}

void disk_ask_now(struct jobs *j)
{
	if (clock_since(j->disk.asked_ns) >= NOW_SECONDS)
		ask(j);
	/* Of a question that was asked in vain for so long already this waits no more. */
	if (j->disk.asking)
		space_ask_wait(j->space, j->disk.asked_ns, j->disk.asked_ns + ANSWER_NS);
}

/* ---- folders ---- */

static bool is_gone(int fd)
{
	return fd >= 0 && io_is_gone(fd);
}

/* The new one takes the descriptor of the old. */
static int exchange(int fd, int with, struct err *err)
{
	int r = dup3(with, fd, O_CLOEXEC) < 0 ? err_sys(err, errno, "a folder of the cache cannot be exchanged") : 0;

	io_close(with);
	return r;
}

static int make_again(struct jobs *j, const char *name, int fd, struct err *err)
{
	int with, r;

	if (!is_gone(fd))
		return 0;
	log_event(LOG_EVENT_CACHE_GONE, NULL, "the folder %s of the cache was removed: it is made again", name);
	r = io_make_dir(j->p.cachefd, name, 0700, err);
	if (!r)
		r = io_open(j->p.cachefd, name, O_RDONLY | O_DIRECTORY, 0, &with, err);
	if (!r)
		r = exchange(fd, with, err);
	/* What was counted there is measured again. */
	if (!r)
		j->disk.begun = false;
	return r;
}

/* Asked by whoever begins something; where nothing is gone, four calls that touch no disk. */
void disk_mend(struct jobs *j)
{
	struct err err = ERR_INIT;
	int with, r = 0;

	if (is_gone(j->p.cachefd) && j->p.cache_again) {
		log_event(LOG_EVENT_CACHE_GONE, NULL, "the folder of the cache was removed: it is made again");
		r = j->p.cache_again(j->p.cache_ctx, &with, &err);
		if (!r)
			r = exchange(j->p.cachefd, with, &err);
	}
	if (!r)
		r = make_again(j, "one-step", j->onestepfd, &err);
	if (!r)
		r = make_again(j, "domains", j->domainsfd, &err);
	if (!r)
		r = make_again(j, "tmp", j->tempfd, &err);
	if (r)
		log_event_err(LOG_EVENT_CACHE_GONE, NULL, "the cache", &err);
}

void disk_look(struct jobs *j)
{
	struct disk *d = &j->disk;

	THREAD_LOOP_ONLY();
	disk_mend(j);
	if (clock_since(d->asked_ns) >= (jobs_active(j) || sched_busy(j->p.sched) ? LOOK_SECONDS : LOOK_SECONDS_IDLE))
		ask(j);
	if (j->parking || d->busy || d->begun)
		return;
	d->begun = true;
	tidy(j, true);
}

void disk_tick(struct jobs *j)
{
	struct disk *d = &j->disk;

	cache_verify_tick(j);
	if (clock_since(d->counted_ns) >= COUNT_SECONDS) {
		d->counted_ns = clock_mono_ns();
		disk_count(j);
		count_running(j);
	}
	if (deferred_over(j))
		disk_look(j);
	else
		disk_mend(j);
}
