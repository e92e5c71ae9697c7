/* How a set of inputs gets one system, plane and lattice: without files, a daemon or a dataset. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "agree_set.h"
#include "err.h"

enum { MOST = 4 };

/* Inputs, in the order of `order`. */
struct set {
	struct agree_input in[MOST];
	struct crs_info crs[MOST], plane[4 * MOST];
	bool excluded[MOST];
	struct err why[MOST];
	size_t order[MOST], n, nplanes;
};

static struct agree_input *at(void *ctx, size_t i)
{
	struct set *s = ctx;

	return s->excluded[s->order[i]] ? NULL : &s->in[s->order[i]];
}

static int exclude(void *ctx, size_t i, const struct err *why)
{
	struct set *s = ctx;

	s->excluded[s->order[i]] = true;
	s->why[s->order[i]] = *why;
	return 0;
}

static const struct crs_info *keep(void *ctx, const struct crs_info *crs)
{
	struct set *s = ctx;

	assert_true(s->nplanes < 4 * MOST);
	s->plane[s->nplanes] = *crs;
	return &s->plane[s->nplanes++];
}

static struct agree_inputs inputs_of(struct set *s)
{
	return (struct agree_inputs){.n = s->n, .at = at, .exclude = exclude, .keep = keep, .ctx = s};
}

/* `crs`: as of --assume-crs; "": none. The box is x to x + 1. */
static void add(struct set *s, const char *name, const char *crs, double x, double y, const char *scale)
{
	struct agree_input *in = &s->in[s->n];
	struct err err = ERR_INIT;

	crs_info_clear(&s->crs[s->n]);
	if (*crs)
		assert_int_equal(crs_assume_text(crs, strlen(crs), &s->crs[s->n], &err), 0);
	*in = (struct agree_input){.name = name, .crs = &s->crs[s->n], .coords = {.name = name, .has_offset = true}};
	for (int k = 0; k < 3; k++) {
		double low = k == 0 ? x : k == 1 ? y : 100;

		decimal_parse(scale, &in->coords.scale[k]);
		in->coords.offset[k] = (struct decimal){0, 0};
		in->coords.min[k] = low;
		in->coords.max[k] = low + 1;
	}
	s->order[s->n] = s->n;
	s->n++;
}

static void begin(struct agree *a, const struct agree_words *words)
{
	struct err err = ERR_INIT;

	assert_int_equal(agree_init(a, words, &err), 0);
	assert_int_equal(agree_said(a, words, &err), 0);
	assert_int_equal(agree_plane_words(a, &err), 0);
	a->dataset = "valley";
}

static int all(struct agree *a, struct set *s, struct err *err)
{
	const struct agree_inputs in = inputs_of(s);
	int r = agree_plane_choose(a, &in, err);

	if (!r)
		r = agree_crs(a, &in, err);
	return r ? r : agree_lattice(a, &in, err);
}

static void swap(struct set *s)
{
	size_t first = s->order[0];

	s->order[0] = s->order[s->n - 1];
	s->order[s->n - 1] = first;
}

static void systems_that_differ_are_refused_in_any_order(void **state)
{
	static const struct agree_words none;
	char said[2][sizeof((struct err){0}.message)];

	for (int turned = 0; turned < 2; turned++) {
		static struct set s;
		struct agree a;
		struct err err = ERR_INIT;

		s = (struct set){.n = 0};
		add(&s, "a.las", "EPSG:25832", 500000, 5200000, "0.01");
		add(&s, "b.las", "EPSG:25833", 500000, 5200000, "0.01");
		if (turned)
			swap(&s);
		begin(&a, &none);
		assert_int_equal(all(&a, &s, &err), -ERR_INPUT);
		assert_string_equal(err.file, "a.las");
		snprintf(said[turned], sizeof said[turned], "%s", err.message);
		agree_done(&a);
	}
	assert_string_equal(said[0], said[1]);
	assert_non_null(strstr(said[0], "b.las"));
}

static void degrees_go_to_the_zone_in_the_middle(void **state)
{
	static const struct agree_words none;
	static struct set s;
	struct input_options options = {.format = NULL};
	struct agree_step step;
	struct agree a;
	struct err err = ERR_INIT;

	s = (struct set){.n = 0};
	add(&s, "a.las", "EPSG:4326", 11, 47, "0.0000001");
	add(&s, "b.las", "EPSG:4326", 12.5, 47, "0.0000001");
	begin(&a, &none);
	assert_int_equal(all(&a, &s, &err), 0);
	assert_true(a.projects);
	assert_int_equal(a.zone.number, 33);
	assert_string_equal(a.crs, "EPSG:32633");
	assert_string_equal(a.unit_xy, "metre");
	assert_string_equal(a.crs_of, "a.las");
	assert_int_equal(agree_step_of(&a, "a.las", s.in[0].crs, &step, &err), 0);
	assert_true(step.needed && step.projects);
	assert_string_equal(step.plane.text, "EPSG:32633");
	/* A file that says something else than its header said. */
	assert_int_equal(agree_step_of(&a, "c.las", &s.plane[0], &step, &err), 0);
	assert_false(step.needed);
	crs_info_clear(&s.crs[1]);
	assert_int_equal(agree_step_of(&a, "b.las", &s.crs[1], &step, &err), -ERR_INPUT);
	/* Degrees of a text keep their digits. */
	a.has_lattice = true;
	agree_input_options(&a, agree_projects(&a, s.in[0].crs), &options);
	assert_true(options.degrees);
	assert_int_equal(options.scale_xy.exponent, -9);
	agree_done(&a);
}

static void an_input_that_fits_no_lattice_is_excluded(void **state)
{
	static const struct agree_words none;
	static struct set s;
	struct agree a;
	struct err err = ERR_INIT;

	s = (struct set){.n = 0};
	add(&s, "a.las", "", 0, 0, "0.01");
	add(&s, "b.las", "", 0, 0, "0.01");
	s.in[1].coords.scale[0] = (struct decimal){0, 0};
	add(&s, "c.las", "", 5, 5, "0.01");
	begin(&a, &none);
	assert_int_equal(all(&a, &s, &err), 0);
	assert_true(!s.excluded[0] && s.excluded[1] && !s.excluded[2]);
	assert_int_equal(s.why[1].code, ERR_INPUT);
	assert_string_equal(s.why[1].file, "b.las");
	assert_int_equal(a.lattice.scale_xy.exponent, -2);
	agree_done(&a);
}

static void a_dataset_binds_its_inputs(void **state)
{
	static const struct agree_words none, override = {.override = {"EPSG:25832"}};
	static struct set s;
	char was[AGREE_OVERRIDDEN];
	struct agree a;
	struct err err = ERR_INIT;

	s = (struct set){.n = 0};
	add(&s, "a.las", "EPSG:4258", 14, 47, "0.0000001");
	begin(&a, &none);
	agree_fix(&a, "EPSG:25832", "metre", "unknown");
	assert_int_equal(all(&a, &s, &err), 0);
	assert_int_equal(a.zone.number, 32);
	assert_true(agree_is(&a, "EPSG:25832", "unknown", "unknown")); /* the number says its unit */
	assert_false(agree_is(&a, "EPSG:25833", "metre", "unknown"));
	agree_unfix(&a);
	s = (struct set){.n = 0};
	add(&s, "a.las", "EPSG:4258", 14, 47, "0.0000001");
	assert_int_equal(all(&a, &s, &err), 0);
	assert_int_equal(a.zone.number, 33);
	agree_done(&a);

	/* What a person says takes the place of what the records say, which is told. */
	begin(&a, &override);
	assert_int_equal(agree_say(&a, "a.las", &s.crs[0], was, &err), 0);
	assert_string_equal(s.crs[0].text, "EPSG:25832");
	assert_non_null(strstr(was, "EPSG:4258"));
	agree_done(&a);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(systems_that_differ_are_refused_in_any_order),
		cmocka_unit_test(degrees_go_to_the_zone_in_the_middle),
		cmocka_unit_test(an_input_that_fits_no_lattice_is_excluded),
		cmocka_unit_test(a_dataset_binds_its_inputs),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
