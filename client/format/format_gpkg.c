/*
 * GeoPackage 1.3 (https://www.geopackage.org/spec130/): a table of contours, each a LINESTRING Z, with its elevation, whether it
 * is an index contour and closed, and its length in the plane.
 *
 * A row is written when the line is known, so the largest line needs no memory; the small tables follow, and the first page comes
 * last. Where the output cannot seek all of it is in a nameless file first. The time of change is a constant: the same mesh is
 * the same file.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "format_gpkg_index.h"
#include "format_lines.h"
#include "outfile.h"

#define APPLICATION 1196444487u /* "GPKG" */
#define VERSION 10300u
#define CHANGED "2000-01-01T00:00:00.000Z"
#define WGS84_TEXT                                                                                                               \
	"GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563,AUTHORITY[\"EPSG\",\"7030\"]],"          \
	"AUTHORITY[\"EPSG\",\"6326\"]],PRIMEM[\"Greenwich\",0,AUTHORITY[\"EPSG\",\"8901\"]],UNIT[\"degree\",0.0174532925199433," \
	"AUTHORITY[\"EPSG\",\"9122\"]],AUTHORITY[\"EPSG\",\"4326\"]]"
enum { WGS84 = 4326, OWN_SYSTEM = 100000, FEATURES_PAGE = 2, GEOMETRY_HEAD = 40 + 9, POINTS = 1024 };

/* Tables, and the number of indexes that their constraints make. */
enum { SYSTEMS, CONTENTS, COLUMNS, EXTENSIONS, FEATURES, TABLES };
static const struct {
	const char *name, *sql;
	unsigned indexes;
} tables[TABLES] = {
	{"gpkg_spatial_ref_sys",
	 "CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY, organization TEXT NOT NULL, "
	 "organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT)",
	 0},
	{"gpkg_contents",
	 "CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE, "
	 "description TEXT DEFAULT '', last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')), min_x DOUBLE, "
	 "min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER, CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES "
	 "gpkg_spatial_ref_sys(srs_id))",
	 2},
	{"gpkg_geometry_columns",
	 "CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL, "
	 "srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL, CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, "
	 "column_name), CONSTRAINT uk_gc_table_name UNIQUE (table_name), CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES "
	 "gpkg_contents(table_name), CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id))",
	 2},
	{"gpkg_extensions",
	 "CREATE TABLE gpkg_extensions (table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL, definition TEXT NOT NULL, "
	 "scope TEXT NOT NULL, CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name))",
	 1},
	{"contours",
	 "CREATE TABLE contours (fid INTEGER NOT NULL PRIMARY KEY, elevation DOUBLE NOT NULL, \"index\" MEDIUMINT NOT NULL, "
	 "closed MEDIUMINT NOT NULL, length DOUBLE NOT NULL, geom LINESTRING)",
	 0},
};

struct gpkg {
	struct format_lines *w;
	struct sqlite_file file;
	struct sqlite_table table[TABLES], schema;
	uint32_t index[TABLES][2]; /* their pages */
	struct gpkg_index *boxes;
	uint32_t box_page[3];
	int32_t system; /* srs_id */
	double box[4];  /* of all lines */
	uint64_t lines;
};

/* ---- lines ---- */

static int put_points(struct gpkg *g, const struct contour_line *line, struct err *err)
{
	const double z = contour_height(g->w->contour, line->level), (*point)[2];
	uint8_t bytes[24 * POINTS];
	size_t n;
	int r;

	while (!(r = contour_points(g->w->contour, &point, &n, err)) && n) {
		for (size_t i = 0, end; i < n && !r; i = end) {
			struct packer p = packer_of(bytes, sizeof(bytes));

			for (end = n - i < POINTS ? n : i + POINTS; i < end; i++) {
				packer_f64(&p, point[i][0]);
				packer_f64(&p, point[i][1]);
				packer_f64(&p, z);
			}
			r = sqlite_bytes(&g->file, bytes, packer_size(&p), err);
		}
		if (r)
			return r;
	}
	return r;
}

/* "GP", with the box; then well-known binary of a line with heights. */
static size_t geometry_head(const struct gpkg *g, const struct contour_line *line, uint8_t bytes[GEOMETRY_HEAD])
{
	static const int order[] = {0, 2, 1, 3};
	struct packer p = packer_of(bytes, GEOMETRY_HEAD);

	packer_bytes(&p, "GP", 2);
	packer_u8(&p, 0);
	packer_u8(&p, 3); /* little-endian, a box of x and y */
	packer_i32(&p, g->system);
	for (int i = 0; i < 4; i++)
		packer_f64(&p, line->box[order[i]]);
	packer_u8(&p, 1);
	packer_u32(&p, 1002);
	packer_u32(&p, (uint32_t)line->points);
	return packer_size(&p);
}

static int put_line(struct gpkg *g, const struct contour_line *line, struct err *err)
{
	struct sqlite_record r = {0};
	uint8_t head[GEOMETRY_HEAD];
	size_t n = geometry_head(g, line, head);
	int rc;

	if (line->points * 24 + 1000 > SQLITE_ROW_MOST) {
		err_set(err, ERR_LIMIT, "a contour has %llu points, and a row of a GeoPackage at most 41 million",
			(unsigned long long)line->points);
		return err_add_hint(err, "write GeoJSON or DXF, give a larger --interval, or a part with --bbox");
	}
	sqlite_null(&r); /* the number of the row */
	sqlite_real(&r, contour_height(g->w->contour, line->level));
	sqlite_integer(&r, format_lines_is_index(g->w, line->level));
	sqlite_integer(&r, line->closed);
	sqlite_real(&r, line->length);
	sqlite_blob(&r, n + line->points * 24);
	rc = sqlite_row(&g->file, &g->table[FEATURES], ++g->lines, &r, err);
	if (!rc)
		rc = sqlite_bytes(&g->file, head, n, err);
	if (!rc)
		rc = gpkg_index_add(g->boxes, g->lines, line->box, err);
	for (int i = 0; i < 4; i++)
		g->box[i] = i < 2 ? fmin(g->box[i], line->box[i]) : fmax(g->box[i], line->box[i]);
	return rc ? rc : put_points(g, line, err);
}

static int put_lines(struct gpkg *g, struct err *err)
{
	struct contour_line line;
	int r;

	while (!(r = contour_next(g->w->contour, &line, err)) && line.points) {
		r = format_lines_room(g->w, err);
		if (!r)
			r = put_line(g, &line, err);
		if (r)
			return r;
	}
	return r ? r : sqlite_table_end(&g->file, &g->table[FEATURES], err);
}

/* ---- the small tables ---- */

static int put_system(struct gpkg *g, int32_t number, const char *name, const char *organization, int32_t code,
		      const char *definition, struct err *err)
{
	struct sqlite_record r = {0};
	int rc;

	sqlite_text(&r, name);
	sqlite_null(&r);
	sqlite_text(&r, organization);
	sqlite_integer(&r, code);
	sqlite_text_later(&r, definition);
	sqlite_null(&r);
	rc = sqlite_row(&g->file, &g->table[SYSTEMS], (uint64_t)(int64_t)number, &r, err);
	return rc ? rc : sqlite_bytes(&g->file, definition, strlen(definition), err);
}

static int put_systems(struct gpkg *g, struct err *err)
{
	int r = put_system(g, -1, "Undefined Cartesian SRS", "NONE", -1, "undefined", err), own = g->system;

	if (!r)
		r = put_system(g, 0, "Undefined geographic SRS", "NONE", 0, "undefined", err);
	if (!r && own > 0 && own < WGS84)
		r = put_system(g, own, g->w->name, "EPSG", own, "undefined", err);
	if (!r)
		r = put_system(g, WGS84, "WGS 84", "EPSG", WGS84, WGS84_TEXT, err);
	if (!r && own > WGS84 && g->w->epsg)
		r = put_system(g, own, g->w->name, "EPSG", own, "undefined", err);
	if (!r && g->w->wkt)
		r = put_system(g, OWN_SYSTEM, g->w->name, "NONE", OWN_SYSTEM, g->w->wkt, err);
	return r ? r : sqlite_table_end(&g->file, &g->table[SYSTEMS], err);
}

static int put_contents(struct gpkg *g, struct err *err)
{
	struct sqlite_record r = {0}, index = {0};
	int rc;

	sqlite_text(&r, "contours");
	sqlite_text(&r, "features");
	sqlite_text(&r, "contours");
	sqlite_text(&r, g->w->comments);
	sqlite_text(&r, CHANGED);
	for (int i = 0; i < 4; i++) {
		if (g->lines)
			sqlite_real(&r, g->box[i]);
		else
			sqlite_null(&r);
	}
	sqlite_integer(&r, g->system);
	rc = sqlite_row(&g->file, &g->table[CONTENTS], 1, &r, err);
	if (!rc)
		rc = sqlite_table_end(&g->file, &g->table[CONTENTS], err);
	sqlite_text(&index, "contours");
	sqlite_integer(&index, 1);
	for (int i = 0; i < 2 && !rc; i++)
		rc = sqlite_index(&g->file, &index, 1, &g->index[CONTENTS][i], err);
	return rc;
}

static int put_columns(struct gpkg *g, struct err *err)
{
	struct sqlite_record r = {0}, both = {0}, one = {0};
	int rc;

	sqlite_text(&r, "contours");
	sqlite_text(&r, "geom");
	sqlite_text(&r, "LINESTRING");
	sqlite_integer(&r, g->system);
	sqlite_integer(&r, 1);
	sqlite_integer(&r, 0);
	rc = sqlite_row(&g->file, &g->table[COLUMNS], 1, &r, err);
	if (!rc)
		rc = sqlite_table_end(&g->file, &g->table[COLUMNS], err);
	sqlite_text(&both, "contours");
	sqlite_text(&both, "geom");
	sqlite_integer(&both, 1);
	sqlite_text(&one, "contours");
	sqlite_integer(&one, 1);
	if (!rc)
		rc = sqlite_index(&g->file, &both, 1, &g->index[COLUMNS][0], err);
	return rc ? rc : sqlite_index(&g->file, &one, 1, &g->index[COLUMNS][1], err);
}

static int put_extensions(struct gpkg *g, struct err *err)
{
	struct sqlite_record r = {0}, index = {0};
	int rc;

	for (int i = 0; i < 2; i++) {
		struct sqlite_record *to = i ? &index : &r;

		sqlite_text(to, "contours");
		sqlite_text(to, "geom");
		sqlite_text(to, GPKG_INDEX_EXTENSION);
	}
	sqlite_text(&r, GPKG_INDEX_DEFINITION);
	sqlite_text(&r, "write-only");
	sqlite_integer(&index, 1);
	rc = sqlite_row(&g->file, &g->table[EXTENSIONS], 1, &r, err);
	if (!rc)
		rc = sqlite_table_end(&g->file, &g->table[EXTENSIONS], err);
	return rc ? rc : sqlite_index(&g->file, &index, 1, &g->index[EXTENSIONS][0], err);
}

static int put_schema_row(struct gpkg *g, uint64_t number, const char *type, const char *name, const char *table, uint32_t page,
			  const char *sql, struct err *err)
{
	struct sqlite_record r = {0};

	sqlite_text(&r, type);
	sqlite_text(&r, name);
	sqlite_text(&r, table);
	sqlite_integer(&r, page);
	if (sql)
		sqlite_text(&r, sql);
	else
		sqlite_null(&r);
	return sqlite_row(&g->file, &g->schema, number, &r, err);
}

static int put_schema(struct gpkg *g, struct err *err)
{
	uint64_t number = 0;
	int r = 0;

	for (int i = 0; i < TABLES && !r; i++) {
		r = put_schema_row(g, ++number, "table", tables[i].name, tables[i].name, g->table[i].root, tables[i].sql, err);
		for (unsigned k = 0; k < tables[i].indexes && !r; k++) {
			char name[80];

			snprintf(name, sizeof(name), "sqlite_autoindex_%s_%u", tables[i].name, k + 1);
			r = put_schema_row(g, ++number, "index", name, tables[i].name, g->index[i][k], NULL, err);
		}
	}
	for (int i = 0; i < 10 && !r; i++) {
		const struct gpkg_index_sql *s = i < 3 ? &gpkg_index_shadows[i] : &gpkg_index_rest[i - 3];

		r = put_schema_row(g, ++number, s->type, s->name, s->table, i < 3 ? g->box_page[i] : 0, s->sql, err);
	}
	return r ? r : sqlite_end(&g->file, &g->schema, APPLICATION, VERSION, err);
}

static int put_file(struct gpkg *g, struct err *err)
{
	int r = sqlite_reserve(&g->file, FEATURES_PAGE, err);

	for (int i = 0; i < TABLES && !r; i++)
		r = sqlite_table_new(&g->table[i], err);
	g->table[FEATURES].root = FEATURES_PAGE;
	g->schema.first = true;
	if (!r)
		r = sqlite_table_new(&g->schema, err);
	if (!r)
		r = gpkg_index_new(g->w->out, g->w->box, &g->boxes, err);
	if (!r)
		r = put_lines(g, err);
	if (!r)
		r = gpkg_index_write(g->boxes, &g->file, g->box_page, err);
	if (!r)
		r = put_systems(g, err);
	if (!r)
		r = put_contents(g, err);
	if (!r)
		r = put_columns(g, err);
	if (!r)
		r = put_extensions(g, err);
	return r ? r : put_schema(g, err);
}

static int put_all(struct format_lines *w, struct err *err)
{
	struct gpkg *g = calloc(1, sizeof(*g));
	struct outfile *spool = NULL;
	int r = g ? 0 : err_set(err, ERR_NOMEM, "no memory for a database");

	if (!r && !outfile_seekable(w->out))
		r = outfile_spool(w->out, &spool, err);
	if (!r) {
		g->w = w;
		g->file.out = spool ? spool : w->out;
		g->system = w->epsg ? (int32_t)w->epsg : w->wkt ? OWN_SYSTEM : w->degrees ? 0 : -1;
		g->box[0] = g->box[1] = INFINITY;
		g->box[2] = g->box[3] = -INFINITY;
		r = put_file(g, err);
	}
	if (!r && spool)
		r = outfile_join(w->out, spool, 0, err);
	for (int i = 0; g && i < TABLES; i++)
		sqlite_table_done(&g->table[i]);
	if (g) {
		sqlite_table_done(&g->schema);
		gpkg_index_free(g->boxes);
	}
	outfile_free(spool);
	free(g);
	return r;
}

static int gpkg_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	return format_lines_open(out, opt, "gpkg", ret, err);
}

static int gpkg_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	return format_lines_finish(writer, tail, put_all, err);
}

const struct format format_gpkg = {
	.name = "gpkg",
	.extensions = ".gpkg",
	.help = "GeoPackage: contours, with their heights (--interval)",
	.purpose = "QGIS, GIS: contours",
	.kind = FORMAT_LINES,
	.takes = FORMAT_LINES_TAKES,
	.positions = true,
	.open = gpkg_open,
	.head = format_lines_head,
	.block = format_lines_block,
	.finish = gpkg_finish,
	.free = format_lines_free,
	.simplified = format_lines_simplified,
	.save = format_lines_save,
	.resume = format_lines_resume,
};
