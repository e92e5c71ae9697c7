/*
 * The VFS has one file, without locks: nobody else sees the output. An error of the output is kept here, since SQLite would
 * forward a number of its own only.
 */
#include "format_database.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "outfile.h"

struct database_file {
	sqlite3_vfs vfs;
	char name[32]; /* of the VFS */
	struct outfile *out;
	struct err err; /* the first one of the output */
};

/* What SQLite opens. */
struct opened {
	sqlite3_file base;
	struct database_file *of;
};

static struct database_file *file_of(sqlite3_file *file)
{
	return ((struct opened *)file)->of;
}

/* ---- the file ---- */

static int file_read(sqlite3_file *file, void *bytes, int n, sqlite3_int64 at)
{
	struct database_file *f = file_of(file);
	uint64_t size = outfile_size(f->out), from = (uint64_t)at;
	size_t there = from >= size ? 0 : size - from < (uint64_t)n ? (size_t)(size - from) : (size_t)n;

	if (there && outfile_read(f->out, from, bytes, there, &f->err))
		return SQLITE_IOERR_READ;
	memset((uint8_t *)bytes + there, 0, (size_t)n - there);
	return there < (size_t)n ? SQLITE_IOERR_SHORT_READ : SQLITE_OK;
}

static int file_write(sqlite3_file *file, const void *bytes, int n, sqlite3_int64 at)
{
	struct database_file *f = file_of(file);

	return outfile_patch(f->out, (uint64_t)at, bytes, (size_t)n, &f->err) ? SQLITE_IOERR_WRITE : SQLITE_OK;
}

static int file_size(sqlite3_file *file, sqlite3_int64 *ret)
{
	*ret = (sqlite3_int64)outfile_size(file_of(file)->out);
	return SQLITE_OK;
}

/* Rows are added only. */
static int file_truncate(sqlite3_file *file, sqlite3_int64 size)
{
	return (uint64_t)size == outfile_size(file_of(file)->out) ? SQLITE_OK : SQLITE_IOERR_TRUNCATE;
}

static int file_sync(sqlite3_file *file, int flags)
{
	return SQLITE_OK;
}

static int file_close(sqlite3_file *file)
{
	return SQLITE_OK;
}

static int file_lock(sqlite3_file *file, int lock)
{
	return SQLITE_OK;
}

static int file_is_locked(sqlite3_file *file, int *ret)
{
	*ret = 0;
	return SQLITE_OK;
}

static int file_control(sqlite3_file *file, int what, void *argument)
{
	return SQLITE_NOTFOUND;
}

static int file_sector(sqlite3_file *file)
{
	return 4096;
}

static int file_features(sqlite3_file *file)
{
	return 0;
}

static const sqlite3_io_methods methods = {
	.iVersion = 1,
	.xClose = file_close,
	.xRead = file_read,
	.xWrite = file_write,
	.xTruncate = file_truncate,
	.xSync = file_sync,
	.xFileSize = file_size,
	.xLock = file_lock,
	.xUnlock = file_lock,
	.xCheckReservedLock = file_is_locked,
	.xFileControl = file_control,
	.xSectorSize = file_sector,
	.xDeviceCharacteristics = file_features,
};

/* ---- the VFS ---- */

static int vfs_open(sqlite3_vfs *vfs, const char *name, sqlite3_file *file, int flags, int *ret_flags)
{
	struct opened *o = (struct opened *)file;

	*o = (struct opened){.of = vfs->pAppData};
	if (!(flags & SQLITE_OPEN_MAIN_DB)) /* a temporary file */
		return SQLITE_CANTOPEN;
	o->base.pMethods = &methods;
	if (ret_flags)
		*ret_flags = flags;
	return SQLITE_OK;
}

static int vfs_delete(sqlite3_vfs *vfs, const char *name, int sync)
{
	return SQLITE_OK;
}

static int vfs_access(sqlite3_vfs *vfs, const char *name, int flags, int *ret)
{
	*ret = 0;
	return SQLITE_OK;
}

static int vfs_path(sqlite3_vfs *vfs, const char *name, int size, char *ret)
{
	snprintf(ret, (size_t)size, "%s", name);
	return SQLITE_OK;
}

/* The rest (time, random numbers) is the system's. */
static struct database_file *file_new(struct outfile *out)
{
	struct database_file *f = sqlite3_initialize() == SQLITE_OK ? calloc(1, sizeof(*f)) : NULL;

	if (!f)
		return NULL;
	f->out = out;
	f->err = ERR_INIT;
	f->vfs = *sqlite3_vfs_find(NULL);
	snprintf(f->name, sizeof(f->name), "acut-%p", (void *)f);
	f->vfs.zName = f->name;
	f->vfs.pNext = NULL;
	f->vfs.pAppData = f;
	f->vfs.szOsFile = sizeof(struct opened);
	f->vfs.xOpen = vfs_open;
	f->vfs.xDelete = vfs_delete;
	f->vfs.xAccess = vfs_access;
	f->vfs.xFullPathname = vfs_path;
	if (sqlite3_vfs_register(&f->vfs, 0) == SQLITE_OK)
		return f;
	free(f);
	return NULL;
}

/* ---- statements ---- */

int database_failed(struct database *d, struct err *err)
{
	if (d->file->err.code) {
		*err = d->file->err;
		return -(int)err->code;
	}
	if (!d->db || (sqlite3_errcode(d->db) & 0xff) == SQLITE_NOMEM)
		return err_set(err, ERR_NOMEM, "no memory for a database");
	return err_set(err, ERR_INTERNAL, "SQLite does not write the database: %s", sqlite3_errmsg(d->db));
}

int database_run(struct database *d, const char *sql, struct err *err)
{
	return sqlite3_exec(d->db, sql, NULL, NULL, NULL) == SQLITE_OK ? 0 : database_failed(d, err);
}

int database_prepare(struct database *d, const char *sql, sqlite3_stmt **ret, struct err *err)
{
	return sqlite3_prepare_v2(d->db, sql, -1, ret, NULL) == SQLITE_OK ? 0 : database_failed(d, err);
}

int database_step(struct database *d, sqlite3_stmt *s, struct err *err)
{
	int r = sqlite3_step(s) == SQLITE_DONE ? 0 : database_failed(d, err);

	sqlite3_reset(s);
	return r;
}

int database_open(struct database *d, struct outfile *out, struct err *err)
{
	char sql[256];

	*d = (struct database){.file = file_new(out)};
	if (!d->file)
		return err_set(err, ERR_NOMEM, "no memory for a database");
	if (sqlite3_open_v2("output", &d->db, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, d->file->name) !=
	    SQLITE_OK)
		return database_failed(d, err);
	snprintf(sql, sizeof(sql),
		 "PRAGMA page_size = 4096; PRAGMA locking_mode = EXCLUSIVE; PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; "
		 "PRAGMA temp_store = MEMORY; PRAGMA cache_size = -%d; BEGIN",
		 DATABASE_CACHE);
	return database_run(d, sql, err);
}

int database_end(struct database *d, struct err *err)
{
	return database_run(d, "COMMIT", err);
}

void database_done(struct database *d)
{
	if (!d->file)
		return;
	sqlite3_close(d->db);
	sqlite3_vfs_unregister(&d->file->vfs);
	free(d->file);
	*d = (struct database){0};
}
