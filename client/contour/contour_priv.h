/* Shared by the files of this room: levels (contour_level.c), triangles to segments (contour.c), the window (contour_cut.c),
 * segments to pieces of lines (contour_chain.c), pieces to lines (contour_join.c, contour_array.c), points (contour_line.c),
 * lines with fewer vertices (contour_simplify.c). */
#ifndef CONTOUR_PRIV_H
#define CONTOUR_PRIV_H

#include "contour.h"

typedef __int128 contour_i128;

/* The nearest double to n / d, ties to even; d > 0, below 2^60. */
double contour_nearest(contour_i128 n, contour_i128 d);

/* ---- levels: contour_level.c ---- */

/* Level i has the lattice number (i * p + r) / q, and 0 <= r < p; its number is i - shift outside of this room. Of a height h the
 * highest level that is not above it is floor((h * q - r) / p): a vertex is up for this level and all lower ones. */
struct contour_levels {
	int64_t p, q, r, shift;
	double inverse; /* of p */
	bool decimal;   /* base and interval are whole multiples of 10^exponent */
	int64_t base, interval;
	int32_t exponent;
	/* else (i * interval_n + base_n) / den */
	contour_i128 interval_n, base_n, den;
	int decimals; /* of heights that are not decimal */
};
int contour_levels_init(struct contour_levels *, const struct acut_mesh_head *, const struct contour_options *, struct err *err);
static inline int64_t contour_levels_of(const struct contour_levels *l, int32_t height)
{
	int64_t n = height * l->q - l->r, i = (int64_t)((double)n * l->inverse); /* near, and a division is slower than this */

	while (i * l->p > n)
		i--;
	while ((i + 1) * l->p <= n)
		i++;
	return i;
}

/* ---- crossings ---- */

/* A point of the plane as one number; they are in the order of (x, y). */
static inline uint64_t contour_key(const int32_t at[3])
{
	return (uint64_t)((uint32_t)at[0] ^ 0x80000000u) << 32 | ((uint32_t)at[1] ^ 0x80000000u);
}
static inline int32_t contour_key_x(uint64_t key)
{
	return (int32_t)((uint32_t)(key >> 32) ^ 0x80000000u);
}
static inline int32_t contour_key_y(uint64_t key)
{
	return (int32_t)((uint32_t)key ^ 0x80000000u);
}

/* Where an edge has a level: at n / d of its way from its lesser end (x, y) to the greater one, whatever triangle it is seen
 * from. */
struct contour_crossing {
	uint64_t end[2];
	int64_t n, d; /* 0 <= n <= d, d > 0 */
};
struct contour_crossing contour_cross(const struct contour_levels *, const int32_t *a, const int32_t *b, int64_t level);
/* Its coordinates: the nearest doubles, unless the numbers have too many digits. */
void contour_place(const struct contour_axis axis[2], const struct contour_crossing *, double ret[2]);
/* Of the number n / q. */
double contour_border(const struct contour_axis *, contour_i128 n, int64_t q);
/* Of a place between lattice points. */
double contour_between(const struct contour_axis *, double number);

/* ---- the window: contour_cut.c ---- */

enum contour_inside { CONTOUR_OUTSIDE, CONTOUR_ACROSS, CONTOUR_INSIDE };
int contour_cut_init(struct contour *, const struct acut_mesh_head *, struct err *err);
void contour_cut_done(struct contour *);
enum contour_inside contour_cut_inside(const struct contour *, const int32_t *const v[3]);
/* The parts of a segment of a triangle that are in the window. */
int contour_cut(struct contour *, const int32_t *const v[3], const struct contour_crossing *from,
		const struct contour_crossing *to, int64_t level, struct err *err);

/* ---- tiles: contour_tile.c ---- */

struct contour_tile {
	int64_t at[2];    /* column and row: from at * p / q of the absolute numbers on */
	int64_t range[2]; /* levels of its lines */
	bool any;
};
struct contour_tiles {
	uint64_t p, q; /* p 0: there are none */
	int64_t k[2];
	unsigned most;
	struct contour_tile *tile;
	size_t n, nslot;
	uint32_t *slot; /* 1 + which tile, by a hash of its place */
	int64_t middle; /* level of the first line */
};
void contour_tiles_init(struct contour_tiles *, const struct acut_mesh_head *, const struct contour_options *);
void contour_tiles_done(struct contour_tiles *);
/* The column or row of a crossing. */
int64_t contour_tiles_of(const struct contour_tiles *, int axis, const struct contour_crossing *);
/* Whether a crossing is before a border (-1), on it, or behind it. */
int contour_tiles_beside(const struct contour_tiles *, int axis, const struct contour_crossing *, int64_t line);
/* Whether a triangle is in one tile. */
bool contour_tiles_same(const struct contour_tiles *, const int32_t *const v[3], int64_t ret[2]);
/* A border as a local lattice number, times q. */
contour_i128 contour_tiles_border(const struct contour_tiles *, int axis, int64_t line);
/* What stands for the level in pieces; -ERR_USAGE: too many tiles. And what it stands for. */
int contour_tiles_key(struct contour_tiles *, const int64_t at[2], int64_t level, int64_t *ret, struct err *err);
int64_t contour_tiles_level(const struct contour_tiles *, int64_t key);
struct contour_tile *contour_tiles_tile(const struct contour_tiles *, int64_t key); /* NULL: there are no tiles */

/* ---- segments to pieces: contour_chain.c ---- */

/* A piece of a line, as it is in the annex; `count` points of two doubles are at `at`. */
struct contour_piece {
	int64_t level;
	uint64_t from[2], to[2]; /* edges of its ends; of one that is closed or cut there, not to be joined */
	uint64_t least[2];       /* the least of its edges, in which a closed line begins */
	uint64_t at;
	uint32_t count, least_index;
	uint32_t flags;
	uint32_t cut; /* which cut of its segment the piece begins at; 0: it begins at an edge */
};
enum { CONTOUR_CLOSED = 1, CONTOUR_CUT_FROM = 2, CONTOUR_CUT_TO = 4 };
/* What is written at once: so many pieces, one behind the other, then their points. */
struct contour_batch {
	uint64_t pieces, points;
};

struct contour_chains;
int contour_chains_new(unsigned segments, struct contour_chains **ret, struct err *err);
struct contour_chains *contour_chains_free(struct contour_chains *);

/* ---- arrays of numbers that may be larger than the memory: contour_array.c ---- */

struct contour_array;
int contour_array_new(const struct outfile *beside, unsigned pages, struct contour_array **ret, struct err *err);
/* *ret: the number of this index, 0 if it was never set, valid until the next call. `change`: it will be written. */
int contour_array_at(struct contour_array *, uint64_t index, bool change, uint64_t **ret, struct err *err);
struct contour_array *contour_array_free(struct contour_array *);

/* ---- all of it ---- */

enum { CONTOUR_POINTS = 4096 }; /* that are read at once */
enum { CONTOUR_CELLS = 256 };   /* a side */

/* Where the reader of a line is. */
struct contour_reader {
	uint64_t first, piece; /* numbers of pieces */
	bool closed;
	uint32_t start; /* of a closed line: the first point's index in its first piece */
	uint64_t at;    /* of the next point */
	uint32_t left;  /* points of this piece */
	unsigned phase; /* of a closed line: 1: its first piece comes again, 2: its first point */
	bool ended;
	double last[2]; /* the point before, and whether there is one */
	bool any;
	bool whole; /* the buffer has all of the line, and it was not handed out yet */
	size_t n;
	double first_point[2];
	double buffer[CONTOUR_POINTS][2];
};

struct contour {
	struct outfile *out, *annex;
	struct contour_options opt;
	struct contour_levels levels;
	struct contour_tiles tiles;
	struct area *area;    /* the window; NULL: none */
	struct area_way *way; /* through it */
	struct contour_chains *chains;
	struct contour_work *work; /* while a block is worked on */
	int64_t seen_levels[2];    /* of the lowest and the highest corner */
	bool any_levels;
	uint64_t pieces; /* in the annex */
	/* after contour_join */
	struct contour_array *link; /* CONTOUR_LINKS numbers a piece */
	struct contour_array *seen; /* while lines are found: a bit a piece */
	uint64_t passed;            /* so many */
	struct sort *lines;
	int64_t range[2];
	bool any;
	const uint64_t *next;      /* the record of a line that was not handed out; NULL: it is the next of the sort */
	struct contour_tile *tile; /* whose lines are handed out; NULL: there are no tiles */
	bool waits;                /* its first line, `first`, was found by contour_next_tile */
	struct contour_line first;
	struct contour_reader reader;
	struct contour_simple *simple; /* NULL: lines as they are */
	struct contour_simplified simplified;
};

/* An end of a segment, or of a part of it: a crossing, or, with the number of the cut, a place between it and the next one. */
struct contour_end {
	const struct contour_crossing *edge;
	uint32_t cut;
	double at[2];
};
/* A directed segment in the triangle; up is on its left. The pieces go to the annex first if the table is full. */
int contour_chains_add(struct contour *, const struct contour_end end[2], int64_t level, struct err *err);
/* Pieces to the annex; the table is empty then. */
int contour_chains_flush(struct contour *, struct err *err);

/* What is known of a piece, in one page: the next one with a mark and how many points it has; where it is in the annex; where
 * its points are; the first word of its least edge, so that the piece itself is read where that does not tell it only. */
enum { CONTOUR_NEXT, CONTOUR_AT, CONTOUR_POINTS_AT, CONTOUR_LEAST, CONTOUR_LINKS };
enum { CONTOUR_COUNT_SHIFT = 48 }; /* a piece has no more points than the table of crossings, which has less than 2^16 */
#define CONTOUR_HAS_PREVIOUS (1ull << 47)
#define CONTOUR_NUMBER (CONTOUR_HAS_PREVIOUS - 1) /* of the next piece, from 1; 0: there is none */
/* *ret: the words of the piece, valid until the next call. */
int contour_link(struct contour *, uint64_t number, bool change, uint64_t **ret, struct err *err);
static inline int contour_interrupted(const struct contour *c)
{
	return c->opt.interrupted && c->opt.interrupted(c->opt.ctx);
}

/* What contour_join has made but the annex. */
void contour_joined_free(struct contour *);

/* ---- lines with fewer vertices: contour_simplify.c ---- */

struct contour_simple;
/* Takes all lines; the next ones come from c->simple. */
int contour_simplify(struct contour *c, struct err *err);
int contour_simple_next(struct contour_simple *, struct contour_line *ret, struct err *err);
int contour_simple_points(struct contour_simple *, const double (**ret)[2], size_t *ret_n, struct err *err);
struct contour_simple *contour_simple_free(struct contour_simple *);

#endif
