/*
 * The steps of a mesh, one function each: ingest, plan, domain, emit. No threads, no waiting, no clock:
 * whoever calls decides when and where. daemon/run and daemon/push call them from workers, acut-domain from main.
 */
#ifndef PIPE_H
#define PIPE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "crs_geo.h"
#include "cut.h"
#include "cut_valid.h"
#include "digest.h"
#include "grid.h"
#include "input.h"
#include "lattice.h"
#include "mesh.h"
#include "store.h"
#include "view.h"

struct err;
struct ledger;

/* ---- ingest: one input into a stage ---- */

struct pipe_ingested {
	uint64_t points;                  /* read and staged */
	uint64_t moved;                   /* of these, rounded to the lattice */
	double max_shift[3];              /* largest move, in coordinates */
	struct crs_shift shift;           /* of the heights, by a geoid */
	uint64_t bytes_read, bytes;       /* of the file: for its points; all */
	uint64_t left_out, left_out_line; /* as of input_info */
	bool partial;                     /* not all points were read, see input_options.has_crop */
	char warning[256];
	uint64_t returns[16];    /* by return number */
	int64_t low[3], high[3]; /* box of the raw numbers; where there are points */
};

/* Memory that pipe_ingest takes besides the stage; charge it before. */
size_t pipe_ingest_bytes(void);
typedef int (*pipe_progress_fn)(void *ctx, uint64_t points);
struct pipe_ingest_params {
	const struct lattice *lattice;
	struct grid_stage *stage;
	const struct crs_step_params *step; /* where a point is more than scaled; lattice and coords are put in here */
	bool split;                         /* the stage is, for several parts of one input that go into it at once */
	uint64_t before;                    /* points that calls for the same input took before; for messages */
	pipe_progress_fn progress;          /* may be NULL; called now and then with this call's points so far;
					     * non-zero from it cancels (-ERR_CANCELLED) */
	void *ctx;
};
/* Read all of `input` (or of the part that it is, input_open_part) into the stage, as the source that
 * grid_stage_source named last. PIPE_E_DRY: all that the input's pipe had; *ret has what came by this call, and
 * another call with the same input goes on. */
enum { PIPE_E_DRY = 3 };
int pipe_ingest(struct input *input, const struct pipe_ingest_params *, struct pipe_ingested *ret, struct err *err);
/* Adds what another part of the same input gave. */
void pipe_ingested_add(struct pipe_ingested *sum, const struct pipe_ingested *part);
/* When all of the input was read: adds to the warning what its header says otherwise than its points. */
void pipe_ingested_compare(struct pipe_ingested *, const struct input_info *);

/* ---- inspect: what is in the records of one input ---- */

enum { PIPE_HULL_MOST = 4096 };
struct pipe_inspected {
	uint64_t points, distinct;         /* read; distinct xy positions of these */
	double min[3], max[3];             /* of the records, in coordinates; without points zeros */
	double inner_min[3], inner_max[3]; /* of 99.9 % of them at least: beyond each side lie no more than a 6,000th */
	struct mesh_most most;             /* the position that most of them share, on the lattice, */
	double most_at[2];                 /* and in coordinates */
	uint64_t classes[256];
	uint64_t returns[16], return_counts[16]; /* by return number, by number of returns */
	uint64_t flags[4];                       /* withheld, synthetic, key-point, overlap */
	double hull[PIPE_HULL_MOST][2];          /* convex hull of the positions, counter-clockwise, in coordinates */
	size_t nhull;
	bool hull_thinned; /* it has more corners: those here are some of them */
	double hull_area;  /* in squares of the unit of coordinates */
};
struct pipe_inspect_params {
	const struct lattice *lattice; /* of this input alone */
	struct grid_stage *stage;      /* empty; sealed by this */
	int dirfd;                     /* the stage's folder and name: what it leaves there is removed */
	const char *name;
	pipe_progress_fn progress; /* as of pipe_ingest */
	void *ctx;
};
/* Memory besides the stage, what reading takes, and *ret. */
size_t pipe_inspect_bytes(void);
/* Reads all of the input. */
int pipe_inspect(struct input *, const struct pipe_inspect_params *, struct pipe_inspected *ret, struct err *err);

/* ---- plan ---- */

/* The memory that the lowest rung needs; NULL: of a grid of one segment. */
size_t pipe_budget_least(const struct grid *);
enum { PIPE_RUNGS = 4 };
extern const uint32_t pipe_rung[PIPE_RUNGS]; /* 2^15, 2^17, 2^19, 2^20 positions */

struct pipe_budget {
	uint32_t load;       /* positions a leaf may own: a rung */
	uint32_t cap;        /* positions an arena carries: own + halo */
	size_t domain_bytes; /* of one domain, all of it */
	unsigned threads;    /* domains at once */
};
/* The highest rung that `memory` carries with `threads`; fewer threads only where not even the lowest does.
 * -ERR_LIMIT with the number if not even the lowest fits one thread. `grid` may be NULL (reader bytes
 * of one segment are assumed). */
int pipe_budget(uint64_t memory, unsigned threads, const struct grid *grid, struct pipe_budget *ret, struct err *err);

/* The same for a plan that was made before: exactly its load and cap, with as many threads as `memory` carries.
 * -ERR_LIMIT if not even one domain fits. */
int pipe_budget_kept(uint64_t memory, unsigned threads, const struct grid *grid, uint32_t load, uint32_t cap,
		     struct pipe_budget *ret, struct err *err);

/* The regions of a mesh, in `memory` of budget->domain_bytes. Where the view's positions are fewer than three or all collinear
 * the leaves are `flat`: their domains are vertices without triangles. PIPE_E_EMPTY: there is nothing to emit (no position, or
 * flat ones in a view with a window); *ret_empty has the counts for pipe_emit_empty, and *ret is empty. -ERR_LIMIT: it cannot
 * fit, with the number that would do. */
enum { PIPE_E_EMPTY = 2 };
/* Of a view with a window the leaves are the pieces of the window, and `domains` are the triangles that meet them. */
int pipe_plan(const struct grid *grid, const struct view *view, const struct pipe_budget *budget, void *memory,
	      struct cut_plan *ret, struct mesh_counts *ret_empty, struct err *err);
/* Its two steps, for who has something to do between them (pipe_refine): the leaves, and the look ahead at their halos.
 * The second empties the plan where it fails. */
int pipe_plan_make(const struct grid *grid, const struct view *view, const struct pipe_budget *budget, void *memory,
		   struct cut_plan *ret, struct mesh_counts *ret_empty, struct err *err);
int pipe_plan_probe(const struct grid *grid, const struct view *view, const struct pipe_budget *budget, void *memory,
		    struct cut_plan *plan, struct err *err);

/* cut_plan_split for a plan of pipe_plan, whatever its view. */
int pipe_plan_split(struct cut_plan *plan, size_t i, struct grid_reader *reader, const struct view *view, uint64_t need,
		    uint32_t cap, struct err *err);

/* ---- domain: one region to a finished domain ---- */

/* What is known of a region beforehand, or NULL. The domain is the same with and without, but for `flat`. */
struct pipe_known {
	const struct cut_sites *sites;    /* of the plan, if the leaf is `known` */
	const struct pipe_before *before; /* by pipe_before */
	bool flat;                        /* the leaf is: its own positions, and no triangles */
};
/* Everything in `memory` of budget->domain_bytes; *ret points into it. PIPE_E_SPLIT: own + halo do not fit; *ret_need
 * positions would. */
enum { PIPE_E_SPLIT = 1 };
int pipe_domain(const struct grid *grid, const struct view *view, const struct cut_region *region, const struct pipe_known *known,
		const struct pipe_budget *budget, void *memory, struct mesh_domain *ret, uint64_t *ret_need, struct err *err);
/* Bytes of `memory` from its start that *domain and its trace need to stay valid. */
size_t pipe_domain_held(const struct mesh_domain *domain, const void *memory);

/* ---- reuse: finished domains kept in a store, and found again in any generation that has the same points ---- */

/* What does not depend on the region, for the many regions of a mesh. */
struct pipe_key {
	struct digest content; /* of the generation */
	struct digest part[2]; /* lattice, view */
};
void pipe_key_init(struct pipe_key *, const struct grid *grid, const struct view *view);
/* Of a region under lattice, view and kernel, whatever the generation. */
struct digest pipe_key_of(const struct pipe_key *, const struct cut_region *region);
/* All that the blocks of a mesh depend on but for its plan; `root`: any region. */
struct digest pipe_key_mesh(const struct pipe_key *, const struct cut_region *root);

/* A domain in the store. */
struct pipe_stored {
	struct store_id id;
	struct digest digest;               /* of its triangles */
	uint64_t payload, triangles, bytes; /* as store.h has them */
	int64_t used_ns;                    /* when it was used before it was found; 0 of what was kept */
};
/* Of a domain in the store what is worth remembering, so that whoever plans later generations need not read its file: its
 * numbers, and of its proof what boxes need (cut_far). No pointer in it is of use. */
struct pipe_summary {
	struct store_id id;
	struct store_front front; /* `beside.content`: of a generation in which it stands */
	struct cut_reach reach;
	struct cut_live live;
};
/* Keep what pipe_domain made in `memory`, as long as nothing else was done there. `ret_summary`: NULL, or what can be remembered
 * of it. */
int pipe_keep(int storefd, const struct pipe_key *, const struct cut_region *region, const struct mesh_domain *,
	      const void *memory, struct pipe_stored *ret, struct pipe_summary *ret_summary, struct err *err);

struct pipe_reuse_params {
	int storefd;
	const struct grid *grid;
	const struct view *view;
	const struct pipe_key *key;
	const struct cut_region *region;
	uint32_t load, cap; /* of the budget */
	void *memory;
	size_t size;                /* of a domain's budget */
	bool light;                 /* the front is enough: what pipe_emit needs without a sink */
	bool sums;                  /* not even that is needed: no array of *ret is there (pipe_emitter_sums) */
	int64_t after_ns;           /* what was used last before this time is known not to do */
	struct grid_reader *reader; /* that is open on the grid; NULL: one is made in `memory` */
	/* The list of what was kept or used last of a base, as far as somebody remembers (false: nobody does): it is asked for
	 * before the folder is, and checked as anything else is. NULL: the folder is asked. */
	bool (*hint)(void *ctx, struct digest base, struct digest *ret_list);
	/* What is remembered of a base (false: nothing), asked for before all else, but not where its front is wanted; and what
	 * is to be remembered. Where that tells that the domain stands, and its file is there and has that size, the file is not
	 * read to find it. NULL, either: nobody does. */
	bool (*recall)(void *ctx, struct digest base, struct pipe_summary *ret);
	void (*remember)(void *ctx, const struct pipe_summary *);
	/* pipe_refine: of each leaf that is `there` at the end, as pipe_reuse has it with `sums`; NULL: nobody asks. */
	void (*there)(void *ctx, const struct cut_region *, const struct mesh_domain *, const struct pipe_stored *);
	void *ctx;         /* of all of these */
	unsigned *damaged; /* counts those that were damaged, and are removed; NULL: nobody asks */
};
/* A domain of the store that is what pipe_domain would make: of this generation's content, or of another's that is the
 * same for this region. Of several the one used last. *ret lies in *ret_held bytes at the start of `memory`.
 * PIPE_E_ABSENT: there is none, none that fits `memory`, or what there is cannot be told to be the same. */
enum { PIPE_E_ABSENT = 4 };
int pipe_reuse(const struct pipe_reuse_params *, struct mesh_domain *ret, struct pipe_stored *ret_stored, size_t *ret_held,
	       struct err *err);

/* Of a region that is to be made again: what it stood on when it was stored last bounds its halo now, if all that was there then
 * still is. False: it is not known, or not so; *ret is of no use. `memory` is used, nothing in it is needed later. */
struct pipe_before {
	struct cut_trace trace;
	struct point site[4 * CUT_TRACE_SITES];
};
bool pipe_before(const struct pipe_reuse_params *, struct pipe_before *ret);

/*
 * Between the steps of a plan: of few leaves that have changed since they were stored smaller ones are made, so that several
 * threads share them, and the next change there finds more of them unchanged. Those that are stored are marked `fits`:
 * whether their halos fit was seen when they were made, and if it changed, it is seen when they are made again; and `there`, if
 * they are what pipe_domain would make. `region`, `light` and `sums` of the parameters do not matter.
 */
int pipe_refine(const struct pipe_reuse_params *, struct cut_plan *, struct err *err);
/*
 * Its steps, for who has several threads: where pipe_refines, pipe_refine_new; pipe_look until one says PIPE_E_LOOKED, by each
 * with parameters and `memory` of his own, of pipe_look_bytes at least, and pipe_look_reader before the first (`there` is then
 * called by any of them, at any time); when all have come back, pipe_refine_cut by one. An error by any of them is that of
 * pipe_refine. The plan is nobody else's meanwhile.
 */
struct pipe_refine;
enum { PIPE_E_LOOKED = 6 };                                      /* there is no leaf left to begin */
bool pipe_refines(const struct view *, const struct cut_plan *); /* else there is nothing to do */
size_t pipe_look_bytes(const struct grid *);
int pipe_refine_new(struct cut_plan *, struct pipe_refine **ret, struct err *err); /* `plan` is borrowed */
struct pipe_refine *pipe_refine_free(struct pipe_refine *);                        /* NULL is fine; returns NULL */
int pipe_look_reader(struct pipe_reuse_params *, struct err *err);                 /* sets `reader`, which lies in `memory` */
int pipe_look(struct pipe_refine *, const struct pipe_reuse_params *, struct err *err);
int pipe_refine_cut(struct pipe_refine *, const struct pipe_reuse_params *, struct err *err);

/* ---- emit: finished domains, in plan order, to numbered blocks ---- */

struct pipe_emitter;

struct pipe_totals {
	uint64_t vertices, triangles, hull, domains;
	struct mesh_counts counts;
	struct digest digest, vertex_digest;
	int32_t box[6];    /* of the vertices: min x y z, max x y z */
	double most_at[2]; /* the place of counts.most, in coordinates; if it has points */
};

/* `memory`: bytes for the table of unfinished vertices (charged by the caller); beyond them it spills
 * into an unlinked file in `tempdirfd`. */
int pipe_emitter_new(const struct lattice *lattice, size_t memory, int tempdirfd, struct pipe_emitter **ret, struct err *err);
/* Of a domain that pipe_reuse gave `light` (`triangle` is NULL) only the totals are made: no sink may be there. */
/* The next domain of the plan. Calls sink->block once (sink may be NULL: counted and digested only).
 * Domains without vertices give no block. The arrays of the block are those of the domain, renumbered in
 * place: they stay valid as long as the domain's memory, also after this returns. */
int pipe_emit(struct pipe_emitter *, struct mesh_domain *, const struct cut_region *, const struct mesh_sink *, struct err *err);
/* Before the first domain: they are those of a window. The mesh has a border that is not the hull's, so it is not held
 * against Euler's count; totals.hull is 0. */
void pipe_emitter_part(struct pipe_emitter *);
/* Before the first domain, or to begin again: nobody will read (true), or somebody will (false, as at first). Sums need the
 * counts, digests and numbers of a domain and none of its arrays; no sink may be there, and the order of domains does not
 * matter. The totals are the same. */
void pipe_emitter_sums(struct pipe_emitter *, bool sums);
/* Instead of any domain: the counts of a plan that is empty (PIPE_E_EMPTY). */
void pipe_emit_empty(struct pipe_emitter *, const struct mesh_counts *counts);
/* After the last domain: totals. Vertices still open are the hull. -ERR_INTERNAL if the mesh is not whole
 * (a link that should have closed). */
int pipe_emitter_finish(struct pipe_emitter *, struct pipe_totals *ret, struct err *err);
struct pipe_emitter *pipe_emitter_free(struct pipe_emitter *);
/* Bytes of its file: the part of its table that does not fit its memory. */
uint64_t pipe_emitter_spilled(const struct pipe_emitter *);

#endif
