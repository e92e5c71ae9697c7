/*
 * Whether the inputs of a dataset go together: coordinate system and units.
 *
 * The model: what an input says, filled up with what the push assumes for inputs that say nothing, is its
 * system. Within a dataset all systems must be one: same texts, same units, and where two records define what
 * they name, the same definition. Known beside unknown is a difference like any other, so whether a set is
 * refused does not depend on its order. Nobody's word is overridden: an assumption that contradicts an input
 * refuses that input. Meshing needs no unit: a dataset that is unknown throughout is taken as it is.
 */
#include <stdio.h>
#include <string.h>

#include "push_priv.h"

static bool known(const char *text)
{
	return *text && strcmp(text, "unknown");
}

/* ---- what is assumed ---- */

static int read_unit(const char *text, const char *field, const char *alike, char ret[CRS_UNIT_SIZE], struct err *err)
{
	const char *unit = crs_assume_unit(text);

	if (!*text)
		return 0;
	if (!unit) {
		err_set(err, ERR_USAGE, "\"%.40s\" is not a unit: m, ft or ftUS", text);
		return err_add_place(err, ERR_NO_OFFSET, field);
	}
	if (known(ret) && strcmp(ret, unit)) {
		err_set(err, ERR_USAGE, "the unit of %s is to be assumed as %s, but %.60s has it in %s", alike, unit,
			"the coordinate system to assume", ret);
		return err_add_place(err, ERR_NO_OFFSET, field);
	}
	snprintf(ret, CRS_UNIT_SIZE, "%s", unit);
	return 0;
}

int push_assume_read(struct push *p, const struct push_params *in, struct err *err)
{
	const char *crs = in->assume_crs ? in->assume_crs : "";
	const char *xy = in->assume_unit_xy ? in->assume_unit_xy : "", *z = in->assume_unit_z ? in->assume_unit_z : "";
	int r = 0;

	crs_info_clear(&p->assume);
	if (*crs)
		r = crs_assume_text(crs, strlen(crs), &p->assume, err);
	if (!r)
		r = read_unit(xy, "assume_unit_xy", "x and y", p->assume.unit_xy, err);
	if (!r)
		r = read_unit(z, "assume_unit_z", "z", p->assume.unit_z, err);
	if (!r)
		crs_info_settle(&p->assume);
	p->assumes = *crs || *xy || *z;
	return r;
}

/* ---- what an input says, and what is assumed for it ---- */

/* The two halves of a text; heights that it does not name are "unknown". */
static void halves(const char *text, char ret_plane[CRS_TEXT_SIZE], const char **ret_heights)
{
	const char *heights = crs_text_heights(text);

	crs_text_plane(text, ret_plane);
	*ret_heights = heights ? heights + 3 : "unknown";
}

static int contradicts(const char *name, const char *what, const char *says, const char *assumed, const char *option,
		       struct err *err)
{
	err_set(err, ERR_INPUT, "%s is %.100s by its own records, and %s assumes %.100s", what, says, option, assumed);
	err_add_hint(err, "leave %s out for this file: what a file says is not overridden", option);
	return err_add_file(err, name);
}

static int assume_unit(const char *name, const char *what, char mine[CRS_UNIT_SIZE], const char *assumed, const char *option,
		       struct err *err)
{
	if (!known(assumed) || !strcmp(mine, assumed))
		return 0;
	if (known(mine))
		return contradicts(name, what, mine, assumed, option, err);
	snprintf(mine, CRS_UNIT_SIZE, "%s", assumed);
	return 0;
}

/* A plane that the input does not know of itself: what its reader would have said of it. */
static int check_plane(const char *name, const struct crs_info *info, struct err *err)
{
	if (info->plane == CRS_PLANE_GEOCENTRIC) {
		err_set(err, ERR_UNSUPPORTED,
			"its coordinates are geocentric (%.200s): no terrain stands on the plane of "
			"x and y",
			info->text);
		err_add_hint(err, "project it to a plane first; --planar takes x and y as they are");
	} else {
		return 0;
	}
	return err_add_file(err, name);
}

int push_assume(const struct push *p, const char *name, struct crs_info *info, struct err *err)
{
	const struct crs_info *a = &p->assume;
	char plane[CRS_TEXT_SIZE], assumed_plane[CRS_TEXT_SIZE], text[CRS_TEXT_SIZE] = "";
	const char *heights, *assumed_heights, *option = known(a->text) ? "--assume-crs" : "--assume-units";
	struct crs_info made = *info;
	int r = 0;

	if (!p->assumes)
		return 0;
	halves(info->text, plane, &heights);
	halves(a->text, assumed_plane, &assumed_heights);
	if (known(plane) && known(assumed_plane) && strcmp(plane, assumed_plane))
		return contradicts(name, "its coordinate system", plane, assumed_plane, option, err);
	if (known(heights) && known(assumed_heights) && strcmp(heights, assumed_heights))
		return contradicts(name, "its vertical system", heights, assumed_heights, option, err);
	if (!known(plane) && known(assumed_plane)) {
		if (made.plane != CRS_PLANE_UNKNOWN && a->plane != CRS_PLANE_UNKNOWN && made.plane != a->plane)
			return contradicts(name, "the kind of its plane", "another", assumed_plane, option, err);
		if (a->plane != CRS_PLANE_UNKNOWN)
			made.plane = a->plane;
		made.system = a->system;
		made.system.epsg_z = info->system.epsg_z;
		snprintf(plane, sizeof plane, "%s", assumed_plane);
	}
	if (!known(heights) && known(assumed_heights)) {
		heights = assumed_heights;
		made.system.epsg_z = a->system.epsg_z;
	}
	r = assume_unit(name, "the unit of its x and y", made.unit_xy, a->unit_xy, option, err);
	if (!r)
		r = assume_unit(name, "the unit of its z", made.unit_z, a->unit_z, option, err);
	if (r)
		return r;
	snprintf(text, sizeof text, "%.250s%s%.250s", plane, known(heights) ? " + " : "", known(heights) ? heights : "");
	memcpy(made.text, text, sizeof made.text);
	crs_info_settle(&made);
	r = info->plane == made.plane || p->planar ? 0 : check_plane(name, &made, err);
	if (!r)
		*info = made;
	return r;
}

/* ---- do they go together ---- */

struct difference {
	const char *what, *mine, *theirs;
	const char *option; /* that would say what is unknown */
};

static bool differ(const char *what, const char *mine, const char *theirs, const char *option, struct difference *ret)
{
	if (!known(mine))
		mine = "unknown";
	if (!known(theirs))
		theirs = "unknown";
	*ret = (struct difference){what, mine, theirs, option};
	return strcmp(mine, theirs) != 0;
}

static int refuse(const struct difference *d, const char *name, const char *other, struct err *err)
{
	err_set(err, ERR_INPUT, "%s is %.100s, but that of %.200s is %.100s", d->what, d->mine, other, d->theirs);
	if (!d->option)
		err_add_hint(err, "they have one name and different definitions; convert one of them first");
	else if (known(d->mine) && known(d->theirs))
		err_add_hint(err, "a dataset has one coordinate system: convert one of them, or use two datasets");
	else
		err_add_hint(err, "say what it is where no record says so, with %s", d->option);
	return err_add_file(err, name);
}

static bool texts_differ(const struct crs_info *a, const char *crs, const char *unit_xy, const char *unit_z,
			 struct difference *ret)
{
	return differ("its coordinate system", a->text, crs, "--assume-crs", ret) ||
	       differ("the unit of its x and y", a->unit_xy, unit_xy, "--assume-units", ret) ||
	       differ("the unit of its z", a->unit_z, unit_z, "--assume-units", ret);
}

static bool definitions_differ(const struct crs_info *a, const struct crs_info *b)
{
	return (a->plane != b->plane && a->plane != CRS_PLANE_UNKNOWN && b->plane != CRS_PLANE_UNKNOWN) ||
	       (a->system.method != CRS_METHOD_UNKNOWN && b->system.method != CRS_METHOD_UNKNOWN &&
		!crs_system_same(&a->system, &b->system));
}

/* Of two inputs that do not go together, the one that sorts first is told about: the sentence is the same in
 * whatever order they came. */
static int refuse_pair(const char *a, const struct crs_info *ca, const char *b, const struct crs_info *cb, struct err *err)
{
	static const struct difference definition = {"the definition of its coordinate system", "one thing", "another", NULL};
	struct difference d;

	if (strcmp(a, b) > 0)
		return refuse_pair(b, cb, a, ca, err);
	if (!texts_differ(ca, cb->text, cb->unit_xy, cb->unit_z, &d))
		d = definition;
	return refuse(&d, a, b, err);
}

int push_compatible(struct push *p, const char *name, const struct crs_info *crs, struct err *err)
{
	struct difference d;

	if (!p->has_crs || !texts_differ(crs, p->crs, p->unit_xy, p->unit_z, &d))
		return 0;
	return refuse(&d, name, p->crs_of, err);
}

static void decide(struct push *p, const char *text, const char *unit_xy, const char *unit_z, const char *of)
{
	snprintf(p->crs, sizeof p->crs, "%s", known(text) ? text : "unknown");
	snprintf(p->unit_xy, sizeof p->unit_xy, "%s", known(unit_xy) ? unit_xy : "unknown");
	snprintf(p->unit_z, sizeof p->unit_z, "%s", known(unit_z) ? unit_z : "unknown");
	snprintf(p->crs_of, sizeof p->crs_of, "%s", of);
	p->has_crs = true;
}

void push_crs_of_dataset(struct push *p, const char *text, const char *unit_xy, const char *unit_z)
{
	char of[sizeof p->crs_of];

	snprintf(of, sizeof of, "the dataset %s", p->dataset->name);
	decide(p, text, unit_xy, unit_z, of);
}

int push_crs_agree(struct push *p, struct err *err)
{
	const struct push_probed *first = NULL;
	struct difference d;
	int r = 0;

	for (size_t i = 0; !r && i < p->nprobes; i++) {
		const struct push_probed *one = &p->probes[i];

		if (one->why)
			continue;
		if (p->has_crs) {
			r = push_compatible(p, one->name, one->plane, err);
			continue;
		}
		if (!first)
			first = one;
		if (texts_differ(one->plane, first->plane->text, first->plane->unit_xy, first->plane->unit_z, &d) ||
		    definitions_differ(one->plane, first->plane))
			r = refuse_pair(one->name, one->plane, first->name, first->plane, err);
	}
	if (!r && first)
		decide(p, first->plane->text, first->plane->unit_xy, first->plane->unit_z, first->name);
	return r;
}
