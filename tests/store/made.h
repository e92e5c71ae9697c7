/* Random domains, for tests of the store. */
#ifndef MADE_H
#define MADE_H

#include <stdint.h>

#include "store.h"

enum { MADE_PROOF = 44 };
struct made {
	struct mesh_domain d;
	struct store_beside beside;
	uint8_t proof[MADE_PROOF];
};

/* Closed vertices within [low, high] of each axis, ends included; open ones anywhere. */
void made_domain(uint32_t nvertex, uint32_t nopen, uint32_t ntriangle, const int32_t low[3], const int32_t high[3],
		 struct made *m);
void made_free(struct made *m);
/* Fails unless they are the same. */
void made_same(const struct mesh_domain *a, const struct mesh_domain *b);

#endif
