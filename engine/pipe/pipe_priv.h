/* Inner door of pipe/: what its files share. */
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
struct grid;
struct grid_reader;
struct mesh_counts;
struct mesh_domain;
struct pipe_budget;
struct tri;
struct view;

/* At the start of a domain's memory, and what it points to behind it: what was loaded (pipe_reuse.c). */
struct pipe_trace {
	struct cut_trace trace;
};
#define PIPE_TRACE align_line(sizeof(struct pipe_trace) + CUT_TRACE_BYTES)

size_t pipe_domain_bytes(uint32_t cap, size_t reader_bytes);
/* Memory of a domain (pipe_domain.c): where the kernel's arena begins. */
void *pipe_domain_arena(const struct grid *grid, void *memory);
/* The output and the scratch of cut_load, for a region of about `own` positions. Unless `whole`, the scratch is as small as such
 * a region usually needs. */
void pipe_domain_room(const struct grid *grid, const struct pipe_budget *budget, uint64_t own, bool whole, void *memory,
		      struct cut_load *ret);
/* The kernel, with the loaded positions as its input. */
struct tri *pipe_domain_tri(const struct grid *grid, const struct pipe_budget *budget, uint64_t own, void *memory,
			    const struct cut_load *load);
/* Whether the view's positions are fewer than three or all collinear; *ret_counts is of all points then, else of those up to the
 * first that is not. And the domain of what was loaded of a `flat` leaf: its vertices (pipe_flat.c). */
int pipe_flat_scan(struct grid_reader *, const struct view *, bool *ret, struct mesh_counts *ret_counts, struct err *err);
struct mesh_domain pipe_flat_domain(const struct cut_load *, const int64_t k[3]);
/* What pipe_reuse found before it reads the rest, by `light` and `sums`. */
struct pipe_found {
	struct store_id id;
	struct store_front front;
	size_t versions; /* that are in the store of this region */
	bool fits;       /* one that was looked at fits the cap with its halo */
};
struct pipe_reuse_params;
struct pipe_stored;
int pipe_find(const struct pipe_reuse_params *, struct pipe_found *ret, struct err *err);
void pipe_found_stored(const struct pipe_found *, struct pipe_stored *ret);

#endif
