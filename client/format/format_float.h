/* Coordinates as 32-bit floats, for formats that have no others. */
#ifndef FORMAT_FLOAT_H
#define FORMAT_FLOAT_H

#include "format_axis.h"

struct format_float {
	struct format_axis axis[3];
	const char *name;           /* of the format */
	bool has_origin, from_auto; /* of the coordinates */
};

/* -ERR_USAGE: x or y of the box is so far from zero that its float would be off by a step of the lattice. */
int format_float_init(struct format_float *, const char *name, const struct acut_mesh_head *, const struct format_options *,
		      struct err *err);
/* The same of z, which the head does not tell. */
int format_float_heights(const struct format_float *, const int32_t (*vertex)[3], size_t n, struct err *err);

#endif
