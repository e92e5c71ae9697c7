/*
 * The plane of a push's points (scan_push_plane.h).
 *
 * The model: a dataset with a system decides, units included; then --crs may only be the same, or the system of the degrees
 * of the poses. A new dataset gets the plane of --crs, whose datum the degrees are then of; else the UTM zone of the poses,
 * or only metres. Nothing is transformed from one datum or plane to another. Ranges are metres: in a plane of unknown unit
 * they are refused, as their unit would be a guess.
 */
#include <stdio.h>
#include <string.h>

#include "clock.h"
#include "console.h"
#include "err.h"
#include "parse.h"
#include "scan_push_plane.h"

static bool known(const char *text)
{
	return *text && strcmp(text, "unknown");
}

static void without_heights(struct crs_info *c)
{
	char *plus = strstr(c->text, " + ");

	if (plus)
		*plus = 0;
	c->system.epsg_z = 0;
}

static bool same_plane(const struct crs_info *a, const struct crs_info *b)
{
	struct crs_info x = *a, y = *b;

	without_heights(&x);
	without_heights(&y);
	return !strcmp(x.text, y.text);
}

/* The geographic base of a plane. */
static void base_of(const struct crs_info *plane, struct crs_info *ret)
{
	crs_info_clear(ret);
	ret->plane = CRS_PLANE_GEOGRAPHIC;
	ret->system.method = CRS_METHOD_GEOGRAPHIC;
	ret->system.a = plane->system.a;
	ret->system.inverse_flattening = plane->system.inverse_flattening;
	memcpy(ret->system.datum, plane->system.datum, sizeof ret->system.datum);
	snprintf(ret->text, sizeof ret->text, "%s", plane->system.datum);
	snprintf(ret->unit_xy, sizeof ret->unit_xy, "degree");
	crs_info_settle(ret);
}

static int check_units(struct program *args, const struct scan_target *t, struct err *err)
{
	const char *what = !known(t->unit_xy) ? "x and y are" : !known(t->unit_z) ? "heights are" : NULL;

	if (!what)
		return 0;
	err_set(err, ERR_UNSUPPORTED,
		"nothing says which unit the dataset's %s in: ranges are metres, and how many of its units that is would be a guess",
		what);
	err_add_hint(err, "use another dataset, or make this one anew: acutctl push set it with --assume-units");
	return err_add_file(err, args->into);
}

/* The plane of a dataset. Heights from a geoid are set by the push, not by its points. */
static int of_dataset(struct program *args, const struct scan_target *t, struct scan_plane *ret, struct err *err)
{
	struct crs_info said = ret->to;
	bool had = ret->has_to;

	crs_info_clear(&ret->to);
	if (known(t->crs) && crs_assume_text(t->crs, strlen(t->crs), &ret->to, err))
		return -(int)err->code;
	snprintf(ret->to.unit_xy, sizeof ret->to.unit_xy, "%s", t->unit_xy);
	snprintf(ret->to.unit_z, sizeof ret->to.unit_z, "%s", t->unit_z);
	crs_info_settle(&ret->to);
	ret->has_to = true;
	if (had && !same_plane(&said, &ret->to)) {
		err_set(err, ERR_INPUT, "the dataset %.60s is in %.150s, --crs is %.150s", args->into, t->crs, said.text);
		return err_add_hint(err, "a dataset has one plane: leave --crs out, or use another dataset");
	}
	if (had && said.system.epsg_z && said.system.epsg_z != ret->to.system.epsg_z) {
		err_set(err, ERR_INPUT, "the dataset %.60s is in %.150s, --crs is %.150s", args->into, t->crs, said.text);
		return err_add_hint(err, "a dataset has heights of one kind: leave --crs out, or use another dataset");
	}
	if (had) {
		unsigned heights = ret->to.system.epsg_z;

		ret->to.system = said.system;
		ret->to.system.epsg_z = heights;
	}
	return t->empty ? 0 : check_units(args, t, err);
}

/* For a new dataset: metres, unless the plane has another unit, whose heights must then be given. */
static int of_new(struct scan_plane *p, struct err *err)
{
	if (!p->has_to || known(p->to.unit_z))
		return 0;
	if (known(p->to.text) && !known(p->to.unit_xy)) {
		err_set(err, ERR_UNSUPPORTED,
			"which unit the plane %.200s has is not known: ranges are metres, and how many of its units that is "
			"would be a guess",
			p->to.text);
		return err_add_hint(err, "a dataset with a file of this plane has its unit (acutctl push --assume-units)");
	}
	if (known(p->to.unit_xy) && strcmp(p->to.unit_xy, "metre")) {
		err_set(err, ERR_USAGE, "the plane %.200s is in %s, and the unit of its heights is unknown", p->to.text,
			p->to.unit_xy);
		return err_add_hint(err, "name the vertical system too: --crs \"EPSG:n + EPSG:m\"");
	}
	snprintf(p->to.unit_xy, sizeof p->to.unit_xy, "metre");
	snprintf(p->to.unit_z, sizeof p->to.unit_z, "metre");
	crs_info_settle(&p->to);
	return 0;
}

int scan_push_plane(struct program *args, const struct scan_target *t, struct scan_plane *ret, struct err *err)
{
	struct crs_info said;
	int r = 0;

	memset(ret, 0, sizeof *ret);
	if (args->crs) {
		r = crs_assume_text(args->crs, strlen(args->crs), &said, err);
		if (r)
			return r;
		if (said.plane == CRS_PLANE_GEOGRAPHIC) {
			ret->degrees = said;
			ret->has_degrees = true;
		} else {
			ret->to = said;
			ret->has_to = true;
		}
	}
	if (t->there && (!t->empty || known(t->crs)))
		r = of_dataset(args, t, ret, err);
	if (!r && (!t->there || t->empty))
		r = of_new(ret, err);
	if (r)
		return r;
	if (args->geoid && ret->has_to)
		without_heights(&ret->to);
	if (args->crs && !ret->has_degrees && ret->to.system.a > 0) {
		base_of(&ret->to, &ret->degrees);
		ret->has_degrees = true;
	}
	return 0;
}

struct reading {
	struct program *args;
	double shown; /* when progress was */
};

static bool show_poses(void *ctx, uint64_t bytes, uint64_t size)
{
	struct reading *r = ctx;
	double now = (double)clock_mono_ns() * 1e-9;
	char done[32], all[32];

	if (console_progress_on(&r->args->console) && now - r->shown >= 0.2) {
		r->shown = now;
		console_progress(&r->args->console, "%s: %s of %s", r->args->pose, parse_size_text(bytes, done),
				 parse_size_text(size, all));
	}
	return scan_stopped();
}

int scan_push_poses(struct program *args, const struct scan_plane *plane, int fd, struct pose_track **ret, struct err *err)
{
	struct reading reading = {.args = args};
	const struct pose_params params = {
		.to = plane->has_to ? &plane->to : NULL,
		.degrees = plane->has_degrees ? &plane->degrees : NULL,
		.utm = args->utm,
		.clock = !strcmp(args->pose_clock, "gps") ? POSE_GPS : POSE_UTC,
		.north = !args->heading                 ? POSE_NORTH_AS_POSED :
			 !strcmp(args->heading, "true") ? POSE_NORTH_TRUE :
							  POSE_NORTH_GRID,
		.grid_scale = args->grid_scale,
		.gap_s = args->gap_s,
		.offset_s = args->pose_offset_s,
		.told = show_poses,
		.ctx = &reading,
	};

	int r = pose_track_read(fd, args->pose, &params, ret, err);

	console_progress_clear(&args->console);
	if (!r && args->geoid && !pose_track_span(*ret)->ellipsoidal) {
		*ret = pose_track_free(*ret);
		err_set(err, ERR_USAGE, "--geoid makes ellipsoidal heights orthometric, and the poses have a column height");
		err_add_hint(err, "name the column ellipsoidal_height if its heights are that, or leave --geoid out");
		r = err_add_file(err, args->pose);
	}
	return r;
}
