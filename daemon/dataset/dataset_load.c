/*
 * The start: rows of the catalogue become datasets and interrupted pushes, and what a crash left in their folders goes. Before
 * the loop runs; reads the disk.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>

#include "dataset_change.h"
#include "dataset_priv.h"
#include "io.h"

struct loaded {
	uint64_t id;
	struct dataset *dataset;
};

/* Bytes on the disk by user (struct core_usage). */
static void used(void *ctx, void (*add)(void *to, uint32_t uid, uint64_t bytes), void *to)
{
	for (const struct dataset *d = ((struct datasets *)ctx)->first; d; d = d->next) {
		add(to, d->uid, d->bytes);
		for (const struct pending *q = d->pending; q; q = q->next)
			add(to, q->uid, datasets_points_bytes(q->points));
	}
}

int datasets_new(struct core *core, struct admission *admission, struct datasets **ret, struct err *err)
{
	struct datasets *ds = calloc(1, sizeof *ds);

	if (!ds)
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	ds->core = core;
	ds->admission = admission;
	core->usage = (struct core_usage){ds, used};
	*ret = ds;
	return 0;
}

struct datasets *datasets_free(struct datasets *ds)
{
	struct dataset *d;

	if (!ds)
		return NULL;
	dataset_old_forget(ds);
	while ((d = ds->first)) {
		ds->first = d->next;
		dataset_free(d);
	}
	free(ds->loaded);
	free(ds);
	return NULL;
}

void datasets_set_calls(struct datasets *ds, const struct datasets_calls *calls, void *ctx)
{
	ds->calls = calls;
	ds->ctx = ctx;
}

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
		/* Where none was removed they stand by their numbers. */
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

/* A push that a crash ended: what was durable of it waits to be taken up, the rest is removed (sweep_all). */
int datasets_load_push(void *ctx, const struct catalogue_push *row, struct err *err)
{
	struct datasets *ds = ctx;
	struct dataset *d = dataset_loaded(ds, row->dataset);
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
	if (row->dataset > ds->last_dataset)
		ds->last_dataset = row->dataset;
	if (!r && !stays)
		r = catalogue_drop_push(ds->core->p.catalogue, row->id, NULL, NULL, err);
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
static int sweep_all(struct datasets *ds, struct err *err)
{
	struct dataset **at = &ds->first, *d;
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
		if (io->unlinkat(ds->core->datafd, name, AT_REMOVEDIR) != 0)
			r = err_sys(err, errno, "cannot remove the folder of a dataset");
		else
			r = catalogue_drop_dataset(ds->core->p.catalogue, d->id, NULL, NULL, err);
		gone = true;
		*at = d->next;
		dataset_free(d);
	}
	/* Rows go when the catalogue starts, by which time folders cannot come back. */
	return !r && gone ? io_sync(ds->core->datafd, "the folder of datasets", err) : r;
}

struct orphans {
	struct datasets *datasets;
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
	if (dataset_loaded(o->datasets, id))
		return 0;
	log_event(LOG_EVENT_DATASET_GONE, NULL, "the folder of dataset number %llu, which was removed, goes",
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
