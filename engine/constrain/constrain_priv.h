/* A domain in progress, as the files of this room share it. Internal. */
#ifndef CONSTRAIN_PRIV_H
#define CONSTRAIN_PRIV_H

#include "constrain.h"
#include "cut_disc.h"
#include "cut_owner.h"
#include "geom.h"
#include "grid.h"
#include "mesh.h"
#include "tri_piece.h"

enum {
	BOXES = 64,    /* triangles for which pieces are searched together */
	SIGHT = 1024,  /* triangles that are followed from one disc; all that is in it is visible if there are more */
	SIGHTS = 4096, /* of all discs of a batch, at least; else of this part of the arena: */
	SIGHTS_PART = 16,
	SIGHTS_MOST = 1 << 16,
	SIGHTS_DISC = 16, /* a disc for so many of them */
	HITS = 8,         /* triangles in which a disc sees, for each of a batch */
	FAR = 512,        /* pieces that are listed and not loaded */
	HINTS = 16,
	INDEX = 8,   /* boxes under one of the index */
	LEVELS = 13, /* of the index */
	NONE = 0xffffffffu,
};

struct constrain_piece {
	int32_t a[2], b[2];
	uint32_t end[2]; /* the vertices; NONE: they were not found yet */
	uint32_t at[2];  /* triangles that were there once */
	bool gone;       /* an end is not kept by the view */
	bool turns;      /* LINESET_OUT */
	bool in;         /* it is in the triangulation */
};

/* A triangle in which a disc sees, and the edge over which it was entered: its ends, as they are seen from the disc's own
 * triangle. `parent`: the triangle before; `first`: the one at the beginning of its path, behind an edge of the disc's own
 * triangle. The own one is the first in the list. */
struct constrain_sight {
	uint32_t triangle, left, right;
	uint16_t parent, first;
	uint32_t side;     /* of the disc's own triangle, over which the path begins */
	uint32_t limit[2]; /* the left end and the right end that limit the view most, of (2) and (3); NONE */
	int32_t box[4];    /* of what is visible in it */
};

/* The best position for a side of the triangle: the side is seen from it at the largest angle, of cotangent `flat`. */
struct constrain_pick {
	double flat;
	struct point point;
	bool any;
};

struct constrain_disc {
	struct cut_disc disc;
	int32_t box[4];    /* of what is visible */
	int32_t cap[3][4]; /* of what is in the disc beyond each side */
	double height[3];  /* how far that is beyond the side at most; INFINITY */
	uint32_t triangle;
	uint32_t sight, nsight; /* the triangles in which it sees; none: all of the disc is visible */
	bool wide;              /* the triangle is searched first, and the rest of the disc if nothing is in it */
	bool part;              /* in the search that is going on */
	struct constrain_pick pick[3];
};

struct constrain_hit {
	uint32_t disc, sight; /* sight: its triangle in which it sees; NONE: any */
};

/* At the end of the arena. Before it lie the pieces, which grow downwards; at the start of the arena the kernel, then the tables,
 * then the points that are loaded in a turn, which grow upwards. */
struct constrain_work {
	struct constrain *c;
	struct err *err;
	struct tri_result r;
	struct cut_owner owner;
	uint32_t first;               /* positions of P(B) */
	uint32_t cap;                 /* of the kernel, for positions that are added */
	uint32_t most;                /* positions for which there is room in the kernel and in the tables */
	uint32_t near;                /* a triangle where the last walk ended */
	uint32_t hint[HINTS * HINTS]; /* of squares of `all`: a triangle there; NONE */
	uint8_t *at;                  /* end of the tables */
	/* sorted, then new ones: they are at the front */
	struct constrain_piece *piece;
	uint32_t npiece, nnew;
	uint32_t found; /* new ones in this turn */
	/* Pieces that meet the box of P(B), cross no owned triangle, and of which an end is no vertex. The others that meet the
	 * box are loaded. */
	int32_t all[4];
	struct lineset_piece far[FAR];
	uint32_t nfar;
	bool many;   /* some are not in the list */
	double wide; /* the least area of the box of a wide disc */
	/* Bits of triangles by place. special: those that the domain does not have just because it owns them: owned triangles of
	 * the plain mesh that are crossed, and all new ones. todo: to be verified. */
	uint64_t *special, *todo;
	struct tri_pieces *p;
	uint32_t (*own)[3]; /* the corners of owned triangles that are crossed */
	uint32_t nown;
	int32_t (*index[LEVELS])[4]; /* their boxes, then those of INDEX boxes ... */
	uint32_t nindex[LEVELS];
	unsigned levels;
	uint32_t last; /* the group in which a centroid was found */
	struct point *point;
	uint32_t npoint;
	struct cut_range range[4]; /* of the region */
	unsigned nrange;
	int64_t border[4]; /* of the region */
	/* the boxes for which pieces are searched, and the discs for which cells are read */
	int32_t around[4], box[BOXES][4];
	uint32_t nbox;
	int32_t disc_around[4];
	bool inside; /* only positions in the triangles of wide discs are searched */
	struct constrain_disc *disc;
	uint32_t ndisc, mostdisc;
	struct constrain_hit *hit; /* what meets the cell that is read */
	uint32_t nhit, mosthit;
	int32_t cell[4]; /* its box */
	struct constrain_sight *sight;
	uint32_t nsight, mostsight;
};

/* What is at the end of an arena of so many bytes. */
size_t constrain_work_bytes(size_t size);
/* The capacity of the kernel for n positions: the finished domain fits the memory of its triangles (finish.h). */
uint32_t constrain_kernel_cap(uint64_t n);
/* Takes n bytes after the tables; NULL: they do not fit. */
void *constrain_take(struct constrain_work *, size_t n);
static inline bool constrain_real(const struct tri_triangle *t)
{
	return t->corner[0] != TRI_GHOST && t->corner[1] != TRI_GHOST && t->corner[2] != TRI_GHOST;
}
static inline bool constrain_bit(const uint64_t *bits, uint32_t i)
{
	return bits[i / 64] >> i % 64 & 1;
}
static inline void constrain_bit_set(uint64_t *bits, uint32_t i)
{
	bits[i / 64] |= UINT64_C(1) << i % 64;
}
/* Whether a triangle is owned, or meets the area. */
bool constrain_owns(const struct constrain_work *, uint32_t triangle);
/* Triangles all over the box `all`, where walks begin. */
void constrain_hints(struct constrain_work *);
/* The vertex at a position; NONE: it has none. The walk ends at `near`. */
uint32_t constrain_vertex(struct constrain_work *, const int32_t at[2]);
void constrain_triangle_box(const struct tri_result *, const uint32_t corner[3], int32_t ret[4]);
static inline bool constrain_boxes_meet(const int32_t a[4], const int32_t b[4])
{
	return a[0] <= b[2] && a[1] <= b[3] && a[2] >= b[0] && a[3] >= b[1];
}

typedef bool (*constrain_less_fn)(const void *a, const void *b);
void constrain_sort(void *array, size_t n, size_t size, constrain_less_fn less); /* of at most 40 bytes each */

/* constrain_lines.c: pieces that meet the boxes of triangles. */
int constrain_lines_all(struct constrain_work *, const int32_t box[4]); /* lists and loads those that meet the box of P(B) */
int constrain_lines_box(struct constrain_work *, const int32_t box[4]); /* adds a box to a batch */
int constrain_lines_flush(struct constrain_work *);                     /* searches the batch */
void constrain_lines_sort(struct constrain_work *);                     /* the new ones are among the others */
/* Finds the ends of pieces, and loads those that are no vertex. */
int constrain_lines_ends(struct constrain_work *);
/* Makes the ends of a piece known to the kernel. */
void constrain_lines_known(struct constrain_work *, struct constrain_piece *);
/* Whether a piece that has an end that is no vertex crosses an owned triangle; true if that is not sure. */
bool constrain_far_crosses(struct constrain_work *, const struct constrain_piece *); /* constrain_far.c */

/* constrain_points.c: points that are loaded. */
int constrain_points_add(struct constrain_work *, const struct point *); /* CONSTRAIN_E_SPLIT: no room */
int constrain_points_plain(struct constrain_work *); /* adds them before there are pieces, and finds the ends of pieces again */
/* Adds them to what has pieces. *ret_again: there is no room, and all was triangulated again, without pieces. */
int constrain_points_insert(struct constrain_work *, bool *ret_again);

/* constrain_disc.c: verification. Adds a flagged triangle; loads what is in the discs. */
int constrain_disc_add(struct constrain_work *, uint32_t triangle);
int constrain_disc_flush(struct constrain_work *);

/* constrain_sight.c: what is visible from a triangle in its disc. Sets sight and box, and adds to the sights of the batch. */
void constrain_sight_follow(struct constrain_work *, struct constrain_disc *);
/* Whether what is visible in triangle i of those in which a disc sees may meet the box; in one of them. */
bool constrain_sight_meets(const struct constrain_work *, const struct constrain_disc *, uint32_t i, const int32_t box[4]);
bool constrain_sight_box(const struct constrain_work *, const struct constrain_disc *, const int32_t box[4]);
/* The triangles in which a disc sees that meet the box; returns how many, of which the first `most` are set. */
uint32_t constrain_sight_list(const struct constrain_work *, const struct constrain_disc *, const int32_t box[4],
			      struct constrain_hit *ret, uint32_t most);
static inline bool constrain_sight_near(const struct constrain_work *w, const struct constrain_disc *d, uint32_t i,
					const int32_t at[2])
{
	const int32_t *box = w->sight[d->sight + i].box;

	return at[0] >= box[0] && at[1] >= box[1] && at[0] <= box[2] && at[1] <= box[3];
}
bool constrain_sight_in(const struct constrain_work *, const struct constrain_disc *, uint32_t i, const int32_t at[2]);
bool constrain_sight_point(const struct constrain_work *, const struct constrain_disc *, const int32_t at[2]);

/* constrain_out.c: clears the bits of chosen triangles that are out; *ret_any: there are some. */
int constrain_out(struct constrain_work *, uint64_t *chosen, bool *ret_any);

/* constrain_owner.c: the owned triangles that are crossed. */
bool constrain_owner_index(struct constrain_work *);                                    /* false: no room */
bool constrain_owner_has(struct constrain_work *, const uint32_t corner[3]);            /* one of them has the centroid */
bool constrain_owner_overlaps(const struct constrain_work *, const uint32_t corner[3]); /* one of them overlaps the triangle */

#endif
