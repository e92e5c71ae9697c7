/*
 * GeoPackage (OGC 12-128r18): the tables of features of an SQLite file, one layer after the other in the order of
 * gpkg_geometry_columns, rows in the order of their numbers.
 *
 * Model: the file is never written, nor is anything beside it. It is opened as immutable, unless a log or journal of a program
 * that writes to it lies beside it. A log is read with the index that the program keeps for it (-shm). Without one SQLite would
 * make one and leave it; and a transaction that was not ended would have to be undone in the file: such a file is refused. SQLite
 * is made safe for files of anybody: no views, no triggers, no functions of the schema. Numbers of rows must grow, so a damaged
 * tree of pages cannot be walked for ever; and between two rows only so many steps are done.
 */
#include "lines_wkb.h"

#include <inttypes.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "grow.h"
#include "io.h"

enum {
	BLOB_MOST = 24 << 20, /* more than the vertices of a feature take, with z and m */
	LENGTH_MOST = BLOB_MOST + (1 << 20),
	PROGRESS = 1000, /* steps of SQLite's machine */
	PROGRESS_MOST = 20000,
	WKTS_MOST = 4 << 20, /* of all layers */
};

struct gpkg_layer {
	struct lines_layer *layer;
	char *table, *column, *wkt;
	bool has_kind;
};

struct gpkg {
	struct lines *lines;
	sqlite3 *db;
	sqlite3_stmt *rows;
	struct gpkg_layer *layer;
	size_t n, room, at;
	uint64_t number;
	size_t wkt_bytes;
	int64_t last; /* number of the last row */
	unsigned steps;
};

static bool matches(const uint8_t *head, size_t n)
{
	return n >= 100 && !memcmp(head, "SQLite format 3", 16);
}

static bool has_log(const struct lines *l, const char *end)
{
	char path[sizeof l->path + 16];
	struct stat st;

	snprintf(path, sizeof path, "%s%s", l->path, end);
	return !stat(path, &st) && st.st_size > 0;
}

static int not_closed(const struct lines *l, struct err *err)
{
	const char *slash = strrchr(l->path, '/');

	err_set(err, ERR_INPUT, "it was not closed: changes that were made in it are in %.80s%s", slash ? slash + 1 : l->path,
		has_log(l, "-wal") ? "-wal" : "-journal");
	return err_add_hint(err, "open it once in the program that made them, and close it there");
}

static int failed(struct lines *l, struct gpkg *g, struct err *err)
{
	int code = g->db ? sqlite3_errcode(g->db) & 0xff : SQLITE_NOMEM;

	switch (code) {
	case SQLITE_NOMEM:
		return err_set(err, ERR_NOMEM, "no memory for SQLite");
	case SQLITE_IOERR:
	case SQLITE_CANTOPEN:
		return err_set(err, ERR_IO, "it cannot be read: %s", sqlite3_errmsg(g->db));
	case SQLITE_READONLY:
		return not_closed(l, err);
	case SQLITE_BUSY:
	case SQLITE_LOCKED:
		err_set(err, ERR_BUSY, "another program writes to it");
		return err_add_hint(err, "try again when it has ended");
	case SQLITE_INTERRUPT:
		if (lines_interrupted(l, err))
			return -(int)err->code;
		err_set(err, ERR_INPUT, "it is damaged: its rows have no end");
		break;
	default:
		err_set(err, ERR_INPUT, "it is damaged: %s", sqlite3_errmsg(g->db));
	}
	return err_add_hint(err, "copy what is readable: ogr2ogr -f GPKG lines.gpkg FILE");
}

static int no_gpkg(struct err *err)
{
	err_set(err, ERR_INPUT, "it is an SQLite file, but no GeoPackage: it has no table gpkg_geometry_columns");
	return err_add_hint(err, "convert it: ogr2ogr -f GPKG lines.gpkg FILE");
}

/* ---- opening ---- */

static int progress(void *ctx)
{
	struct gpkg *g = ctx;

	return ++g->steps > PROGRESS_MOST || (g->lines->interrupted && g->lines->interrupted(g->lines->ctx));
}

/* The head counts the pages. A cut file is known at once, not where its end is missed. */
static int check_size(struct lines *l, struct err *err)
{
	uint8_t head[100];
	uint64_t page, pages;
	int rc = io_read_at(l->fd, head, sizeof head, 0, l->path, err);

	if (rc)
		return rc;
	page = head[16] << 8 | head[17];
	page = page == 1 ? 65536 : page;
	pages = (uint64_t)head[28] << 24 | head[29] << 16 | head[30] << 8 | head[31];
	if (memcmp(head + 24, head + 92, 4) != 0 || page * pages <= l->size || has_log(l, "-wal") || has_log(l, "-journal"))
		return 0;
	err_set(err, ERR_TRUNCATED, "it has %" PRIu64 " bytes of %" PRIu64, l->size, page * pages);
	return err_add_hint(err, "copy it again");
}

/* The path as a URI. */
static void uri_of(const struct lines *l, char *ret, size_t size)
{
	const char *path = l->path;
	size_t n = (size_t)snprintf(ret, size, "file:");

	while (path[0] == '/' && path[1] == '/') /* two of them begin the name of a machine */
		path++;
	for (const char *p = path; *p && n + 4 < size; p++)
		n += (size_t)snprintf(ret + n, size - n, strchr("%?#", *p) ? "%%%02x" : "%c", (unsigned char)*p);
	snprintf(ret + n, size - n, "?mode=ro&%s",
		 has_log(l, "-wal") || has_log(l, "-journal") ? "readonly_shm=1" : "immutable=1");
}

static int open_database(struct lines *l, struct gpkg *g, struct err *err)
{
	char uri[3 * sizeof l->path + 64];
	static const struct {
		int what, on;
	} rows[] = {
		{SQLITE_DBCONFIG_DEFENSIVE, 1},      {SQLITE_DBCONFIG_ENABLE_TRIGGER, 0}, {SQLITE_DBCONFIG_ENABLE_VIEW, 0},
		{SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0}, {SQLITE_DBCONFIG_DQS_DML, 0},
	};

	if (has_log(l, "-wal") && !has_log(l, "-shm"))
		return not_closed(l, err);
	uri_of(l, uri, sizeof uri);
	if (sqlite3_open_v2(uri, &g->db, SQLITE_OPEN_READONLY | SQLITE_OPEN_URI | SQLITE_OPEN_NOMUTEX, NULL) != SQLITE_OK)
		return failed(l, g, err);
	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
		sqlite3_db_config(g->db, rows[i].what, rows[i].on, (int *)NULL);
	sqlite3_limit(g->db, SQLITE_LIMIT_LENGTH, LENGTH_MOST);
	sqlite3_limit(g->db, SQLITE_LIMIT_ATTACHED, 0);
	sqlite3_progress_handler(g->db, PROGRESS, progress, g);
	if (sqlite3_exec(g->db, "PRAGMA cell_size_check = 1", NULL, NULL, NULL) != SQLITE_OK)
		return failed(l, g, err);
	return 0;
}

/* ---- layers ---- */

static const char *text_of(sqlite3_stmt *s, int column)
{
	const char *text = (const char *)sqlite3_column_text(s, column);

	return text ? text : "";
}

/* srs_id 0 and -1 are undefined systems. */
static int read_system(struct lines *l, struct gpkg *g, struct gpkg_layer *layer, int64_t srs_id, struct err *err)
{
	struct lines_crs *crs = &layer->layer->crs;
	sqlite3_stmt *s;
	int r;

	crs->from = "gpkg_spatial_ref_sys";
	if (srs_id == 0 || srs_id == -1)
		return 0;
	if (sqlite3_prepare_v2(
		    g->db,
		    "SELECT organization, organization_coordsys_id, srs_name, definition FROM gpkg_spatial_ref_sys WHERE srs_id = ?",
		    -1, &s, NULL) != SQLITE_OK)
		return failed(l, g, err);
	sqlite3_bind_int64(s, 1, srs_id);
	r = sqlite3_step(s);
	if (r == SQLITE_ROW) {
		int64_t code = sqlite3_column_int64(s, 1);
		const char *wkt = text_of(s, 3);

		if (strlen(wkt) <= LINES_WKT_MOST && (g->wkt_bytes += strlen(wkt)) <= WKTS_MOST &&
		    strcasecmp(wkt, "undefined") != 0) {
			layer->wkt = strdup(wkt);
			crs->wkt = layer->wkt ? layer->wkt : "";
			lines_crs_of_wkt(crs->wkt, crs);
		}
		if (!strcasecmp(text_of(s, 0), "EPSG") && code > 0 && code <= 1000000)
			crs->epsg = (uint32_t)code;
		lines_utf8(text_of(s, 2), strlen(text_of(s, 2)), crs->name, sizeof crs->name);
	}
	r = r == SQLITE_ROW || r == SQLITE_DONE ? 0 : failed(l, g, err);
	sqlite3_finalize(s);
	return r;
}

static int no_table(struct lines *l, struct gpkg *g, const char *name, struct err *err)
{
	bool view = false;
	sqlite3_stmt *s;
	int r;

	if ((sqlite3_errcode(g->db) & 0xff) != SQLITE_ERROR ||
	    sqlite3_prepare_v2(g->db, "SELECT 1 FROM sqlite_schema WHERE type = 'view' AND name = ? COLLATE NOCASE", -1, &s,
			       NULL) != SQLITE_OK)
		return failed(l, g, err);
	sqlite3_bind_text(s, 1, name, -1, SQLITE_STATIC);
	r = sqlite3_step(s);
	view = r == SQLITE_ROW;
	r = view || r == SQLITE_DONE ? 0 : failed(l, g, err);
	sqlite3_finalize(s);
	if (r)
		return r;
	err_set(err, ERR_INPUT, "the layer \"%.80s\" is no table%s", name, view ? " but a view" : ": it does not exist");
	return err_add_hint(err, "copy it into a table: ogr2ogr -f GPKG lines.gpkg FILE LAYER, or choose others by --layer");
}

static int add_layer(struct lines *l, struct gpkg *g, sqlite3_stmt *s, struct err *err)
{
	struct gpkg_layer *new;
	int rc;

	if (g->n == LINES_LAYERS_MOST)
		return lines_too_many_layers(err);
	if (!grow(&g->layer, &g->room, g->n + 1, 16, sizeof(*g->layer)))
		return err_set(err, ERR_NOMEM, "no memory for layers");
	new = &g->layer[g->n++];
	*new = (struct gpkg_layer){.table = strdup(text_of(s, 0)), .column = strdup(text_of(s, 1))};
	if (!new->table || !new->column)
		return err_set(err, ERR_NOMEM, "no memory for layers");
	rc = lines_layer(l, new->table, &new->layer, err);
	if (rc || !new->layer->selected)
		return rc;
	/* SQLite has the schema in memory: it is not read once for each layer. */
	if (sqlite3_table_column_metadata(g->db, "main", new->table, NULL, NULL, NULL, NULL, NULL, NULL) != SQLITE_OK)
		return no_table(l, g, new->table, err);
	new->has_kind = l->has_kind_field &&sqlite3_table_column_metadata(g->db, "main", new->table, l->kind_field, NULL, NULL,
									  NULL, NULL, NULL) == SQLITE_OK;
	return read_system(l, g, new, sqlite3_column_int64(s, 2), err);
}

static int read_layers(struct lines *l, struct gpkg *g, struct err *err)
{
	sqlite3_stmt *s;
	int rc = 0, r = SQLITE_DONE;

	if (sqlite3_table_column_metadata(g->db, "main", "gpkg_geometry_columns", NULL, NULL, NULL, NULL, NULL, NULL) !=
	    SQLITE_OK)
		return (sqlite3_errcode(g->db) & 0xff) == SQLITE_ERROR ? no_gpkg(err) : failed(l, g, err);
	if (sqlite3_prepare_v2(g->db, "SELECT table_name, column_name, srs_id FROM gpkg_geometry_columns ORDER BY rowid", -1, &s,
			       NULL) != SQLITE_OK)
		return failed(l, g, err);
	while (!rc && (r = sqlite3_step(s)) == SQLITE_ROW) {
		rc = add_layer(l, g, s, err);
		g->steps = 0;
	}
	if (!rc && r != SQLITE_DONE)
		rc = failed(l, g, err);
	sqlite3_finalize(s);
	return rc;
}

static int check_kind(struct lines *l, struct gpkg *g, struct err *err)
{
	bool any = !l->has_kind_field;

	for (size_t i = 0; i < g->n; i++)
		any |= g->layer[i].has_kind;
	if (any)
		return 0;
	err_set(err, ERR_INPUT, "no layer has a field \"%s\"", l->kind_field);
	return err_add_hint(err, "ogrinfo -so FILE LAYER lists the fields of a layer");
}

static int open_gpkg(struct lines *l, struct err *err)
{
	struct gpkg *g = l->state = calloc(1, sizeof *g);
	int rc;

	if (!g)
		return err_set(err, ERR_NOMEM, "no memory to read lines");
	g->lines = l;
	rc = check_size(l, err);
	if (!rc)
		rc = open_database(l, g, err);
	if (!rc)
		rc = read_layers(l, g, err);
	return rc ? rc : check_kind(l, g, err);
}

/* ---- rows ---- */

/* The rows of the next layer that is wanted; g->rows NULL: there is none. */
static int begin_layer(struct lines *l, struct gpkg *g, struct err *err)
{
	char *sql;
	int r;

	while (g->at < g->n && !g->layer[g->at].layer->selected)
		g->at++;
	if (g->at == g->n)
		return 0;
	sql = sqlite3_mprintf(
		"SELECT rowid, CASE WHEN length(\"%w\") <= %d THEN \"%w\" END, length(\"%w\")%s%w%s FROM main.\"%w\" ORDER BY rowid",
		g->layer[g->at].column, BLOB_MOST, g->layer[g->at].column, g->layer[g->at].column,
		g->layer[g->at].has_kind ? ", \"" : "", g->layer[g->at].has_kind ? l->kind_field : "",
		g->layer[g->at].has_kind ? "\"" : "", g->layer[g->at].table);
	if (!sql)
		return err_set(err, ERR_NOMEM, "no memory for SQLite");
	r = sqlite3_prepare_v2(g->db, sql, -1, &g->rows, NULL);
	sqlite3_free(sql);
	g->number = 0;
	g->last = INT64_MIN;
	return r == SQLITE_OK ? 0 : failed(l, g, err);
}

static int read_blob(struct lines *l, const uint8_t *blob, size_t n, struct err *err)
{
	static const uint8_t envelope[8] = {0, 32, 48, 48, 64};
	size_t head;

	if (n < 8 || blob[0] != 'G' || blob[1] != 'P')
		return lines_bad(l, err, l->f.place, "its geometry is none of a GeoPackage");
	head = 8 + (size_t)envelope[blob[3] >> 1 & 7];
	if ((blob[3] >> 1 & 7) > 4 || head > n)
		return lines_bad(l, err, l->f.place, "the head of its geometry is damaged");
	if (blob[3] & 0x20) {
		lines_refuse(l, "it is an extended geometry");
		return 0;
	}
	/* With the flag for empty a point has NaN coordinates, a line no vertices. */
	return lines_wkb(l, blob + head, n - head, err);
}

static int read_row(struct lines *l, struct gpkg *g, struct err *err)
{
	int64_t id = sqlite3_column_int64(g->rows, 0);
	const uint8_t *blob;
	int rc = 0;

	if (g->number && id <= g->last) {
		err_set(err, ERR_INPUT, "it is damaged: row %" PRId64 " follows row %" PRId64, id, g->last);
		return err_add_hint(err, "copy what is readable: ogr2ogr -f GPKG lines.gpkg FILE");
	}
	g->last = id;
	g->steps = 0;
	lines_begin(l, g->layer[g->at].layer, ++g->number, (uint64_t)id);
	if (g->layer[g->at].has_kind && sqlite3_column_type(g->rows, 3) != SQLITE_NULL) {
		const char *kind = text_of(g->rows, 3);

		lines_kind(l, kind, strlen(kind));
	}
	blob = sqlite3_column_blob(g->rows, 1);
	if (blob)
		rc = read_blob(l, blob, (size_t)sqlite3_column_bytes(g->rows, 1), err);
	else if (sqlite3_column_int64(g->rows, 2) > BLOB_MOST)
		lines_refuse(l, "it has more than 524288 vertices");
	if (!rc)
		lines_end(l);
	return rc;
}

static int next_gpkg(struct lines *l, bool *ret_more, struct err *err)
{
	struct gpkg *g = l->state;
	int r, rc;

	for (;;) {
		if (!g->rows) {
			g->steps = 0;
			rc = begin_layer(l, g, err);
			if (rc || !g->rows)
				return rc;
		}
		r = sqlite3_step(g->rows);
		*ret_more = r == SQLITE_ROW;
		if (r == SQLITE_ROW)
			return read_row(l, g, err);
		if (r != SQLITE_DONE)
			return failed(l, g, err);
		sqlite3_finalize(g->rows);
		g->rows = NULL;
		g->at++;
	}
}

static void close_gpkg(struct lines *l)
{
	struct gpkg *g = l->state;

	if (!g)
		return;
	for (size_t i = 0; i < g->n; i++) {
		free(g->layer[i].table);
		free(g->layer[i].column);
		free(g->layer[i].wkt);
	}
	free(g->layer);
	sqlite3_finalize(g->rows);
	sqlite3_close(g->db);
	free(g);
}

const struct lines_reader lines_gpkg_reader = {
	.name = "gpkg",
	.title = "GeoPackage",
	.place = "row",
	.matches = matches,
	.open = open_gpkg,
	.next = next_gpkg,
	.close = close_gpkg,
};
