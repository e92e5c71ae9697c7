/* Tiles, for the files that work on them: triangles into tiles (format_tile.c), a file a tile (format_tile_make.c),
 * the index (format_tile_index.c), the folder (format_tile_place.c). */
#ifndef FORMAT_TILE_H
#define FORMAT_TILE_H

#include "digest.h"
#include "format_priv.h"

/* ---- the folder: format_tile_place.c ---- */

/* A folder, made if need be, with another one in it where files stand until all of them are whole. */
struct format_place;
int format_place_new(const char *dir, bool no_clobber, struct format_place **ret, struct err *err);
/* A new file in the inner folder; also says in which folder nameless ones go. */
int format_place_file(const struct format_place *, const char *name, struct format_output **ret, struct err *err);
/* Before the first is moved: -ERR_USAGE where names are taken and must not be; else the old index goes, because what
 * it says will not be true. `name` writes that of file i. */
int format_place_clear(struct format_place *, size_t n, const char *(*name)(void *ctx, size_t i, char *buf), void *ctx,
		       struct err *err);
/* Moves a file that was published in the inner folder to the outer one. */
int format_place_move(struct format_place *, const char *name, struct err *err);
int format_place_sync(struct format_place *, struct err *err);
void format_place_keep(struct format_place *); /* all is in its place: a folder that was made stays */
struct format_place *format_place_free(struct format_place *);
#define FORMAT_PLACE_NAME 96 /* room for the name of a file */

/* ---- tiles ---- */

struct format_tile {
	uint64_t number; /* row << 32 | column, from the first ones of the box */
	uint64_t triangles, vertices, bytes;
	int32_t box[6]; /* of the vertices of its triangles */
	struct digest digest, vertex_digest;
};

struct format_tiles {
	const struct format *format;
	struct format_options opt;
	struct format_run_options run;
	struct decimal size; /* exponent not above 0 */
	struct format_place *place;
	struct format_output *index;
	struct format_sort *sort;   /* the triangles, by tile */
	struct acut_mesh_head head; /* its texts are this object's */
	char *text[8];
	unsigned ntext;
	struct acut_mesh_tail tail;
	char digest[DIGEST_HEX_SIZE], vertex_digest[DIGEST_HEX_SIZE];
	uint64_t p, q;            /* side of a tile over the lattice's scale */
	int64_t first[2];         /* numbers of the first column and row */
	uint64_t count[2];        /* columns and rows that the box has */
	struct format_tile *tile; /* those with triangles: as they came, then by number */
	size_t ntile;
	uint32_t *slot; /* by number, open: 1 + which tile, 0 nothing; a power of two of them */
	size_t nslot;
	uint64_t job, generation;
	char *dataset;
};

int format_tiles_new(const char *dir, const struct format *, const struct format_options *, const struct format_run_options *,
		     struct format_tiles **ret, struct err *err);
int format_tiles_head(struct format_tiles *, const struct acut_mesh_head *, struct err *err);
int format_tiles_block(struct format_tiles *, const struct format_block *, struct err *err);
int format_tiles_tail(struct format_tiles *, const struct acut_mesh_tail *, struct err *err);
void format_tiles_about(struct format_tiles *, uint64_t job, const char *dataset, uint64_t generation);
/* Makes all tiles and the index and moves them to their places. *bytes grows by theirs. */
int format_tiles_publish(struct format_tiles *, uint64_t left_out, uint64_t *bytes, struct err *err);
uint64_t format_tiles_count(const struct format_tiles *); /* with triangles */
struct format_tiles *format_tiles_free(struct format_tiles *);

const char *format_tiles_name(void *tiles, size_t i, char buf[FORMAT_PLACE_NAME]);
void format_tiles_order(struct format_tiles *); /* when all triangles have come: the tiles by number, row by row */
void format_tiles_number(const struct format_tiles *, size_t i, int64_t ret[2]);
/* format_tile_make.c: a file for each, in the inner folder. */
int format_tiles_make(struct format_tiles *, struct err *err);
/* format_tile_index.c */
int format_tiles_index(struct format_tiles *, uint64_t left_out, struct err *err);

enum { FORMAT_TILE_WORDS = 6 }; /* of a record: tile, three corners, heights 0 and 1, height 2 */

#endif
