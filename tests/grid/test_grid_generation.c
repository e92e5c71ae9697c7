/*
 * Generations: sources that are added, removed and restored are read as a model of intervals says, by scan, count and
 * sum; pruned generations are rejected; the tallies of generations are those counted here.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include <cmocka.h>

#include "grid_block.h"
#include "grid_fixture.h"
#include "ledger.h"

enum { SOURCES = 7, GENERATIONS = 12 };

/* The generations of each source, one letter each from the first on. */
static const char *const in[SOURCES] = {
	"xxxxxxxxxxxx",                                                 /* always */
	"xx..xx..xx.x",                                                 /* added and removed repeatedly, present at the end */
	".xxx..xxxx..",                                                 /* and absent at the end */
	"......xxxxxx", "x...........", "..x.x.x.x.x.", "............", /* never present: added and removed at once */
};

static bool alive(unsigned source, uint64_t g)
{
	return g && in[source - 1][g - 1] == 'x';
}

/* The spans of the model, as in a manifest. */
static void set_spans(struct grid_source *s, struct grid_span spans[GENERATIONS])
{
	size_t n = 0;

	for (uint64_t g = 1; g <= GENERATIONS; g++) {
		if (alive(s->id, g) && !alive(s->id, g - 1))
			spans[n++] = (struct grid_span){g, 0};
		if (!alive(s->id, g) && alive(s->id, g - 1))
			spans[n - 1].removed = g;
	}
	s->added = n ? spans[n - 1].added : 3;
	s->removed = n ? spans[n - 1].removed : 3;
	s->earlier = spans;
	s->nearlier = n ? n - 1 : 0;
}

struct collected {
	struct point *pts;
	size_t n, cap;
};

static int collect(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct collected *c = ctx;

	assert_true(c->n + n <= c->cap);
	memcpy(c->pts + c->n, pts, n * sizeof *pts);
	c->n += n;
	return 0;
}

static void check_generation(const struct folder *f, const struct set *all, uint64_t g)
{
	struct reader r = reader_open(f, "m", g, 1 << 20);
	struct collected got = {.pts = malloc(all->n * sizeof *got.pts), .cap = all->n};
	struct digest sum = {0, 0}, told;
	struct err err = ERR_INIT;
	uint64_t count;
	size_t n = 0;
	bool exact;

	CHECK(grid_scan(r.r, 0, UINT64_MAX, collect, &got, &err));
	for (size_t i = 0; i < all->n; i++) {
		if (!alive(all->ids[i], g))
			continue;
		assert_true(n < got.n);
		assert_memory_equal(&got.pts[n], &all->pts[i], sizeof *got.pts);
		digest_add(&sum, grid_record_hash(&all->pts[i]));
		n++;
	}
	assert_int_equal(got.n, n);
	assert_int_equal(grid_points(r.grid), n);
	CHECK(grid_sum(r.r, 0, UINT64_MAX, &told, &err));
	assert_true(digest_equal(told, sum));
	CHECK(grid_count(r.r, 0, UINT64_MAX, &count, &exact, &err));
	assert_true(exact ? count == n : count >= n);
	free(got.pts);
	reader_close(&r);
}

static struct grid_manifest was_live(struct grid_segment_info *info, size_t nsegments,
				     struct grid_span spans[SOURCES][GENERATIONS])
{
	struct grid_manifest m = manifest_of(info, nsegments, SOURCES);

	m.generation = GENERATIONS;
	for (unsigned i = 0; i < SOURCES; i++) {
		m.sources[i].points = 10 + i;
		m.sources[i].hash = (struct digest){i, 100 * i};
		set_spans(&m.sources[i], spans[i]);
	}
	return m;
}

static void test_spans(void **state)
{
	struct set all = set_make(SHAPE_DUPLICATES, 30000, SOURCES, 11);
	struct set half = {all.pts, all.ids, all.n / 2}, rest = {all.pts + all.n / 2, all.ids + all.n / 2, all.n - all.n / 2};
	struct grid_span spans[SOURCES][GENERATIONS];
	struct grid_segment_info info[2];
	struct folder f = folder_new();
	struct err err = ERR_INIT;

	CHECK(stage_set(&f, "a", &half, 0, &info[0], &err));
	CHECK(stage_set(&f, "b", &rest, 0, &info[1], &err));
	struct grid_manifest m = was_live(info, 2, spans);

	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	set_sort(&all);
	for (uint64_t g = 0; g <= GENERATIONS; g++)
		check_generation(&f, &all, g);
	free(m.sources);
	set_free(&all);
	folder_remove(&f);
}

static void test_pruned(void **state)
{
	struct set all = set_make(SHAPE_UNIFORM, 1000, SOURCES, 12);
	struct grid_span spans[SOURCES][GENERATIONS];
	struct grid_segment_info info;
	struct folder f = folder_new();
	struct err err = ERR_INIT;
	struct grid *g;

	CHECK(stage_set(&f, "a", &all, 0, &info, &err));
	struct grid_manifest m = was_live(&info, 1, spans);

	m.oldest = 5;
	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	assert_int_equal(grid_open(f.fd, "m", 4, NULL, 0, &g, &err), -ERR_NOTFOUND);
	assert_non_null(strstr(err.message, "5 to 12"));
	err_clear(&err);
	CHECK(grid_open(f.fd, "m", 5, NULL, 0, &g, &err));
	grid_close(g);
	free(m.sources);
	set_free(&all);
	folder_remove(&f);
}

/* By the model, for each generation. */
static void tally(const struct grid_manifest *m, uint64_t g, struct grid_generation *ret)
{
	*ret = (struct grid_generation){.number = g, .kind = GRID_PUSH, .user = ""};
	for (unsigned i = 1; i <= SOURCES; i++) {
		const struct grid_source *s = &m->sources[i - 1];

		if (alive(i, g) && !alive(i, g - 1)) {
			ret->files++;
			ret->points_added += s->points;
			ret->content.hi += s->hash.hi;
			ret->content.lo += s->hash.lo;
		}
		if (!alive(i, g) && alive(i, g - 1)) {
			ret->files_removed++;
			ret->points_removed += s->points;
		}
	}
}

static void assert_tally(const struct grid_generation *a, const struct grid_generation *b)
{
	assert_true(a->number == b->number && a->files == b->files && a->files_removed == b->files_removed);
	assert_true(a->points_added == b->points_added && a->points_removed == b->points_removed);
	assert_true(digest_equal(a->content, b->content));
}

static void test_tally(void **state)
{
	struct grid_span spans[SOURCES][GENERATIONS];
	struct grid_manifest m = was_live(NULL, 0, spans);
	struct grid_generation all[GENERATIONS], want, one = {.number = 6};

	for (uint64_t g = 1; g <= GENERATIONS; g++)
		all[g - 1] = (struct grid_generation){.number = g, .files = 99, .points_added = 7};
	grid_generations_tally(&m, all, GENERATIONS);
	for (uint64_t g = 1; g <= GENERATIONS; g++) {
		tally(&m, g, &want);
		assert_tally(&all[g - 1], &want);
	}
	grid_generations_tally(&m, &one, 1);
	assert_tally(&one, &all[5]);
	free(m.sources);
}

static int dump(const struct folder *f)
{
	const char *program = getenv("ACUT_GRID_DUMP");
	char command[600];
	int rc;

	if (!program) {
		print_message("ACUT_GRID_DUMP does not say where acut-grid-dump is\n");
		skip();
	}
	snprintf(command, sizeof command, "'%s' --check '%s/m' >/dev/null 2>&1", program, f->path);
	rc = system(command);
	assert_true(rc != -1 && WIFEXITED(rc));
	return WEXITSTATUS(rc);
}

/* acut-grid-dump --check finds a generation that does not agree with the sources, unless it was pruned. */
static void test_dump(void **state)
{
	struct grid_span spans[SOURCES][GENERATIONS];
	struct grid_manifest m = was_live(NULL, 0, spans);
	struct grid_generation all[GENERATIONS];
	struct folder f = folder_new();
	struct err err = ERR_INIT;

	for (uint64_t g = 1; g <= GENERATIONS; g++)
		tally(&m, g, &all[g - 1]);
	m.generations = all;
	m.ngenerations = GENERATIONS;
	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	assert_int_equal(dump(&f), 0);
	all[4].points_removed++;
	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	assert_int_equal(dump(&f), 1);
	m.oldest = 5;
	CHECK(grid_manifest_write(f.fd, "m", &m, &err));
	assert_int_equal(dump(&f), 0);
	free(m.sources);
	folder_remove(&f);
}

/* A source that is restored has all of its spans, in order; beyond what a manifest holds it is refused, unchanged. */
static void test_restore(void **state)
{
	struct grid_source s = {.id = 2};
	struct grid_span *spans[2] = {calloc(UINT16_MAX + 1, sizeof **spans), calloc(UINT16_MAX + 1, sizeof **spans)};
	struct err err = ERR_INIT;

	for (uint64_t g = 1, n = 0; g <= GENERATIONS; g++) { /* as the model has it */
		if (alive(s.id, g) && !alive(s.id, g - 1)) {
			if (!n++)
				s.added = g;
			else
				assert_int_equal(grid_source_restore(&s, g, spans[n & 1], &err), 0);
		}
		if (!alive(s.id, g) && alive(s.id, g - 1))
			s.removed = g;
		for (uint64_t at = 1; at <= g; at++)
			assert_int_equal(grid_source_live(&s, at), alive(s.id, at));
	}
	assert_int_equal(s.nearlier, 3);
	s.nearlier = UINT16_MAX;
	s.earlier = spans[0];
	s.removed = GENERATIONS + 1;
	for (s.kind = GRID_POINTS; s.kind < GRID_SOURCE_KINDS; s.kind++) {
		assert_int_equal(grid_source_restore(&s, GENERATIONS + 2, spans[1], &err), -ERR_LIMIT);
		assert_int_equal(!!strstr(err.message, "lines were"), s.kind == GRID_LINE_VERTICES);
		assert_int_equal(s.removed, GENERATIONS + 1);
		assert_int_equal(s.nearlier, UINT16_MAX);
		err = (struct err)ERR_INIT;
	}
	free(spans[0]);
	free(spans[1]);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_spans), cmocka_unit_test(test_restore), cmocka_unit_test(test_pruned),
		cmocka_unit_test(test_tally), cmocka_unit_test(test_dump),
	};

	no_sync();
	return cmocka_run_group_tests_name("grid: generations", tests, NULL, NULL);
}
