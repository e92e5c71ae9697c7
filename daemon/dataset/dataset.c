/*
 * Datasets: their rows in memory, their folders on disk.
 *
 * The model: a dataset is in the list as long as it has a generation or a user. A one-step dataset, and a
 * named one that never got a generation, goes with its last user, folder and all. The folder is opened when
 * first needed, by a worker, and closed with the last who opened it (the only state here that workers touch,
 * under its own lock).
 */
#include <assert.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "clock.h"
#include "io.h"
#include "dataset_priv.h"
#include "lock.h"
#include "log.h"

/* Itself, and the longest texts that a manifest may give it. */
enum { DATASET_BYTES = sizeof(struct dataset) + LATTICE_TEXT_SIZE + 512 + 2 * 16 + 5 * 24 };

static struct lock folder_lock = LOCK_STATIC(DATASET_FOLDER);

bool dataset_name_valid(const char *name)
{
	static const char more[] = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_.-";
	size_t n = strlen(name);

	return n && n <= DATASET_NAME_MAX && strspn(name, more) == n && *name != '.' && *name != '-';
}

struct dataset *dataset_new(struct datasets *ds, const char *name, const struct peer *owner, bool onestep, struct err *err)
{
	struct dataset *d, **at;

	THREAD_LOOP_ONLY();
	/* One of a single step goes with its mesh. */
	if (onestep ? charge(ds->core, DATASET_BYTES, "another dataset", err) :
		      charge_lasting(ds->core, CHARGE_DATASET, owner->uid, DATASET_BYTES, "another dataset", err))
		return NULL;
	d = calloc(1, sizeof *d);
	if (!d)
		uncharge(ds->core, DATASET_BYTES);
	if (d) {
		d->datasets = ds;
		d->charged = DATASET_BYTES;
		d->dirfd = -1;
		d->lattice = strdup("");
		d->crs = strdup("");
		d->unit_xy = strdup("");
		d->unit_z = strdup("");
	}
	if (!d || !d->lattice || !d->crs || !d->unit_xy || !d->unit_z) {
		dataset_free(d);
		err_set(err, ERR_NOMEM, "no memory for a dataset");
		return NULL;
	}
	d->onestep = onestep;
	d->id = onestep ? ++ds->last_onestep : ++ds->last_dataset;
	if (onestep)
		snprintf(d->name, sizeof d->name, ".one-step-%llu", (unsigned long long)d->id);
	else
		snprintf(d->name, sizeof d->name, "%s", name);
	d->uid = owner->uid;
	d->gid = owner->gid;
	d->mode = DATASET_MODE;
	d->created_us = clock_real_us();
	d->next_source = 1;
	for (at = ds->last_loaded ? &ds->last_loaded->next : &ds->first; *at && !(*at)->onestep; at = &(*at)->next)
		;
	if (onestep)
		while (*at)
			at = &(*at)->next;
	d->next = *at;
	*at = d;
	return d;
}

struct dataset *dataset_free(struct dataset *d)
{
	struct pending *q;

	THREAD_LOOP_ONLY();
	if (!d)
		return NULL;
	io_close(d->dirfd);
	while ((q = d->pending)) {
		d->pending = q->next;
		pending_free(d->datasets, q);
	}
	uncharge(d->datasets->core, d->charged);
	free(d->lattice);
	free(d->crs);
	free(d->unit_xy);
	free(d->unit_z);
	free(d);
	return NULL;
}

/* ---- folders ---- */

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
	unnamed = !r && !d->onestep && !d->named;
	if (!r)
		d->opened++;
	lock_give(&folder_lock);
	if (!unnamed)
		return r;
	/* The folder's own name must outlive a power cut as its files do. Without the lock, which the loop takes to close. */
	r = io_sync(parent_of(d), "the folder of datasets", err);
	lock_take(&folder_lock);
	d->named |= !r;
	lock_give(&folder_lock);
	if (r)
		dataset_close(d);
	return r;
}

void dataset_close(struct dataset *d)
{
	lock_take(&folder_lock);
	if (!--d->opened)
		d->dirfd = io_close(d->dirfd);
	lock_give(&folder_lock);
}

/* ---- leftovers ---- */

struct keep {
	int dirfd;
	const char *manifest;
	const struct grid_manifest *m;
	const struct pending *pending;
	unsigned removed;
};

static int remove_unnamed(void *ctx, const struct dirent *e, struct err *err)
{
	struct keep *keep = ctx;
	const struct pending *q;
	char stem[32];
	size_t i;

	if (!strcmp(e->d_name, keep->manifest))
		return 0;
	for (i = 0; keep->m && i < keep->m->nsegments; i++)
		if (!strcmp(e->d_name, keep->m->segments[i].file))
			return 0;
	for (q = keep->pending; q; q = q->next) {
		snprintf(stem, sizeof stem, "push-%llu.", (unsigned long long)q->id);
		if (!strncmp(e->d_name, stem, strlen(stem)) && strcmp(e->d_name + strlen(stem), "seg"))
			return 0;
	}
	keep->removed++;
	return io_remove(keep->dirfd, e->d_name, err);
}

int dataset_sweep(struct dataset *d, bool again, struct err *err)
{
	struct keep keep = {.manifest = d->manifest, .pending = d->pending};
	struct grid_manifest *m = NULL;
	int r = dataset_open(d, err);

	if (r)
		return r;
	if (*d->manifest)
		r = grid_manifest_load(d->dirfd, d->manifest, d->datasets->core->p.ledger, &m, err);
	keep.m = m;
	keep.dirfd = d->dirfd;
	if (!r)
		r = io_list(d->dirfd, ".", remove_unnamed, &keep, err);
	/* Where nobody looks again what was removed must not come back. */
	if (!r && (keep.removed || !again))
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
		return; /* never made */
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

/* NULL: without memory for it the folder stays, and is removed at the next start. */
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

/* Loop: the folder goes in the background, or stays where a row may still lead to it. */
static void removal_go(struct removal *rm, bool goes)
{
	if (rm && goes)
		sched_submit(rm->datasets->core->p.sched, &rm->task);
	else if (rm)
		removal_done(&rm->task);
}

static void removal_row_gone(void *ctx, int r, const struct err *why)
{
	struct removal *rm = ctx;

	removal_go(rm, !r && !catalogue_is_uncertain(rm->datasets->core->p.catalogue));
}

/* ---- in memory ---- */

struct dataset *dataset_hold(struct dataset *d)
{
	THREAD_LOOP_ONLY();
	d->users++;
	return d;
}

void dataset_release(struct dataset *d)
{
	THREAD_LOOP_ONLY();
	if (!--d->users && (d->onestep || (!d->generation && !dataset_created(d))))
		dataset_drop(d);
}

void dataset_drop(struct dataset *d)
{
	struct removal *rm = removal_new(d);
	struct err err = ERR_INIT;
	struct dataset **at;

	THREAD_LOOP_ONLY();
	for (at = &d->datasets->first; *at != d; at = &(*at)->next)
		;
	*at = d->next;
	/* First the row, then what it names. */
	if (!d->row) {
		removal_go(rm, d->onestep || !catalogue_is_uncertain(d->datasets->core->p.catalogue));
	} else if (catalogue_drop_dataset(d->datasets->core->p.catalogue, d->id, rm ? removal_row_gone : NULL, rm, &err)) {
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL, "the catalogue", &err);
		removal_go(rm, false);
	}
	if (atomic_load(&d->derived))
		space_give(d->datasets->core->space, SPACE_ONESTEP, atomic_load(&d->derived));
	datasets_count(d->datasets);
	dataset_free(d);
}

struct dataset *datasets_first(const struct datasets *ds)
{
	return ds->first;
}

struct dataset *dataset_find(struct datasets *ds, const char *name, const struct peer *peer)
{
	struct dataset *d;

	for (d = ds->first; d; d = d->next)
		if (!d->removed_us && !strcmp(d->name, name))
			return !d->onestep || rights_acts_as(peer, d->uid) ? d : NULL;
	return NULL;
}

int dataset_ask(struct datasets *ds, const char *name, const struct peer *peer, enum right right, struct dataset **ret,
		struct err *err)
{
	struct dataset *d = dataset_find(ds, name, peer);
	int r;

	if (!d) {
		err_set(err, ERR_NOTFOUND, "there is no dataset \"%.100s\"", name);
		return err_add_hint(err, "acutctl datasets lists them");
	}
	r = dataset_rights(d, peer, right, err);
	if (!r)
		*ret = d;
	return r;
}

static bool is_listed(const struct dataset *d, const struct peer *peer)
{
	return !d->onestep && !d->removed_us && (d->generation || d->pending || dataset_created(d)) &&
	       rights_allow(peer, RIGHT_READ, d->uid, d->gid, d->mode);
}

unsigned dataset_list(const struct datasets *ds, const char *name, const struct peer *peer, unsigned max, struct dataset **ret)
{
	struct dataset *d;
	unsigned n = 0;

	/* Those that are found stay in order; as a rule a page is full soon, and the others come after its last. */
	for (d = ds->first; d && max; d = d->next) {
		unsigned i;

		if (strcmp(d->name, name) <= 0 || (n == max && strcmp(d->name, ret[n - 1]->name) > 0) || !is_listed(d, peer))
			continue;
		n += n < max;
		for (i = n - 1; i && strcmp(d->name, ret[i - 1]->name) < 0; i--)
			ret[i] = ret[i - 1];
		ret[i] = d;
	}
	return n;
}

void dataset_info(const struct dataset *d, struct dataset_info *ret)
{
	const struct pending *q;

	*ret = (struct dataset_info){
		.name = d->name,
		.id = d->id,
		.generation = d->generation,
		.points = d->points,
		.bytes = d->bytes,
		.files = d->files,
		.uid = d->uid,
		.gid = d->gid,
		.mode = d->mode,
		.lattice = d->lattice,
		.crs = d->crs,
		.unit_xy = d->unit_xy,
		.unit_z = d->unit_z,
		.created_us = d->created_us,
		.pushed_us = d->pushed_us,
		.pushes = d->pushes,
		.oldest = d->oldest,
		.segments = d->segments,
		.merging = merge_at_work(d),
		.removed_us = d->removed_us,
		.until_us = dataset_until_us(d),
		.pinned = d->pinned,
	};
	memcpy(ret->box, d->box, sizeof ret->box);
	for (q = d->pending; q; q = q->next)
		ret->pending++;
	q = d->pending;
	if (q) {
		ret->pending_files = q->files;
		ret->pending_uid = q->uid;
		ret->pending_points = q->points;
		ret->pending_until_us = pending_until_us(q);
	}
}

static bool replace(char **to, const char *with)
{
	char *copy;

	if (*to && !strcmp(*to, with))
		return true;
	copy = strdup(with);
	if (!copy)
		return false;
	free(*to);
	*to = copy;
	return true;
}

void dataset_row(const struct dataset *d, struct catalogue_dataset *ret)
{
	*ret = (struct catalogue_dataset){
		.id = d->id,
		.name = d->name,
		.uid = d->uid,
		.gid = d->gid,
		.mode = d->mode,
		.created_us = d->created_us,
		.pushed_us = d->pushed_us,
		.manifest = d->manifest,
		.generation = d->generation,
		.points = d->points,
		.bytes = d->bytes,
		.files = d->files,
		.lattice = d->lattice,
		.crs = d->crs,
		.unit_xy = d->unit_xy,
		.unit_z = d->unit_z,
		.oldest = d->oldest,
		.segments = d->segments,
		.removed_us = d->removed_us,
		.pinned = d->pinned,
	};
	memcpy(ret->box, d->box, sizeof ret->box);
}

uint64_t dataset_oldest(const struct dataset *d)
{
	uint64_t oldest = d->oldest ? d->oldest : 1;

	return d->prune_to > oldest ? d->prune_to : oldest;
}

int dataset_check_generation(const struct dataset *d, uint64_t generation, struct err *err)
{
	uint64_t oldest = dataset_oldest(d);

	if (!d->generation)
		return err_set(err, ERR_NOTFOUND, "the dataset %s has no generation yet", d->name);
	if (!generation || (generation >= oldest && generation <= d->generation))
		return 0;
	if (generation < oldest)
		err_set(err, ERR_NOTFOUND, "generation %llu of the dataset %s was pruned", (unsigned long long)generation,
			d->name);
	else
		err_set(err, ERR_NOTFOUND, "the dataset %s has no generation %llu", d->name, (unsigned long long)generation);
	return err_add_hint(err, "it has generations %llu to %llu", (unsigned long long)oldest,
			    (unsigned long long)d->generation);
}

int dataset_put_row(struct dataset *d, struct err *err)
{
	struct catalogue_dataset row;
	int r;

	THREAD_LOOP_ONLY();
	if (d->row || d->generation)
		return 0;
	dataset_row(d, &row);
	r = catalogue_put_dataset(d->datasets->core->p.catalogue, &row, 0, NULL, NULL, err);
	d->row = !r;
	return r;
}

/* At the start waiting helps nobody. */
static int full(struct err *err)
{
	err->code = ERR_LIMIT;
	return -ERR_LIMIT;
}

/* Of the room for texts, what they do not take. */
static void charge_texts(struct dataset *d)
{
	const char *const texts[] = {d->lattice, d->crs, d->unit_xy, d->unit_z};
	size_t bytes = sizeof *d + 64;

	for (size_t i = 0; i < 4; i++)
		bytes += strlen(texts[i]) + 24;
	if (bytes >= d->charged)
		return;
	uncharge(d->datasets->core, d->charged - bytes);
	d->charged = bytes;
}

int datasets_load(void *datasets, const struct catalogue_dataset *row, struct err *err)
{
	struct datasets *ds = datasets;
	const struct peer owner = rights_of_user(row->uid, 0);
	struct dataset *d = dataset_new(ds, row->name, &owner, false, err);

	if (!d)
		return err->code == ERR_BUSY ? full(err) : -(int)err->code;
	ds->last_loaded = d;
	d->id = row->id;
	d->row = true;
	d->gid = row->gid;
	d->mode = row->mode;
	d->files = row->files;
	d->created_us = row->created_us;
	d->pushed_us = row->pushed_us;
	snprintf(d->manifest, sizeof d->manifest, "%s", row->manifest);
	d->generation = row->generation;
	d->removed_us = row->removed_us;
	d->pinned = row->pinned;
	d->named = row->generation > 0;
	d->points = row->points;
	d->bytes = row->bytes;
	d->oldest = row->oldest || !row->generation ? row->oldest : 1;
	d->segments = row->segments;
	d->merge_due = merge_due_likely(row->segments);
	d->datasets->merges_due |= d->merge_due;
	memcpy(d->box, row->box, sizeof d->box);
	if (!replace(&d->lattice, row->lattice) || !replace(&d->crs, row->crs) || !replace(&d->unit_xy, row->unit_xy) ||
	    !replace(&d->unit_z, row->unit_z))
		return err_set(err, ERR_NOMEM, "no memory for a dataset");
	charge_texts(d);
	return 0;
}

/* ---- what others change ---- */

void dataset_unhold(struct dataset *d)
{
	THREAD_LOOP_ONLY();
	d->users--;
}

bool dataset_is_read(const struct dataset *d)
{
	return d->readers || admission_opens(d->datasets->admission, d);
}

bool dataset_commit_begin(struct dataset *d, const void *by)
{
	THREAD_LOOP_ONLY();
	if (d->committer && d->committer != by)
		return false;
	d->committer = by;
	return true;
}

void dataset_commit_end(struct dataset *d, const void *by)
{
	THREAD_LOOP_ONLY();
	if (d->committer == by)
		d->committer = NULL;
}

void dataset_row_written(struct dataset *d)
{
	THREAD_LOOP_ONLY();
	assert(d->rows);
	d->rows--;
}

bool dataset_plan_begin(struct dataset *d, struct push *p)
{
	THREAD_LOOP_ONLY();
	if (d->planner && d->planner != p)
		return false;
	d->planner = p;
	return true;
}

void dataset_plan_end(struct dataset *d, const struct push *p)
{
	THREAD_LOOP_ONLY();
	if (d->planner == p)
		d->planner = NULL;
}

void dataset_push_begin(struct dataset *d)
{
	THREAD_LOOP_ONLY();
	d->pushes++;
}

void dataset_push_end(struct dataset *d)
{
	THREAD_LOOP_ONLY();
	assert(d->pushes);
	d->pushes--;
}

void dataset_set_mode(struct dataset *d, uint32_t mode)
{
	d->mode = mode;
}

void dataset_set_partial(struct dataset *d, const double crop[4])
{
	d->partial = true;
	memcpy(d->crop, crop, sizeof d->crop);
}

void dataset_set_seconds(struct dataset *d, double stage, double seal)
{
	d->stage_seconds = stage;
	d->seal_seconds = seal;
}

uint32_t dataset_next_source(struct dataset *d)
{
	return d->next_source++;
}

void dataset_sources_from(struct dataset *d, uint32_t number)
{
	if (number > d->next_source)
		d->next_source = number;
}
