/*
 * Regions (dyadic boxes of circumcentres), the triangles that they own, the points that they load, and the plan of a
 * mesh (docs/design/algorithm.md 3 to 5). A region is opaque outside this room.
 */
#ifndef CUT_H
#define CUT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mesh.h"
#include "view.h"

struct err;
struct ledger;
struct grid_reader;

enum { CUT_INF_X0 = 1, CUT_INF_X1 = 2, CUT_INF_Y0 = 4, CUT_INF_Y1 = 8 };

/* Lower corner, as lattice numbers + 2^31, and widths 2^wx, 2^wy. Private to engine/cut. */
struct cut_region {
	uint32_t x, y;
	uint8_t wx, wy, inf;
};

struct cut_range {
	uint64_t lo, hi;
};

#define CUT_REGION_TEXT_SIZE 64
char *cut_region_text(const struct cut_region *, char buf[CUT_REGION_TEXT_SIZE]);
bool cut_region_parse(const char *text, struct cut_region *ret);
static inline bool cut_region_same(const struct cut_region *a, const struct cut_region *b)
{
	return a->x == b->x && a->y == b->y && a->wx == b->wx && a->wy == b->wy && a->inf == b->inf;
}
/* The borders, as doubled lattice numbers (odd); INT64_MIN/MAX on infinite sides: x0, y0, x1, y1. */
void cut_region_box(const struct cut_region *, int64_t ret[4]);

/* The smallest aligned square, or 2 x 2 block of aligned squares, that contains the box with a margin (an eighth of its
 * longer side, within the lattice); all sides are infinite. For a single position: that position alone. */
void cut_region_root(const int32_t box[4], struct cut_region *ret);
/* Splits it into its lower and upper half (a square along x). False: it is one position wide. */
bool cut_region_split(const struct cut_region *, struct cut_region ret[2]);
/* The regions from which it was split, up to `root`, the nearest first, at most `most`; returns how many. */
size_t cut_region_above(const struct cut_region *root, const struct cut_region *, struct cut_region *ret, size_t most);
/* The Morton ranges of the region's finite box, ascending; returns how many (1 to 4). */
unsigned cut_region_ranges(const struct cut_region *, struct cut_range ret[4]);
bool cut_region_holds(const struct cut_region *, int32_t x, int32_t y);

/* Whether the region owns the triangle, exact (algorithm.md 3). a, b, c counter-clockwise. */
bool cut_region_owns(const struct cut_region *, const int32_t a[2], const int32_t b[2], const int32_t c[2]);

/*
 * Whether the region owns the hull edge from a to b (outside on its left): the perpendicular ray from its midpoint
 * outwards ends in the region, at infinity. Exactly one region of a plan owns it; if the ray is on a border, the lower
 * or left one.
 */
bool cut_region_owns_hull(const struct cut_region *, const int32_t a[2], const int32_t b[2]);

/* Loads exactly P_B: the region's own positions and its halo, after the view, with duplicates reduced, in Morton order,
 * to out[0..cap). The caller provides scratch memory for the halo: cut_load_scratch_bytes suffices for halos of about
 * cap / 2, more scratch for larger ones. CUT_E_FULL: own + halo do not fit cap or the scratch, and the caller splits
 * the region. *ret_need > cap is the number of positions if it is known, else an estimate from the index (known sites,
 * and records of cells that may matter). */
enum { CUT_E_FULL = 1 };
struct cut_sites;
struct cut_trace;
struct cut_load {
	struct mesh_vertex *out;
	uint8_t *weight; /* gets the number of each position's weight (view_weight_of), cap of them; NULL: not wanted */
	uint32_t cap;
	const struct cut_sites *sites; /* of the plan, for a leaf that is `known`: its halo is not read; else NULL */
	bool flat;                     /* for a leaf that is `flat`: only its own positions are loaded */
	void *scratch;
	size_t scratch_size;
	/* A valid trace (cut_valid.h) of the same region, lattice and view, or NULL: the halo is searched only as far
	 * as its sites allow. Less is read and the same is loaded, but CUT_E_FULL and *ret_need may differ; a caller
	 * that uses these tries again without it. Only its sites are used. */
	const struct cut_trace *before;
	struct cut_trace *trace; /* after cut_trace_init: records what was loaded (cut_valid.h); may be NULL */
	/* results */
	uint32_t n, own;
	struct mesh_counts counts;
};
int cut_load(struct grid_reader *, const struct view *, const struct cut_region *, struct cut_load *, uint64_t *ret_need,
	     struct err *err);
size_t cut_load_scratch_bytes(uint32_t cap);
/* Upper bound of the records in the region, before the view. */
int cut_count(struct grid_reader *, const struct cut_region *, uint64_t *ret, struct err *err);

/* A plan: leaves in order, each with an upper bound of its own positions. */
struct cut_leaf {
	struct cut_region region;
	uint64_t count; /* upper bound of its own positions, before the view (their number if `exact`) */
	bool exact;
	bool known;          /* its halo is in the plan's sites */
	bool checked, there; /* set by pipe_refine: the store was searched for it; it is stored, and valid */
	bool changed;        /* set by pipe_refine: it is stored, but for other points */
	bool fits;           /* own + halo fitted when it was last made, so the probe skips it */
	bool flat;           /* the whole plan has no triangles (cut_plan_flat), so the leaf has no halo */
	uint8_t stuck;       /* consecutive levels above it without progress */
	uint64_t above;      /* own + halo of the region from which it was split because they did not fit; else 0 */
};
struct cut_plan {
	struct cut_leaf *leaf;
	size_t n, cap;
	uint32_t load;         /* the most positions of a leaf when it was made */
	struct ledger *ledger; /* charged for `cap` leaves (LEDGER_PLAN); NULL: none */
	/* Set by the probe: sites of the halos of leaves that have few points and would read many; may be NULL. They
	 * stay valid as long as the plan, also when leaves are split. */
	struct cut_sites *sites;
	uint64_t cells_read, points_read; /* by the probe */
};
/* Makes room for n leaves. -ERR_BUSY: the ledger has not enough memory. */
int cut_plan_room(struct cut_plan *, size_t n, struct err *err);

size_t cut_sites_bytes(const struct cut_sites *);
struct cut_sites *cut_sites_free(struct cut_sites *);

/* Splits the root until each leaf has at most `load` positions. Without points there are no leaves. Charges the grid's
 * ledger. */
int cut_plan_make(struct grid_reader *, uint32_t load, struct cut_plan *ret, struct err *err);
/* A plan in two levels: the leaves of cut_plan_make with `load` that lie in `top`, a leaf of the plan with the same or a larger
 * load, in order. `alone`: that plan has no other leaf. */
int cut_plan_below(struct grid_reader *, const struct cut_region *top, bool alone, uint32_t load, struct cut_plan *ret,
		   struct err *err);
/* Replaces leaf i by its two halves, in order. `need`: from cut_load, for the text of an error: -ERR_LIMIT when eight
 * levels made no progress (algorithm.md 5). */
int cut_plan_split(struct cut_plan *, size_t i, struct grid_reader *, uint64_t need, uint32_t cap, struct err *err);
/* The same for a leaf that fits: its halves fit, too. *ret is false if it is one position wide. */
int cut_plan_halve(struct cut_plan *, size_t i, struct grid_reader *, bool *ret, struct err *err);
/*
 * Before the first triangle: ensures that own + halo of the leaves at the rim, and of nearly empty leaves, fit `cap`,
 * and splits leaves that do not; -ERR_LIMIT as in cut_plan_split. Reads nothing if the index alone shows that a halo
 * fits. The halos of nearly empty leaves that would read many cells are searched together, so that each cell is read
 * once, and stay with the plan (`sites`; at most CUT_SITES_BYTES for each position of cap). `scratch`: as for cut_load;
 * halos can be searched together if it is at least twice as large.
 */
enum { CUT_SITES_BYTES = 8 };
int cut_plan_probe_rim(struct cut_plan *, struct grid_reader *, const struct view *, uint32_t cap, void *scratch,
		       size_t scratch_size, struct err *err);
void cut_plan_done(struct cut_plan *); /* empties it; the ledger stays */
/* If the plan has fewer than three positions, or all are collinear: marks its leaves as flat. Returns whether they are. */
void cut_plan_make_flat(struct cut_plan *);
static inline bool cut_plan_flat(const struct cut_plan *plan)
{
	return plan->n && plan->leaf[0].flat;
}

#endif
