/*
 * The core: made before all rooms above it, and freed after them.
 *
 * Opens the folders. cache/one-step and cache/tmp start empty: the old folders are renamed at the start, and removed by a task
 * while the daemon already serves.
 */
#include "core_priv.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>

#include "io.h"

static const char old_prefix[] = "gone-";

int core_folder(int dirfd, const char *name, int *ret_fd, struct err *err)
{
	int r = io_make_dir(dirfd, name, 0700, err);

	return r ? r : io_open(dirfd, name, O_RDONLY | O_DIRECTORY, 0, ret_fd, err);
}

int core_selected_folder(const struct core *core, int *ret_fd, struct err *err)
{
	return core_folder(core->p.cachefd, "selected", ret_fd, err);
}

/* Opens an empty folder. The old one is renamed, for core_sweep_cache. If that is impossible, it is emptied now. */
static int open_empty(struct core *core, const char *name, int *ret_fd, struct err *err)
{
	char to[32];
	int r = -1;

	for (unsigned i = 0; r != 0 && i < 1000; i++) {
		snprintf(to, sizeof to, "%s%u", old_prefix, i);
		r = io->renameat(core->p.cachefd, name, core->p.cachefd, to);
		if (r != 0 && errno != ENOTEMPTY && errno != EEXIST)
			break;
	}
	if (r == 0 || errno == ENOENT)
		return core_folder(core->p.cachefd, name, ret_fd, err);
	r = core_folder(core->p.cachefd, name, ret_fd, err);
	return r ? r : io_folder_empty(*ret_fd, err);
}

static int open_folders(struct core *core, struct err *err)
{
	int r = core_folder(core->p.statefd, "datasets", &core->datafd, err);

	if (!r)
		r = open_empty(core, "one-step", &core->onestepfd, err);
	if (!r)
		r = core_folder(core->p.cachefd, "domains", &core->domainsfd, err);
	if (!r)
		r = open_empty(core, "tmp", &core->tempfd, err);
	if (!r)
		r = core_folder(core->p.statefd, "plans", &core->plansfd, err);
	return r;
}

int core_new(const struct core_params *p, struct core **ret, struct err *err)
{
	struct core *core = calloc(1, sizeof *core);
	int r;

	if (!core)
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	core->priv = calloc(1, sizeof *core->priv);
	if (!core->priv) {
		free(core);
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	}
	core->p = *p;
	core->datafd = core->onestepfd = core->domainsfd = core->tempfd = core->plansfd = -1;
	limit_init(core->priv);
	r = space_new(&(struct space_params){p->statefd, p->cachefd, p->limits.disk, p->limits.keep_free}, &core->space, err);
	if (!r)
		r = open_folders(core, err);
	if (r)
		core_free(core);
	else
		*ret = core;
	return r;
}

struct core *core_free(struct core *core)
{
	if (!core)
		return NULL;
	deferred_cancel_all(core);
	io_close(core->datafd);
	io_close(core->onestepfd);
	io_close(core->domainsfd);
	io_close(core->tempfd);
	io_close(core->plansfd);
	space_free(core->space);
	limit_done(core->priv);
	free(core->priv);
	free(core);
	return NULL;
}

void core_background(struct core *core, struct sched_task *t)
{
	THREAD_LOOP_ONLY();
	core->background++;
	sched_submit(core->p.sched, t);
}

void core_background_done(struct core *core)
{
	THREAD_LOOP_ONLY();
	assert(core->background);
	core->background--;
}

void core_task_held(const struct core *core, const struct sched_task *t, uint64_t held[LEDGER_NAMES])
{
	uint64_t bytes = sched_taken(core->p.sched, t);

	if (bytes)
		held[t->name] += bytes;
}

/* ---- sweeping what an earlier daemon left in the cache ---- */

struct sweep {
	struct sched_task task;
	struct core *core;
};

static void sweep_run(struct sched_task *t)
{
	struct err err = ERR_INIT;

	int r = io_folder_sweep_until(((struct sweep *)t)->core->p.cachefd, old_prefix, &t->cancel, &err);

	if (r && r != -ERR_CANCELLED)
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "what an earlier acutd left in the cache stays until the next start",
			      &err);
}

static void sweep_done(struct sched_task *t)
{
	deferred_done(((struct sweep *)t)->core, t);
	free(t);
}

void core_sweep_cache(struct core *core)
{
	struct sweep *w = calloc(1, sizeof *w);

	if (!w)
		return;
	w->task = (struct sched_task){.run = sweep_run, .done = sweep_done, .priority = SCHED_LAST};
	w->core = core;
	deferred_submit(core, &w->task);
}

/* ---- events and counts ---- */

void tally_domain(struct core *core, uint32_t triangles)
{
	THREAD_LOOP_ONLY();
	core->tally.domains_made++;
	core->tally.triangles += triangles;
}

void event_damage(const struct log_about *about, const struct err *why)
{
	if (why->code == ERR_CORRUPT)
		log_event_err(LOG_EVENT_DAMAGE, about, "what is stored is damaged", why);
}
