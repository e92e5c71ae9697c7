/*
 * From the triangles of a mesh, in any order, to a tree of tiles: passes over files, whatever the size of the mesh.
 *
 * 1. Triangles are sorted by the Morton code of their centroids and cut into leaves (levels_tree.c).
 * 2. Those that reach into other leaves are sorted by these leaves.
 * 3. Leaf by leaf, heights are sampled for all grids that the leaf is in (levels_grid.c). A grid is complete when the last of its
 *    leaves is.
 * 4. Leaf by leaf again, with these grids, their error is measured (levels_error.c), and the tiles are written (levels_tile.c).
 *
 * Memory: that of the sort, one leaf, a grid of each depth, and some bytes a leaf. On the disk are 48 bytes a triangle twice,
 * until all is written.
 */
#include <stdlib.h>

#include "levels_priv.h"

#define MEMORY (8ull << 20)

int levels_no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory for tiles");
}

int levels_grow(void **list, size_t *room, size_t used, size_t size, struct err *err)
{
	size_t more = *room ? *room + *room / 2 : 64;
	void *grown;

	if (used < *room)
		return 0;
	grown = realloc(*list, more * size);
	if (!grown)
		return levels_no_memory(err);
	*list = grown;
	*room = more;
	return 0;
}

int levels_new(const struct levels_options *opt, struct levels **ret, struct err *err)
{
	struct levels *lv = calloc(1, sizeof(*lv));
	int r;

	if (!lv)
		return levels_no_memory(err);
	lv->opt = *opt;
	if (!lv->opt.leaf)
		lv->opt.leaf = LEVELS_LEAF;
	if (!lv->opt.memory)
		lv->opt.memory = MEMORY;
	r = sort_new(6, 4, lv->opt.memory, opt->beside, &lv->sort, err);
	if (r) {
		levels_free(lv);
		return r;
	}
	*ret = lv;
	return 0;
}

struct levels *levels_free(struct levels *lv)
{
	if (!lv)
		return NULL;
	sort_free(lv->sort);
	outfile_free(lv->own);
	outfile_free(lv->foreign);
	outfile_free(lv->grids);
	for (int d = 0; d < LEVELS_DEPTHS; d++)
		free(lv->stack[d]);
	levels_buffers_free(lv);
	free(lv->leaf);
	free(lv->tile);
	free(lv->inner);
	free(lv);
	return NULL;
}

int levels_box(struct levels *lv, const int32_t low[2], const int32_t high[2], struct err *err)
{
	for (int k = 0; k < 2; k++) {
		uint64_t size = low[k] <= high[k] ? (uint64_t)((int64_t)high[k] - low[k]) : 0;

		lv->low[k] = low[k];
		for (lv->bits = lv->bits < LEVELS_BITS ? LEVELS_BITS : lv->bits; size >> lv->bits; lv->bits++)
			;
	}
	return 0;
}

int levels_triangle(struct levels *lv, const int32_t *const corner[3], struct err *err)
{
	uint64_t place[3], rec[6];
	uint32_t at[3][2];
	int low = 0;

	for (int j = 0; j < 3; j++) {
		for (int k = 0; k < 2; k++) {
			int64_t n = (int64_t)corner[j][k] - lv->low[k];

			if (n < 0 || n >> lv->bits)
				return err_set(err, ERR_PROTO, "a triangle is outside of the box that the stream announced");
			at[j][k] = (uint32_t)n;
		}
		place[j] = (uint64_t)at[j][0] << 32 | at[j][1];
		low = place[j] < place[low] ? j : low;
	}
	rec[0] = levels_key(lv, at);
	for (int j = 0; j < 3; j++)
		rec[1 + j] = place[(low + j) % 3];
	rec[4] = (uint64_t)(uint32_t)corner[low][2] << 32 | (uint32_t)corner[(low + 1) % 3][2];
	rec[5] = (uint32_t)corner[(low + 2) % 3][2];
	lv->triangles++;
	return sort_add(lv->sort, rec, err);
}

/* ---- triangles of files ---- */

struct reader {
	struct outfile *from;
	uint64_t at;
	struct levels_triangle piece[LEVELS_PIECE];
	uint32_t next, have;
};

/* NULL at the end. */
static int peek(struct reader *in, const struct levels_triangle **ret, struct err *err)
{
	uint64_t left = (outfile_size(in->from) - in->at) / sizeof(*in->piece);
	int r = 0;

	if (in->next == in->have && left) {
		in->have = left < LEVELS_PIECE ? (uint32_t)left : LEVELS_PIECE;
		in->next = 0;
		r = outfile_read(in->from, in->at, in->piece, in->have * sizeof(*in->piece), err);
		in->at += in->have * sizeof(*in->piece);
	}
	*ret = in->next < in->have ? &in->piece[in->next] : NULL;
	return r;
}

static int interrupted(const struct levels *lv, struct err *err)
{
	return lv->opt.interrupted && lv->opt.interrupted(lv->opt.ctx) ? err_set(err, ERR_CANCELLED, "interrupted") : 0;
}

/* ---- 2: triangles that reach into other leaves ---- */

struct spread {
	struct sort *sort;
	const struct levels_triangle *t;
};

static int spread_one(void *ctx, size_t leaf, struct err *err)
{
	const struct spread *s = ctx;
	const struct levels_triangle *t = s->t;
	uint64_t rec[5] = {(uint64_t)leaf << 32 | (uint32_t)t->z[2]};

	for (int j = 0; j < 3; j++)
		rec[1 + j] = (uint64_t)t->at[j][0] << 32 | t->at[j][1];
	rec[4] = (uint64_t)(uint32_t)t->z[0] << 32 | (uint32_t)t->z[1];
	return sort_add(s->sort, rec, err);
}

static int keep_sorted(struct levels *lv, struct sort *sort, struct err *err)
{
	const uint64_t *rec;
	int r = sort_start(sort, err);

	while (!r && !(r = sort_next(sort, &rec, err)) && rec) {
		struct levels_triangle t = {.leaf = (uint32_t)(rec[0] >> 32)};

		for (int j = 0; j < 3; j++) {
			t.at[j][0] = (uint32_t)(rec[1 + j] >> 32);
			t.at[j][1] = (uint32_t)rec[1 + j];
		}
		t.z[0] = (int32_t)(uint32_t)(rec[4] >> 32);
		t.z[1] = (int32_t)(uint32_t)rec[4];
		t.z[2] = (int32_t)(uint32_t)rec[0];
		t.key = levels_key(lv, (const uint32_t(*)[2])t.at);
		r = outfile_write(lv->foreign, &t, sizeof(t), err);
	}
	return r;
}

static int spread(struct levels *lv, struct reader *in, struct err *err)
{
	struct spread s = {NULL, NULL};
	int r = sort_new(5, 4, lv->opt.memory, lv->opt.beside, &s.sort, err);

	for (size_t i = 0; i < lv->nleaf && !r; i++) {
		for (uint32_t k = 0; k < lv->leaf[i].count && !r; k++, in->next++) {
			r = peek(in, &s.t, err);
			if (!r)
				r = levels_elsewhere(lv, s.t, i, spread_one, &s, err);
		}
		if (!r)
			r = interrupted(lv, err);
	}
	if (!r)
		r = keep_sorted(lv, s.sort, err);
	sort_free(s.sort);
	return r;
}

/* ---- 3 and 4: leaf by leaf, with the grids that it is in ---- */

struct pass {
	struct levels *lv;
	struct reader own, foreign;
	size_t entered;
	uint64_t first; /* of the leaf's triangles */
	int (*enter)(struct pass *, struct levels_grid *, struct err *err);
	int (*leaf)(struct pass *, size_t leaf, struct err *err);
	int (*leave)(struct pass *, struct levels_grid *, struct err *err);
};

static int enter(struct pass *p, const struct levels_leaf *leaf, unsigned depth, struct err *err)
{
	struct levels *lv = p->lv;
	struct levels_grid **g = &lv->stack[depth];
	uint64_t corner[2];

	if (!*g)
		*g = malloc(sizeof(**g));
	if (!*g)
		return levels_no_memory(err);
	memset(*g, 0, sizeof(**g));
	(*g)->cell = (struct levels_cell){depth ? leaf->cell.key & ~(uint64_t)0 << (64 - 2 * depth) : 0, depth};
	levels_corner(lv, &(*g)->cell, corner);
	(*g)->x = corner[0];
	(*g)->y = corner[1];
	(*g)->step = lv->bits - depth - LEVELS_BITS;
	(*g)->stored = p->entered++;
	return p->enter(p, *g, err);
}

static int walk(struct pass *p, struct err *err)
{
	struct levels *lv = p->lv;
	int r = 0;

	for (size_t i = 0; i < lv->nleaf && !r; i++) {
		const struct levels_leaf *leaf = &lv->leaf[i];
		unsigned from = i ? levels_common(leaf[-1].cell.key, leaf->cell.key) + 1 : 0;
		unsigned to = i + 1 < lv->nleaf ? levels_common(leaf->cell.key, leaf[1].cell.key) + 1 : 0;

		for (unsigned d = from; d < leaf->cell.depth && !r; d++)
			r = enter(p, leaf, d, err);
		if (!r)
			r = p->leaf(p, i, err);
		p->first += leaf->count;
		for (unsigned d = leaf->cell.depth; d > to && !r; d--)
			r = p->leave(p, lv->stack[d - 1], err);
		if (!r)
			r = interrupted(lv, err);
	}
	return r;
}

static int sample_enter(struct pass *p, struct levels_grid *g, struct err *err)
{
	struct levels *lv = p->lv;
	int r = levels_grow((void **)&lv->inner, &lv->inner_room, lv->ninner, sizeof(*lv->inner), err);

	if (!r)
		lv->inner[lv->ninner++] = 0;
	return r;
}

static int sample_leaf(struct pass *p, size_t i, struct err *err)
{
	const struct levels_leaf *leaf = &p->lv->leaf[i];
	const struct levels_triangle *t;
	int r = 0;

	if (!leaf->cell.depth)
		return 0;
	for (uint32_t k = 0; k < leaf->count && !r; k++, p->own.next++)
		if (!(r = peek(&p->own, &t, err)))
			levels_sample(p->lv, leaf, t);
	while (!r && !(r = peek(&p->foreign, &t, err)) && t && t->leaf == i) {
		levels_sample(p->lv, leaf, t);
		p->foreign.next++;
	}
	return r;
}

static int sample_leave(struct pass *p, struct levels_grid *g, struct err *err)
{
	struct levels *lv = p->lv;
	int r;

	lv->inner[g->stored] = outfile_size(lv->grids);
	r = outfile_write(lv->grids, g->z, sizeof(g->z), err);
	return r ? r : outfile_write(lv->grids, g->has, sizeof(g->has), err);
}

static int write_enter(struct pass *p, struct levels_grid *g, struct err *err)
{
	struct levels *lv = p->lv;
	uint64_t at = lv->inner[g->stored];
	int r = outfile_read(lv->grids, at, g->z, sizeof(g->z), err);

	g->error = 0.5;
	return r ? r : outfile_read(lv->grids, at + sizeof(g->z), g->has, sizeof(g->has), err);
}

static struct levels_about *place_of(struct levels *lv, const struct levels_cell *cell)
{
	return cell->depth ? &lv->stack[cell->depth - 1]->child[cell->key >> (64 - 2 * cell->depth) & 3] : &lv->root;
}

/* Quads of the parent's grid that a triangle of another leaf meets. */
static void mark(struct levels *lv, const struct levels_leaf *leaf, const struct levels_triangle *t)
{
	struct levels_grid *g = lv->stack[leaf->cell.depth - 1];
	uint8_t *border = g->border[leaf->cell.key >> (64 - 2 * leaf->cell.depth) & 3];
	uint64_t corner[2], side = (uint64_t)1 << g->step, most = LEVELS_SIDE / 2 - 1, low[2], high[2];

	levels_corner(lv, &leaf->cell, corner);
	for (int k = 0; k < 2; k++) {
		low[k] = most;
		high[k] = 0;
		for (int j = 0; j < 3; j++) {
			uint64_t n = t->at[j][k] > corner[k] ? (t->at[j][k] - corner[k]) >> g->step : 0;

			low[k] = n < low[k] ? n : low[k];
			high[k] = n > high[k] ? n : high[k];
		}
		high[k] = high[k] < most ? high[k] : most;
	}
	for (uint64_t y = low[1]; y <= high[1]; y++)
		for (uint64_t x = low[0]; x <= high[0]; x++) {
			const uint64_t at[2] = {corner[0] + x * side, corner[1] + y * side};

			if (!border[y * (most + 1) + x])
				border[y * (most + 1) + x] = levels_meets(t, at, side);
		}
}

static int write_leaf(struct pass *p, size_t i, struct err *err)
{
	struct levels *lv = p->lv;
	const struct levels_leaf *leaf = &lv->leaf[i];
	const struct levels_triangle *t;
	int r = 0;

	for (uint32_t k = 0; k < leaf->count && !r && leaf->cell.depth; k++, p->own.next++) {
		r = peek(&p->own, &t, err);
		for (unsigned d = 0; d < leaf->cell.depth && !r; d++)
			levels_compare(lv->stack[d], t, true);
	}
	while (!r && !(r = peek(&p->foreign, &t, err)) && t && t->leaf == i) {
		for (unsigned d = 0; d < leaf->cell.depth; d++)
			if (!levels_holds(&lv->stack[d]->cell, t->key))
				levels_compare(lv->stack[d], t, false);
		mark(lv, leaf, t);
		p->foreign.next++;
	}
	return r || !leaf->count ? r : levels_put_leaf(lv, leaf, p->first, place_of(lv, &leaf->cell), err);
}

static int write_leave(struct pass *p, struct levels_grid *g, struct err *err)
{
	struct levels_about *about = place_of(p->lv, &g->cell);

	about->grid = true;
	about->triangles = 0;
	about->error = levels_up(g->error + 0.001); /* which is more than any rounding */
	about->lost = g->corners ? levels_up((double)g->lost / (double)g->corners) : 0;
	for (int i = 0; i < 4; i++) {
		const struct levels_about *child = &g->child[i];

		for (int k = 0; k < 3 && child->triangles; k++) {
			bool first = !about->triangles;

			about->box[k] = first || child->box[k] < about->box[k] ? child->box[k] : about->box[k];
			about->box[k + 3] =
				first || child->box[k + 3] > about->box[k + 3] ? child->box[k + 3] : about->box[k + 3];
		}
		about->triangles += child->triangles;
	}
	return levels_put_grid(p->lv, g, err);
}

static int pass(struct levels *lv, bool write, struct err *err)
{
	struct pass *p = calloc(1, sizeof(*p));
	int r;

	if (!p)
		return levels_no_memory(err);
	p->lv = lv;
	p->own.from = lv->own;
	p->foreign.from = lv->foreign;
	p->enter = write ? write_enter : sample_enter;
	p->leaf = write ? write_leaf : sample_leaf;
	p->leave = write ? write_leave : sample_leave;
	r = walk(p, err);
	free(p);
	return r;
}

int levels_make(struct levels *lv, const char *stamp, struct err *err)
{
	struct reader *in = calloc(1, sizeof(*in));
	int r = in ? 0 : levels_no_memory(err);

	lv->stamp = stamp;
	if (!r)
		r = outfile_spool(lv->opt.beside, &lv->own, err);
	if (!r)
		r = outfile_spool(lv->opt.beside, &lv->foreign, err);
	if (!r)
		r = outfile_spool(lv->opt.beside, &lv->grids, err);
	if (!r)
		r = levels_cut(lv, err);
	if (!r) {
		in->from = lv->own;
		r = spread(lv, in, err);
	}
	free(in);
	if (!r)
		r = pass(lv, false, err);
	if (!r)
		r = levels_buffers_new(lv, err);
	return r ? r : pass(lv, true, err);
}

void levels_facts(const struct levels *lv, FILE *f)
{
	fprintf(f, "\"levels\":{\"stamp\":\"%s\",\"low\":[%d,%d],\"bits\":%u,\"side\":%d,\"root\":", lv->stamp, lv->low[0],
		lv->low[1], lv->bits, LEVELS_SIDE);
	levels_put_about(f, &lv->root);
	fputc('}', f);
}

uint64_t levels_bytes(const struct levels *lv)
{
	return lv->bytes;
}

size_t levels_tiles(const struct levels *lv)
{
	return lv->ntile;
}

const char *levels_name(void *levels, size_t i, char *buf)
{
	return levels_tile_name(&((struct levels *)levels)->tile[i], buf);
}
