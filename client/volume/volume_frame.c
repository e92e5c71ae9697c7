/*
 * One lattice for both meshes.
 *
 * Scales are exact decimals, so the largest step of which both are multiples is one, too. Every coordinate of either mesh is a
 * whole number of such steps, and nothing is rounded. Offsets are multiples of the scale of their lattice.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "volume_priv.h"
#include "wide.h"

/* mantissa * 10^by; false: more than 2^62. */
static bool raise(int64_t mantissa, int64_t by, volume_i128 *ret)
{
	volume_i128 v = mantissa;

	for (; by > 0; by--) {
		v *= 10;
		if (v > (volume_i128)1 << 62 || v < -((volume_i128)1 << 62))
			return false;
	}
	*ret = v;
	return true;
}

static int axis_init(struct volume_frame *f, int axis, const struct decimal scale[2], struct err *err)
{
	int32_t e = scale[0].exponent < scale[1].exponent ? scale[0].exponent : scale[1].exponent;
	char first[DECIMAL_TEXT_SIZE], second[DECIMAL_TEXT_SIZE];
	volume_i128 m[2];

	if (raise(scale[0].mantissa, scale[0].exponent - e, &m[0]) && raise(scale[1].mantissa, scale[1].exponent - e, &m[1])) {
		volume_i128 a = wide_gcd(m[0], m[1]);

		f->step[axis] = (struct decimal){(int64_t)a, e};
		f->times[0][axis] = (int64_t)(m[0] / a);
		f->times[1][axis] = (int64_t)(m[1] / a);
		if (f->times[0][axis] < INT32_MAX && f->times[1][axis] < INT32_MAX)
			return 0;
	}
	err_set(err, ERR_USAGE, "the scales %s and %s of the two lattices have no common step", decimal_text(scale[0], first),
		decimal_text(scale[1], second));
	return err_add_hint(err, "push one of the two again with the --scale of the other");
}

static int scales(const struct volume_side *s, struct decimal ret[2], struct err *err)
{
	char word[2][64];

	if (sscanf(s->lattice ? s->lattice : "", "%63s %63s", word[0], word[1]) == 2 && decimal_parse(word[0], &ret[0]) &&
	    decimal_parse(word[1], &ret[1]) && ret[0].mantissa > 0 && ret[1].mantissa > 0)
		return 0;
	return err_set(err, ERR_PROTO, "the lattice of %s is not known", s->name);
}

/* ---- what cannot be compared ---- */

static const char *known(const char *text)
{
	return text && *text ? text : "unknown";
}

static int check_unit(const struct volume_side *s, struct err *err)
{
	static const char *const unit[] = {"metre", "foot", "us-survey-foot"};

	if (strcmp(known(s->unit_xy), known(s->unit_z)) != 0) {
		err_set(err, ERR_USAGE, "%s has x and y in %s and heights in %s: a volume needs one unit", s->name,
			known(s->unit_xy), known(s->unit_z));
		return err_add_hint(err, "push the files again with their units: --assume-units XY,Z for files that say "
					 "nothing of them, else --override-units");
	}
	for (size_t i = 0; i < sizeof(unit) / sizeof(*unit); i++)
		if (!strcmp(known(s->unit_xy), unit[i]))
			return 0;
	err_set(err, ERR_USAGE, "the unit of %s is %s: a volume needs metres or feet", s->name, known(s->unit_xy));
	return err_add_hint(err, "push the files again with their unit, --assume-units m, ft or ftUS");
}

static int check_same(const struct volume_side s[2], struct err *err)
{
	if (strcmp(known(s[0].unit_xy), known(s[1].unit_xy)) != 0) {
		err_set(err, ERR_USAGE, "%s is in %s, %s in %s", s[0].name, known(s[0].unit_xy), s[1].name, known(s[1].unit_xy));
		return err_add_hint(err, "convert the files of one of the two (pdal translate), and push them");
	}
	if (strcmp(known(s[0].crs), known(s[1].crs)) != 0) {
		err_set(err, ERR_USAGE, "%s is in the coordinate system %.200s, %s in %.200s", s[0].name, known(s[0].crs),
			s[1].name, known(s[1].crs));
		return err_add_hint(err, "if it is the same system, push the files of one again with --assume-crs or "
					 "--override-crs; else convert them");
	}
	return 0;
}

/* (level / step - k), rounded down, and the rest. */
static int set_level(struct volume_frame *f, struct decimal level, struct err *err)
{
	int32_t by = level.exponent - f->step[1].exponent;
	volume_i128 n = level.mantissa, d = f->step[1].mantissa, whole;
	char text[DECIMAL_TEXT_SIZE];

	if (!level.mantissa)
		by = 0;
	if (!raise(level.mantissa, by, &n) || !raise(f->step[1].mantissa, -by, &d)) {
		err_set(err, ERR_USAGE, "the level %s is too far off, or has too many digits", decimal_text(level, text));
		return err_add_hint(err, "give a height in the unit of the mesh, as in --level 112.5");
	}
	whole = n / d - (n % d < 0);
	f->level = (int64_t)(whole - f->k[2]);
	f->level_part = (double)(n - whole * d) / (double)d;
	return 0;
}

/* ---- the frame ---- */

int volume_frame_init(struct volume_frame *f, const struct volume_options *opt, struct err *err)
{
	const struct volume_side *s = opt->side;
	struct decimal scale[2][2];
	int r = check_unit(&s[0], err);

	*f = (struct volume_frame){.level = 0};
	if (!r && !opt->has_level)
		r = check_unit(&s[1], err);
	if (!r && !opt->has_level)
		r = check_same(s, err);
	if (!r)
		r = scales(&s[0], scale[0], err);
	if (!r)
		r = scales(&s[!opt->has_level], scale[1], err);
	for (int axis = 0; axis < 2 && !r; axis++)
		r = axis_init(f, axis, (const struct decimal[2]){scale[0][axis], scale[1][axis]}, err);
	return r;
}

int volume_frame_head(struct volume_frame *f, unsigned side, const struct acut_mesh_head *head, const struct volume_options *opt,
		      struct err *err)
{
	/* Numbers are near zero in the middle of the first mesh. */
	for (int i = 0; i < 3; i++) {
		volume_i128 times = f->times[side][i == 2], k = head->k[i] * times;
		volume_i128 middle = ((int64_t)head->box[i] + head->box[3 + i]) / 2 * times;

		if (k > INT64_MAX / 4 || k < INT64_MIN / 4)
			return err_set(err, ERR_LIMIT, "the lattice of the mesh is too far from zero");
		if (!side)
			f->k[i] = (int64_t)(k + middle);
		f->shift[side][i] = k - f->k[i];
	}
	return !side && opt->has_level ? set_level(f, opt->level, err) : 0;
}

bool volume_frame_point(const struct volume_frame *f, unsigned side, const int32_t from[3], int32_t to[3])
{
	for (int i = 0; i < 3; i++) {
		volume_i128 v = (volume_i128)from[i] * f->times[side][i == 2] + f->shift[side][i];

		if (v < INT32_MIN || v > INT32_MAX)
			return false;
		to[i] = (int32_t)v;
	}
	return true;
}

int64_t volume_frame_corner(const struct volume_frame *f, struct decimal d)
{
	int64_t at;

	decimal_steps(d.mantissa, d.exponent, VOLUME_CORNER_PART, 1, f->step[0], &at);
	return at;
}

static double power(int32_t exponent)
{
	return decimal_double((struct decimal){1, exponent});
}

double volume_frame_squares(const struct volume_frame *f, volume_i128 v, int part)
{
	double m = (double)f->step[0].mantissa;

	return ldexp((double)v, -part) * (m * m) * power(2 * f->step[0].exponent);
}

double volume_frame_cubes(const struct volume_frame *f, volume_i128 v, int part)
{
	double m = (double)f->step[0].mantissa;

	return ldexp((double)v, -part) * (m * m * (double)f->step[1].mantissa) *
	       power(2 * f->step[0].exponent + f->step[1].exponent);
}
