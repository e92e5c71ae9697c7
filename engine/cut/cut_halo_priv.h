/* A halo that is being found, as cut_halo.c, cut_halo_seed.c and cut_halo_take.c share it. */
#ifndef CUT_HALO_PRIV_H
#define CUT_HALO_PRIV_H

#include "cut_chain.h"
#include "cut_halo.h"
#include "cut_judge.h"
#include "cut_valid.h"
#include "point.h"

enum {
	COLUMNS = 256,
	BATCH = 1024,
	BATCH_SHARE = 32,        /* share of each batch in the memory for points */
	MERGE_SHARE = 16,        /* share of a chain that a batch has when it is merged between two walks */
	MERGED_ALWAYS = 1 << 15, /* a chain with fewer sites is merged before each walk */
	LIST = 512,
	SWEEP = 256,
	ROUNDS = 200,
	SEED_COLUMNS = 1024,
	SEED_BLOCKS = 1024,
	SEED_GROUPS = 64,
	SEED_BLOCK_BITS = 5,  /* minimum */
	SEED_COLUMN_BITS = 4, /* minimum */
	TAKE_COLUMNS = 16,
	TAKE_MANY = 96,
	NONE = UINT32_MAX,
};

struct noted {
	int64_t x; /* distance of the cell's box from the line; INT64_MAX: no cell */
	struct grid_cell cell;
};

/* What a chain needs of the cell that is being read: for each column along it, points no farther than this. */
struct take {
	unsigned chain, shift;
	unsigned across; /* 0: x, 1: y */
	int64_t c2, u0;
	int32_t from; /* points within the largest limit are in [from, from + wide] across */
	uint32_t wide;
	int64_t limit[TAKE_COLUMNS];
};

struct seen {
	uint64_t lo, place;
	uint32_t segment;
	uint32_t used;
};

struct cut_halo {
	struct cut_source src;
	const struct view *view;
	struct cut_judge judge;
	struct cut_region region;
	bool own_known;
	struct cut_range range[4];
	unsigned nrange, nchain;
	struct cut_chain chain[4];
	/* Sites that are known from before: their E is nowhere below that of all sites. */
	bool bounded;
	struct cut_chain bound[4];
	struct point bound_site[4 * CUT_TRACE_SITES];
	int32_t box[4];                   /* of all cells */
	int64_t u0[4], u1[4];             /* start of the columns of each chain in this round */
	unsigned columns;                 /* that are used */
	unsigned rounds;                  /* limit */
	unsigned block_bits, column_bits; /* minimum, for seeding */
	uint32_t merged_always;           /* a chain with fewer sites is merged before each walk */
	uint32_t merge_share;             /* a longer one when its batch has this share of it */
	uint32_t many;                    /* if more points of a cell pass, they are compared with each other */
	struct seen *seen;
	uint32_t seen_size, seen_limit, nseen;
	/* The hits of the last walk are in `list`; those of later rounds are among them. */
	bool listed;
	uint32_t nlist, list_limit;
	struct point *pool; /* the chains in order, each with free space behind it; then the batches */
	size_t pool_size;
	uint64_t cells, points;
	struct cut_trace *trace; /* may be NULL */
	struct take take[4];
	unsigned ntake;
	/* sweep: the hits with the smallest keys after this one, sorted */
	struct grid_cell after;
	bool has_after;
	uint32_t nsweep;
	uint64_t waiting;            /* estimate: records of hits that were not read */
	struct grid_cell list[LIST]; /* below, each use initializes its own part */
	union {
		struct noted noted[4][COLUMNS];
		struct grid_cell sweep[SWEEP];
		struct {
			int32_t box[SEED_BLOCKS][4];
			uint32_t nearest[SEED_COLUMNS];
			int64_t x[SEED_COLUMNS];
			int64_t limit[SEED_COLUMNS];
			int64_t most[SEED_GROUPS];
		} seed;
	};
};

/* Adds a kept point to chain i, and merges its batch; if the chain is full, it gets more of the pool. */
int cut_halo_add(struct cut_halo *, unsigned i, const struct point *);
int cut_halo_flush(struct cut_halo *, unsigned i);
/* Whether chain i can have a site in the box. */
bool cut_halo_hit(const struct cut_halo *, unsigned i, const int32_t box[4]);
/* Reads a cell and adds what the chains need of it. */
int cut_halo_read(struct cut_halo *, const struct grid_cell *, struct err *);

#endif
