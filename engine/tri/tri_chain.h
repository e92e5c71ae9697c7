/*
 * The triangulation of one side of a piece, constrained Delaunay at once (docs/design/constraints.md, "One side of a
 * piece"). Internal.
 *
 * A chain is the boundary of the removed triangles on one side of the piece, from one end of the piece to the other,
 * with the removed triangles on its right. Its triangulation is a binary tree: node i is the triangle with the base
 * end[0], end[1] and the apex i, which is between them on the chain; child[0] is the triangle across from the side
 * end[0], i and child[1] the one across from i, end[1], where there is one. So each inner node of the chain is the apex
 * of one triangle, and a flip is a rotation.
 */
#ifndef TRI_CHAIN_H
#define TRI_CHAIN_H

#include <stdbool.h>
#include <stdint.h>

#define TRI_NONE UINT32_MAX

struct tri_node {
	uint32_t vertex;
	uint32_t outer; /* the link across the edge from this node to the next one */
	uint32_t strip; /* the removed triangle at this edge: its place along the piece, from 1 */
	uint32_t end[2];
	union {
		uint32_t child[2];
		struct {
			uint32_t ear; /* while ears are cut: an entry of the list of ears, of any node */
			uint32_t listed;
		};
	};
	uint32_t up; /* the parent; of an ear that was cut the one that was cut before */
};

struct tri_chain {
	struct tri_node *node;
	uint32_t n; /* at least 3 */
	uint32_t root;
};

/* From the vertices of the chain to its triangulation: fills end, child, up and root. */
void tri_chain_fill(struct tri_chain *, const int32_t (*xy)[2]);

#endif
