/*
 * What a person says of an input: a system for inputs that say none, or one that takes the place of what they say.
 *
 * The model: an assumption completes what the records of an input lack, and one that contradicts them refuses the input. An
 * override replaces what they say.
 */
#include "agree.h"

#include <stdio.h>
#include <string.h>

#include "err.h"

static int read_unit(const char *text, const char *field, const char *alike, char ret[CRS_UNIT_SIZE], struct err *err)
{
	const char *unit = crs_assume_unit(text);

	if (!*text)
		return 0;
	if (!unit) {
		err_set(err, ERR_USAGE, "\"%.40s\" is not a unit: m, ft or ftUS", text);
		return err_add_place(err, ERR_NO_OFFSET, field);
	}
	if (agree_known(ret) && strcmp(ret, unit)) {
		err_set(err, ERR_USAGE, "the unit of %s is to be %s, but the coordinate system that is given has it in %s", alike,
			unit, ret);
		return err_add_place(err, ERR_NO_OFFSET, field);
	}
	snprintf(ret, CRS_UNIT_SIZE, "%s", unit);
	return 0;
}

int agree_read(const char *const words[3], const char *const fields[3], struct crs_info *ret, struct err *err)
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
	if (!agree_known(assumed) || !strcmp(mine, assumed))
		return 0;
	if (agree_known(mine))
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

int agree_assume(const struct crs_info *a, bool planar, const char *name, struct crs_info *info, struct err *err)
{
	char plane[CRS_TEXT_SIZE], assumed_plane[CRS_TEXT_SIZE], text[CRS_TEXT_SIZE] = "";
	const char *heights, *assumed_heights, *option = agree_known(a->text) ? "--assume-crs" : "--assume-units";
	struct crs_info made = *info;
	int r = 0;

	halves(info->text, plane, &heights);
	halves(a->text, assumed_plane, &assumed_heights);
	if (agree_known(plane) && agree_known(assumed_plane) && strcmp(plane, assumed_plane))
		return refuse_contradiction(name, "its coordinate system", plane, assumed_plane, option, err);
	if (agree_known(heights) && agree_known(assumed_heights) && strcmp(heights, assumed_heights))
		return refuse_contradiction(name, "its vertical system", heights, assumed_heights, option, err);
	if (!agree_known(plane) && agree_known(assumed_plane)) {
		if (made.plane != CRS_PLANE_UNKNOWN && a->plane != CRS_PLANE_UNKNOWN && made.plane != a->plane)
			return refuse_contradiction(name, "the kind of its plane", "another", assumed_plane, option, err);
		if (a->plane != CRS_PLANE_UNKNOWN)
			made.plane = a->plane;
		made.system = a->system;
		made.system.epsg_z = info->system.epsg_z;
		snprintf(plane, sizeof plane, "%s", assumed_plane);
	}
	if (!agree_known(heights) && agree_known(assumed_heights)) {
		heights = assumed_heights;
		made.system.epsg_z = a->system.epsg_z;
	}
	r = assume_unit(name, "the unit of its x and y", made.unit_xy, a->unit_xy, option, err);
	if (!r)
		r = assume_unit(name, "the unit of its z", made.unit_z, a->unit_z, option, err);
	if (r)
		return r;
	snprintf(text, sizeof text, "%.250s%s%.250s", plane, agree_known(heights) ? " + " : "",
		 agree_known(heights) ? heights : "");
	memcpy(made.text, text, sizeof made.text);
	crs_info_settle(&made);
	r = info->plane == made.plane || planar ? 0 : check_plane(name, &made, err);
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
int agree_override(const struct crs_info *new, bool planar, const char *name, struct crs_info *info,
		   char overridden[AGREE_OVERRIDDEN], struct err *err)
{
	const struct crs_info said = *info;

	if (agree_known(new->text)) {
		*info = *new;
	} else if (agree_known(new->unit_xy) && said.plane == CRS_PLANE_GEOGRAPHIC) {
		err_set(err, ERR_INPUT, "its coordinates are degrees by its own records (%.200s), which have no length",
			said.text);
		err_add_hint(err, "name the system that they really have with --override-crs");
		return err_add_file(err, name);
	} else {
		if (agree_known(new->unit_xy))
			memcpy(info->unit_xy, new->unit_xy, sizeof info->unit_xy);
		if (agree_known(new->unit_z))
			memcpy(info->unit_z, new->unit_z, sizeof info->unit_z);
		crs_info_settle(info);
	}
	if (!same_words(info, &said) && (agree_known(said.text) || agree_known(said.unit_xy) || agree_known(said.unit_z)))
		snprintf(overridden, AGREE_OVERRIDDEN, "%.400s, x and y in %s, z in %s", said.text, said.unit_xy, said.unit_z);
	return planar ? 0 : check_plane(name, info, err);
}
