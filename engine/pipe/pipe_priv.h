/* What the files of this room share. Internal. */
#ifndef PIPE_PRIV_H
#define PIPE_PRIV_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "align.h"
#include "cut_valid.h"
#include "digest.h"
#include "store.h"

struct cut_load;
struct cut_region;
struct err;
struct finish_choice;
struct grid;
struct grid_reader;
struct mesh_counts;
struct mesh_domain;
struct pipe_budget;
struct pipe_known;
struct pipe_origin;
struct regular;
struct tri;
struct view;

/* The trace of what was loaded (pipe_reuse.c), at the start of a domain's memory; its arrays follow. */
struct pipe_trace {
	struct cut_trace trace;
};
#define PIPE_TRACE align_line(sizeof(struct pipe_trace) + CUT_TRACE_BYTES)

size_t pipe_domain_bytes(uint32_t cap, size_t reader_bytes);
/* The start of the kernel's arena in a domain's memory (pipe_domain.c). */
void *pipe_domain_arena(const struct grid *grid, void *memory);
/* Memory for the output and the scratch of cut_load, for a region of about `own` positions. Unless `whole`, the scratch
 * has only the size that such a region usually needs. */
void pipe_domain_room(const struct grid *grid, const struct pipe_budget *budget, uint64_t own, bool whole, void *memory,
		      struct cut_load *ret);
/* The kernel, with the loaded positions as its input, and its capacity: for so many more. */
struct tri *pipe_domain_tri(const struct grid *grid, const struct pipe_budget *budget, uint64_t own, void *memory,
			    const struct cut_load *load, uint32_t more, uint32_t *ret_cap);
/* Loads the region's positions for the kernel. `weight`: gets the numbers of their weights, budget->cap of them; NULL. */
int pipe_domain_load(const struct grid *grid, const struct view *view, const struct cut_region *region,
		     const struct pipe_known *known, const struct pipe_budget *budget, void *memory, uint8_t *weight,
		     struct cut_load *load, uint64_t *ret_own, uint64_t *ret_need, struct err *err);
/* pipe_domain for a view with weights, and what is refused with one (pipe_weight.c). */
int pipe_weight(const struct grid *grid, const struct view *view, const struct cut_region *region, const struct pipe_known *known,
		const struct pipe_budget *budget, void *memory, struct mesh_domain *ret, uint64_t *ret_need, struct err *err);
/* After the kernel of a region with weights: the domain of a view with `hidden`. Its counts are those of all that was loaded. */
int pipe_hidden(const struct grid *grid, const struct regular *, const struct pipe_origin *, void *memory,
		struct mesh_domain *ret, struct err *err);
/* What a kernel of the view has of the arena; and of the arena for such a kernel. */
uint32_t pipe_weight_cap(const struct view *, uint32_t cap);
uint64_t pipe_weight_need(const struct view *, uint64_t need);
/* No position has a greater weight. */
int64_t pipe_weight_most(const struct grid *grid, const struct view *view);
int pipe_weight_check(const struct grid *grid, const struct view *view, struct err *err);
/* For a grid with lines, after tri_run: the triangles of the region if they differ from the owned ones (else ret->chosen is
 * NULL), of *tri, which may become another one. PIPE_E_SPLIT as of pipe_domain. */
int pipe_constrain(const struct grid *grid, const struct view *view, const struct cut_region *region,
		   const struct pipe_budget *budget, void *memory, struct tri **tri, uint32_t tri_cap, struct mesh_counts *counts,
		   struct finish_choice *ret, struct tri_pieces **ret_pieces, uint64_t *ret_need, struct err *err);
/* Whether the view has fewer than three positions, or all are collinear; *ret_counts is then of all points, else of
 * those up to the first that is not collinear. And the domain of a loaded `flat` leaf: its vertices (pipe_flat.c). */
int pipe_flat_scan(struct grid_reader *, const struct view *, bool *ret, struct mesh_counts *ret_counts, struct err *err);
struct mesh_domain pipe_flat_domain(const struct cut_load *, const struct view *, const int64_t k[3]);
/* What pipe_reuse has found before it reads the rest, by `light` and `sums`. */
struct pipe_found {
	struct store_id id;
	struct store_front front;
	size_t versions; /* stored versions of this region */
	bool fits;       /* one of them fits the cap with its halo */
};
struct pipe_reuse_params;
struct pipe_stored;
int pipe_find(const struct pipe_reuse_params *, struct pipe_found *ret, struct err *err);
void pipe_found_stored(const struct pipe_found *, struct pipe_stored *ret);

#endif
