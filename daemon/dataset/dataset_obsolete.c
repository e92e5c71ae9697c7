/*
 * Removal of files that a newer manifest does not name.
 *
 * The model: the loop resolves the name of a manifest, then a worker opens it and its segments. An open file stays valid when its
 * name is removed. So obsolete files are removed when nobody is between these two steps: no run that opens the dataset, and
 * nobody between dataset_read_begin and dataset_read_end, as are runs that open segments again (grid_reopens). Until the removal
 * is durable, a row in the catalogue (as of a push) makes the next start sweep the folder. Without such a row the files stay
 * until another one makes a start sweep.
 */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "io.h"
#include "dataset_priv.h"
#include "log.h"

struct dataset_obsolete {
	struct sched_task task;
	struct dataset_obsolete *next;
	struct dataset *dataset;
	uint64_t push; /* its row is dropped with the files; 0: none */
	bool failed;
	size_t n, cap;
	char name[][64];
};

/* ---- the list ---- */

struct dataset_obsolete *dataset_obsolete_new(size_t names)
{
	struct dataset_obsolete *o = calloc(1, sizeof *o + names * sizeof o->name[0]);

	if (o)
		o->cap = names;
	return o;
}

struct dataset_obsolete *dataset_obsolete_free(struct dataset_obsolete *o)
{
	free(o);
	return NULL;
}

void dataset_obsolete_add(struct dataset_obsolete *o, const char *name)
{
	assert(o->n < o->cap && strlen(name) < sizeof o->name[0]);
	memcpy(o->name[o->n++], name, strlen(name) + 1);
}

/* ---- removal ---- */

static void obsolete_run(struct sched_task *t)
{
	struct dataset_obsolete *o = (struct dataset_obsolete *)t;
	struct err err = ERR_INIT;
	int r = dataset_open(o->dataset, &err);

	if (!r) {
		for (size_t i = 0; !r && i < o->n; i++)
			r = io_remove(o->dataset->dirfd, o->name[i], &err);
		/* The row is dropped only when the removal is durable. */
		if (!r)
			r = io_sync(o->dataset->dirfd, "the folder of a dataset", &err);
		dataset_close(o->dataset);
	}
	o->failed = r != 0;
	if (r)
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "old segments of a merge or prune stay until the next start", &err);
}

static void obsolete_done(struct sched_task *t)
{
	struct dataset_obsolete *o = (struct dataset_obsolete *)t;
	struct datasets *ds = o->dataset->datasets;

	core_background_done(ds->core);
	if (t->ran && !o->failed && o->push)
		datasets_drop_push(ds, o->push);
	dataset_release(o->dataset);
	dataset_obsolete_free(o);
}

static void obsolete_start(struct dataset_obsolete *o)
{
	struct datasets *ds = o->dataset->datasets;

	o->task = (struct sched_task){
		.run = obsolete_run, .done = obsolete_done, .owner = {.uid = o->dataset->uid}, .priority = SCHED_LAST};
	core_background(ds->core, &o->task);
}

void dataset_obsolete_queue(struct dataset_obsolete *o, struct dataset *d, uint64_t push)
{
	THREAD_LOOP_ONLY();
	o->dataset = dataset_hold(d);
	o->push = push;
	o->next = d->datasets->obsolete;
	d->datasets->obsolete = o;
}

void dataset_obsolete_settle(struct datasets *ds)
{
	struct dataset_obsolete **at = &ds->obsolete, *o;

	while ((o = *at)) {
		if (dataset_is_read(o->dataset)) {
			at = &o->next;
			continue;
		}
		*at = o->next;
		obsolete_start(o);
	}
}

void dataset_obsolete_free_all(struct datasets *ds)
{
	struct dataset_obsolete *o;

	while ((o = ds->obsolete)) {
		ds->obsolete = o->next;
		dataset_obsolete_free(o);
	}
}
