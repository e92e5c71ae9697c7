/*
 * The steps of a mesh, one function each: ingest, plan, domain, emit. They have no threads and no clock and never wait;
 * the caller decides when and where they run. The daemon calls them from workers, acut-domain from main.
 */
#ifndef PIPE_H
#define PIPE_H

#include <stdatomic.h>
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

struct breakline_writer;
struct err;
struct ledger;
struct store_packer;

/* ---- ingest: one input into a stage ---- */

struct pipe_ingested {
	uint64_t points;                  /* read and staged */
	uint64_t moved;                   /* how many of these were rounded to the lattice */
	double max_shift[3];              /* largest rounding, in coordinates */
	struct crs_shift shift;           /* of the heights, by a geoid */
	uint64_t bytes_read, bytes;       /* of the file: read for its points; all */
	uint64_t left_out, left_out_line; /* as in input_info */
	bool partial;                     /* only a part was read, see input_options.has_crop */
	char warning[256];
	uint64_t returns[16];                      /* by return number */
	int64_t low[3], high[3];                   /* box of the raw numbers; only if there are points */
	uint64_t vertices_dropped, vertices_added; /* of lines: equal ones in a row; to make segments shorter */
};

/* Memory that pipe_ingest uses besides the stage; the caller charges it before. */
size_t pipe_ingest_bytes(void);
typedef int (*pipe_progress_fn)(void *ctx, uint64_t points);
struct pipe_ingest_params {
	const struct lattice *lattice;
	struct grid_stage *stage;
	/* Of an input of lines, in place of the stage; NULL: lines are refused. The unit of x and y of the dataset. */
	struct breakline_writer *lines;
	const char *unit_xy;
	/* the conversion, if it is more than a scale; its lattice and coords are set by pipe_ingest */
	const struct crs_step_params *step;
	bool split;      /* the stage is split, because several parts of one input are added at once */
	uint64_t before; /* points that earlier calls took from the same input; for messages */
	/* called now and then with the points of this call so far; non-zero cancels (-ERR_CANCELLED). May be NULL */
	pipe_progress_fn progress;
	void *ctx;
};
/* Reads all of `input` (or of the part that it is, input_open_part) into the stage, as the source of the last
 * grid_stage_source. PIPE_E_DRY: the input's pipe has no more data now; *ret covers this call, and another call with
 * the same input continues. */
enum { PIPE_E_DRY = 3 };
int pipe_ingest(struct input *input, const struct pipe_ingest_params *, struct pipe_ingested *ret, struct err *err);
/* Adds the result of another part of the same input. */
void pipe_ingested_add(struct pipe_ingested *sum, const struct pipe_ingested *part);
/* After all of the input was read: adds to the warning what differs between its header and its points. */
void pipe_ingested_compare(struct pipe_ingested *, const struct input_info *);

/* ---- inspect: statistics of the records of one input ---- */

enum { PIPE_HULL_MOST = 4096 };
struct pipe_inspected {
	uint64_t points, distinct;         /* points read; their distinct xy positions */
	double min[3], max[3];             /* of the records, in coordinates; zeros without points */
	double inner_min[3], inner_max[3]; /* box of at least 99.9 % of them: at most a 6,000th is beyond each side */
	struct mesh_most most;             /* the position with the most points, on the lattice, */
	double most_at[2];                 /* and in coordinates */
	uint64_t classes[256];
	uint64_t returns[16], return_counts[16]; /* by return number, by number of returns */
	uint64_t flags[4];                       /* withheld, synthetic, key-point, overlap */
	double hull[PIPE_HULL_MOST][2];          /* convex hull of the positions, counter-clockwise, in coordinates */
	size_t nhull;
	bool hull_thinned; /* it has more corners than fit; these are some of them */
	double hull_area;  /* in squares of the coordinates' unit */
};
struct pipe_inspect_params {
	const struct lattice *lattice; /* of this input only */
	struct grid_stage *stage;      /* empty; sealed by this */
	int dirfd;                     /* the stage's folder and name; its files are removed at the end */
	const char *name;
	pipe_progress_fn progress; /* as in pipe_ingest */
	void *ctx;
};
/* Memory for reading and for *ret, besides the stage. */
size_t pipe_inspect_bytes(void);
/* Reads all of the input. */
int pipe_inspect(struct input *, const struct pipe_inspect_params *, struct pipe_inspected *ret, struct err *err);

/* ---- plan ---- */

/* The memory that the smallest load needs; NULL: for a grid of one segment. */
size_t pipe_budget_min(const struct grid *);
enum { PIPE_LOADS = 4 };
extern const uint32_t pipe_load[PIPE_LOADS]; /* the loads that a budget can have: 2^15, 2^17, 2^19, 2^20 positions */
/* Positions of a leaf where domains are kept, whatever the memory allows. Small leaves: little is made again after a push, and
 * making all of them costs a tenth more. The arena's capacity does not depend on it. */
enum { PIPE_KEPT_LOAD = 1 << 16 };
/* Positions of a leaf of a mesh that is made once, for a reader, likewise. What a domain has mostly stays in the processor's
 * cache from its points to its last byte, and costs a tenth less than with 2^19. */
enum { PIPE_ONCE_LOAD = 1 << 18 };

struct pipe_budget {
	uint32_t load;       /* the most positions that a leaf may own: one of pipe_load, or of a wide budget */
	uint32_t cap;        /* the most positions in an arena: own + halo */
	size_t domain_bytes; /* memory of one domain in all */
	unsigned threads;    /* domains at the same time */
};
/* The largest load that fits `memory` with `threads` threads; fewer threads only if not even the smallest load fits.
 * -ERR_LIMIT, with the necessary memory, if one thread does not fit with the smallest load. `grid` may be NULL (a
 * reader of one segment is assumed). */
int pipe_budget(uint64_t memory, unsigned threads, const struct grid *grid, struct pipe_budget *ret, struct err *err);

/*
 * One thread, and room for more positions in a domain than any load has: for points in convex position, of which every region
 * needs nearly all. The cap is twice `positions` where the memory suffices, since their number is an estimate; the load is the
 * largest that the cap allows, because small leaves would all load the same points. -ERR_LIMIT: the memory has not even room for
 * `least`; *ret_need bytes would do for `positions`, UINT64_MAX if no memory does.
 */
enum { PIPE_MADE_AND_SENT = 2 };
struct pipe_wide {
	uint64_t memory;
	unsigned domains;          /* as many have to fit: PIPE_MADE_AND_SENT, if one is sent while the next is made, or 1 */
	uint64_t positions, least; /* least 0: as many as `positions`; an estimate above what the grid can need is lowered */
};
int pipe_budget_wide(const struct pipe_wide *, const struct grid *grid, struct pipe_budget *ret, uint64_t *ret_need,
		     struct err *err);
/* Whether r, from pipe_plan, its steps or pipe_plan_split, says that a region needs more positions than fit the budget, however
 * small it is. A wide budget for err->need may then have room, with which the plan is made again. */
bool pipe_budget_narrow(const struct pipe_budget *, const struct grid *, int r, const struct err *err);

/* One domain with this load, if `fixed` bytes, and `each` bytes for each position of the cap, are used beside it. -ERR_LIMIT: the
 * memory does not suffice; err->need would. */
int pipe_budget_fixed(uint32_t load, uint64_t memory, size_t fixed, size_t each, const struct grid *grid, struct pipe_budget *ret,
		      struct err *err);

/* pipe_budget for an existing plan: with its load and cap, and as many threads as fit `memory`. -ERR_LIMIT if not even one
 * domain fits. */
int pipe_budget_kept(uint64_t memory, unsigned threads, const struct grid *grid, uint32_t load, uint32_t cap,
		     struct pipe_budget *ret, struct err *err);

/* Plans the regions of a mesh, in `memory` of budget->domain_bytes. If the view has fewer than three positions, or all
 * are collinear, the leaves are `flat`: their domains are vertices without triangles. PIPE_E_EMPTY: there is nothing to
 * emit (no position, or flat leaves in a view with a window); *ret_empty has the counts for pipe_emit_empty, and *ret
 * is empty. -ERR_LIMIT: it cannot fit; the message has the memory that would suffice. */
enum { PIPE_E_EMPTY = 2 };
/* For a view with a window, the leaves are pieces of the window, and `domains` are the triangles that meet them. */
int pipe_plan(const struct grid *grid, const struct view *view, const struct pipe_budget *budget, void *memory,
	      struct cut_plan *ret, struct mesh_counts *ret_empty, struct err *err);
/* The two steps of pipe_plan, for callers that refine the plan between them (pipe_refine): making the leaves, and
 * estimating their halos. If the second fails, it empties the plan. Another thread sets *cancel (NULL: never):
 * -ERR_CANCELLED. */
int pipe_plan_make(const struct grid *grid, const struct view *view, const struct pipe_budget *budget, void *memory,
		   struct cut_plan *ret, struct mesh_counts *ret_empty, struct err *err);
int pipe_plan_probe(const struct grid *grid, const struct view *view, const struct pipe_budget *budget, void *memory,
		    const atomic_bool *cancel, struct cut_plan *plan, struct err *err);

/* cut_plan_split for a plan made by pipe_plan, for any view. */
int pipe_plan_split(struct cut_plan *plan, size_t i, struct grid_reader *reader, const struct view *view, uint64_t need,
		    uint32_t cap, struct err *err);

/* ---- domain: one region to a finished domain ---- */

/* Of a selection: what it was made from, in the same plane, with the view that selects. */
struct pipe_origin {
	const struct grid *grid;
	const struct view *view;
};

/* What is known about a region beforehand; may be NULL. Except for `flat` it does not change the domain. */
struct pipe_known {
	const struct cut_sites *sites;    /* sites of the plan, if the leaf is `known` */
	const struct pipe_before *before; /* from pipe_before */
	bool flat;                        /* the leaf is flat: the domain has its positions and no triangles */
	const struct pipe_origin *origin; /* for the files of a view with `hidden`, if it is of a selection; NULL: unknown */
	/* Called every few milliseconds while a domain with weights is made, which can take long; non-zero cancels
	 * (-ERR_CANCELLED). May be NULL. */
	int (*progress)(void *ctx);
	void *ctx;
};
/* Makes the domain of a region in `memory` of budget->domain_bytes; *ret points into it. PIPE_E_SPLIT: own + halo do
 * not fit; they would need room for *ret_need positions. */
enum { PIPE_E_SPLIT = 1 };
int pipe_domain(const struct grid *grid, const struct view *view, const struct cut_region *region, const struct pipe_known *known,
		const struct pipe_budget *budget, void *memory, struct mesh_domain *ret, uint64_t *ret_need, struct err *err);
/*
 * The first half of pipe_domain, for callers that use the triangles where they were made: those of `tri` (tri_result) that the
 * region owns; if there are pieces of lines, those that finish_chosen takes. `flat`: there are none. All of it is in
 * `memory`, behind what a reader of the grid needs.
 */
struct tri;
struct tri_pieces;
struct pipe_kernel {
	struct tri *tri;
	struct tri_pieces *pieces;        /* to add positions to it; NULL: it has no pieces */
	const uint64_t *chosen, *special; /* as of struct finish_choice; `chosen` is NULL: owned by cut_region_owns */
	bool flat;
	struct mesh_counts counts;
};
int pipe_kernel(const struct grid *grid, const struct view *view, const struct cut_region *region, const struct pipe_known *known,
		const struct pipe_budget *budget, void *memory, struct pipe_kernel *ret, uint64_t *ret_need, struct err *err);
/* Whether the lines of the grid have areas that are out of the mesh. */
bool pipe_has_out(const struct grid *grid);
/* Bytes at the start of `memory` that must stay for *domain and its trace to stay valid. */
size_t pipe_domain_held(const struct mesh_domain *domain, const void *memory);

/* ---- reuse: finished domains in a store, found again in every generation that has the same points ---- */

/* The kernel's version. Raise it when the same points give other blocks, or the same in another order of vertices or triangles:
 * stored domains of the old kernel are then not found, and its streams and runs of a cluster do not continue. */
#define PIPE_KERNEL "kernel 5"

/* What all regions of a mesh have in common. */
struct pipe_key {
	struct digest content; /* of the generation */
	struct digest part[2]; /* lattice, view */
};
void pipe_key_init(struct pipe_key *, const struct grid *grid, const struct view *view);
/* The key of a region under this lattice, view and kernel, for any generation. */
struct digest pipe_key_of(const struct pipe_key *, const struct cut_region *region);
/* Identifies everything that the blocks of a mesh depend on except its plan; `root`: any region. */
struct digest pipe_key_mesh(const struct pipe_key *, const struct cut_region *root);

/* A domain in the store. */
struct pipe_stored {
	struct store_id id;
	struct digest digest;               /* of its triangles */
	uint64_t payload, triangles, bytes; /* as in store.h */
	int64_t used_ns;                    /* time of its last use before this one; 0 if it was just stored */
};
/* What to remember of a stored domain, so that planning later generations need not read its file: its numbers, and the
 * part of its proof that boxes need (cut_additions_far). Its pointers are not valid. */
struct pipe_summary {
	struct store_id id;
	struct store_front front; /* `beside.content`: of a generation in which it is valid */
	struct cut_reach reach;
	struct cut_live live;
	uint32_t cap; /* of struct cut_lines */
};
/* Stores what pipe_domain made in `memory`; call it before `memory` is used for anything else. `ret_summary`: what to
 * remember of it; may be NULL. */
int pipe_store(int storefd, const struct pipe_key *, const struct cut_region *region, const struct mesh_domain *,
	       const void *memory, struct pipe_stored *ret, struct pipe_summary *ret_summary, struct err *err);
/* The same into a pack. `flat`: the leaf is flat, and its domain is not for a store. */
int pipe_pack(struct store_packer *, const struct pipe_key *, const struct cut_region *region, const struct mesh_domain *,
	      const void *memory, bool flat, struct pipe_stored *ret, struct err *err);

struct pipe_reuse_params {
	int storefd;
	const struct grid *grid;
	const struct view *view;
	const struct pipe_key *key;
	const struct cut_region *region;
	uint32_t load, cap; /* of the budget */
	void *memory;
	size_t size;                /* of a domain's budget */
	bool light;                 /* only the front is needed: what pipe_emit needs without a sink */
	bool sums;                  /* not even that: no array of *ret is set (pipe_emitter_sums) */
	int64_t after_ns;           /* domains that were last used before this time are known to be invalid */
	struct grid_reader *reader; /* a reader on the grid; NULL: one is made in `memory` */
	/* Returns the list of the domain of this base that was used last, if it is remembered (else false). It is tried
	 * before the folder is searched, and checked like any other. May be NULL. */
	bool (*hint)(void *ctx, struct digest base, struct digest *ret_list);
	/* Returns the summary that is remembered of a base (else false). It is asked first, unless the front is needed.
	 * If the summary proves that the domain is valid, and its file exists with that size, the file is not read.
	 * `remember` takes a new summary. Both may be NULL. */
	bool (*recall)(void *ctx, struct digest base, struct pipe_summary *ret);
	void (*remember)(void *ctx, const struct pipe_summary *);
	/* For pipe_refine: called for each leaf that is `there` at the end, with what pipe_reuse returns for `sums`.
	 * May be NULL. */
	void (*there)(void *ctx, const struct cut_region *, const struct mesh_domain *, const struct pipe_stored *);
	void *ctx;         /* of all these functions */
	unsigned *damaged; /* counts the domains that were damaged and removed; may be NULL */
};
/* Finds a stored domain that is equal to what pipe_domain would make: of this generation's content, or of another
 * content that is the same for this region. If there are several, the one that was used last. *ret is in *ret_held
 * bytes at the start of `memory`. PIPE_E_ABSENT: there is none, or none that fits `memory`, or none that can be proved
 * to be equal. */
enum { PIPE_E_ABSENT = 4 };
int pipe_reuse(const struct pipe_reuse_params *, struct mesh_domain *ret, struct pipe_stored *ret_stored, size_t *ret_held,
	       struct err *err);

/* For a region that must be made again: the sites under its domain when it was last stored bound its halo, if all of
 * these points still exist. False: unknown, or they do not all exist; *ret is then unspecified. Uses `memory`, and
 * needs nothing in it later. */
struct pipe_before {
	struct cut_trace trace;
	struct point site[4 * CUT_TRACE_SITES];
};
bool pipe_before(const struct pipe_reuse_params *, struct pipe_before *ret);

/*
 * Between the steps of a plan: if only few leaves have changed since they were stored, these are split into smaller
 * ones. Then several threads share them, and the next change there leaves more of them unchanged. Stored leaves are
 * marked `fits` (their halos fitted when they were made; if that has changed, it is found when they are made again),
 * and `there` if they are what pipe_domain would make. `region`, `light` and `sums` of the parameters are ignored.
 */
int pipe_refine(const struct pipe_reuse_params *, struct cut_plan *, struct err *err);
/*
 * The steps of pipe_refine, for several threads. If pipe_refine_applies: pipe_refine_new; then each thread calls
 * pipe_refine_reader, and pipe_refine_step until one returns PIPE_E_REFINED, with its own parameters and `memory` of at
 * least pipe_refine_bytes; when no thread is in a step, one calls pipe_refine_split. Each error is an error of
 * pipe_refine. Any thread may call `there` at any time. Nothing else may use the plan meanwhile.
 */
struct pipe_refine;
enum { PIPE_E_REFINED = 6 };                                            /* no leaf is left */
bool pipe_refine_applies(const struct view *, const struct cut_plan *); /* if not, there is nothing to do */
size_t pipe_refine_bytes(const struct grid *);
int pipe_refine_new(struct cut_plan *, struct pipe_refine **ret, struct err *err); /* `plan` is borrowed */
struct pipe_refine *pipe_refine_free(struct pipe_refine *);                        /* may be NULL; returns NULL */
int pipe_refine_reader(struct pipe_reuse_params *, struct err *err);               /* sets `reader`, which is in `memory` */
int pipe_refine_step(struct pipe_refine *, const struct pipe_reuse_params *, struct err *err);
int pipe_refine_split(struct pipe_refine *, const struct pipe_reuse_params *, struct err *err);

/* ---- emit: finished domains, in plan order, to numbered blocks ---- */

struct pipe_emitter;

struct pipe_totals {
	uint64_t vertices, triangles, hull, domains;
	struct mesh_counts counts;
	struct digest digest, vertex_digest;
	int32_t box[6];    /* of the vertices: min x y z, max x y z */
	double most_at[2]; /* position of counts.most (mapped, if the view has a map), in coordinates; only if it has points */
};

/* `memory`: bytes for the table of open vertices (the caller charges them). If they do not suffice, the table spills
 * into an unlinked file in `tempdirfd`. */
int pipe_emitter_new(const struct lattice *lattice, size_t memory, int tempdirfd, struct pipe_emitter **ret, struct err *err);
/* For a view with a map (view_bind_map), before the first domain: the regions are of the mapped plane. Blocks have them without
 * the origin, in doubled numbers P x + Q y and K (P y - Q x); the lattice stays that of the positions. */
void pipe_emitter_map(struct pipe_emitter *, const struct view *);
/* The same for the box of a region (cut_region_box). */
void pipe_region_box(const struct view_map *, int64_t box[4]);
/* Emits the next domain of the plan. Calls sink->block once, but not for a domain without vertices. `sink` may be NULL:
 * the domain is only counted and digested; that is required for a `light` domain of pipe_reuse, whose `triangle` is
 * NULL. The arrays of the block are those of the domain, renumbered in place; they stay valid as long as the domain's
 * memory. */
int pipe_emit(struct pipe_emitter *, struct mesh_domain *, const struct cut_region *, const struct mesh_sink *, struct err *err);
/* Call it before the first domain of a window, or of a mesh of which parts are out (pipe_has_out). Such a mesh has a border that
 * is not the hull's, so Euler's formula is not checked, and totals.hull is 0. Positions need not be vertices of it, so its totals
 * cannot be made by pipe_emitter_sums. */
void pipe_emitter_part(struct pipe_emitter *);
/* Call it before the first domain, or to begin again. true: nobody reads the mesh, and only its totals are made, from
 * the counts, digests and numbers of the domains, without their arrays; no sink is allowed, and domains can come in any
 * order. false (the default): the mesh is emitted. The totals are the same. */
void pipe_emitter_sums(struct pipe_emitter *, bool sums);
/* Instead of domains: the counts of an empty plan (PIPE_E_EMPTY). */
void pipe_emit_empty(struct pipe_emitter *, const struct mesh_counts *counts);
/* After the last domain: the totals. Vertices that are still open are the hull. -ERR_INTERNAL if the mesh is incomplete
 * (an open link that is not the hull's). */
int pipe_emitter_finish(struct pipe_emitter *, struct pipe_totals *ret, struct err *err);
struct pipe_emitter *pipe_emitter_free(struct pipe_emitter *);
/* Size of that file: the part of the table that does not fit `memory`. */
uint64_t pipe_emitter_spilled(const struct pipe_emitter *);

#endif
