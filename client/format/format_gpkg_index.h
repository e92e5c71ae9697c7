/*
 * The spatial index of a GeoPackage: the tables of an R*Tree of SQLite (https://www.sqlite.org/rtree.html), filled from the boxes
 * of all rows in the order of a Z over the plane. Memory does not grow with the rows.
 */
#ifndef FORMAT_GPKG_INDEX_H
#define FORMAT_GPKG_INDEX_H

#include "format_sqlite.h"

struct gpkg_index;
/* `box`: least x y, greatest x y of all, more or less: a wrong one makes a slower index. */
int gpkg_index_new(const struct outfile *beside, const double box[4], struct gpkg_index **ret, struct err *err);
int gpkg_index_add(struct gpkg_index *, uint64_t row, const double box[4], struct err *err);
/* *ret: the pages of its tables _node, _parent, _rowid. */
int gpkg_index_write(struct gpkg_index *, struct sqlite_file *, uint32_t ret[3], struct err *err);
struct gpkg_index *gpkg_index_free(struct gpkg_index *);

/* The rows of the schema beside those of the tables: the virtual table, which has no page, and the triggers that keep it true. */
struct gpkg_index_sql {
	const char *type, *name, *table, *sql;
};
extern const struct gpkg_index_sql gpkg_index_shadows[3], gpkg_index_rest[7];
#define GPKG_INDEX_EXTENSION "gpkg_rtree_index"
#define GPKG_INDEX_DEFINITION "http://www.geopackage.org/spec120/#extension_rtree"

#endif
