/*
 * Shapefiles (ESRI Shapefile Technical Description, July 1998): PolyLineZ and PolygonZ; those with M or without z are refused
 * feature by feature, points are left out.
 *
 * Model: records are found by the .shx, if there is one: an editor that lengthens a shape leaves the old one in the .shp. Without
 * it they are read one behind the other. A record is read in pieces: parts, then x and y, then z, each by its own place.
 *
 * libshp is not used: it keeps offset and size of all records in memory (a file of 4 GB has up to 35 million of them), five
 * copies of a record's vertices, needs the .shx, and does not say where in the file something is wrong.
 */
#include "lines_dbf.h"

#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io.h"

enum {
	HEAD = 100,
	RECORD_HEAD = 8,
	POLY_HEAD = 44, /* type, box, number of parts, number of points */
	PIECE = 512,    /* vertices at a time */
};

struct shape {
	struct lines_layer *layer;
	int shx;
	struct lines_dbf dbf;
	uint64_t at, record, records; /* of the next record; without .shx `records` is not known */
	uint64_t used;                /* bytes of records so far: they do not lie over each other */
	char *wkt;
};

static uint32_t be32(const uint8_t *p)
{
	return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

static uint32_t le32(const uint8_t *p)
{
	return (uint32_t)p[3] << 24 | (uint32_t)p[2] << 16 | (uint32_t)p[1] << 8 | p[0];
}

static double le_double(const uint8_t *p)
{
	uint64_t bits = (uint64_t)le32(p + 4) << 32 | le32(p);
	double v;

	memcpy(&v, &bits, sizeof v);
	return v;
}

static bool matches(const uint8_t *head, size_t n)
{
	return n >= 32 && be32(head) == 9994 && le32(head + 28) == 1000;
}

/* ---- the files beside it ---- */

/* -1: there is none. */
static int beside(const struct lines *l, const char *lower, const char *upper)
{
	const char *slash = strrchr(l->path, '/'), *dot = strrchr(slash ? slash : l->path, '.');
	int stem = (int)(dot ? (size_t)(dot - l->path) : strlen(l->path));
	const char *const ends[] = {lower, upper};

	for (int i = 0; i < 2; i++) {
		char path[sizeof l->path + 8];
		struct err err = ERR_INIT;
		struct stat st;
		int fd = -1;

		snprintf(path, sizeof path, "%.*s.%s", stem, l->path, ends[i]);
		if (io_open(AT_FDCWD, path, O_RDONLY | O_NONBLOCK | O_NOCTTY, 0, &fd, &err))
			continue;
		if (!io->fstat(fd, &st) && S_ISREG(st.st_mode))
			return fd;
		io_close(fd);
	}
	return -1;
}

static int read_projection(struct lines *l, struct shape *s, struct err *err)
{
	int fd = beside(l, "prj", "PRJ"), rc;
	size_t n = 0;

	if (fd < 0)
		return 0;
	s->wkt = calloc(1, LINES_WKT_MOST + 1);
	rc = s->wkt ? io_read_some(fd, s->wkt, LINES_WKT_MOST, 0, l->path, &n, err) :
		      err_set(err, ERR_NOMEM, "no memory for a .prj");
	io_close(fd);
	if (rc)
		return rc;
	while (n && (lines_is_blank(s->wkt[n - 1]) || !s->wkt[n - 1]))
		s->wkt[--n] = 0;
	s->layer->crs.wkt = s->wkt;
	s->layer->crs.from = n ? ".prj" : "";
	lines_crs_of_wkt(s->wkt, &s->layer->crs);
	return 0;
}

static int open_index(struct lines *l, struct shape *s, struct err *err)
{
	struct stat st;
	uint8_t head[HEAD];
	int rc;

	s->shx = beside(l, "shx", "SHX");
	if (s->shx < 0)
		return 0;
	rc = io->fstat(s->shx, &st) ? -ERR_IO : io_read_at(s->shx, head, HEAD, 0, l->path, err);
	if (rc || !matches(head, HEAD)) {
		err_clear(err);
		err_set(err, ERR_INPUT, "its index (.shx) is damaged");
		return err_add_hint(err, "move the .shx away: the shapes are then read in the order of the .shp");
	}
	s->records = ((uint64_t)st.st_size - HEAD) / RECORD_HEAD;
	return 0;
}

static int open_shape(struct lines *l, struct err *err)
{
	static const char *const names[32] = {
		[1] = "Point",      [3] = "PolyLine",     [5] = "Polygon",      [8] = "MultiPoint", [11] = "PointZ",
		[13] = "PolyLineZ", [15] = "PolygonZ",    [18] = "MultiPointZ", [21] = "PointM",    [23] = "PolyLineM",
		[25] = "PolygonM",  [28] = "MultiPointM", [31] = "MultiPatch",
	};
	struct shape *s = l->state = calloc(1, sizeof *s);
	char stem[LINES_NAME_SIZE];
	uint8_t head[HEAD];
	uint32_t type;
	int rc;

	if (!s)
		return err_set(err, ERR_NOMEM, "no memory to read lines");
	s->shx = s->dbf.fd = -1;
	s->at = HEAD;
	rc = io_read_at(l->fd, head, HEAD, 0, l->path, err);
	if (rc)
		return rc;
	type = le32(head + 32);
	snprintf(l->info.variant, sizeof l->info.variant, "%s", type < 32 && names[type] ? names[type] : "");
	lines_stem(l, stem);
	rc = lines_layer(l, stem, &s->layer, err);
	if (!rc)
		rc = read_projection(l, s, err);
	if (!rc)
		rc = open_index(l, s, err);
	return rc ? rc : lines_dbf_open(l, beside(l, "dbf", "DBF"), &s->dbf, err);
}

/* ---- records ---- */

static int read_parts(struct lines *l, uint64_t at, uint32_t parts, uint32_t points, uint32_t first[], struct err *err)
{
	uint8_t piece[4 * PIECE];
	int rc;

	for (uint32_t i = 0; i < parts; i++) {
		if (i % PIECE == 0) {
			rc = io_read_at(l->fd, piece, 4 * (size_t)(parts - i < PIECE ? parts - i : PIECE), at + 4 * (uint64_t)i,
					l->path, err);
			if (rc)
				return rc;
		}
		first[i] = le32(piece + 4 * (i % PIECE));
		if (i ? first[i] < first[i - 1] || first[i] > points : first[i])
			return lines_bad(l, err, at, "part %" PRIu32 " begins at vertex %" PRIu32 " of %" PRIu32, i + 1, first[i],
					 points);
	}
	return 0;
}

static int read_vertices(struct lines *l, uint64_t xy, uint64_t z, bool ring, const uint32_t first[], uint32_t parts,
			 uint32_t points, struct err *err)
{
	uint8_t a[16 * PIECE], b[8 * PIECE];
	uint32_t part = 0;
	int rc = 0;

	for (uint32_t i = 0; i < points && !rc; i++) {
		double v[3];

		if (i % PIECE == 0) {
			size_t n = points - i < PIECE ? points - i : PIECE;

			rc = io_read_at(l->fd, a, 16 * n, xy + 16 * (uint64_t)i, l->path, err);
			if (!rc)
				rc = io_read_at(l->fd, b, 8 * n, z + 8 * (uint64_t)i, l->path, err);
		}
		for (; part < parts && first[part] == i && !rc; part++)
			rc = lines_part(l, ring, err);
		if (rc)
			return rc;
		v[0] = le_double(a + 16 * (i % PIECE));
		v[1] = le_double(a + 16 * (i % PIECE) + 8);
		v[2] = le_double(b + 8 * (i % PIECE));
		rc = lines_vertex_number(l, v, err);
	}
	return rc;
}

/* A PolyLineZ or PolygonZ: `at` is its content of `size` bytes. */
static int read_poly(struct lines *l, uint64_t at, uint64_t size, bool ring, struct err *err)
{
	uint8_t head[POLY_HEAD];
	uint32_t parts, points, *first;
	uint64_t xy, z;
	int rc;

	if (size < POLY_HEAD)
		return lines_bad(l, err, at, "a shape of %" PRIu64 " bytes is too short", size);
	rc = io_read_at(l->fd, head, sizeof head, at, l->path, err);
	if (rc)
		return rc;
	parts = le32(head + 36);
	points = le32(head + 40);
	xy = POLY_HEAD + 4 * (uint64_t)parts;
	z = xy + 16 * (uint64_t)points + 16;
	if (z + 8 * (uint64_t)points > size)
		return lines_bad(l, err, at,
				 "a shape of %" PRIu32 " parts and %" PRIu32 " vertices does not fit into its %" PRIu64 " bytes",
				 parts, points, size);
	if (points && !parts)
		return lines_bad(l, err, at, "a shape of %" PRIu32 " vertices has no part", points);
	if (points > LINES_VERTICES_MOST)
		lines_refuse(l, "it has more than 524288 vertices");
	if (parts > LINES_PARTS_MOST)
		lines_refuse(l, "it has more than 65536 lines or rings");
	if (!points || l->f.state == LINES_REFUSED)
		return 0;
	first = malloc(parts * sizeof *first);
	if (!first)
		return err_set(err, ERR_NOMEM, "no memory for a feature");
	rc = read_parts(l, at + POLY_HEAD, parts, points, first, err);
	if (!rc)
		rc = read_vertices(l, at + xy, at + z, ring, first, parts, points, err);
	free(first);
	return rc;
}

static int read_content(struct lines *l, uint64_t at, uint64_t size, struct err *err)
{
	uint8_t type[4];
	int rc = size < 4 ? lines_bad(l, err, at, "a shape has no type") : io_read_at(l->fd, type, 4, at, l->path, err);

	if (rc)
		return rc;
	switch (le32(type)) {
	case 0:
		return 0;
	case 1:
	case 8:
	case 11:
	case 18:
	case 21:
	case 28:
		lines_no_line(l, "points");
		return 0;
	case 3:
	case 5:
		lines_geometry(l, le32(type) == 3 ? "PolyLine" : "Polygon");
		lines_refuse(l, lines_no_z);
		return 0;
	case 23:
	case 25:
		lines_geometry(l, le32(type) == 23 ? "PolyLineM" : "PolygonM");
		lines_refuse(l, lines_no_z);
		return 0;
	case 13:
		lines_geometry(l, "PolyLineZ");
		return read_poly(l, at, size, false, err);
	case 15:
		lines_geometry(l, "PolygonZ");
		return read_poly(l, at, size, true, err);
	case 31:
		lines_geometry(l, "MultiPatch");
		lines_refuse(l, "it is a surface in space (MultiPatch)");
		return 0;
	default:
		return lines_bad(l, err, at, "a shape has the type %" PRIu32 ", which does not exist", le32(type));
	}
}

/* Where the next record lies; *ret_more false: there is none. */
static int find_record(struct lines *l, struct shape *s, uint64_t *ret_at, bool *ret_more, struct err *err)
{
	uint8_t entry[RECORD_HEAD];
	int rc;

	*ret_more = s->shx < 0 ? s->at < l->size : s->record < s->records;
	if (!*ret_more)
		return 0;
	if (s->shx < 0) {
		*ret_at = s->at;
		return 0;
	}
	rc = io_read_at(s->shx, entry, sizeof entry, HEAD + s->record * RECORD_HEAD, l->path, err);
	*ret_at = rc ? 0 : 2 * (uint64_t)be32(entry);
	return rc;
}

static int next_shape(struct lines *l, bool *ret_more, struct err *err)
{
	struct shape *s = l->state;
	uint8_t head[RECORD_HEAD];
	bool deleted = true;
	uint64_t at, size;
	int rc;

	while (deleted) {
		rc = find_record(l, s, &at, ret_more, err);
		if (rc || !*ret_more)
			return rc;
		if (at < HEAD || at + RECORD_HEAD > l->size)
			return lines_bad(l, err, at, "there is no room for the shape of record %" PRIu64, s->record + 1);
		rc = io_read_at(l->fd, head, sizeof head, at, l->path, err);
		if (rc)
			return rc;
		size = 2 * (uint64_t)be32(head + 4);
		s->at = at + RECORD_HEAD + size;
		s->used += RECORD_HEAD + size;
		if (size > l->size || s->at > l->size)
			return lines_bad(l, err, at, "the shape of record %" PRIu64 " ends beyond the end of the file",
					 s->record + 1);
		if (s->used > l->size)
			return lines_bad(l, err, at, "shapes lie over each other");
		lines_begin(l, s->layer, s->record + 1, at);
		rc = lines_dbf_row(l, &s->dbf, s->record++, &deleted, err);
		if (rc)
			return rc;
	}
	rc = read_content(l, at + RECORD_HEAD, size, err);
	if (!rc)
		lines_end(l);
	return rc;
}

static void close_shape(struct lines *l)
{
	struct shape *s = l->state;

	if (!s)
		return;
	io_close(s->shx);
	io_close(s->dbf.fd);
	free(s->wkt);
	free(s);
}

const struct lines_reader lines_shape_reader = {
	.name = "shapefile",
	.title = "Shapefile",
	.place = "byte",
	.matches = matches,
	.open = open_shape,
	.next = next_shape,
	.close = close_shape,
};
