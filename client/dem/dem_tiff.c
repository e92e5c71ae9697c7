/*
 * The file: a GeoTIFF whose directories come first and whose smallest level follows them, so that a reader over a network gets
 * an overview by reading the front of the file (the layout of "cloud optimized" GeoTIFF).
 *
 * It is written in order, once all tiles are compressed, so it can go to a pipe. Little-endian; BigTIFF if it has 4 GiB or more.
 * A tile without heights has offset and size 0, which GDAL and libtiff read as no data.
 */
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "dem_priv.h"
#include "err.h"
#include "outfile.h"

enum { BYTE_ASCII = 2, SHORT = 3, LONG = 4, DOUBLE = 12, LONG8 = 16 };
enum { ENTRIES = 24 };
enum {
	SUBFILE_TYPE = 254,
	WIDTH = 256,
	HEIGHT = 257,
	BITS = 258,
	COMPRESSION = 259,
	PHOTOMETRIC = 262,
	DESCRIPTION = 270,
	SAMPLES = 277,
	PLANAR = 284,
	PREDICTOR = 317,
	TILE_WIDTH = 322,
	TILE_HEIGHT = 323,
	TILE_OFFSETS = 324,
	TILE_BYTES = 325,
	SAMPLE_FORMAT = 339,
	PIXEL_SCALE = 33550,
	TIE_POINT = 33922,
	GEO_KEYS = 34735,
	GEO_ASCII = 34737,
	NODATA = 42113,
};

struct entry {
	uint16_t tag, type;
	uint64_t count;
	const void *bytes; /* little-endian; NULL: the offsets or sizes of the level's tiles, or `value` */
	uint64_t value;
};

struct file {
	bool big;
	const struct dem_pyramid *pyramid;
	struct dem_keys keys;
	const char *description;
	double scale[3], tie[6];
	uint64_t data[DEM_LEVELS]; /* where the tiles of a level begin */
	struct packer out;
};

static uint64_t tiles_of(const struct dem_level *l)
{
	return (uint64_t)l->columns * l->rows;
}

static unsigned size_of(unsigned type)
{
	return type == BYTE_ASCII ? 1 : type == SHORT ? 2 : type == LONG ? 4 : 8;
}

static unsigned level_entries(const struct file *f, unsigned i, struct entry e[ENTRIES])
{
	const struct dem_level *l = &f->pyramid->level[i];
	const struct entry all[] = {
		{SUBFILE_TYPE, LONG, 1, NULL, i > 0},
		{WIDTH, LONG, 1, NULL, l->w},
		{HEIGHT, LONG, 1, NULL, l->h},
		{BITS, SHORT, 1, NULL, 32},
		{COMPRESSION, SHORT, 1, NULL, 8}, /* deflate */
		{PHOTOMETRIC, SHORT, 1, NULL, 1},
		{DESCRIPTION, BYTE_ASCII, strlen(f->description) + 1, f->description, 0},
		{SAMPLES, SHORT, 1, NULL, 1},
		{PLANAR, SHORT, 1, NULL, 1},
		{PREDICTOR, SHORT, 1, NULL, 3}, /* floating point */
		{TILE_WIDTH, LONG, 1, NULL, DEM_TILE},
		{TILE_HEIGHT, LONG, 1, NULL, DEM_TILE},
		{TILE_OFFSETS, f->big ? LONG8 : LONG, tiles_of(l), NULL, 0},
		{TILE_BYTES, LONG, tiles_of(l), NULL, 0},
		{SAMPLE_FORMAT, SHORT, 1, NULL, 3}, /* IEEE */
		{PIXEL_SCALE, DOUBLE, 3, f->scale, 0},
		{TIE_POINT, DOUBLE, 6, f->tie, 0},
		{GEO_KEYS, SHORT, f->keys.n, f->keys.key, 0},
		{GEO_ASCII, BYTE_ASCII, strlen(f->keys.text) + 1, f->keys.text, 0},
		{NODATA, BYTE_ASCII, sizeof(DEM_NODATA_TEXT), DEM_NODATA_TEXT, 0},
	};
	unsigned n = 0;

	for (unsigned k = 0; k < sizeof(all) / sizeof(*all); k++)
		if (!i || (all[k].tag < PIXEL_SCALE && all[k].tag != DESCRIPTION) || all[k].tag == NODATA)
			e[n++] = all[k];
	return n;
}

/* Bytes of a value outside of its entry, 0: it fits in; even, as TIFF wants offsets to be. */
static uint64_t outside(const struct file *f, const struct entry *e)
{
	uint64_t n = e->count * size_of(e->type);

	return n <= (f->big ? 8 : 4) ? 0 : n + (n & 1);
}

static uint64_t directory_size(const struct file *f, unsigned level)
{
	struct entry e[ENTRIES];
	unsigned n = level_entries(f, level, e);
	uint64_t size = f->big ? 8 + 20 * (uint64_t)n + 8 : 2 + 12 * (uint64_t)n + 4;

	for (unsigned i = 0; i < n; i++)
		size += outside(f, &e[i]);
	return size;
}

static uint64_t header_size(const struct file *f)
{
	uint64_t size = f->big ? 16 : 8;

	for (unsigned i = 0; i < f->pyramid->n; i++)
		size += directory_size(f, i);
	return size;
}

static void put_word(struct file *f, uint64_t v)
{
	if (f->big)
		packer_u64(&f->out, v);
	else
		packer_u32(&f->out, (uint32_t)v);
}

static void put_number(struct file *f, unsigned type, const void *bytes, uint64_t i)
{
	const uint16_t *shorts = bytes;
	const double *doubles = bytes;

	if (type == SHORT)
		packer_u16(&f->out, shorts[i]);
	else if (type == DOUBLE)
		packer_f64(&f->out, doubles[i]);
	else
		packer_u8(&f->out, ((const uint8_t *)bytes)[i]);
}

static void put_value(struct file *f, unsigned level, const struct entry *e)
{
	const struct dem_level *l = &f->pyramid->level[level];

	for (uint64_t i = 0; i < e->count; i++) {
		uint64_t at = l->offset[e->tag == TILE_OFFSETS || e->tag == TILE_BYTES ? i : 0];

		if (e->tag == TILE_OFFSETS)
			put_word(f, at == UINT64_MAX ? 0 : f->data[level] + at);
		else if (e->tag == TILE_BYTES)
			packer_u32(&f->out, l->bytes[i]);
		else if (e->bytes)
			put_number(f, e->type, e->bytes, i);
		else if (e->type == SHORT)
			packer_u16(&f->out, (uint16_t)e->value);
		else
			packer_u32(&f->out, (uint32_t)e->value);
	}
}

static void put_directory(struct file *f, unsigned level)
{
	struct entry e[ENTRIES];
	unsigned n = level_entries(f, level, e), word = f->big ? 8 : 4;
	uint64_t start = packer_size(&f->out), at = start + (f->big ? 8 + 20 * (uint64_t)n + 8 : 2 + 12 * (uint64_t)n + 4);

	if (f->big)
		packer_u64(&f->out, n);
	else
		packer_u16(&f->out, (uint16_t)n);
	for (unsigned i = 0; i < n; i++) {
		uint64_t size = e[i].count * size_of(e[i].type);

		packer_u16(&f->out, e[i].tag);
		packer_u16(&f->out, e[i].type);
		put_word(f, e[i].count);
		if (outside(f, &e[i])) {
			put_word(f, at);
			at += outside(f, &e[i]);
		} else {
			put_value(f, level, &e[i]);
			packer_zero(&f->out, word - (size_t)size);
		}
	}
	put_word(f, level + 1 < f->pyramid->n ? at : 0);
	for (unsigned i = 0; i < n; i++) {
		if (!outside(f, &e[i]))
			continue;
		put_value(f, level, &e[i]);
		packer_zero(&f->out, (size_t)(e[i].count * size_of(e[i].type) & 1));
	}
}

static void put_header(struct file *f)
{
	packer_bytes(&f->out, "II", 2);
	packer_u16(&f->out, f->big ? 43 : 42);
	if (f->big) {
		packer_u16(&f->out, 8);
		packer_u16(&f->out, 0);
	}
	put_word(f, f->big ? 16 : 8);
	for (unsigned i = 0; i < f->pyramid->n; i++)
		put_directory(f, i);
}

/* Where each level's tiles begin; the end of the file. */
static uint64_t lay_out(struct file *f)
{
	uint64_t at = header_size(f);

	for (unsigned i = f->pyramid->n; i--;) {
		f->data[i] = at;
		at += f->pyramid->level[i].size;
	}
	return at;
}

static void place(struct file *f, const struct dem *d, const struct dem_rect *rect)
{
	double side = dem_grid_side(&d->grid);

	f->scale[0] = f->scale[1] = side;
	f->tie[3] = dem_grid_line(&d->grid, 0, rect->x);
	f->tie[4] = dem_grid_line(&d->grid, 1, rect->y + (int64_t)rect->h);
}

int dem_tiff_write(const struct dem *d, const struct dem_pyramid *pyramid, const struct dem_rect *rect, struct err *err)
{
	struct file f = {.pyramid = pyramid, .description = d->description ? d->description : ""};
	uint8_t *bytes;
	size_t size;
	int r;

	dem_keys_make(&f.keys, d);
	place(&f, d, rect);
	if (d->opt.big || lay_out(&f) > UINT32_MAX) {
		f.big = true;
		lay_out(&f);
	}
	size = (size_t)header_size(&f);
	bytes = malloc(size);
	if (!bytes)
		return err_set(err, ERR_NOMEM, "no memory for the header of a raster");
	f.out = packer_of(bytes, size);
	put_header(&f);
	r = f.out.bad || packer_size(&f.out) != size ? err_set(err, ERR_INTERNAL, "the header of a raster has a wrong size") :
						       outfile_write(d->out, bytes, size, err);
	free(bytes);
	for (unsigned i = pyramid->n; i-- && !r;)
		r = outfile_join(d->out, pyramid->level[i].data, 1, err);
	return r;
}
