/* Coordinates as 32-bit floats, for formats that have no others. */
#ifndef FORMAT_FLOAT_H
#define FORMAT_FLOAT_H

#include "format_axis.h"

struct format_float {
	struct format_axis axis[3];
	const char *name;           /* of the format */
	bool has_origin, from_auto; /* of the coordinates */
	bool part;                  /* of a mesh is written */
};

/* -ERR_USAGE: a coordinate is so far from zero that its float would be off by a step of the lattice: here x or y of the box of a
 * whole mesh. */
int format_float_init(struct format_float *, const char *name, const struct acut_mesh_head *, const struct format_options *,
		      struct err *err);
/* The same of what is written: its least and greatest coordinates. */
#define FORMAT_FLOAT_NOTHING                            \
	{                                               \
		{INT32_MAX, INT32_MAX, INT32_MAX},      \
		{                                       \
			INT32_MIN, INT32_MIN, INT32_MIN \
		}                                       \
	}
void format_float_range(int32_t range[2][3], const int32_t vertex[3]);
int format_float_check(const struct format_float *, const int32_t range[2][3], struct err *err);

#endif
