/*
 * The lattice of a push, chosen from the headers of all probed files.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "io.h"
#include "lattice_set.h"
#include "push_priv.h"

static int scale_of(const char *text, const char *field, struct decimal *ret, struct err *err)
{
	if (!decimal_parse(text, ret) || ret->mantissa <= 0) {
		err_set(err, ERR_USAGE, "\"%.40s\" is not a scale: a decimal above zero is wanted", text);
		return err_add_place(err, ERR_NO_OFFSET, field);
	}
	return 0;
}

/* Excludes, one by one, inputs that do not fit one lattice with the others. Each gets its error as the answer to its File; the
 * last error is the push's. */
static int choose_of_fewer(struct push *p, const struct lattice_input *inputs, struct push_probed **probes, size_t n,
			   const struct decimal *xy, const struct decimal *z, struct err *err)
{
	struct lattice_set *set = lattice_set_new(inputs, n);
	size_t which;
	int r;

	err_clear(err);
	if (!set)
		return err_set(err, ERR_NOMEM, "no memory to choose a lattice");
	while ((r = lattice_set_choose(set, xy, z, &p->lattice, &which, err))) {
		if (which == n || lattice_set_left(set) == 1 || atomic_load(&p->cancel) || push_exclude(probes[which], err))
			break;
		lattice_set_remove(set, which);
		err_clear(err);
	}
	lattice_set_free(set);
	return r;
}

/* Degrees that are taken as a plane are rounded less than lengths. */
static void limit_rounding(const struct push_probed *probe, struct lattice_input *c)
{
	static const struct decimal degrees = {1, -9};

	for (int k = 0; k < 2; k++)
		if (probe->crs->plane == CRS_PLANE_GEOGRAPHIC && c->coarsest[k].mantissa &&
		    decimal_compare(c->coarsest[k], degrees) > 0)
			c->coarsest[k] = degrees;
}

static bool rounds(const struct push_probed *probe, unsigned axis, struct decimal scale)
{
	const struct lattice_input *c = &probe->coords;

	return !probe->excluded && !probe->lines &&
	       (c->rounds[axis] || (c->coarsest[axis].mantissa && decimal_compare(c->scale[axis], scale) < 0));
}

/* Notes the chosen scale if nobody asked for it and inputs have more digits. */
static void note_rounding(struct push *p)
{
	char more[48] = "", xy[DECIMAL_TEXT_SIZE], z[DECIMAL_TEXT_SIZE];
	const struct push_probed *first = NULL;
	bool any_xy = false, any_z = false;
	size_t n = 0;

	*p->lattice_note = 0;
	for (size_t i = 0; i < p->nprobes; i++) {
		const struct push_probed *probe = &p->probes[i];
		bool of_xy = !*p->scale_xy && (rounds(probe, 0, p->lattice.scale_xy) || rounds(probe, 1, p->lattice.scale_xy));
		bool of_z = !*p->scale_z && rounds(probe, 2, p->lattice.scale_z);

		any_xy |= of_xy;
		any_z |= of_z;
		if ((of_xy || of_z) && !n++)
			first = probe;
	}
	if (!n)
		return;
	if (n > 1)
		snprintf(more, sizeof more, " and %zu more", n - 1);
	snprintf(p->lattice_note, sizeof p->lattice_note,
		 "%.160s%s: the coordinates have more digits than fit into 32 bits%s: %s%s%s%s%s, the finest scale that fits; "
		 "to use another, give --scale XY,Z",
		 first->name, more, p->dataset->onestep ? "" : " with room for later pushes",
		 any_xy ? "x and y are rounded to " : "", any_xy ? decimal_text(p->lattice.scale_xy, xy) : "",
		 any_xy && any_z ? ", " : "", any_z ? any_xy ? "z to " : "z is rounded to " : "",
		 any_z ? decimal_text(p->lattice.scale_z, z) : "");
}

/*
 * Files of lines often have the digits of doubles, or few digits. Beside points they have the scale of these, whatever digits
 * they have, so that no error about the scale is about them; without points a scale no finer than a thousandth of the unit. They
 * are rounded to it.
 */
static void scale_lines(struct push_probed *const *probe, struct lattice_input *input, size_t n)
{
	static const struct decimal thousandth = {1, -3}, degrees = {1, -9};

	for (unsigned k = 0; k < 3; k++) {
		struct decimal finest = {0, 0};

		for (size_t i = 0; i < n; i++)
			if (!probe[i]->lines && (!finest.mantissa || decimal_compare(input[i].scale[k], finest) < 0))
				finest = input[i].scale[k];
		for (size_t i = 0; i < n; i++) {
			bool planar_degrees = k < 2 && probe[i]->crs->plane == CRS_PLANE_GEOGRAPHIC;
			struct decimal least = finest.mantissa ? finest : planar_degrees ? degrees : thousandth;

			bool finer = decimal_compare(input[i].scale[k], least) < 0;

			if (!probe[i]->lines || (!finer && !finest.mantissa))
				continue;
			input[i].scale[k] = least;
			if (input[i].coarsest[k].mantissa && decimal_compare(input[i].coarsest[k], least) < 0)
				input[i].coarsest[k] = least;
		}
	}
}

/* Worker. From all headers, so the order of files does not matter. */
int push_choose_lattice(struct push *p, struct err *err)
{
	struct decimal xy, z;
	struct lattice_input *inputs;
	struct push_probed **probes;
	size_t i, n = 0;
	int r = 0;

	if (*p->scale_xy)
		r = scale_of(p->scale_xy, "scale_xy", &xy, err);
	if (!r && *p->scale_z)
		r = scale_of(p->scale_z, "scale_z", &z, err);
	if (r)
		return r;
	if (!p->nprobes)
		return err_set(err, ERR_USAGE, "no input was probed: there is nothing to choose a lattice from");
	inputs = calloc(p->nprobes, sizeof *inputs);
	probes = calloc(p->nprobes, sizeof *probes);
	if (!inputs || !probes)
		r = err_set(err, ERR_NOMEM, "no memory to choose a lattice");
	for (i = 0; !r && i < p->nprobes; i++) {
		if (p->probes[i].excluded)
			continue;
		r = push_plane_coords(p, &p->probes[i], err);
		limit_rounding(&p->probes[i], &p->probes[i].coords);
		probes[n] = &p->probes[i];
		inputs[n] = p->probes[i].coords;
		inputs[n++].grows = !p->dataset->onestep;
	}
	if (!r)
		scale_lines(probes, inputs, n);
	if (!r)
		r = lattice_choose(inputs, n, *p->scale_xy ? &xy : NULL, *p->scale_z ? &z : NULL, &p->lattice, err);
	if (r == -ERR_INPUT && n > 1 && *err->file)
		r = choose_of_fewer(p, inputs, probes, n, *p->scale_xy ? &xy : NULL, *p->scale_z ? &z : NULL, err);
	if (!r)
		note_rounding(p);
	free(inputs);
	free(probes);
	return r;
}
