/*
 * The database of the catalogue: opening, older versions, errors.
 *
 * An older version is converted step by step. Each step is a transaction, so an interrupted one has no effect. A newer version is
 * refused before anything is written. The heap of SQLite is bounded, so the undo data of a step with many rows goes to a
 * temporary file.
 */
#include "catalogue_priv.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "log.h"
#include "progress.h"

enum { CHECKPOINT_PAGES = 256 };

enum err_code catalogue_err_code(int code)
{
	switch (code & 0xff) {
	case SQLITE_FULL:
		return ERR_NOSPACE;
	case SQLITE_CORRUPT:
	case SQLITE_NOTADB:
		return ERR_CORRUPT;
	case SQLITE_NOMEM:
		return ERR_NOMEM;
	case SQLITE_BUSY:
	case SQLITE_LOCKED:
		return ERR_BUSY;
	case SQLITE_PERM:
	case SQLITE_READONLY:
		return ERR_PERM;
	default:
		return ERR_IO;
	}
}

int catalogue_failed(struct catalogue *c, struct err *err, const char *what)
{
	int code = sqlite3_extended_errcode(c->db) & 0xff;
	enum err_code as = catalogue_err_code(code);
	int sys = code == SQLITE_IOERR || code == SQLITE_CANTOPEN ? sqlite3_system_errno(c->db) : 0;

	/* Without memory SQLite may fail anywhere in a commit, also after it became durable. */
	c->io_failed |= code == SQLITE_IOERR || code == SQLITE_NOMEM;
	if (sys == ENOSPC || sys == EDQUOT)
		as = ERR_NOSPACE;
	err_set(err, as, "%s: %s%s%s", what, sqlite3_errmsg(c->db), sys ? ": " : "", sys ? strerror(sys) : "");
	/* An error of the disk, after which another start may help, also where SQLite keeps no number. */
	err->sys = code == SQLITE_IOERR && !sys ? EIO : sys;
	return as == ERR_CORRUPT ? err_add_hint(err, "take the state from a backup") : -(int)as;
}

int catalogue_run(struct catalogue *c, const char *sql, struct err *err)
{
	if (sqlite3_exec(c->db, sql, NULL, NULL, NULL) != SQLITE_OK)
		return catalogue_failed(c, err, "the catalogue");
	return 0;
}

static int user_version(struct catalogue *c, int *ret, struct err *err)
{
	sqlite3_stmt *s;
	int r = sqlite3_prepare_v2(c->db, "PRAGMA user_version", -1, &s, NULL);

	if (r != SQLITE_OK || sqlite3_step(s) != SQLITE_ROW) {
		sqlite3_finalize(s);
		return catalogue_failed(c, err, "the catalogue cannot be read");
	}
	*ret = sqlite3_column_int(s, 0);
	sqlite3_finalize(s);
	return 0;
}

static int convert(struct catalogue *c, int version, struct err *err)
{
	int r = 0;

	if (!version)
		return catalogue_run(c, catalogue_sql_schema, err);
	if (version < CATALOGUE_VERSION)
		r = catalogue_sum_function(c, err);
	if (version < CATALOGUE_VERSION)
		r = catalogue_run(c, "PRAGMA temp_store = FILE", err);
	for (; !r && version < CATALOGUE_VERSION; version++)
		r = catalogue_run(c, catalogue_sql_step[version], err);
	return r ? r : catalogue_run(c, "PRAGMA temp_store = MEMORY", err);
}

/* SQLite ignores errors of automatic checkpoints. This hook makes the checkpoint, and records its error. */
static int on_wal(void *ctx, sqlite3 *db, const char *name, int pages)
{
	struct catalogue *c = ctx;

	if (pages >= CHECKPOINT_PAGES &&
	    (sqlite3_wal_checkpoint_v2(db, name, SQLITE_CHECKPOINT_PASSIVE, NULL, NULL) & 0xff) == SQLITE_IOERR)
		c->io_failed = true;
	return SQLITE_OK;
}

/* Instructions of the database between two steps of progress: converting many rows takes its time. */
enum { STEP_INSTRUCTIONS = 100000 };

static int on_instructions(void *ctx)
{
	progress_step();
	return 0; /* continue */
}

/* SQLite maps the index of its log, and gives each page one block only. Where blocks are smaller than pages, or a change needs
 * new ones, a full disk would end the process by SIGBUS. Closing the descriptor releases SQLite's locks, so it stays as long as
 * these. Without it nothing else changes. */
static void reserve_index(struct catalogue *c, const char *path)
{
	enum { BYTES = 64 << 10 /* twice what CHECKPOINT_PAGES need */ };
	char name[620];
	int fd;

	snprintf(name, sizeof name, "%s-shm", path);
	fd = open(name, O_RDWR | O_NOFOLLOW | O_CLOEXEC);
	if (fd >= 0 && fallocate(fd, 0, 0, BYTES) != 0)
		log_debug("no blocks are reserved for %s: %s", name, strerror(errno));
	c->index = fd + 1;
}

int catalogue_open(struct catalogue *c, const char *path, struct err *err)
{
	int r, version = 0;
	bool beside;

	/* Cached pages are released before the heap is full; statements and texts of one change need far less than the rest. */
	sqlite3_soft_heap_limit64(CATALOGUE_HEAP - (CATALOGUE_HEAP >> 2));
	sqlite3_hard_heap_limit64(CATALOGUE_HEAP);
	if (sqlite3_open_v2(path, &c->db, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, NULL) != SQLITE_OK)
		return c->db ? catalogue_failed(c, err, "the catalogue cannot be opened") :
			       err_set(err, ERR_NOMEM, "no memory for the catalogue");
	sqlite3_busy_timeout(c->db, 2000);
	sqlite3_progress_handler(c->db, STEP_INSTRUCTIONS, on_instructions, NULL);
	r = user_version(c, &version, err);
	if (r)
		return r;
	if (version > CATALOGUE_VERSION) {
		err_set(err, ERR_VERSION,
			"the catalogue was written by a newer acutd: it has version %d, this one (%s) knows up to %d", version,
			ACUT_VERSION, CATALOGUE_VERSION);
		return err_add_hint(err, "use that acutd, or another state folder (--state; of private daemons XDG_STATE_HOME)");
	}
	r = catalogue_run(c, catalogue_sql_setup, err);
	beside = c->starting && version == CATALOGUE_VERSION;
	if (!r && version && !beside)
		r = catalogue_check_pages(c, err);
	if (!r)
		r = convert(c, version, err);
	/* Whatever an earlier fsync did, what is read from here on is durable. */
	if (!r)
		r = catalogue_run(c, "PRAGMA wal_checkpoint(TRUNCATE)", err);
	if (!r)
		reserve_index(c, path);
	if (!r)
		sqlite3_wal_hook(c->db, on_wal, c);
	if (!r && beside)
		catalogue_check_begin(c);
	for (int i = 0; !r && i < CATALOGUE_SQLS; i++)
		if (sqlite3_prepare_v3(c->db, catalogue_sql_text[i], -1, SQLITE_PREPARE_PERSISTENT, &c->stmt[i], NULL) !=
		    SQLITE_OK)
			r = catalogue_failed(c, err, "the catalogue");
	return r;
}

void catalogue_close(struct catalogue *c)
{
	for (int i = 0; i < CATALOGUE_SQLS; i++)
		c->stmt[i] = (sqlite3_finalize(c->stmt[i]), NULL);
	sqlite3_close(c->db);
	c->db = NULL;
	if (c->index)
		close(c->index - 1);
	c->index = 0;
}

/* Keeps the first line of an answer. */
static int first_line(void *ctx, int n, char **value, char **name)
{
	char *line = ctx;

	if (!*line && n)
		snprintf(line, 256, "%s", value[0] ? value[0] : "");
	return 0;
}

/* Within the bounded heap: the thorough check needs some memory for each page of the database; the quick one does not check
 * indices. */
int catalogue_verify(struct catalogue *c, struct err *err)
{
	static const char *const checks[] = {"PRAGMA integrity_check(1)", "PRAGMA quick_check(1)"};
	char line[256] = "";
	int r = SQLITE_NOMEM;

	for (size_t i = 0; i < 2 && r == SQLITE_NOMEM; i++) {
		*line = 0;
		r = sqlite3_exec(c->db, checks[i], first_line, line, NULL);
	}
	if (r != SQLITE_OK)
		catalogue_failed(c, err, "the catalogue cannot be read");
	else if (strcmp(line, "ok"))
		err_set(err, ERR_CORRUPT, "the catalogue is damaged: %s", line);
	else
		return 0;
	err_add_file(err, "catalogue.db");
	return err_add_hint(err, "check the disk, and restore the state folder from a backup");
}
