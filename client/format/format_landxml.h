/* LandXML, for its files: what is around points and faces. */
#ifndef FORMAT_LANDXML_H
#define FORMAT_LANDXML_H

#include "format.h"

/* Up to the first point. -ERR_USAGE: the units are not known, or not one. */
int format_landxml_head(struct outfile *, const struct acut_mesh_head *, const struct format_options *, struct err *err);
/* After the last face; both texts are "NAME VALUE". */
int format_landxml_tail(struct outfile *, const char *counts, const char *digest, struct err *err);

#endif
