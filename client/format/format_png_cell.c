/*
 * PNG with --cell: a hillshade whose pixels are those of the rasters of this cell (the room dem draws it), in grey, transparent
 * where there is no mesh. A world file and, where the plane has an EPSG number or a WKT, GDAL's .aux.xml say where it is.
 *
 * Memory is that of a raster, not of the picture. Numbers have no place in 8 bits: heights and slopes are written as tif.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "format_dem.h"
#include "format_png.h"
#include "format_png_file.h"
#include "format_text.h"
#include "outfile.h"

struct format_png_cell {
	struct format_options opt;
	struct dem *dem;
	struct dem_frame frame;
	struct format_png_file file;
};

static int check(const struct format_options *opt, struct err *err)
{
	if (opt->width)
		return err_set(err, ERR_USAGE, "--width and --cell are two sizes of a pixel, and a picture has one");
	if (opt->color)
		return err_set(err, ERR_USAGE, "--color has no meaning for a picture with --cell, which is a hillshade");
	if (opt->has_raster && opt->raster != FORMAT_SHADES) {
		err_set(err, ERR_USAGE, "a png holds no heights or slopes, but --raster hillshade");
		return err_add_hint(err, "write tif, which holds numbers");
	}
	return 0;
}

int format_png_cell_new(struct outfile *out, const struct format_options *opt, struct format_png_cell **ret, struct err *err)
{
	int r = check(opt, err);
	struct format_png_cell *p = r ? NULL : calloc(1, sizeof(*p));

	if (r)
		return r;
	if (!p)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	p->opt = *opt;
	r = dem_new(out, &p->dem, err);
	if (r)
		free(p);
	else
		*ret = p;
	return r;
}

int format_png_cell_head(struct format_png_cell *p, const struct acut_mesh_head *head, struct err *err)
{
	struct dem_options to;
	int r = format_dem_options(&p->opt, head, DEM_HILLSHADE, &to, err);

	if (p->opt.tiled)
		dem_tiled(p->dem);
	return r ? r : dem_head(p->dem, head, &to, err);
}

int format_png_cell_block(struct format_png_cell *p, const struct format_block *block, struct err *err)
{
	return format_dem_block(p->dem, block, err);
}

/* ---- the picture ---- */

static int begin(void *ctx, const struct dem_frame *frame, struct err *err)
{
	struct format_png_cell *p = ctx;

	p->frame = *frame;
	return format_png_begin(&p->file, frame->out, frame->width, frame->height, false, err);
}

static int put_row(void *ctx, const uint8_t *grey, struct err *err)
{
	return format_png_row(&((struct format_png_cell *)ctx)->file, grey, err);
}

static int end(void *ctx, struct err *err)
{
	return format_png_end(&((struct format_png_cell *)ctx)->file, err);
}

int format_png_cell_finish(struct format_png_cell *p, const struct acut_mesh_tail *tail, struct err *err)
{
	const struct dem_rows rows = {begin, put_row, end, p};

	return dem_finish_rows(p->dem, tail->vertices ? tail->box : NULL, &rows, err);
}

int format_png_cell_tiles(struct format_png_cell *p, const struct dem_tiler *given, const struct acut_mesh_tail *tail,
			  struct err *err)
{
	const struct dem_rows rows = {begin, put_row, end, p};
	struct dem_tiler tiler = *given;

	tiler.rows = &rows;
	return tail->vertices ? dem_finish_tiles(p->dem, &tiler, err) : 0;
}

struct format_png_cell *format_png_cell_free(struct format_png_cell *p)
{
	if (!p)
		return NULL;
	format_png_done(&p->file);
	dem_free(p->dem);
	free(p);
	return NULL;
}

/* ---- where it is ---- */

const char *const *format_png_cell_beside(const struct format_options *opt)
{
	static const char *const name[] = {".pgw", "+.aux.xml", NULL};

	return opt->cell.mantissa ? name : NULL;
}

/* The shortest text that is read back as v. */
static const char *number(double v, char buf[DECIMAL_TEXT_SIZE])
{
	struct decimal d;

	return decimal_from_double(v, &d) ? decimal_text(d, buf) : "0";
}

static int wkt_text(const char *wkt, char **ret, struct err *err)
{
	size_t size = strlen(wkt) * FORMAT_TEXT_GROWTH + 1;
	char *text = malloc(size);
	int n = -1;

	if (text)
		n = asprintf(ret, "<PAMDataset>\n  <SRS>%s</SRS>\n</PAMDataset>\n",
			     format_text(FORMAT_TEXT_XML, wkt, text, size));
	free(text);
	return n < 0 ? err_set(err, ERR_NOMEM, "no memory for the system of a picture") : 0;
}

int format_png_cell_text(const struct format_png_cell *p, unsigned i, char **ret, struct err *err)
{
	char side[DECIMAL_TEXT_SIZE], low[DECIMAL_TEXT_SIZE], left[DECIMAL_TEXT_SIZE], top[DECIMAL_TEXT_SIZE];
	int n = 0;

	*ret = NULL;
	if (!i)
		n = asprintf(ret, "%s\n0\n0\n%s\n%s\n%s\n", number(p->frame.side, side), number(-p->frame.side, low),
			     number(p->frame.left, left), number(p->frame.top, top));
	else if (!p->frame.epsg && p->frame.wkt)
		return wkt_text(p->frame.wkt, ret, err);
	else if (p->frame.epsg)
		n = asprintf(ret, "<PAMDataset>\n  <SRS>EPSG:%u</SRS>\n</PAMDataset>\n", p->frame.epsg);
	return n < 0 ? err_set(err, ERR_NOMEM, "no memory for a world file") : 0;
}
