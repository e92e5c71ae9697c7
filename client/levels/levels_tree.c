/*
 * The quadtree: which triangles are in which leaf.
 *
 * The root is a square at the low corner of the mesh's box, its side the next power of two of lattice steps. A triangle is in the
 * cell that has its centroid, rounded down. A cell with more triangles than a leaf may have is divided into four. So the tree is
 * a function of the mesh. Triangles do not overlap, so their centroids differ, and a cell of one lattice step has at most 9:
 * cells with many triangles have long sides.
 *
 * Sorted by the Morton codes of their centroids the triangles of a cell are neighbours, and one pass with a buffer of one leaf
 * finds the leaves.
 */
#include <stdlib.h>

#include "levels_priv.h"
#include "morton.h"

/* ---- codes ---- */

uint64_t levels_key(const struct levels *lv, const uint32_t at[3][2])
{
	uint64_t x = ((uint64_t)at[0][0] + at[1][0] + at[2][0]) / 3, y = ((uint64_t)at[0][1] + at[1][1] + at[2][1]) / 3;

	return morton_code((uint32_t)x, (uint32_t)y) << (64 - 2 * lv->bits);
}

uint64_t levels_place_key(const uint32_t at[2])
{
	return morton_code(at[0], at[1]);
}

unsigned levels_common(uint64_t a, uint64_t b)
{
	return a == b ? 32 : (unsigned)__builtin_clzll(a ^ b) / 2;
}

/* A depth beyond 32 is that of cells of one place. */
static uint64_t first_of(uint64_t key, unsigned depth)
{
	if (depth >= 32)
		return key;
	return depth ? key & ~(uint64_t)0 << (64 - 2 * depth) : 0;
}

bool levels_holds(const struct levels_cell *cell, uint64_t key)
{
	return first_of(key, cell->depth) == cell->key;
}

void levels_corner(const struct levels *lv, const struct levels_cell *cell, uint64_t ret[2])
{
	uint64_t code = cell->key >> (64 - 2 * lv->bits);

	ret[0] = morton_gather(code);
	ret[1] = morton_gather(code >> 1);
}

uint64_t levels_side(const struct levels *lv, const struct levels_cell *cell)
{
	return (uint64_t)1 << (lv->bits - cell->depth);
}

/* ---- leaves with triangles ---- */

static int add_leaf(struct levels *lv, uint64_t key, unsigned depth, uint32_t count, struct err *err)
{
	int r = levels_grow((void **)&lv->leaf, &lv->leaf_room, lv->nleaf, sizeof(*lv->leaf), err);

	if (!r)
		lv->leaf[lv->nleaf++] = (struct levels_leaf){{first_of(key, depth), depth}, count};
	return r;
}

static void unpack(const uint64_t *rec, struct levels_triangle *t)
{
	*t = (struct levels_triangle){.key = rec[0]};
	for (int j = 0; j < 3; j++) {
		t->at[j][0] = (uint32_t)(rec[1 + j] >> 32);
		t->at[j][1] = (uint32_t)rec[1 + j];
	}
	t->z[0] = (int32_t)(uint32_t)(rec[4] >> 32);
	t->z[1] = (int32_t)(uint32_t)rec[4];
	t->z[2] = (int32_t)(uint32_t)rec[5];
}

/* The leaf that begins with the first triangle of the buffer; all before it are in other leaves, `last` the nearest of them. The
 * cells that both are in were divided. So it is the next smaller cell if the rest of it is in the buffer. */
static void next_leaf(const struct levels_triangle *t, uint32_t n, uint32_t most, const uint64_t *last, unsigned *ret_depth,
		      uint32_t *ret_count)
{
	unsigned depth = last ? levels_common(*last, t[0].key) + 1 : 0;
	struct levels_cell cell;
	uint32_t count = 0;

	if (n > most && levels_common(t[0].key, t[most].key) + 1 > depth)
		depth = levels_common(t[0].key, t[most].key) + 1;
	cell = (struct levels_cell){first_of(t[0].key, depth), depth};
	while (count < n && levels_holds(&cell, t[count].key))
		count++;
	*ret_depth = depth;
	*ret_count = count;
}

static int fill(struct levels *lv, struct levels_triangle *t, uint32_t *n, uint32_t most, bool *end, struct err *err)
{
	const uint64_t *rec;
	int r = 0;

	while (*n < most && !*end && !(r = sort_next(lv->sort, &rec, err))) {
		if (rec)
			unpack(rec, &t[(*n)++]);
		else
			*end = true;
	}
	return r;
}

static int find_leaves(struct levels *lv, struct levels_triangle *t, struct err *err)
{
	uint32_t n = 0, most = lv->opt.leaf;
	bool end = false, any = false;
	uint64_t last = 0;
	int r = sort_start(lv->sort, err);

	while (!r && !(r = fill(lv, t, &n, most + 1, &end, err)) && n) {
		unsigned depth;
		uint32_t count;

		next_leaf(t, n, most, any ? &last : NULL, &depth, &count);
		if (depth > lv->bits - LEVELS_BITS + 1)
			return err_set(err, ERR_PROTO, "the triangles of the stream overlap");
		r = add_leaf(lv, t[0].key, depth, count, err);
		if (!r)
			r = outfile_write(lv->own, t, count * sizeof(*t), err);
		last = t[count - 1].key;
		any = true;
		n -= count;
		memmove(t, t + count, n * sizeof(*t));
		if (!r && lv->opt.interrupted && lv->opt.interrupted(lv->opt.ctx))
			r = err_set(err, ERR_CANCELLED, "interrupted");
	}
	return r;
}

/* ---- and those without ---- */

struct complete {
	const struct levels_leaf *had;
	size_t n;
};

static int complete(struct levels *lv, struct complete *c, uint64_t key, unsigned depth, struct err *err)
{
	const struct levels_cell cell = {key, depth};
	int r = 0;

	if (!c->n || !levels_holds(&cell, c->had->cell.key))
		return add_leaf(lv, key, depth, 0, err);
	if (c->had->cell.depth == depth) {
		r = add_leaf(lv, key, depth, c->had->count, err);
		c->had++;
		c->n--;
		return r;
	}
	for (uint64_t i = 0; i < 4 && !r; i++)
		r = complete(lv, c, key | i << (62 - 2 * depth), depth + 1, err);
	return r;
}

int levels_cut(struct levels *lv, struct err *err)
{
	struct levels_triangle *buffer = malloc(((size_t)lv->opt.leaf + 1) * sizeof(*buffer));
	int r = buffer ? find_leaves(lv, buffer, err) : levels_no_memory(err);
	struct levels_leaf *had = lv->leaf;
	struct complete c = {had, lv->nleaf};

	free(buffer);
	lv->sort = sort_free(lv->sort);
	if (!r && lv->nleaf) {
		lv->leaf = NULL;
		lv->nleaf = lv->leaf_room = 0;
		r = complete(lv, &c, 0, 0, err);
		free(had);
	}
	return r;
}

/* ---- triangles that reach into other leaves ---- */

/* Twice the area on the left of an edge. */
static levels_i128 side_of(const struct levels_triangle *t, int j, uint64_t x, uint64_t y)
{
	const uint32_t *a = t->at[j], *b = t->at[(j + 1) % 3];

	return (levels_i128)((int64_t)b[0] - a[0]) * ((int64_t)y - a[1]) -
	       (levels_i128)((int64_t)b[1] - a[1]) * ((int64_t)x - a[0]);
}

bool levels_meets(const struct levels_triangle *t, const uint64_t corner[2], uint64_t side)
{
	for (int k = 0; k < 2; k++) {
		uint64_t low = corner[k], high = corner[k] + side;

		if ((t->at[0][k] < low && t->at[1][k] < low && t->at[2][k] < low) ||
		    (t->at[0][k] > high && t->at[1][k] > high && t->at[2][k] > high))
			return false;
	}
	for (int j = 0; j < 3; j++) {
		const uint32_t *a = t->at[j], *b = t->at[(j + 1) % 3];
		/* the corner of the square that is farthest on the left */
		uint64_t x = b[1] < a[1] ? corner[0] + side : corner[0], y = b[0] > a[0] ? corner[1] + side : corner[1];

		if (side_of(t, j, x, y) < 0)
			return false;
	}
	return true;
}

struct search {
	const struct levels *lv;
	const struct levels_triangle *t;
	size_t own;
	int (*each)(void *ctx, size_t leaf, struct err *err);
	void *ctx;
};

/* The first leaf from `from` on whose cell begins at `key` or later. */
static size_t leaf_at(const struct levels *lv, size_t from, size_t to, uint64_t key)
{
	while (from < to) {
		size_t middle = from + (to - from) / 2;

		if (lv->leaf[middle].cell.key < key)
			from = middle + 1;
		else
			to = middle;
	}
	return from;
}

static int descend(const struct search *s, const struct levels_cell *cell, size_t from, size_t to, struct err *err)
{
	uint64_t corner[2];
	int r = 0;

	if (to - from == 1 && from == s->own)
		return 0;
	levels_corner(s->lv, cell, corner);
	if (!levels_meets(s->t, corner, levels_side(s->lv, cell)))
		return 0;
	if (s->lv->leaf[from].cell.depth == cell->depth)
		return s->each(s->ctx, from, err);
	for (uint64_t i = 0; i < 4 && !r; i++) {
		unsigned shift = 62 - 2 * cell->depth;
		const struct levels_cell child = {cell->key | i << shift, cell->depth + 1};
		size_t end = i == 3 ? to : leaf_at(s->lv, from, to, cell->key | (i + 1) << shift);

		r = descend(s, &child, from, end, err);
		from = end;
	}
	return r;
}

int levels_elsewhere(const struct levels *lv, const struct levels_triangle *t, size_t own,
		     int (*each)(void *ctx, size_t leaf, struct err *err), void *ctx, struct err *err)
{
	const struct search s = {lv, t, own, each, ctx};
	const struct levels_cell root = {0, 0};
	uint64_t corner[2], side = levels_side(lv, &lv->leaf[own].cell);
	bool inside = true;

	levels_corner(lv, &lv->leaf[own].cell, corner);
	for (int j = 0; j < 3; j++)
		for (int k = 0; k < 2; k++)
			inside &= t->at[j][k] > corner[k] && t->at[j][k] < corner[k] + side;
	return inside ? 0 : descend(&s, &root, 0, lv->nleaf, err);
}
