/* Reading the catalogue, before it starts: each row is handed over, its texts borrowed. */
#include "catalogue_priv.h"

#include <string.h>

#include "err.h"
#include "progress.h"

static const char *text(sqlite3_stmt *s, int i)
{
	const char *t = (const char *)sqlite3_column_text(s, i);

	return t ? t : "";
}

static int read_dataset(sqlite3_stmt *s, const struct catalogue_reader *to, struct err *err)
{
	struct catalogue_dataset d = {
		.id = (uint64_t)sqlite3_column_int64(s, 0),
		.name = text(s, 1),
		.uid = (uint32_t)sqlite3_column_int64(s, 2),
		.created_us = sqlite3_column_int64(s, 3),
		.pushed_us = sqlite3_column_int64(s, 4),
		.manifest = text(s, 5),
		.generation = (uint64_t)sqlite3_column_int64(s, 6),
		.points = (uint64_t)sqlite3_column_int64(s, 7),
		.bytes = (uint64_t)sqlite3_column_int64(s, 8),
		.files = (uint32_t)sqlite3_column_int64(s, 9),
		.lattice = text(s, 10),
		.crs = text(s, 11),
		.unit_xy = text(s, 12),
		.unit_z = text(s, 13),
		.box = {(int32_t)(sqlite3_column_int64(s, 14) >> 32), (int32_t)sqlite3_column_int64(s, 14),
			(int32_t)(sqlite3_column_int64(s, 15) >> 32), (int32_t)sqlite3_column_int64(s, 15)},
		.removed_us = sqlite3_column_int64(s, 16),
		.pinned = sqlite3_column_int64(s, 17) != 0,
		.oldest = (uint64_t)sqlite3_column_int64(s, 18),
		.segments = (uint32_t)sqlite3_column_int64(s, 19),
		.gid = (uint32_t)sqlite3_column_int64(s, 20),
		.mode = (uint32_t)sqlite3_column_int64(s, 21),
	};

	return to->dataset(to->ctx, &d, err);
}

static int read_job(sqlite3_stmt *s, const struct catalogue_reader *to, struct err *err)
{
	struct catalogue_job j = {
		.id = (uint64_t)sqlite3_column_int64(s, 0),
		.dataset = (uint64_t)sqlite3_column_int64(s, 1),
		.generation = (uint64_t)sqlite3_column_int64(s, 2),
		.view = text(s, 3),
		.state = text(s, 4),
		.uid = (uint32_t)sqlite3_column_int64(s, 5),
		.pid = (uint32_t)sqlite3_column_int64(s, 6),
		.submitted_us = sqlite3_column_int64(s, 7),
		.finished_us = sqlite3_column_int64(s, 8),
		.report = text(s, 9),
		.error_code = text(s, 10),
		.error_message = text(s, 11),
		.error_file = text(s, 12),
		.error_field = text(s, 13),
		.error_hint = text(s, 14),
		.error_offset = sqlite3_column_int64(s, 15),
		.priority = (uint32_t)sqlite3_column_int64(s, 16),
		.area = text(s, 17),
		.admin = sqlite3_column_int64(s, 18) != 0,
	};

	return to->job(to->ctx, &j, err);
}

static int read_push(sqlite3_stmt *s, const struct catalogue_reader *to, struct err *err)
{
	struct catalogue_push p = {
		.id = (uint64_t)sqlite3_column_int64(s, 0),
		.dataset = (uint64_t)sqlite3_column_int64(s, 1),
		.uid = (uint32_t)sqlite3_column_int64(s, 2),
		.files = (uint32_t)sqlite3_column_int64(s, 3),
		.begun_us = sqlite3_column_int64(s, 4),
	};

	return to->push(to->ctx, &p, err);
}

static int read_last(sqlite3_stmt *s, const struct catalogue_reader *to, struct err *err)
{
	static const char *const names[3] = {"dataset", "job", "push"};
	uint64_t *last = to->ctx;

	for (int i = 0; i < 3; i++)
		if (!strcmp(text(s, 0), names[i]))
			last[i] = (uint64_t)sqlite3_column_int64(s, 1);
	return 0;
}

/* `table`: its rows have checksums; NULL: not. */
static int read_all(struct catalogue *c, const char *table, const char *sql,
		    int (*row)(sqlite3_stmt *, const struct catalogue_reader *, struct err *),
		    const struct catalogue_reader *to, struct err *err)
{
	sqlite3_stmt *s;
	int r = 0, step;

	if (sqlite3_prepare_v2(c->db, sql, -1, &s, NULL) != SQLITE_OK)
		return catalogue_failed(c, err, "the catalogue cannot be read");
	while (!r && (step = sqlite3_step(s)) != SQLITE_DONE) {
		if (step != SQLITE_ROW)
			r = catalogue_failed(c, err, "the catalogue cannot be read");
		else if (table)
			r = catalogue_sum_check(s, table, err);
		if (!r)
			r = row(s, to, err);
		progress_step();
	}
	sqlite3_finalize(s);
	return r;
}

int catalogue_load(struct catalogue *c, const struct catalogue_reader *to, uint64_t ret_last[3],
		   struct err *err)
{
	struct catalogue_reader last = {.ctx = ret_last};
	int r;

	ret_last[0] = ret_last[1] = ret_last[2] = 0;
	r = read_all(c, NULL, "SELECT name, seq FROM sqlite_sequence", read_last, &last, err);
	if (!r)
		r = read_all(c, "dataset", catalogue_sql_datasets, read_dataset, to, err);
	if (!r)
		r = read_all(c, "job", catalogue_sql_jobs, read_job, to, err);
	if (!r)
		r = read_all(c, "push", catalogue_sql_pushes, read_push, to, err);
	return r;
}
