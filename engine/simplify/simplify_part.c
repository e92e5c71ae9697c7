/* A task of the blocks: greedy insertion in a few blocks, one after the other. */
#include <string.h>

#include "align.h"
#include "err.h"
#include "lineset.h"
#include "simplify_priv.h"
#include "simplify_raster.h"

/* The step of greedy insertion with max_points: finer, so that the picks with keys above an error are those of a run that ends
 * there, but for a few in a hundred. */
enum { FINE = 24 };

struct part {
	struct simplify_in in;
	struct simplify_out out;
	struct simplify_sink sink;
	const struct simplify *s;
	struct grid_reader *reader;
	void *greedy;
	struct simplify_found found;
	struct simplify_raster raster;
	int32_t box[4]; /* of the points */
	uint32_t n;
	struct point pts[SIMPLIFY_BLOCK];
	uint64_t key[SIMPLIFY_BLOCK]; /* of the points that are seeds; else 0 */
};

size_t simplify_part_bytes(const struct grid *grid)
{
	return align_line(sizeof(struct part)) + align_line(grid_reader_bytes(grid)) + simplify_greedy_bytes(SIMPLIFY_BLOCK);
}

static int add_point(void *ctx, const struct point *p, struct err *err)
{
	struct part *w = ctx;

	if (w->n == SIMPLIFY_BLOCK)
		return err_set(err, ERR_CORRUPT, "a block has more points than were counted");
	w->pts[w->n++] = *p;
	return 0;
}

static int write_seeds(struct part *w, struct err *err)
{
	int r = 0;

	for (uint32_t i = 0; !r && i < w->n; i++) {
		const struct simplify_seed seed = {w->pts[i], w->key[i]};

		r = seed.key ? simplify_out_add(&w->out, &seed, 1, err) : 0;
	}
	return r;
}

/* With max_points the error is not known yet, so all is inserted, and the keys tell what an error leaves. */
static uint64_t least_key(const struct simplify *s)
{
	return s->p.max_points ? 0 : s->at.error << SIMPLIFY_KEY_SHIFT;
}

/* ---- where pieces of lines are ---- */

static int mark_piece(void *ctx, const struct lineset_piece *piece, struct err *err)
{
	struct part *w = ctx;

	(void)err;
	simplify_raster_line(&w->raster, piece->a, piece->b);
	return 0;
}

static int mark_pieces(struct part *w, struct lineset_reader *lines, struct err *err)
{
	for (uint32_t i = 0; i < w->n; i++) {
		const int32_t at[4] = {w->pts[i].x, w->pts[i].y, w->pts[i].x, w->pts[i].y};

		if (i)
			point_box_join(w->box, at);
		else
			memcpy(w->box, at, sizeof at);
	}
	simplify_raster_init(&w->raster, w->box, SIMPLIFY_RASTER);
	return lineset_find(lines, w->box, mark_piece, w, err);
}

/* ---- a block ---- */

static void join_found(struct simplify_found *to, const struct simplify_found *from)
{
	if (from->far > to->far)
		*to = *from;
}

static uint64_t marks_of(uint32_t corner)
{
	return (corner & SIMPLIFY_EDGE ? SIMPLIFY_SEED_EDGE : 0) | (corner & SIMPLIFY_RING ? SIMPLIFY_SEED_RING : 0);
}

/* Greedy insertion. The keys of points that may be corners of other triangles than settled ones have a mark. */
static void run_block(struct part *w, const struct simplify_raster *pieces, const int32_t clear[4])
{
	struct simplify_greedy g = {.pts = w->pts,
				    .n = w->n,
				    .least = least_key(w->s),
				    .rough = !w->s->p.max_points,
				    .step = w->s->p.max_points ? FINE : 0,
				    .pieces = pieces,
				    .clear = simplify_settles(w->s) ? clear : NULL};

	simplify_greedy_run(&g, w->greedy);
	memset(w->key, 0, w->n * sizeof *w->key);
	for (uint32_t i = 0; i < g.npick; i++)
		w->key[g.pick[i].at] = g.pick[i].key | (g.clear ? marks_of(g.corner[g.pick[i].at]) : 0);
	for (uint32_t i = 0; i < g.nhull; i++)
		w->key[g.hull[i]] = SIMPLIFY_SEED_HULL;
	for (uint32_t i = 0; i < w->n; i++)
		if (w->pts[i].tag & POINT_LINE)
			w->key[i] = w->key[i] == SIMPLIFY_SEED_HULL ? SIMPLIFY_SEED_LINE_HULL : SIMPLIFY_SEED_LINE;
	join_found(&w->found, &g.found);
}

static void take_all(struct part *w)
{
	for (uint32_t i = 0; i < w->n; i++)
		w->key[i] = w->pts[i].tag & POINT_LINE ? SIMPLIFY_SEED_LINE : SIMPLIFY_SEED_FLAT;
}

static int do_block(struct part *w, const struct simplify_block *b, struct err *err)
{
	struct lineset_reader *lines = grid_reader_lines(w->reader);
	int32_t clear[4];
	int r;

	point_from_morton(b->lo, &clear[0], &clear[1]);
	point_from_morton(b->hi, &clear[2], &clear[3]);
	if (w->s->loose)
		memcpy(clear, (const int32_t[]){INT32_MIN, INT32_MIN, INT32_MAX, INT32_MAX}, sizeof clear);
	w->n = 0;
	r = simplify_scan(&w->sink, w->reader, b->lo, b->hi, err);
	if (!r && lines && w->n)
		r = mark_pieces(w, lines, err);
	if (r)
		return r;
	if (w->s->at.flat)
		take_all(w);
	else
		run_block(w, lines ? &w->raster : NULL, clear);
	return write_seeds(w, err);
}

static int do_blocks(struct part *w, uint32_t task, struct err *err)
{
	uint64_t from = w->in.n * task / w->s->at.parts, to = w->in.n * (task + 1) / w->s->at.parts;
	struct simplify_block b;
	int r = 0;

	for (uint64_t i = from; !r && i < to; i++) {
		r = simplify_in_some(&w->in, &b, i, 1, err);
		if (!r)
			r = do_block(w, &b, err);
	}
	return r;
}

int simplify_part(const struct simplify *s, uint32_t task, void *memory, struct err *err)
{
	struct part *w = memory;
	uint8_t *at = (uint8_t *)memory + align_line(sizeof *w);
	size_t reader_bytes = grid_reader_bytes(s->p.grid);
	uint64_t info[SIMPLIFY_INFO];
	char name[GRID_NAME_MAX];
	int r = simplify_in_begin(&w->in, s->p.dirfd, "blocks", sizeof(struct simplify_block), err);

	if (r)
		return r;
	r = simplify_out_begin(&w->out, s->p.dirfd, simplify_name(name, "part", task, 0, 0), sizeof(struct simplify_seed), err);
	if (r) {
		simplify_in_end(&w->in);
		return r;
	}
	simplify_sink_init(&w->sink, s, &s->view);
	w->sink.ctx = w;
	w->sink.point = add_point;
	w->s = s;
	w->found = (struct simplify_found){.tests = 0};
	w->greedy = at + align_line(reader_bytes);
	r = grid_reader_new(s->p.grid, at, reader_bytes, &w->reader, err);
	if (!r) {
		r = do_blocks(w, task, err);
		grid_reader_free(w->reader);
	}
	memcpy(info, &w->found, sizeof info);
	if (!r)
		r = simplify_out_end(&w->out, info, err);
	simplify_out_abort(&w->out);
	simplify_in_end(&w->in);
	return r;
}
