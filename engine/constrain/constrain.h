/*
 * Domains with pieces (docs/design/constraints.md, "Domains with pieces"): which triangles of the constrained mesh a region owns.
 * Loads what they depend on beyond P(B), inside the memory of the caller.
 */
#ifndef CONSTRAIN_H
#define CONSTRAIN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "cut_source.h"
#include "cut_valid.h"
#include "lineset.h"
#include "tri.h"

struct err;
struct lattice;

/* The pieces: as lineset_find. Their ends are positions of the source; a piece with an end that the view does not keep is
 * ignored. */
struct constrain_lines {
	void *ctx;
	int (*find)(void *ctx, const int32_t box[4], lineset_piece_fn, void *sink, struct err *);
	/* As lineset_state: triangles that are out are not chosen. NULL: nothing is out. */
	int (*state)(void *ctx, int64_t x, int64_t y, unsigned den, unsigned *ret, struct err *);
	/* Adds the file and the feature that a piece is of to an error, if they are known. May be NULL. */
	void (*name)(void *ctx, const int32_t a[2], const int32_t b[2], struct err *);
};

/* The lines of a grid; valid as long as the reader, which may not be in use during a call. False: it has none. */
struct grid;
struct grid_reader;
bool constrain_lines_of(struct grid_reader *, struct constrain_lines *ret);
bool constrain_has_out(const struct grid *); /* some of its areas are out of the mesh */

/* The triangles of an area instead of those of a region: */
struct constrain_area {
	void *ctx;
	/* Whether a triangle meets the area: it is verified. And whether it is chosen then. */
	bool (*meets)(void *ctx, const int32_t a[2], const int32_t b[2], const int32_t c[2]);
	bool (*takes)(void *ctx, const int32_t a[2], const int32_t b[2], const int32_t c[2]);
	/* Whether all kept positions of a cell are in the triangulation. */
	bool (*has)(void *ctx, const struct grid_cell *);
};

struct constrain {
	const struct cut_source *src;
	const struct view *view;
	const struct cut_region *region;
	const struct constrain_lines *lines;
	const struct constrain_area *area; /* NULL: the region's triangles */
	const struct lattice *lattice;     /* for the text of an error; NULL: lattice numbers */
	void *arena;                       /* the kernel is at its start, and needs `used` bytes of it */
	size_t size, used;
	struct tri *tri; /* after a tri_run of P(B) that returned 0 (or of what an area loads); later of all that was loaded, with
			    the pieces */
	struct cut_cover *cover; /* gets the boxes of discs that are not in the region; may be NULL */
	bool not_verified;       /* for tests */
	/* results */
	/* In the arena, a bit for each triangle of `tri`: the domain has those that are chosen, and those that are not special
	 * and that the region owns. special NULL: those that are chosen; chosen NULL: those that the region owns. */
	const uint64_t *chosen, *special;
	struct tri_pieces *inserted;            /* to add positions to `tri`, in the arena, if there are pieces; else NULL */
	uint32_t pieces, crossed, added, turns; /* pieces; owned triangles that are crossed; positions beyond P(B) */
	uint64_t cells_read, points_read;
	struct cut_lines depends; /* what it depends on beside P(B), without the sum */
};

/* CONSTRAIN_E_SPLIT: it does not fit; *ret_need > size / TRI_BYTES_PER_POINT is an estimate of the positions for which an
 * arena would suffice. -ERR_LIMIT: no smaller region would fit, because of one long piece, which the message names. */
enum { CONSTRAIN_E_SPLIT = 1 };
int constrain_run(struct constrain *, uint64_t *ret_need, struct err *);

#endif
