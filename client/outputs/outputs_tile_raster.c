/*
 * The tiles of a raster, and of lines.
 *
 * The format has drawn all of it and divides it (dem.h): each pixel is in the tile that has its centre, and tiles without a
 * height are left out, as tiles without triangles are. So tiles together are the whole raster, pixel for pixel. What stands
 * beside a picture, as its world file, stands beside each of its tiles; all tiles have the same of these files.
 *
 * Lines are cut at the borders of tiles (contour.h); tiles without lines are left out.
 */
#include <stdlib.h>
#include <string.h>

#include "dem.h"
#include "err.h"
#include "grow.h"
#include "outputs_tile.h"

static int tile_begin(void *ctx, const int64_t at[2], struct outfile **ret, struct err *err)
{
	struct outputs_tiles *t = ctx;
	char name[OUTFILE_NAME];
	int r = outputs_interrupted(&t->run, err);

	return r ? r : outfile_folder_file(t->place, outputs_tiles_name_at(t, at, name), ret, err);
}

static int keep(struct outputs_tiles *t, const struct outputs_tile *tile, struct err *err)
{
	if (t->ntile == outputs_tiles_most(t))
		return outputs_tiles_too_many(t, err);
	if (!grow(&t->tile, &t->nslot, t->ntile + 1, 64, sizeof(*t->tile)))
		return err_set(err, ERR_NOMEM, "no memory for %zu tiles", t->ntile + 1);
	t->tile[t->ntile++] = *tile;
	return 0;
}

static int put_beside(struct outputs_tiles *t, const char *tile, const char *suffix, const char *text, struct err *err)
{
	char name[OUTFILE_NAME];
	struct outfile *out;
	int r;

	outputs_beside_name(tile, suffix, name, sizeof(name));
	r = outfile_folder_file(t->place, name, &out, err);
	if (r)
		return r;
	r = outputs_beside_write(out, text, err);
	if (!r)
		r = outfile_publish(out, err);
	t->beside_bytes += outfile_size(out);
	outfile_free(out);
	return r;
}

/* The files beside the tile that the writer has just made. */
static int make_beside(struct outputs_tiles *t, const int64_t at[2], struct err *err)
{
	const char *const *suffix = t->format->beside ? t->format->beside(&t->opt) : NULL;
	char tile[OUTFILE_NAME];
	int r = 0;

	outputs_tiles_name_at(t, at, tile);
	t->nbeside = 0;
	for (unsigned i = 0; suffix && suffix[i] && !r; i++) {
		char *text = NULL;

		r = t->format->beside_text(t->writer, i, &text, err);
		if (!r && text) {
			t->beside[t->nbeside++] = suffix[i];
			r = put_beside(t, tile, suffix[i], text, err);
		}
		free(text);
	}
	return r;
}

static int tile_end(void *ctx, const int64_t at[2], struct outfile *out, const struct dem_tile *got, struct err *err)
{
	struct outputs_tiles *t = ctx;
	struct outputs_tile tile = {.pixels = {got->width, got->height}};
	uint64_t column = (uint64_t)(at[0] - t->grid.first[0]), row = (uint64_t)(at[1] - t->grid.first[1]);
	int r = 0;

	tile.number = row << 32 | column;
	memcpy(tile.edge, got->box, sizeof(tile.edge));
	if (!got->no_heights && (column >= t->grid.count[0] || row >= t->grid.count[1]))
		r = err_set(err, ERR_INTERNAL, "a tile is outside of the box that the stream announced");
	if (!r && !got->no_heights)
		r = outfile_publish(out, err);
	tile.bytes = outfile_size(out);
	if (!r && !got->no_heights)
		r = make_beside(t, at, err);
	if (!r && !got->no_heights)
		r = keep(t, &tile, err);
	outfile_free(out);
	return r;
}

static int lines_end(void *ctx, const int64_t at[2], struct outfile *out, const double box[4], uint64_t lines, struct err *err)
{
	struct outputs_tiles *t = ctx;
	uint64_t column = (uint64_t)(at[0] - t->grid.first[0]), row = (uint64_t)(at[1] - t->grid.first[1]);
	struct outputs_tile tile = {.number = row << 32 | column, .lines = lines};
	int r = column < t->grid.count[0] && row < t->grid.count[1] ?
			outfile_publish(out, err) :
			err_set(err, ERR_PROTO, "a line is outside of the box that the stream announced");

	memcpy(tile.edge, box, sizeof(tile.edge));
	tile.bytes = outfile_size(out);
	outfile_free(out);
	return r ? r : keep(t, &tile, err);
}

void outputs_tiles_tile(struct outputs_tiles *t)
{
	const struct format_tiler tiler = {
		.p = t->grid.p, .q = t->grid.q, .most = OUTPUTS_TILES, .begin = tile_begin, .end = lines_end, .ctx = t};

	t->format->tile(t->writer, &tiler);
}

int outputs_tiles_raster(struct outputs_tiles *t, struct err *err)
{
	const struct dem_tiler tiler = {
		.p = t->grid.p, .q = t->grid.q, .most = OUTPUTS_TILES, .begin = tile_begin, .end = tile_end, .ctx = t};
	int r;

	if (!t->format->tile_lines)
		return t->format->tiles(t->writer, &tiler, &t->tail.is, err);
	r = t->format->tile_lines(t->writer, &t->tail.is, err);
	outputs_tiles_order(t);
	return r;
}
