/*
 * GeoTIFF: an elevation model of the mesh, or its slopes or hillshade. The room dem draws and writes it; here its options
 * become numbers of the file's units.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dem.h"
#include "err.h"
#include "format_axis.h"
#include "format_dem.h"

struct writer {
	struct dem *dem;
	struct format_options opt;
};

static int tif_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	struct writer *w;
	int r;

	if (!opt->cell.mantissa) {
		err_set(err, ERR_USAGE, "tif needs the side of a pixel: --cell");
		return err_add_hint(err, "give it in the units of the files, or with m, ft or ftUS, as in --cell 1m");
	}
	w = calloc(1, sizeof(*w));
	if (!w)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	w->opt = *opt;
	r = dem_new(out, &w->dem, err);
	if (r)
		free(w);
	else
		*ret = w;
	return r;
}

/* Pixels are not on the lattice, and its offset depends on how the points were pushed. */
static int describe(void *ctx, const char *text, struct err *err)
{
	return strncmp(text, "acut-lattice ", 13) ? dem_describe(ctx, text, err) : 0;
}

static int tif_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	static const enum dem_kind kind[] = {DEM_ELEVATION, DEM_SLOPE, DEM_HILLSHADE};
	struct writer *w = writer;
	struct dem_options to;
	int r = format_dem_options(&w->opt, head, kind[w->opt.raster], &to, err);

	if (w->opt.tiled)
		dem_tiled(w->dem);
	if (!r)
		r = dem_head(w->dem, head, &to, err);
	return r ? r : format_comment_head(head, &w->opt, describe, w->dem, err);
}

static int tif_block(void *writer, const struct format_block *block, struct err *err)
{
	return format_dem_block(((struct writer *)writer)->dem, block, err);
}

static int tif_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	struct writer *w = writer;
	char text[128];
	int r;

	snprintf(text, sizeof(text), "acut-digest %s %s", tail->digest, tail->vertex_digest);
	r = dem_describe(w->dem, text, err);
	return r ? r : dem_finish(w->dem, tail->vertices ? tail->box : NULL, err);
}

/* Without the digest of the mesh: a tile with the same pixels is the same file. */
static int tif_tiles(void *writer, const struct dem_tiler *tiler, const struct acut_mesh_tail *tail, struct err *err)
{
	struct writer *w = writer;

	return tail->vertices ? dem_finish_tiles(w->dem, tiler, err) : 0;
}

static void *tif_free(void *writer)
{
	struct writer *w = writer;

	if (w)
		dem_free(w->dem);
	free(w);
	return NULL;
}

const struct format format_tif = {
	.name = "tif",
	.extensions = ".tif .tiff",
	.help = "GeoTIFF of elevations, slopes or hillshade, laid out as a COG (--cell, --raster)",
	.purpose = "DEM: QGIS (raster layer), GDAL",
	.kind = FORMAT_RASTER,
	.takes = FORMAT_Z_UNIT | FORMAT_CELL | FORMAT_RASTERED,
	.positions = true,
	.open = tif_open,
	.head = tif_head,
	.block = tif_block,
	.finish = tif_finish,
	.tiles = tif_tiles,
	.free = tif_free,
};
