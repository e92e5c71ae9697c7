/*
 * --tile: the triangles of a mesh into the tiles of a grid, each into exactly one.
 *
 * A tile is the square [i * SIZE, (i + 1) * SIZE) of each axis, in absolute coordinates, and has the triangles whose centroid
 * is in it. The rule is exact: the sum of three absolute lattice numbers, times the scale, is compared with 3 * i * SIZE in
 * whole numbers. It depends on the triangle alone, so two meshes with the same triangles in a tile have the same tile.
 *
 * Every triangle goes into one external sort, by tile and then by its corners; the files are made from it after the whole
 * stream was checked (outputs_tile_make.c). Only tiles with triangles are stored, in a hash table by number: the box that a
 * stream announces may have thousands of millions of tiles, since one point far away is enough for that. Memory is that of
 * the sort and some hundred bytes a tile; one nameless file has the rest.
 *
 * A raster is drawn as a whole and divides itself: a pixel is in the tile that has its centre (outputs_tile_raster.c). So do
 * lines, which are cut at the borders.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "outputs_tile.h"
#include "wide.h"

#define SHARE 2 /* the sort of all has one of these of the memory, that of one tile the other */

typedef __int128 i128;

static int tiles_check(const char *dir, const struct format *format, const struct format_options *opt, struct decimal size,
		       struct err *err)
{
	if (!dir || format->kind == FORMAT_NOTHING)
		return err_set(err, ERR_USAGE, "%s writes nothing: there are no tiles to write", format->name);
	if (!strcmp(dir, "-")) {
		err_set(err, ERR_USAGE, "tiles are files in a folder and cannot go to standard output");
		return err_add_hint(err, "give a folder, as in -o tiles/");
	}
	if (opt->sidecar) {
		err_set(err, ERR_USAGE, "--sidecar has no meaning for tiles");
		return err_add_hint(err, OUTPUTS_TILES_INDEX " says what they are");
	}
	if (format->kind == FORMAT_PICTURE && opt->color == FORMAT_DOMAIN)
		return err_set(err, ERR_USAGE, "--color domain has no meaning for tiles: they do not keep the domains");
	if (format->kind == FORMAT_LINES && opt->simplify.mantissa) {
		err_set(err, ERR_USAGE,
			"--simplify and --tile do not go together: lines would be cut before they are simplified");
		return err_add_hint(err, "write one file with --simplify, or tiles of exact lines");
	}
	if (size.mantissa <= 0)
		return err_set(err, ERR_USAGE, "--tile is not a length above zero");
	return 0;
}

int outputs_tiles_new(const char *dir, const struct format *format, const struct format_options *opt,
		      const struct outputs_options *run, struct outputs_tiles **ret, struct err *err)
{
	int r = tiles_check(dir, format, opt, run->tile, err);
	struct outputs_tiles *t = r ? NULL : calloc(1, sizeof(*t));

	if (r)
		return r;
	if (!t)
		return err_set(err, ERR_NOMEM, "no memory for tiles");
	t->format = format;
	t->opt = *opt;
	t->opt.canonical = format->kind == FORMAT_MESH; /* they come sorted, vertices first */
	t->run = *run;
	for (t->size = run->tile; t->size.exponent > 0 && t->size.mantissa < INT64_MAX / 10; t->size.exponent--)
		t->size.mantissa *= 10;
	if (t->size.exponent > 0 || t->size.exponent < -40)
		r = err_set(err, ERR_USAGE, "--tile is no length that a mesh can have");
	if (!r)
		r = outfile_folder_hold(dir, OUTPUTS_TILES_INDEX, opt->no_clobber, run->part, run->joins, &t->place, err);
	if (!r)
		r = outfile_folder_file(t->place, OUTPUTS_TILES_INDEX, &t->index, err);
	t->opt.tiled = true;
	t->divides = (format->tiles && (format->kind == FORMAT_RASTER || opt->cell.mantissa)) || format->tile_lines;
	if (!r && !run->joins)
		r = t->divides ? format->open(t->index, &t->opt, &t->writer, err) :
				 sort_new(OUTPUTS_TILE_WORDS, 4, run->sort_memory / SHARE, t->index, &t->sort, err);
	if (!r && t->sort)
		sort_interrupt(t->sort, run->interrupted, run->ctx);
	if (r) {
		outputs_tiles_free(t);
		return r;
	}
	*ret = t;
	return 0;
}

struct outputs_tiles *outputs_tiles_free(struct outputs_tiles *t)
{
	if (!t)
		return NULL;
	sort_free(t->sort);
	if (t->writer)
		t->format->free(t->writer);
	outfile_free(t->index);
	outfile_folder_free(t->place);
	outputs_head_done(&t->copy);
	outputs_passed_free(&t->passed);
	free(t->tile);
	free(t->slot);
	free(t);
	return NULL;
}

/* ---- the grid ---- */

/* The tile of an axis by the sum of three absolute lattice numbers: below 2^64 * 2^60. */
static i128 tile_of(const struct outputs_grid *g, i128 sum)
{
	return wide_floor(sum * (i128)g->q, (i128)g->p * 3);
}

static int lay_out(struct outputs_grid *g, const struct acut_mesh_head *h, struct err *err)
{
	for (int i = 0; i < 2 && h->box[0] <= h->box[3] && h->box[1] <= h->box[4]; i++) {
		i128 first = tile_of(g, 3 * ((i128)h->box[i] + h->k[i])), last = tile_of(g, 3 * ((i128)h->box[i + 3] + h->k[i]));

		if (first < INT64_MIN / 2 || last > INT64_MAX / 2)
			return err_set(err, ERR_USAGE, "--tile is too small: the numbers of the tiles have more than 62 bits");
		if (last - first > UINT32_MAX)
			return err_set(err, ERR_USAGE, "--tile is too small: there would be more than 2^32 columns or rows");
		g->first[i] = (int64_t)first;
		g->count[i] = (uint64_t)(last - first) + 1;
	}
	return 0;
}

int outputs_grid_init(struct outputs_grid *g, struct decimal tile, const struct acut_mesh_head *h, struct err *err)
{
	struct decimal scale;

	*g = (struct outputs_grid){.k = {h->k[0], h->k[1]}};
	if (!decimal_parse(h->scale_xy, &scale) || scale.mantissa <= 0)
		return err_set(err, ERR_PROTO, "the stream's xy scale is not a number above zero");
	if (!outputs_edge_ratio(tile, 1, 1, scale, &g->p, &g->q) || g->q >> 60) {
		err_set(err, ERR_USAGE, "--tile has too many digits beside the scale %s", h->scale_xy);
		return err_add_hint(err, "give --tile with fewer decimals");
	}
	return lay_out(g, h, err);
}

void outputs_grid_at(const struct outputs_grid *g, const int32_t corner[2], uint32_t ret[2])
{
	for (int i = 0; i < 2; i++) {
		i128 at = tile_of(g, 3 * ((i128)corner[i] + g->k[i])) - g->first[i];

		ret[i] = at < 0 ? 0 : at > UINT32_MAX ? UINT32_MAX : (uint32_t)at;
	}
}

bool outputs_tiles_at(const struct outputs_tiles *t, const int32_t *const corner[3], uint64_t ret[2])
{
	for (int k = 0; k < 2; k++) {
		i128 sum = 3 * (i128)t->head.k[k] + corner[0][k] + corner[1][k] + corner[2][k];

		ret[k] = (uint64_t)(tile_of(&t->grid, sum) - t->grid.first[k]);
	}
	return ret[0] < t->grid.count[0] && ret[1] < t->grid.count[1];
}

int outputs_tiles_head(struct outputs_tiles *t, const struct acut_mesh_head *head, struct err *err)
{
	int r = outputs_head_copy(&t->copy, head, err);

	t->head = t->copy.is;
	if (!r)
		r = outputs_grid_init(&t->grid, t->run.tile, &t->head, err);
	if (!r && t->writer && t->format->tile)
		outputs_tiles_tile(t);
	return r || !t->writer ? r : t->format->head(t->writer, head, err);
}

void outputs_tiles_number(const struct outputs_tiles *t, size_t i, int64_t ret[2])
{
	ret[0] = t->grid.first[0] + (int64_t)(uint32_t)t->tile[i].number;
	ret[1] = t->grid.first[1] + (int64_t)(t->tile[i].number >> 32);
}

const char *outputs_tiles_name_at(const struct outputs_tiles *t, const int64_t at[2], char buf[OUTFILE_NAME])
{
	const char *extension = *t->format->extensions ? t->format->extensions : ".dxf"; /* dxf-contours has none of its own */

	snprintf(buf, OUTFILE_NAME, "tile_%lld_%lld%.*s", (long long)at[0], (long long)at[1], (int)strcspn(extension, " "),
		 extension);
	return buf;
}

const char *outputs_tiles_name(void *tiles, size_t i, char buf[OUTFILE_NAME])
{
	int64_t at[2];

	outputs_tiles_number(tiles, i, at);
	return outputs_tiles_name_at(tiles, at, buf);
}

/* With the files beside it, which come first. */
static const char *file_name(void *tiles, size_t i, char buf[OUTFILE_NAME])
{
	const struct outputs_tiles *t = tiles;
	size_t each = t->nbeside + 1, k = i % each;
	char name[OUTFILE_NAME];

	outputs_tiles_name(tiles, i / each, name);
	if (k < t->nbeside)
		outputs_beside_name(name, t->beside[k], buf, OUTFILE_NAME);
	else
		memcpy(buf, name, sizeof(name));
	return buf;
}

/* ---- the tiles that have triangles ---- */

/* The caller's limit is one of memory for tiles of triangles; rasters and lines divide themselves. */
static bool by_memory(const struct outputs_tiles *t)
{
	return t->run.tiles_most && !t->divides;
}

uint64_t outputs_tiles_most(const struct outputs_tiles *t)
{
	return by_memory(t) ? t->run.tiles_most : OUTPUTS_TILES;
}

int outputs_tiles_too_many(const struct outputs_tiles *t, struct err *err)
{
	char size[DECIMAL_TEXT_SIZE];

	err_set(err, ERR_USAGE, "the mesh is in more than %llu tiles of %s", (unsigned long long)outputs_tiles_most(t),
		decimal_text(t->run.tile, size));
	return err_add_hint(err,
			    by_memory(t) ? "give a larger --tile, or tasks more memory (--task-memory)" : "give a larger --tile");
}

/* Where `number` is in the table of slots, or would be. */
static size_t slot_of(const struct outputs_tiles *t, uint64_t number)
{
	size_t i = (size_t)(number * 0x9e3779b97f4a7c15u >> 32) & (t->nslot - 1);

	while (t->slot[i] && t->tile[t->slot[i] - 1].number != number)
		i = (i + 1) & (t->nslot - 1);
	return i;
}

/* Room for one more tile; at least half of the slots stay empty. */
static int grow(struct outputs_tiles *t, struct err *err)
{
	size_t room = t->nslot ? t->nslot : 64; /* of tiles: half of the slots to be */
	struct outputs_tile *tile;
	uint32_t *slot;

	if (t->ntile < t->nslot / 2)
		return 0;
	tile = realloc(t->tile, room * sizeof(*tile));
	if (tile)
		t->tile = tile;
	slot = tile ? calloc(2 * room, sizeof(*slot)) : NULL;
	if (!slot)
		return err_set(err, ERR_NOMEM, "no memory for %zu tiles", room);
	free(t->slot);
	t->slot = slot;
	t->nslot = 2 * room;
	for (size_t i = 0; i < t->ntile; i++)
		t->slot[slot_of(t, t->tile[i].number)] = (uint32_t)i + 1;
	return 0;
}

static int find_tile(struct outputs_tiles *t, uint64_t number, struct outputs_tile **ret, struct err *err)
{
	int r = grow(t, err);
	size_t i = r ? 0 : slot_of(t, number);

	if (!r && !t->slot[i]) {
		if (t->ntile == outputs_tiles_most(t))
			return outputs_tiles_too_many(t, err);
		t->tile[t->ntile] = (struct outputs_tile){.number = number};
		t->slot[i] = (uint32_t)++t->ntile;
	}
	if (!r)
		*ret = &t->tile[t->slot[i] - 1];
	return r;
}

static int by_number(const void *a, const void *b)
{
	const struct outputs_tile *x = a, *y = b;

	return x->number < y->number ? -1 : x->number > y->number;
}

void outputs_tiles_order(struct outputs_tiles *t)
{
	if (t->ntile)
		qsort(t->tile, t->ntile, sizeof(*t->tile), by_number);
	free(t->slot); /* which does not know them any more */
	t->slot = NULL;
	t->nslot = 0;
}

/* ---- triangles ---- */

static void grow_box(int32_t box[6], const int32_t *p, bool first)
{
	for (int k = 0; k < 3; k++) {
		box[k] = first || p[k] < box[k] ? p[k] : box[k];
		box[k + 3] = first || p[k] > box[k + 3] ? p[k] : box[k + 3];
	}
}

static int add_triangle(struct outputs_tiles *t, const int32_t *const corner[3], unsigned flags, struct err *err)
{
	uint64_t place[3], rec[OUTPUTS_TILE_WORDS], at[2];
	struct outputs_tile *tile = NULL;
	int low = 0, r;

	if (!outputs_tiles_at(t, corner, at))
		return err_set(err, ERR_PROTO, "a triangle is outside of the box that the stream announced");
	for (int j = 0; j < 3; j++) {
		place[j] = digest_place(corner[j][0], corner[j][1]);
		low = place[j] < place[low] ? j : low;
	}
	rec[0] = at[1] << 32 | at[0];
	r = find_tile(t, rec[0], &tile, err);
	if (r)
		return r;
	for (int j = 0; j < 3; j++) {
		rec[1 + j] = place[(low + j) % 3];
		grow_box(tile->box, corner[j], !tile->triangles && !j);
	}
	rec[4] = (uint64_t)(uint32_t)corner[low][2] << 32 | (uint32_t)corner[(low + 1) % 3][2];
	rec[5] = (uint32_t)corner[(low + 2) % 3][2] | (uint64_t)((flags >> low | flags << (3 - low)) & 7) << 32;
	digest_add_triangles(&tile->digest, (const uint64_t(*)[3]) & place, 1, t->head.k);
	tile->triangles++;
	return sort_add(t->sort, rec, err);
}

int outputs_tiles_block(struct outputs_tiles *t, const struct format_block *block, struct err *err)
{
	const struct acut_mesh_block *b = block->mesh;
	int r = 0;

	if (t->writer)
		return t->format->block(t->writer, block, err);
	for (uint32_t i = 0; i < b->ntriangle && !r; i++) {
		const int32_t *corner[3];

		for (int j = 0; j < 3; j++)
			corner[j] = block->position[b->triangle[i][j]];
		r = add_triangle(t, corner, b->flags ? b->flags[i] : 0, err);
	}
	return r;
}

/* All is looked at before the first change: an attempt that comes after another one, or after another run with this folder, must
 * not remove an index that is true. */
static int move_all(struct outputs_tiles *t, struct err *err)
{
	char name[OUTFILE_NAME];
	size_t n = t->ntile * (t->nbeside + 1);
	bool all = false;
	int r = t->run.joins ? outputs_moves_look(t->moves, &t->run, t->place, &all, err) : 0;

	if (all && outfile_folder_same(t->place, OUTPUTS_TILES_INDEX))
		return outfile_folder_sync(t->place, err);
	if (!r)
		r = outfile_folder_clear(t->place, n, file_name, t, err);
	if (t->run.joins && !r)
		r = outputs_moves_settle(t->moves, t->place, err);
	for (size_t i = 0; i < n && !r && !t->run.joins; i++)
		r = outfile_folder_move(t->place, file_name(t, i, name), err);
	if (!r)
		r = outfile_folder_sync(t->place, err);
	if (!r)
		r = outfile_folder_move(t->place, OUTPUTS_TILES_INDEX, err);
	return r ? r : outfile_folder_sync(t->place, err);
}

/* A part has no index, and its files stay where they are. */
static int keep_part(struct outputs_tiles *t, struct err *err)
{
	int r = outputs_moves_folder(t->moves, t->place, t->ntile * (t->nbeside + 1), file_name, t, NULL, err);

	if (!r)
		r = outfile_folder_sync(t->place, err);
	if (!r)
		outfile_folder_keep(t->place);
	return r;
}

static int make_tiles(struct outputs_tiles *t, struct err *err)
{
	if (t->run.joins) {
		outputs_tiles_order(t);
		return 0;
	}
	return t->writer ? outputs_tiles_raster(t, err) : outputs_tiles_make(t, err);
}

int outputs_tiles_publish(struct outputs_tiles *t, const struct outputs_origin *origin, const struct outputs_report *report,
			  uint64_t *bytes, struct err *err)
{
	bool part = t->run.part && !t->run.joins;
	int r = make_tiles(t, err);

	t->origin = origin;
	if (!r && part)
		r = keep_part(t, err);
	if (!r && !part)
		r = outputs_tiles_index(t, report, err);
	if (!r && !part)
		r = outfile_publish(t->index, err);
	if (!r && !part)
		r = move_all(t, err);
	if (r)
		return r;
	*bytes += (part ? 0 : outfile_size(t->index)) + t->beside_bytes;
	for (size_t i = 0; i < t->ntile; i++)
		*bytes += t->tile[i].bytes;
	outfile_folder_keep(t->place);
	return 0;
}
