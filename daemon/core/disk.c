/*
 * The file systems, and the folders of the cache.
 *
 * The model: a worker asks the file systems every two seconds what they have, every ten while the daemon is idle. The loop never
 * asks: a file system that hangs keeps that worker. A task reads sizes of what is derived once after the start, and evicts
 * whenever quota or keep-free do not hold, also when other programs have filled the disk. A folder of the cache that is gone is
 * made again under the descriptor that everybody has of it; what was in it is derived, and made again by whoever needs it.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "io.h"
#include "core.h"
#include "log.h"

#define LOOK_SECONDS 2.0
#define LOOK_SECONDS_IDLE 10.0 /* each look wakes a worker */
#define NOW_SECONDS 1.0
#define ANSWER_NS UINT64_C(20000000) /* that the loop waits for a worker's answer */

/* ---- in the background ---- */

struct tidy {
	struct sched_task task;
	struct core *core;
	bool measures;
};

static void tidy_run(struct sched_task *t)
{
	struct tidy *x = (struct tidy *)t;
	struct err err = ERR_INIT;
	uint64_t bytes, entries;
	int r = x->measures ? space_measure(x->core->space, &err) : 0;

	if (!r)
		space_ask(x->core->space);
	if (!r && space_over(x->core->space))
		r = space_evict(x->core->space, false, &bytes, &entries, &err);
	if (r)
		log_event_err(LOG_EVENT_SPACE_UNKNOWN, NULL, "the cache cannot be looked through", &err);
}

static void tidy_done(struct sched_task *t)
{
	struct tidy *x = (struct tidy *)t;

	core_background_over(x->core);
	x->core->disk.busy = false;
	free(x);
}

static void tidy(struct core *core, bool measures)
{
	struct tidy *x = calloc(1, sizeof *x);

	if (!x)
		return;
	x->task = (struct sched_task){
		.run = tidy_run, .done = tidy_done, .owner = {.uid = geteuid()}, .priority = SCHED_LAST, .lengthy = true};
	x->core = core;
	x->measures = measures;
	core->disk.busy = true;
	core_background(core, &x->task);
}

/* ---- asking the file systems ---- */

static struct core *core_of(struct sched_task *t)
{
	return (struct core *)((char *)t - offsetof(struct core, disk.ask));
}

static void ask_run(struct sched_task *t)
{
	space_ask(core_of(t)->space);
}

static void ask_done(struct sched_task *t)
{
	struct core *core = core_of(t);

	core_background_over(core);
	core->disk.asking = false;
	if (t->ran && !core->parking && core->disk.begun && !core->disk.busy && space_over(core->space))
		tidy(core, false);
}

static void ask(struct core *core)
{
	struct disk *d = &core->disk;

	if (d->asking || core->parking)
		return;
	d->ask = (struct sched_task){.run = ask_run, .done = ask_done, .owner = {.uid = geteuid()}, .priority = SCHED_FIRST};
	d->asking = true;
	d->asked_ns = clock_mono_ns();
	core_background(core, &d->ask);
}

void disk_ask_now(struct core *core)
{
	if (clock_since(core->disk.asked_ns) >= NOW_SECONDS)
		ask(core);
	/* Of a question that was asked in vain for so long already this waits no more. */
	if (core->disk.asking)
		space_ask_wait(core->space, core->disk.asked_ns, core->disk.asked_ns + ANSWER_NS);
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

static int make_again(struct core *core, const char *name, int fd, struct err *err)
{
	int with, r;

	if (!is_gone(fd))
		return 0;
	log_event(LOG_EVENT_CACHE_GONE, NULL, "the folder %s of the cache was removed: it is made again", name);
	r = io_make_dir(core->p.cachefd, name, 0700, err);
	if (!r)
		r = io_open(core->p.cachefd, name, O_RDONLY | O_DIRECTORY, 0, &with, err);
	if (!r)
		r = exchange(fd, with, err);
	/* What was counted there is measured again. */
	if (!r)
		core->disk.begun = false;
	return r;
}

/* Asked by whoever begins something; where nothing is gone, four calls that touch no disk. */
void disk_mend(struct core *core)
{
	struct err err = ERR_INIT;
	int with, r = 0;

	if (is_gone(core->p.cachefd) && core->p.cache_again) {
		log_event(LOG_EVENT_CACHE_GONE, NULL, "the folder of the cache was removed: it is made again");
		r = core->p.cache_again(core->p.cache_ctx, &with, &err);
		if (!r)
			r = exchange(core->p.cachefd, with, &err);
	}
	if (!r)
		r = make_again(core, "one-step", core->onestepfd, &err);
	if (!r)
		r = make_again(core, "domains", core->domainsfd, &err);
	if (!r)
		r = make_again(core, "tmp", core->tempfd, &err);
	if (r)
		log_event_err(LOG_EVENT_CACHE_GONE, NULL, "the cache", &err);
}

void disk_look(struct core *core, bool active)
{
	struct disk *d = &core->disk;

	THREAD_LOOP_ONLY();
	disk_mend(core);
	if (clock_since(d->asked_ns) >= (active || sched_busy(core->p.sched) ? LOOK_SECONDS : LOOK_SECONDS_IDLE))
		ask(core);
	if (core->parking || d->busy || d->begun)
		return;
	d->begun = true;
	tidy(core, true);
}
