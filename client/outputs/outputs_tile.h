/* Tiles, for the files that work on them: triangles into tiles (outputs_tile.c), a file a tile (outputs_tile_make.c),
 * rasters (outputs_tile_raster.c), the index (outputs_tile_index.c), the folder (outfile_folder.c). */
#ifndef OUTPUTS_TILE_H
#define OUTPUTS_TILE_H

#include "digest.h"
#include "outputs_priv.h"

struct outputs_tile {
	uint64_t number; /* row << 32 | column, from the first ones of the box */
	uint64_t triangles, vertices, bytes;
	uint64_t pixels[2]; /* of rasters, which have these and `edge` in place of the rest */
	uint64_t lines;     /* of lines, likewise */
	double edge[4];
	int32_t box[6]; /* of the vertices of its triangles */
	struct digest digest, vertex_digest;
};

struct outputs_tiles {
	const struct format *format;
	struct format_options opt;
	struct outputs_options run;
	struct decimal size; /* exponent not above 0 */
	struct outfile_folder *place;
	struct outfile *index;
	struct sort *sort; /* the triangles, by tile */
	void *writer;      /* of a raster or of lines, in place of the sort */
	bool divides;      /* the format is one of these, which divide themselves */
	struct outputs_head copy;
	struct acut_mesh_head head; /* its texts are the copy's */
	struct outputs_tail tail;
	struct outputs_grid grid;  /* the tiles of the head's box */
	struct outputs_tile *tile; /* those with triangles: as they came, then by number */
	size_t ntile;
	const char *beside[OUTPUTS_BESIDE]; /* what the names of files beside each tile end with; of rasters */
	unsigned nbeside;
	uint64_t beside_bytes;
	uint32_t *slot; /* by number, open: 1 + which tile, 0 nothing; a power of two of them */
	size_t nslot;
	const struct outputs_origin *origin; /* while it is published */
	struct outputs_passed passed;        /* of outputs_tiles_share */
	struct outputs_moves *moves;         /* borrowed: of the files that are joined, or were made for that */
};

int outputs_tiles_new(const char *dir, const struct format *, const struct format_options *, const struct outputs_options *,
		      struct outputs_tiles **ret, struct err *err);
int outputs_tiles_head(struct outputs_tiles *, const struct acut_mesh_head *, struct err *err);
int outputs_tiles_block(struct outputs_tiles *, const struct format_block *, struct err *err);
/* Makes all tiles and the index and moves them to their places. *bytes grows by theirs. */
int outputs_tiles_publish(struct outputs_tiles *, const struct outputs_origin *, const struct outputs_report *, uint64_t *bytes,
			  struct err *err);
/* Of a part: only the triangles of its tiles. *ret points into the tiles and the block. */
int outputs_tiles_share(struct outputs_tiles *, const struct acut_mesh_block *, const int32_t (*position)[3],
			struct acut_mesh_block *ret, struct err *err);
/* The tiles of a part, for the run that joins them. -ERR_CORRUPT. */
void outputs_tiles_save(const struct outputs_tiles *, struct packer *);
size_t outputs_tiles_saved(const struct outputs_tiles *); /* at most these bytes */
int outputs_tiles_load(struct outputs_tiles *, struct cursor *, struct err *err);
struct outputs_tiles *outputs_tiles_free(struct outputs_tiles *);

/* The column and row of the tile that has the triangle. False: it is outside of the box. */
bool outputs_tiles_at(const struct outputs_tiles *, const int32_t *const corner[3], uint64_t ret[2]);
const char *outputs_tiles_name_at(const struct outputs_tiles *, const int64_t at[2], char buf[OUTFILE_NAME]);
const char *outputs_tiles_name(void *tiles, size_t i, char buf[OUTFILE_NAME]);
uint64_t outputs_tiles_most(const struct outputs_tiles *);
int outputs_tiles_too_many(const struct outputs_tiles *, struct err *err);
void outputs_tiles_order(struct outputs_tiles *); /* when all triangles have come: the tiles by number, row by row */
void outputs_tiles_number(const struct outputs_tiles *, size_t i, int64_t ret[2]);
/* outputs_tile_make.c: a file for each, in the inner folder. */
int outputs_tiles_make(struct outputs_tiles *, struct err *err);
int outputs_tiles_raster(struct outputs_tiles *, struct err *err); /* outputs_tile_raster.c: likewise */
void outputs_tiles_tile(struct outputs_tiles *);                   /* before the head of a writer of lines */
/* outputs_tile_index.c */
int outputs_tiles_index(struct outputs_tiles *, const struct outputs_report *, struct err *err);

enum { OUTPUTS_TILE_WORDS = 6 }; /* of a record: tile, three corners, heights 0 and 1, height 2 */

#endif
