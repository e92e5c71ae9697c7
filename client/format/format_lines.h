/*
 * Contours, for the formats that have them: GeoPackage, GeoJSON, DXF. Their writers are this one, with a function that writes a
 * file when all lines are known.
 */
#ifndef FORMAT_LINES_H
#define FORMAT_LINES_H

#include "contour.h"
#include "format_axis.h"

struct format_lines {
	struct outfile *out;
	int (*write)(struct format_lines *, struct err *err); /* format_lines_next until there is none */
	struct format_options opt;
	struct contour *contour;
	uint32_t index;            /* every so many levels; 0: none */
	unsigned epsg;             /* of the plane; 0: the system has no number */
	char *wkt;                 /* of a system without a number; NULL: none, or it is not that of the heights */
	bool degrees;              /* x and y are */
	char name[FORMAT_COMMENT]; /* of the system, one line, "unknown" */
	char *comments;            /* acut-crs ... acut-digest, lines */
	int decimals;              /* of coordinates as text */
	double box[4];             /* that the head announces: least x y, greatest x y */
	uint64_t lines;            /* that were handed out */
	double lines_box[4];       /* of these */
	struct format_tiler tiler; /* most 0: one file */
};

/* `name`: of the format. */
int format_lines_open(struct outfile *, const struct format_options *, const char *name,
		      int (*write)(struct format_lines *, struct err *), void **ret, struct err *err);
int format_lines_head(void *writer, const struct acut_mesh_head *, struct err *err);
int format_lines_block(void *writer, const struct format_block *, struct err *err);
void format_lines_save(const void *writer, struct packer *);
int format_lines_resume(void *writer, const struct acut_mesh_head *, struct cursor *, struct err *err);
void *format_lines_free(void *writer);
/* Joins the lines, writes the file, and removes what is left of the pieces. */
int format_lines_finish(void *writer, const struct acut_mesh_tail *, struct err *err);

/* Before the head, and in place of format_lines_finish: a file for each tile. */
void format_lines_tile(void *writer, const struct format_tiler *);
int format_lines_tiles(void *writer, const struct acut_mesh_tail *, struct err *err);
/* contour_next, counted; and how many lines the files have. */
int format_lines_next(struct format_lines *, struct contour_line *ret, struct err *err);
uint64_t format_lines_count(const void *writer);
struct format_simplified format_lines_simplified(const void *writer);

bool format_lines_is_index(const struct format_lines *, int64_t level);
/* -ERR_LIMIT: so much output would meet the pieces. Before each line. */
int format_lines_room(const struct format_lines *, struct err *err);
enum { FORMAT_LINES_NUMBER = 40 }; /* room for one as text */
/* A coordinate with the decimals that tell doubles of its size apart, without zeros at the end. Returns the end. */
char *format_lines_text(const struct format_lines *, double v, char *at);

/* What the rows of these formats have in common. */
#define FORMAT_LINES_ROW                                                                                               \
	.kind = FORMAT_LINES, .takes = FORMAT_Z_UNIT | FORMAT_INTERVAL | FORMAT_BASE | FORMAT_INDEX | FORMAT_SIMPLIFY, \
	.positions = true, .head = format_lines_head, .block = format_lines_block, .finish = format_lines_finish,      \
	.free = format_lines_free, .simplified = format_lines_simplified, .save = format_lines_save,                   \
	.resume = format_lines_resume, .lines = format_lines_count, .tile = format_lines_tile, .tile_lines = format_lines_tiles

#endif
