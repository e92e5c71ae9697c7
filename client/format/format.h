/*
 * Formats of outputs: one row a format, and what a writer gets.
 */
#ifndef FORMAT_H
#define FORMAT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "acut.h"
#include "decimal.h"

struct cursor;
struct dem_tiler;
struct err;
struct outfile;
struct packer;

enum format_kind {
	FORMAT_MESH,    /* vertices and triangles */
	FORMAT_PICTURE, /* drawn from triangles in any order: vertices need no numbers */
	FORMAT_RASTER,  /* measured from triangles in any order: of a whole mesh or window, not of changes; makes tiles by itself
			 */
	FORMAT_LINES,   /* likewise, lines */
	FORMAT_NOTHING, /* writes nothing: opened without an output */
};

/* The options that a format can use. */
enum {
	FORMAT_CANONICAL = 1,
	FORMAT_ORIGIN = 2,
	FORMAT_Z_UNIT = 4,
	FORMAT_SIZED = 8, /* --width */
	FORMAT_COLORED = 16,
	FORMAT_POLYFACE = 32,
	FORMAT_CELL = 64,      /* --cell, which such a format needs */
	FORMAT_RASTERED = 128, /* --raster */
	FORMAT_INTERVAL = 256, /* --interval, which such a format needs */
	FORMAT_BASE = 512,
	FORMAT_INDEX = 1024,
	FORMAT_SIMPLIFY = 2048,
};

enum format_color { FORMAT_HILLSHADE, FORMAT_ELEVATION, FORMAT_DOMAIN };
enum format_rasters { FORMAT_HEIGHTS, FORMAT_SLOPES, FORMAT_SHADES };

struct format_options {
	bool canonical;  /* vertices by (x, y), triangles by their numbers */
	bool no_clobber; /* an output that exists is an error */
	bool origin_auto, has_origin;
	struct decimal origin[3]; /* subtracted from the coordinates, exactly; of z after its conversion */
	const char *z_unit;       /* name of a length ("metre", ...) that heights are converted to; NULL: as they are */
	uint32_t width;           /* pictures: pixels; 0 = FORMAT_WIDTH */
	enum format_color color;
	bool lines;            /* pictures: pieces of lines are drawn over it */
	struct decimal cell;   /* rasters: side of a pixel; zero: not given */
	const char *cell_unit; /* name of its unit; NULL: that of the file */
	enum format_rasters raster;
	/* Contours: of the levels base + i * interval every `index`th is marked (0: none). Without a unit lengths are in that of
	 * the heights as they are written. */
	struct decimal interval, base; /* zero: not given */
	const char *interval_unit, *base_unit;
	/* Contours: the most that a vertex which is left out is off, in the unit of x and y if it has none; zero: not given. */
	struct decimal simplify;
	const char *simplify_unit;
	bool has_base, has_index;
	uint32_t index;
	int (*interrupted)(void *ctx); /* not 0: give up; of rasters and lines, while the file is made; may be NULL */
	void *ctx;
	unsigned rasters; /* outputs that share the memory of rasters; 0: one */
	/* Why the file is a part of the mesh: "max-edge=2.5", "tile=100"; NULL: it is not, but for the window of its view. */
	const char *trimmed;
	bool sidecar; /* a JSON file beside the output says what it is */
	bool has_raster;
	bool polyface; /* DXF: polyface meshes in place of single faces */
	bool tiled;    /* rasters: `tiles` will come */
};

/* Lines in tiles: squares of p / q lattice units. `begin` opens the file of one, `end` gets it back, complete; after a failure it
 * is freed. */
struct format_tiler {
	uint64_t p, q;
	unsigned most;
	int (*begin)(void *ctx, const int64_t at[2], struct outfile **ret, struct err *err);
	int (*end)(void *ctx, const int64_t at[2], struct outfile *, const double box[4], uint64_t lines, struct err *err);
	void *ctx;
};

#define FORMAT_INDEX_EACH 5
#define FORMAT_WIDTH 1600
#define FORMAT_WIDTH_MAX 32768

/* A block as writers see it: `mesh` as it came (triangles left out are gone), and, for formats that ask for them, the positions
 * of all its local vertices, foreign ones first. */
struct format_block {
	const struct acut_mesh_block *mesh;
	const int32_t (*position)[3];
};

/* Vertices of all lines, and those of them that --simplify left out. */
struct format_simplified {
	uint64_t vertices, left_out;
};

/* Triangles of a part of a mesh whose vertices have their numbers. */
struct format_piece {
	const int32_t (*position)[3];
	const uint64_t *number; /* of the first `nnumber` vertices; that of others is their place and `shift` (modulo 2^64) */
	uint64_t shift;
	uint32_t nnumber;
	const uint32_t (*triangle)[3];
	const uint8_t *flags; /* as in struct acut_mesh_block */
};

/* Of a format whose records have a size: several processes write one file, each some of its bytes. The file is a front, all
 * vertices, all triangles. After `open` comes `front` in place of head and finish, then any number of the others. */
struct format_fixed {
	size_t vertex; /* bytes of one; 0: the format has none */
	/* The bytes before the first vertex, to be freed, and those of a triangle. -ERR_LIMIT: there are too many. */
	int (*front)(void *writer, const struct acut_mesh_head *, const struct acut_mesh_tail *, uint8_t **ret, size_t *ret_size,
		     size_t *ret_triangle, struct err *);
	void (*vertices)(const void *writer, const int32_t (*)[3], size_t n, uint8_t *to);
	/* Those from number `first` on. 8 bytes behind them may be overwritten. */
	int (*triangles)(const void *writer, const struct format_piece *, uint32_t first, uint32_t n, uint8_t *to, struct err *);
};

/* One format. `open` makes the writer; `head`, any number of `block`, `finish` follow in this order, `free` comes last, also
 * after a failure, and returns NULL. Writers write to their output and nowhere else. The tail
 * has the digest of the triangles that came. */
struct format {
	const char *name, *extensions, *help; /* extensions: ".a .b" */
	const char *purpose;                  /* what, or whom, it is for */
	enum format_kind kind;
	unsigned takes; /* FORMAT_CANONICAL ... */
	bool positions; /* blocks come with positions */
	int (*open)(struct outfile *, const struct format_options *, void **ret, struct err *);
	int (*head)(void *writer, const struct acut_mesh_head *, struct err *);
	int (*block)(void *writer, const struct format_block *, struct err *);
	int (*finish)(void *writer, const struct acut_mesh_tail *, struct err *);
	void *(*free)(void *writer);
	/* Small files beside the output, by their names: ".pgw" in place of its extension, "+.aux.xml" behind its name; NULL ends
	 * them. What number i has is asked for after finish, to be freed; NULL: it is not written. Both may be NULL. */
	const char *const *(*beside)(const struct format_options *);
	int (*beside_text)(const void *writer, unsigned i, char **ret, struct err *);
	/* Of rasters, in place of finish: a file for each tile. */
	int (*tiles)(void *writer, const struct dem_tiler *, const struct acut_mesh_tail *, struct err *);
	/* Of lines, after finish; else NULL. */
	struct format_simplified (*simplified)(const void *writer);
	/* To be resumed later; NULL: it cannot. `save` packs at most FORMAT_SAVED bytes; `resume` is called in place of head,
	 * with the output positioned after its last byte. */
	void (*save)(const void *writer, struct packer *);
	int (*resume)(void *writer, const struct acut_mesh_head *, struct cursor *, struct err *);
	/* Of FORMAT_LINES, after finish: how many lines the file has. */
	uint64_t (*lines)(const void *writer);
	/* Likewise: tiles will come, before head; and in place of finish, a file for each that has lines. */
	void (*tile)(void *writer, const struct format_tiler *);
	int (*tile_lines)(void *writer, const struct acut_mesh_tail *, struct err *);
	const struct format_fixed *fixed; /* NULL: only one process can write it */
};
#define FORMAT_SAVED 64

const struct format *const *format_rows(size_t *ret_n);
const struct format *format_find(const char *name);                 /* NULL: no such format */
const struct format *format_by_path(const char *path);              /* by extension; NULL: unknown */
const char *format_extension(const char *path);                     /* with its dot; NULL: none */
bool format_has_extension(const char *list, const char *extension); /* `list`: ".a .b" */
/* False: nothing is known of the extension. Else `err` says what to write, and which program makes such a file of it. */
bool format_elsewhere(const char *path, struct err *err);
/* "hillshade", and "hillshade+lines" for lines over it. */
bool format_parse_color(const char *text, enum format_color *ret, bool *ret_lines);
bool format_parse_raster(const char *text, enum format_rasters *ret);
unsigned format_options_given(const struct format_options *); /* FORMAT_CANONICAL ... */
/* The name of the first of some options on the command line ("canonical"); NULL: there is none. */
const char *format_option_name(unsigned options);

/* "m", "ft", "ftUS" to the name of the unit; NULL: no such unit. */
const char *format_unit_of_word(const char *word, size_t n);
/* One `from` is num/den of `to`; false unless both are names of lengths ("metre", "foot", "us-survey-foot"). */
bool format_unit_ratio(const char *from, const char *to, int64_t *num, int64_t *den);

#endif
