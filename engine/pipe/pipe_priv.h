/* Inner door of pipe/: what its files share. */
#ifndef PIPE_PRIV_H
#define PIPE_PRIV_H

#include <stddef.h>
#include <stdint.h>

#include "cut_valid.h"
#include "digest.h"
#include "store.h"

struct err;
struct grid;
struct pipe_selected;

enum { PIPE_ALIGN = 64 };

static inline size_t pipe_round(size_t n)
{
	return (n + PIPE_ALIGN - 1) & ~(size_t)(PIPE_ALIGN - 1);
}

/* At the start of a domain's memory, and what it points to behind it: what was loaded (pipe_reuse.c). */
struct pipe_trace {
	struct cut_trace trace;
};
#define PIPE_TRACE pipe_round(sizeof(struct pipe_trace) + CUT_TRACE_BYTES)

size_t pipe_domain_bytes(uint32_t cap, size_t reader_bytes);
/* Windows (pipe_area.c, pipe_area_plan.c): what pipe_domain and pipe_plan do where a view has one. `cap`: of a
 * budget; of what that takes tables need a part, and the rest carries pipe_area_cap positions. */
struct cut_plan;
struct cut_region;
struct grid_reader;
struct mesh_domain;
struct pipe_budget;
struct view;
uint32_t pipe_area_cap(uint32_t cap);
int pipe_area(const struct grid *, const struct view *, const struct cut_region *, const struct pipe_budget *, void *memory,
	      struct mesh_domain *ret, uint64_t *ret_need, struct err *err);
int pipe_area_plan(struct grid_reader *, const struct view *, uint32_t cap, struct cut_plan *ret, struct err *err);
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
/* What tells the points of two generations apart, whatever dataset they are of, and however they lie there. */
struct digest pipe_content(const struct grid *grid);
int pipe_selected_write(int dirfd, const struct pipe_selected *, struct err *err);

#endif
