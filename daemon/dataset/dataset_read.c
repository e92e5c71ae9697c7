/*
 * Reads the newest manifest of a dataset for a list of its contents: a worker reads it, the loop passes it to the caller and
 * frees it.
 */
#include <stdlib.h>
#include <string.h>

#include "dataset_priv.h"

struct manifest_read {
	struct sched_task task;
	struct dataset *dataset;
	struct grid_manifest *manifest;
	char name[64];
	int r;
	struct err err;
	dataset_look_fn *look; /* NULL: the manifest suffices */
	dataset_read_fn *answer;
	void *token;
};

static void read_run(struct sched_task *t)
{
	struct manifest_read *x = (struct manifest_read *)t;

	x->r = dataset_open(x->dataset, &x->err);
	if (x->r)
		return;
	x->r = grid_manifest_load(x->dataset->dirfd, x->name, x->dataset->datasets->core->p.ledger, &x->manifest, &x->err);
	if (!x->r && x->look)
		x->r = x->look(x->token, x->dataset->dirfd, x->manifest, &x->err);
	dataset_close(x->dataset);
}

static void read_done(struct sched_task *t)
{
	struct manifest_read *x = (struct manifest_read *)t;
	struct dataset *d = x->dataset;
	struct datasets *ds = d->datasets;

	core_background_done(ds->core);
	dataset_read_end(d);
	if (!t->ran)
		x->r = err_set(&x->err, ERR_BUSY, "the daemon is stopping");
	x->answer(x->token, x->r ? &x->err : NULL, d, x->manifest);
	grid_manifest_free(x->manifest);
	uncharge(ds->core, sizeof *x);
	dataset_release(d);
	free(x);
}

void dataset_read(struct dataset *d, const struct peer *peer, dataset_read_fn *answer, void *token)
{
	dataset_look(d, peer, NULL, answer, token);
}

void dataset_look(struct dataset *d, const struct peer *peer, dataset_look_fn *look, dataset_read_fn *answer, void *token)
{
	struct datasets *ds = d->datasets;
	struct manifest_read *x = NULL;
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (!*d->manifest) {
		answer(token, NULL, d, NULL);
		return;
	}
	if (!charge(ds->core, sizeof *x, "a list", &err) && !(x = calloc(1, sizeof *x))) {
		uncharge(ds->core, sizeof *x);
		err_set(&err, ERR_NOMEM, "no memory for a list");
	}
	if (!x) {
		answer(token, &err, d, NULL);
		return;
	}
	x->task = (struct sched_task){.run = read_run,
				      .done = read_done,
				      .priority = SCHED_FIRST,
				      .owner = {.uid = peer->uid, .flow = ++ds->core->last_flow}};
	x->dataset = dataset_hold(d);
	x->err = ERR_INIT;
	x->look = look;
	x->answer = answer;
	x->token = token;
	memcpy(x->name, d->manifest, sizeof x->name);
	dataset_read_begin(d);
	core_background(ds->core, &x->task);
}
