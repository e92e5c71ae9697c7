/*
 * Cutting: regions (dyadic boxes of circumcentres), which triangles they own, which points they load,
 * and the plan of a mesh (docs/design/algorithm.md 3 to 5). A region is opaque outside this room.
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

/* x, y: lattice numbers + 2^31 of the lower corner; widths are 2^wx, 2^wy. Only cut/ looks inside. */
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
/* The borders as doubled lattice numbers (odd), INT64_MIN/MAX on infinite sides: x0, y0, x1, y1. */
void cut_region_box(const struct cut_region *, int64_t ret[4]);

/* The smallest aligned square, or 2 x 2 block of aligned squares, around the box with room on all sides (an eighth of its
 * longer side, as far as the lattice goes); all sides infinite. Of one position: that alone. */
void cut_region_root(const int32_t box[4], struct cut_region *ret);
/* Lower half, upper half (x first of a square). False: one position wide, cannot be split. */
bool cut_region_split(const struct cut_region *, struct cut_region ret[2]);
/* The regions that it was split out of, from `root` on, the nearest first, at most `most`; returns how many. */
size_t cut_region_above(const struct cut_region *root, const struct cut_region *, struct cut_region *ret, size_t most);
/* The Morton ranges that make up the region's finite box; returns how many (1 to 4), ascending. */
unsigned cut_region_ranges(const struct cut_region *, struct cut_range ret[4]);
bool cut_region_holds(const struct cut_region *, int32_t x, int32_t y);

/* Owner test, exact (algorithm.md 3). a, b, c counter-clockwise. */
bool cut_region_owns(const struct cut_region *, const int32_t a[2], const int32_t b[2], const int32_t c[2]);

/*
 * Likewise of an edge of the hull, from a to b with the outside on its left: whether the ray that leaves it at a right
 * angle from its middle ends in the region, at infinity. Of the regions of a plan one owns it; of the lower or left one,
 * where the ray runs along a border.
 */
bool cut_region_owns_hull(const struct cut_region *, const int32_t a[2], const int32_t b[2]);

/* Load exactly P_B: the region's own positions and its halo, after the view, duplicates reduced, in
 * Morton order, into out[0..cap). Scratch memory for the halo comes from the caller: cut_load_scratch_bytes
 * holds halos of about cap / 2, more scratch more. CUT_E_FULL: own + halo do not fit cap or the scratch; the
 * caller splits the region. *ret_need > cap is the number of positions where it is known, else an estimate from
 * the index (known sites and the records of cells that may still matter). */
enum { CUT_E_FULL = 1 };
struct cut_sites;
struct cut_trace;
struct cut_load {
	struct mesh_vertex *out;
	uint32_t cap;
	const struct cut_sites *sites; /* of the plan, for a leaf that is `known`: its halo is not read; else NULL */
	bool flat;                     /* of a leaf that is `flat`: only its own positions are loaded */
	void *scratch;
	size_t scratch_size;
	/* NULL; or a trace of the same region, lattice and view that stands (cut_valid.h) and fits: the halo is looked for no
	 * farther out than its sites let it be. Less is read, what is loaded is the same; but CUT_E_FULL and *ret_need may
	 * differ: who goes by these asks again without. Of it only sites are looked at. */
	const struct cut_trace *before;
	struct cut_trace *trace; /* NULL; or after cut_trace_init: what was loaded goes in here (cut_valid.h) */
	/* results */
	uint32_t n, own;
	struct mesh_counts counts;
};
int cut_load(struct grid_reader *, const struct view *, const struct cut_region *, struct cut_load *, uint64_t *ret_need,
	     struct err *err);
size_t cut_load_scratch_bytes(uint32_t cap);
/* Records in the region, before the view, at most. */
int cut_count(struct grid_reader *, const struct cut_region *, uint64_t *ret, struct err *err);

/* The plan: leaves in order, each with an upper bound of its own positions. */
struct cut_leaf {
	struct cut_region region;
	uint64_t count; /* own positions at most, before the view (their number if `exact`) */
	bool exact;
	bool known;         /* its halo is in the plan's sites */
	bool looked, there; /* pipe_refine: it was looked for in the store; it is there, and unchanged */
	bool changed;       /* likewise: what is there is of other points */
	bool fits;          /* own + halo fitted when it was made last: the probe passes it */
	bool flat;          /* the whole plan is of positions without triangles (cut_plan_flat): it has no halo */
	uint8_t stuck;      /* consecutive levels without progress above it */
	uint64_t above;     /* own + halo of the region it was cut out of because they did not fit; else 0 */
};
struct cut_plan {
	struct cut_leaf *leaf;
	size_t n, cap;
	uint32_t load;         /* it was made with: positions of a leaf at most */
	struct ledger *ledger; /* that `cap` leaves are taken from (LEDGER_PLAN); NULL: none */
	/* By the probe: sites of the halos of leaves that have few points and would read many; NULL: none. The same
	 * as long as the plan lives, also when leaves split. */
	struct cut_sites *sites;
	uint64_t cells_read, points_read; /* by the probe */
};
/* Room for n leaves. -ERR_BUSY: the ledger has none. */
int cut_plan_room(struct cut_plan *, size_t n, struct err *err);

size_t cut_sites_bytes(const struct cut_sites *);
struct cut_sites *cut_sites_free(struct cut_sites *);

/* What a refusal reckons: bytes a position of a domain. err.need has the positions. */
enum { CUT_BYTES_PER_POSITION = 80 };

/* Split the root until each leaf has at most `load` positions. No points: no leaves. Its ledger is the grid's. */
int cut_plan_make(struct grid_reader *, uint32_t load, struct cut_plan *ret, struct err *err);
/* Replace leaf i by its two halves (in order). `need` as cut_load said, for the error's text:
 * -ERR_LIMIT when eight levels brought no progress (algorithm.md 5). */
int cut_plan_split(struct cut_plan *, size_t i, struct grid_reader *, uint64_t need, uint32_t cap, struct err *err);
/* Likewise, but for no need: what fits fits in halves too. False in *ret: it is one position wide. */
int cut_plan_halve(struct cut_plan *, size_t i, struct grid_reader *, bool *ret, struct err *err);
/*
 * Before the first triangle: see to it that own + halo fit `cap` of the leaves at the rim and of those that are nearly
 * empty, and split what does not; -ERR_LIMIT as cut_plan_split. Where the index alone shows that a halo fits nothing
 * is read. The halos of nearly empty leaves that would read many cells are found together, each cell read once, and
 * stay with the plan (`sites`; at most CUT_SITES_BYTES for a position of cap). `scratch` as for cut_load; with twice
 * as much or more of it halos can be found together.
 */
enum { CUT_SITES_BYTES = 8 };
int cut_plan_probe_rim(struct cut_plan *, struct grid_reader *, const struct view *, uint32_t cap, void *scratch,
		       size_t scratch_size, struct err *err);
void cut_plan_done(struct cut_plan *); /* empty again, the ledger stays */
/* Of a plan whose positions are fewer than three or all collinear: marks its leaves; whether they are marked. */
void cut_plan_make_flat(struct cut_plan *);
static inline bool cut_plan_flat(const struct cut_plan *plan)
{
	return plan->n && plan->leaf[0].flat;
}

#endif
