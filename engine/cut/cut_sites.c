/*
 * Sites as a source of cells: intervals of the Morton order with tight boxes, and intervals of these as subtrees, so
 * that the search for halos prunes them as it prunes a grid. Never changed once made: any thread may read it.
 */
#include "cut_sites.h"

#include <stdlib.h>
#include <string.h>

#include "ledger.h"

enum { CELL = 64, TREE = 32 };

struct cut_sites {
	size_t bytes;
	struct ledger *ledger;
	uint32_t n, ncell, ntree;
	int32_t (*cell)[4], (*tree)[4]; /* boxes */
	struct point *pt;
};

static void join(int32_t box[4], const int32_t other[4], bool first)
{
	if (first)
		memcpy(box, other, sizeof(int32_t[4]));
	else
		point_box_join(box, other);
}

struct cut_sites *cut_sites_new(const struct point *pts, uint32_t n, struct ledger *ledger)
{
	uint32_t ncell = n / CELL + 1, ntree = ncell / TREE + 1;
	size_t boxes = (ncell + (size_t)ntree) * sizeof(int32_t[4]), bytes = sizeof(struct cut_sites) + boxes + n * sizeof(*pts);
	struct cut_sites *s;

	if (ledger && !ledger_take(ledger, LEDGER_PLAN, bytes))
		return NULL;
	s = malloc(bytes);
	if (!s) {
		if (ledger)
			ledger_give(ledger, LEDGER_PLAN, bytes);
		return NULL;
	}
	*s = (struct cut_sites){.bytes = bytes, .ledger = ledger, .n = n, .ncell = (n + CELL - 1) / CELL};
	s->ntree = (s->ncell + TREE - 1) / TREE;
	s->pt = (struct point *)(s + 1);
	s->cell = (int32_t(*)[4])(s->pt + n);
	s->tree = s->cell + ncell;
	memcpy(s->pt, pts, n * sizeof(*pts));
	for (uint32_t i = 0; i < n; i++)
		join(s->cell[i / CELL], (const int32_t[4]){pts[i].x, pts[i].y, pts[i].x, pts[i].y}, i % CELL == 0);
	for (uint32_t i = 0; i < s->ncell; i++)
		join(s->tree[i / TREE], s->cell[i], i % TREE == 0);
	return s;
}

struct cut_sites *cut_sites_free(struct cut_sites *s)
{
	if (s && s->ledger)
		ledger_give(s->ledger, LEDGER_PLAN, s->bytes);
	free(s);
	return NULL;
}

size_t cut_sites_bytes(const struct cut_sites *s)
{
	return s ? s->bytes : 0;
}

/* Sites [from, to) as the index would describe them. */
static struct grid_cell cell_of(const struct cut_sites *s, uint32_t from, uint32_t to, const int32_t box[4])
{
	struct grid_cell cell = {.count = to - from, .distinct = to - from, .place = from, .blocks = 1};

	cell.lo = point_morton(s->pt[from].x, s->pt[from].y);
	cell.hi = point_morton(s->pt[to - 1].x, s->pt[to - 1].y);
	memcpy(cell.box, box, sizeof(cell.box));
	return cell;
}

static uint32_t least(uint32_t a, uint32_t b)
{
	return a < b ? a : b;
}

/* Sites are only walked as a whole. */
static int sites_walk(void *ctx, uint64_t lo, uint64_t hi, const struct grid_visitor *v, struct err *err)
{
	const struct cut_sites *s = ctx;

	(void)lo, (void)hi, (void)err;
	for (uint32_t t = 0; t < s->ntree; t++) {
		uint32_t end = least((t + 1) * TREE, s->ncell);
		struct grid_cell cell = cell_of(s, t * TREE * CELL, least(end * CELL, s->n), s->tree[t]);

		if (v->enter && !v->enter(v->ctx, &cell))
			continue;
		for (uint32_t i = t * TREE; i < end; i++) {
			int rc;

			cell = cell_of(s, i * CELL, least((i + 1) * CELL, s->n), s->cell[i]);
			rc = v->cell(v->ctx, &cell);
			if (rc)
				return rc;
		}
	}
	return 0;
}

static int sites_read(void *ctx, const struct grid_cell *cell, grid_points_fn fn, void *sink, struct err *err)
{
	const struct cut_sites *s = ctx;

	return fn(sink, s->pt + cell->place, cell->count, err);
}

static bool sites_box(void *ctx, int32_t ret_box[4])
{
	const struct cut_sites *s = ctx;

	for (uint32_t t = 0; t < s->ntree; t++)
		join(ret_box, s->tree[t], t == 0);
	return s->n > 0;
}

void cut_sites_source(const struct cut_sites *s, struct cut_source *ret)
{
	*ret = (struct cut_source){.ctx = (void *)s, .walk = sites_walk, .read = sites_read, .box = sites_box};
}
