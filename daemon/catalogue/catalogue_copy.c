/*
 * A copy of the catalogue as of one moment, while it is in use.
 *
 * The model: a second connection reads what is durable, by SQLite's backup interface, all pages in one step. With a write-ahead
 * log nobody waits for that. Uncommitted pushes are removed from the copy, since a backup does not have their files. The heap of
 * SQLite is bounded for the whole process; both connections keep only a few pages.
 */
#include "catalogue_priv.h"
#include "err.h"

static int copy_failed(sqlite3 *db, int code, const char *what, struct err *err)
{
	return err_set(err, catalogue_err_code(code), "%s: %s", what, db ? sqlite3_errmsg(db) : sqlite3_errstr(code & 0xff));
}

static int open_connection(const char *path, int flags, sqlite3 **ret, struct err *err)
{
	int code = sqlite3_open_v2(path, ret, flags | SQLITE_OPEN_NOMUTEX, NULL);

	if (code == SQLITE_OK) {
		sqlite3_busy_timeout(*ret, 2000);
		code = sqlite3_exec(*ret, "PRAGMA cache_size = -32", NULL, NULL, NULL);
	}
	return code == SQLITE_OK ? 0 : copy_failed(*ret, code, "the catalogue cannot be copied", err);
}

static int copy_pages(sqlite3 *from, sqlite3 *to, struct err *err)
{
	sqlite3_backup *b = sqlite3_backup_init(to, "main", from, "main");
	int step, code;

	if (!b)
		return copy_failed(to, sqlite3_errcode(to), "the catalogue cannot be copied", err);
	step = sqlite3_backup_step(b, -1);
	code = sqlite3_backup_finish(b);
	if (step == SQLITE_DONE && code == SQLITE_OK)
		return 0;
	return copy_failed(NULL, code != SQLITE_OK ? code : step, "the catalogue cannot be copied", err);
}

int catalogue_copy(const char *from, const char *to, struct err *err)
{
	sqlite3 *source = NULL, *copy = NULL;
	int r = open_connection(from, SQLITE_OPEN_READONLY, &source, err);

	if (!r)
		r = open_connection(to, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, &copy, err);
	if (!r)
		r = copy_pages(source, copy, err);
	/* One file, without a log beside it. */
	if (!r && sqlite3_exec(copy, "PRAGMA journal_mode = DELETE; DELETE FROM push;", NULL, NULL, NULL) != SQLITE_OK)
		r = copy_failed(copy, sqlite3_errcode(copy), "the copy of the catalogue cannot be written", err);
	sqlite3_close(source);
	if (sqlite3_close(copy) != SQLITE_OK && !r)
		r = err_set(err, ERR_IO, "the copy of the catalogue cannot be closed");
	return r;
}

int catalogue_manifests(const char *path, int (*each)(void *ctx, uint64_t dataset, const char *manifest, struct err *), void *ctx,
			struct err *err)
{
	sqlite3_stmt *s = NULL;
	sqlite3 *db = NULL;
	int r = open_connection(path, SQLITE_OPEN_READONLY, &db, err), step = SQLITE_DONE;

	if (!r && sqlite3_prepare_v2(db, "SELECT id, manifest FROM dataset WHERE manifest <> '' ORDER BY id", -1, &s, NULL) !=
			  SQLITE_OK)
		r = copy_failed(db, sqlite3_errcode(db), "the catalogue cannot be read", err);
	while (!r && (step = sqlite3_step(s)) == SQLITE_ROW)
		r = each(ctx, (uint64_t)sqlite3_column_int64(s, 0), (const char *)sqlite3_column_text(s, 1), err);
	if (!r && step != SQLITE_DONE)
		r = copy_failed(db, step, "the catalogue cannot be read", err);
	sqlite3_finalize(s);
	sqlite3_close(db);
	return r;
}
