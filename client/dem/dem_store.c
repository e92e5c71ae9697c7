/*
 * The tiles of a raster: those with pixels, a few of them in memory, the others in a nameless file beside the output.
 *
 * A hash table finds a tile by its number. The least recently used one leaves the memory, into its place in the file, if it was
 * written since it came. A tile that was never asked for is nowhere.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dem_priv.h"
#include "err.h"
#include "outfile.h"

enum { PIXELS = DEM_TILE * DEM_TILE, NONE = -1, LEAST_CACHE = 2 };
#define BYTES (PIXELS * sizeof(float))

struct tile {
	uint64_t number;  /* row << 32 | column */
	int32_t page;     /* in memory; NONE: it is in the file */
	bool used, filed; /* filed: the file has a place for it, that of its index */
	uint32_t place;
};

struct page {
	uint64_t number;
	bool changed;
	int32_t before, after; /* by last use */
};

struct dem_store {
	const struct outfile *beside;
	struct outfile *spool;
	struct tile *tile; /* hash table, linear probing */
	size_t size, used;
	uint32_t filed; /* places in the file */
	struct page *page;
	float *pixels;
	int32_t npage, most, newest, oldest;
};

struct dem_store *dem_store_free(struct dem_store *s)
{
	if (!s)
		return NULL;
	outfile_free(s->spool);
	free(s->tile);
	free(s->page);
	free(s->pixels);
	free(s);
	return NULL;
}

int dem_store_new(const struct outfile *beside, unsigned cache, struct dem_store **ret, struct err *err)
{
	struct dem_store *s = calloc(1, sizeof(*s));

	if (s) {
		s->beside = beside;
		s->most = cache < LEAST_CACHE ? LEAST_CACHE : (int32_t)cache;
		s->newest = s->oldest = NONE;
		s->size = 1024;
		s->tile = calloc(s->size, sizeof(*s->tile));
		s->page = calloc((size_t)s->most, sizeof(*s->page));
		s->pixels = malloc((size_t)s->most * BYTES);
	}
	if (!s || !s->tile || !s->page || !s->pixels) {
		dem_store_free(s);
		return err_set(err, ERR_NOMEM, "no memory for a raster");
	}
	*ret = s;
	return 0;
}

static struct tile *find(const struct dem_store *s, uint64_t number)
{
	size_t i = (size_t)(number * 0x9e3779b97f4a7c15u >> 32) & (s->size - 1);

	while (s->tile[i].used && s->tile[i].number != number)
		i = (i + 1) & (s->size - 1);
	return &s->tile[i];
}

static int grow(struct dem_store *s, struct err *err)
{
	struct dem_store old = *s;

	s->tile = calloc(2 * old.size, sizeof(*s->tile));
	if (!s->tile) {
		s->tile = old.tile;
		return err_set(err, ERR_NOMEM, "no memory for %zu tiles of a raster", old.used);
	}
	s->size = 2 * old.size;
	for (size_t i = 0; i < old.size; i++)
		if (old.tile[i].used)
			*find(s, old.tile[i].number) = old.tile[i];
	free(old.tile);
	return 0;
}

/* ---- pages ---- */

static void unlink_page(struct dem_store *s, int32_t i)
{
	struct page *p = &s->page[i];

	*(p->before == NONE ? &s->newest : &s->page[p->before].after) = p->after;
	*(p->after == NONE ? &s->oldest : &s->page[p->after].before) = p->before;
}

static void put_first(struct dem_store *s, int32_t i)
{
	s->page[i].before = NONE;
	s->page[i].after = s->newest;
	*(s->newest == NONE ? &s->oldest : &s->page[s->newest].before) = i;
	s->newest = i;
}

static float *pixels_of(const struct dem_store *s, int32_t page)
{
	return s->pixels + (size_t)page * PIXELS;
}

/* The oldest page becomes free. */
static int evict(struct dem_store *s, int32_t *ret, struct err *err)
{
	struct page *p = &s->page[s->oldest];
	struct tile *t = find(s, p->number);
	int r = 0;

	if (p->changed && !s->spool)
		r = outfile_spool(s->beside, &s->spool, err);
	if (!r && p->changed) {
		if (!t->filed)
			t->place = s->filed++;
		t->filed = true;
		r = outfile_patch(s->spool, (uint64_t)t->place * BYTES, pixels_of(s, s->oldest), BYTES, err);
	}
	if (r)
		return r;
	t->page = NONE;
	*ret = s->oldest;
	unlink_page(s, s->oldest);
	return 0;
}

static int load(struct dem_store *s, struct tile *t, struct err *err)
{
	int32_t page = s->npage;
	int r = 0;

	if (page < s->most)
		s->npage++;
	else
		r = evict(s, &page, err);
	if (r)
		return r;
	put_first(s, page);
	s->page[page].number = t->number;
	s->page[page].changed = false;
	if (t->filed)
		r = outfile_read(s->spool, (uint64_t)t->place * BYTES, pixels_of(s, page), BYTES, err);
	for (size_t i = 0; i < PIXELS && !t->filed; i++)
		pixels_of(s, page)[i] = NAN;
	t->page = page;
	return r;
}

int dem_store_tile(struct dem_store *s, uint32_t column, uint32_t row, bool look, float **ret, struct err *err)
{
	uint64_t number = (uint64_t)row << 32 | column;
	struct tile *t;
	int r = 0;

	if (s->newest != NONE && s->page[s->newest].number == number) {
		s->page[s->newest].changed |= !look;
		*ret = pixels_of(s, s->newest);
		return 0;
	}
	t = find(s, number);
	if (!t->used && look) {
		*ret = NULL;
		return 0;
	}
	if (!t->used) {
		if (s->used == DEM_TILES_MAX)
			return err_set(err, ERR_USAGE, "the raster has more than %u tiles of %d x %d pixels", DEM_TILES_MAX,
				       DEM_TILE, DEM_TILE);
		r = 2 * (s->used + 1) > s->size ? grow(s, err) : 0;
		if (r)
			return r;
		t = find(s, number);
		*t = (struct tile){.number = number, .page = NONE, .used = true};
		s->used++;
	}
	if (t->page == NONE) {
		r = load(s, t, err);
	} else {
		unlink_page(s, t->page);
		put_first(s, t->page);
	}
	if (r)
		return r;
	s->page[t->page].changed |= !look;
	*ret = pixels_of(s, t->page);
	return 0;
}

int dem_store_list(const struct dem_store *s, uint64_t **ret, size_t *ret_n, struct err *err)
{
	uint64_t *list = malloc((s->used + 1) * sizeof(*list));
	size_t n = 0;

	if (!list)
		return err_set(err, ERR_NOMEM, "no memory for %zu tiles of a raster", s->used);
	for (size_t i = 0; i < s->size; i++)
		if (s->tile[i].used)
			list[n++] = s->tile[i].number;
	*ret = list;
	*ret_n = n;
	return 0;
}

int dem_store_read(struct dem_store *s, int64_t x, int64_t y, uint64_t w, uint64_t h, float *tile, bool *ret_any, struct err *err)
{
	int64_t right = x + (int64_t)(w < DEM_TILE ? w : DEM_TILE), low = y + (int64_t)(h < DEM_TILE ? h : DEM_TILE);
	int64_t tx0 = x > 0 ? x / DEM_TILE : 0, ty0 = y > 0 ? y / DEM_TILE : 0;

	*ret_any = false;
	for (size_t i = 0; i < PIXELS; i++)
		tile[i] = NAN;
	for (int64_t ty = ty0; ty * DEM_TILE < low; ty++) {
		for (int64_t tx = tx0; tx * DEM_TILE < right; tx++) {
			int64_t x0 = tx * DEM_TILE > x ? tx * DEM_TILE : x, y0 = ty * DEM_TILE > y ? ty * DEM_TILE : y;
			int64_t x1 = (tx + 1) * DEM_TILE < right ? (tx + 1) * DEM_TILE : right;
			int64_t y1 = (ty + 1) * DEM_TILE < low ? (ty + 1) * DEM_TILE : low;
			float *from;

			if (dem_store_tile(s, (uint32_t)tx, (uint32_t)ty, true, &from, err))
				return -err->code;
			*ret_any |= from != NULL;
			for (int64_t at = y0; at < y1 && from; at++)
				memcpy(tile + (at - y) * DEM_TILE + (x0 - x), from + at % DEM_TILE * DEM_TILE + x0 % DEM_TILE,
				       (size_t)(x1 - x0) * sizeof(float));
		}
	}
	return 0;
}
