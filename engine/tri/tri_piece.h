/*
 * Pieces in a triangulation: the Delaunay triangulation of tri_run becomes the constrained one, which is unique for its
 * vertices and pieces (docs/design/constraints.md, "The constrained triangulation"). A piece is an edge that the mesh shall have;
 * it has a vertex at either end, none between them, and crosses no other piece. Its links are marked constrained on both sides.
 *
 * No allocation, no I/O, no globals. The order of the pieces does not change the result. Once there are pieces, positions are
 * added by tri_piece_add only.
 *
 * Vertices are named by their `id`, triangles by their place. A triangle may have a flag: each triangle that takes the
 * place of others has one if it overlaps a flagged one of these, and may have one if it does not.
 */
#ifndef TRI_PIECE_H
#define TRI_PIECE_H

#include "tri.h"

struct tri_pieces; /* at the start of its memory */

/* 5 bytes for each of up to `cap` vertices, 44 for each of the `most` triangles that one piece may cross, and a small
 * constant. A mesh of n vertices has at most 2 n - 5 triangles to cross. */
size_t tri_pieces_bytes(uint32_t cap, uint32_t most);

/* `memory`: tri_pieces_bytes(tri_count(t), most) bytes, aligned to 64; `t` holds the result of a tri_run that returned 0,
 * and is in use until the last call. No triangle has a flag. */
struct tri_pieces *tri_pieces_init(void *memory, struct tri *t, uint32_t most);

/* The same, but an end of a piece must be made known, with a triangle at that vertex, before it is used. So it takes a constant
 * time. There may be `cap` vertices, tri_pieces_bytes(cap, most), when positions were added. */
struct tri_pieces *tri_pieces_open(void *memory, struct tri *t, uint32_t cap, uint32_t most);
void tri_piece_end(struct tri_pieces *, uint32_t id, uint32_t triangle);

/* Why a piece was not inserted. Nothing has changed then. */
enum {
	TRI_E_END = 3,  /* an end is no vertex, or both are the same one */
	TRI_E_VERTEX,   /* a vertex is between the ends: *ret_at is its id */
	TRI_E_CROSSING, /* it crosses another piece: *ret_at is the id of one end of that */
	TRI_E_MOST,     /* it crosses more than `most` triangles */
};

/* Inserts the piece between two vertices. 0, also for a piece that is there; or one of the above. Time: as the number of
 * triangles crossed, and as the smaller number of triangles around an end. */
int tri_piece_insert(struct tri_pieces *, uint32_t from, uint32_t to, uint32_t *ret_at);

/* Changes nothing, and finds the triangles that the piece crosses, in order along it; none if it is an edge. Returns as
 * tri_piece_insert. */
int tri_piece_find(struct tri_pieces *, uint32_t from, uint32_t to, uint32_t *ret_n, uint32_t *ret_at);
uint32_t tri_piece_found(const struct tri_pieces *, uint32_t i); /* triangle i of the last tri_piece_find */

/* Adds a position that is no vertex and on no piece; its id is its number. `at`: tri_walk of it. All new triangles have a flag if
 * one had whose place they take. They are those of tri_piece_found: *ret_n. 0; TRI_E_FULL; TRI_E_MOST: so many triangles have
 * it in their circle; TRI_E_CROSSING: it is on a piece. Nothing has changed unless it is 0. */
int tri_piece_add(struct tri_pieces *, const struct mesh_vertex *, uint32_t at, uint32_t *ret_n);

void tri_piece_flag(struct tri_pieces *, uint32_t triangle);
bool tri_piece_flagged(const struct tri_pieces *, uint32_t triangle);
const uint64_t *tri_piece_flags(const struct tri_pieces *); /* bits, of 64 triangles a word */

#endif
