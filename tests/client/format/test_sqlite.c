/* Databases larger than 1 GiB, read by SQLite: the page whose bytes it locks has nothing, wherever in a table it comes. The pages
 * before it are a hole. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "format_sqlite.h"
#include "outfile.h"

enum { ROWS = 60 };
#define SQL "CREATE TABLE t (id INTEGER NOT NULL PRIMARY KEY, v BLOB)"

static size_t size_of(unsigned row)
{
	return row % 3 ? row * 50 : row % 2 ? 9000 : 20000;
}

static void put_rows(struct sqlite_file *f, struct sqlite_table *t, struct err *err)
{
	static uint8_t bytes[20000];

	for (unsigned i = 1; i <= ROWS; i++) {
		struct sqlite_record r = {0};

		sqlite_null(&r);
		sqlite_blob(&r, size_of(i));
		memset(bytes, (int)i, sizeof(bytes));
		assert_int_equal(sqlite_row(f, t, i, &r, err), 0);
		assert_int_equal(sqlite_bytes(f, bytes, size_of(i), err), 0);
	}
	assert_int_equal(sqlite_table_end(f, t, err), 0);
}

/* With so many pages before. */
static void put_file(struct outfile *out, uint32_t pages)
{
	struct sqlite_table table = {0}, schema = {.first = true};
	struct sqlite_record r = {0};
	struct sqlite_file f = {.out = out};
	struct err err = {0};

	assert_int_equal(sqlite_reserve(&f, 1, &err), 0);
	f.pages = pages;
	assert_int_equal(sqlite_table_new(&table, &err), 0);
	assert_int_equal(sqlite_table_new(&schema, &err), 0);
	put_rows(&f, &table, &err);
	for (int i = 0; i < 2; i++) { /* so long that the schema is not one page */
		char sql[3001];

		r = (struct sqlite_record){0};
		sqlite_text(&r, i ? "view" : "table");
		sqlite_text(&r, i ? "v" : "t");
		sqlite_text(&r, i ? "v" : "t");
		sqlite_integer(&r, i ? 0 : table.root);
		snprintf(sql, sizeof(sql), "%-3000s", i ? "CREATE VIEW v AS SELECT 1" : SQL);
		sqlite_text(&r, sql);
		assert_int_equal(sqlite_row(&f, &schema, (uint64_t)i + 1, &r, &err), 0);
	}
	assert_int_equal(sqlite_end(&f, &schema, 1, 2, &err), 0);
	sqlite_table_done(&table);
	sqlite_table_done(&schema);
}

static void check(const char *path)
{
	sqlite3_stmt *s;
	sqlite3 *db;
	int rows = 0;

	assert_int_equal(sqlite3_open_v2(path, &db, SQLITE_OPEN_READONLY, NULL), SQLITE_OK);
	assert_int_equal(sqlite3_prepare_v2(db, "SELECT id, v FROM t ORDER BY id", -1, &s, NULL), SQLITE_OK);
	while (sqlite3_step(s) == SQLITE_ROW) {
		const uint8_t *v = sqlite3_column_blob(s, 1);
		size_t n = (size_t)sqlite3_column_bytes(s, 1);

		assert_int_equal(sqlite3_column_int(s, 0), ++rows);
		assert_int_equal(n, size_of((unsigned)rows));
		for (size_t i = 0; i < n; i++)
			assert_int_equal(v[i], rows);
	}
	assert_int_equal(sqlite3_finalize(s), SQLITE_OK);
	assert_int_equal(rows, ROWS);
	sqlite3_close(db);
}

static void test_lock_page(void **state)
{
	for (uint32_t before = 1; before < 120; before++) {
		uint32_t pages = SQLITE_LOCK_PAGE - before;
		char path[] = "/tmp/acut-sqlite-XXXXXX";
		uint8_t page[SQLITE_PAGE];
		struct outfile *out;
		struct err err = {0};
		int fd = mkstemp(path);

		assert_true(fd >= 0);
		assert_int_equal(outfile_spool(NULL, &out, &err), 0);
		put_file(out, pages);
		for (uint64_t at = 0; at < outfile_size(out); at += SQLITE_PAGE) {
			uint64_t to = at ? at + (uint64_t)(pages - 1) * SQLITE_PAGE : 0;

			assert_int_equal(outfile_read(out, at, page, SQLITE_PAGE, &err), 0);
			assert_int_equal(pwrite(fd, page, SQLITE_PAGE, (off_t)to), SQLITE_PAGE);
		}
		check(path);
		outfile_free(out);
		close(fd);
		unlink(path);
	}
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_lock_page),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
