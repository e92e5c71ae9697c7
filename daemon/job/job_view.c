/* The view of a job as canonical text, made from what the client asked for. */
#include <stdlib.h>
#include <string.h>

#include "job_priv.h"

/* A view of a dataset that was read in part must lie in the part that was read. Rounding moves corners by up to a unit, and two
 * more units were read. */
static int check_partial(const struct dataset *d, const struct lattice *l, const struct view *view, struct err *err)
{
	double unit = decimal_double(l->scale_xy);
	bool inside = view->crop != VIEW_CROP_NONE;

	for (int i = 0; d->partial && inside && i < 4; i++) {
		double at = (double)view->crop_box[i] * unit;

		inside = i < 2 ? at >= d->crop[i] - unit : at <= d->crop[i] + unit;
	}
	if (!d->partial || inside)
		return 0;
	err_set(err, ERR_USAGE, "the dataset %s has only the points in the box %.15g,%.15g,%.15g,%.15g of its inputs", d->name,
		d->crop[0], d->crop[1], d->crop[2], d->crop[3]);
	return err_add_hint(err, "push them into a named dataset: it takes them whole and serves any view");
}

static int view_of(const char *text, const char *window, const struct dataset *d, char **ret, struct err *err)
{
	struct lattice lattice;
	struct view view;
	int r;

	if (!lattice_parse(d->lattice, &lattice))
		return err_set(err, ERR_INTERNAL, "the lattice of the dataset %s cannot be read", d->name);
	r = view_resolve_window(text, window, &lattice, d->unit_xy, d->unit_z, &view, err);
	if (r)
		return r;
	r = check_partial(d, &lattice, &view, err);
	*ret = r ? NULL : view_text(&view);
	view_done(&view);
	if (r)
		return r;
	return *ret ? 0 : err_set(err, ERR_NOMEM, "no memory for a view");
}

int job_view(const char *text, const struct dataset *d, char **ret, struct err *err)
{
	return view_of(text, "", d, ret, err);
}

int job_window(const struct job *job, const char *area, char **ret, struct err *err)
{
	if (!job->dataset)
		return err_set(err, ERR_GONE, "the dataset of job %llu is gone", (unsigned long long)job->id);
	if (strstr(job->view, " window="))
		return err_set(err, ERR_USAGE, "the mesh of job %llu is that of a window already", (unsigned long long)job->id);
	return view_of(job->view, area, job->dataset, ret, err);
}
