/* The domain of a region from a source of cells and pieces, as the product makes it, for sets of SETS_MAX_N positions. */
#ifndef MADE_H
#define MADE_H

#include "constrain.h"
#include "mesh.h"

enum { MADE_BYTES = 1 << 19 };

struct made {
	const struct cut_source *src;
	const struct view *view;
	const struct cut_region *region;
	const struct constrain_lines *lines;
	bool not_verified;
	void *memory;            /* MADE_BYTES, aligned to 64 */
	struct cut_trace *trace; /* may be NULL */
	/* results */
	struct constrain c;
	uint32_t n; /* positions of P(B) */
};
void made_domain(struct made *, struct mesh_domain *ret);
/* Fails unless the bytes are the same. */
void made_check_same(const struct mesh_domain *, const struct mesh_domain *);
bool made_same(const struct mesh_domain *, const struct mesh_domain *);

/* Scratch of cut_load. */
void *made_scratch(void);
size_t made_scratch_size(void);

#endif
