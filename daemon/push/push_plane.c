/*
 * The plane and the heights of a push's points.
 *
 * The model: degrees become metres of one UTM or UPS zone: the dataset's own zone; or the one that the push asks for; or that of
 * a projected input on a zone of the same datum; or the zone in the middle of all headers. None of this depends on the order of
 * files. A file in the dataset's own plane is not changed. A geoid changes heights only, and those of all files of a dataset
 * alike, so the manifest records it and later pushes must agree.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "push_priv.h"

/* ---- parameters of the push ---- */

static int parse_way(struct push *p, struct err *err)
{
	if (*p->geoid_way && !*p->geoid)
		return err_set(err, ERR_USAGE, "--geoid-way needs --geoid");
	if (!*p->geoid_way || !strcmp(p->geoid_way, "orthometric"))
		p->plane.way = CRS_TO_ORTHOMETRIC;
	else if (!strcmp(p->geoid_way, "ellipsoidal"))
		p->plane.way = CRS_TO_ELLIPSOIDAL;
	else
		return err_set(err, ERR_USAGE, "\"%.40s\" is not a way of a geoid: orthometric or ellipsoidal", p->geoid_way);
	return 0;
}

/* The text in the manifest has a hash, which identifies the grid, and a name for people. */
static bool same_heights(const char *a, const char *b)
{
	char kind[2][16] = {"", ""}, hash[2][DIGEST_HEX_SIZE] = {"", ""};

	sscanf(a, "%15s %32s", kind[0], hash[0]);
	sscanf(b, "%15s %32s", kind[1], hash[1]);
	return !strcmp(kind[0], kind[1]) && !strcmp(hash[0], hash[1]);
}

int push_plane_heights(const struct push *p, struct err *err)
{
	const char *base = p->base->geoid;

	if (same_heights(base, p->plane.geoid))
		return 0;
	if (*base)
		err_set(err, ERR_USAGE, "the heights of the dataset %s are %s, those of this push %s", p->dataset->name, base,
			*p->plane.geoid ? p->plane.geoid : "as the files have them");
	else
		err_set(err, ERR_USAGE, "the heights of the dataset %s are as its files had them, not shifted by a geoid",
			p->dataset->name);
	return err_add_hint(err, "push with the geoid of the dataset, or into a dataset of its own");
}

int push_plane_begin(struct push *p, struct err *err)
{
	struct geoids_found found;
	int r = 0;

	if (*p->utm && !crs_zone_parse(p->utm, &p->plane.wanted)) {
		err_set(err, ERR_USAGE, "\"%.40s\" is no zone", p->utm);
		return err_add_hint(err, "name a UTM zone as in --utm 32N, or --utm UPS-N or UPS-S");
	}
	if (*p->utm && p->planar)
		return err_set(err, ERR_USAGE, "--planar takes degrees as they are, --utm projects them: use one of them");
	r = parse_way(p, err);
	if (!r && *p->geoid) {
		r = geoids_find(p->pushes->geoids, p->geoid, &found, err);
		if (r)
			return r;
		memcpy(p->plane.geoid_path, found.path, sizeof p->plane.geoid_path);
		snprintf(p->plane.geoid, sizeof p->plane.geoid, "%s %s %.64s",
			 p->plane.way == CRS_TO_ORTHOMETRIC ? "orthometric" : "ellipsoidal", found.hash, p->geoid);
	}
	return !r && p->base ? push_plane_heights(p, err) : r;
}

/* ---- the zone ---- */

/* The plane that the dataset has, or was created with; NULL: the files decide. */
static const char *own_plane(const struct push *p)
{
	if (push_reference(p))
		return push_reference(p)->crs;
	return agree_known(p->plane.created) ? p->plane.created : NULL;
}

/* Removes the vertical system from the text if a geoid changes heights: it does not hold any more. */
static void without_heights(const struct push *p, char *text)
{
	char *heights = strstr(text, " + ");

	if (*p->plane.geoid && heights)
		*heights = 0;
}

/* A dataset that was created without heights accepts any. */
static void any_heights(const struct push *p, const char *base, char *text)
{
	char *heights = strstr(text, " + ");

	if (!push_reference(p) && heights && !strstr(base, " + "))
		*heights = 0;
}

/* Adds the heights that the geoid makes. */
static void with_heights(const struct push *p, char text[CRS_TEXT_SIZE])
{
	size_t n = strlen(text);

	if (*p->plane.geoid)
		snprintf(text + n, CRS_TEXT_SIZE - n, " + %s height (%.64s)",
			 p->plane.way == CRS_TO_ORTHOMETRIC ? "orthometric" : "ellipsoidal", p->geoid);
}

/* Degrees, unless they are the dataset's own plane. */
static bool to_project(const struct push *p, const struct crs_info *crs)
{
	char base[CRS_TEXT_SIZE] = "", own[CRS_TEXT_SIZE];

	if (crs->plane != CRS_PLANE_GEOGRAPHIC || p->planar)
		return false;
	memcpy(own, crs->text, sizeof own);
	without_heights(p, own);
	if (own_plane(p))
		snprintf(base, sizeof base, "%s", own_plane(p));
	without_heights(p, base);
	if (*base)
		any_heights(p, base, own);
	return strcmp(base, own);
}

static const struct push_probed *first_of(const struct push *p, bool projected)
{
	for (size_t i = 0; i < p->nprobes; i++) {
		const struct push_probed *probe = &p->probes[i];

		if (!probe->excluded && (projected ? probe->crs->plane == CRS_PLANE_PROJECTED && agree_known(probe->crs->text) :
						     to_project(p, probe->crs)))
			return probe;
	}
	return NULL;
}

/* From the boxes of all inputs. Inputs whose numbers are no degrees are excluded, unless there are no others. */
static int zone_of_boxes(struct push *p, struct err *err)
{
	struct lattice_input *boxes = calloc(p->nprobes, sizeof *boxes);
	size_t i, n = 0, left = 0;
	int r = 0;

	if (!boxes)
		return err_set(err, ERR_NOMEM, "no memory to choose a zone");
	for (i = 0; i < p->nprobes; i++)
		left += !p->probes[i].excluded;
	for (i = 0; i < p->nprobes; i++) {
		struct push_probed *probe = &p->probes[i];
		struct crs_zone any;
		struct err bad = ERR_INIT;

		if (probe->excluded || !to_project(p, probe->crs))
			continue;
		if (crs_zone_choose(&probe->coords, 1, &any, &bad) && *bad.file && left > 1 && !push_exclude(probe, &bad)) {
			left--;
			continue;
		}
		boxes[n++] = probe->coords;
	}
	r = crs_zone_choose(boxes, n, &p->plane.zone, err);
	free(boxes);
	return r;
}

static int zone_of_base(struct push *p, const struct crs_info *degrees, struct err *err)
{
	char want[8], have[8], base[CRS_TEXT_SIZE];
	struct crs_info from;

	snprintf(base, sizeof base, "%s", own_plane(p));
	without_heights(p, base);
	from = *degrees;
	any_heights(p, base, from.text);
	if (!crs_zone_of_text(&from, base, &p->plane.zone)) {
		err_set(err, ERR_UNSUPPORTED, "degrees of %.100s cannot be brought to the plane of the dataset %s, %.100s",
			degrees->text, p->dataset->name, own_plane(p));
		return err_add_hint(err, "it would have to be a UTM or UPS zone of their datum; project the file first, or "
					 "push it into a dataset of its own");
	}
	if (*p->utm && strcmp(crs_zone_text(p->plane.wanted, want), crs_zone_text(p->plane.zone, have)))
		return err_set(err, ERR_USAGE, "the dataset %s lies in zone %s, not %s", p->dataset->name, have, want);
	return 0;
}

static int choose_zone(struct push *p, struct err *err)
{
	const struct push_probed *degrees = first_of(p, false), *projected = first_of(p, true);
	struct crs_info from;
	int r;

	p->plane.projects = degrees != NULL;
	if (!degrees) {
		if (!*p->utm || own_plane(p))
			return 0;
		err_set(err, ERR_USAGE, "--utm projects degrees, and no input says that it has any");
		return err_add_hint(
			err, "leave it out, or say what the coordinates are with --assume-crs, or with --override-crs where "
			     "the inputs say something else");
	}
	from = *degrees->crs;
	without_heights(p, from.text);
	r = crs_zone_datum(&from, err);
	if (r)
		return err_add_file(err, degrees->name);
	snprintf(p->plane.datum, sizeof p->plane.datum, "%.63s", *from.system.datum ? from.system.datum : from.text);
	if (own_plane(p)) {
		r = zone_of_base(p, &from, err);
		return r ? err_add_file(err, degrees->name) : 0;
	}
	if (*p->utm) {
		p->plane.zone = p->plane.wanted;
		return 0;
	}
	if (projected) {
		char other[CRS_TEXT_SIZE];

		memcpy(other, projected->crs->text, sizeof other);
		without_heights(p, other);
		if (crs_zone_of_text(&from, other, &p->plane.zone))
			return 0;
	}
	return zone_of_boxes(p, err);
}

/* ---- one input ---- */

static int check_heights(const struct push *p, const struct crs_info *crs, struct err *err)
{
	unsigned z = crs->system.epsg_z;
	/* EPSG numbers of heights above an ellipsoid, as in GeoTIFF keys. */
	bool ellipsoidal = z >= 5001 && z <= 5035;

	if (!*p->plane.geoid || !z || ellipsoidal == (p->plane.way == CRS_TO_ORTHOMETRIC))
		return 0;
	err_set(err, ERR_USAGE, "its heights (EPSG:%u) are %s already", z,
		ellipsoidal ? "ellipsoidal" : "above a geoid or a datum of heights");
	return err_add_hint(err, "leave --geoid out, or override what it says of itself with --override-crs");
}

int push_plane_of(const struct push *p, const struct crs_info *crs, struct push_plane_step *ret, struct err *err)
{
	int r = check_heights(p, crs, err);

	ret->from = *crs;
	without_heights(p, ret->from.text);
	ret->projects = p->plane.projects && to_project(p, crs);
	ret->to = ret->from;
	if (!r && ret->projects)
		r = crs_zone_system(&ret->from, p->plane.zone, &ret->to, err);
	ret->needed = ret->projects || *p->plane.geoid;
	ret->plane = ret->to;
	with_heights(p, ret->plane.text);
	ret->params = (struct crs_step_params){
		.from = &ret->from,
		.to = ret->projects ? &ret->to : NULL,
		.geoid_path = *p->plane.geoid ? p->plane.geoid_path : NULL,
		.way = p->plane.way,
	};
	return r;
}

int push_plane_coords(struct push *p, struct push_probed *probe, struct err *err)
{
	struct push_plane_step step;
	int r;

	if (probe->on_plane)
		return 0;
	r = push_plane_of(p, probe->crs, &step, err);
	step.params.coords = &probe->coords;
	if (!r && step.needed)
		r = crs_step_coords(&step.params, &probe->coords, err);
	probe->on_plane = !r;
	return r ? err_add_file(err, probe->name) : 0;
}

int push_plane_choose(struct push *p, struct err *err)
{
	struct push_plane_step step;
	int r = choose_zone(p, err);

	for (size_t i = 0; !r && i < p->nprobes; i++) {
		struct push_probed *probe = &p->probes[i];

		if (probe->excluded)
			continue;
		r = push_plane_of(p, probe->crs, &step, err);
		if (!r && !(probe->plane = push_keep_crs(p, &step.plane)))
			r = err_set(err, ERR_NOMEM, "no memory for a coordinate system");
		if (r)
			err_add_file(err, probe->name);
	}
	return r;
}
