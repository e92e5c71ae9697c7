/* Requirements of a dataset that dataset_create made for its first push: a scale, a coordinate system. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "decimal.h"
#include "push_priv.h"

static int require_scale(struct push *p, char **mine, const char *wanted, struct err *err)
{
	struct decimal a, b;

	if (!strcmp(wanted, "-"))
		return 0;
	if (!**mine) {
		char *copy = strdup(wanted);

		if (!copy)
			return err_set(err, ERR_NOMEM, "no memory for a push");
		free(*mine);
		*mine = copy;
		return 0;
	}
	if (decimal_parse(*mine, &a) && decimal_parse(wanted, &b) && !decimal_compare(a, b))
		return 0;
	err_set(err, ERR_USAGE, "the dataset %s was created with the scale %s", p->dataset->name, wanted);
	return err_add_hint(err, "leave the scale out, or push into a new dataset");
}

int push_created_scale(struct push *p, struct err *err)
{
	char xy[DECIMAL_TEXT_SIZE], z[DECIMAL_TEXT_SIZE];
	int r;

	if (!dataset_created(p->dataset))
		return 0;
	if (sscanf(p->dataset->lattice, "scale %47s %47s", xy, z) != 2)
		return err_set(err, ERR_CORRUPT, "the catalogue has \"%.60s\" as a lattice", p->dataset->lattice);
	r = require_scale(p, &p->agree.scale_xy, xy, err);
	return r ? r : require_scale(p, &p->agree.scale_z, z, err);
}

static int require_text(const struct push *p, const char *what, const char *wanted, const char *got, struct err *err)
{
	if (!*wanted || !strcmp(wanted, "unknown") || !strcmp(wanted, got))
		return 0;
	err_set(err, ERR_INPUT, "%s is %.100s, but the dataset %s was created with %.100s", what, got, p->dataset->name, wanted);
	err_add_hint(err, strcmp(got, "unknown") ?
				  "push into a dataset of that coordinate system, or override what the file says with "
				  "--override-crs and --override-units" :
				  "say with --assume-crs that it is that, where no record says so");
	return err_add_file(err, p->agree.crs_of);
}

int push_created_crs(const struct push *p, struct err *err)
{
	const struct dataset *d = p->dataset;
	char plane[CRS_TEXT_SIZE];
	int r;

	if (!dataset_created(d) || !p->agree.has_crs)
		return 0;
	/* A dataset that was created without heights accepts any. */
	crs_text_plane(p->agree.crs, plane);
	r = require_text(p, "its coordinate system", d->crs, crs_text_heights(d->crs) ? p->agree.crs : plane, err);
	if (!r)
		r = require_text(p, "the unit of its x and y", d->unit_xy, p->agree.unit_xy, err);
	return r ? r : require_text(p, "the unit of its z", d->unit_z, p->agree.unit_z, err);
}
