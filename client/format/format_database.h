/*
 * A database of SQLite that an output file is. libsqlite3 reads and writes it through the output (a VFS), so it has a name only
 * when it is published, and its errors are those of an output. No other file is made: there is no journal, since a file that is
 * not whole is never seen. The same statements are the same bytes.
 */
#ifndef FORMAT_DATABASE_H
#define FORMAT_DATABASE_H

#include <sqlite3.h>

struct err;
struct outfile;

/* The library's memory for pages in KiB, and the bytes of a row that readers take (SQLITE_MAX_LENGTH). */
enum { DATABASE_CACHE = 4096, DATABASE_ROW_MOST = 1000000000 };

struct database {
	sqlite3 *db;
	struct database_file *file;
};
/* `out` can seek and is empty. All is one transaction. */
int database_open(struct database *, struct outfile *out, struct err *err);
int database_run(struct database *, const char *sql, struct err *err);
int database_prepare(struct database *, const char *sql, sqlite3_stmt **ret, struct err *err);
/* Runs a statement without a result, which can be bound and run again. */
int database_step(struct database *, sqlite3_stmt *, struct err *err);
/* The error of a call of the library that failed. */
int database_failed(struct database *, struct err *err);
/* Commits. No blob is open. */
int database_end(struct database *, struct err *err);
/* Its statements and blobs are freed. */
void database_done(struct database *);

#endif
