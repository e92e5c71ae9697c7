/*
 * The levels of the pyramid: the raster, then each time half as wide and high, until one tile has all.
 *
 * A pixel of a level is the mean of those of its four pixels below that have a height (in doubles, from the north-west by rows,
 * rounded once); it has none if no pixel below has. The tiles of a level are compressed into a file of their own, since in the
 * output the smallest level comes first. Up to four threads compress; the order is that of the tiles. A tile without heights is
 * not written.
 */
#include <libdeflate.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "dem_priv.h"
#include "err.h"
#include "outfile.h"

enum { PIXELS = DEM_TILE * DEM_TILE, HALF = DEM_TILE / 2, BYTES = PIXELS * 4, HIGHER_CACHE = 16, DEFLATE = 2 };
enum { BATCH = 8, HELPERS = 3 };

/* A tile on its way to the file. */
struct job {
	size_t index; /* of its level */
	size_t size;  /* packed; 0: it could not be */
	bool is_none; /* a height is DEM_NODATA */
	uint8_t *packed;
	float pixel[PIXELS];
};

struct helper {
	struct work *work;
	struct libdeflate_compressor *deflate;
	pthread_t thread;
	uint8_t plane[BYTES];
};

struct work {
	struct dem *dem;
	struct dem_store *store, *higher; /* of this level and the next */
	int64_t x, y;                     /* of this level in its store */
	bool whole;                       /* it is the raster, not a smaller one */
	size_t room;                      /* of a packed tile */
	struct job *job;
	unsigned njob;
	atomic_uint next; /* job to be taken */
	struct helper *helper[1 + HELPERS];
	unsigned nhelper; /* the first is the caller */
};

/* ---- compression, by helpers ---- */

static uint32_t bits_of(float v)
{
	uint32_t bits;

	memcpy(&bits, &v, sizeof(bits));
	return bits;
}

/* TIFF's floating point predictor: the bytes of a row by their weight, then differences. */
static void predict(struct job *job, uint8_t *plane)
{
	const uint32_t none = bits_of(DEM_NODATA);

	for (size_t y = 0; y < DEM_TILE; y++) {
		const float *v = job->pixel + y * DEM_TILE;
		uint8_t *to = plane + y * DEM_TILE * 4, row[DEM_TILE * 4];
		unsigned found = 0;
		uint32_t bits[DEM_TILE];

		memcpy(bits, v, sizeof(bits));
		for (size_t x = 0; x < DEM_TILE; x++) {
			found |= bits[x] == none;
			bits[x] = isnan(v[x]) ? none : bits[x];
		}
		job->is_none |= found;
		for (unsigned k = 0; k < 4; k++)
			for (size_t x = 0; x < DEM_TILE; x++)
				row[DEM_TILE * k + x] = (uint8_t)(bits[x] >> (24 - 8 * k));
		to[0] = row[0];
		for (size_t i = 1; i < DEM_TILE * 4; i++)
			to[i] = (uint8_t)(row[i] - row[i - 1]);
	}
}

static void *help(void *arg)
{
	struct helper *h = arg;
	struct work *w = h->work;

	for (unsigned i; (i = atomic_fetch_add(&w->next, 1)) < w->njob;) {
		struct job *job = &w->job[i];

		predict(job, h->plane);
		job->size = libdeflate_zlib_compress(h->deflate, h->plane, BYTES, job->packed, w->room);
	}
	return NULL;
}

/* Signals are the caller's. Without a thread the caller does it all. */
static void help_all(struct work *w)
{
	unsigned started = 1;
	sigset_t all, was;

	atomic_store(&w->next, 0);
	sigfillset(&all);
	pthread_sigmask(SIG_SETMASK, &all, &was);
	while (started < w->nhelper && started < w->njob &&
	       !pthread_create(&w->helper[started]->thread, NULL, help, w->helper[started]))
		started++;
	pthread_sigmask(SIG_SETMASK, &was, NULL);
	help(w->helper[0]);
	while (started-- > 1)
		pthread_join(w->helper[started]->thread, NULL);
}

/* Packs what is gathered and appends it in order, whoever was first. */
static int put_batch(struct work *w, struct dem_level *l, struct err *err)
{
	int r = 0;

	if (w->njob)
		help_all(w);
	for (unsigned i = 0; i < w->njob && !r; i++) {
		struct job *job = &w->job[i];

		if (job->is_none) {
			err_set(err, ERR_USAGE, "a height is " DEM_NODATA_TEXT ", which stands for no height");
			return err_add_hint(err, "convert the heights with --z-unit, or leave the points out");
		}
		if (!job->size)
			return err_set(err, ERR_INTERNAL, "a tile cannot be compressed");
		l->offset[job->index] = l->size;
		l->bytes[job->index] = (uint32_t)job->size;
		l->size += job->size;
		r = outfile_write(l->data, job->packed, job->size, err);
	}
	w->njob = 0;
	return r;
}

/* ---- levels ---- */

static float mean(const float *north, const float *south)
{
	const float v[4] = {north[0], north[1], south[0], south[1]};
	double sum = 0;
	int n = 0;
	float m;

	for (int i = 0; i < 4; i++) {
		if (!isnan(v[i])) {
			sum += v[i];
			n++;
		}
	}
	m = n ? (float)(sum / n) : NAN;
	return m == DEM_NODATA ? nextafterf(m, 0) : m; /* a mean is a height even where it has the value of no data */
}

/* The tile's quarter of one of the next level. */
static int put_half(struct work *w, const float *pixel, uint32_t column, uint32_t row, struct err *err)
{
	float *to;
	int r = dem_store_tile(w->higher, column / 2, row / 2, false, &to, err);

	if (r)
		return r;
	to += (row % 2 * DEM_TILE + column % 2) * HALF;
	for (size_t y = 0; y < HALF; y++)
		for (size_t x = 0; x < HALF; x++)
			to[y * DEM_TILE + x] = mean(pixel + 2 * y * DEM_TILE + 2 * x, pixel + (2 * y + 1) * DEM_TILE + 2 * x);
	return 0;
}

static bool has_heights(const float *pixel)
{
	for (size_t i = 0; i < PIXELS; i++)
		if (!isnan(pixel[i]))
			return true;
	return false;
}

static int put_tile(struct work *w, struct dem_level *l, uint32_t column, uint32_t row, struct err *err)
{
	uint64_t x = (uint64_t)column * DEM_TILE, y = (uint64_t)row * DEM_TILE;
	struct job *job = &w->job[w->njob];
	bool any;
	int r = dem_store_read(w->store, w->x + (int64_t)x, w->y + (int64_t)y, l->w - x, l->h - y, job->pixel, &any, err);

	if (!r && any && w->whole)
		dem_clip_tile(&w->dem->grid, w->x + (int64_t)x, w->y + (int64_t)y, job->pixel);
	job->index = (size_t)row * l->columns + column;
	job->is_none = false;
	l->offset[job->index] = UINT64_MAX;
	l->bytes[job->index] = 0;
	if (r || !any || !has_heights(job->pixel))
		return r;
	if (w->higher)
		r = put_half(w, job->pixel, column, row, err);
	return !r && ++w->njob == BATCH ? put_batch(w, l, err) : r;
}

static int level_init(struct dem_level *l, const struct outfile *beside, struct err *err)
{
	size_t n;

	l->columns = (l->w + DEM_TILE - 1) / DEM_TILE;
	l->rows = (l->h + DEM_TILE - 1) / DEM_TILE;
	n = (size_t)l->columns * l->rows;
	l->offset = malloc(n * sizeof(*l->offset));
	l->bytes = malloc(n * sizeof(*l->bytes));
	if (!l->offset || !l->bytes)
		return err_set(err, ERR_NOMEM, "no memory for %zu tiles", n);
	return outfile_spool(beside, &l->data, err);
}

static int make_level(struct work *w, struct dem_level *l, struct err *err)
{
	const struct dem_options *o = &w->dem->opt;
	int r = level_init(l, w->dem->out, err);

	if (!r && l->columns * (uint64_t)l->rows > 1)
		r = dem_store_new(w->dem->out, HIGHER_CACHE, &w->higher, err);
	for (uint32_t row = 0; row < l->rows && !r; row++) {
		if (o->interrupted && o->interrupted(o->ctx))
			r = err_set(err, ERR_CANCELLED, "interrupted");
		for (uint32_t column = 0; column < l->columns && !r; column++)
			r = put_tile(w, l, column, row, err);
	}
	if (!r)
		r = put_batch(w, l, err);
	if (w->store != w->dem->store)
		dem_store_free(w->store);
	w->store = w->higher;
	w->higher = NULL;
	w->x = w->y = 0;
	w->whole = false;
	return r;
}

static struct work *work_free(struct work *w)
{
	if (!w)
		return NULL;
	for (unsigned i = 0; i < w->nhelper; i++) {
		libdeflate_free_compressor(w->helper[i]->deflate);
		free(w->helper[i]);
	}
	for (unsigned i = 0; i < BATCH && w->job; i++)
		free(w->job[i].packed);
	if (!w->dem || w->store != w->dem->store)
		dem_store_free(w->store);
	dem_store_free(w->higher);
	free(w->job);
	free(w);
	return NULL;
}

static struct work *work_new(void)
{
	long processors = sysconf(_SC_NPROCESSORS_ONLN);
	struct work *w = calloc(1, sizeof(*w));
	bool ok = w && (w->job = calloc(BATCH, sizeof(*w->job)));

	for (unsigned i = 0; i <= HELPERS && ok && (i == 0 || (long)i < processors); i++) {
		struct helper *h = w->helper[i] = calloc(1, sizeof(*h));

		ok = h && (h->deflate = libdeflate_alloc_compressor(DEFLATE));
		if (h) {
			h->work = w;
			w->nhelper++;
		}
	}
	if (ok)
		w->room = libdeflate_zlib_compress_bound(w->helper[0]->deflate, BYTES);
	for (unsigned i = 0; i < BATCH && ok; i++)
		ok = (w->job[i].packed = malloc(w->room));
	return ok ? w : work_free(w);
}

int dem_pyramid_make(struct dem_pyramid *p, struct dem *d, const struct dem_rect *rect, struct err *err)
{
	struct work *w = work_new();
	uint32_t width = (uint32_t)rect->w, height = (uint32_t)rect->h;
	int r = 0;

	memset(p, 0, sizeof(*p));
	if (!w)
		return err_set(err, ERR_NOMEM, "no memory to compress a raster");
	w->dem = d;
	w->store = d->store;
	if (!d->tiled)
		d->store = NULL;
	w->x = rect->x;
	w->y = d->grid.count[1] - rect->y - (int64_t)rect->h;
	w->whole = true;
	while (w->store && !r) {
		struct dem_level *l = &p->level[p->n++];

		l->w = width;
		l->h = height;
		r = make_level(w, l, err);
		width = (width + 1) / 2;
		height = (height + 1) / 2;
	}
	work_free(w);
	return r;
}

void dem_pyramid_done(struct dem_pyramid *p)
{
	for (unsigned i = 0; i < p->n; i++) {
		free(p->level[i].offset);
		free(p->level[i].bytes);
		outfile_free(p->level[i].data);
	}
	memset(p, 0, sizeof(*p));
}
