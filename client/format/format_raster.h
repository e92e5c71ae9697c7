/* Triangles to pixels, and pixels to colours. */
#ifndef FORMAT_RASTER_H
#define FORMAT_RASTER_H

#include "format.h"

struct format_raster {
	uint32_t w, h;
	float *z;         /* lattice numbers, row 0 is the north; NaN where nothing is */
	uint32_t *domain; /* NULL unless asked for; hash of the region */
	uint8_t *line;    /* NULL unless asked for; 1 where a line goes */
	int32_t min[2];
	double factor; /* sub-pixels a lattice unit */
};
#define FORMAT_SUBPIXEL 256
/* For the box (min x y, max x y); the picture is `width` pixels wide, less if it would be very high. */
int format_raster_init(struct format_raster *, const int32_t min[2], const int32_t max[2], uint32_t width, bool domains,
		       bool lines, struct err *err);
void format_raster_triangle(struct format_raster *, const int32_t *a, const int32_t *b, const int32_t *c, uint32_t domain);
/* Every pixel that is nearest to the segment in its row or column, whichever it crosses more of. */
void format_raster_line(struct format_raster *, const int32_t *a, const int32_t *b);
void format_raster_done(struct format_raster *);

/* ---- pixels to colours: format_paint.c ---- */

struct format_paint {
	const struct format_raster *raster;
	enum format_color color;
	double cell, height; /* xy length of a pixel, z length of a number, in one unit */
	float low, high;     /* z numbers at the ends of the ramp */
};
void format_paint_init(struct format_paint *, const struct format_raster *, const struct acut_mesh_head *, enum format_color);
/* RGBA of the pixels x0 <= x < x1 of one row. */
void format_paint_row(const struct format_paint *, uint32_t y, uint32_t x0, uint32_t x1, uint8_t *ret);

#endif
