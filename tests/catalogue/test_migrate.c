/*
 * Catalogues of older versions, made by the SQL that those versions ran: all rows are there afterwards, in this
 * version; ids go on where they were; a step that is cut short leaves the old one whole.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>
#include <sqlite3.h>

#include "catalogue.h"
#include "catalogue_fixture.h"
#include "err.h"

#define DATASET_AND_PUSH                                                                                         \
	"CREATE TABLE dataset ("                                                                                 \
	" id INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL UNIQUE, uid INTEGER NOT NULL,"                \
	" created_us INTEGER NOT NULL, pushed_us INTEGER NOT NULL, manifest TEXT NOT NULL,"                      \
	" generation INTEGER NOT NULL, points INTEGER NOT NULL, bytes INTEGER NOT NULL, files INTEGER NOT NULL," \
	" lattice TEXT NOT NULL, crs TEXT NOT NULL, unit_xy TEXT NOT NULL, unit_z TEXT NOT NULL,"                \
	" box_min INTEGER NOT NULL, box_max INTEGER NOT NULL);"                                                  \
	"CREATE TABLE push ("                                                                                    \
	" id INTEGER PRIMARY KEY AUTOINCREMENT, dataset INTEGER NOT NULL, uid INTEGER NOT NULL,"                 \
	" files INTEGER NOT NULL, begun_us INTEGER NOT NULL);"
#define JOB(more)                                                                                       \
	"CREATE TABLE job ("                                                                            \
	" id INTEGER PRIMARY KEY AUTOINCREMENT, dataset INTEGER NOT NULL, generation INTEGER NOT NULL," \
	" view TEXT NOT NULL, state TEXT NOT NULL, uid INTEGER NOT NULL, pid INTEGER NOT NULL,"         \
	" submitted_us INTEGER NOT NULL, finished_us INTEGER NOT NULL, report TEXT NOT NULL,"           \
	" error_code TEXT NOT NULL, error_message TEXT NOT NULL, error_file TEXT NOT NULL,"             \
	" error_field TEXT NOT NULL, error_hint TEXT NOT NULL, error_offset INTEGER NOT NULL" more ");"
/* 9 was given and is gone: it is not given again. */
#define DATASET_ROWS                                                                                           \
	"INSERT INTO dataset VALUES (9,'gone',1000,1,1,'',0,0,0,0,'','','','',0,0);"                           \
	"DELETE FROM dataset WHERE id = 9;"                                                                    \
	"INSERT INTO dataset VALUES (7,'valley',1000,1,2,'manifest-1',1,10,160,1,'0.01 0.01 1 2 3','unknown'," \
	"'metre','metre',-21474836481,6);"                                                                     \
	"INSERT INTO dataset VALUES (3,'ridge',1001,3,4,'manifest-9',5,11,176,2,'l','c','u','z',0,0);"         \
	"INSERT INTO push VALUES (4,7,1000,2,99);"

static const char *const old[] = {
	[1] = "PRAGMA journal_mode = WAL; BEGIN;" DATASET_AND_PUSH JOB("") DATASET_ROWS
	"INSERT INTO job VALUES (5,7,1,'view 1','done',1000,77,11,12,'report','','','','','',-1);"
	"PRAGMA user_version = 1; COMMIT;",
	[2] = "PRAGMA journal_mode = WAL; BEGIN;" DATASET_AND_PUSH JOB(", priority INTEGER NOT NULL DEFAULT 0") DATASET_ROWS
	"INSERT INTO job VALUES (5,7,1,'view 1','done',1000,77,11,12,'report','','','','','',-1,2);"
	"PRAGMA user_version = 2; COMMIT;",
	[3] = "PRAGMA journal_mode = WAL; BEGIN;"
	      "CREATE TABLE dataset (id INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, uid INTEGER NOT NULL,"
	      " created_us INTEGER NOT NULL, pushed_us INTEGER NOT NULL, manifest TEXT NOT NULL,"
	      " generation INTEGER NOT NULL, points INTEGER NOT NULL, bytes INTEGER NOT NULL, files INTEGER NOT NULL,"
	      " lattice TEXT NOT NULL, crs TEXT NOT NULL, unit_xy TEXT NOT NULL, unit_z TEXT NOT NULL,"
	      " box_min INTEGER NOT NULL, box_max INTEGER NOT NULL, removed_us INTEGER NOT NULL DEFAULT 0,"
	      " pinned INTEGER NOT NULL DEFAULT 0, oldest INTEGER NOT NULL DEFAULT 0,"
	      " segments INTEGER NOT NULL DEFAULT 0, sum INTEGER);"
	      "CREATE UNIQUE INDEX dataset_name ON dataset (name) WHERE removed_us = 0;"
	      "CREATE TABLE push (id INTEGER PRIMARY KEY AUTOINCREMENT, dataset INTEGER NOT NULL, uid INTEGER NOT NULL,"
	      " files INTEGER NOT NULL, begun_us INTEGER NOT NULL, sum INTEGER);" JOB(
		      ", priority INTEGER NOT NULL DEFAULT 0, area TEXT NOT NULL DEFAULT '', sum INTEGER") "INSERT INTO dataset VALUES (9,'gone',1000,1,1,'',0,0,0,0,'','','','',0,0,0,0,0,0,NULL);"
													   "DELETE FROM dataset WHERE id = 9;"
													   "INSERT INTO dataset VALUES (7,'valley',1000,1,2,'manifest-1',1,10,160,1,'0.01 0.01 1 2 3','unknown',"
													   "'metre','metre',-21474836481,6,0,0,0,0,NULL);"
													   "INSERT INTO dataset VALUES (3,'ridge',1001,3,4,'manifest-9',5,11,176,2,'l','c','u','z',0,0,0,0,0,0,NULL);"
													   "INSERT INTO push VALUES (4,7,1000,2,99,NULL);"
													   "INSERT INTO job VALUES (5,7,1,'view 1','done',1000,77,11,12,'report','','','','','',-1,2,'',NULL);"
													   "PRAGMA user_version = 3; COMMIT;",
};

static void run(const char *sql)
{
	sqlite3 *db;

	assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
	assert_int_equal(sqlite3_exec(db, sql, NULL, NULL, NULL), SQLITE_OK);
	sqlite3_close(db);
}

static int64_t number(const char *sql)
{
	sqlite3_stmt *s;
	sqlite3 *db;
	int64_t n;

	assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
	assert_int_equal(sqlite3_prepare_v2(db, sql, -1, &s, NULL), SQLITE_OK);
	assert_int_equal(sqlite3_step(s), SQLITE_ROW);
	n = sqlite3_column_int64(s, 0);
	sqlite3_finalize(s);
	sqlite3_close(db);
	return n;
}

struct seen {
	int datasets, jobs, pushes, version;
};

static int see_dataset(void *ctx, const struct catalogue_dataset *d, struct err *err)
{
	((struct seen *)ctx)->datasets++;
	assert_int_equal(d->removed_us, 0);
	assert_false(d->pinned);
	assert_int_equal(d->oldest, 0);
	assert_int_equal(d->segments, 0);
	assert_int_equal(d->gid, UINT32_MAX);
	assert_int_equal(d->mode, 0644);
	if (d->id == 3) {
		assert_string_equal(d->name, "ridge");
		assert_string_equal(d->manifest, "manifest-9");
		assert_int_equal(d->generation, 5);
		return 0;
	}
	assert_int_equal(d->id, 7);
	assert_string_equal(d->name, "valley");
	assert_int_equal(d->points, 10);
	assert_string_equal(d->unit_z, "metre");
	assert_int_equal(d->box[0], -6);
	assert_int_equal(d->box[1], -1);
	assert_int_equal(d->box[3], 6);
	return 0;
}

static int see_job(void *ctx, const struct catalogue_job *j, struct err *err)
{
	struct seen *s = ctx;

	s->jobs++;
	assert_int_equal(j->id, 5);
	assert_string_equal(j->report, "report");
	assert_int_equal(j->error_offset, -1);
	assert_int_equal(j->priority, s->version >= 2 ? 2 : 0);
	assert_string_equal(j->area, "");
	assert_false(j->admin);
	return 0;
}

static int see_push(void *ctx, const struct catalogue_push *p, struct err *err)
{
	((struct seen *)ctx)->pushes++;
	assert_int_equal(p->id, 4);
	assert_int_equal(p->begun_us, 99);
	return 0;
}

static void look(int version)
{
	struct seen seen = {.version = version};
	struct catalogue_reader reader = {&seen, see_dataset, see_job, see_push};
	struct err err = ERR_INIT;
	struct catalogue *c;
	uint64_t last[3];

	assert_int_equal(catalogue_new(path, NULL, &c, &err), 0);
	assert_int_equal(catalogue_load(c, &reader, last, &err), 0);
	assert_int_equal(seen.datasets, 2);
	assert_int_equal(seen.jobs, 1);
	assert_int_equal(seen.pushes, 1);
	assert_int_equal(last[0], 9);
	assert_int_equal(last[1], 5);
	assert_int_equal(last[2], 4);
	catalogue_free(c);
}

static void older(void **state)
{
	for (int version = 1; version <= 3; version++) {
		run(old[version]);
		look(version);
		assert_int_equal(number("PRAGMA user_version"), 4);
		look(version); /* and once more, as what it is now */
		assert_int_equal(number("SELECT count(*) FROM sqlite_sequence WHERE name = 'dataset'"), 1);
		assert_int_equal(number("SELECT count(*) FROM sqlite_sequence"), 3);
		teardown(NULL);
		mkdir(folder, 0700);
	}
}

/* A step that fails is undone whole. */
static void cut_short(void **state)
{
	struct err err = ERR_INIT;
	struct catalogue *c;

	run(old[1]);
	run("CREATE TABLE dataset_3 (x)");
	assert_true(catalogue_new(path, NULL, &c, &err) < 0);
	assert_string_equal(err.file, path);
	assert_int_equal(number("PRAGMA user_version"), 2);
	assert_int_equal(number("SELECT count(*) FROM dataset WHERE name = 'valley'"), 1);
	run("DROP TABLE dataset_3");
	look(1);
}

/* A row that was damaged before is not made whole by the step: its sum does not fit then either. One whose sum fits has
 * one that fits (versions.py: catalogues with sums of version 3). */
static void damaged(void **state)
{
	for (int i = 0; i < 2; i++) {
		struct seen seen = {.version = 3};
		struct catalogue_reader reader = {&seen, see_dataset, see_job, see_push};
		struct err err = ERR_INIT;
		struct catalogue *c;
		uint64_t last[3];

		run(old[3]);
		run(i ? "UPDATE job SET sum = 5" : "UPDATE dataset SET sum = 5 WHERE id = 7");
		assert_int_equal(catalogue_new(path, NULL, &c, &err), 0);
		assert_int_equal(catalogue_load(c, &reader, last, &err), -ERR_CORRUPT);
		assert_non_null(strstr(err.message, i ? "job number 5" : "dataset number 7"));
		catalogue_free(c);
		teardown(NULL);
		mkdir(folder, 0700);
	}
}

/* A catalogue with 10,000 jobs is converted within SQLite's memory. */
static void large(void **state)
{
	struct err err = ERR_INIT;
	struct catalogue *c;

	run(old[3]);
	run("WITH RECURSIVE n(i) AS (SELECT 10 UNION ALL SELECT i + 1 FROM n WHERE i < 10009) INSERT INTO job SELECT i, 7, 1, 'v',"
	    " 'done', 1000, 77, 11, 12, hex(zeroblob(400)), '', '', '', '', '', -1, 2, '', NULL FROM n");
	assert_int_equal(catalogue_new(path, NULL, &c, &err), 0);
	catalogue_free(c);
	assert_int_equal(number("PRAGMA user_version"), 4);
	assert_int_equal(number("SELECT count(*) FROM job"), 10001);
}

/* A newer one is left as it is. */
static void newer(void **state)
{
	struct err err = ERR_INIT;
	struct catalogue *c;

	run(old[3]);
	run("PRAGMA user_version = 5");
	assert_int_equal(catalogue_new(path, NULL, &c, &err), -ERR_VERSION);
	assert_non_null(strstr(err.message, "it has version 5"));
	assert_int_equal(number("PRAGMA user_version"), 5);
}

/* What was removed leaves its name to others, and is not touched when one of them is put. */
static void names(void **state)
{
	struct catalogue_dataset d = {.id = 1,
				      .name = "valley",
				      .manifest = "",
				      .lattice = "",
				      .crs = "",
				      .unit_xy = "",
				      .unit_z = "",
				      .removed_us = 5,
				      .pinned = true,
				      .oldest = 3,
				      .segments = 4,
				      .gid = 17,
				      .mode = 0750};
	struct err err = ERR_INIT;
	struct catalogue *c;

	assert_int_equal(catalogue_new(path, NULL, &c, &err), 0);
	assert_int_equal(catalogue_start(c, &err), 0);
	assert_int_equal(catalogue_put_dataset(c, &d, 0, NULL, NULL, &err), 0);
	d.id = 2;
	d.removed_us = 0;
	assert_int_equal(catalogue_put_dataset(c, &d, 0, NULL, NULL, &err), 0);
	d.id = 3; /* a second one is not put, and 2 stays */
	assert_int_equal(catalogue_put_dataset(c, &d, 0, NULL, NULL, &err), 0);
	catalogue_free(c);
	assert_int_equal(number("SELECT count(*) FROM dataset"), 2);
	assert_int_equal(number("SELECT removed_us FROM dataset WHERE id = 1"), 5);
	assert_int_equal(number("SELECT pinned FROM dataset WHERE id = 1"), 1);
	assert_int_equal(number("SELECT oldest * 10 + segments FROM dataset WHERE id = 1"), 34);
	assert_int_equal(number("SELECT gid * 1000 + mode FROM dataset WHERE id = 1"), 17488);
	assert_int_equal(number("SELECT count(*) FROM dataset WHERE id = 2"), 1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(older, setup, teardown),
		cmocka_unit_test_setup_teardown(cut_short, setup, teardown),
		cmocka_unit_test_setup_teardown(damaged, setup, teardown),
		cmocka_unit_test_setup_teardown(large, setup, teardown),
		cmocka_unit_test_setup_teardown(newer, setup, teardown),
		cmocka_unit_test_setup_teardown(names, setup, teardown),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
