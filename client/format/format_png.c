/*
 * PNG: a picture of the mesh from above, north up, drawn while it streams by.
 *
 * Memory is the picture's (4 bytes a pixel, 8 with domains), not the mesh's. The picture is laid out over
 * the box that the stream announces; margins that no triangle covers are cut off at the end, because that box
 * may be larger than the mesh (points that the view leaves out count in it). With --cell it is another picture
 * (format_png_cell.c).
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "format_domain.h"
#include "format_png.h"
#include "format_png_file.h"
#include "format_raster.h"
#include "outfile.h"

struct picture {
	struct format_png_cell *cell; /* not NULL: it has all the rest */
	struct outfile *out;
	struct format_options opt;
	struct format_raster raster;
	struct acut_mesh_head head; /* scales and units only */
	char scale_xy[64], scale_z[64], unit_xy[64], unit_z[64];
	struct format_png_file file;
};

static int png_open_writer(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	struct picture *p;
	int r;

	if (!opt->cell.mantissa && opt->has_raster)
		return err_set(err, ERR_USAGE, "--raster needs the side of a pixel: --cell");
	if (opt->width > FORMAT_WIDTH_MAX)
		return err_set(err, ERR_USAGE, "--width is more than %d", FORMAT_WIDTH_MAX);
	p = calloc(1, sizeof(*p));
	if (!p)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	p->out = out;
	p->opt = *opt;
	if (!p->opt.width)
		p->opt.width = FORMAT_WIDTH;
	r = opt->cell.mantissa ? format_png_cell_new(out, opt, &p->cell, err) : 0;
	if (r)
		free(p);
	else
		*ret = p;
	return r;
}

static const char *keep(char *to, size_t size, const char *text)
{
	strncpy(to, text ? text : "", size - 1);
	return to;
}

static int png_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	struct picture *p = writer;

	if (p->cell)
		return format_png_cell_head(p->cell, head, err);
	p->head.scale_xy = keep(p->scale_xy, sizeof(p->scale_xy), head->scale_xy);
	p->head.scale_z = keep(p->scale_z, sizeof(p->scale_z), head->scale_z);
	p->head.unit_xy = keep(p->unit_xy, sizeof(p->unit_xy), head->unit_xy);
	p->head.unit_z = keep(p->unit_z, sizeof(p->unit_z), head->unit_z);
	return format_raster_init(&p->raster, head->box, head->box + 3, p->opt.width, p->opt.color == FORMAT_DOMAIN, p->opt.lines,
				  err);
}

static int png_block(void *writer, const struct format_block *block, struct err *err)
{
	struct picture *p = writer;
	const struct acut_mesh_block *b = block->mesh;
	uint32_t domain = format_domain(b->box);

	if (p->cell)
		return format_png_cell_block(p->cell, block, err);
	for (uint32_t i = 0; i < b->ntriangle; i++) {
		const uint32_t *t = b->triangle[i];

		format_raster_triangle(&p->raster, block->position[t[0]], block->position[t[1]], block->position[t[2]], domain);
		for (unsigned k = 0; k < 3 && p->raster.line && b->flags; k++)
			if (b->flags[i] >> k & 1)
				format_raster_line(&p->raster, block->position[t[(k + 1) % 3]], block->position[t[(k + 2) % 3]]);
	}
	return 0;
}

struct frame {
	uint32_t x0, y0, x1, y1;
};

/* The covered part of the raster; one transparent pixel if there is none. */
static struct frame covered(const struct format_raster *r)
{
	struct frame f = {r->w, r->h, 0, 0};

	for (uint32_t y = 0; y < r->h; y++) {
		const float *z = r->z + (size_t)y * r->w;
		for (uint32_t x = 0; x < r->w; x++) {
			if (isnan(z[x]))
				continue;
			f.x0 = x < f.x0 ? x : f.x0;
			f.x1 = x >= f.x1 ? x + 1 : f.x1;
			f.y0 = y < f.y0 ? y : f.y0;
			f.y1 = y + 1;
		}
	}
	return f.x1 ? f : (struct frame){0, 0, 1, 1};
}

static int png_encode(struct picture *p, const struct format_paint *paint, struct frame f, uint8_t *row, struct err *err)
{
	int r = format_png_begin(&p->file, p->out, f.x1 - f.x0, f.y1 - f.y0, true, err);

	for (uint32_t y = f.y0; y < f.y1 && !r; y++) {
		format_paint_row(paint, y, f.x0, f.x1, row);
		r = format_png_row(&p->file, row, err);
	}
	return r ? r : format_png_end(&p->file, err);
}

static int png_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	struct picture *p = writer;
	struct format_paint paint;
	struct frame f;
	uint8_t *row;
	int r;

	if (p->cell)
		return format_png_cell_finish(p->cell, tail, err);
	f = covered(&p->raster);
	row = malloc((size_t)(f.x1 - f.x0) * 4);
	if (!row)
		return err_set(err, ERR_NOMEM, "no memory to encode a picture");
	format_paint_init(&paint, &p->raster, &p->head, p->opt.color);
	r = png_encode(p, &paint, f, row, err);
	free(row);
	return r;
}

/* With --cell only. */
static int png_tiles(void *writer, const struct dem_tiler *tiler, const struct acut_mesh_tail *tail, struct err *err)
{
	struct picture *p = writer;

	return format_png_cell_tiles(p->cell, tiler, tail, err);
}

static void *png_free_writer(void *writer)
{
	struct picture *p = writer;

	if (p) {
		format_raster_done(&p->raster);
		format_png_cell_free(p->cell);
		format_png_done(&p->file);
	}
	free(p);
	return NULL;
}

static int png_beside(const void *writer, unsigned i, char **ret, struct err *err)
{
	const struct picture *p = writer;

	return format_png_cell_text(p->cell, i, ret, err);
}

const struct format format_png = {
	.name = "png",
	.extensions = ".png",
	.help = "a picture from above: hillshade, elevation or domains (--color, --width), or aligned to --cell",
	.purpose = "a look at it",
	.kind = FORMAT_PICTURE,
	.takes = FORMAT_SIZED | FORMAT_COLORED | FORMAT_CELL | FORMAT_RASTERED,
	.positions = true,
	.open = png_open_writer,
	.head = png_head,
	.block = png_block,
	.finish = png_finish,
	.tiles = png_tiles,
	.beside = format_png_cell_beside,
	.beside_text = png_beside,
	.free = png_free_writer,
};
