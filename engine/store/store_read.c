/*
 * Reading a whole domain from a file, from a place on (store_write.c): each array to where it is unpacked, packed ones to the end
 * of their memory.
 */
#define XXH_STATIC_LINKING_ONLY /* for the hash state on the stack */
#include <xxhash.h>

#include "io.h"
#include "store_format.h"

static uint64_t rest_sum(const struct mesh_domain *d, const void *closed, const void *triangle, const struct store_extent *e)
{
	XXH3_state_t state;

	XXH3_64bits_reset(&state);
	XXH3_64bits_update(&state, closed, e->closed);
	XXH3_64bits_update(&state, triangle, e->triangle);
	if (e->edges)
		XXH3_64bits_update(&state, d->edges, e->edges);
	return XXH3_64bits_digest(&state);
}

static void place_arrays(struct mesh_domain *d, uint8_t *memory)
{
	const struct store_layout l = store_layout_of(d);

	d->link = (void *)memory;
	d->vertex = (void *)(memory + l.vertex);
	d->triangle = (void *)(memory + l.triangle);
	d->final = memory + l.final;
	d->edges = d->nedges ? memory + l.edges : NULL;
}

int store_read(int fd, const char *name, uint64_t at, struct store_front *f, const struct store_header *h, void *memory,
	       bool *ret_whole, struct err *err)
{
	const struct store_extent e = store_extent_of(&f->domain, &h->code, f->beside.proof_size);
	struct mesh_domain *d = &f->domain;
	uint8_t *closed, *triangle;
	int r = io_read_at(fd, memory, e.open, at + e.open_at, name, err);

	place_arrays(d, memory);
	closed = (uint8_t *)(d->vertex + d->nvertex) - e.closed;
	triangle = (uint8_t *)(d->triangle + d->ntriangle) - e.triangle;
	if (!r)
		r = io_read_at(fd, closed, e.closed, at + e.closed_at, name, err);
	if (!r)
		r = io_read_at(fd, triangle, e.triangle, at + e.triangle_at, name, err);
	if (!r && e.edges)
		r = io_read_at(fd, d->edges, e.edges, at + e.triangle_at + e.triangle, name, err);
	if (r)
		return r;
	*ret_whole = store_open_sum(d) == h->sums.open && rest_sum(d, closed, triangle, &e) == h->sums.rest &&
		     store_corners_fit(&h->code, triangle, 3 * (size_t)d->ntriangle, d->nvertex);
	if (!*ret_whole)
		return 0;
	store_unpack_vertices(&h->code, d->vertex + d->nopen, d->nvertex - d->nopen);
	store_unpack_triangles(&h->code, d->triangle, d->ntriangle);
	return 0;
}
