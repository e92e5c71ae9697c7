/*
 * Folders of datasets: made and opened when needed, swept at a start, removed in the background.
 *
 * The model: a worker opens the folder when it is first needed; the last user closes it. The descriptor and the count of its
 * users are the only state of a dataset that workers change; a lock guards them.
 */
#include <assert.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dataset_priv.h"
#include "io.h"
#include "lock.h"
#include "log.h"

static struct lock folder_lock = LOCK_STATIC(DATASET_FOLDER);

static int parent_of(const struct dataset *d)
{
	return d->onestep ? d->datasets->core->onestepfd : d->datasets->core->datafd;
}

int dataset_open(struct dataset *d, struct err *err)
{
	char name[32];
	bool unnamed;
	int r = 0;

	snprintf(name, sizeof name, "%llu", (unsigned long long)d->id);
	lock_take(&folder_lock);
	if (d->dirfd < 0) {
		r = io_make_dir(parent_of(d), name, 0700, err);
		if (!r)
			r = io_open(parent_of(d), name, O_RDONLY | O_DIRECTORY, 0, &d->dirfd, err);
	}
	unnamed = !r && !d->onestep && !d->folder_durable;
	if (!r)
		d->dirfd_users++;
	lock_give(&folder_lock);
	if (!unnamed)
		return r;
	/* The name of the folder must survive a power cut as its files do. Without the lock: the loop takes it to close a
	 * folder. */
	r = io_sync(parent_of(d), "the folder of datasets", err);
	lock_take(&folder_lock);
	d->folder_durable |= !r;
	lock_give(&folder_lock);
	if (r)
		dataset_close(d);
	return r;
}

void dataset_close(struct dataset *d)
{
	lock_take(&folder_lock);
	assert(d->dirfd_users);
	if (!--d->dirfd_users)
		d->dirfd = io_close(d->dirfd);
	lock_give(&folder_lock);
}

/* ---- leftovers and removal ---- */

struct sweep {
	int dirfd;
	const char *manifest;
	const struct grid_manifest *m;
	const struct pending *pending;
	unsigned removed;
};

/* A file that was being written. */
static bool is_partial(const char *name)
{
	size_t n = strlen(name);

	return n > 4 && !strcmp(name + n - 4, ".tmp");
}

static int sweep_entry(void *ctx, const struct dirent *e, struct err *err)
{
	struct sweep *sweep = ctx;
	const struct pending *q;
	char stem[32];

	if (!strcmp(e->d_name, sweep->manifest))
		return 0;
	if (sweep->m && grid_manifest_has_file(sweep->m, e->d_name))
		return 0;
	for (q = sweep->pending; q; q = q->next) {
		snprintf(stem, sizeof stem, "push-%llu.", (unsigned long long)q->id);
		if (!strncmp(e->d_name, stem, strlen(stem)) && strcmp(e->d_name + strlen(stem), "seg") && !is_partial(e->d_name))
			return 0;
	}
	sweep->removed++;
	return io_remove(sweep->dirfd, e->d_name, err);
}

int dataset_sweep(struct dataset *d, bool again, struct err *err)
{
	struct sweep sweep = {.manifest = d->manifest, .pending = d->pending};
	struct grid_manifest *m = NULL;
	int r = dataset_open(d, err);

	if (r)
		return r;
	if (*d->manifest)
		r = grid_manifest_load_bare(d->dirfd, d->manifest, d->datasets->core->p.ledger, &m, err);
	sweep.m = m;
	sweep.dirfd = d->dirfd;
	if (!r)
		r = io_list(d->dirfd, ".", sweep_entry, &sweep, err);
	/* If no later start sweeps here, the removal itself must be durable. */
	if (!r && (sweep.removed || !again))
		r = io_sync(d->dirfd, d->name, err);
	grid_manifest_free(m);
	dataset_close(d);
	return r;
}

struct removal {
	struct sched_task task;
	struct datasets *datasets;
	int parent;
	char name[32];
};

static void removal_run(struct sched_task *t)
{
	struct removal *rm = (struct removal *)t;
	struct err err = ERR_INIT;
	int fd, r;

	r = io_open(rm->parent, rm->name, O_RDONLY | O_DIRECTORY, 0, &fd, &err);
	if (r)
		return; /* the folder was never made */
	r = io_folder_empty(fd, &err);
	io_close(fd);
	if (!r && io->unlinkat(rm->parent, rm->name, AT_REMOVEDIR) != 0)
		r = err_sys(&err, errno, "cannot remove the folder of a dataset");
	if (r)
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "a dataset's folder stays behind", &err);
}

static void removal_done(struct sched_task *t)
{
	struct removal *rm = (struct removal *)t;

	core_background_done(rm->datasets->core);
	free(rm);
}

/* NULL: no memory; the folder stays until the next start removes it. */
static struct removal *removal_new(struct dataset *d)
{
	struct removal *rm = calloc(1, sizeof *rm);

	if (!rm)
		return NULL;
	rm->task =
		(struct sched_task){.run = removal_run, .done = removal_done, .owner = {.uid = d->uid}, .priority = SCHED_LAST};
	rm->datasets = d->datasets;
	rm->parent = parent_of(d);
	snprintf(rm->name, sizeof rm->name, "%llu", (unsigned long long)d->id);
	d->datasets->core->background++;
	return rm;
}

/* Loop: removes the folder in the background, unless a row may still lead to it. */
static void removal_start(struct removal *rm, bool goes)
{
	if (rm && goes)
		sched_submit(rm->datasets->core->p.sched, &rm->task);
	else if (rm)
		removal_done(&rm->task);
}

static void removal_row_dropped(void *ctx, int r, const struct err *why)
{
	struct removal *rm = ctx;

	removal_start(rm, !r && !catalogue_is_uncertain(rm->datasets->core->p.catalogue));
}

void dataset_drop(struct dataset *d)
{
	struct removal *rm = removal_new(d);
	struct err err = ERR_INIT;
	struct dataset **at;

	THREAD_LOOP_ONLY();
	assert(!d->users && !d->pushes && !d->pending && !d->committer);
	for (at = &d->datasets->first; *at != d; at = &(*at)->next)
		;
	*at = d->next;
	/* First the row, then the folder that it names. */
	if (!d->has_row) {
		removal_start(rm, d->onestep || !catalogue_is_uncertain(d->datasets->core->p.catalogue));
	} else if (catalogue_drop_dataset(d->datasets->core->p.catalogue, d->id, rm ? removal_row_dropped : NULL, rm, &err)) {
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL, "the catalogue", &err);
		removal_start(rm, false);
	}
	if (atomic_load(&d->derived))
		space_give(d->datasets->core->space, SPACE_ONESTEP, atomic_load(&d->derived));
	datasets_count(d->datasets);
	dataset_free(d);
}
