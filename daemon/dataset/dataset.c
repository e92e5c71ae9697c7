/*
 * One dataset: when it is made and freed in memory, its row, and how pushes and jobs change it.
 *
 * The model: a dataset is in the list as long as it has a generation or a user. The last user removes a one-step dataset, and a
 * named one that never got a generation, with its folder (dataset_folder.c).
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

/* The struct, and the longest texts that a manifest may give it. */
enum { DATASET_BYTES = sizeof(struct dataset) + LATTICE_TEXT_SIZE + 512 + 2 * 16 + 5 * 24 };

struct dataset *dataset_new(struct datasets *ds, const char *name, const struct peer *owner, bool onestep, struct err *err)
{
	struct dataset *d, **at;

	THREAD_LOOP_ONLY();
	/* A one-step dataset is removed with its mesh, so it is not charged as lasting. */
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

/* ---- users and rows ---- */

struct dataset *dataset_hold(struct dataset *d)
{
	THREAD_LOOP_ONLY();
	d->users++;
	return d;
}

void dataset_release(struct dataset *d)
{
	THREAD_LOOP_ONLY();
	assert(d->users);
	if (!--d->users && (d->onestep || (!d->generation && !dataset_created(d))))
		dataset_drop(d);
}

bool dataset_set_text(char **to, const char *with)
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
	if (d->has_row || d->generation)
		return 0;
	dataset_row(d, &row);
	r = catalogue_put_dataset(d->datasets->core->p.catalogue, &row, 0, NULL, NULL, err);
	d->has_row = !r;
	return r;
}

/* ---- changes by other rooms ---- */

void dataset_unhold(struct dataset *d)
{
	THREAD_LOOP_ONLY();
	assert(d->users);
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
	assert(d->rows_queued);
	d->rows_queued--;
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
	THREAD_LOOP_ONLY();
	d->mode = mode;
}

void dataset_set_partial(struct dataset *d, const double crop[4])
{
	THREAD_LOOP_ONLY();
	d->partial = true;
	memcpy(d->crop, crop, sizeof d->crop);
}

void dataset_set_seconds(struct dataset *d, double stage, double seal)
{
	THREAD_LOOP_ONLY();
	d->stage_seconds = stage;
	d->seal_seconds = seal;
}

uint32_t dataset_next_source(struct dataset *d)
{
	THREAD_LOOP_ONLY();
	return d->next_source++;
}

void dataset_sources_from(struct dataset *d, uint32_t number)
{
	THREAD_LOOP_ONLY();
	if (number > d->next_source)
		d->next_source = number;
}

void dataset_read_begin(struct dataset *d)
{
	THREAD_LOOP_ONLY();
	d->readers++;
}

void dataset_read_end(struct dataset *d)
{
	THREAD_LOOP_ONLY();
	assert(d->readers);
	d->readers--;
}
