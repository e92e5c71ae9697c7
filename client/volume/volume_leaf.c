/*
 * Pairs of triangles in memory: those of a in a grid of cells, each of b with those in its cells.
 *
 * Triangles that are the same in both are found first, by a table: they meet each other alone, since those of one mesh do not
 * overlap. In two states of one survey these are nearly all.
 *
 * Slivers around a vertex are in many cells, and in each other's. Where triangles of a are in too many of them, or there were
 * many tries for each of b, the rest of them is left to volume_slab.c.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grow.h"
#include "volume_priv.h"

/* Items of the grid, and tries, that are always good. */
enum { ITEMS_LEAST = 4096, SLOTS = 2 * VOLUME_LEAF, CROWD_LEAST = 1 << 17 };

struct volume_leaf {
	uint32_t slot[SLOTS];       /* of the table: a triangle of a, and one; 0: none */
	uint32_t mark[VOLUME_LEAF]; /* of a: the last triangle of b that it was tried with, and one */
	bool gone[VOLUME_LEAF];
	struct volume_grid grid;
	uint32_t *start, *item;
	size_t starts_room, items_room, nitem;
	int (*interrupted)(void *ctx);
	void *ctx;
	/* of the running join */
	const struct volume_triangle *a, *b;
	size_t na, now; /* now: of b, or of a while the grid is filled */
	const struct volume_rect *rect;
	const struct volume_call *call;
	struct err *err;
	bool fill;
	uint64_t tries;
	const uint32_t *index[2]; /* of those that volume_slabs has */
};

struct volume_leaf *volume_leaf_new(int (*interrupted)(void *ctx), void *ctx)
{
	struct volume_leaf *l = calloc(1, sizeof(*l));

	if (l) {
		l->interrupted = interrupted;
		l->ctx = ctx;
	}
	return l;
}

struct volume_leaf *volume_leaf_free(struct volume_leaf *l)
{
	if (l) {
		free(l->start);
		free(l->item);
	}
	free(l);
	return NULL;
}

/* ---- one pair ---- */

/* Its first corner decides where it counts, so it counts once, whatever the cells. */
static int try(struct volume_leaf *l, const struct volume_triangle *a, const struct volume_triangle *b)
{
	struct volume_polygon p;
	int64_t x, y;

	if (!volume_pair(a, b, &p))
		return 0;
	x = (int64_t)floor(p.x[0]) + p.origin[0];
	y = (int64_t)floor(p.y[0]) + p.origin[1];
	if (x < l->rect->x1 || x >= l->rect->x2 || y < l->rect->y1 || y >= l->rect->y2)
		return 0;
	return l->call->pair(l->call->ctx, a, b, &p, l->err);
}

/* ---- the same in both ---- */

static size_t slot_of(const struct volume_triangle *t)
{
	uint64_t h = 0;

	for (int i = 0; i < 3; i++)
		for (int k = 0; k < 3; k++)
			h = (h ^ (uint32_t)t->at[i][k]) * 0x9e3779b97f4a7c15u, h ^= h >> 29;
	return (size_t)(h >> 20) % SLOTS;
}

static void table_fill(struct volume_leaf *l)
{
	memset(l->slot, 0, sizeof(l->slot));
	for (size_t i = 0; i < l->na; i++) {
		size_t at = slot_of(&l->a[i]);

		while (l->slot[at])
			at = (at + 1) % SLOTS;
		l->slot[at] = (uint32_t)i + 1;
	}
}

/* Of a; VOLUME_LEAF: there is none. */
static size_t table_find(const struct volume_leaf *l, const struct volume_triangle *t)
{
	for (size_t at = slot_of(t); l->slot[at]; at = (at + 1) % SLOTS)
		if (!memcmp(&l->a[l->slot[at] - 1], t, sizeof(*t)))
			return l->slot[at] - 1;
	return VOLUME_LEAF;
}

/* ---- the grid ---- */

static int count(void *ctx, uint32_t y, uint32_t x1, uint32_t x2)
{
	struct volume_leaf *l = ctx;

	for (uint32_t x = x1; x <= x2; x++) {
		uint32_t *n = &l->start[(size_t)y * l->grid.nx + x];

		if (l->fill)
			l->item[--*n] = (uint32_t)l->now;
		else
			++*n;
	}
	l->nitem += x2 - x1 + 1;
	return !l->fill && l->nitem > ITEMS_LEAST + volume_join_sizes.crowd / 4 * l->na;
}

static void box_of(const struct volume_triangle *t, size_t n, int64_t box[4])
{
	box[0] = box[1] = INT64_MAX;
	box[2] = box[3] = INT64_MIN;
	for (size_t i = 0; i < n; i++)
		for (int j = 0; j < 3; j++)
			for (int k = 0; k < 2; k++) {
				int64_t v = t[i].at[j][k];

				box[k] = v < box[k] ? v : box[k];
				box[2 + k] = v > box[2 + k] ? v : box[2 + k];
			}
}

/* No larger than where triangles of both may meet in the rectangle. */
static bool grid_box(const struct volume_leaf *l, size_t nb, int64_t box[4])
{
	int64_t other[4];
	const int64_t rect[4] = {l->rect->x1, l->rect->y1, l->rect->x2, l->rect->y2};

	box_of(l->a, l->na, box);
	box_of(l->b, nb, other);
	for (int k = 0; k < 2; k++) {
		box[k] = box[k] > other[k] ? box[k] : other[k];
		box[k] = box[k] > rect[k] ? box[k] : rect[k];
		box[2 + k] = box[2 + k] < other[2 + k] ? box[2 + k] : other[2 + k];
		box[2 + k] = box[2 + k] < rect[2 + k] ? box[2 + k] : rect[2 + k];
	}
	return box[0] <= box[2] && box[1] <= box[3];
}

/* *ret_crowd: it is not filled, since the triangles are in too many cells. */
static int grid_fill(struct volume_leaf *l, const int64_t box[4], bool *ret_crowd)
{
	size_t n;

	*ret_crowd = !volume_join_sizes.crowd;
	if (*ret_crowd)
		return 0;
	l->grid = volume_grid_of(box, (double)l->na / 2 + 1);
	n = (size_t)l->grid.nx * l->grid.ny;
	if (!grow(&l->start, &l->starts_room, n + 1, 1024, sizeof(*l->start)))
		return err_set(l->err, ERR_NOMEM, "no memory for pairs of triangles");
	memset(l->start, 0, (n + 1) * sizeof(*l->start));
	l->nitem = 0;
	l->fill = false;
	for (size_t i = 0; i < l->na && !*ret_crowd; i++)
		*ret_crowd = !l->gone[i] && volume_cells(&l->grid, &l->a[i], count, l);
	if (*ret_crowd)
		return 0;
	if (!grow(&l->item, &l->items_room, l->nitem + 1, 4096, sizeof(*l->item)))
		return err_set(l->err, ERR_NOMEM, "no memory for pairs of triangles");
	for (size_t i = 0, sum = 0; i <= n; i++)
		l->start[i] = (uint32_t)(sum += l->start[i]);
	l->fill = true;
	for (l->now = 0; l->now < l->na; l->now++)
		if (!l->gone[l->now])
			volume_cells(&l->grid, &l->a[l->now], count, l);
	return 0;
}

static int try_cells(void *ctx, uint32_t y, uint32_t x1, uint32_t x2)
{
	struct volume_leaf *l = ctx;
	size_t row = (size_t)y * l->grid.nx;
	int r = 0;

	for (uint32_t i = l->start[row + x1]; i < l->start[row + x2 + 1] && !r; i++) {
		uint32_t a = l->item[i];

		if (l->mark[a] == l->now + 1)
			continue;
		l->mark[a] = (uint32_t)l->now + 1;
		l->tries++;
		r = try(l, &l->a[a], &l->b[l->now]);
	}
	return r;
}

static int try_slabs(void *ctx, uint32_t a, uint32_t b)
{
	struct volume_leaf *l = ctx;

	return try(l, &l->a[l->index[0][a]], &l->b[l->index[1][b]]);
}

/* Those of b whose numbers are in `other`, with all of a that are left. */
static int by_slabs(struct volume_leaf *l, const uint32_t *other, size_t n, const int64_t box[4])
{
	const struct volume_slab_call call = {try_slabs, l, l->interrupted, l->ctx};
	/* a pair counts in the rectangle that has its first corner, rounded */
	const int64_t x[2] = {box[0] - 2, box[2] + 2};
	uint32_t *mine = malloc(l->na * sizeof(*mine));
	size_t na = 0;
	int r;

	if (!mine)
		return err_set(l->err, ERR_NOMEM, "no memory for pairs of triangles");
	for (size_t i = 0; i < l->na; i++)
		if (!l->gone[i])
			mine[na++] = (uint32_t)i;
	l->index[0] = mine;
	l->index[1] = other;
	r = volume_slabs(l->a, mine, na, l->b, other, n, x, &call, l->err);
	free(mine);
	return r;
}

static bool crowded(const struct volume_leaf *l, size_t done)
{
	return l->tries > CROWD_LEAST + volume_join_sizes.crowd * (uint64_t)(done + 1);
}

static int by_cells(struct volume_leaf *l, const uint32_t *other, size_t n, const int64_t box[4])
{
	bool crowd;
	int r = grid_fill(l, box, &crowd);

	for (size_t i = 0; i < n && !r; i++) {
		if (crowd || crowded(l, i))
			return by_slabs(l, other + i, n - i, box);
		l->now = other[i];
		r = volume_cells(&l->grid, &l->b[l->now], try_cells, l);
		if (!r && !(i & 63) && l->interrupted && l->interrupted(l->ctx))
			r = err_set(l->err, ERR_CANCELLED, "interrupted");
	}
	return r;
}

int volume_leaf_join(struct volume_leaf *l, const struct volume_triangle *a, size_t na, const struct volume_triangle *b,
		     size_t nb, const struct volume_rect *rect, const struct volume_call *call, struct err *err)
{
	int64_t box[4];
	size_t n = 0, rest = 0;
	uint32_t *other;
	int r = 0;

	l->a = a;
	l->b = b;
	l->na = na;
	l->rect = rect;
	l->call = call;
	l->err = err;
	l->tries = 0;
	if (!na || !nb || !grid_box(l, nb, box))
		return 0;
	other = malloc(nb * sizeof(*other));
	if (!other)
		return err_set(err, ERR_NOMEM, "no memory for pairs of triangles");
	memset(l->gone, 0, sizeof(l->gone));
	memset(l->mark, 0, sizeof(l->mark));
	table_fill(l);
	for (size_t i = 0; i < nb && !r; i++) {
		size_t same = table_find(l, &b[i]);

		if (same == VOLUME_LEAF) {
			other[rest++] = (uint32_t)i;
			continue;
		}
		l->gone[same] = true;
		n++;
		r = try(l, &a[same], &b[i]);
	}
	if (!r && rest && n < na)
		r = by_cells(l, other, rest, box);
	free(other);
	return r;
}
