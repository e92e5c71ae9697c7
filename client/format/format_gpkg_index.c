/*
 * Nodes are filled one behind the other: 51 boxes in a leaf, 51 leaves in the node above. The number of rows tells how many nodes
 * there are and so their numbers: the root is 1, the leaves come last. Each level goes to a nameless file as it is filled, since
 * the table wants the root first.
 */
#include "format_gpkg_index.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "outfile.h"
#include "sort.h"

#define SORT_MEMORY (1ull << 20)
enum { CELLS = 51, CELL = 24, NODE = 4 + CELLS * CELL, LEVELS = 12, BOX_WORDS = 4, ROW_WORDS = 2, Z_BITS = 16 };

struct node {
	uint8_t bytes[NODE];
	unsigned n;
	float box[4]; /* least x, greatest x, least y, greatest y */
};
struct level {
	struct node node; /* that is being filled */
	struct outfile *spool;
	uint64_t count, done, first; /* nodes, those that are filled, the number of the first */
};

struct gpkg_index {
	const struct outfile *beside;
	double low[2], unit[2];
	uint64_t rows;
	struct sort *boxes, *places; /* by Z; rows and their leaves, by row */
	struct level level[LEVELS];
	unsigned levels;
};

#define VALUES "VALUES (NEW.fid, ST_MinX(NEW.geom), ST_MaxX(NEW.geom), ST_MinY(NEW.geom), ST_MaxY(NEW.geom)); END"
#define INSERT "INSERT OR REPLACE INTO rtree_contours_geom " VALUES
#define DELETE "DELETE FROM rtree_contours_geom WHERE id = OLD.fid; "
#define THERE "(NEW.geom NOTNULL AND NOT ST_IsEmpty(NEW.geom)) BEGIN "
#define GONE "(NEW.geom ISNULL OR ST_IsEmpty(NEW.geom)) BEGIN "
#define TRIGGER(what, when)                                                                                         \
	{                                                                                                           \
		"trigger", "rtree_contours_geom_" what, "contours", "CREATE TRIGGER rtree_contours_geom_" what when \
	}
#define SHADOW(what, columns)                                                        \
	{                                                                            \
		"table", "rtree_contours_geom_" what, "rtree_contours_geom_" what,   \
			"CREATE TABLE \"rtree_contours_geom_" what "\"(" columns ")" \
	}
const struct gpkg_index_sql gpkg_index_shadows[3] = {
	SHADOW("node", "nodeno INTEGER PRIMARY KEY,data"),
	SHADOW("parent", "nodeno INTEGER PRIMARY KEY,parentnode"),
	SHADOW("rowid", "rowid INTEGER PRIMARY KEY,nodeno"),
};
const struct gpkg_index_sql gpkg_index_rest[7] = {
	{"table", "rtree_contours_geom", "rtree_contours_geom",
	 "CREATE VIRTUAL TABLE rtree_contours_geom USING rtree(id, minx, maxx, miny, maxy)"},
	TRIGGER("insert", " AFTER INSERT ON contours WHEN " THERE INSERT),
	TRIGGER("update1", " AFTER UPDATE OF geom ON contours WHEN OLD.fid = NEW.fid AND " THERE INSERT),
	TRIGGER("update2", " AFTER UPDATE OF geom ON contours WHEN OLD.fid = NEW.fid AND " GONE DELETE "END"),
	TRIGGER("update3", " AFTER UPDATE ON contours WHEN OLD.fid != NEW.fid AND " THERE DELETE INSERT),
	TRIGGER("update4", " AFTER UPDATE ON contours WHEN OLD.fid != NEW.fid AND " GONE
			   "DELETE FROM rtree_contours_geom WHERE id IN (OLD.fid, NEW.fid); END"),
	TRIGGER("delete", " AFTER DELETE ON contours WHEN OLD.geom NOT NULL BEGIN " DELETE "END"),
};

int gpkg_index_new(const struct outfile *beside, const double box[4], struct gpkg_index **ret, struct err *err)
{
	struct gpkg_index *t = calloc(1, sizeof(*t));
	int r = t ? sort_new(BOX_WORDS, 2, SORT_MEMORY, beside, &t->boxes, err) :
		    err_set(err, ERR_NOMEM, "no memory for a spatial index");

	if (!r)
		r = sort_new(ROW_WORDS, 1, SORT_MEMORY, beside, &t->places, err);
	if (r) {
		gpkg_index_free(t);
		return r;
	}
	t->beside = beside;
	for (int i = 0; i < 2; i++) {
		t->low[i] = box[i];
		t->unit[i] = box[i + 2] > box[i] ? (1 << Z_BITS) / (box[i + 2] - box[i]) : 0;
	}
	*ret = t;
	return 0;
}

struct gpkg_index *gpkg_index_free(struct gpkg_index *t)
{
	if (t) {
		sort_free(t->boxes);
		sort_free(t->places);
	}
	for (unsigned i = 0; t && i < LEVELS; i++)
		outfile_free(t->level[i].spool);
	free(t);
	return NULL;
}

/* ---- boxes ---- */

static float rounded(double v, double towards)
{
	float f = (float)v;

	return (towards < 0 && (double)f > v) || (towards > 0 && (double)f < v) ? nextafterf(f, (float)towards) : f;
}

static uint64_t z_of(const struct gpkg_index *t, const double box[4])
{
	uint64_t z = 0;

	for (int i = 0; i < 2; i++) {
		double at = ((box[i] + box[i + 2]) / 2 - t->low[i]) * t->unit[i];
		uint32_t n = at <= 0 ? 0 : at >= (1 << Z_BITS) - 1 ? (1 << Z_BITS) - 1 : (uint32_t)at;

		for (int bit = 0; bit < Z_BITS; bit++)
			z |= (uint64_t)(n >> bit & 1) << (2 * bit + i);
	}
	return z;
}

static uint64_t pack(float a, float b)
{
	uint32_t bits[2];

	memcpy(&bits[0], &a, sizeof(a));
	memcpy(&bits[1], &b, sizeof(b));
	return (uint64_t)bits[0] << 32 | bits[1];
}

int gpkg_index_add(struct gpkg_index *t, uint64_t row, const double box[4], struct err *err)
{
	const uint64_t rec[BOX_WORDS] = {z_of(t, box), row, pack(rounded(box[0], -INFINITY), rounded(box[2], INFINITY)),
					 pack(rounded(box[1], -INFINITY), rounded(box[3], INFINITY))};

	t->rows++;
	return sort_add(t->boxes, rec, err);
}

/* ---- nodes ---- */

static void put_bytes(uint8_t *at, uint64_t v, unsigned n)
{
	while (n--) {
		at[n] = (uint8_t)v;
		v >>= 8;
	}
}

static int add(struct gpkg_index *t, unsigned level, uint64_t number, const float box[4], struct err *err);

static int node_end(struct gpkg_index *t, unsigned level, struct err *err)
{
	struct level *l = &t->level[level];
	const float box[4] = {l->node.box[0], l->node.box[1], l->node.box[2], l->node.box[3]};
	int r;

	put_bytes(l->node.bytes, level + 1 == t->levels ? level : 0, 2); /* the root has the depth of the tree */
	put_bytes(l->node.bytes + 2, l->node.n, 2);
	r = outfile_write(l->spool, l->node.bytes, NODE, err);
	l->node = (struct node){.n = 0};
	l->done++;
	return r || level + 1 == t->levels ? r : add(t, level + 1, l->first + l->done - 1, box, err);
}

static int add(struct gpkg_index *t, unsigned level, uint64_t number, const float box[4], struct err *err)
{
	struct node *n = &t->level[level].node;
	uint8_t *at = n->bytes + 4 + (size_t)n->n * CELL;

	put_bytes(at, number, 8);
	for (int i = 0; i < 4; i++) {
		bool low = i % 2 == 0;
		uint32_t bits;

		memcpy(&bits, &box[i], sizeof(bits));
		put_bytes(at + 8 + 4 * i, bits, 4);
		if (!n->n || (low ? box[i] < n->box[i] : box[i] > n->box[i]))
			n->box[i] = box[i];
	}
	return ++n->n == CELLS ? node_end(t, level, err) : 0;
}

static void number_nodes(struct gpkg_index *t)
{
	uint64_t n = t->rows ? (t->rows + CELLS - 1) / CELLS : 1, next = 1;

	for (;; n = (n + CELLS - 1) / CELLS) {
		t->level[t->levels++].count = n;
		if (n == 1)
			break;
	}
	for (unsigned i = t->levels; i--; next += t->level[i].count)
		t->level[i].first = next;
}

static int make_nodes(struct gpkg_index *t, struct err *err)
{
	const uint64_t *rec;
	int r = sort_start(t->boxes, err);

	number_nodes(t);
	for (unsigned i = 0; i < t->levels && !r; i++)
		r = outfile_spool(t->beside, &t->level[i].spool, err);
	while (!r && !(r = sort_next(t->boxes, &rec, err)) && rec) {
		const uint32_t bits[4] = {(uint32_t)(rec[2] >> 32), (uint32_t)rec[2], (uint32_t)(rec[3] >> 32), (uint32_t)rec[3]};
		const uint64_t place[ROW_WORDS] = {rec[1], t->level[0].first + t->level[0].done};
		float box[4];

		memcpy(box, bits, sizeof(box));
		r = sort_add(t->places, place, err);
		if (!r)
			r = add(t, 0, rec[1], box, err);
	}
	for (unsigned i = 0; i < t->levels && !r; i++)
		if (t->level[i].node.n || !t->rows)
			r = node_end(t, i, err);
	return r;
}

/* ---- tables ---- */

static int put_nodes(struct gpkg_index *t, struct sqlite_file *f, struct sqlite_table *to, struct err *err)
{
	int r = 0;

	for (unsigned k = t->levels; k--;) {
		for (uint64_t i = 0; i < t->level[k].count && !r; i++) {
			struct sqlite_record rec = {0};
			uint8_t bytes[NODE];

			sqlite_null(&rec);
			sqlite_blob(&rec, NODE);
			r = outfile_read(t->level[k].spool, i * NODE, bytes, NODE, err);
			if (!r)
				r = sqlite_row(f, to, t->level[k].first + i, &rec, err);
			if (!r)
				r = sqlite_bytes(f, bytes, NODE, err);
		}
	}
	return r ? r : sqlite_table_end(f, to, err);
}

static int put_number(struct sqlite_file *f, struct sqlite_table *to, uint64_t row, uint64_t value, struct err *err)
{
	struct sqlite_record rec = {0};

	sqlite_null(&rec);
	sqlite_integer(&rec, (int64_t)value);
	return sqlite_row(f, to, row, &rec, err);
}

static int put_parents(struct gpkg_index *t, struct sqlite_file *f, struct sqlite_table *to, struct err *err)
{
	int r = 0;

	for (unsigned k = t->levels - 1; k--;)
		for (uint64_t i = 0; i < t->level[k].count && !r; i++)
			r = put_number(f, to, t->level[k].first + i, t->level[k + 1].first + i / CELLS, err);
	return r ? r : sqlite_table_end(f, to, err);
}

static int put_places(struct gpkg_index *t, struct sqlite_file *f, struct sqlite_table *to, struct err *err)
{
	const uint64_t *rec;
	int r = sort_start(t->places, err);

	while (!r && !(r = sort_next(t->places, &rec, err)) && rec)
		r = put_number(f, to, rec[0], rec[1], err);
	return r ? r : sqlite_table_end(f, to, err);
}

int gpkg_index_write(struct gpkg_index *t, struct sqlite_file *f, uint32_t ret[3], struct err *err)
{
	static int (*const put[3])(struct gpkg_index *, struct sqlite_file *, struct sqlite_table *,
				   struct err *) = {put_nodes, put_parents, put_places};
	int r = make_nodes(t, err);

	for (int i = 0; i < 3 && !r; i++) {
		struct sqlite_table table = {0};

		r = sqlite_table_new(&table, err);
		if (!r)
			r = put[i](t, f, &table, err);
		ret[i] = table.root;
		sqlite_table_done(&table);
	}
	return r;
}
