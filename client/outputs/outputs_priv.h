/* Shared by the files of this room: outputs (outputs.c, outputs_keep.c), and the steps between the stream and the writers. */
#ifndef OUTPUTS_PRIV_H
#define OUTPUTS_PRIV_H

#include <string.h>

#include "digest.h"
#include "err.h"
#include "outfile.h"
#include "outputs.h"
#include "sort.h"

struct outputs_change;
struct outputs_levels;
struct outputs_moves;
struct outputs_stripes;
struct outputs_tiles;

/* Where a mesh is from, for the indexes of tiles and changes. */
struct outputs_origin {
	uint64_t job, generation;
	char *dataset; /* NULL: not known */
};

/* ---- --max-edge and edge statistics: outputs_edge.c ---- */

/* Triangles that are left out. */
struct outputs_left {
	uint64_t triangles;
	unsigned __int128 area2; /* twice their area, lattice units */
	struct digest digest;
	int64_t k[2]; /* of the head */
};
void outputs_left_add(struct outputs_left *, const int32_t *a, const int32_t *b, const int32_t *c);

/* ---- the triangles of a block that stay: outputs_passed.c ---- */

struct outputs_passed {
	uint32_t (*triangle)[3];
	uint8_t *flags;
	uint32_t n, room;
};
int outputs_passed_begin(struct outputs_passed *, const struct acut_mesh_block *, struct err *err);
static inline void outputs_passed_add(struct outputs_passed *k, const struct acut_mesh_block *b, uint32_t i)
{
	memcpy(k->triangle[k->n], b->triangle[i], sizeof(*k->triangle));
	if (b->flags)
		k->flags[k->n] = b->flags[i];
	k->n++;
}
/* *ret is `b` with these triangles; valid until the next begin. */
void outputs_passed_end(const struct outputs_passed *, const struct acut_mesh_block *b, struct acut_mesh_block *ret);
void outputs_passed_free(struct outputs_passed *);
void outputs_left_sum(struct outputs_left *, const struct outputs_left *more);
void outputs_left_save(const struct outputs_left *, struct packer *);
void outputs_left_load(struct outputs_left *, struct cursor *);

/* A length in lattice units. */
struct outputs_limit {
	bool none_longer; /* no edge can be longer */
	unsigned __int128 square;
};
/* `option` is the name in messages. -ERR_USAGE: its unit cannot be converted, or it has too many digits. */
int outputs_limit_init(struct outputs_limit *, const struct acut_mesh_head *, const struct outputs_length *, const char *option,
		       struct err *err);
unsigned __int128 outputs_edge_square(const int32_t *a, const int32_t *b); /* squared xy length, lattice units */

#define OUTPUTS_EDGE_BUCKETS (70 * 16)
struct outputs_edge {
	bool limited;
	struct outputs_limit limit; /* longer edges are left out */
	bool gather;
	double scale;
	char unit[16]; /* of x and y */
	struct outputs_left left;
	double longest;                               /* squared, lattice units */
	uint64_t count, bucket[OUTPUTS_EDGE_BUCKETS]; /* of the squared length, 16 from one power of two to the next */
	double area[OUTPUTS_EDGE_BUCKETS];            /* of triangles, lattice units, by their longest edge */
	struct outputs_passed passed;
};
/* limit * num / den / scale as p / q in lowest terms; false if it does not fit 64 bits. */
bool outputs_edge_ratio(struct decimal limit, int64_t num, int64_t den, struct decimal scale, uint64_t *ret_p, uint64_t *ret_q);
int outputs_edge_init(struct outputs_edge *, const struct acut_mesh_head *, const struct outputs_options *, struct err *err);
/* *ret is the block without the triangles left out; it points into the filter and the block. */
int outputs_edge_block(struct outputs_edge *, const struct acut_mesh_block *, const int32_t (*position)[3],
		       struct acut_mesh_block *ret, struct err *err);
double outputs_edge_median(const struct outputs_edge *);
double outputs_edge_longest(const struct outputs_edge *);
/* The part of the area of all triangles that is in triangles with an edge longer than `length` (file units): 0 to 1. */
double outputs_edge_share(const struct outputs_edge *, double length);
/* An area in the unit of the file; NAN where that is not a length. */
double outputs_edge_area(const struct outputs_edge *, unsigned __int128 area2);
void outputs_edge_done(struct outputs_edge *);
void outputs_edge_save(const struct outputs_edge *, struct packer *); /* what was counted */
void outputs_edge_add(struct outputs_edge *, struct cursor *);        /* to what is there */

/* ---- --trim-hull: outputs_hull.c ---- */

struct outputs_hull;
int outputs_hull_new(const struct outfile *beside, struct outputs_hull **ret, struct err *err);
/* -ERR_USAGE: a window has no hull. */
int outputs_hull_head(struct outputs_hull *, const struct acut_mesh_head *, const struct outputs_length *, struct err *err);
/* *ret is the block without the triangles that have long edges; it points into the trimmer and the block. */
int outputs_hull_block(struct outputs_hull *, const struct acut_mesh_block *, const int32_t (*position)[3],
		       struct acut_mesh_block *ret, struct err *err);
/* After the last block: those of them that stay, as blocks of triangles whose vertices came before. */
int outputs_hull_rest(struct outputs_hull *, int (*each)(void *ctx, const struct format_block *), void *ctx, struct err *err);
const struct outputs_left *outputs_hull_left(const struct outputs_hull *);
struct outputs_hull *outputs_hull_free(struct outputs_hull *);

/* ---- --mask and --erase: outputs_mask.c ---- */

struct outputs_mask;
int outputs_mask_add(struct outputs_mask ** /* NULL at first */, enum outputs_cut, const char *file, struct err *err);
/* Hexadecimal; "": there is no area of this kind. */
const char *outputs_mask_digest(const struct outputs_mask *, enum outputs_cut);
/* -ERR_USAGE: a file is of another coordinate system, or reaches too far out. */
int outputs_mask_head(struct outputs_mask *, const struct acut_mesh_head *, struct err *err);
/* *ret is the block without the triangles left out; it points into the mask and the block. */
int outputs_mask_block(struct outputs_mask *, const struct acut_mesh_block *, const int32_t (*position)[3],
		       struct acut_mesh_block *ret, struct err *err);
struct outputs_left *outputs_mask_left(struct outputs_mask *, enum outputs_cut);
struct outputs_mask *outputs_mask_free(struct outputs_mask *);

/* ---- --canonical: outputs_canonical.c ---- */

struct outputs_canonical;
/* OUTPUTS_LINES: triangles may have flags. OUTPUTS_MERGE: vertices come once for each triangle that has them, and are written
 * once. The run says what to ask while it sorts. */
enum { OUTPUTS_LINES = 1, OUTPUTS_MERGE = 2 };
int outputs_canonical_new(const struct format *, void *writer, const struct outfile *beside, const struct outputs_options *run,
			  uint64_t memory, unsigned how, struct outputs_canonical **ret, struct err *err);
int outputs_canonical_block(struct outputs_canonical *, const struct format_block *, struct err *err);
/* Sends everything to the writer, in order, as blocks; the caller finishes the writer. */
int outputs_canonical_finish(struct outputs_canonical *, struct err *err);
struct outputs_canonical *outputs_canonical_free(struct outputs_canonical *);

/* ---- --levels: outputs_levels.c ---- */

int outputs_levels_new(const char *dir, const struct format *, const struct format_options *, const struct outputs_options *,
		       struct outputs_levels **ret, struct err *err);
const struct outfile *outputs_levels_beside(const struct outputs_levels *);
int outputs_levels_head(struct outputs_levels *, const struct acut_mesh_head *, struct err *err);
int outputs_levels_block(struct outputs_levels *, const struct format_block *, struct err *err);
void outputs_levels_tail(struct outputs_levels *, const struct acut_mesh_tail *);
/* Makes the folder. *bytes grows by its files. */
int outputs_levels_publish(struct outputs_levels *, uint64_t *bytes, struct err *err);
/* After it, of a part. */
int outputs_levels_moves(struct outputs_levels *, struct outputs_moves *, struct err *err);
uint64_t outputs_levels_count(const struct outputs_levels *); /* tiles */
struct outputs_levels *outputs_levels_free(struct outputs_levels *);

/* ---- what a stream says first, with texts of its own: outputs_beside.c ---- */

struct outputs_head {
	struct acut_mesh_head is;
	char *text[11];
};
int outputs_head_copy(struct outputs_head *, const struct acut_mesh_head *, struct err *err);
void outputs_head_done(struct outputs_head *);

/* What it says last, without a report. */
struct outputs_tail {
	struct acut_mesh_tail is;
	char digest[DIGEST_HEX_SIZE], vertex_digest[DIGEST_HEX_SIZE];
};
void outputs_tail_copy(struct outputs_tail *, const struct acut_mesh_tail *);

/* ---- parts: outputs_part.c ---- */

/* A file that is complete and gets its name when the parts are joined: a path, or a name in the folder of the run. */
struct outputs_move {
	char *name;
	const char *part; /* one of the names of parts */
	struct outfile_held held;
};
struct outputs_moves {
	struct outputs_move *move;
	size_t n, room;
};
int outputs_moves_add(struct outputs_moves *, const char *name, const char *part, const struct outfile_held *, struct err *err);
/* Of files that a folder of this part has: n of them by `name`, and `last`, if it is not NULL. */
int outputs_moves_folder(struct outputs_moves *, const struct outfile_folder *, size_t n,
			 const char *(*name)(void *ctx, size_t i, char *buf), void *ctx, const char *last, struct err *err);
/* Before they are settled. *ret_all: all have their names already. -ERR_GONE: one is neither here nor there. -ERR_CANCELLED. */
int outputs_moves_look(const struct outputs_moves *, const struct outputs_options *, const struct outfile_folder *, bool *ret_all,
		       struct err *err);
int outputs_interrupted(const struct outputs_options *, struct err *err); /* -ERR_CANCELLED */
int outputs_moves_settle(const struct outputs_moves *, struct outfile_folder *, struct err *err);

/* What a run knows of the parts that it joins. */
struct outputs_joined {
	struct outputs_moves moves; /* of a part: its own files */
	char **part;                /* their names */
	size_t nparts;
	char *folder; /* that the files are in; NULL: they have paths */
	bool no_clobber;
	struct outputs_left left[OUTPUTS_REASONS];
	struct format_simplified simplified;
	uint64_t bytes, tiles;
	uint32_t no_lines;
};

/* ---- outputs ---- */

enum { OUTPUTS_BESIDE = 4 };

struct outputs_target {
	const struct format *format;
	struct format_options opt;
	struct outfile *out;
	void *writer;
	struct outfile *beside[OUTPUTS_BESIDE]; /* those of the format, and the sidecar */
	unsigned nbeside;
	struct outputs_canonical *canonical;
	const char *part;                /* of the run */
	struct outputs_stripes *stripes; /* NULL: no other process writes the file */
	struct outputs_target *next;
};

struct outputs {
	struct outputs_options opt;
	struct outputs_target *target, **end;
	struct outputs_change *change; /* NULL: the stream is of a mesh */
	struct outputs_tiles *tiles;   /* NULL: one file an output */
	struct outputs_levels *levels; /* likewise, but for --levels */
	bool finished;
	char trimmed[384];             /* of the options of formats */
	uint64_t all_triangles;        /* of the stream, after its tail */
	char written[DIGEST_HEX_SIZE]; /* digest of the triangles that were written; "" before the tail */
	struct outputs_head head;
	struct outputs_tail tail;
	struct outputs_hull *hull; /* NULL: nothing is trimmed */
	struct outputs_mask *mask; /* NULL: there is neither --mask nor --erase */
	struct outputs_edge edge;
	struct err err;
	uint64_t bytes;
	struct outputs_origin origin; /* owns its text */
	struct outputs_kept *kept;    /* NULL: nothing is */
	struct outputs_joined joined;
};
/* outputs_share.c */
int outputs_share_head(struct outputs *, const struct acut_mesh_head *, struct err *err);
int outputs_share_publish(struct outputs *, struct err *err);
struct outputs_stripes *outputs_stripes_free(struct outputs_stripes *);
/* outputs_part.c. A file of a part that was published, and of the run that joins: what outputs_publish does there. */
int outputs_part_file(struct outputs *, const struct outfile *, struct err *err);
int outputs_part_publish(struct outputs *, struct err *err);
void outputs_joined_done(struct outputs_joined *);
struct outputs_left *outputs_left_by(struct outputs *, enum outputs_reason); /* NULL: the run has no such reason */
uint32_t outputs_no_lines(const struct outputs *);
struct format_simplified outputs_simplified(const struct outputs *);

/* outputs_beside.c: the small files beside an output are opened with it, and made and get their names before it. */
/* The name of a file beside `path`: `suffix` is in place of its extension, or behind all of it if it begins with '+'. */
void outputs_beside_name(const char *path, const char *suffix, char *ret, size_t size);
int outputs_beside_write(struct outfile *, const char *text, struct err *err);
int outputs_beside_open(struct outputs_target *, const char *path, struct err *err);
int outputs_beside_make(const struct outputs *, struct outputs_target *, struct err *err);
int outputs_beside_publish(struct outputs_target *, uint64_t *bytes, struct err *err);
/* outputs_keep.c: called in place of the heads of the writers if outputs are continued. */
bool outputs_keep_goes_on(const struct outputs *);
int outputs_keep_head(struct outputs *, const struct acut_mesh_head *, struct err *err);
/* All outputs have their names. */
void outputs_keep_done(struct outputs *);
void outputs_keep_discard(struct outputs *); /* a run that ends with nothing to go on with leaves nothing */
struct outputs_kept *outputs_keep_free(struct outputs_kept *);

#endif
