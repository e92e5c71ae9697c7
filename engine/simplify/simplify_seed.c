/*
 * From the blocks to the first grid of chosen points: the points that were inserted, vertices of lines, and the corners of the
 * hull of all points. The blocks' hulls have these; their other corners are dropped.
 */
#include "simplify_seed.h"

#include <stdlib.h>
#include <string.h>

#include "align.h"
#include "err.h"
#include "parse.h"
#include "pipe.h"

enum { READ = 1024, HULL_EACH = 2 * sizeof(struct point) + sizeof(struct simplify_place) + sizeof(uint32_t) };

/* ---- how many points an error leaves ---- */

/* The buckets of ceil(key / 2^16), the least error that leaves the point out: numbers up to 1,024 each have one, greater ones
 * share it with those of the same ten highest bits. */
static uint32_t bucket_of(uint64_t v)
{
	unsigned bits = v ? 63 - (unsigned)__builtin_clzll(v) : 0;

	return bits < 10 ? (uint32_t)v : 1024 + (bits - 10) * 512 + ((uint32_t)(v >> (bits - 9)) & 511);
}

/* The greatest number of a bucket. */
static uint64_t bucket_last(uint32_t bucket)
{
	uint32_t bits = (bucket - 1024) / 512 + 10;

	if (bucket < 1024)
		return bucket;
	return (((uint64_t)512 + (bucket - 1024) % 512 + 1) << (bits - 9)) - 1;
}

uint64_t simplify_seeds_error(const uint64_t histogram[SIMPLIFY_BUCKETS], uint64_t most)
{
	uint64_t sum = 0;
	uint32_t b = SIMPLIFY_BUCKETS;

	while (b > 1 && sum + histogram[b - 1] <= most)
		sum += histogram[--b];
	return bucket_last(b - 1);
}

/* ---- reading the parts ---- */

struct walk {
	struct simplify_in in;
	struct simplify_found found; /* the greatest error of all parts that were read */
	struct simplify_seed seed[READ];
};

/* A torn part is removed, so that its task is done again. */
static int read_part(const struct simplify *s, struct walk *w, uint32_t task,
		     int (*each)(void *ctx, const struct simplify_seed *, struct err *err), void *ctx, struct err *err)
{
	struct simplify_found found;
	char name[GRID_NAME_MAX];
	size_t n = 0;
	int r;

	simplify_name(name, "part", task, 0, 0);
	r = simplify_in_begin(&w->in, s->p.dirfd, name, sizeof *w->seed, err);
	if (!r) {
		memcpy(&found, w->in.info, sizeof found);
		if (found.far > w->found.far)
			w->found = found;
	}
	do {
		if (!r)
			r = simplify_in_read(&w->in, w->seed, READ, &n, err);
		for (size_t i = 0; !r && i < n; i++)
			r = each(ctx, &w->seed[i], err);
	} while (!r && n);
	simplify_in_end(&w->in);
	return r;
}

static int read_parts(const struct simplify *s, struct walk *w,
		      int (*each)(void *ctx, const struct simplify_seed *, struct err *err), void *ctx, struct err *err)
{
	int r = 0;

	for (uint32_t i = 0; !r && i < s->at.parts; i++) {
		r = read_part(s, w, i, each, ctx, err);
		if (!r)
			r = simplify_cancelled(s, err);
	}
	return r;
}

/* ---- the hull ---- */

struct hull {
	struct walk walk;
	struct simplify_out out;
	struct point *pts, *other;
	struct simplify_place *order;
	uint32_t *corner;
	size_t n, room;
	uint64_t lines;
	bool count; /* for max_points */
	uint64_t histogram[SIMPLIFY_BUCKETS];
};

static void reduce(struct hull *h)
{
	uint32_t n = h->n ? simplify_hull(h->pts, (uint32_t)h->n, h->order, h->corner) : 0;
	struct point *all = h->pts;

	for (uint32_t i = 0; i < n; i++)
		h->other[i] = h->pts[h->corner[i]];
	h->pts = h->other;
	h->other = all;
	h->n = n;
}

static int hull_seed(void *ctx, const struct simplify_seed *seed, struct err *err)
{
	struct hull *h = ctx;
	char need[32];

	if (seed->key == SIMPLIFY_SEED_LINE || seed->key == SIMPLIFY_SEED_LINE_HULL)
		h->lines++;
	if (seed->key < SIMPLIFY_SEED_FLAT && h->count)
		h->histogram[bucket_of((seed->key >> SIMPLIFY_KEY_SHIFT) + ((seed->key & 65535) != 0))]++;
	if (seed->key != SIMPLIFY_SEED_HULL && seed->key != SIMPLIFY_SEED_LINE_HULL)
		return 0;
	if (h->n == h->room)
		reduce(h);
	/* A hull of lattice positions has few corners: a million needs a survey that was made for it. */
	if (h->n > h->room / 2) {
		err_set(err, ERR_LIMIT, "the hull of the points has more than %zu corners; twice as many need %s of memory", h->n,
			parse_size_text(8 * h->room * HULL_EACH, need));
		return err_add_hint(err, "give acutd more memory, or leave out points");
	}
	h->pts[h->n++] = seed->p;
	return 0;
}

/* Corners that are vertices of lines are chosen already, as these. They are needed to find the others. */
static int write_hull(const struct simplify *s, struct hull *h, uint64_t *ret_n, struct err *err)
{
	int r = simplify_out_begin(&h->out, s->p.dirfd, "hull", sizeof *h->pts, err);

	if (r)
		return r;
	*ret_n = 0;
	for (size_t i = 0; !r && i < h->n; i++) {
		bool line = (h->pts[i].tag & POINT_LINE) != 0;

		*ret_n += !line;
		r = line ? 0 : simplify_out_add(&h->out, &h->pts[i], 1, err);
	}
	if (!r)
		return simplify_out_end(&h->out, NULL, err);
	simplify_out_abort(&h->out);
	return r;
}

static int write_histogram(const struct simplify *s, struct hull *h, struct err *err)
{
	int r = simplify_out_begin(&h->out, s->p.dirfd, "histogram", sizeof *h->histogram, err);

	if (r)
		return r;
	r = simplify_out_add(&h->out, h->histogram, SIMPLIFY_BUCKETS, err);
	if (!r)
		return simplify_out_end(&h->out, NULL, err);
	simplify_out_abort(&h->out);
	return r;
}

int simplify_seed_hull(const struct simplify *s, struct simplify_where *where, struct err *err)
{
	struct hull *h = calloc(1, sizeof *h);
	uint8_t *memory;
	int r;

	if (!h)
		return err_set(err, ERR_NOMEM, "no memory for a hull");
	h->room = (s->p.memory - sizeof *h - sizeof *h->corner) / HULL_EACH / 2 * 2;
	memory = malloc(h->room * HULL_EACH + sizeof *h->corner); /* simplify_hull writes one more */
	if (!memory) {
		free(h);
		return err_set(err, ERR_NOMEM, "no memory for a hull");
	}
	h->count = s->p.max_points > 0;
	h->pts = (struct point *)memory;
	h->other = h->pts + h->room;
	h->order = (struct simplify_place *)(h->other + h->room);
	h->corner = (uint32_t *)(h->order + h->room);
	r = read_parts(s, &h->walk, hull_seed, h, err);
	if (!r) {
		reduce(h);
		where->lines = h->lines;
		where->far = h->walk.found.far;
		where->corner0 = h->walk.found.corner[0];
		where->corner1 = h->walk.found.corner[1];
		where->corner2 = h->walk.found.corner[2];
		r = write_hull(s, h, &where->hull, err);
	}
	if (!r && s->p.max_points)
		r = write_histogram(s, h, err);
	free(memory);
	free(h);
	return r;
}

int simplify_seed_histogram(const struct simplify *s, uint64_t ret[SIMPLIFY_BUCKETS], struct err *err)
{
	struct simplify_in in;
	size_t n = 0;
	int r = simplify_in_begin(&in, s->p.dirfd, "histogram", sizeof *ret, err);

	if (r)
		return r;
	r = simplify_in_read(&in, ret, SIMPLIFY_BUCKETS, &n, err);
	simplify_in_end(&in);
	return !r && n != SIMPLIFY_BUCKETS ? err_set(err, ERR_CORRUPT, "a file of a simplification is damaged") : r;
}

/* ---- the grid ---- */

struct seeds {
	struct walk walk;
	struct simplify_stage to, strip;
	struct simplify_out border;
	uint64_t key;
	bool settles;
};

/* Seeds come in the order of their keys of position. */
static int take_seed(void *ctx, const struct simplify_seed *seed, struct err *err)
{
	uint64_t at = point_morton(seed->p.x, seed->p.y);
	struct seeds *t = ctx;
	int r = 0;

	if (t->settles && seed->key & SIMPLIFY_SEED_EDGE)
		r = simplify_out_add(&t->border, &at, 1, err);
	if (r || seed->key == SIMPLIFY_SEED_HULL || (seed->key & ~SIMPLIFY_SEED_MARKS) <= t->key)
		return r;
	if (t->settles && seed->key & SIMPLIFY_SEED_MARKS)
		r = simplify_stage_add(&t->strip, &seed->p, err);
	return r ? r : simplify_stage_add(&t->to, &seed->p, err);
}

static int take_hull(const struct simplify *s, struct seeds *t, struct err *err)
{
	struct point pts[64];
	struct simplify_in in;
	size_t n = 0;
	int r = simplify_in_begin(&in, s->p.dirfd, "hull", sizeof *pts, err);

	/* All points of a flat view are chosen already. */
	if (r || s->at.flat) {
		if (!r)
			simplify_in_end(&in);
		return r;
	}
	do {
		r = simplify_in_read(&in, pts, 64, &n, err);
		for (size_t i = 0; !r && i < n; i++) {
			r = simplify_stage_add(&t->to, &pts[i], err);
			if (!r && t->settles)
				r = simplify_stage_add(&t->strip, &pts[i], err);
		}
	} while (!r && n);
	simplify_in_end(&in);
	return r;
}

bool simplify_settles(const struct simplify *s)
{
	return !s->p.max_points && !s->at.flat && !pipe_has_out(s->p.grid);
}

static int seed_grid(const struct simplify *s, struct seeds *t, const char *name, const char *strip,
		     struct grid_segment_info *ret, struct grid_segment_info *ret_strip, struct err *err)
{
	const size_t memory = s->p.memory - sizeof *t;
	int r = simplify_stage_begin(&t->to, s, name, true, t->settles ? memory / 2 : memory, err);

	if (!r && t->settles)
		r = simplify_stage_begin(&t->strip, s, strip, true, memory / 2, err);
	if (!r)
		r = read_parts(s, &t->walk, take_seed, t, err);
	if (!r)
		r = take_hull(s, t, err);
	if (!r)
		r = simplify_stage_end(&t->to, ret, err);
	if (!r && t->settles)
		r = simplify_stage_end(&t->strip, ret_strip, err);
	simplify_stage_abort(&t->to);
	simplify_stage_abort(&t->strip);
	return r;
}

/* The file of keys, and both grids. */
static int seed_grids(const struct simplify *s, const struct simplify_where *where, struct seeds *t, const char *name,
		      struct grid_segment_info *ret, struct err *err)
{
	struct grid_segment_info strip;
	char border[GRID_NAME_MAX], segment[GRID_NAME_MAX], manifest[GRID_NAME_MAX];
	int r = simplify_out_begin(&t->border, s->p.dirfd, simplify_name(border, "border", where->attempt, 0, 0),
				   sizeof(uint64_t), err);

	if (r)
		return r;
	r = seed_grid(s, t, name, simplify_name(segment, "narrow", where->attempt, 0, 0), ret, &strip, err);
	if (!r)
		r = simplify_out_end(&t->border, NULL, err);
	simplify_out_abort(&t->border);
	return r ? r : simplify_manifest(s, simplify_name(manifest, "strip", where->attempt, 0, 0), &strip, 1, where->lines, err);
}

int simplify_seed_grid(const struct simplify *s, struct simplify_where *where, const char *name, struct grid_segment_info *ret,
		       struct err *err)
{
	struct seeds *t = calloc(1, sizeof *t);
	int r;

	if (!t)
		return err_set(err, ERR_NOMEM, "no memory for the points chosen");
	t->key = where->error << SIMPLIFY_KEY_SHIFT;
	t->settles = simplify_settles(s);
	if (t->settles)
		r = seed_grids(s, where, t, name, ret, err);
	else
		r = seed_grid(s, t, name, NULL, ret, NULL, err);
	where->edges = t->border.n;
	free(t);
	return r;
}
