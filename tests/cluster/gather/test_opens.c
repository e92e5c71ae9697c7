/*
 * The phase sum alone reads the records of the phase mesh, each once. A task of gather opens only the packs that can meet its
 * share, of tiles or of one file; finish alone reads the indexes of all packs, and believes no record that says something else
 * than they do.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "gather_priv.h"
#include "io.h"
#include "mesh_fixture.h"
#include "no_sync.h"
#include "repeat.h"

enum { MESHES = 64, GATHERS = 16 };

static char out[160];
static struct io_table table;
static const struct io_table *usual;
static unsigned opens, records;

static int count_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	opens += strstr(path, "mesh/pack-") != NULL;
	records += strstr(path, "done/mesh-") != NULL;
	return usual->openat(dirfd, path, flags, mode);
}

struct gathering {
	struct run run;
	struct ctl_fetch_options options;
	struct gather_params p;
};

/* A work folder up to the phase mesh. */
static void begin(struct gathering *g, const char *tile)
{
	run_gathers = GATHERS;
	set_up(&g->run, set_make(SHAPE_UNIFORM, 40000, 5, 3), 2, MESHES);
	g->run.p.load = 50;
	g->run.p.cap = 20000;
	run_all(&g->run);
	g->options = (struct ctl_fetch_options){.output[1].path = out, .tile = tile};
	g->p = (struct gather_params){.work = g->run.work, .outputs = &g->options, .memory = 64 << 20, .block = 4096};
}

static unsigned packs(const struct gathering *g)
{
	unsigned n = 0;

	for (uint32_t i = 0; i < MESHES; i++) {
		struct mesh_task t;
		struct err err = ERR_INIT;

		CHECK(mesh_task_about(g->run.work, i, &t, &err));
		n += *t.pack != 0;
	}
	return n;
}

static void remove_out(void)
{
	struct err err = ERR_INIT;

	if (unlink(out))
		CHECK(io_folder_remove(AT_FDCWD, out, &err));
}

/* Opens of packs by one task, at most; all tasks together in *ret_all. */
static unsigned count_tasks(const struct gathering *g, unsigned *ret_all)
{
	struct err err = ERR_INIT;
	unsigned most = 0;

	*ret_all = 0;
	opens = records = 0;
	io = &table;
	CHECK(gather_sum(&g->p, &err));
	io = usual;
	assert_true(!opens && records == MESHES);
	records = 0;
	for (uint32_t i = 0; i < GATHERS; i++) {
		opens = 0;
		io = &table;
		CHECK(gather_task(&g->p, i, &err));
		io = usual;
		most = opens > most ? opens : most;
		*ret_all += opens;
	}
	assert_int_equal(records, 0);
	return most;
}

static void check_opens(const char *tile, const char *what, unsigned most_of_task, unsigned most_of_all)
{
	struct err err = ERR_INIT;
	struct gathering g;
	unsigned most, all;

	begin(&g, tile);
	most = count_tasks(&g, &all);
	print_message("%s: %u packs; a task opens %u at most, all together %u\n", what, packs(&g), most, all);
	assert_int_equal(packs(&g), MESHES);
	assert_true(all >= MESHES && most <= most_of_task && all <= most_of_all);
	opens = records = 0;
	io = &table;
	CHECK(gather_finish(&g.p, &err));
	io = usual;
	assert_int_equal(opens, MESHES);
	remove_out();
	run_remove(&g.run);
}

static void test_tiles(void **state)
{
	(void)state;
	check_opens("200", "tiles", 20, 4 * MESHES);
}

/* Of 8 times 8 packs a task has 4, and 12 around them have corners of its triangles. */
static void test_one_file(void **state)
{
	(void)state;
	check_opens(NULL, "one file", 24, 5 * MESHES);
}

/* Where survey and regions are sparse, most positions can be used by triangles of other domains alone, which are looked for. The
 * effort grows with the domains, and not with their square. */
static double fronts_of(size_t points)
{
	struct err err = ERR_INIT;
	uint64_t domains = 0, fronts = 0, extra = 0;
	struct gathering g;

	run_gathers = 4;
	set_up(&g.run, set_make(SHAPE_UNIFORM, points, 5, 3), 2, 8);
	g.run.p.load = 2;
	g.run.p.cap = 20000;
	run_all(&g.run);
	g.options = (struct ctl_fetch_options){.output[1].path = out};
	g.p = (struct gather_params){.work = g.run.work, .outputs = &g.options, .memory = 64 << 20, .block = 4096};
	CHECK(gather_sum(&g.p, &err));
	for (uint32_t i = 0; i < 4; i++) {
		struct work_record *record = NULL;
		uint64_t n[3];

		CHECK(gather_task(&g.p, i, &err));
		CHECK(work_record_need(g.run.work, WORK_GATHER, i, &record, &err));
		CHECK(work_record_u64(record, "domains", &n[0], &err));
		CHECK(work_record_u64(record, "fronts", &n[1], &err));
		CHECK(work_record_u64(record, "extra", &n[2], &err));
		domains += n[0];
		fronts += n[1];
		extra += n[2];
		work_record_free(record);
	}
	CHECK(gather_finish(&g.p, &err));
	print_message("%llu domains, %llu positions without triangles of their own, open vertices read %llu times\n",
		      (unsigned long long)domains, (unsigned long long)extra, (unsigned long long)fronts);
	assert_true(extra > points / 20);
	remove_out();
	run_remove(&g.run);
	return (double)fronts / (double)domains;
}

static void test_sparse(void **state)
{
	double few, many;

	(void)state;
	few = fronts_of(500);
	many = fronts_of(4000);
	assert_true(many < 2 * few);
}

/* The record of a task once more, with another text of a value. */
static void change(const struct gathering *g, uint32_t task, const char *key, const char *text)
{
	struct work_record *record = NULL;
	struct work_attempt *a = NULL;
	struct err err = ERR_INIT;
	char name[64];

	CHECK(work_record_need(g->run.work, WORK_MESH, task, &record, &err));
	snprintf(name, sizeof(name), "done/mesh-%u", task);
	assert_int_equal(unlinkat(work_fd(g->run.work), name, 0), 0);
	unlinkat(work_fd(g->run.work), "done/sum-0", 0);
	CHECK(work_begin(g->run.work, WORK_MESH, task, &a, &err));
	for (size_t i = 0; i < record->nfile; i++)
		CHECK(work_result_file(a, record->file[i].name, &err));
	for (size_t i = 0; i < record->nvalue; i++)
		CHECK(work_result(a, record->value[i].key, strcmp(record->value[i].key, key) ? record->value[i].text : text,
				  &err));
	CHECK(work_publish(a, &err));
	work_end(a);
	work_record_free(record);
}

static char *value_of(const struct gathering *g, uint32_t task, const char *key)
{
	struct work_record *record = NULL;
	struct err err = ERR_INIT;
	char *text;

	CHECK(work_record_need(g->run.work, WORK_MESH, task, &record, &err));
	text = strdup(work_record_text(record, key));
	work_record_free(record);
	return text;
}

static void test_records(void **state)
{
	static const char *const wrong[][2] = {
		{"groups", ""}, {"groups", "3"}, {"groups", "1,7 8 9 10"}, {"box", "1 2 3"}, {"largest", "many"}};
	struct err err = ERR_INIT;
	struct gathering g;
	char *right, *other;
	unsigned all;

	(void)state;
	begin(&g, "5000");
	for (unsigned i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
		right = value_of(&g, 5, wrong[i][0]);
		change(&g, 5, wrong[i][0], wrong[i][1]);
		assert_int_equal(gather_sum(&g.p, &err), -ERR_CORRUPT);
		assert_non_null(strstr(err.message, i == 4 ? "largest" : "mesh 5"));
		err_clear(&err);
		change(&g, 5, wrong[i][0], right);
		free(right);
	}
	/* read without an error, and not true: finish alone can know it */
	count_tasks(&g, &all);
	right = value_of(&g, 5, "groups");
	other = strdup(right);
	other[strlen(other) - 1] ^= 1; /* a digit of the last box */
	change(&g, 5, "groups", other);
	CHECK(gather_sum(&g.p, &err));
	assert_int_equal(gather_finish(&g.p, &err), -ERR_CORRUPT);
	assert_non_null(strstr(err.message, "where its domains are"));
	err_clear(&err);
	change(&g, 5, "groups", right);
	free(right);
	free(other);
	right = value_of(&g, 5, "box");
	change(&g, 5, "box", "-2000000000 0 0 0 0 0");
	CHECK(gather_sum(&g.p, &err));
	assert_int_equal(gather_finish(&g.p, &err), -ERR_INTERNAL);
	err_clear(&err);
	change(&g, 5, "box", right);
	free(right);
	CHECK(gather_sum(&g.p, &err));
	CHECK(gather_finish(&g.p, &err));
	remove_out();
	run_remove(&g.run);
}

/* With less memory for a domain than it needs, nothing is written behind it. */
static void test_largest(void **state)
{
	struct err err = ERR_INIT;
	struct gathering g;

	(void)state;
	begin(&g, "5000");
	for (uint32_t i = 0; i < MESHES; i++)
		change(&g, i, "largest", "1");
	CHECK(gather_sum(&g.p, &err));
	assert_true(gather_task(&g.p, 0, &err) < 0);
	run_remove(&g.run);
	remove_out();
}

static bool want_all(void *ctx, uint64_t domain, uint64_t n, uint64_t first, uint64_t vertices, uint64_t first_triangle,
		     uint64_t triangles)
{
	return true;
}

struct walked {
	uint64_t n, first, triangles;
};

static int take_place(void *ctx, uint64_t domain, const struct gather_place *at, struct err *err)
{
	struct walked *w = ctx;

	assert_true(domain == w->n && at->first == w->first && at->first_triangle == w->triangles);
	w->n++;
	w->first += at->own;
	w->triangles += at->ntriangle;
	return 0;
}

/* What is kept of domains is counted, and never more than it may be. */
static void test_memory(void **state)
{
	const struct gather_places_choice all = {want_all, NULL};
	struct err err = ERR_INIT;
	struct gather_input in = {.p = NULL};
	struct gathering g;
	uint64_t need = 0;

	(void)state;
	begin(&g, NULL);
	CHECK(gather_sum(&g.p, &err));
	CHECK(gather_input_read(&in, &g.p, 0, &err));
	for (int less = 0; less < 2; less++) {
		struct gather_places *places = NULL;
		struct walked w = {0};
		int r;

		CHECK(gather_places_new(&in, less ? need - 1 : 1 << 30, &places, &err));
		r = gather_places_walk(places, &all, take_place, &w, &err);
		if (!less) {
			assert_int_equal(r, 0);
			assert_true(w.n == in.sums.domains && w.first == in.sums.vertices && w.triangles == in.sums.triangles);
			need = gather_places_held(places);
			assert_true(need >= w.n * sizeof(struct gather_place) + MESHES * MESH_GROUPS * sizeof(struct mesh_group));
		} else {
			assert_int_equal(r, -ERR_LIMIT);
			assert_true(gather_places_held(places) < need && w.n < in.sums.domains);
		}
		gather_places_free(places);
	}
	err_clear(&err);
	gather_input_done(&in);
	run_remove(&g.run);
}

static int setup(void **state)
{
	(void)state;
	no_sync();
	run_begin(state);
	snprintf(out, sizeof(out), "%s/out.ply", run_top);
	usual = io;
	table = *usual;
	table.openat = count_openat;
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_tiles),   cmocka_unit_test(test_one_file), cmocka_unit_test(test_sparse),
		cmocka_unit_test(test_records), cmocka_unit_test(test_largest),  cmocka_unit_test(test_memory),
	};

	return cmocka_run_group_tests(tests, setup, run_end);
}
