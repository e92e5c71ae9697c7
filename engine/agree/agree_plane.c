/*
 * The plane and the heights of a set of inputs (agree_set.h).
 *
 * The model: degrees become metres of one UTM or UPS zone: the dataset's own zone; or the one that is asked for; or that of
 * a projected input on a zone of the same datum; or the zone in the middle of all headers. None of this depends on the order of
 * files. A file in the dataset's own plane is not changed. A geoid changes heights only, and those of all files of a dataset
 * alike, so the manifest records it and later inputs must agree.
 */
#include "agree_set.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "digest.h"
#include "err.h"

/* ---- what is asked ---- */

static int parse_way(struct agree *a, struct err *err)
{
	if (*a->geoid_way && !*a->geoid)
		return err_set(err, ERR_USAGE, "--geoid-way needs --geoid");
	if (!*a->geoid_way || !strcmp(a->geoid_way, "orthometric"))
		a->way = CRS_TO_ORTHOMETRIC;
	else if (!strcmp(a->geoid_way, "ellipsoidal"))
		a->way = CRS_TO_ELLIPSOIDAL;
	else
		return err_set(err, ERR_USAGE, "\"%.40s\" is not a way of a geoid: orthometric or ellipsoidal", a->geoid_way);
	return 0;
}

/* The text in the manifest has a hash, which identifies the grid, and a name for people. */
bool agree_geoid_same(const char *a, const char *b)
{
	char kind[2][16] = {"", ""}, hash[2][DIGEST_HEX_SIZE] = {"", ""};

	sscanf(a, "%15s %32s", kind[0], hash[0]);
	sscanf(b, "%15s %32s", kind[1], hash[1]);
	return !strcmp(kind[0], kind[1]) && !strcmp(hash[0], hash[1]);
}

int agree_plane_words(struct agree *a, struct err *err)
{
	if (*a->utm && !crs_zone_parse(a->utm, &a->wanted)) {
		err_set(err, ERR_USAGE, "\"%.40s\" is no zone", a->utm);
		return err_add_hint(err, "name a UTM zone as in --utm 32N, or --utm UPS-N or UPS-S");
	}
	if (*a->utm && a->planar)
		return err_set(err, ERR_USAGE, "--planar takes degrees as they are, --utm projects them: use one of them");
	return parse_way(a, err);
}

int agree_geoid_found(struct agree *a, const char *path, const char *hash, struct err *err)
{
	free(a->geoid_path);
	a->geoid_path = strdup(path);
	snprintf(a->geoid_text, sizeof a->geoid_text, "%s %s %.64s", a->way == CRS_TO_ORTHOMETRIC ? "orthometric" : "ellipsoidal",
		 hash, a->geoid);
	return a->geoid_path ? 0 : err_set(err, ERR_NOMEM, "no memory for the name of a geoid");
}

/* ---- the zone ---- */

/* The plane that the dataset has, or was created with; NULL: the files decide. */
static const char *own_plane(const struct agree *a)
{
	if (a->fixed)
		return a->crs;
	return agree_known(a->created) ? a->created : NULL;
}

/* Removes the vertical system from the text if a geoid changes heights: it does not hold any more. */
static void without_heights(const struct agree *a, char *text)
{
	char *heights = strstr(text, " + ");

	if (*a->geoid_text && heights)
		*heights = 0;
}

/* A dataset that was created without heights accepts any. */
static void any_heights(const struct agree *a, const char *base, char *text)
{
	char *heights = strstr(text, " + ");

	if (!a->fixed && heights && !strstr(base, " + "))
		*heights = 0;
}

/* Adds the heights that the geoid makes. */
static void with_heights(const struct agree *a, char text[CRS_TEXT_SIZE])
{
	size_t n = strlen(text);

	if (*a->geoid_text)
		snprintf(text + n, CRS_TEXT_SIZE - n, " + %s height (%.64s)",
			 a->way == CRS_TO_ORTHOMETRIC ? "orthometric" : "ellipsoidal", a->geoid);
}

/* Degrees, unless they are the dataset's own plane. */
static bool to_project(const struct agree *a, const struct crs_info *crs)
{
	char base[CRS_TEXT_SIZE] = "", own[CRS_TEXT_SIZE];

	if (crs->plane != CRS_PLANE_GEOGRAPHIC || a->planar)
		return false;
	memcpy(own, crs->text, sizeof own);
	without_heights(a, own);
	if (own_plane(a))
		snprintf(base, sizeof base, "%s", own_plane(a));
	without_heights(a, base);
	if (*base)
		any_heights(a, base, own);
	return strcmp(base, own);
}

static const struct agree_input *first_of(const struct agree *a, const struct agree_inputs *in, bool projected)
{
	for (size_t i = 0; i < in->n; i++) {
		const struct agree_input *one = in->at(in->ctx, i);

		if (one &&
		    (projected ? one->crs->plane == CRS_PLANE_PROJECTED && agree_known(one->crs->text) : to_project(a, one->crs)))
			return one;
	}
	return NULL;
}

/* From the boxes of all inputs. Inputs whose numbers are no degrees are excluded, unless there are no others. */
static int zone_of_boxes(struct agree *a, const struct agree_inputs *in, struct err *err)
{
	struct lattice_input *boxes = calloc(in->n, sizeof *boxes);
	size_t i, n = 0, left = 0;
	int r = 0;

	if (!boxes)
		return err_set(err, ERR_NOMEM, "no memory to choose a zone");
	for (i = 0; i < in->n; i++)
		left += in->at(in->ctx, i) != NULL;
	for (i = 0; i < in->n; i++) {
		const struct agree_input *one = in->at(in->ctx, i);
		struct crs_zone any;
		struct err bad = ERR_INIT;

		if (!one || !to_project(a, one->crs))
			continue;
		if (crs_zone_choose(&one->coords, 1, &any, &bad) && *bad.file && left > 1 && !in->exclude(in->ctx, i, &bad)) {
			left--;
			continue;
		}
		boxes[n++] = one->coords;
	}
	r = crs_zone_choose(boxes, n, &a->zone, err);
	free(boxes);
	return r;
}

static int zone_of_base(struct agree *a, const struct crs_info *degrees, struct err *err)
{
	char want[8], have[8], base[CRS_TEXT_SIZE];
	struct crs_info from;

	snprintf(base, sizeof base, "%s", own_plane(a));
	without_heights(a, base);
	from = *degrees;
	any_heights(a, base, from.text);
	if (!crs_zone_of_text(&from, base, &a->zone)) {
		err_set(err, ERR_UNSUPPORTED, "degrees of %.100s cannot be brought to the plane of the dataset %s, %.100s",
			degrees->text, a->dataset, own_plane(a));
		return err_add_hint(err, "it would have to be a UTM or UPS zone of their datum; project the file first, or "
					 "push it into a dataset of its own");
	}
	if (*a->utm && strcmp(crs_zone_text(a->wanted, want), crs_zone_text(a->zone, have)))
		return err_set(err, ERR_USAGE, "the dataset %s lies in zone %s, not %s", a->dataset, have, want);
	return 0;
}

static int choose_zone(struct agree *a, const struct agree_inputs *in, struct err *err)
{
	const struct agree_input *degrees = first_of(a, in, false), *projected = first_of(a, in, true);
	struct crs_info from;
	int r;

	a->projects = degrees != NULL;
	if (!degrees) {
		if (!*a->utm || own_plane(a))
			return 0;
		err_set(err, ERR_USAGE, "--utm projects degrees, and no input says that it has any");
		return err_add_hint(
			err, "leave it out, or say what the coordinates are with --assume-crs, or with --override-crs where "
			     "the inputs say something else");
	}
	from = *degrees->crs;
	without_heights(a, from.text);
	r = crs_zone_datum(&from, err);
	if (r)
		return err_add_file(err, degrees->name);
	snprintf(a->datum, sizeof a->datum, "%.63s", *from.system.datum ? from.system.datum : from.text);
	if (own_plane(a)) {
		r = zone_of_base(a, &from, err);
		return r ? err_add_file(err, degrees->name) : 0;
	}
	if (*a->utm) {
		a->zone = a->wanted;
		return 0;
	}
	if (projected) {
		char other[CRS_TEXT_SIZE];

		memcpy(other, projected->crs->text, sizeof other);
		without_heights(a, other);
		if (crs_zone_of_text(&from, other, &a->zone))
			return 0;
	}
	return zone_of_boxes(a, in, err);
}

/* ---- one input ---- */

static int check_heights(const struct agree *a, const struct crs_info *crs, struct err *err)
{
	unsigned z = crs->system.epsg_z;
	/* EPSG numbers of heights above an ellipsoid, as in GeoTIFF keys. */
	bool ellipsoidal = z >= 5001 && z <= 5035;

	if (!*a->geoid_text || !z || ellipsoidal == (a->way == CRS_TO_ORTHOMETRIC))
		return 0;
	err_set(err, ERR_USAGE, "its heights (EPSG:%u) are %s already", z,
		ellipsoidal ? "ellipsoidal" : "above a geoid or a datum of heights");
	return err_add_hint(err, "leave --geoid out, or override what it says of itself with --override-crs");
}

bool agree_projects(const struct agree *a, const struct crs_info *crs)
{
	return a->projects && to_project(a, crs);
}

int agree_plane_of(const struct agree *a, const struct crs_info *crs, struct agree_step *ret, struct err *err)
{
	int r = check_heights(a, crs, err);

	ret->from = *crs;
	without_heights(a, ret->from.text);
	ret->projects = agree_projects(a, crs);
	ret->to = ret->from;
	if (!r && ret->projects)
		r = crs_zone_system(&ret->from, a->zone, &ret->to, err);
	ret->needed = ret->projects || *a->geoid_text;
	ret->plane = ret->to;
	with_heights(a, ret->plane.text);
	ret->params = (struct crs_step_params){
		.from = &ret->from,
		.to = ret->projects ? &ret->to : NULL,
		.geoid_path = a->geoid_path,
		.way = a->way,
	};
	return r;
}

int agree_plane_choose(struct agree *a, const struct agree_inputs *in, struct err *err)
{
	struct agree_step step;
	int r = choose_zone(a, in, err);

	for (size_t i = 0; !r && i < in->n; i++) {
		struct agree_input *one = in->at(in->ctx, i);

		if (!one)
			continue;
		r = agree_plane_of(a, one->crs, &step, err);
		if (!r && !(one->plane = in->keep(in->ctx, &step.plane)))
			r = err_set(err, ERR_NOMEM, "no memory for a coordinate system");
		if (r)
			err_add_file(err, one->name);
	}
	return r;
}
