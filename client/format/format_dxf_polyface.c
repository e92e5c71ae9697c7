/*
 * Triangles of a block as polyface meshes: a POLYLINE with its vertices, then its faces, which name the vertices by numbers of 15
 * bits.
 *
 * The counts come before the vertices, and these before the faces, so a mesh is kept until it is complete: when a block ends, so
 * that nothing is left between two blocks, or when one more triangle could exceed what the numbers can tell. A hash table by the
 * vertices' numbers in the stream, twice as large as a mesh can be, finds those that the mesh has.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "format_digits.h"
#include "format_dxf.h"
#include "outfile.h"

enum { SLOTS = 1 << 16, ITEM = DXF_POINT + 128 }; /* of the table; bytes of a vertex or face at most */

struct dxf_polyface {
	uint32_t nvertex, nface;
	int32_t vertex[DXF_POLYFACE_MOST][3];
	uint16_t face[DXF_POLYFACE_MOST][3]; /* from 1 */
	struct {
		uint64_t number; /* in the stream */
		uint16_t local;  /* from 1; 0: free */
	} slot[SLOTS];
};

int format_dxf_polyface_new(struct dxf_polyface **ret, struct err *err)
{
	*ret = calloc(1, sizeof(**ret));
	return *ret ? 0 : err_set(err, ERR_NOMEM, "no memory for a polyface mesh");
}

struct dxf_polyface *format_dxf_polyface_free(struct dxf_polyface *p)
{
	free(p);
	return NULL;
}

static uint16_t local_of(struct dxf_polyface *p, uint64_t number, const int32_t at[3])
{
	size_t i = (size_t)(number * 0x9e3779b97f4a7c15u >> 48);

	while (p->slot[i].local && p->slot[i].number != number)
		i = (i + 1) % SLOTS;
	if (!p->slot[i].local) {
		memcpy(p->vertex[p->nvertex], at, sizeof(p->vertex[0]));
		p->slot[i].number = number;
		p->slot[i].local = (uint16_t)++p->nvertex;
	}
	return p->slot[i].local;
}

static int put_vertices(const struct dxf_polyface *p, const struct format_axis axis[3], struct outfile *out, struct err *err)
{
	for (uint32_t i = 0; i < p->nvertex; i++) {
		char *start = outfile_room(out, ITEM, err), *at;

		if (!start)
			return -err->code;
		at = stpcpy(start, "0\nVERTEX\n" DXF_LAYER);
		at = format_dxf_point(axis, p->vertex[i], 0, at);
		at = stpcpy(at, "70\n192\n");
		outfile_used(out, (size_t)(at - start));
	}
	return 0;
}

static int put_faces(const struct dxf_polyface *p, struct outfile *out, struct err *err)
{
	for (uint32_t i = 0; i < p->nface; i++) {
		char *start = outfile_room(out, ITEM, err), *at;

		if (!start)
			return -err->code;
		at = stpcpy(start, "0\nVERTEX\n" DXF_LAYER "10\n0.0\n20\n0.0\n30\n0.0\n70\n128\n");
		for (int j = 0; j < 3; j++) {
			at = stpcpy(at, j == 0 ? "71\n" : j == 1 ? "72\n" : "73\n");
			at = format_digits_put(p->face[i][j], at);
			*at++ = '\n';
		}
		outfile_used(out, (size_t)(at - start));
	}
	return 0;
}

static int put_mesh(struct dxf_polyface *p, const struct format_axis axis[3], struct outfile *out, struct err *err)
{
	static const char end[] = "0\nSEQEND\n" DXF_LAYER;
	char head[128];
	int n = snprintf(head, sizeof(head),
			 "0\nPOLYLINE\n" DXF_LAYER "66\n1\n10\n0.0\n20\n0.0\n30\n0.0\n70\n64\n71\n%u\n72\n%u\n", p->nvertex,
			 p->nface),
	    r = p->nface ? outfile_write(out, head, (size_t)n, err) : 0;

	if (r || !p->nface)
		return r;
	r = put_vertices(p, axis, out, err);
	if (!r)
		r = put_faces(p, out, err);
	if (!r)
		r = outfile_write(out, end, sizeof(end) - 1, err);
	p->nvertex = p->nface = 0;
	memset(p->slot, 0, sizeof(p->slot));
	return r;
}

int format_dxf_polyface_block(struct dxf_polyface *p, const struct format_axis axis[3], const struct format_block *block,
			      struct outfile *out, struct err *err)
{
	const struct acut_mesh_block *b = block->mesh;
	int r = 0;

	for (uint32_t i = 0; i < b->ntriangle && !r; i++) {
		for (int j = 0; j < 3; j++) {
			uint32_t l = b->triangle[i][j];
			uint64_t number = l < b->nforeign ? b->foreign[l] : b->first + (l - b->nforeign);

			p->face[p->nface][j] = local_of(p, number, block->position[l]);
		}
		p->nface++;
		if (p->nface == DXF_POLYFACE_MOST || p->nvertex + 3 > DXF_POLYFACE_MOST)
			r = put_mesh(p, axis, out, err);
	}
	return r ? r : put_mesh(p, axis, out, err);
}
