#include "lines_made.h"

#include <assert.h>
#include <sqlite3.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* ---- Shapefile ---- */

static void shape_head(struct lines_case_bytes *b, uint32_t type)
{
	b->n = 0;
	lines_case_u32(b, 9994, 1);
	for (int i = 0; i < 6; i++)
		lines_case_u32(b, 0, 1);
	lines_case_u32(b, 1000, 0);
	lines_case_u32(b, type, 0);
	for (int i = 0; i < 16; i++)
		lines_case_u32(b, 0, 0);
}

void lines_made_shape_begin(struct lines_case_bytes *shp, struct lines_case_bytes *shx, uint32_t type)
{
	shape_head(shp, type);
	shape_head(shx, type);
}

static void shape_axis(struct lines_case_bytes *shp, uint32_t type, const uint32_t *count, int z)
{
	for (uint32_t p = 0, i = 0; count[p]; p++)
		for (uint32_t k = 0; k < count[p]; k++, i++) {
			double v = type % 10 == 5 && k + 1 == count[p] ? i - k : i;

			lines_case_double(shp, z ? v / 4 : v, 0);
			if (!z)
				lines_case_double(shp, 10 * v, 0);
		}
}

void lines_made_shape(struct lines_case_bytes *shp, struct lines_case_bytes *shx, uint32_t type, const uint32_t *count)
{
	size_t at = shp->n;
	uint32_t parts = 0, points = 0, first = 0;

	lines_case_u32(shx, (uint32_t)at / 2, 1);
	lines_case_u32(shp, (uint32_t)(shx->n - 100) / 8 + 1, 1);
	lines_case_u32(shp, 0, 1);
	lines_case_u32(shp, type, 0);
	for (; count && count[parts]; parts++)
		points += count[parts];
	if (count) {
		for (int i = 0; i < 4; i++)
			lines_case_double(shp, 0, 0);
		lines_case_u32(shp, parts, 0);
		lines_case_u32(shp, points, 0);
		for (uint32_t i = 0; i < parts; first += count[i++])
			lines_case_u32(shp, first, 0);
		shape_axis(shp, type, count, 0);
		if (type > 10 && type < 20) {
			lines_case_double(shp, 0, 0);
			lines_case_double(shp, 0, 0);
			shape_axis(shp, type, count, 1);
		}
	}
	lines_case_set32(shp, at + 4, (uint32_t)(shp->n - at - 8) / 2, 1);
	lines_case_u32(shx, (uint32_t)(shp->n - at - 8) / 2, 1);
}

void lines_made_table(struct lines_case_bytes *dbf, const char *deleted, uint32_t rows)
{
	static const struct {
		const char *name;
		unsigned size;
	} fields[] = {{"NAME", 8}, {"KIND_OF_LI", 6}};

	dbf->n = 0;
	lines_case_u32(dbf, 3, 0);
	lines_case_u32(dbf, rows, 0);
	lines_case_u32(dbf, (32 + 64 + 1) | 15 << 16, 0);
	for (int i = 0; i < 5; i++)
		lines_case_u32(dbf, 0, 0);
	for (int i = 0; i < 2; i++)
		for (unsigned k = 0; k < 32; k++)
			lines_case_u8(dbf, k == 11                    ? 'C' :
					   k == 16                    ? fields[i].size :
					   k < strlen(fields[i].name) ? (unsigned char)fields[i].name[k] :
									0);
	lines_case_u8(dbf, '\r');
	for (; *deleted; deleted++)
		for (unsigned k = 0; k < 15; k++)
			lines_case_u8(dbf, (unsigned char)(k ? "name    lake  "[k - 1] : *deleted));
}

/* ---- GeoPackage ---- */

void lines_made_wkb(struct lines_case_bytes *b, int big, uint32_t code, uint32_t n)
{
	uint32_t plain = code & 0x1fffffff, type = plain % 1000;
	int z = code >> 31 || plain / 1000 == 1 || plain / 1000 == 3, m = (code >> 30 & 1) || plain / 1000 >= 2;

	lines_case_u8(b, !big);
	lines_case_u32(b, code, big);
	if (code >> 29 & 1)
		lines_case_u32(b, 25832, big);
	if (type == 3)
		lines_case_u32(b, 1, big);
	if (type != 1)
		lines_case_u32(b, n, big);
	for (uint32_t i = 0; type < 4 && i < (type == 1 ? 1 : n); i++) {
		double v = type == 3 && i + 1 == n ? 0 : i;

		lines_case_double(b, v, big);
		lines_case_double(b, 10 * v, big);
		if (z)
			lines_case_double(b, v / 4, big);
		if (m)
			lines_case_double(b, 9, big);
	}
}

void lines_made_gpkg_head(struct lines_case_bytes *b, unsigned flags)
{
	static const unsigned envelope[8] = {0, 4, 6, 6, 8};

	lines_case_u8(b, 'G');
	lines_case_u8(b, 'P');
	lines_case_u8(b, 0);
	lines_case_u8(b, flags);
	lines_case_u32(b, 25832, 0);
	for (unsigned i = 0; i < envelope[flags >> 1 & 7]; i++)
		lines_case_double(b, 0, 0);
}

static void sql(sqlite3 *db, const char *text)
{
	char *said = NULL;

	if (sqlite3_exec(db, text, NULL, NULL, &said) != SQLITE_OK)
		fprintf(stderr, "%s: %s\n", text, said);
	assert(!said);
}

static void add_row(sqlite3 *db, const struct lines_made_row *row)
{
	sqlite3_stmt *s;

	assert(sqlite3_prepare_v2(db, "INSERT INTO breaks(geom, sort) VALUES(?, ?)", -1, &s, NULL) == SQLITE_OK);
	if (row->n)
		sqlite3_bind_blob(s, 1, row->geometry, (int)row->n, SQLITE_TRANSIENT);
	if (row->kind)
		sqlite3_bind_text(s, 2, row->kind, -1, SQLITE_TRANSIENT);
	assert(sqlite3_step(s) == SQLITE_DONE);
	sqlite3_finalize(s);
}

void lines_made_gpkg(const char *path, const struct lines_made_row *rows, size_t n, const char *more)
{
	sqlite3 *db;

	unlink(path);
	assert(sqlite3_open(path, &db) == SQLITE_OK);
	sql(db,
	    "PRAGMA synchronous = OFF; PRAGMA journal_mode = MEMORY; PRAGMA page_size = 512; PRAGMA application_id = 0x47504b47;"
	    "CREATE TABLE gpkg_spatial_ref_sys(srs_name, srs_id INTEGER PRIMARY KEY, organization, organization_coordsys_id, definition);"
	    "INSERT INTO gpkg_spatial_ref_sys VALUES('ETRS89 / UTM 32N', 25832, 'EPSG', 25832, "
	    "'PROJCS[\"x\",GEOGCS[\"y\",UNIT[\"degree\",1]],UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"25832\"]]');"
	    "CREATE TABLE gpkg_geometry_columns(table_name, column_name, geometry_type_name, srs_id, z, m);"
	    "INSERT INTO gpkg_geometry_columns VALUES('breaks', 'geom', 'GEOMETRY', 25832, 1, 0), ('lakes', 'g', 'POLYGON', 0, 1, 0);"
	    "CREATE TABLE breaks(id INTEGER PRIMARY KEY, geom BLOB, sort TEXT); CREATE TABLE lakes(id INTEGER PRIMARY KEY, g BLOB);");
	for (size_t i = 0; i < n; i++)
		add_row(db, &rows[i]);
	if (more)
		sql(db, more);
	sqlite3_close(db);
}
