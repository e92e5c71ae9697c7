/* GeoPackages made here: geometries of every code, layers and their systems, what is refused, and damaged files. */
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

#include "lines_made.h"

static char text[LINES_CASE_TEXT];

/* The layer `breaks` with one row of this geometry. */
static const char *one(const struct lines_case_bytes *b)
{
	struct lines_made_row row = {NULL, b->at, b->n};
	const char *path = lines_case_path("p.gpkg");

	lines_made_gpkg(path, &row, 1, NULL);
	return lines_case_read(path, NULL, text);
}

static void test_geometries(void **state)
{
	static const struct {
		uint32_t code, n;
		const char *want;
	} rows[] = {
		{1002, 2, "#1 breaks LineString: open 0 0 0, 1 10 0.25\n"},
		{3002, 3, "#1 breaks LineString: open 0 0 0, 1 10 0.25, 2 20 0.5\n"},
		{0x80000002, 2, "#1 breaks LineString: open 0 0 0, 1 10 0.25\n"},
		{0xc0000002, 2, "#1 breaks LineString: open 0 0 0, 1 10 0.25\n"},
		{0xa0000002, 2, "#1 breaks LineString: open 0 0 0, 1 10 0.25\n"},
		{1003, 4, "#1 breaks Polygon: ring 0 0 0, 1 10 0.25, 2 20 0.5\n"},
		{2, 2, "#1 breaks LineString ! it has no z\n"},
		{2002, 2, "#1 breaks LineString ! it has no z\n"},
		{3, 4, "#1 breaks Polygon ! it has no z\n"},
		{1002, 0, "#1 breaks LineString\n"},
		{1002, 1, "#1 breaks LineString ! a line has fewer than two vertices\n"},
		{1001, 0, "#1 breaks Point = points\n"},
		{1005, 0, "#1 breaks MultiLineString\n"},
		{1008, 0,
		 "#1 breaks CircularString ! it is a curve (CircularString, CompoundCurve, CurvePolygon and the like)\n"},
		{1016, 0, "#1 breaks TIN ! it is a surface of faces (TIN, PolyhedralSurface, Triangle)\n"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
		for (int big = 0; big < 2; big++)
			for (unsigned envelope = 0; envelope < 5; envelope++) {
				struct lines_case_bytes b = {.n = 0};

				lines_made_gpkg_head(&b, envelope << 1 | (big ? 0 : 1));
				lines_made_wkb(&b, big, rows[i].code, rows[i].n);
				assert_string_equal(one(&b), rows[i].want);
			}
}

static void test_collections(void **state)
{
	struct lines_case_bytes b = {.n = 0};

	lines_made_gpkg_head(&b, 1);
	lines_made_wkb(&b, 0, 1007, 2);
	lines_made_wkb(&b, 1, 1005, 1);
	lines_made_wkb(&b, 0, 1002, 2);
	lines_made_wkb(&b, 0, 1006, 1);
	lines_made_wkb(&b, 1, 1003, 4);
	assert_string_equal(one(&b), "#1 breaks GeometryCollection: open 0 0 0, 1 10 0.25; ring 0 0 0, 1 10 0.25, 2 20 0.5\n");
	lines_case_u8(&b, 0);
	assert_string_equal(
		one(&b),
		"error: row 1: its geometry is followed by other bytes (the file is damaged, or no GeoPackage; write it again)\n");
	b.n = 0;
	lines_made_gpkg_head(&b, 1);
	lines_made_wkb(&b, 0, 1007, 2);
	lines_made_wkb(&b, 0, 1001, 1);
	lines_made_wkb(&b, 0, 1002, 2);
	assert_string_equal(one(&b), "#1 breaks GeometryCollection ! it is a collection of lines and points\n");
	for (size_t n = 0; n < b.n; n++) {
		struct lines_case_bytes cut = b;

		cut.n = n;
		if (strncmp(one(&cut), n ? "error: row 1: " : "#1 breaks \n", n ? 14 : 11) != 0)
			fail_msg("cut at %zu: %s", n, text);
	}
	b.n = 0;
	lines_made_gpkg_head(&b, 1);
	for (int i = 0; i < 12; i++)
		lines_made_wkb(&b, 0, 1007, 1);
	assert_non_null(strstr(one(&b), "has collections in collections in collections"));
}

static void test_damaged_geometry(void **state)
{
	static const struct {
		size_t at;
		uint32_t v;
		const char *want;
	} rows[] = {
		{0, 0x4758, "is none of a GeoPackage"},
		{3, 11, "the head of its geometry is damaged"},
		{3, 0x21, "extended geometry"},
		{8, 2, "has no order of bytes"},
		{9, 1020, "has a type that does not exist"},
		{9, 4002, "has a type that does not exist"},
		{13, 0xffffffff, "claims more vertices than it has"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct lines_case_bytes b = {.n = 0};

		lines_made_gpkg_head(&b, 1);
		lines_made_wkb(&b, 0, 1002, 2);
		if (rows[i].at == 3 || rows[i].at == 8)
			b.at[rows[i].at] = (uint8_t)rows[i].v;
		else
			lines_case_set32(&b, rows[i].at, rows[i].v, 0);
		if (!strstr(one(&b), rows[i].want))
			fail_msg("row %zu: %s", i, text);
	}
}

static struct lines_case_bytes line;

static void make(const char *sql)
{
	struct lines_made_row rows[] = {{"hard", line.at, line.n}, {NULL, line.at, line.n}, {"lake", NULL, 0}};

	lines_made_gpkg(lines_case_path("q.gpkg"), rows, 3, sql);
}

static const char *read_all(const struct lines_options *opt)
{
	return lines_case_read(lines_case_path("q.gpkg"), opt, text);
}

#define LINE ": open 0 0 0, 1 10 0.25\n"

static void test_layers(void **state)
{
	static const struct lines_options lakes = {.layer = "LAKES"}, none = {.layer = "rivers"}, kind = {.kind_field = "sort"},
					  wrong = {.kind_field = "sorts"};

	make("INSERT INTO lakes SELECT id + 5, geom FROM breaks");
	assert_string_equal(read_all(NULL), "#1 breaks LineString" LINE "#2 breaks LineString" LINE "#3 breaks \n"
					    "#1 lakes LineString" LINE "#2 lakes LineString" LINE "#3 lakes \n");
	assert_string_equal(read_all(&lakes), "#1 lakes LineString" LINE "#2 lakes LineString" LINE "#3 lakes \n");
	assert_string_equal(read_all(&kind), "#1 breaks LineString [hard]" LINE "#2 breaks LineString" LINE "#3 breaks  [lake]\n"
					     "#1 lakes LineString" LINE "#2 lakes LineString" LINE "#3 lakes \n");
	assert_string_equal(read_all(&none), "error: it has no layer \"rivers\" (its layers: breaks, lakes)\n");
	assert_string_equal(read_all(&wrong),
			    "error: no layer has a field \"sorts\" (ogrinfo -so FILE LAYER lists the fields of a layer)\n");
}

/* A file of many layers and views is no damaged one. */
static void test_many_layers(void **state)
{
	enum { LAYERS = 900, VIEWS = 10 };
	static const struct lines_options last = {.layer = "T899"};
	static char sql[LAYERS * 200];
	size_t n = (size_t)sprintf(sql, "BEGIN;");

	for (int i = 0; i < LAYERS; i++)
		n += (size_t)sprintf(sql + n,
				     "CREATE TABLE t%d(id INTEGER PRIMARY KEY, geom);"
				     "INSERT INTO gpkg_geometry_columns VALUES('t%d', 'geom', '', 0, 1, 0);",
				     i, i);
	/* SQLite itself looks through the schema for each statement that adds to it. */
	sprintf(sql + n,
		"INSERT INTO t899 SELECT id, geom FROM breaks; PRAGMA writable_schema = on;"
		"WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT %d)"
		"INSERT INTO sqlite_schema(rowid, type, name, tbl_name, rootpage, sql)"
		"SELECT -i, 'view', 'v' || i, 'v' || i, 0, 'CREATE VIEW v' || i || ' AS SELECT 1' FROM n; COMMIT",
		LAYERS * VIEWS);
	make(sql);
	assert_string_equal(read_all(&last), "#1 t899 LineString" LINE "#2 t899 LineString" LINE "#3 t899 \n");
}

static void test_systems(void **state)
{
	static const struct lines_options opt;
	const struct lines_feature *f;
	struct err err = ERR_INIT;
	struct lines *l;

	make("INSERT INTO lakes SELECT id + 5, geom FROM breaks");
	assert_int_equal(lines_open(lines_case_path("q.gpkg"), &opt, &l, &err), 0);
	assert_int_equal(lines_next(l, &f, &err), 0);
	assert_int_equal(f->layer->crs.epsg, 25832);
	assert_string_equal(f->layer->crs.name, "ETRS89 / UTM 32N");
	assert_string_equal(f->layer->crs.unit, "metre");
	assert_false(f->layer->crs.degrees);
	assert_non_null(strstr(f->layer->crs.wkt, "PROJCS"));
	for (int i = 0; i < 3; i++)
		assert_int_equal(lines_next(l, &f, &err), 0);
	assert_string_equal(f->layer->name, "lakes");
	assert_int_equal(f->place, 6);
	assert_true(!f->layer->crs.epsg && !*f->layer->crs.wkt);
	lines_close(l);
}

/* A file of anybody: views and what stands in a schema are not run. */
static void test_hostile(void **state)
{
	static const struct {
		const char *sql, *want;
	} rows[] = {
		{"DROP TABLE gpkg_geometry_columns", "it is an SQLite file, but no GeoPackage"},
		{"DROP TABLE lakes; CREATE VIEW lakes AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n) SELECT i AS g FROM n",
		 "the layer \"lakes\" is no table but a view"},
		{"DROP TABLE lakes", "the layer \"lakes\" is no table: it does not exist"},
		{"UPDATE gpkg_geometry_columns SET column_name = 'no\"such'", "no such column: no\"such"},
		{"ALTER TABLE breaks RENAME TO \"a\"\"b; --\"; UPDATE gpkg_geometry_columns SET table_name = 'a\"b; --' WHERE column_name = 'geom'",
		 "#1 a\"b; -- LineString"},
		{"UPDATE breaks SET geom = zeroblob(26000000) WHERE id = 1",
		 "#1 breaks  ! it has more than 524288 vertices\n#2 breaks LineString: open"},
		{"UPDATE breaks SET geom = 'GP text' WHERE id = 1", "error: row 1: its geometry"},
		{"WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT 4095) INSERT INTO gpkg_geometry_columns SELECT 'breaks', "
		 "'geom', '', 0, 1, 0 FROM n",
		 "it has more than 4096 layers"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		make(rows[i].sql);
		if (!strstr(read_all(NULL), rows[i].want))
			fail_msg("%s: %s", rows[i].sql, text);
	}
}

/* Any byte of the file may be another: features or an error, and always an end. */
static void test_damaged(void **state)
{
	static uint8_t bytes[1 << 16];
	unsigned errors = 0;
	struct stat st;
	FILE *f;

	make(NULL);
	assert_int_equal(stat(lines_case_path("q.gpkg"), &st), 0);
	f = fopen(lines_case_path("q.gpkg"), "rb");
	assert_true(f && fread(bytes, 1, sizeof bytes, f) == (size_t)st.st_size);
	fclose(f);
	for (size_t i = 0; i < (size_t)st.st_size; i++) {
		static const uint8_t flips[] = {0xff, 0x01, 0x80};

		bytes[i] ^= flips[i % 3];
		lines_case_file("r.gpkg", bytes, (size_t)st.st_size);
		bytes[i] ^= flips[i % 3];
		errors += strstr(lines_case_read(lines_case_path("r.gpkg"), NULL, text), "error: ") != NULL;
	}
	for (size_t n = 0; n < (size_t)st.st_size; n += 100) {
		lines_case_file("r.gpkg", bytes, n);
		if (!strstr(lines_case_read(lines_case_path("r.gpkg"), NULL, text), "error: "))
			fail_msg("cut at %zu: %s", n, text);
	}
	print_message("%u of %zu are errors\n", errors, (size_t)st.st_size);
	assert_true(errors > 100);
}

static uint8_t pages[1 << 20];

static size_t be16(size_t at)
{
	return pages[at] << 8 | pages[at + 1];
}

static size_t child(size_t page, size_t cell)
{
	size_t at = page * 512 + (cell < be16(page * 512 + 3) ? be16(page * 512 + 12 + 2 * cell) : 8);

	return (be16(at) << 16 | be16(at + 2)) - 1;
}

/* All children of a page inside a tree become this one. */
static void set_children(size_t page, size_t to)
{
	for (size_t i = 0; i <= be16(page * 512 + 3); i++) {
		size_t at = page * 512 + (i < be16(page * 512 + 3) ? be16(page * 512 + 12 + 2 * i) : 8);

		pages[at] = pages[at + 1] = 0;
		pages[at + 2] = (uint8_t)((to + 1) >> 8);
		pages[at + 3] = (uint8_t)(to + 1);
	}
}

/* The tree of a table is made a ladder: each rung of it leads to the next one fifty times. */
static void make_ladder(const char *sql, const char *table)
{
	size_t root, rung[16], n = 0, bottom, size;
	sqlite3_stmt *s;
	sqlite3 *db;
	FILE *f;

	make(sql);
	assert_int_equal(sqlite3_open(lines_case_path("q.gpkg"), &db), SQLITE_OK);
	assert_int_equal(sqlite3_prepare_v2(db, "SELECT rootpage FROM sqlite_schema WHERE name = ?", -1, &s, NULL), SQLITE_OK);
	sqlite3_bind_text(s, 1, table, -1, SQLITE_STATIC);
	assert_int_equal(sqlite3_step(s), SQLITE_ROW);
	root = (size_t)sqlite3_column_int(s, 0) - 1;
	sqlite3_finalize(s);
	sqlite3_close(db);
	f = fopen(lines_case_path("q.gpkg"), "rb");
	assert_non_null(f);
	size = fread(pages, 1, sizeof pages, f);
	fclose(f);
	assert_true(size < sizeof pages && pages[root * 512] == 5 && pages[child(root, 0) * 512] == 5);
	for (size_t i = 0; i <= be16(root * 512 + 3) && n < 16; i++)
		rung[n++] = child(root, i);
	bottom = child(rung[0], 0);
	assert_true(n > 5);
	assert_int_equal(pages[bottom * 512], 13);
	set_children(root, rung[0]);
	for (size_t i = 0; i + 1 < n; i++)
		set_children(rung[i], rung[i + 1]);
	set_children(rung[n - 1], bottom);
	lines_case_file("q.gpkg", pages, size);
}

/* A tree of pages that leads to the same ones again and again has more rows than anybody can read. */
static void test_endless(void **state)
{
	make_ladder(
		"WITH RECURSIVE n(i) AS (SELECT 10 UNION ALL SELECT i + 1 FROM n LIMIT 5000) INSERT INTO breaks SELECT i, NULL, "
		"'0123456789012345678901234567890123456789' FROM n",
		"breaks");
	assert_non_null(strstr(read_all(NULL), "error: it is damaged: row "));
	make_ladder(
		"DROP TABLE gpkg_spatial_ref_sys; CREATE TABLE gpkg_spatial_ref_sys(srs_name, srs_id, organization, organization_coordsys_id, "
		"definition); WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT 5000) INSERT INTO gpkg_spatial_ref_sys "
		"SELECT '0123456789012345678901234567890123456789', -7, 0, 0, 0 FROM n",
		"gpkg_spatial_ref_sys");
	assert_non_null(strstr(read_all(NULL), "error: it is damaged: its rows have no end"));
}

/* Nothing appears beside the file. */
static void test_untouched(void **state)
{
	make("PRAGMA journal_mode = wal; INSERT INTO lakes SELECT id + 5, geom FROM breaks");
	assert_non_null(strstr(read_all(NULL), "#3 lakes"));
	assert_int_not_equal(access(lines_case_path("q.gpkg-shm"), F_OK), 0);
	assert_int_not_equal(access(lines_case_path("q.gpkg-wal"), F_OK), 0);
}

/* What another program has written, but not yet into the file itself, is read. */
static void test_log(void **state)
{
	sqlite3 *db;

	make("PRAGMA journal_mode = wal");
	assert_int_equal(sqlite3_open(lines_case_path("q.gpkg"), &db), SQLITE_OK);
	assert_int_equal(sqlite3_exec(db, "INSERT INTO lakes SELECT id + 5, geom FROM breaks", NULL, NULL, NULL), SQLITE_OK);
	assert_non_null(strstr(read_all(NULL), "#3 lakes"));
	sqlite3_close(db);
}

/* A copy of a file that lies beside q.gpkg, as the same beside r.gpkg. */
static void copy(const char *end)
{
	static uint8_t bytes[1 << 20];
	char name[64];
	size_t n;
	FILE *f;

	snprintf(name, sizeof name, "q.gpkg%s", end);
	f = fopen(lines_case_path(name), "rb");
	assert_non_null(f);
	n = fread(bytes, 1, sizeof bytes, f);
	assert_true(n > 0 && n < sizeof bytes);
	fclose(f);
	snprintf(name, sizeof name, "r.gpkg%s", end);
	lines_case_file(name, bytes, n);
}

static bool beside(const char *end)
{
	char name[64];

	snprintf(name, sizeof name, "r.gpkg%s", end);
	return !access(lines_case_path(name), F_OK);
}

/* What a program left that ended without closing the file: nothing is changed, and nothing appears. */
static void test_not_closed(void **state)
{
	static const char sql[] =
		"BEGIN; WITH RECURSIVE n(i) AS (SELECT 10 UNION ALL SELECT i + 1 FROM n LIMIT 3000) INSERT INTO "
		"lakes SELECT i, NULL FROM n";
	static const char want[] = "error: it was not closed: changes that were made in it are in r.gpkg-%s (open it once in the "
				   "program that made them, and close it there)\n";
	char said[400];
	sqlite3 *db;

	/* with a log and the index of it; without the index */
	make("PRAGMA journal_mode = wal");
	assert_int_equal(sqlite3_open(lines_case_path("q.gpkg"), &db), SQLITE_OK);
	assert_int_equal(sqlite3_exec(db, "INSERT INTO lakes SELECT id + 5, geom FROM breaks", NULL, NULL, NULL), SQLITE_OK);
	copy("");
	copy("-wal");
	snprintf(said, sizeof said, want, "wal");
	assert_string_equal(lines_case_read(lines_case_path("r.gpkg"), NULL, text), said);
	assert_true(beside("-wal") && !beside("-shm") && !beside("-journal"));
	copy("-shm");
	assert_non_null(strstr(lines_case_read(lines_case_path("r.gpkg"), NULL, text), "#3 lakes"));
	assert_true(beside("-wal") && beside("-shm") && !beside("-journal"));
	sqlite3_close(db);
	unlink(lines_case_path("r.gpkg-wal"));
	unlink(lines_case_path("r.gpkg-shm"));

	/* in the middle of a transaction */
	make(NULL);
	assert_int_equal(sqlite3_open(lines_case_path("q.gpkg"), &db), SQLITE_OK);
	assert_int_equal(sqlite3_exec(db, "PRAGMA cache_size = 1", NULL, NULL, NULL), SQLITE_OK);
	assert_int_equal(sqlite3_exec(db, sql, NULL, NULL, NULL), SQLITE_OK);
	copy("");
	copy("-journal");
	snprintf(said, sizeof said, want, "journal");
	assert_string_equal(lines_case_read(lines_case_path("r.gpkg"), NULL, text), said);
	assert_true(!beside("-wal") && !beside("-shm") && beside("-journal"));
	sqlite3_close(db);
}

static void test_names(void **state)
{
	struct lines_made_row row = {NULL, line.at, line.n};
	char path[600];

	lines_made_gpkg(lines_case_path("a?b#c%41 &mode=rw.gpkg"), &row, 1, NULL);
	assert_non_null(
		strstr(lines_case_read(lines_case_path("a?b#c%41 &mode=rw.gpkg"), NULL, text), "#1 breaks LineString: open"));
	snprintf(path, sizeof path, "/%s", lines_case_path("a?b#c%41 &mode=rw.gpkg"));
	assert_non_null(strstr(lines_case_read(path, NULL, text), "#1 breaks LineString: open"));
}

static int remove_all(void **state)
{
	lines_case_remove_all();
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_geometries),  cmocka_unit_test(test_collections), cmocka_unit_test(test_damaged_geometry),
		cmocka_unit_test(test_layers),      cmocka_unit_test(test_systems),     cmocka_unit_test(test_hostile),
		cmocka_unit_test(test_damaged),     cmocka_unit_test(test_untouched),   cmocka_unit_test(test_endless),
		cmocka_unit_test(test_log),         cmocka_unit_test(test_names),       cmocka_unit_test(test_not_closed),
		cmocka_unit_test(test_many_layers),
	};

	lines_made_gpkg_head(&line, 1);
	lines_made_wkb(&line, 0, 1002, 2);
	return cmocka_run_group_tests(tests, NULL, remove_all);
}
