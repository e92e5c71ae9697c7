/*
 * The line set of a generation: the pieces of all its lines, and its areas, in an immutable file with a tree of boxes. Pieces
 * meet at their ends only (snap.h); their ends are positions of line vertices, which are records of the generation like others
 * (POINT_LINE). docs/formats/format.md describes the bytes; docs/design/constraints.md what pieces mean.
 *
 * Areas: lakes, boundaries and holes. A position is out if there are boundaries and it is in none of them, or if it is in a hole.
 * It is in a lake if it is not out, and in an odd number of the rings of one lake. A piece says which of these change where it
 * is crossed.
 */
#ifndef LINESET_H
#define LINESET_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "digest.h"
#include "point.h"

struct err;
struct ledger;

/* What changes where a piece is crossed, and the state of a position: bits. */
enum { LINESET_LAKE = 1, LINESET_OUT = 2 };

struct lineset_piece {
	int32_t a[2], b[2]; /* a is before b: by x, then y */
	uint32_t turns;     /* LINESET_LAKE, LINESET_OUT */
};

struct lineset;

/* As it is in the head of the file. */
struct lineset_info {
	uint64_t pieces;
	bool areas;            /* a piece turns something, or all is out */
	unsigned turns;        /* what pieces turn, all together */
	unsigned far;          /* the state of positions far from all pieces: 0 or LINESET_OUT */
	int32_t box[4];        /* of the pieces */
	struct digest content; /* the same for the same pieces, whatever the file */
};

/* `memory`: for pages of the tree that all readers share; charged to the ledger (may be NULL) until lineset_close. */
int lineset_open(int dirfd, const char *name, struct ledger *, size_t memory, struct lineset **ret, struct err *);
struct lineset *lineset_close(struct lineset *); /* NULL is fine; returns NULL */
const struct lineset_info *lineset_info(const struct lineset *);
uint64_t lineset_charged(const struct lineset *); /* bytes charged to LEDGER_INDEX */

/* Working memory of one thread: pages. Its size is a constant. */
struct lineset_reader;
size_t lineset_reader_bytes(void);
struct lineset_reader *lineset_reader_init(void *memory, const struct lineset *);

/* Passes each piece that meets the closed box (min x, min y, max x, max y) once, in an order that depends on the file alone. When
 * `piece` returns non-zero, the call ends and returns that. The same reader may not be used within `piece`. */
typedef int (*lineset_piece_fn)(void *ctx, const struct lineset_piece *, struct err *);
int lineset_find(struct lineset_reader *, const int32_t box[4], lineset_piece_fn piece, void *ctx, struct err *);

/* The number of pieces that meet the box, at most `most`. */
int lineset_count(struct lineset_reader *, const int32_t box[4], uint64_t most, uint64_t *ret, struct err *);

/* The state of the position (x / den, y / den), den 1 to 3. One on a piece counts as moved to greater x and, much less, to
 * greater y. */
int lineset_state(struct lineset_reader *, int64_t x, int64_t y, unsigned den, unsigned *ret, struct err *);

/* What records and triangles in a box depend on: a sum over the pieces that meet the closed box, and the state at its lower left
 * corner. Zero if no piece meets it and the state is zero. It does not depend on pieces elsewhere, except by the state. */
int lineset_sum(struct lineset_reader *, const int32_t box[4], struct digest *ret, struct err *);
/* The same for Morton keys [lo, hi]: a sum over the largest aligned cells of the range, with the pieces that meet their boxes
 * widened by `clear`. */
int lineset_sum_range(struct lineset_reader *, uint64_t lo, uint64_t hi, int64_t clear, struct digest *ret, struct err *);

/* Marks the records of survey points in a closed box that lines remove: POINT_NEAR_LINE if one is on a piece or within `clear`
 * (lattice numbers) of it, else POINT_IN_AREA if it is in a lake or out. Records with POINT_LINE are line vertices, and stay. */
int lineset_mark(struct lineset_reader *, const int32_t box[4], double clear, struct point *, size_t n, struct err *);

/* ---- writing ---- */

/* Writes and fsyncs the file. `piece` may be reordered. */
int lineset_write(int dirfd, const char *name, struct lineset_piece *, size_t n, unsigned far, struct err *);

#endif
