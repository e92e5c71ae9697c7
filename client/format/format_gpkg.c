/*
 * GeoPackage 1.3 (https://www.geopackage.org/spec130/): a table of contours, each a LINESTRING Z, with its elevation, whether it
 * is an index contour and closed, and its length in the plane; and its spatial index (extension gpkg_rtree_index).
 *
 * A row gets its points through SQLite's incremental blobs, so the largest line needs no memory. Where the output cannot seek all
 * of it is in a nameless file first. The time of change is a constant: the same mesh is the same file.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "format_database.h"
#include "format_lines.h"
#include "outfile.h"

enum { OWN_SYSTEM = 100000, GEOMETRY_HEAD = 40 + 9, POINT = 24, POINTS = 1024 };

/* Before the lines. 1196444487 is "GPKG". */
static const char begin[] =
	"PRAGMA application_id = 1196444487;"
	"PRAGMA user_version = 10300;"
	"CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY, organization TEXT NOT NULL, "
	"organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);"
	"INSERT INTO gpkg_spatial_ref_sys VALUES ('Undefined Cartesian SRS', -1, 'NONE', -1, 'undefined', NULL), "
	"('Undefined geographic SRS', 0, 'NONE', 0, 'undefined', NULL), ('WGS 84', 4326, 'EPSG', 4326, "
	"'GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563,AUTHORITY[\"EPSG\",\"7030\"]],"
	"AUTHORITY[\"EPSG\",\"6326\"]],PRIMEM[\"Greenwich\",0,AUTHORITY[\"EPSG\",\"8901\"]],UNIT[\"degree\",0.0174532925199433,"
	"AUTHORITY[\"EPSG\",\"9122\"]],AUTHORITY[\"EPSG\",\"4326\"]]', NULL);"
	"CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE, "
	"description TEXT DEFAULT '', last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')), min_x DOUBLE, "
	"min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER, CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES "
	"gpkg_spatial_ref_sys(srs_id));"
	"CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL, "
	"srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL, CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, "
	"column_name), CONSTRAINT uk_gc_table_name UNIQUE (table_name), CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES "
	"gpkg_contents(table_name), CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));"
	"CREATE TABLE gpkg_extensions (table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL, definition TEXT NOT NULL, "
	"scope TEXT NOT NULL, CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name));"
	"INSERT INTO gpkg_extensions VALUES ('contours', 'geom', 'gpkg_rtree_index', "
	"'http://www.geopackage.org/spec120/#extension_rtree', 'write-only');"
	"CREATE TABLE contours (fid INTEGER NOT NULL PRIMARY KEY, elevation DOUBLE NOT NULL, \"index\" MEDIUMINT NOT NULL, "
	"closed MEDIUMINT NOT NULL, length DOUBLE NOT NULL, geom LINESTRING);"
	"CREATE VIRTUAL TABLE rtree_contours_geom USING rtree(id, minx, maxx, miny, maxy);";

/* After them, each with all parameters. A system that is there already, as WGS 84, stays. */
static const char *const facts[] = {
	"INSERT OR IGNORE INTO gpkg_spatial_ref_sys VALUES (:name, :system, :organization, :system, :definition, NULL)",
	"INSERT INTO gpkg_contents VALUES ('contours', 'features', 'contours', :description, '2000-01-01T00:00:00.000Z', "
	":min_x, :min_y, :max_x, :max_y, :system)",
	"INSERT INTO gpkg_geometry_columns VALUES ('contours', 'geom', 'LINESTRING', :system, 1, 0)",
};

/* The triggers of the extension keep the index true when a line is edited. They come last: SQLite has not their functions. */
#define INSERT                                                                                                                  \
	"INSERT OR REPLACE INTO rtree_contours_geom VALUES (NEW.fid, ST_MinX(NEW.geom), ST_MaxX(NEW.geom), ST_MinY(NEW.geom), " \
	"ST_MaxY(NEW.geom)); END;"
#define DELETE "DELETE FROM rtree_contours_geom WHERE id = OLD.fid; "
#define THERE "(NEW.geom NOTNULL AND NOT ST_IsEmpty(NEW.geom)) BEGIN "
#define GONE "(NEW.geom ISNULL OR ST_IsEmpty(NEW.geom)) BEGIN "
static const char triggers[] =
	"CREATE TRIGGER rtree_contours_geom_insert AFTER INSERT ON contours WHEN " THERE INSERT
	"CREATE TRIGGER rtree_contours_geom_update1 AFTER UPDATE OF geom ON contours WHEN OLD.fid = NEW.fid AND " THERE INSERT
	"CREATE TRIGGER rtree_contours_geom_update2 AFTER UPDATE OF geom ON contours WHEN OLD.fid = NEW.fid AND " GONE DELETE
	"END;"
	"CREATE TRIGGER rtree_contours_geom_update3 AFTER UPDATE ON contours WHEN OLD.fid != NEW.fid AND " THERE DELETE INSERT
	"CREATE TRIGGER rtree_contours_geom_update4 AFTER UPDATE ON contours WHEN OLD.fid != NEW.fid AND " GONE
	"DELETE FROM rtree_contours_geom WHERE id IN (OLD.fid, NEW.fid); END;"
	"CREATE TRIGGER rtree_contours_geom_delete AFTER DELETE ON contours WHEN OLD.geom NOT NULL BEGIN " DELETE "END;";

struct gpkg {
	struct format_lines *w;
	struct database file;
	sqlite3_stmt *line, *index;
	sqlite3_blob *blob; /* the geometry of the last line */
	int32_t system;     /* srs_id */
	double box[4];      /* of all lines */
	int64_t lines;
};

/* ---- lines ---- */

/* A row whose geometry is zeros. */
static int put_row(struct gpkg *g, const struct contour_line *line, struct err *err)
{
	sqlite3_stmt *s = g->line;

	sqlite3_bind_int64(s, 1, ++g->lines);
	sqlite3_bind_double(s, 2, contour_height(g->w->contour, line->level));
	sqlite3_bind_int(s, 3, format_lines_is_index(g->w, line->level));
	sqlite3_bind_int(s, 4, line->closed);
	sqlite3_bind_double(s, 5, line->length);
	sqlite3_bind_zeroblob64(s, 6, GEOMETRY_HEAD + line->points * POINT);
	return database_step(&g->file, s, err);
}

static int put_box(struct gpkg *g, const double box[4], struct err *err)
{
	static const int order[] = {0, 2, 1, 3};

	sqlite3_bind_int64(g->index, 1, g->lines);
	for (int i = 0; i < 4; i++) {
		sqlite3_bind_double(g->index, 2 + i, box[order[i]]);
		g->box[i] = i < 2 ? fmin(g->box[i], box[i]) : fmax(g->box[i], box[i]);
	}
	return database_step(&g->file, g->index, err);
}

/* "GP", with the box; then well-known binary of a line with heights. */
static void geometry_head(const struct gpkg *g, const struct contour_line *line, struct packer *p)
{
	static const int order[] = {0, 2, 1, 3};

	packer_bytes(p, "GP", 2);
	packer_u8(p, 0);
	packer_u8(p, 3); /* little-endian, a box of x and y */
	packer_i32(p, g->system);
	for (int i = 0; i < 4; i++)
		packer_f64(p, line->box[order[i]]);
	packer_u8(p, 1);
	packer_u32(p, 1002);
	packer_u32(p, (uint32_t)line->points);
}

/* What is packed goes to the geometry of the last line, and the packer is empty again. */
static int put_packed(struct gpkg *g, struct packer *p, uint64_t *at, struct err *err)
{
	size_t n = packer_size(p);
	int r = sqlite3_blob_write(g->blob, p->start, (int)n, (int)*at) == SQLITE_OK ? 0 : database_failed(&g->file, err);

	*at += n;
	p->at = p->start;
	return r;
}

static int put_geometry(struct gpkg *g, const struct contour_line *line, struct err *err)
{
	const double z = contour_height(g->w->contour, line->level), (*point)[2];
	uint8_t bytes[GEOMETRY_HEAD + POINTS * POINT];
	struct packer p = packer_of(bytes, sizeof(bytes));
	uint64_t at = 0;
	size_t n;
	int r = g->blob ? sqlite3_blob_reopen(g->blob, g->lines) :
			  sqlite3_blob_open(g->file.db, "main", "contours", "geom", g->lines, 1, &g->blob);

	if (r != SQLITE_OK)
		return database_failed(&g->file, err);
	geometry_head(g, line, &p);
	while (!(r = contour_points(g->w->contour, &point, &n, err)) && n) {
		for (size_t i = 0; i < n && !r; i++) {
			if (sizeof(bytes) - packer_size(&p) < POINT)
				r = put_packed(g, &p, &at, err);
			packer_f64(&p, point[i][0]);
			packer_f64(&p, point[i][1]);
			packer_f64(&p, z);
		}
		if (r)
			return r;
	}
	return r ? r : put_packed(g, &p, &at, err);
}

static int put_line(struct gpkg *g, const struct contour_line *line, struct err *err)
{
	int r;

	if (line->points * POINT + 1000 > DATABASE_ROW_MOST) {
		err_set(err, ERR_LIMIT, "a contour has %llu points, and a row of a GeoPackage at most 41 million",
			(unsigned long long)line->points);
		return err_add_hint(err, "write GeoJSON or DXF, give a larger --interval, or a part with --bbox");
	}
	r = put_row(g, line, err);
	if (!r)
		r = put_box(g, line->box, err);
	return r ? r : put_geometry(g, line, err);
}

static int put_lines(struct gpkg *g, struct err *err)
{
	struct contour_line line;
	int r = database_prepare(&g->file, "INSERT INTO contours VALUES (?, ?, ?, ?, ?, ?)", &g->line, err);

	if (!r)
		r = database_prepare(&g->file, "INSERT INTO rtree_contours_geom VALUES (?, ?, ?, ?, ?)", &g->index, err);
	while (!r && !(r = format_lines_next(g->w, &line, err)) && line.points) {
		r = format_lines_room(g->w, err);
		if (!r)
			r = put_line(g, &line, err);
	}
	return r;
}

/* ---- the file ---- */

static void bind_text(sqlite3_stmt *s, const char *parameter, const char *text)
{
	sqlite3_bind_text(s, sqlite3_bind_parameter_index(s, parameter), text, -1, SQLITE_STATIC);
}

static int put_fact(struct gpkg *g, const char *sql, struct err *err)
{
	static const char *const side[4] = {":min_x", ":min_y", ":max_x", ":max_y"};
	sqlite3_stmt *s;
	int r = database_prepare(&g->file, sql, &s, err);

	if (r)
		return r;
	bind_text(s, ":name", g->w->name);
	bind_text(s, ":organization", g->w->epsg ? "EPSG" : "NONE");
	bind_text(s, ":definition", g->w->wkt ? g->w->wkt : "undefined");
	bind_text(s, ":description", g->w->comments);
	sqlite3_bind_int(s, sqlite3_bind_parameter_index(s, ":system"), g->system);
	for (int i = 0; i < 4 && g->lines; i++) /* else they are null */
		sqlite3_bind_double(s, sqlite3_bind_parameter_index(s, side[i]), g->box[i]);
	r = database_step(&g->file, s, err);
	sqlite3_finalize(s);
	return r;
}

static int put_file(struct gpkg *g, struct outfile *out, struct err *err)
{
	int r = database_open(&g->file, out, err);

	if (!r)
		r = database_run(&g->file, begin, err);
	if (!r)
		r = put_lines(g, err);
	for (size_t i = 0; i < sizeof(facts) / sizeof(*facts) && !r; i++)
		r = put_fact(g, facts[i], err);
	if (!r)
		r = database_run(&g->file, triggers, err);
	sqlite3_blob_close(g->blob);
	sqlite3_finalize(g->line);
	sqlite3_finalize(g->index);
	if (!r)
		r = database_end(&g->file, err);
	database_done(&g->file);
	return r;
}

static int put_all(struct format_lines *w, struct err *err)
{
	struct gpkg g = {.w = w, .box = {INFINITY, INFINITY, -INFINITY, -INFINITY}};
	struct outfile *spool = NULL;
	int r = outfile_seekable(w->out) ? 0 : outfile_spool(w->out, &spool, err);

	g.system = w->epsg ? (int32_t)w->epsg : w->wkt ? OWN_SYSTEM : w->degrees ? 0 : -1;
	if (!r)
		r = put_file(&g, spool ? spool : w->out, err);
	if (!r && spool)
		r = outfile_join(w->out, spool, 0, err);
	outfile_free(spool);
	return r;
}

static int gpkg_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	return format_lines_open(out, opt, "gpkg", put_all, ret, err);
}

const struct format format_gpkg = {
	.name = "gpkg",
	.extensions = ".gpkg",
	.help = "GeoPackage: contours, with their heights (--interval)",
	.purpose = "QGIS, GIS: contours",
	.open = gpkg_open,
	FORMAT_LINES_ROW,
};
