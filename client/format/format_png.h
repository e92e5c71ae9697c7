/* Pictures whose pixels are those of a raster (format_png_cell.c), for the row of PNG. */
#ifndef FORMAT_PNG_H
#define FORMAT_PNG_H

#include "format.h"

struct format_png_cell;
/* -ERR_USAGE: options that do not go together. */
int format_png_cell_new(struct outfile *, const struct format_options *, struct format_png_cell **ret, struct err *);
int format_png_cell_head(struct format_png_cell *, const struct acut_mesh_head *, struct err *);
int format_png_cell_block(struct format_png_cell *, const struct format_block *, struct err *);
int format_png_cell_finish(struct format_png_cell *, const struct acut_mesh_tail *, struct err *);
int format_png_cell_tiles(struct format_png_cell *, const struct dem_tiler *, const struct acut_mesh_tail *, struct err *);
struct format_png_cell *format_png_cell_free(struct format_png_cell *);
const char *const *format_png_cell_beside(const struct format_options *);
int format_png_cell_text(const struct format_png_cell *, unsigned i, char **ret, struct err *);

#endif
