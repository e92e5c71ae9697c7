/* GLB, for its files: bytes (format_glb.c) and the JSON that describes them (format_glb_json.c). */
#ifndef FORMAT_GLB_H
#define FORMAT_GLB_H

#include "format.h"

struct glb_scene {
	char *extras; /* members of an object, each with a comma behind it */
	uint64_t nvertex, nface;
	uint64_t faces_at; /* offset of the indices behind the first position */
	float min[3], max[3];
};

/* What other formats have in comments, into scene->extras. */
int format_glb_extras(struct glb_scene *, const struct acut_mesh_head *, const struct format_options *, struct err *err);
/* Bytes of the JSON whatever the numbers will be, a multiple of 4. */
int format_glb_json_widest(const struct glb_scene *, size_t *ret, struct err *err);
/* Exactly `size` bytes, filled with blanks. */
int format_glb_json(const struct glb_scene *, const struct acut_mesh_tail *, char *to, size_t size, struct err *err);

#endif
