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

/* For slopes: metres of a unit. A degree is as good as for the hillshade of a picture; unknown units count as equal. */
static double metres_of(const char *unit)
{
	int64_t num, den;

	if (unit && !strcmp(unit, "degree"))
		return 111320;
	return format_unit_ratio(unit, "metre", &num, &den) ? (double)num / (double)den : 0;
}

static double steep(const struct acut_mesh_head *head)
{
	double xy = metres_of(head->unit_xy), z = metres_of(head->unit_z);

	if (xy > 1000 && z <= 0)
		return 1 / xy;
	return xy > 0 && z > 0 ? z / xy : 1;
}

static int cell_units(const struct format_options *opt, const struct acut_mesh_head *head, struct dem_options *to,
		      struct err *err)
{
	if (!opt->cell_unit || format_unit_ratio(opt->cell_unit, head->unit_xy, &to->cell_num, &to->cell_den))
		return 0;
	err_set(err, ERR_USAGE, "--cell is in %s, but the unit of x and y is %.30s", opt->cell_unit,
		head->unit_xy && *head->unit_xy ? head->unit_xy : "unknown");
	return err_add_hint(err, head->unit_xy && !strcmp(head->unit_xy, "degree") ?
					 "give a bare number of degrees" :
					 "give a bare number in the units of the files, or stage the inputs with --assume-units");
}

static int z_units(const struct format_options *opt, const struct acut_mesh_head *head, struct dem_options *to, struct err *err)
{
	if (!opt->z_unit)
		return 0;
	if (!format_unit_ratio(head->unit_z, opt->z_unit, &to->z_num, &to->z_den)) {
		err_set(err, ERR_USAGE, "--z-unit cannot convert heights: the unit of z is %.30s",
			head->unit_z && *head->unit_z ? head->unit_z : "unknown");
		return err_add_hint(err, "stage the inputs with --assume-units ,m or ,ft or ,ftUS, for inputs without units");
	}
	to->unit_z = opt->z_unit;
	to->z_converted = to->z_num != to->z_den;
	return 0;
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
	struct dem_options to = {
		.kind = kind[w->opt.raster],
		.cell = w->opt.cell,
		.cell_num = 1,
		.cell_den = 1,
		.z_num = 1,
		.z_den = 1,
		.steep = steep(head),
		.unit_xy = head->unit_xy,
		.unit_z = head->unit_z,
		.cache = w->opt.rasters > 1 ? (w->opt.rasters < DEM_CACHE / 2 ? DEM_CACHE / w->opt.rasters : 2) : 0,
		.interrupted = w->opt.interrupted,
		.ctx = w->opt.ctx,
	};
	int r = cell_units(&w->opt, head, &to, err);

	if (w->opt.tiled)
		dem_tiled(w->dem);
	if (!r)
		r = z_units(&w->opt, head, &to, err);
	if (!r)
		r = dem_head(w->dem, head, &to, err);
	return r ? r : format_comment_head(head, &w->opt, describe, w->dem, err);
}

static int tif_block(void *writer, const struct format_block *block, struct err *err)
{
	struct writer *w = writer;
	const struct acut_mesh_block *b = block->mesh;
	int r = 0;

	for (uint32_t i = 0; i < b->ntriangle && !r; i++) {
		const uint32_t *t = b->triangle[i];

		r = dem_triangle(w->dem, block->position[t[0]], block->position[t[1]], block->position[t[2]], err);
	}
	return r;
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
