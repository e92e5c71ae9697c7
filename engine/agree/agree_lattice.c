/* The lattice of a set of inputs, chosen from the headers of all of them (agree_set.h). */
#include "agree_set.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "lattice_set.h"

static int scale_of(const char *text, const char *field, struct decimal *ret, struct err *err)
{
	if (!decimal_parse(text, ret) || ret->mantissa <= 0) {
		err_set(err, ERR_USAGE, "\"%.40s\" is not a scale: a decimal above zero is wanted", text);
		return err_add_place(err, ERR_NO_OFFSET, field);
	}
	return 0;
}

/* The inputs that are not excluded; `which` has their numbers. */
struct chosen {
	struct lattice_input *coords;
	struct agree_input **input;
	size_t *which, n;
	struct decimal xy, z;         /* the scales that are asked for */
	struct decimal *at_xy, *at_z; /* NULL: none is */
};

/* Excludes, one by one, inputs that do not fit one lattice with the others. The last error is that of all. */
static int choose_of_fewer(struct agree *a, const struct agree_inputs *in, const struct chosen *c, struct err *err)
{
	struct lattice_set *set = lattice_set_new(c->coords, c->n);
	size_t which;
	int r;

	err_clear(err);
	if (!set)
		return err_set(err, ERR_NOMEM, "no memory to choose a lattice");
	while ((r = lattice_set_choose(set, c->at_xy, c->at_z, &a->lattice, &which, err))) {
		if (which == c->n || lattice_set_left(set) == 1 || in->exclude(in->ctx, c->which[which], err))
			break;
		lattice_set_remove(set, which);
		err_clear(err);
	}
	lattice_set_free(set);
	return r;
}

static int coords_on_plane(const struct agree *a, struct agree_input *one, struct err *err)
{
	struct agree_step step;
	int r;

	if (one->on_plane)
		return 0;
	r = agree_plane_of(a, one->crs, &step, err);
	step.params.coords = &one->coords;
	if (!r && step.needed)
		r = crs_step_coords(&step.params, &one->coords, err);
	one->on_plane = !r;
	return r ? err_add_file(err, one->name) : 0;
}

/* Degrees that are taken as a plane are rounded less than lengths. */
static void limit_rounding(const struct agree_input *one, struct lattice_input *c)
{
	static const struct decimal degrees = {1, -9};

	for (int k = 0; k < 2; k++)
		if (one->crs->plane == CRS_PLANE_GEOGRAPHIC && c->coarsest[k].mantissa &&
		    decimal_compare(c->coarsest[k], degrees) > 0)
			c->coarsest[k] = degrees;
}

static bool rounds(const struct agree_input *one, unsigned axis, struct decimal scale)
{
	const struct lattice_input *c = &one->coords;

	return !one->lines && (c->rounds[axis] || (c->coarsest[axis].mantissa && decimal_compare(c->scale[axis], scale) < 0));
}

/* Notes the chosen scale if nobody asked for it and inputs have more digits. */
static void note_rounding(struct agree *a, const struct agree_inputs *in)
{
	char more[48] = "", xy[DECIMAL_TEXT_SIZE], z[DECIMAL_TEXT_SIZE];
	const struct agree_input *first = NULL;
	bool any_xy = false, any_z = false;
	size_t n = 0;

	*a->note = 0;
	for (size_t i = 0; i < in->n; i++) {
		const struct agree_input *one = in->at(in->ctx, i);
		bool of_xy = one && !*a->scale_xy && (rounds(one, 0, a->lattice.scale_xy) || rounds(one, 1, a->lattice.scale_xy));
		bool of_z = one && !*a->scale_z && rounds(one, 2, a->lattice.scale_z);

		any_xy |= of_xy;
		any_z |= of_z;
		if ((of_xy || of_z) && !n++)
			first = one;
	}
	if (!n)
		return;
	if (n > 1)
		snprintf(more, sizeof more, " and %zu more", n - 1);
	snprintf(a->note, sizeof a->note,
		 "%.160s%s: the coordinates have more digits than fit into 32 bits%s: %s%s%s%s%s, the finest scale that fits; "
		 "to use another, give --scale XY,Z",
		 first->name, more, a->grows ? " with room for later pushes" : "", any_xy ? "x and y are rounded to " : "",
		 any_xy ? decimal_text(a->lattice.scale_xy, xy) : "", any_xy && any_z ? ", " : "",
		 any_z ? any_xy ? "z to " : "z is rounded to " : "", any_z ? decimal_text(a->lattice.scale_z, z) : "");
}

/*
 * Files of lines often have the digits of doubles, or few digits. Beside points they have the scale of these, whatever digits
 * they have, so that no error about the scale is about them; without points a scale no finer than a thousandth of the unit. They
 * are rounded to it.
 */
static void scale_lines(struct agree_input *const *from, struct lattice_input *input, size_t n)
{
	static const struct decimal thousandth = {1, -3}, degrees = {1, -9};

	for (unsigned k = 0; k < 3; k++) {
		struct decimal finest = {0, 0};

		for (size_t i = 0; i < n; i++)
			if (!from[i]->lines && (!finest.mantissa || decimal_compare(input[i].scale[k], finest) < 0))
				finest = input[i].scale[k];
		for (size_t i = 0; i < n; i++) {
			bool planar_degrees = k < 2 && from[i]->crs->plane == CRS_PLANE_GEOGRAPHIC;
			struct decimal least = finest.mantissa ? finest : planar_degrees ? degrees : thousandth;

			bool finer = decimal_compare(input[i].scale[k], least) < 0;

			if (!from[i]->lines || (!finer && !finest.mantissa))
				continue;
			input[i].scale[k] = least;
			if (input[i].coarsest[k].mantissa && decimal_compare(input[i].coarsest[k], least) < 0)
				input[i].coarsest[k] = least;
		}
	}
}

static int collect(struct agree *a, const struct agree_inputs *in, struct chosen *c, struct err *err)
{
	for (size_t i = 0; i < in->n; i++) {
		struct agree_input *one = in->at(in->ctx, i);

		if (!one)
			continue;
		if (coords_on_plane(a, one, err))
			return -(int)err->code;
		limit_rounding(one, &one->coords);
		c->input[c->n] = one;
		c->which[c->n] = i;
		c->coords[c->n] = one->coords;
		c->coords[c->n++].grows = a->grows;
	}
	scale_lines(c->input, c->coords, c->n);
	return 0;
}

/* All numbers of a lattice with scale `of` are on one with this scale: k shifts by whole steps. */
static bool divides(struct decimal scale, struct decimal of)
{
	struct decimal whole = scale;
	int64_t steps;

	return decimal_steps(of.mantissa, of.exponent, 1, 1, scale, &steps) &&
	       !__builtin_mul_overflow(scale.mantissa, steps, &whole.mantissa) && !decimal_compare(whole, of);
}

static bool box_fits(const struct lattice *l, const struct lattice_input *in)
{
	for (int k = 0; k < 3; k++) {
		double scale = decimal_double(k < 2 ? l->scale_xy : l->scale_z);
		double low = in->min[k] / scale - (double)l->k[k], high = in->max[k] / scale - (double)l->k[k];

		/* A box that is not finite or inverted says nothing. */
		if (!(low <= high && low > INT32_MIN && high < INT32_MAX))
			return false;
	}
	return true;
}

/* The chosen lattice has no number that the near one has not, and all inputs fit. */
static bool takes_near(const struct agree *a, const struct agree_inputs *in, const struct chosen *c)
{
	const struct lattice *l = a->near;

	if (!l || (c->at_xy && decimal_compare(c->xy, l->scale_xy)) || (c->at_z && decimal_compare(c->z, l->scale_z)) ||
	    !divides(l->scale_xy, a->lattice.scale_xy) || !divides(l->scale_z, a->lattice.scale_z))
		return false;
	for (size_t i = 0; i < c->n; i++)
		if (in->at(in->ctx, c->which[i]) && !box_fits(l, &c->coords[i]))
			return false;
	return true;
}

int agree_lattice(struct agree *a, const struct agree_inputs *in, struct err *err)
{
	struct chosen c = {.n = 0};
	int r = 0;

	if (*a->scale_xy)
		r = scale_of(a->scale_xy, "scale_xy", c.at_xy = &c.xy, err);
	if (!r && *a->scale_z)
		r = scale_of(a->scale_z, "scale_z", c.at_z = &c.z, err);
	if (r)
		return r;
	if (!in->n)
		return err_set(err, ERR_USAGE, "no input was probed: there is nothing to choose a lattice from");
	c.coords = calloc(in->n, sizeof *c.coords);
	c.input = calloc(in->n, sizeof *c.input);
	c.which = calloc(in->n, sizeof *c.which);
	if (!c.coords || !c.input || !c.which)
		r = err_set(err, ERR_NOMEM, "no memory to choose a lattice");
	if (!r)
		r = collect(a, in, &c, err);
	if (!r)
		r = lattice_choose(c.coords, c.n, c.at_xy, c.at_z, &a->lattice, err);
	if (r == -ERR_INPUT && c.n > 1 && *err->file)
		r = choose_of_fewer(a, in, &c, err);
	if (!r && takes_near(a, in, &c))
		a->lattice = *a->near;
	if (!r)
		note_rounding(a, in);
	free(c.coords);
	free(c.input);
	free(c.which);
	return r;
}
