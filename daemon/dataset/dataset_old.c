/*
 * Files that a newer manifest does not name any more.
 *
 * The model: a manifest is opened by name, and then the segments that it names; what is open stays good whatever becomes
 * of the name. So old files go when nobody is between taking the name and having opened all: neither a run that opens,
 * nor whoever said so by dataset_read_begin. A row of the catalogue (that of a push) says as long as they are there that
 * the next start is to look for what no manifest names; without one they stay until something else makes it look.
 */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "io.h"
#include "dataset_priv.h"
#include "log.h"

struct dataset_old {
	struct sched_task task;
	struct dataset_old *next;
	struct dataset *dataset;
	uint64_t row;
	bool failed;
	size_t n, room;
	char name[][64];
};

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

/* ---- the list ---- */

struct dataset_old *dataset_old_new(size_t names)
{
	struct dataset_old *o = calloc(1, sizeof *o + names * sizeof o->name[0]);

	if (o)
		o->room = names;
	return o;
}

struct dataset_old *dataset_old_free(struct dataset_old *o)
{
	free(o);
	return NULL;
}

void dataset_old_add(struct dataset_old *o, const char *name)
{
	assert(o->n < o->room && strlen(name) < sizeof o->name[0]);
	memcpy(o->name[o->n++], name, strlen(name) + 1);
}

/* ---- removing ---- */

static void old_run(struct sched_task *t)
{
	struct dataset_old *o = (struct dataset_old *)t;
	struct err err = ERR_INIT;
	int r = dataset_open(o->dataset, &err);

	if (!r) {
		for (size_t i = 0; !r && i < o->n; i++)
			r = io_remove(o->dataset->dirfd, o->name[i], &err);
		/* The row goes only when they cannot come back. */
		if (!r)
			r = io_sync(o->dataset->dirfd, "the folder of a dataset", &err);
		dataset_close(o->dataset);
	}
	o->failed = r != 0;
	if (r)
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "what was merged or pruned is removed again at the next start", &err);
}

static void old_done(struct sched_task *t)
{
	struct dataset_old *o = (struct dataset_old *)t;
	struct datasets *ds = o->dataset->datasets;
	struct err err = ERR_INIT;

	core_background_done(ds->core);
	if (t->ran && !o->failed && o->row && catalogue_drop_push(ds->core->p.catalogue, o->row, NULL, NULL, &err))
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL, "the catalogue", &err);
	dataset_release(o->dataset);
	dataset_old_free(o);
}

static void go(struct dataset_old *o)
{
	struct datasets *ds = o->dataset->datasets;

	o->task =
		(struct sched_task){.run = old_run, .done = old_done, .owner = {.uid = o->dataset->uid}, .priority = SCHED_LAST};
	core_background(ds->core, &o->task);
}

void dataset_old_goes(struct dataset_old *o, struct dataset *d, uint64_t row)
{
	THREAD_LOOP_ONLY();
	o->dataset = dataset_hold(d);
	o->row = row;
	o->next = d->datasets->olds;
	d->datasets->olds = o;
}

void dataset_old_settle(struct datasets *ds)
{
	struct dataset_old **at = &ds->olds, *o;

	while ((o = *at)) {
		if (dataset_is_read(o->dataset)) {
			at = &o->next;
			continue;
		}
		*at = o->next;
		go(o);
	}
}

void dataset_old_forget(struct datasets *ds)
{
	struct dataset_old *o;

	while ((o = ds->olds)) {
		ds->olds = o->next;
		dataset_old_free(o);
	}
}
