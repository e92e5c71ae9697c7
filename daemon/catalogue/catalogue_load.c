/* Reading the catalogue before it starts. Each row is passed to the reader, with borrowed texts. */
#include "catalogue_priv.h"

#include <stdbool.h>
#include <string.h>

#include "err.h"
#include "progress.h"
#include "thread.h"

/* Rows between two steps of progress. */
enum { ROWS_STEP = 16 };

/* A start reads ten thousand rows of twenty columns. So each value is fetched once, and its text only if it has one. (Values of
 * columns are unprotected, which is safe with SQLITE_OPEN_NOMUTEX.) */
static bool read_column(sqlite3_stmt *s, int i, struct column *ret)
{
	sqlite3_value *v = sqlite3_column_value(s, i);

	*ret = (struct column){.type = sqlite3_value_type(v), .text = ""};
	if (ret->type == SQLITE_INTEGER || ret->type == SQLITE_FLOAT)
		ret->number = sqlite3_value_int64(v);
	if (ret->type == SQLITE_INTEGER || ret->type == SQLITE_NULL)
		return true;
	ret->bytes = (size_t)sqlite3_value_bytes(v);
	if (ret->bytes)
		ret->text = (const char *)sqlite3_value_text(v);
	return ret->text; /* NULL: no memory for it */
}

static bool read_columns(sqlite3_stmt *s, int n, struct column *ret)
{
	for (int i = 0; i < n; i++)
		if (!read_column(s, i, &ret[i]))
			return false;
	return true;
}

static int read_dataset(const struct column *c, const struct catalogue_reader *to, struct err *err)
{
	struct catalogue_dataset d = {
		.id = (uint64_t)c[0].number,
		.name = c[1].text,
		.uid = (uint32_t)c[2].number,
		.created_us = c[3].number,
		.pushed_us = c[4].number,
		.manifest = c[5].text,
		.generation = (uint64_t)c[6].number,
		.points = (uint64_t)c[7].number,
		.bytes = (uint64_t)c[8].number,
		.files = (uint32_t)c[9].number,
		.lattice = c[10].text,
		.crs = c[11].text,
		.unit_xy = c[12].text,
		.unit_z = c[13].text,
		.box = {(int32_t)(c[14].number >> 32), (int32_t)c[14].number, (int32_t)(c[15].number >> 32),
			(int32_t)c[15].number},
		.removed_us = c[16].number,
		.pinned = c[17].number != 0,
		.oldest = (uint64_t)c[18].number,
		.segments = (uint32_t)c[19].number,
		.gid = (uint32_t)c[20].number,
		.mode = (uint32_t)c[21].number,
	};

	return to->dataset(to->ctx, &d, err);
}

static int read_job(const struct column *c, const struct catalogue_reader *to, struct err *err)
{
	struct catalogue_job j = {
		.id = (uint64_t)c[0].number,
		.dataset = (uint64_t)c[1].number,
		.generation = (uint64_t)c[2].number,
		.view = c[3].text,
		.state = c[4].text,
		.uid = (uint32_t)c[5].number,
		.pid = (uint32_t)c[6].number,
		.submitted_us = c[7].number,
		.finished_us = c[8].number,
		.report = c[9].text,
		.error_code = c[10].text,
		.error_message = c[11].text,
		.error_file = c[12].text,
		.error_field = c[13].text,
		.error_hint = c[14].text,
		.error_offset = c[15].number,
		.priority = (uint32_t)c[16].number,
		.area = c[17].text,
		.admin = c[18].number != 0,
	};

	return to->job(to->ctx, &j, err);
}

static int read_push(const struct column *c, const struct catalogue_reader *to, struct err *err)
{
	struct catalogue_push p = {
		.id = (uint64_t)c[0].number,
		.dataset = (uint64_t)c[1].number,
		.uid = (uint32_t)c[2].number,
		.files = (uint32_t)c[3].number,
		.begun_us = c[4].number,
	};

	return to->push(to->ctx, &p, err);
}

static int read_last(const struct column *c, const struct catalogue_reader *to, struct err *err)
{
	static const char *const names[3] = {"dataset", "job", "push"};
	uint64_t *last = to->ctx;

	for (int i = 0; i < 3; i++)
		if (!strcmp(c[0].text, names[i]))
			last[i] = (uint64_t)c[1].number;
	return 0;
}

/* table: the name of a table whose rows have checksums; NULL: they have none. */
static int read_all(struct catalogue *c, const char *table, const char *sql,
		    int (*row)(const struct column *, const struct catalogue_reader *, struct err *),
		    const struct catalogue_reader *to, struct err *err)
{
	struct column column[VALUES + 1];
	unsigned rows = 0;
	sqlite3_stmt *s;
	int r = 0, step, n;

	if (sqlite3_prepare_v2(c->db, sql, -1, &s, NULL) != SQLITE_OK)
		return catalogue_failed(c, err, "the catalogue cannot be read");
	n = sqlite3_column_count(s);
	while (!r && (step = sqlite3_step(s)) != SQLITE_DONE) {
		if (step != SQLITE_ROW || !read_columns(s, n, column))
			r = catalogue_failed(c, err, "the catalogue cannot be read");
		else if (table)
			r = catalogue_sum_check(column, (unsigned)n, table, err);
		if (!r)
			r = row(column, to, err);
		if (++rows % ROWS_STEP)
			continue;
		progress_step();
		if (!r && catalogue_check_failed(c))
			r = err_set(err, ERR_CORRUPT, "the catalogue is damaged");
	}
	sqlite3_finalize(s);
	return r;
}

/* Folders of datasets whose number was given out, and which have no row, are deleted. So the numbers are known only to a caller
 * that has seen all rows. */
int catalogue_load(struct catalogue *c, const struct catalogue_reader *to, uint64_t ret_last[3], struct err *err)
{
	uint64_t used[3] = {0};
	const struct catalogue_reader last = {.ctx = used};
	struct err why = ERR_INIT;
	int r, s;

	THREAD_LOOP_ONLY();
	ret_last[0] = ret_last[1] = ret_last[2] = 0;
	r = read_all(c, NULL, "SELECT name, seq FROM sqlite_sequence", read_last, &last, err);
	if (!r)
		r = read_all(c, "dataset", catalogue_sql_datasets, read_dataset, to, err);
	if (!r)
		r = read_all(c, "job", catalogue_sql_jobs, read_job, to, err);
	if (!r)
		r = read_all(c, "push", catalogue_sql_pushes, read_push, to, err);
	/* A row cannot be read, or seems to be damaged, because its page is. */
	s = catalogue_check_end(c, &why);
	if (s) {
		*err = why;
		err_add_file(err, c->path);
		return s;
	}
	if (!r)
		memcpy(ret_last, used, sizeof used);
	return r;
}
