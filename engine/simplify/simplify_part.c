/* A task of the blocks: greedy insertion in a few blocks, one after the other. */
#include <string.h>

#include "align.h"
#include "err.h"
#include "simplify_priv.h"

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
	uint32_t n;
	struct point pts[SIMPLIFY_BLOCK];
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

static int write_seed(struct part *w, uint32_t i, uint64_t key, struct err *err)
{
	const struct simplify_seed seed = {w->pts[i], key};

	return simplify_out_add(&w->out, &seed, 1, err);
}

/* With max_points the error is not known yet, so all is inserted, and the keys tell what an error leaves. */
static uint64_t least_key(const struct simplify *s)
{
	return s->p.max_points ? 0 : s->at.error << SIMPLIFY_KEY_SHIFT;
}

static int write_block(struct part *w, struct err *err)
{
	struct simplify_greedy g = {.pts = w->pts,
				    .n = w->n,
				    .least = least_key(w->s),
				    .rough = !w->s->p.max_points,
				    .step = w->s->p.max_points ? FINE : 0};
	int r = 0;

	simplify_greedy_run(&g, w->greedy);
	for (uint32_t i = 0; !r && i < w->n; i++)
		if (w->pts[i].tag & POINT_LINE)
			r = write_seed(w, i, SIMPLIFY_SEED_LINE, err);
	for (uint32_t i = 0; !r && i < g.nhull; i++)
		r = write_seed(w, g.hull[i], SIMPLIFY_SEED_HULL, err);
	for (uint32_t i = 0; !r && i < g.npick; i++)
		r = write_seed(w, g.pick[i].at, g.pick[i].key, err);
	return r;
}

static int write_all(struct part *w, struct err *err)
{
	int r = 0;

	for (uint32_t i = 0; !r && i < w->n; i++)
		r = write_seed(w, i, w->pts[i].tag & POINT_LINE ? SIMPLIFY_SEED_LINE : SIMPLIFY_SEED_FLAT, err);
	return r;
}

static int do_block(struct part *w, const struct simplify_block *b, struct err *err)
{
	int r;

	w->n = 0;
	r = simplify_scan(&w->sink, w->reader, b->lo, b->hi, err);
	if (!r)
		r = w->s->at.flat ? write_all(w, err) : write_block(w, err);
	return r;
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
	w->greedy = at + align_line(reader_bytes);
	r = grid_reader_new(s->p.grid, at, reader_bytes, &w->reader, err);
	if (!r) {
		r = do_blocks(w, task, err);
		grid_reader_free(w->reader);
	}
	if (!r)
		r = simplify_out_end(&w->out, NULL, err);
	simplify_out_abort(&w->out);
	simplify_in_end(&w->in);
	return r;
}
