/*
 * Lets one domain that a worker makes exceed its memory, another one fail to be read, and another one take until it is cancelled.
 *
 * Linked with --wrap=pipe_domain.
 */
#ifndef FAILING_DOMAIN_H
#define FAILING_DOMAIN_H

#include <stdatomic.h>
#include <unistd.h>

#include "err.h"
#include "pipe.h"

static struct {
	atomic_uint made;                          /* domains started */
	atomic_uint split_at, fail_at, endless_at; /* the domains with these numbers; 0: none */
	atomic_bool in_endless, cancelled;
} making;

int __real_pipe_domain(const struct grid *grid, const struct view *v, const struct cut_region *region,
		       const struct pipe_known *known, const struct pipe_budget *budget, void *memory, struct mesh_domain *ret,
		       uint64_t *ret_need, struct err *err);
int __wrap_pipe_domain(const struct grid *grid, const struct view *v, const struct cut_region *region,
		       const struct pipe_known *known, const struct pipe_budget *budget, void *memory, struct mesh_domain *ret,
		       uint64_t *ret_need, struct err *err);

int __wrap_pipe_domain(const struct grid *grid, const struct view *v, const struct cut_region *region,
		       const struct pipe_known *known, const struct pipe_budget *budget, void *memory, struct mesh_domain *ret,
		       uint64_t *ret_need, struct err *err)
{
	unsigned n = ++making.made;

	if (n == making.fail_at)
		return err_set(err, ERR_IO, "the test's disk is gone");
	if (n == making.endless_at) {
		making.in_endless = true;
		for (unsigned i = 0; i < 20000 && !making.cancelled; i++) {
			making.cancelled = known->progress(known->ctx) != 0;
			usleep(1000);
		}
		return err_set(err, ERR_CANCELLED, "the test's domain was cancelled");
	}
	if (n == making.split_at) {
		*ret_need = (uint64_t)budget->cap + 1;
		return PIPE_E_SPLIT;
	}
	return __real_pipe_domain(grid, v, region, known, budget, memory, ret, ret_need, err);
}

#endif
