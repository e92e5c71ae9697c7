/*
 * A task of gather opens only the packs that can meet its share, and finds these by records; finish alone reads the indexes of
 * all packs, and believes no record that says something else than they do.
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

#include "gather.h"
#include "io.h"
#include "mesh_fixture.h"
#include "no_sync.h"
#include "repeat.h"

enum { MESHES = 64, GATHERS = 16 };

static char out[160];
static struct io_table table;
static const struct io_table *usual;
static unsigned opens;

static int count_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	opens += strstr(path, "mesh/pack-") != NULL;
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
	for (uint32_t i = 0; i < GATHERS; i++) {
		opens = 0;
		io = &table;
		CHECK(gather_task(&g->p, i, &err));
		io = usual;
		most = opens > most ? opens : most;
		*ret_all += opens;
	}
	return most;
}

static void test_tiles(void **state)
{
	struct err err = ERR_INIT;
	struct gathering g;
	unsigned most, all;

	(void)state;
	begin(&g, "40");
	most = count_tasks(&g, &all);
	print_message("%u packs; a task opens %u at most, all together %u\n", packs(&g), most, all);
	assert_int_equal(packs(&g), MESHES);
	assert_true(all >= MESHES && most <= 20 && all <= 4 * MESHES);
	opens = 0;
	io = &table;
	CHECK(gather_finish(&g.p, &err));
	io = usual;
	assert_int_equal(opens, MESHES);
	remove_out();
	run_remove(&g.run);
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
	begin(&g, "40");
	for (unsigned i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++) {
		right = value_of(&g, 5, wrong[i][0]);
		change(&g, 5, wrong[i][0], wrong[i][1]);
		assert_int_equal(gather_task(&g.p, 0, &err), -ERR_CORRUPT);
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
	assert_int_equal(gather_finish(&g.p, &err), -ERR_CORRUPT);
	assert_non_null(strstr(err.message, "where its domains are"));
	err_clear(&err);
	change(&g, 5, "groups", right);
	free(right);
	free(other);
	right = value_of(&g, 5, "box");
	change(&g, 5, "box", "-2000000000 0 0 0 0 0");
	assert_int_equal(gather_finish(&g.p, &err), -ERR_INTERNAL);
	err_clear(&err);
	change(&g, 5, "box", right);
	free(right);
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
	begin(&g, "40");
	for (uint32_t i = 0; i < MESHES; i++)
		change(&g, i, "largest", "1");
	assert_true(gather_task(&g.p, 0, &err) < 0);
	run_remove(&g.run);
	remove_out();
}

static int setup(void **state)
{
	(void)state;
	no_sync();
	repeat_folder(run_top, sizeof(run_top), "opens");
	snprintf(out, sizeof(out), "%s/out", run_top);
	usual = io;
	table = *usual;
	table.openat = count_openat;
	return 0;
}

static int teardown(void **state)
{
	(void)state;
	return repeat_remove(run_top);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_tiles),
		cmocka_unit_test(test_records),
		cmocka_unit_test(test_largest),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
