/*
 * Pieces of a mesh, and the sinks that receive them.
 *
 * A finished domain (struct mesh_domain) has positions but no vertex numbers; the store keeps it in this form. The
 * emitter turns it into a numbered block (struct mesh_block), which the stream carries.
 */
#ifndef MESH_H
#define MESH_H

#include <stdbool.h>
#include <stdint.h>

#include "digest.h"

struct err;

struct mesh_vertex {
	int32_t x, y, z; /* lattice numbers */
};

/* An open vertex: one that other domains or the hull may share. */
struct mesh_link {
	uint64_t hi, lo; /* 128-bit sum over its triangles (p, a, b), counter-clockwise, of H(a) - H(b); zero: closed */
	uint32_t edges;  /* number of triangles in the sum */
};

#define MESH_RULES 16 /* at least VIEW_RULES; part of the format of stored domains */

/* The position with the most points in the view, at least two; if several have as many, the first by x, then y. */
struct mesh_most {
	uint64_t points; /* 0: there is no such position */
	int32_t x, y;
};
static inline void mesh_most_add(struct mesh_most *m, uint64_t points, int32_t x, int32_t y)
{
	bool before = x != m->x ? x < m->x : y < m->y;

	if (points > m->points || (points && points == m->points && before))
		*m = (struct mesh_most){points, x, y};
}

struct mesh_counts {
	uint64_t points;              /* records in the region */
	uint64_t removed[MESH_RULES]; /* of these, by rule: enum view_rule */
	uint64_t used;                /* positions of the region that are points of the mesh */
	struct mesh_most most;
	uint64_t halo;        /* positions loaded from outside the region */
	uint64_t cells_read;  /* for the halo */
	uint64_t points_read; /* records that were read: `points`, and those of the cells read for the halo */
};

/* The record of a vertex: its class, and the source that it is of. */
struct mesh_origin {
	uint32_t source;
	uint8_t cls, zero[3];
};

/* Vertices [0, nopen) are open; the others are closed and are in no other domain. The arrays are memory of whoever made
 * the domain. The emitter renumbers them in place, so a domain can be emitted only once. */
struct mesh_domain {
	struct mesh_vertex *vertex;
	struct mesh_link *link;  /* nopen of them */
	uint32_t (*triangle)[3]; /* local vertex numbers, counter-clockwise */
	uint8_t *final;          /* (nvertex + 7) / 8 bytes, filled by the emitter */
	/* A byte for each triangle: bit k: the side across from corner k is a piece of a line. nedges: ntriangle, or 0 if no side
	 * is. */
	uint8_t *edges;
	struct mesh_origin *origin; /* of a view with `hidden`, which has no open vertices: of each vertex. NULL: not known */
	uint32_t nvertex, nopen, ntriangle, nedges;
	struct digest digest;        /* of its triangles */
	struct digest closed_digest; /* vertex digest of the closed vertices */
	/* of all positions of the region (counts.used), even if their triangles belong to other domains */
	struct digest own_digest;
	uint32_t nhull; /* edges of the hull whose outer ray ends in the region */
	int32_t box[6]; /* of its vertices: min x y z, max x y z; meaningless without vertices */
	struct mesh_counts counts;
};

/* Local vertices: first the foreign ones (numbers of earlier blocks), then new ones, numbered from `first`. */
struct mesh_block {
	uint64_t index;
	int64_t box[4]; /* region, as doubled lattice numbers (odd); INT64_MIN/MAX: infinite */
	uint64_t first;
	const uint64_t *foreign;
	const struct mesh_vertex *vertex; /* nnew of them */
	const uint32_t (*triangle)[3];
	const uint8_t *final;             /* bit set over nforeign + nnew: no later block uses the vertex */
	const uint8_t *edges;             /* as in struct mesh_domain; NULL: no side of a triangle is a piece of a line */
	const struct mesh_origin *origin; /* likewise, of each new vertex */
	uint32_t nforeign, nnew, ntriangle;
};

struct mesh_sink {
	void *ctx;
	int (*block)(void *ctx, const struct mesh_block *, struct err *err);
};

#endif
