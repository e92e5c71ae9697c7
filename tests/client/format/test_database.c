/*
 * A database in an output: whichever file call fails, the error is that of the output; short transfers change nothing; memory
 * does not grow with rows.
 */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "folder.h"
#include "format_database.h"
#include "io.h"
#include "outfile.h"

/* So many rows of so many bytes do not fit in the memory for pages, so pages are written and read again before the end. */
enum { ROWS = 1500, ROW = 6000, LARGE = 48 << 20 };

/* ---- file calls that fail ---- */

static struct io_table table;
static unsigned long reads, writes, fail_read, fail_write; /* calls, and those that fail; 0: none */
static int with;                                           /* errno; 0: half of the transfer is done */

static ssize_t test_pread(int fd, void *bytes, size_t n, off_t at)
{
	if (++reads != fail_read)
		return pread(fd, bytes, n, at);
	errno = with;
	return with ? -1 : pread(fd, bytes, n / 2, at);
}

static ssize_t test_pwrite(int fd, const void *bytes, size_t n, off_t at)
{
	if (++writes != fail_write)
		return pwrite(fd, bytes, n, at);
	errno = with;
	return with ? -1 : pwrite(fd, bytes, n / 2, at);
}

/* ---- a database ---- */

static int put_row(struct database *d, sqlite3_stmt *row, sqlite3_stmt *box, int number, struct err *err)
{
	static uint8_t bytes[ROW];
	int r;

	memset(bytes, number, ROW);
	sqlite3_bind_int(row, 1, number);
	sqlite3_bind_blob(row, 2, bytes, ROW, SQLITE_STATIC);
	r = database_step(d, row, err);
	sqlite3_bind_int(box, 1, number);
	for (int i = 0; i < 4; i++)
		sqlite3_bind_int(box, 2 + i, number * 7919 % ROWS + i % 2);
	return r ? r : database_step(d, box, err);
}

static int put_rows(struct database *d, struct err *err)
{
	sqlite3_stmt *row = NULL, *box = NULL;
	int r = database_run(
		d, "CREATE TABLE t (id INTEGER PRIMARY KEY, v BLOB); CREATE VIRTUAL TABLE b USING rtree(id, x, xx, y, yy)", err);

	if (!r)
		r = database_prepare(d, "INSERT INTO t VALUES (?, ?)", &row, err);
	if (!r)
		r = database_prepare(d, "INSERT INTO b VALUES (?, ?, ?, ?, ?)", &box, err);
	for (int i = 1; i <= ROWS && !r; i++)
		r = put_row(d, row, box, i, err);
	if (!r)
		r = database_run(d, "SELECT max(v) FROM t", err); /* pages that are not in memory any more */
	sqlite3_finalize(row);
	sqlite3_finalize(box);
	return r;
}

static int write_file(struct err *err)
{
	struct database d = {0};
	struct outfile *out = NULL;
	int r = outfile_new(folder_out, false, &out, err);

	reads = writes = 0;
	if (!r)
		r = database_open(&d, out, err);
	if (!r)
		r = put_rows(&d, err);
	if (!r)
		r = database_end(&d, err);
	database_done(&d);
	if (!r)
		r = outfile_publish(out, err);
	outfile_free(out);
	return r;
}

/* Of a query with one result, a text. */
static void expect(sqlite3 *db, const char *sql, const char *want)
{
	sqlite3_stmt *s;

	assert_int_equal(sqlite3_prepare_v2(db, sql, -1, &s, NULL), SQLITE_OK);
	assert_int_equal(sqlite3_step(s), SQLITE_ROW);
	assert_string_equal((const char *)sqlite3_column_text(s, 0), want);
	sqlite3_finalize(s);
}

/* ---- tests ---- */

static void test_whole(void **state)
{
	struct err err = ERR_INIT;
	char count[16];
	sqlite3 *db;

	assert_int_equal(write_file(&err), 0);
	assert_true(reads > 100); /* what the next test lets fail */
	assert_true(writes > (unsigned long)ROWS * ROW / 4096);
	snprintf(count, sizeof(count), "%d", ROWS);
	assert_int_equal(sqlite3_open_v2(folder_out, &db, SQLITE_OPEN_READONLY, NULL), SQLITE_OK);
	expect(db, "PRAGMA integrity_check", "ok");
	expect(db, "SELECT rtreecheck('b')", "ok");
	expect(db, "SELECT count(*) FROM b", count);
	expect(db, "SELECT count(*) FROM t WHERE length(v) = 6000 AND substr(v, 6000, 1) = substr(v, 1, 1)", count);
	sqlite3_close(db);
	unlink(folder_out);
	(void)state;
}

/* The first calls, and every 97th. */
static void failing(unsigned long *which, unsigned long calls, int number, enum err_code code)
{
	with = number;
	for (unsigned long i = 1; i <= calls; i += i < 20 ? 1 : 97) {
		struct err err = ERR_INIT;

		*which = i;
		assert_int_equal(write_file(&err), -(int)code);
		assert_int_equal(err_exit_status(err.code), 74);
		assert_string_equal(err.file, folder_out);
		assert_int_equal(err.sys, number);
		assert_int_equal(rmdir(folder_own), 0); /* nothing is there */
		assert_int_equal(mkdir(folder_own, 0700), 0);
	}
	*which = 0;
}

static void test_errors(void **state)
{
	unsigned long nread, nwrite;
	struct err err = ERR_INIT;

	assert_int_equal(write_file(&err), 0);
	unlink(folder_out);
	nread = reads;
	nwrite = writes;
	failing(&fail_write, nwrite, ENOSPC, ERR_NOSPACE);
	failing(&fail_write, nwrite, EIO, ERR_IO);
	failing(&fail_read, nread, EIO, ERR_IO);
	(void)state;
}

static void test_short(void **state)
{
	unsigned long nread, nwrite;
	struct err err = ERR_INIT;
	char *want, *got;
	size_t size, n;

	assert_int_equal(write_file(&err), 0);
	nread = reads;
	nwrite = writes;
	want = folder_file(folder_out, &size);
	with = 0;
	for (unsigned i = 1; i < 16; i++) {
		fail_read = nread * i / 16;
		fail_write = nwrite * i / 16;
		assert_int_equal(write_file(&err), 0);
		got = folder_file(folder_out, &n);
		assert_int_equal(n, size);
		assert_memory_equal(got, want, size);
		free(got);
	}
	fail_read = fail_write = 0;
	free(want);
	(void)state;
}

/* A row of 48 MiB, in pieces. */
static void test_memory(void **state)
{
	static uint8_t piece[1 << 16];
	struct err err = ERR_INIT;
	struct outfile *out;
	struct database d;
	sqlite3_blob *blob;

	sqlite3_memory_highwater(1);
	assert_int_equal(outfile_spool(NULL, &out, &err), 0);
	assert_int_equal(database_open(&d, out, &err), 0);
	assert_int_equal(put_rows(&d, &err), 0);
	assert_int_equal(database_run(&d, "INSERT INTO t VALUES (100000, zeroblob(50331648))", &err), 0);
	assert_int_equal(sqlite3_blob_open(d.db, "main", "t", "v", 100000, 1, &blob), SQLITE_OK);
	for (int at = 0; at < LARGE; at += (int)sizeof(piece))
		assert_int_equal(sqlite3_blob_write(blob, piece, sizeof(piece), at), SQLITE_OK);
	sqlite3_blob_close(blob);
	assert_int_equal(database_end(&d, &err), 0);
	database_done(&d);
	assert_true(outfile_size(out) > LARGE + (uint64_t)ROWS * ROW);
	outfile_free(out);
	assert_true(sqlite3_memory_highwater(0) < (DATABASE_CACHE + 1024) * 1024);
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_whole),
		cmocka_unit_test(test_errors),
		cmocka_unit_test(test_short),
		cmocka_unit_test(test_memory),
	};

	table = io_system;
	table.pread = test_pread;
	table.pwrite = test_pwrite;
	io = &table;
	return folder_run(tests);
}
