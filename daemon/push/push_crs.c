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

static const char *text_of(const char *text)
{
	return text ? text : "";
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
		return agree_read(override, override_fields, &p->assume, err);
	return agree_read(assume, assume_fields, &p->assume, err);
}

int push_assume(const struct push *p, struct push_request *rq)
{
	*rq->overridden = 0;
	if (p->overrides)
		return agree_override(&p->assume, p->planar, rq->name, &rq->info.crs, rq->overridden, &rq->err);
	return p->assumes ? agree_assume(&p->assume, p->planar, rq->name, &rq->info.crs, &rq->err) : 0;
}

/* ---- agreement ---- */

static void fill_unit(char unit[CRS_UNIT_SIZE], const char *other)
{
	if (!agree_known(unit))
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
	struct agree_difference d;

	if (!p->has_crs || !agree_texts_differ(&mine, p->crs, p->unit_xy, p->unit_z, &d))
		return 0;
	return agree_refuse(&d, name, p->crs_of, err);
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
	snprintf(p->crs, sizeof p->crs, "%s", agree_known(text) ? text : "unknown");
	snprintf(p->unit_xy, sizeof p->unit_xy, "%s", agree_known(unit_xy) ? unit_xy : "unknown");
	snprintf(p->unit_z, sizeof p->unit_z, "%s", agree_known(unit_z) ? unit_z : "unknown");
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
	struct agree_difference d;
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
		if (agree_texts_differ(one->plane, first->plane->text, first->plane->unit_xy, first->plane->unit_z, &d) ||
		    agree_definitions_differ(one->plane, first->plane))
			r = agree_refuse_pair(one->name, one->plane, first->name, first->plane, err);
	}
	if (!r && first)
		set_system(p, first->plane->text, first->plane->unit_xy, first->plane->unit_z, first->name);
	return r;
}
