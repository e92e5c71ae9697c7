/*
 * Coordinates as 32-bit floats.
 *
 * A float has 24 bits: up to 2^24 steps from zero it is off by less than one step of the lattice, beyond that by more. The x and
 * y of most projected systems do not fit, and need an origin near the mesh; heights nearly always fit. The box of the head holds
 * all x and y of the mesh, so it is known before the first byte whether those of a whole mesh fit. A window, a tile or a trimmed
 * mesh may fit where the mesh does not, and the range of heights is known only at the end: what is written is looked at as it
 * comes.
 */
#include <math.h>

#include "err.h"
#include "format_float.h"

#define FLOAT_STEPS 16777216.0 /* 2^24 */

/* One step of the lattice, as it is written. */
static double step_of(const struct format_axis *ax)
{
	return ax->converted ? (double)ax->value.a / (double)ax->value.q : decimal_scaled_double(ax->scale, 1);
}

static int refuse(const struct format_float *f, int axis, double most, double step, struct err *err)
{
	static const char *const axes[] = {"x", "y", "z"};
	int exponent;

	frexp(most, &exponent);
	err_set(err, ERR_USAGE, "%s has 32-bit floats, and %s is up to %.10g%s: off by up to %.2g, with a lattice of %.10g",
		f->name, axes[axis], most, f->has_origin ? " from the origin" : "", ldexp(1, exponent - 25), step);
	if (axis == 2) /* of which --origin auto does not know the middle either */
		return err_add_hint(
			err,
			"give --origin X,Y,Z with a height near those of the mesh, or leave out points far above or below: --zmin, --zmax");
	if (f->from_auto && f->part)
		return err_add_hint(err,
				    "--origin auto is the middle of the whole mesh: give --origin X,Y,Z near what is written");
	if (f->from_auto)
		return err_add_hint(
			err, "write PLY or OBJ, which have all digits, or make a mesh of a smaller area: --crop X1,Y1,X2,Y2");
	return err_add_hint(err, "give --origin auto, which takes the middle of the mesh off the coordinates");
}

static int check(const struct format_float *f, int axis, int32_t low, int32_t high, struct err *err)
{
	const struct format_axis *ax = &f->axis[axis];
	double most = fmax(fabs(format_axis_value(ax, low)), fabs(format_axis_value(ax, high))), step = step_of(ax);

	return most / step > FLOAT_STEPS ? refuse(f, axis, most, step, err) : 0;
}

int format_float_init(struct format_float *f, const char *name, const struct acut_mesh_head *head,
		      const struct format_options *opt, struct err *err)
{
	int r = format_axis_init(f->axis, head, opt, err);

	f->name = name;
	f->has_origin = opt->has_origin || opt->origin_auto;
	f->from_auto = opt->origin_auto;
	f->part = format_is_part(head, opt);
	for (int i = 0; i < 2 && !r && !f->part; i++)
		r = check(f, i, head->box[i], head->box[i + 3], err);
	return r;
}

void format_float_range(int32_t range[2][3], const int32_t v[3])
{
	for (int i = 0; i < 3; i++) {
		range[0][i] = v[i] < range[0][i] ? v[i] : range[0][i];
		range[1][i] = v[i] > range[1][i] ? v[i] : range[1][i];
	}
}

int format_float_check(const struct format_float *f, const int32_t range[2][3], struct err *err)
{
	int r = 0;

	for (int i = 0; i < 3 && !r && range[0][i] <= range[1][i]; i++)
		r = check(f, i, range[0][i], range[1][i], err);
	return r;
}
