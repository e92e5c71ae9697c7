/* The records of a file, for people and as JSON. Unknown values are "unknown", or null. */
#include <math.h>
#include <string.h>

#include "ctl_report.h"
#include "term.h"

static const char *const flag_name[4] = {"withheld", "synthetic", "key_point", "overlap"};

/* ---- for people ---- */

static void counts_text(FILE *out, const char *what, const uint64_t *counts, unsigned n)
{
	char text[256 * 32], a[32];
	size_t at = 0;

	text[0] = 0;
	for (unsigned i = 0; i < n && at < sizeof(text); i++)
		if (counts[i])
			at += (size_t)snprintf(text + at, sizeof(text) - at, "%s%u: %s", at ? ", " : "", i,
					       term_count(counts[i], a));
	term_field(out, what, "%s", text);
}

static void place_text(FILE *out, const struct acut_inspected *in)
{
	if (!in->has_place) {
		term_field(out, "  place", "unknown: %s", in->no_place);
		return;
	}
	term_field(out, "  place", "%.7f %.7f to %.7f %.7f (south west to north east)", in->south, in->west, in->north, in->east);
	term_field(out, "  mgrs", "%s", *in->mgrs ? in->mgrs : "none");
	term_field(out, "  area", "%.6g m2 of the convex hull by geodesics, %.6g m around it", in->area, in->perimeter);
	if (in->area > 0)
		term_field(out, "  density", "%.4g points a square metre, %.4g positions", (double)in->points / in->area,
			   (double)in->distinct / in->area);
}

void ctl_report_inspected(struct console *c, const struct acut_inspected *in)
{
	FILE *out = c->report;
	char a[32], b[32], d[32];

	term_field(out, "  records", "%s, at %s positions: %s more than one there", term_count(in->points, a),
		   term_count(in->distinct, b), term_count(in->points - in->distinct, d));
	if (in->points) {
		term_field(out, "  from", "%.15g %.15g %.15g to %.15g %.15g %.15g", in->min[0], in->min[1], in->min[2],
			   in->max[0], in->max[1], in->max[2]);
		if (!isnan(in->inner_min[0]))
			term_field(out, "  99.9 %", "%.15g %.15g %.15g to %.15g %.15g %.15g hold this part of them",
				   in->inner_min[0], in->inner_min[1], in->inner_min[2], in->inner_max[0], in->inner_max[1],
				   in->inner_max[2]);
		if (ctl_report_crowded(in->most_points, in->points, in->distinct))
			term_field(out, "  at one", "%s of them are at one position, %.15g %.15g", term_count(in->most_points, a),
				   in->most_at[0], in->most_at[1]);
		counts_text(out, "  class", in->classes, 256);
		counts_text(out, "  return", in->returns, 16);
		counts_text(out, "  of", in->return_counts, 16);
	}
	for (int i = 0; i < 4; i++)
		if (in->flags[i])
			term_field(out, "  flag", "%s: %s", flag_name[i], term_count(in->flags[i], a));
	term_field(out, "  lattice", "%s", in->lattice);
	place_text(out, in);
	if (!in->has_place && in->hull_area > 0)
		term_field(out, "  hull", "%.6g squares of the unit, %.4g points each", in->hull_area,
			   (double)in->points / in->hull_area);
	for (size_t i = 0; i < in->ndifference; i++)
		term_field(out, "  differs", "%s", in->difference[i]);
}

/* ---- JSON ---- */

static void counts_json(struct term_json *j, const char *key, const uint64_t *counts, unsigned n)
{
	char name[8];

	term_json_open(j, key, '{');
	for (unsigned i = 0; i < n; i++) {
		if (!counts[i])
			continue;
		snprintf(name, sizeof(name), "%u", i);
		term_json_u64(j, name, counts[i]);
	}
	term_json_close(j, '}');
}

static double per(uint64_t n, double area, bool known)
{
	return known && area > 0 ? (double)n / area : NAN;
}

static void place_json(struct term_json *j, const struct acut_inspected *in)
{
	term_json_open(j, "hull", '{');
	term_json_u64(j, "corners", in->hull_corners);
	term_json_bool(j, "thinned", in->hull_thinned);
	term_json_number(j, "area_units", in->hull_area);
	term_json_number(j, "area_m2", in->has_place ? in->area : NAN);
	term_json_number(j, "perimeter_m", in->has_place ? in->perimeter : NAN);
	term_json_close(j, '}');
	term_json_open(j, "density", '{');
	term_json_number(j, "points_unit", per(in->points, in->hull_area, true));
	term_json_number(j, "points_m2", per(in->points, in->area, in->has_place));
	term_json_number(j, "positions_m2", per(in->distinct, in->area, in->has_place));
	term_json_close(j, '}');
	if (in->has_place) {
		term_json_open(j, "place", '{');
		term_json_number(j, "south", in->south);
		term_json_number(j, "west", in->west);
		term_json_number(j, "north", in->north);
		term_json_number(j, "east", in->east);
		term_json_known(j, "mgrs", in->mgrs);
		term_json_close(j, '}');
	} else {
		term_json_null(j, "place");
	}
}

void ctl_report_inspected_json(struct term_json *j, const struct acut_inspected *in)
{
	static const char *const keys[] = {"records", "distinct",      "duplicates", "record_min", "record_max", "classes",
					   "returns", "return_counts", "flags",      "lattice",    "hull",       "density",
					   "place",   "differences",   "inner_min",  "inner_max",  "most"};

	if (!in) {
		for (size_t i = 0; i < sizeof(keys) / sizeof(*keys); i++)
			term_json_null(j, keys[i]);
		return;
	}
	term_json_u64(j, "records", in->points);
	term_json_u64(j, "distinct", in->distinct);
	term_json_u64(j, "duplicates", in->points - in->distinct);
	term_json_numbers(j, "record_min", in->min, 3);
	term_json_numbers(j, "record_max", in->max, 3);
	counts_json(j, "classes", in->classes, 256);
	counts_json(j, "returns", in->returns, 16);
	counts_json(j, "return_counts", in->return_counts, 16);
	term_json_open(j, "flags", '{');
	for (int i = 0; i < 4; i++)
		term_json_u64(j, flag_name[i], in->flags[i]);
	term_json_close(j, '}');
	ctl_report_lattice(j, in->lattice);
	place_json(j, in);
	term_json_open(j, "differences", '[');
	for (size_t i = 0; i < in->ndifference; i++)
		term_json_text(j, NULL, in->difference[i]);
	term_json_close(j, ']');
	term_json_numbers(j, "inner_min", in->inner_min, 3);
	term_json_numbers(j, "inner_max", in->inner_max, 3);
	ctl_report_most(j, in->most_points, in->most_at);
}
