/*
 * A set of inputs from which inputs are removed (lattice_set.h).
 *
 * The inputs are sorted once in each order that matters for the choice. In each order only the first remaining input
 * counts. Its index only grows, so each order is passed only once. Scales differ if the first and the last input of
 * their order do. Inputs that are alike form a class, and the number of classes is counted.
 */
#include "lattice_set.h"

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "lattice_facts.h"

struct order {
	uint32_t *at;      /* inputs, in order */
	size_t first, end; /* of the inputs that may remain */
};

struct lattice_set {
	const struct lattice_input *inputs;
	size_t n, left;
	bool *gone;
	struct order order[3][LATTICE_ORDERS], bad;
	uint32_t *class, *members; /* class of each input; number of members of each class */
	size_t classes;            /* classes that have members */
	uint64_t steps;
};

struct sorting {
	struct lattice_set *set;
	unsigned axis;
	enum lattice_order by;
};

static int by_order(const void *a, const void *b, void *ctx)
{
	const struct sorting *s = ctx;
	const struct lattice_input *in = s->set->inputs;

	s->set->steps++;
	return lattice_compare(&in[*(const uint32_t *)a], &in[*(const uint32_t *)b], s->axis, s->by);
}

/* Sorts inputs that are alike together. */
static int by_class(const void *a, const void *b, void *ctx)
{
	struct lattice_set *s = ctx;
	const struct lattice_input *x = &s->inputs[*(const uint32_t *)a], *y = &s->inputs[*(const uint32_t *)b];
	int order = (int)x->has_offset - (int)y->has_offset;

	s->steps++;
	for (unsigned i = 0; !order && i < 3; i++) {
		order = decimal_compare(x->scale[i], y->scale[i]);
		if (!order)
			order = decimal_compare(x->offset[i], y->offset[i]);
	}
	return order;
}

static bool make_order(struct lattice_set *s, unsigned axis, enum lattice_order by)
{
	struct order *o = &s->order[axis][by];
	struct sorting sorting = {s, axis, by};

	o->at = malloc(s->n * sizeof *o->at);
	if (!o->at)
		return false;
	for (size_t i = 0; i < s->n; i++)
		if (lattice_in_order(&s->inputs[i], axis, by))
			o->at[o->end++] = (uint32_t)i;
	qsort_r(o->at, o->end, sizeof *o->at, by_order, &sorting);
	return true;
}

/* An input without an offset is a class of its own. */
static bool make_classes(struct lattice_set *s)
{
	uint32_t *at = malloc(s->n * sizeof *at);

	s->class = calloc(s->n, sizeof *s->class);
	s->members = calloc(s->n, sizeof *s->members);
	if (!at || !s->class || !s->members) {
		free(at);
		return false;
	}
	for (size_t i = 0; i < s->n; i++)
		at[i] = (uint32_t)i;
	qsort_r(at, s->n, sizeof *at, by_class, s);
	for (size_t i = 0; i < s->n; i++) {
		s->classes += !i || !lattice_alike(&s->inputs[at[i - 1]], &s->inputs[at[i]]);
		s->class[at[i]] = (uint32_t)s->classes - 1;
		s->members[s->classes - 1]++;
	}
	free(at);
	return true;
}

static bool make_bad(struct lattice_set *s)
{
	s->bad.at = malloc(s->n * sizeof *s->bad.at);
	for (size_t i = 0; s->bad.at && i < s->n; i++)
		if (!lattice_scales_good(&s->inputs[i]))
			s->bad.at[s->bad.end++] = (uint32_t)i;
	return s->bad.at != NULL;
}

struct lattice_set *lattice_set_new(const struct lattice_input *inputs, size_t n)
{
	struct lattice_set *s = calloc(1, sizeof *s);
	bool made = s && n && n < UINT32_MAX;

	if (!made)
		return lattice_set_free(s);
	s->inputs = inputs;
	s->n = s->left = n;
	s->gone = calloc(n, sizeof *s->gone);
	made = s->gone && make_bad(s) && make_classes(s);
	for (unsigned a = 0; a < 3; a++)
		for (enum lattice_order by = 0; by < LATTICE_ORDERS; by++)
			made = made && make_order(s, a, by);
	return made ? s : lattice_set_free(s);
}

/* The first remaining input; NULL: there is none. */
static const struct lattice_input *first_of(struct lattice_set *s, struct order *o)
{
	for (; o->first < o->end && s->gone[o->at[o->first]]; o->first++)
		s->steps++;
	return o->first < o->end ? &s->inputs[o->at[o->first]] : NULL;
}

static const struct lattice_input *last_of(struct lattice_set *s, struct order *o)
{
	for (; o->first < o->end && s->gone[o->at[o->end - 1]]; o->end--)
		s->steps++;
	return o->first < o->end ? &s->inputs[o->at[o->end - 1]] : NULL;
}

/* Finds the input that the error is about: it is first in some order, and has the name in the error. */
static size_t find_input_at_fault(const struct lattice_set *s, const struct lattice_facts *f, const struct err *err)
{
	if (f->bad && !strcmp(f->bad->name, err->file))
		return (size_t)(f->bad - s->inputs);
	for (unsigned a = 0; a < 3; a++)
		for (enum lattice_order by = 0; by < LATTICE_ORDERS; by++)
			if (f->first[a][by] && !strcmp(f->first[a][by]->name, err->file))
				return (size_t)(f->first[a][by] - s->inputs);
	return s->n;
}

int lattice_set_choose(struct lattice_set *s, const struct decimal *scale_xy, const struct decimal *scale_z, struct lattice *ret,
		       size_t *ret_which, struct err *err)
{
	struct lattice_facts f = {.alike = s->classes == 1, .grows = s->inputs[0].grows};
	int rc;

	*ret_which = s->n;
	if (!s->left)
		return err_set(err, ERR_INPUT, "a lattice needs at least one input");
	f.bad = first_of(s, &s->bad);
	for (unsigned a = 0; a < 3; a++) {
		for (enum lattice_order by = 0; by < LATTICE_ORDERS; by++)
			f.first[a][by] = first_of(s, &s->order[a][by]);
		f.scales_differ[a] = decimal_compare(f.first[a][LATTICE_BY_SCALE]->scale[a],
						     last_of(s, &s->order[a][LATTICE_BY_SCALE])->scale[a]) != 0;
	}
	f.alike = f.alike && f.first[0][LATTICE_BY_SCALE]->has_offset;
	rc = lattice_decide(&f, scale_xy, scale_z, ret, err);
	if (rc == -ERR_INPUT)
		*ret_which = find_input_at_fault(s, &f, err);
	return rc;
}

void lattice_set_remove(struct lattice_set *s, size_t i)
{
	s->gone[i] = true;
	s->left--;
	if (--s->members[s->class[i]] == 0)
		s->classes--;
}

size_t lattice_set_left(const struct lattice_set *s)
{
	return s->left;
}

uint64_t lattice_set_steps(const struct lattice_set *s)
{
	return s->steps;
}

struct lattice_set *lattice_set_free(struct lattice_set *s)
{
	if (!s)
		return NULL;
	for (unsigned a = 0; a < 3; a++)
		for (enum lattice_order by = 0; by < LATTICE_ORDERS; by++)
			free(s->order[a][by].at);
	free(s->bad.at);
	free(s->class);
	free(s->members);
	free(s->gone);
	free(s);
	return NULL;
}
