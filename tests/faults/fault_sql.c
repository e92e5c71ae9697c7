/*
 * SQLite's file system for tests: the default one, with faults before and the log after each call. A journal or WAL that
 * was just made has its folder synced with the first sync of it, as the default one does. The -shm file is no part of
 * what survives.
 */
#include <errno.h>
#include <fcntl.h>
#include <sqlite3.h>
#include <stdlib.h>
#include <string.h>

#include "fault_priv.h"

struct file {
	sqlite3_file base;
	unsigned node;
	bool fresh;
	char *path;
	sqlite3_file *real; /* behind this one */
};

static sqlite3_vfs *below;

static sqlite3_file *real(sqlite3_file *f)
{
	return ((struct file *)f)->real;
}

static int full_or(int code)
{
	return fault_error() == ENOSPC || fault_error() == EDQUOT ? SQLITE_FULL : code;
}

static int s_close(sqlite3_file *f)
{
	int rc = real(f)->pMethods ? real(f)->pMethods->xClose(real(f)) : SQLITE_OK;

	free(((struct file *)f)->path);
	return rc;
}

static int s_read(sqlite3_file *f, void *buf, int n, sqlite3_int64 at)
{
	bool fails;

	fault_lock();
	fails = fault_fails(FAULT_SQL_READ);
	fault_unlock();
	return fails ? SQLITE_IOERR_READ : real(f)->pMethods->xRead(real(f), buf, n, at);
}

static int s_write(sqlite3_file *f, const void *buf, int n, sqlite3_int64 at)
{
	int rc;

	fault_lock();
	if (fault_fails(FAULT_SQL_WRITE)) {
		if (fault_half() && n > 1 && real(f)->pMethods->xWrite(real(f), buf, n / 2, at) == SQLITE_OK)
			fault_did_write_node(((struct file *)f)->node, buf, (size_t)n / 2, (uint64_t)at);
		rc = full_or(SQLITE_IOERR_WRITE);
	} else {
		rc = real(f)->pMethods->xWrite(real(f), buf, n, at);
		if (rc == SQLITE_OK)
			fault_did_write_node(((struct file *)f)->node, buf, (size_t)n, (uint64_t)at);
	}
	fault_unlock();
	return rc;
}

static int s_truncate(sqlite3_file *f, sqlite3_int64 size)
{
	int rc = SQLITE_IOERR_TRUNCATE;

	fault_lock();
	if (!fault_fails(FAULT_SQL_OTHER))
		rc = real(f)->pMethods->xTruncate(real(f), size);
	if (rc == SQLITE_OK)
		fault_did_size_node(((struct file *)f)->node, (uint64_t)size);
	fault_unlock();
	return rc;
}

static int s_sync(sqlite3_file *f, int flags)
{
	struct file *s = (struct file *)f;
	bool fails;

	fault_lock();
	fails = fault_fails(FAULT_SQL_SYNC);
	if (!fails) {
		fault_did_sync_node(s->node);
		if (s->fresh)
			fault_did_sync_dir_of(s->path);
		s->fresh = false;
	}
	fault_unlock();
	return fails ? SQLITE_IOERR_FSYNC : SQLITE_OK;
}

static int s_size(sqlite3_file *f, sqlite3_int64 *ret)
{
	bool fails;

	fault_lock();
	fails = fault_fails(FAULT_SQL_OTHER);
	fault_unlock();
	return fails ? SQLITE_IOERR_FSTAT : real(f)->pMethods->xFileSize(real(f), ret);
}

static int s_lock(sqlite3_file *f, int how)
{
	return real(f)->pMethods->xLock(real(f), how);
}

static int s_unlock(sqlite3_file *f, int how)
{
	return real(f)->pMethods->xUnlock(real(f), how);
}

static int s_check(sqlite3_file *f, int *ret)
{
	return real(f)->pMethods->xCheckReservedLock(real(f), ret);
}

/* Hints of sizes make the default one allocate, which is no write. */
static int s_control(sqlite3_file *f, int op, void *arg)
{
	return op == SQLITE_FCNTL_SIZE_HINT ? SQLITE_OK : real(f)->pMethods->xFileControl(real(f), op, arg);
}

static int s_sector(sqlite3_file *f)
{
	return 512;
}

/* Nothing is promised: neither atomic writes nor sectors that stay when their neighbours are written. */
static int s_traits(sqlite3_file *f)
{
	return 0;
}

static int s_shm_map(sqlite3_file *f, int page, int size, int extend, void volatile **ret)
{
	return real(f)->pMethods->xShmMap(real(f), page, size, extend, ret);
}

static int s_shm_lock(sqlite3_file *f, int offset, int n, int flags)
{
	return real(f)->pMethods->xShmLock(real(f), offset, n, flags);
}

static void s_shm_barrier(sqlite3_file *f)
{
	real(f)->pMethods->xShmBarrier(real(f));
}

static int s_shm_unmap(sqlite3_file *f, int delete)
{
	return real(f)->pMethods->xShmUnmap(real(f), delete);
}

static const sqlite3_io_methods methods = {
	.iVersion = 2,
	.xClose = s_close,
	.xRead = s_read,
	.xWrite = s_write,
	.xTruncate = s_truncate,
	.xSync = s_sync,
	.xFileSize = s_size,
	.xLock = s_lock,
	.xUnlock = s_unlock,
	.xCheckReservedLock = s_check,
	.xFileControl = s_control,
	.xSectorSize = s_sector,
	.xDeviceCharacteristics = s_traits,
	.xShmMap = s_shm_map,
	.xShmLock = s_shm_lock,
	.xShmBarrier = s_shm_barrier,
	.xShmUnmap = s_shm_unmap,
};

static int v_open(sqlite3_vfs *v, const char *path, sqlite3_file *f, int flags, int *ret_flags)
{
	struct file *s = (struct file *)f;
	int rc = SQLITE_CANTOPEN;

	s->real = (sqlite3_file *)(s + 1);
	s->base.pMethods = NULL;
	fault_lock();
	if (!fault_fails(FAULT_SQL_OPEN))
		rc = below->xOpen(below, path, s->real, flags, ret_flags);
	if (rc == SQLITE_OK) {
		s->node = path ? fault_node_at(path) : ~0u;
		s->path = path ? strdup(path) : NULL;
		s->fresh = false;
		if (path && s->node == ~0u && (flags & SQLITE_OPEN_CREATE)) {
			fault_did_create(AT_FDCWD, path, false, false);
			s->node = fault_node_at(path);
			s->fresh = (flags & (SQLITE_OPEN_WAL | SQLITE_OPEN_MAIN_JOURNAL)) != 0;
		}
		s->base.pMethods = &methods;
	}
	fault_unlock();
	return rc;
}

static int v_delete(sqlite3_vfs *v, const char *path, int sync)
{
	int rc = SQLITE_IOERR_DELETE;

	fault_lock();
	if (!fault_fails(FAULT_SQL_OTHER))
		rc = below->xDelete(below, path, 0);
	if (rc == SQLITE_OK) {
		fault_did_unlink(AT_FDCWD, path);
		if (sync)
			fault_did_sync_dir_of(path);
	}
	fault_unlock();
	return rc;
}

static int v_access(sqlite3_vfs *v, const char *path, int flags, int *ret)
{
	bool fails;

	fault_lock();
	fails = fault_fails(FAULT_SQL_OTHER);
	fault_unlock();
	return fails ? SQLITE_IOERR_ACCESS : below->xAccess(below, path, flags, ret);
}

void fault_sql_start(void)
{
	static sqlite3_vfs vfs;

	below = sqlite3_vfs_find(NULL);
	vfs = *below;
	vfs.zName = "fault";
	vfs.pNext = NULL;
	vfs.szOsFile = (int)sizeof(struct file) + below->szOsFile;
	vfs.xOpen = v_open;
	vfs.xDelete = v_delete;
	vfs.xAccess = v_access;
	sqlite3_vfs_register(&vfs, 1);
}
