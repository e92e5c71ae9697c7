/* From the kernel's triangles to a finished domain, in place. The steps of pipe_domain, apart for bench/engine. */
#ifndef PIPE_FINISH_H
#define PIPE_FINISH_H

#include "cut.h"
#include "grid.h"
#include "tri.h"
#include "view.h"

struct pipe_budget;

/* Where a domain's memory begins to be the kernel's arena. */
void *pipe_domain_arena(const struct grid *grid, void *memory);
/* Where cut_load writes to, and its scratch, for a region of about `own` positions at most. Not `whole`: of the scratch only
 * what such a region takes as a rule. */
void pipe_domain_room(const struct grid *grid, const struct pipe_budget *budget, uint64_t own, bool whole, void *memory,
		      struct cut_load *ret);
/* The kernel, with what was loaded there as its input. */
struct tri *pipe_domain_tri(const struct grid *grid, const struct pipe_budget *budget, uint64_t own, void *memory,
			    const struct cut_load *load);

/* A vertex, while triangles are picked: a byte each, in the place of the kernel's ids. */
enum { PIPE_USED = 1, PIPE_OPEN = 2 }; /* by a picked triangle, by another one (or a ghost) */

struct pipe_finish {
	const struct cut_region *region;
	int64_t k[3];
	struct tri_result tri;
	struct mesh_domain out;
};

/* tri_run was done. After each step `out` holds more: */
void pipe_finish_init(struct pipe_finish *, const struct cut_region *, const int64_t k[3], const struct tri *);
void pipe_finish_owned(struct pipe_finish *);    /* triangles owned, and their digest; marks of their vertices */
bool pipe_finish_vertices(struct pipe_finish *); /* vertices, box, digest of the closed ones. False: no room */
void pipe_finish_numbers(struct pipe_finish *);  /* local numbers in the triangles, links of open vertices */

#endif
