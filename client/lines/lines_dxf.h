/* Shared by the files that read DXF: pairs and sections (lines_dxf.c), entities (lines_dxf_entity.c). */
#ifndef LINES_DXF_H
#define LINES_DXF_H

#include "lines_priv.h"

enum { LINES_DXF_VALUE = 512 };

struct lines_dxf {
	struct lines *l;
	struct text_source source;
	struct lines_crs crs; /* of every layer */
	int code;             /* the pair that was read last, */
	uint64_t line;        /* the line of its code, */
	char value[LINES_DXF_VALUE];
	uint64_t number;
	bool ended; /* the section of entities */
};

/* The next pair; one that is missing is an error. Values longer than there is room are cut. */
int lines_dxf_pair(struct lines_dxf *);
/* The value as a decimal or an integer. */
int lines_dxf_number(struct lines_dxf *, struct decimal *ret);
int lines_dxf_integer(struct lines_dxf *, int64_t *ret);
/* The entity whose pair 0 was read last becomes the feature, from lines_begin to lines_end. Ends at the next pair 0.
 * *ret_none: it was none of its own. */
int lines_dxf_entity(struct lines_dxf *, bool *ret_none);

#endif
