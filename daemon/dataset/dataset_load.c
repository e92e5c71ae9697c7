/*
 * The start: rows of the catalogue become datasets and pending pushes, and what a crash left in their folders is removed. Runs
 * before the loop does, and reads the disk.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dataset_change.h"
#include "dataset_priv.h"
#include "io.h"

struct loaded {
	uint64_t id;
	struct dataset *dataset;
};

static int by_id(const void *a, const void *b)
{
	uint64_t x = ((const struct loaded *)a)->id, y = ((const struct loaded *)b)->id;

	return x < y ? -1 : x > y;
}

struct dataset *dataset_loaded(struct datasets *ds, uint64_t id)
{
	const struct loaded *hit;
	struct dataset *d;
	size_t n = 0;

	for (d = ds->loaded ? NULL : ds->first; d; d = d->next)
		n++;
	if (n)
		ds->loaded = calloc(n, sizeof *ds->loaded);
	for (d = n && ds->loaded ? ds->first : NULL; d; d = d->next)
		ds->loaded[ds->nloaded++] = (struct loaded){d->id, d};
	if (ds->loaded) {
		/* If none was removed, the entry's index follows from its id. */
		n = (size_t)(id - ds->loaded[0].id);
		if (n < ds->nloaded && ds->loaded[n].id == id)
			return ds->loaded[n].dataset;
		hit = bsearch(&(struct loaded){.id = id}, ds->loaded, ds->nloaded, sizeof *ds->loaded, by_id);
		return hit ? hit->dataset : NULL;
	}
	for (d = ds->first; d && d->id != id; d = d->next)
		;
	return d;
}

/* A push that a crash interrupted. Its durable part becomes a pending push; the rest is removed (sweep_all). */
int datasets_load_push(void *ctx, const struct catalogue_push *row, struct err *err)
{
	struct datasets *ds = ctx;
	struct dataset *d = dataset_loaded(ds, row->dataset);
	bool stays = false;
	int r = 0;

	if (d) {
		struct err why = ERR_INIT;

		d->needs_sweep = true;
		r = rewrite_owns_row(row) ? 0 : pending_load(d, row, &stays, &why);
		if (r == -ERR_NOMEM || r == -ERR_BUSY || r == -ERR_LIMIT) {
			*err = why;
			return r;
		}
		if (r) {
			log_event_err(LOG_EVENT_UNREADABLE,
				      &(struct log_about){.push = row->id, .dataset = d->name, ABOUT_USER(row->uid)},
				      "files of an interrupted push cannot be read: they stay", &why);
			d->keeps_leftovers = stays = true;
			r = 0;
		}
		d->sweep_ends |= !stays;
	}
	if (row->dataset > ds->last_dataset)
		ds->last_dataset = row->dataset;
	if (!r && !stays)
		r = catalogue_drop_push(ds->core->p.catalogue, row->id, NULL, NULL, err);
	return r;
}

/* A damaged dataset does not keep the daemon from serving the others. */
static int sweep_one(struct dataset *d, bool unused, struct err *err)
{
	struct err why = ERR_INIT;
	int r = dataset_sweep(d, !d->sweep_ends && !unused, &why);

	if (!r || r == -ERR_NOMEM || r == -ERR_BUSY || r == -ERR_LIMIT) {
		*err = why;
		return r;
	}
	log_event_err(LOG_EVENT_UNREADABLE, ABOUT_DATASET(d),
		      "files that interrupted pushes left in a dataset stay: they cannot be told from its own files", &why);
	return unused ? (*err = why, r) : 0;
}

/* Sweeps folders in which a push left something. A dataset without a generation or a pending push is dropped, unless
 * dataset_create made it. */
static int sweep_all(struct datasets *ds, struct err *err)
{
	struct dataset **at = &ds->first, *d;
	bool dropped = false;
	char name[32];
	int r = 0;

	while (!r && (d = *at)) {
		bool unused = !d->generation && !d->pending && !dataset_created(d);

		unused = unused && !d->keeps_leftovers;
		if ((d->needs_sweep || unused) && !d->keeps_leftovers)
			r = sweep_one(d, unused, err);
		if (r || !unused) {
			at = &d->next;
			continue;
		}
		snprintf(name, sizeof name, "%llu", (unsigned long long)d->id);
		if (io->unlinkat(ds->core->datafd, name, AT_REMOVEDIR) != 0)
			r = err_sys(err, errno, "cannot remove the folder of a dataset");
		else
			r = catalogue_drop_dataset(ds->core->p.catalogue, d->id, NULL, NULL, err);
		dropped = true;
		*at = d->next;
		dataset_free(d);
	}
	/* The catalogue drops these rows when it starts, so the folders must be gone for good before. */
	return !r && dropped ? io_sync(ds->core->datafd, "the folder of datasets", err) : r;
}

struct orphans {
	struct datasets *datasets;
	uint64_t last;
};

/* Removes the folder of a dataset that was removed while its folder could not be. Only ids that this catalogue has given out
 * count: if the catalogue was lost, the points are not. */
static int sweep_orphan(void *ctx, const struct dirent *e, struct err *err)
{
	const struct orphans *o = ctx;
	struct err why = ERR_INIT;
	uint64_t id;
	char *end;

	id = strtoull(e->d_name, &end, 10);
	if (*end || !id || id > o->last)
		return 0;
	if (dataset_loaded(o->datasets, id))
		return 0;
	log_event(LOG_EVENT_DATASET_GONE, NULL, "the folder of the removed dataset number %llu is deleted",
		  (unsigned long long)id);
	if (io_folder_remove(o->datasets->core->datafd, e->d_name, &why))
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "a dataset's folder stays behind", &why);
	return 0;
}

int datasets_loaded(struct datasets *ds, uint64_t last, struct err *err)
{
	int r = io_list(ds->core->datafd, ".", sweep_orphan, &(struct orphans){ds, last}, err);

	free(ds->loaded);
	ds->loaded = NULL;
	ds->nloaded = 0;
	ds->last_loaded = NULL;
	if (!r)
		r = sweep_all(ds, err);
	if (last > ds->last_dataset)
		ds->last_dataset = last;
	return r;
}

/* At the start nothing would free memory, so waiting is no use. */
static int memory_full(struct err *err)
{
	err->code = ERR_LIMIT;
	return -ERR_LIMIT;
}

/* Returns what was charged for longer texts than the dataset has. */
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
		return err->code == ERR_BUSY ? memory_full(err) : -(int)err->code;
	ds->last_loaded = d;
	d->id = row->id;
	d->has_row = true;
	d->gid = row->gid;
	d->mode = row->mode;
	d->files = row->files;
	d->created_us = row->created_us;
	d->pushed_us = row->pushed_us;
	snprintf(d->manifest, sizeof d->manifest, "%s", row->manifest);
	d->generation = row->generation;
	d->removed_us = row->removed_us;
	d->pinned = row->pinned;
	d->folder_durable = row->generation > 0;
	d->points = row->points;
	d->bytes = row->bytes;
	d->oldest = row->oldest || !row->generation ? row->oldest : 1;
	d->segments = row->segments;
	d->merge_due = merge_due_likely(row->segments);
	d->datasets->merges_due |= d->merge_due;
	memcpy(d->box, row->box, sizeof d->box);
	if (!dataset_set_text(&d->lattice, row->lattice) || !dataset_set_text(&d->crs, row->crs) ||
	    !dataset_set_text(&d->unit_xy, row->unit_xy) || !dataset_set_text(&d->unit_z, row->unit_z))
		return err_set(err, ERR_NOMEM, "no memory for a dataset");
	charge_texts(d);
	return 0;
}
