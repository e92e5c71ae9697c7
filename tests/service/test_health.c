/* Health checks: one for all who ask at once, another when something changed. */
#include "fixture.h"

#include "geoid_priv.h"
#include "health.h"

enum { ANNA = 1001, BERT = 1002, ASKERS = 500 };

/* Not 0: the time that it is for all. */
static _Atomic uint64_t stopped_ns;

uint64_t __real_clock_mono_ns(void);
uint64_t __wrap_clock_mono_ns(void);

uint64_t __wrap_clock_mono_ns(void)
{
	return stopped_ns ? stopped_ns : __real_clock_mono_ns();
}

static unsigned answers;
static struct health seen;

static void looked(void *token, const struct err *why, const struct health *found)
{
	assert_null(why);
	answers++;
	seen = *found;
}

static void grid_text(const char *name, const char *text)
{
	char path[128];
	FILE *f;

	snprintf(path, sizeof path, "%s/geoids/%s.geoid", h.folder, name);
	f = fopen(path, "w");
	assert_non_null(f);
	fputs(text, f);
	fclose(f);
}

static void looks(void **state)
{
	struct service *s = h.service;

	answers = 0;
	turn_until(!s->core->background);
	for (unsigned i = 0; i < ASKERS; i++)
		health_check(s, &me, looked, NULL);
	assert_int_equal(answers, 0);
	assert_int_equal(s->core->background, 1);
	turn_until(answers);
	assert_int_equal(answers, ASKERS);
	assert_int_equal(s->core->background, 0);
	assert_int_equal(seen.geoids, 0);
	assert_true(seen.open_files > 3 && seen.threads > 1);
	/* Within a second it holds, unless something changed. */
	grid_text("a", "nonsense");
	stopped_ns = s->health->last_ns = clock_mono_ns();
	health_check(s, &me, looked, NULL);
	stopped_ns = 0;
	assert_int_equal(answers, ASKERS + 1);
	assert_int_equal(seen.geoids, 0);
	s->geoids->changes++;
	health_check(s, &me, looked, NULL);
	assert_int_equal(answers, ASKERS + 1);
	turn_until(answers == ASKERS + 2);
	assert_int_equal(seen.geoids_bad, 1);
	/* Requests after a change are answered by a new check, not by the one that is under way. */
	s->health->last_ns = 0;
	health_check(s, &me, looked, NULL);
	grid_text("b", "nonsense");
	s->geoids->changes++;
	for (unsigned i = 0; i < ASKERS; i++)
		health_check(s, &me, looked, NULL);
	assert_int_equal(s->core->background, 1);
	turn_until(answers == 2 * ASKERS + 3);
	assert_int_equal(seen.geoids_bad, 2);
	assert_int_equal(s->core->background, 0);
	/* A second later it is looked again. */
	grid_text("c", "nonsense");
	s->health->last_ns -= UINT64_C(1000000001);
	health_check(s, &me, looked, NULL);
	turn_until(answers == 2 * ASKERS + 4);
	assert_int_equal(seen.geoids_bad, 3);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(looks, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
