/* The insides of a halo that is being found, shared by cut_halo.c, cut_halo_seed.c and cut_halo_take.c. */
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
	BATCH_SHARE = 32, /* one batch, of the memory for points */
	LIST = 512,
	SWEEP = 256,
	ROUNDS = 200,
	SEED_COLUMNS = 1024,
	SEED_BLOCKS = 1024,
	SEED_GROUPS = 64,
	SEED_BLOCK_BITS = 5,  /* at least */
	SEED_COLUMN_BITS = 4, /* likewise */
	TAKE_COLUMNS = 16,
	TAKE_MANY = 96,
	NONE = UINT32_MAX,
};

struct noted {
	int64_t x; /* distance of the cell's box from the line; INT64_MAX: nothing noted */
	struct grid_cell cell;
};

/* What of the cell that is being read a chain asks for: by columns along it, no point farther from it than this. */
struct take {
	unsigned chain, shift;
	unsigned across; /* 0: x, 1: y */
	int64_t c2, u0;
	int32_t from; /* what is within the largest limit lies in [from, from + wide] across */
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
	/* Of sites known before: E of these is nowhere below that of all. */
	bool bounded;
	struct cut_chain bound[4];
	struct point bound_site[4 * CUT_TRACE_SITES];
	int32_t box[4];                   /* of all cells */
	int64_t u0[4], u1[4];             /* what the columns of each chain span in this round */
	unsigned columns;                 /* in use */
	unsigned rounds;                  /* limit */
	unsigned block_bits, column_bits; /* of seeding, at least */
	uint32_t many; /* points of a cell that pass: from more than these on they are held against each other */
	struct seen *seen;
	uint32_t seen_size, seen_limit, nseen;
	/* The hits of the last walk, where they found room: those of later rounds are among them. */
	bool listed;
	uint32_t nlist, list_limit;
	struct point *pool; /* the chains in order, each with room behind it; then the batches */
	size_t pool_size;
	uint64_t cells, points;
	struct cut_trace *trace; /* NULL: not asked for */
	struct take take[4];
	unsigned ntake;
	/* sweep: the hits with the smallest keys past `after`, sorted */
	struct grid_cell after;
	bool has_after;
	uint32_t nsweep;
	uint64_t waiting;            /* estimate: records of hits not read */
	struct grid_cell list[LIST]; /* from here on each use fills its own part */
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

/* A kept point into chain i, and its batch into the chain; where it is full, with more of the pool. */
int cut_halo_add(struct cut_halo *, unsigned i, const struct point *);
int cut_halo_flush(struct cut_halo *, unsigned i);
/* Whether chain i may have a site in the box. */
bool cut_halo_hit(const struct cut_halo *, unsigned i, const int32_t box[4]);
/* What the chains ask of a cell into them. */
int cut_halo_read(struct cut_halo *, const struct grid_cell *, struct err *);

#endif
