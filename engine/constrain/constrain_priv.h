/* A domain in progress, as the files of this room share it. Internal. */
#ifndef CONSTRAIN_PRIV_H
#define CONSTRAIN_PRIV_H

#include "constrain.h"
#include "cut_disc.h"
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
	SIGHTS_DISC = 16,    /* a disc for so many of them */
	HITS = 8,            /* triangles in which a disc sees, for each of a batch */
	SIGHTS_VERIFIED = 4, /* a verified triangle that is remembered */
	FAR = 512,           /* pieces that are listed and not loaded */
	INDEX = 8,           /* triangles, or boxes, under a box of the index */
	LEVELS = 12,         /* of the index */
	NONE = 0xffffffffu,
};

struct constrain_piece {
	int32_t a[2], b[2];
	bool gone;  /* an end is not kept by the view */
	bool turns; /* LINESET_OUT */
};

/* A triangle in which a disc sees, and the edge over which it was entered: its ends, as they are seen from the disc's own
 * triangle. `parent`: the triangle before; `first`: the one at the beginning of its path, behind an edge of the disc's own
 * triangle. The own one is the first in the list. */
struct constrain_sight {
	uint32_t triangle, left, right;
	uint16_t parent, first;
	uint32_t limit[2]; /* the left end and the right end that limit the view most, of (2) and (3); NONE */
	int32_t box[4];    /* of what is visible in it */
};

/* A triangle before the pieces, which one of them crosses. */
struct constrain_before {
	uint32_t place;
	struct tri_triangle triangle;
};

struct constrain_disc {
	struct cut_disc disc;
	int32_t box[4]; /* of what is visible */
	uint32_t triangle;
	uint32_t sight, nsight; /* the triangles in which it sees; none: all of the disc is visible */
};

struct constrain_hit {
	uint32_t disc, sight; /* sight: its triangle in which it sees; NONE: any */
};

/* At the end of the arena. Before it lie the pieces, which grow downwards; at the start of the arena the kernel, then the tables
 * of a turn, then the points that are loaded in it, which grow upwards. */
struct constrain_work {
	struct constrain *c;
	struct err *err;
	struct tri_result r;
	uint32_t first; /* positions of P(B) */
	uint32_t cap;   /* of the kernel, for positions that are added */
	uint8_t *at;    /* end of the tables */
	/* of all turns, sorted, then new ones: they are at the front */
	struct constrain_piece *piece;
	uint32_t npiece, nnew;
	uint32_t found; /* new ones in this turn */
	/* Pieces that meet the box of all owned triangles (`depends.box` at first), and of which an end is no vertex. The others
	 * that meet it are loaded. */
	int32_t all[4];
	struct lineset_piece far[FAR];
	uint32_t nfar;
	bool many;             /* some are not in the list */
	uint32_t *slot, nslot; /* vertices by position */
	bool filled;
	/* of a turn */
	uint64_t *chosen, *crossed; /* bits of triangles; crossed: by place, before and after the pieces */
	struct tri_pieces *p;
	struct constrain_before *before; /* all that are crossed */
	uint32_t nbefore;
	uint32_t (*own)[3]; /* the corners of owned triangles that are crossed, along the pieces */
	uint32_t nown;
	int32_t (*index[LEVELS])[4]; /* boxes of INDEX triangles, then of INDEX boxes ... */
	uint32_t nindex[LEVELS];
	unsigned levels;
	struct point *point;
	uint32_t npoint;
	struct cut_range range[4]; /* of the region */
	unsigned nrange;
	int64_t border[4]; /* of the region */
	/* the boxes for which pieces are searched, and the discs for which cells are read */
	int32_t around[4], box[BOXES][4];
	uint32_t nbox;
	int32_t disc_around[4];
	struct constrain_disc *disc;
	uint32_t ndisc, mostdisc;
	struct constrain_hit *hit; /* what meets the cell that is read */
	uint32_t nhit, mosthit;
	struct constrain_sight *sight;
	uint32_t nsight, mostsight;
	/* Triangles that were verified, by their corners: what they see is loaded, and more pieces show them nothing new. A place
	 * has one of those that belong there. */
	uint32_t (*verified)[3], nverified;
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
void constrain_triangle_box(const struct tri_result *, const uint32_t corner[3], int32_t ret[4]);
static inline bool constrain_boxes_meet(const int32_t a[4], const int32_t b[4])
{
	return a[0] <= b[2] && a[1] <= b[3] && a[2] >= b[0] && a[3] >= b[1];
}

typedef bool (*constrain_less_fn)(const void *a, const void *b);
void constrain_sort(void *array, size_t n, size_t size, constrain_less_fn less); /* of at most 32 bytes each */

/* constrain_lines.c: pieces that meet the boxes of triangles. */
int constrain_lines_all(struct constrain_work *, const int32_t box[4]); /* lists and loads those that meet the box of all */
int constrain_lines_box(struct constrain_work *, const int32_t box[4]); /* adds a box to a batch */
int constrain_lines_flush(struct constrain_work *);                     /* searches the batch */
void constrain_lines_sort(struct constrain_work *);                     /* the new ones are among the others */
/* Loads the ends of pieces that are no vertex. */
int constrain_lines_ends(struct constrain_work *);

/* constrain_points.c: vertices by position, and points that are loaded. */
bool constrain_points_reserve(struct constrain_work *); /* the table, behind the kernel; false: no room */
void constrain_points_fill(struct constrain_work *);    /* if it is not filled */
static inline uint32_t constrain_points_slot(const struct constrain_work *w, int32_t x, int32_t y)
{
	uint64_t h = ((uint64_t)(uint32_t)x << 32 | (uint32_t)y) * UINT64_C(0x9e3779b97f4a7c15);

	h = (h ^ h >> 32) * UINT64_C(0xd6e8feb86659fd93);
	return (uint32_t)((h >> 32) * w->nslot >> 32);
}
uint32_t constrain_points_find(const struct constrain_work *, int32_t x, int32_t y); /* NONE: it is no vertex */
bool constrain_points_known(struct constrain_work *, const struct point *); /* a vertex has its position, and the height */
int constrain_points_add(struct constrain_work *, const struct point *);    /* CONSTRAIN_E_SPLIT: no room */
void constrain_points_reduce(struct constrain_work *);                      /* sorts them, one for each position */
int constrain_points_merge(struct constrain_work *);                        /* the triangulation of all, without pieces */

/* constrain_disc.c: verification. Adds a flagged triangle; loads what is in the discs. */
int constrain_disc_add(struct constrain_work *, uint32_t triangle);
int constrain_disc_flush(struct constrain_work *);

/* constrain_verified.c: triangles that need not be verified again. */
bool constrain_verified(const struct constrain_work *, uint32_t triangle);
void constrain_verified_add(struct constrain_work *, uint32_t triangle);
void constrain_verified_clear(struct constrain_work *);

/* constrain_sight.c: what is visible from a triangle in its disc. Sets sight and box, and adds to the sights of the batch. */
void constrain_sight_follow(struct constrain_work *, struct constrain_disc *);
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
int constrain_out(struct constrain_work *, bool *ret_any);

/* constrain_owner.c: the owned triangles that are crossed. */
bool constrain_owner_index(struct constrain_work *); /* false: no room */
bool constrain_owner_has(const struct constrain_work *, const uint32_t corner[3]);

#endif
