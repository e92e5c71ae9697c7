/*
 * Coordinate systems and units: do the inputs of a dataset agree?
 *
 * The model: the system of an input comes from its records; what they lack is completed by the assumptions of the push. All
 * systems in a dataset must be the same: same texts, same units, and where two records define the system, the same definition.
 * Known and unknown differ, so whether a set of files is refused does not depend on their order.
 *
 * Systems of EPSG are an exception: the number implies the units, also where an older table did not have them. So a unit that an
 * input or the dataset leaves unknown does not count as a difference.
 *
 * An assumption that contradicts an input refuses the input. An override replaces what the input says, and the source records
 * what that was. Meshing needs no unit: a dataset without any is accepted.
 */
#include <stdio.h>
#include <string.h>

#include "push_priv.h"

/* ---- assumptions and overrides of the push ---- */

static int read_unit(const char *text, const char *field, const char *alike, char ret[CRS_UNIT_SIZE], struct err *err)
{
	const char *unit = crs_assume_unit(text);

	if (!*text)
		return 0;
	if (!unit) {
		err_set(err, ERR_USAGE, "\"%.40s\" is not a unit: m, ft or ftUS", text);
		return err_add_place(err, ERR_NO_OFFSET, field);
	}
	if (push_crs_known(ret) && strcmp(ret, unit)) {
		err_set(err, ERR_USAGE, "the unit of %s is to be %s, but the coordinate system that is given has it in %s", alike,
			unit, ret);
		return err_add_place(err, ERR_NO_OFFSET, field);
	}
	snprintf(ret, CRS_UNIT_SIZE, "%s", unit);
	return 0;
}

static const char *text_of(const char *text)
{
	return text ? text : "";
}

static int read_system(const char *const words[3], const char *const fields[3], struct crs_info *ret, struct err *err)
{
	int r = 0;

	crs_info_clear(ret);
	if (*words[0])
		r = crs_assume_text(words[0], strlen(words[0]), ret, err);
	if (!r)
		r = read_unit(words[1], fields[1], "x and y", ret->unit_xy, err);
	if (!r)
		r = read_unit(words[2], fields[2], "z", ret->unit_z, err);
	if (!r)
		crs_info_settle(ret);
	return r;
}

int push_assume_read(struct push *p, const struct push_params *in, struct err *err)
{
	static const char *const assume_fields[3] = {"assume_crs", "assume_unit_xy", "assume_unit_z"};
	static const char *const override_fields[3] = {"override_crs", "override_unit_xy", "override_unit_z"};
	const char *assume[3] = {text_of(in->assume_crs), text_of(in->assume_unit_xy), text_of(in->assume_unit_z)};
	const char *override[3] = {text_of(in->override_crs), text_of(in->override_unit_xy), text_of(in->override_unit_z)};

	p->assumes = *assume[0] || *assume[1] || *assume[2];
	p->overrides = *override[0] || *override[1] || *override[2];
	if (p->assumes && p->overrides) {
		err_set(err, ERR_USAGE,
			"a system for inputs without one, and a system that replaces that of all inputs, contradict each other");
		return err_add_hint(err, "leave out --assume-crs and --assume-units: an override applies to all inputs");
	}
	if (push_wkt_given(p, p->overrides ? *override : *assume, err))
		return -(int)err->code;
	if (p->overrides)
		return read_system(override, override_fields, &p->assume, err);
	return read_system(assume, assume_fields, &p->assume, err);
}

/* ---- applied to an input ---- */

/* Divides a text at its vertical part; "unknown" if it has none. */
static void halves(const char *text, char ret_plane[CRS_TEXT_SIZE], const char **ret_heights)
{
	const char *heights = crs_text_heights(text);

	crs_text_plane(text, ret_plane);
	*ret_heights = heights ? heights + 3 : "unknown";
}

static int refuse_contradiction(const char *name, const char *what, const char *says, const char *assumed, const char *option,
				struct err *err)
{
	err_set(err, ERR_INPUT, "%s is %.100s by its own records, and %s assumes %.100s", what, says, option, assumed);
	err_add_hint(err, "leave %s out for this file, or override what it says with %s", option,
		     strcmp(option, "--assume-crs") ? "--override-units" : "--override-crs");
	return err_add_file(err, name);
}

static int assume_unit(const char *name, const char *what, char mine[CRS_UNIT_SIZE], const char *assumed, const char *option,
		       struct err *err)
{
	if (!push_crs_known(assumed) || !strcmp(mine, assumed))
		return 0;
	if (push_crs_known(mine))
		return refuse_contradiction(name, what, mine, assumed, option, err);
	snprintf(mine, CRS_UNIT_SIZE, "%s", assumed);
	return 0;
}

/* A plane that was assumed gets the check that the reader would have made. */
static int check_plane(const char *name, const struct crs_info *info, struct err *err)
{
	if (info->plane == CRS_PLANE_GEOCENTRIC) {
		err_set(err, ERR_UNSUPPORTED,
			"its coordinates are geocentric (%.200s): no terrain stands on the plane of "
			"x and y",
			info->text);
		err_add_hint(err,
			     "project it to a plane first; --planar takes x and y as they are; if that is not what they are, "
			     "name their system with --override-crs");
	} else {
		return 0;
	}
	return err_add_file(err, name);
}

static int assume_system(const struct push *p, const char *name, struct crs_info *info, struct err *err)
{
	const struct crs_info *a = &p->assume;
	char plane[CRS_TEXT_SIZE], assumed_plane[CRS_TEXT_SIZE], text[CRS_TEXT_SIZE] = "";
	const char *heights, *assumed_heights, *option = push_crs_known(a->text) ? "--assume-crs" : "--assume-units";
	struct crs_info made = *info;
	int r = 0;

	if (!p->assumes)
		return 0;
	halves(info->text, plane, &heights);
	halves(a->text, assumed_plane, &assumed_heights);
	if (push_crs_known(plane) && push_crs_known(assumed_plane) && strcmp(plane, assumed_plane))
		return refuse_contradiction(name, "its coordinate system", plane, assumed_plane, option, err);
	if (push_crs_known(heights) && push_crs_known(assumed_heights) && strcmp(heights, assumed_heights))
		return refuse_contradiction(name, "its vertical system", heights, assumed_heights, option, err);
	if (!push_crs_known(plane) && push_crs_known(assumed_plane)) {
		if (made.plane != CRS_PLANE_UNKNOWN && a->plane != CRS_PLANE_UNKNOWN && made.plane != a->plane)
			return refuse_contradiction(name, "the kind of its plane", "another", assumed_plane, option, err);
		if (a->plane != CRS_PLANE_UNKNOWN)
			made.plane = a->plane;
		made.system = a->system;
		made.system.epsg_z = info->system.epsg_z;
		snprintf(plane, sizeof plane, "%s", assumed_plane);
	}
	if (!push_crs_known(heights) && push_crs_known(assumed_heights)) {
		heights = assumed_heights;
		made.system.epsg_z = a->system.epsg_z;
	}
	r = assume_unit(name, "the unit of its x and y", made.unit_xy, a->unit_xy, option, err);
	if (!r)
		r = assume_unit(name, "the unit of its z", made.unit_z, a->unit_z, option, err);
	if (r)
		return r;
	snprintf(text, sizeof text, "%.250s%s%.250s", plane, push_crs_known(heights) ? " + " : "",
		 push_crs_known(heights) ? heights : "");
	memcpy(made.text, text, sizeof made.text);
	crs_info_settle(&made);
	r = info->plane == made.plane || p->planar ? 0 : check_plane(name, &made, err);
	if (!r)
		*info = made;
	return r;
}

static bool same_words(const struct crs_info *a, const struct crs_info *b)
{
	return !strcmp(a->text, b->text) && !strcmp(a->unit_xy, b->unit_xy) && !strcmp(a->unit_z, b->unit_z);
}

/* An override of the system replaces all that the input says, also of heights; what it leaves open is unknown. An override of
 * units replaces only units. */
static int override_system(const struct push *p, struct push_request *rq)
{
	struct crs_info *info = &rq->info.crs;
	const struct crs_info *new = &p->assume, said = *info;

	if (push_crs_known(new->text)) {
		*info = *new;
	} else if (push_crs_known(new->unit_xy) && said.plane == CRS_PLANE_GEOGRAPHIC) {
		err_set(&rq->err, ERR_INPUT, "its coordinates are degrees by its own records (%.200s), which have no length",
			said.text);
		err_add_hint(&rq->err, "name the system that they really have with --override-crs");
		return err_add_file(&rq->err, rq->name);
	} else {
		if (push_crs_known(new->unit_xy))
			memcpy(info->unit_xy, new->unit_xy, sizeof info->unit_xy);
		if (push_crs_known(new->unit_z))
			memcpy(info->unit_z, new->unit_z, sizeof info->unit_z);
		crs_info_settle(info);
	}
	if (!same_words(info, &said) &&
	    (push_crs_known(said.text) || push_crs_known(said.unit_xy) || push_crs_known(said.unit_z)))
		snprintf(rq->overridden, sizeof rq->overridden, "%.400s, x and y in %s, z in %s", said.text, said.unit_xy,
			 said.unit_z);
	return p->planar ? 0 : check_plane(rq->name, info, &rq->err);
}

int push_assume(const struct push *p, struct push_request *rq)
{
	*rq->overridden = 0;
	if (p->overrides)
		return override_system(p, rq);
	return assume_system(p, rq->name, &rq->info.crs, &rq->err);
}

/* ---- agreement ---- */

struct difference {
	const char *what, *mine, *theirs;
	const char *option; /* that would define what is unknown; NULL: none */
};

static bool differ(const char *what, const char *mine, const char *theirs, const char *option, struct difference *ret)
{
	if (!push_crs_known(mine))
		mine = "unknown";
	if (!push_crs_known(theirs))
		theirs = "unknown";
	*ret = (struct difference){what, mine, theirs, option};
	return strcmp(mine, theirs) != 0;
}

static int refuse_difference(const struct difference *d, const char *name, const char *other, struct err *err)
{
	err_set(err, ERR_INPUT, "%s is %.100s, but that of %.200s is %.100s", d->what, d->mine, other, d->theirs);
	if (!d->option)
		err_add_hint(err, "they have one name and different definitions; convert one of them first");
	else if (push_crs_known(d->mine) && push_crs_known(d->theirs))
		err_add_hint(err,
			     "a dataset has one coordinate system: convert one of them, or use two datasets; where what a file "
			     "says is wrong, --override-crs and --override-units say what holds");
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

/* The error is about the input that sorts first, so it does not depend on the order of the inputs. */
static int refuse_pair(const char *a, const struct crs_info *ca, const char *b, const struct crs_info *cb, struct err *err)
{
	static const struct difference definition = {"the definition of its coordinate system", "one thing", "another", NULL};
	struct difference d;

	if (strcmp(a, b) > 0)
		return refuse_pair(b, cb, a, ca, err);
	if (!texts_differ(ca, cb->text, cb->unit_xy, cb->unit_z, &d))
		d = definition;
	return refuse_difference(&d, a, b, err);
}

static void fill_unit(char unit[CRS_UNIT_SIZE], const char *other)
{
	if (!push_crs_known(unit))
		snprintf(unit, CRS_UNIT_SIZE, "%s", other);
}

/* An input with the dataset's EPSG number also has its units. */
static struct crs_info as_numbered(const struct push *p, const struct crs_info *crs)
{
	static const char number[] = "EPSG:";
	struct crs_info ret = *crs;
	const char *heights = crs_text_heights(crs->text);

	if (strcmp(crs->text, p->crs))
		return ret;
	if (!strncmp(crs->text, number, strlen(number)))
		fill_unit(ret.unit_xy, p->unit_xy);
	if (heights && !strncmp(heights + 3, number, strlen(number)))
		fill_unit(ret.unit_z, p->unit_z);
	return ret;
}

int push_compatible(struct push *p, const char *name, const struct crs_info *crs, struct err *err)
{
	struct crs_info mine = as_numbered(p, crs);
	struct difference d;

	if (!p->has_crs || !texts_differ(&mine, p->crs, p->unit_xy, p->unit_z, &d))
		return 0;
	return refuse_difference(&d, name, p->crs_of, err);
}

bool push_crs_is(const struct push *p, const struct grid_manifest *m)
{
	char unit_xy[CRS_UNIT_SIZE], unit_z[CRS_UNIT_SIZE];

	snprintf(unit_xy, sizeof unit_xy, "%s", m->unit_xy);
	snprintf(unit_z, sizeof unit_z, "%s", m->unit_z);
	crs_text_units(m->crs, unit_xy, unit_z);
	return !strcmp(m->crs, p->crs) && !strcmp(unit_xy, p->unit_xy) && !strcmp(unit_z, p->unit_z);
}

static void set_system(struct push *p, const char *text, const char *unit_xy, const char *unit_z, const char *of)
{
	snprintf(p->crs, sizeof p->crs, "%s", push_crs_known(text) ? text : "unknown");
	snprintf(p->unit_xy, sizeof p->unit_xy, "%s", push_crs_known(unit_xy) ? unit_xy : "unknown");
	snprintf(p->unit_z, sizeof p->unit_z, "%s", push_crs_known(unit_z) ? unit_z : "unknown");
	snprintf(p->crs_of, sizeof p->crs_of, "%s", of);
	p->has_crs = true;
}

void push_crs_of_dataset(struct push *p, const char *text, const char *unit_xy, const char *unit_z)
{
	char of[sizeof p->crs_of];

	snprintf(of, sizeof of, "the dataset %s", p->dataset->name);
	set_system(p, text, unit_xy, unit_z, of);
	crs_text_units(p->crs, p->unit_xy, p->unit_z);
}

int push_crs_agree(struct push *p, struct err *err)
{
	const struct push_probed *first = NULL;
	struct difference d;
	int r = 0;

	for (size_t i = 0; !r && i < p->nprobes; i++) {
		const struct push_probed *one = &p->probes[i];

		if (one->excluded)
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
		set_system(p, first->plane->text, first->plane->unit_xy, first->plane->unit_z, first->name);
	return r;
}
