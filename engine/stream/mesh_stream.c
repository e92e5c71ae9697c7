/* The same numbers, and the same arrays by other types: they have the same bytes. */
#include "mesh_stream.h"

#include <stddef.h>
#include <string.h>

_Static_assert(sizeof(struct mesh_vertex) == sizeof(int32_t[3]), "vertices go out as they lie in memory");
_Static_assert(sizeof(struct mesh_origin) == sizeof(struct stream_origin) && offsetof(struct mesh_origin, cls) == 4,
	       "and so do their records");

struct stream_block mesh_stream_block(const struct mesh_block *b)
{
	struct stream_block block = {
		.index = b->index,
		.first = b->first,
		.nforeign = b->nforeign,
		.nnew = b->nnew,
		.ntriangle = b->ntriangle,
		.foreign = b->foreign,
		.vertex = (const int32_t(*)[3])b->vertex,
		.triangle = b->triangle,
		.flags = b->edges,
		.final = b->final,
		.origin = (const struct stream_origin *)(const void *)b->origin,
	};

	memcpy(block.box, b->box, sizeof block.box);
	return block;
}
