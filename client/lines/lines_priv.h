/* Shared by the readers: their table, the feature that is being read, bytes and lines of a file, numbers. */
#ifndef LINES_PRIV_H
#define LINES_PRIV_H

#include "lines.h"

#include "err.h"
#include "text_source.h"

enum { LINES_HEAD = 4096, LINES_LOOK = 1 << 16, LINES_WKT_MOST = 1 << 16 /* bytes of the text of a system */ };

struct lines_reader {
	const char *name, *title, *place;
	bool exact; /* vertices are decimals */
	/* Of the first bytes of a file. */
	bool (*matches)(const uint8_t *head, size_t n);
	/* l->state is NULL before; `close` is called after a failure too, also if it is still NULL. */
	int (*open)(struct lines *, struct err *);
	/* Reads the next feature between lines_begin and lines_end. *ret_more false: there is none. */
	int (*next)(struct lines *, bool *ret_more, struct err *);
	void (*close)(struct lines *);
};
extern const struct lines_reader lines_shape_reader, lines_geojson_reader, lines_gpkg_reader, lines_dxf_reader,
	lines_landxml_reader, lines_csv_reader;
void lines_free_state(struct lines *); /* `close` of a reader whose state is one piece of memory */
uint32_t lines_hash(const char *name); /* as far as the name of a layer goes */
/* The beginning of a text: lines_may_be. `whole`: there is no more of it. */
bool lines_csv_may_be(const char *text, size_t n, bool whole);

struct lines {
	char path[4096], layer_name[LINES_NAME_SIZE], kind_field[LINES_NAME_SIZE];
	bool has_layer, has_kind_field;
	int (*interrupted)(void *ctx);
	void *ctx;
	int fd;
	uint64_t size;
	const struct lines_reader *reader;
	struct lines_info info;
	struct lines_layer **layer;             /* those met so far, */
	uint32_t layer_hash[LINES_LAYERS_MOST]; /* and of their names: a drawing asks for each entity */
	size_t nlayers, layers_room;
	struct lines_feature f;
	struct lines_part *part;
	size_t parts_room;
	void *vertex;
	size_t vertices_room;
	uint64_t dropped; /* vertices of this feature beyond what is kept */
	char kind[LINES_NAME_SIZE];
	void *state;
	bool failed, ended;
};

/* ---- the feature (lines_build.c) ---- */

/* What several readers refuse. */
extern const char lines_no_z[], lines_no_name[];

void lines_begin(struct lines *, const struct lines_layer *, uint64_t number, uint64_t place);
/* Static texts. The first reason stays. */
void lines_geometry(struct lines *, const char *name);
void lines_refuse(struct lines *, const char *why);
void lines_no_line(struct lines *, const char *what); /* for a feature without any line */
void lines_kind(struct lines *, const char *text, size_t n);
/* Begins a line. */
int lines_part(struct lines *, bool ring, struct err *);
int lines_vertex_exact(struct lines *, const struct decimal[3], struct err *);
int lines_vertex_number(struct lines *, const double[3], struct err *);
/* Gives all vertices of the feature this z; makes its one line a ring. */
void lines_all_z(struct lines *, struct decimal z);
void lines_make_ring(struct lines *);
/* Closes rings, and decides on the state. */
void lines_end(struct lines *);

/* ---- layers (lines.c) ---- */

/* The layer of this name, made if it is new. */
int lines_layer(struct lines *, const char *name, struct lines_layer **ret, struct err *);
int lines_too_many_layers(struct err *err);
/* The file's own name without folder and extension. */
void lines_stem(const struct lines *, char ret[LINES_NAME_SIZE]);
/* -ERR_CANCELLED if the caller wants no more. */
int lines_interrupted(const struct lines *, struct err *err);
/* -ERR_INPUT with a place like "line 7". */
__attribute__((format(printf, 4, 5))) int lines_bad(const struct lines *, struct err *, uint64_t place, const char *fmt, ...);

/* ---- texts (lines_text.c) ---- */

void lines_source_begin(struct text_source *, const struct lines *, struct err *);
/* All of the text is a decimal number. Beyond 18 digits it is rounded so that rounding again to 17 digits or less gives
 * what rounding once gives (ROUND_05UP). */
bool lines_number(const char *text, size_t n, struct decimal *ret);
/* Texts that are not UTF-8 are taken for Latin-1. */
void lines_utf8(const char *text, size_t n, char *ret, size_t size);
/* The numbers of "urn:ogc:def:crs:EPSG::25832" and the like: of the plane, and of heights. */
void lines_crs_of_text(const char *text, struct lines_crs *);
/* The top of the text of a coordinate system (lines_wkt.c). */
void lines_crs_of_wkt(const char *wkt, struct lines_crs *);
/* A unit by its names in these formats, into `ret`; a name that is not known stays. */
void lines_unit_of(const char *name, char ret[32]);

static inline bool lines_is_blank(char c)
{
	return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == '\f' || c == '\v';
}

#endif
