/* DXF, for its files: single faces and the file around them (format_dxf.c), polyface meshes (format_dxf_polyface.c). */
#ifndef FORMAT_DXF_H
#define FORMAT_DXF_H

#include "format_axis.h"

#define DXF_LAYER "8\nTIN\n"
enum { DXF_POINT = 3 * (FORMAT_COORDINATE + 4) }; /* bytes of a point at most */

/* "1N\nX\n2N\nY\n3N\nZ\n" at `at`; N: which corner. Returns the end. */
char *format_dxf_point(const struct format_axis axis[3], const int32_t v[3], int corner, char *at);

/* Polyface meshes of at most this many vertices, and as many faces: the numbers of both have 15 bits. */
#define DXF_POLYFACE_MOST 32767
struct dxf_polyface;
int format_dxf_polyface_new(struct dxf_polyface **ret, struct err *err);
/* The triangles of a block, in meshes of their own. */
int format_dxf_polyface_block(struct dxf_polyface *, const struct format_axis axis[3], const struct format_block *,
			      struct outfile *, struct err *err);
struct dxf_polyface *format_dxf_polyface_free(struct dxf_polyface *);

#endif
