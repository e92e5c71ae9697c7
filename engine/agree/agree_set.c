/*
 * Coordinate systems and units: do the inputs of a dataset agree? (agree_set.h)
 *
 * The model: the system of an input comes from its records; what they lack is completed by what a person assumes. All systems in
 * a dataset must be the same: same texts, same units, and where two records define the system, the same definition. Known and
 * unknown differ, so whether a set of files is refused does not depend on their order.
 *
 * Systems of EPSG are an exception: the number implies the units, also where an older table did not have them. So a unit that an
 * input or the dataset leaves unknown does not count as a difference.
 *
 * An assumption that contradicts an input refuses the input. An override replaces what the input says, and the source records
 * what that was. Meshing needs no unit: a dataset without any is accepted.
 */
#include "agree_set.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "agree_reading.h"
#include "err.h"

/* ---- what a person says ---- */

static const char *text_of(const char *text)
{
	return text ? text : "";
}

int agree_init(struct agree *a, const struct agree_words *in, struct err *err)
{
	memset(a, 0, sizeof *a);
	a->scale_xy = strdup(text_of(in->scale_xy));
	a->scale_z = strdup(text_of(in->scale_z));
	a->utm = strdup(text_of(in->utm));
	a->geoid = strdup(text_of(in->geoid));
	a->geoid_way = strdup(text_of(in->geoid_way));
	a->planar = in->planar;
	agree_unfix(a);
	return a->scale_xy && a->scale_z && a->utm && a->geoid && a->geoid_way ?
		       0 :
		       err_set(err, ERR_NOMEM, "no memory for what was said of the inputs");
}

void agree_done(struct agree *a)
{
	free(a->scale_xy);
	free(a->scale_z);
	free(a->utm);
	free(a->geoid);
	free(a->geoid_way);
	free(a->said_wkt);
	free(a->geoid_path);
}

static int keep_wkt(struct agree *a, const char *text, struct err *err)
{
	char *normal = *text ? malloc(CRS_WKT_MAX + 1) : NULL;
	size_t n = normal ? crs_wkt_normal(text, strlen(text), normal) : 0;

	free(a->said_wkt);
	a->said_wkt = n ? strdup(normal) : NULL;
	free(normal);
	return (*text && !normal) || (n && !a->said_wkt) ? err_set(err, ERR_NOMEM, "no memory for a coordinate system") : 0;
}

static bool says(const char *const words[3])
{
	return *words[0] || *words[1] || *words[2];
}

int agree_said(struct agree *a, const struct agree_words *in, struct err *err)
{
	static const char *const fields[2][3] = {{"assume_crs", "assume_unit_xy", "assume_unit_z"},
						 {"override_crs", "override_unit_xy", "override_unit_z"}};
	const char *words[2][3];

	for (int i = 0; i < 3; i++) {
		words[0][i] = text_of(in->assume[i]);
		words[1][i] = text_of(in->override[i]);
	}
	a->assumes = says(words[0]);
	a->overrides = says(words[1]);
	if (a->assumes && a->overrides) {
		err_set(err, ERR_USAGE,
			"a system for inputs without one, and a system that replaces that of all inputs, contradict each other");
		return err_add_hint(err, "leave out --assume-crs and --assume-units: an override applies to all inputs");
	}
	if (keep_wkt(a, words[a->overrides][0], err))
		return -(int)err->code;
	return agree_read(words[a->overrides], fields[a->overrides], &a->said, err);
}

int agree_say(const struct agree *a, const char *name, struct crs_info *crs, char overridden[AGREE_OVERRIDDEN], struct err *err)
{
	*overridden = 0;
	if (a->overrides)
		return agree_override(&a->said, a->planar, name, crs, overridden, err);
	return a->assumes ? agree_assume(&a->said, a->planar, name, crs, err) : 0;
}

/* ---- one input ---- */

/* The unit to which a text's numbers are rounded. Numbers that are projected or shifted pass through doubles, and keep their
 * precision. */
static void lattice_of(const struct agree *a, bool projects, struct input_options *ret)
{
	static const struct decimal finest = {1, -9};

	ret->lattice_later = true;
	if (a->has_lattice) {
		ret->scale_xy = a->lattice.scale_xy;
		ret->scale_z = a->lattice.scale_z;
	} else if ((*a->scale_xy && !decimal_parse(a->scale_xy, &ret->scale_xy)) ||
		   (*a->scale_z && !decimal_parse(a->scale_z, &ret->scale_z))) {
		ret->scale_xy = ret->scale_z = (struct decimal){0, 0}; /* agree_lattice reports the error */
	}
	if (projects)
		ret->scale_xy = finest;
	if (*a->geoid_text)
		ret->scale_z = finest;
}

void agree_input_options(const struct agree *a, bool projects, struct input_options *ret)
{
	ret->planar = a->planar;
	ret->degrees = true;
	ret->any_plane = a->overrides;
	lattice_of(a, projects, ret);
}

/* After a projection, or a shift by a geoid, the dataset's system is not the file's. */
void agree_how_read(const struct agree *a, const char *format, const char *columns, bool decimal_comma,
		    const struct crs_info *crs, char *ret, size_t size)
{
	bool own = crs->plane == CRS_PLANE_GEOGRAPHIC || *a->geoid_text;

	agree_reading_text(format, columns, decimal_comma, own ? crs : NULL, ret, size);
}

/* ---- agreement ---- */

static void fill_unit(char unit[CRS_UNIT_SIZE], const char *other)
{
	if (!agree_known(unit))
		snprintf(unit, CRS_UNIT_SIZE, "%s", other);
}

/* An input with the dataset's EPSG number also has its units. */
static struct crs_info as_numbered(const struct agree *a, const struct crs_info *crs)
{
	static const char number[] = "EPSG:";
	struct crs_info ret = *crs;
	const char *heights = crs_text_heights(crs->text);

	if (strcmp(crs->text, a->crs))
		return ret;
	if (!strncmp(crs->text, number, strlen(number)))
		fill_unit(ret.unit_xy, a->unit_xy);
	if (heights && !strncmp(heights + 3, number, strlen(number)))
		fill_unit(ret.unit_z, a->unit_z);
	return ret;
}

static int compatible(const struct agree *a, const char *name, const struct crs_info *crs, struct err *err)
{
	struct crs_info mine = as_numbered(a, crs);
	struct agree_difference d;

	if (!a->has_crs || !agree_texts_differ(&mine, a->crs, a->unit_xy, a->unit_z, &d))
		return 0;
	return agree_refuse(&d, name, a->crs_of, err);
}

int agree_step_of(const struct agree *a, const char *name, const struct crs_info *crs, struct agree_step *ret, struct err *err)
{
	int r = agree_plane_of(a, crs, ret, err);

	return r ? r : compatible(a, name, &ret->plane, err);
}

bool agree_is(const struct agree *a, const char *crs, const char *unit_xy, const char *unit_z)
{
	char units[2][CRS_UNIT_SIZE];

	snprintf(units[0], CRS_UNIT_SIZE, "%s", unit_xy);
	snprintf(units[1], CRS_UNIT_SIZE, "%s", unit_z);
	crs_text_units(crs, units[0], units[1]);
	return !strcmp(crs, a->crs) && !strcmp(units[0], a->unit_xy) && !strcmp(units[1], a->unit_z);
}

static void set_system(struct agree *a, const char *text, const char *unit_xy, const char *unit_z, const char *of)
{
	snprintf(a->crs, sizeof a->crs, "%s", agree_known(text) ? text : "unknown");
	snprintf(a->unit_xy, sizeof a->unit_xy, "%s", agree_known(unit_xy) ? unit_xy : "unknown");
	snprintf(a->unit_z, sizeof a->unit_z, "%s", agree_known(unit_z) ? unit_z : "unknown");
	snprintf(a->crs_of, sizeof a->crs_of, "%s", of);
	a->has_crs = true;
}

void agree_fix(struct agree *a, const char *text, const char *unit_xy, const char *unit_z)
{
	char of[sizeof a->crs_of];

	snprintf(of, sizeof of, "the dataset %s", a->dataset);
	set_system(a, text, unit_xy, unit_z, of);
	crs_text_units(a->crs, a->unit_xy, a->unit_z);
	a->fixed = true;
}

void agree_unfix(struct agree *a)
{
	set_system(a, "", "", "", "");
	a->fixed = a->has_crs = a->has_lattice = false;
}

bool agree_take_up(struct agree *a, const char *crs, const char *unit_xy, const char *unit_z, const char *zone,
		   const struct lattice *lattice)
{
	set_system(a, crs, unit_xy, unit_z, "the other inputs");
	a->projects = *zone;
	a->lattice = *lattice;
	a->has_lattice = true;
	return !a->projects || crs_zone_parse(zone, &a->zone);
}

int agree_crs(struct agree *a, const struct agree_inputs *in, struct err *err)
{
	const struct agree_input *first = NULL;
	struct agree_difference d;
	int r = 0;

	for (size_t i = 0; !r && i < in->n; i++) {
		const struct agree_input *one = in->at(in->ctx, i);

		if (!one)
			continue;
		if (a->has_crs) {
			r = compatible(a, one->name, one->plane, err);
			continue;
		}
		if (!first)
			first = one;
		if (agree_texts_differ(one->plane, first->plane->text, first->plane->unit_xy, first->plane->unit_z, &d) ||
		    agree_definitions_differ(one->plane, first->plane))
			r = agree_refuse_pair(one->name, one->plane, first->name, first->plane, err);
	}
	if (!r && first)
		set_system(a, first->plane->text, first->plane->unit_xy, first->plane->unit_z, first->name);
	return r;
}
