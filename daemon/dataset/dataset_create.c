/*
 * Datasets that come to be before their first push, with what that push has to keep to: a scale, a coordinate
 * system.
 *
 * The model: such a dataset is a row without a generation whose lattice says "scale XY Z", "-" for what the inputs
 * choose. It stays until its first push makes it like all others. What it does not say (heights, often) is
 * open until then.
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

static bool set(char **to, const char *text)
{
	char *copy = strdup(text);

	if (!copy)
		return false;
	free(*to);
	*to = copy;
	return true;
}

static int make(struct datasets *ds, const struct dataset_wish *w, struct dataset **ret, struct err *err)
{
	char lattice[2 * DECIMAL_TEXT_SIZE + 16];
	struct crs_info crs;
	struct dataset *d;
	int r = 0;

	if (!dataset_name_valid(w->name)) {
		err_set(err, ERR_USAGE, "\"%.80s\" cannot name a dataset", w->name);
		return err_add_hint(err, "use up to %d letters, digits, '_', '-' and '.', not starting with '.' or '-'",
				    DATASET_NAME_MAX);
	}
	if (dataset_find(ds, w->name, &w->peer))
		return err_set(err, ERR_CONFLICT, "there is a dataset %s already", w->name);
	crs_info_clear(&crs);
	if (*w->crs)
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
	if (!set(&d->crs, crs.text) || !set(&d->unit_xy, crs.unit_xy) || !set(&d->unit_z, crs.unit_z) ||
	    !set(&d->lattice, lattice)) {
		set(&d->lattice, "");
		dataset_release(d);
		return err_set(err, ERR_NOMEM, "no memory for a dataset");
	}
	*ret = d;
	return 0;
}

static void finish(struct creation *c, const struct err *why)
{
	/* What is not on disk never was. */
	if (why)
		c->dataset->lattice[0] = 0;
	else
		c->dataset->row = true;
	if (!why)
		log_event(LOG_EVENT_DATASET_MADE, ABOUT_DATASET(c->dataset), "the dataset %s was made by user %u",
			  c->dataset->name, c->dataset->uid);
	dataset_release(c->dataset);
	c->created(c->token, why);
	free(c);
}

static void row_done(void *ctx, int r, const struct err *why)
{
	finish(ctx, r ? why : NULL);
}

void dataset_create(struct datasets *ds, const struct dataset_wish *w, void (*created)(void *token, const struct err *why),
		    void *token)
{
	struct creation *c = calloc(1, sizeof *c);
	struct catalogue_dataset row;
	struct err err = ERR_INIT;

	if (!c)
		err_set(&err, ERR_NOMEM, "no memory for a request");
	else if (ds->core->stopping)
		err_set(&err, ERR_BUSY, "the daemon is stopping");
	if (err.code || make(ds, w, &c->dataset, &err)) {
		free(c);
		created(token, &err);
		return;
	}
	c->created = created;
	c->token = token;
	dataset_row(c->dataset, &row);
	if (catalogue_put_dataset(ds->core->p.catalogue, &row, 0, row_done, c, &err))
		finish(c, &err);
}
