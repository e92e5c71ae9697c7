/*
 * Datasets that exist before their first push, with what that push has to respect: a scale, a coordinate system.
 *
 * The model: such a dataset is a row without a generation whose lattice is "scale XY Z", with "-" for what the inputs choose. It
 * becomes a usual dataset with its first push. What it does not define (often the heights) is open until then.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "crs.h"
#include "decimal.h"
#include "mode.h"
#include "dataset_priv.h"

struct creation {
	struct dataset *dataset;
	void (*created)(void *token, const struct err *why);
	void *token;
};

bool dataset_created(const struct dataset *d)
{
	return !d->generation && !strncmp(d->lattice, "scale ", 6);
}

static int check_scale(const char *text, const char *field, struct err *err)
{
	struct decimal d;

	if (!*text || (decimal_parse(text, &d) && d.mantissa > 0 && strlen(text) < DECIMAL_TEXT_SIZE))
		return 0;
	err_set(err, ERR_USAGE, "\"%.40s\" is not a scale: a decimal above zero is wanted", text);
	return err_add_place(err, ERR_NO_OFFSET, field);
}

static int create(struct datasets *ds, const struct dataset_create_params *w, struct dataset **ret, struct err *err)
{
	char lattice[2 * DECIMAL_TEXT_SIZE + 16];
	struct crs_info crs;
	struct dataset *d;
	int r;

	r = dataset_name_check(w->name, err);
	if (!r && dataset_find(ds, w->name, &w->peer))
		r = err_set(err, ERR_CONFLICT, "there is a dataset %s already", w->name);
	crs_info_clear(&crs);
	if (!r && *w->crs)
		r = crs_assume_text(w->crs, strlen(w->crs), &crs, err);
	if (!r)
		r = check_scale(w->scale_xy, "scale_xy", err);
	if (!r)
		r = check_scale(w->scale_z, "scale_z", err);
	if (r)
		return r;
	r = dataset_limit(ds, &w->peer, err);
	if (r)
		return r;
	d = dataset_new(ds, w->name, &w->peer, false, err);
	if (!d)
		return -(int)err->code;
	d->mode = w->has_mode ? w->mode & MODE_ALL : DATASET_MODE;
	dataset_hold(d);
	snprintf(lattice, sizeof lattice, "scale %s %s", *w->scale_xy ? w->scale_xy : "-", *w->scale_z ? w->scale_z : "-");
	if (!dataset_set_text(&d->crs, crs.text) || !dataset_set_text(&d->unit_xy, crs.unit_xy) ||
	    !dataset_set_text(&d->unit_z, crs.unit_z) || !dataset_set_text(&d->lattice, lattice)) {
		dataset_set_text(&d->lattice, "");
		dataset_release(d);
		return err_set(err, ERR_NOMEM, "no memory for a dataset");
	}
	*ret = d;
	return 0;
}

static void creation_finish(struct creation *c, const struct err *why)
{
	/* Without its row the dataset does not exist. */
	if (why)
		c->dataset->lattice[0] = 0;
	else
		c->dataset->has_row = true;
	if (!why)
		log_event(LOG_EVENT_DATASET_MADE, ABOUT_DATASET(c->dataset), "the dataset %s was made by user %u",
			  c->dataset->name, c->dataset->uid);
	dataset_release(c->dataset);
	c->created(c->token, why);
	free(c);
}

static void row_written(void *ctx, int r, const struct err *why)
{
	creation_finish(ctx, r ? why : NULL);
}

void dataset_create(struct datasets *ds, const struct dataset_create_params *w,
		    void (*created)(void *token, const struct err *why), void *token)
{
	struct creation *c = calloc(1, sizeof *c);
	struct catalogue_dataset row;
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (!c)
		err_set(&err, ERR_NOMEM, "no memory for a request");
	else if (ds->core->stopping)
		err_set(&err, ERR_BUSY, "the daemon is stopping");
	if (err.code || create(ds, w, &c->dataset, &err)) {
		free(c);
		created(token, &err);
		return;
	}
	c->created = created;
	c->token = token;
	dataset_row(c->dataset, &row);
	if (catalogue_put_dataset(ds->core->p.catalogue, &row, 0, row_written, c, &err))
		creation_finish(c, &err);
}
