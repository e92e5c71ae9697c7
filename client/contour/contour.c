/* Triangles to segments; see contour.h. */
#include <stdlib.h>
#include <string.h>

#include "contour_priv.h"
#include "cursor.h"
#include "err.h"
#include "outfile.h"
#include "sort.h"

int contour_new(struct outfile *out, struct contour **ret, struct err *err)
{
	struct contour *c = calloc(1, sizeof(*c));

	if (!c)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	c->out = out;
	*ret = c;
	return 0;
}

int contour_head(struct contour *c, const struct acut_mesh_head *head, const struct contour_options *opt, struct err *err)
{
	int r = contour_levels_init(&c->levels, head, opt, err);

	c->opt = *opt;
	contour_tiles_init(&c->tiles, head, opt);
	if (!r)
		r = contour_cut_init(c, head, err);
	return r ? r : outfile_annex(c->out, &c->annex, err);
}

int contour_resume(struct contour *c, const struct acut_mesh_head *head, const struct contour_options *opt, struct cursor *from,
		   struct err *err)
{
	c->pieces = cursor_u64(from);
	return contour_head(c, head, opt, err);
}

void contour_save(const struct contour *c, struct packer *to)
{
	packer_u64(to, c->pieces);
}

/* The segments of one triangle: of each level that is above its lowest corner and not above its highest. */
static int triangle(struct contour *c, const int32_t *const v[3], const int64_t level[3], bool whole, struct err *err)
{
	int64_t tile[2], key;
	int low = level[1] < level[0] ? 1 : 0, high = level[1] > level[0] ? 1 : 0;

	low = level[2] < level[low] ? 2 : low;
	high = level[2] > level[high] ? 2 : high;
	if (c->tiles.p)
		whole &= contour_tiles_same(&c->tiles, v, tile);
	for (int64_t l = level[low] + 1; l <= level[high]; l++) {
		unsigned up = (level[0] >= l) + (level[1] >= l) + (level[2] >= l);
		int one = up == 1 ? high : low; /* the corner that differs from the two others */
		const int32_t *at = v[one], *next = v[(one + 1) % 3], *last = v[(one + 2) % 3];
		struct contour_crossing from = contour_cross(&c->levels, at, up == 1 ? next : last, l);
		struct contour_crossing to = contour_cross(&c->levels, at, up == 1 ? last : next, l);
		const struct contour_end end[2] = {{.edge = &from}, {.edge = &to}};
		int r = 0;

		key = l;
		if (whole && c->tiles.p)
			r = contour_tiles_key(&c->tiles, tile, l, &key, err);
		if (!r)
			r = whole ? contour_chains_add(c, end, key, err) : contour_cut(c, v, &from, &to, l, err);
		if (r)
			return r;
	}
	return 0;
}

/* ---- blocks ---- */

/* Cells of a grid over the block, in the order of a Z. */
struct cells {
	int32_t low[2];
	int shift;
};

static struct cells cells_of(const int32_t (*position)[3], size_t n)
{
	struct cells g = {.low = {position[0][0], position[0][1]}};
	int32_t high[2] = {position[0][0], position[0][1]};
	uint32_t most = 0;

	for (size_t i = 1; i < n; i++) {
		for (int k = 0; k < 2; k++) {
			g.low[k] = position[i][k] < g.low[k] ? position[i][k] : g.low[k];
			high[k] = position[i][k] > high[k] ? position[i][k] : high[k];
		}
	}
	for (int k = 0; k < 2; k++)
		most |= (uint32_t)high[k] - (uint32_t)g.low[k];
	while (most >> g.shift >= CONTOUR_CELLS)
		g.shift++;
	return g;
}

static uint32_t spread(uint32_t v) /* eight bits */
{
	v = (v | v << 4) & 0x0f0f;
	v = (v | v << 2) & 0x3333;
	return (v | v << 1) & 0x5555;
}

static uint32_t cell_of(const struct cells *g, const int32_t at[3])
{
	return spread(((uint32_t)at[0] - (uint32_t)g->low[0]) >> g->shift) |
	       spread(((uint32_t)at[1] - (uint32_t)g->low[1]) >> g->shift) << 1;
}

/* Whether a triangle has lines, and the levels of its corners. */
static bool levels_of(const struct contour *c, const uint32_t t[3], const int32_t (*position)[3], int64_t level[3])
{
	for (int i = 0; i < 3; i++)
		level[i] = contour_levels_of(&c->levels, position[t[i]][2]);
	return level[0] != level[1] || level[0] != level[2];
}

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory for the contours of a block");
}

enum { CELLS = CONTOUR_CELLS * CONTOUR_CELLS, BATCH = 1 << 17 };

/* The outputs of a stream have a block one after the other, so only one of them has this memory. But for a bit a triangle its
 * size is fixed. */
struct contour_work {
	uint8_t *crossed;     /* bits: triangles of the block that have lines */
	uint32_t cell[CELLS]; /* how many of them are in each; of a batch: where the next one of the cell goes */
	uint32_t *order;      /* a batch of them, cell by cell */
};

static void release(struct contour *c)
{
	c->chains = contour_chains_free(c->chains);
	if (c->work) {
		free(c->work->crossed);
		free(c->work->order);
	}
	free(c->work);
	c->work = NULL;
}

static int check_levels(struct contour *c, const int64_t level[3], struct err *err)
{
	int64_t *seen = c->seen_levels;

	for (int i = 0; i < 3; i++) {
		seen[0] = !c->any_levels || level[i] < seen[0] ? level[i] : seen[0];
		seen[1] = !c->any_levels || level[i] > seen[1] ? level[i] : seen[1];
		c->any_levels = true;
	}
	if (seen[1] - seen[0] <= CONTOUR_LEVELS)
		return 0;
	err_set(err, ERR_USAGE, "with this --interval there are more than %d heights of contours", CONTOUR_LEVELS);
	return err_add_hint(err, "give a larger --interval");
}

/* The triangles with lines, and how many of them each cell has. */
static int count_cells(struct contour *c, const struct acut_mesh_block *b, const int32_t (*position)[3], const struct cells *g,
		       struct err *err)
{
	struct contour_work *w = c->work = calloc(1, sizeof(*w));

	if (w) {
		w->crossed = calloc((size_t)b->ntriangle / 8 + 1, 1);
		w->order = malloc((b->ntriangle < BATCH ? b->ntriangle : BATCH) * sizeof(*w->order));
	}
	if (!w || !w->crossed || !w->order)
		return no_memory(err);
	for (uint32_t i = 0; i < b->ntriangle; i++) {
		int64_t level[3];
		bool lines = levels_of(c, b->triangle[i], position, level);
		int r = check_levels(c, level, err);

		if (r)
			return r;
		if (!lines)
			continue;
		w->crossed[i >> 3] |= (uint8_t)(1u << (i & 7));
		w->cell[cell_of(g, position[b->triangle[i][0]])]++;
	}
	return 0;
}

static int add_triangle(struct contour *c, const uint32_t t[3], const int32_t (*position)[3], struct err *err)
{
	const int32_t *const v[3] = {position[t[0]], position[t[1]], position[t[2]]};
	int64_t level[3];
	enum contour_inside in = contour_cut_inside(c, v);

	levels_of(c, t, position, level);
	return in == CONTOUR_OUTSIDE ? 0 : triangle(c, v, level, in == CONTOUR_INSIDE, err);
}

/* The triangles with lines of the cells from `from` up to `to`, n of them, cell by cell; of a cell that is more than a batch, as
 * they come. */
static int add_batch(struct contour *c, const struct acut_mesh_block *b, const int32_t (*position)[3], const struct cells *g,
		     const uint32_t range[2], uint32_t n, struct err *err)
{
	struct contour_work *w = c->work;
	uint32_t sum = 0;
	int r = 0;

	for (uint32_t i = range[0]; i < range[1]; i++) {
		uint32_t of = w->cell[i];

		w->cell[i] = sum;
		sum += of;
	}
	for (uint32_t i = 0; i < b->ntriangle && !r; i++) {
		uint32_t cell = w->crossed[i >> 3] >> (i & 7) & 1 ? cell_of(g, position[b->triangle[i][0]]) : CELLS;

		if (cell < range[0] || cell >= range[1])
			continue;
		if (n > BATCH)
			r = add_triangle(c, b->triangle[i], position, err);
		else
			w->order[w->cell[cell]++] = i;
	}
	for (uint32_t i = 0; i < n && n <= BATCH && !r; i++)
		r = add_triangle(c, b->triangle[w->order[i]], position, err);
	return r;
}

/* Neighbours near each other: the table of crossings then has whole lines when it is full. The stream has no such order. */
static int add_cells(struct contour *c, const struct acut_mesh_block *b, const int32_t (*position)[3], const struct cells *g,
		     struct err *err)
{
	const uint32_t *cell = c->work->cell;
	int r = 0;

	for (uint32_t from = 0, to; from < CELLS && !r; from = to) {
		uint32_t n = cell[from];

		for (to = from + 1; to < CELLS && n + cell[to] <= BATCH; to++)
			n += cell[to];
		if (n && !c->chains)
			r = contour_chains_new(c->opt.segments ? c->opt.segments : CONTOUR_SEGMENTS, &c->chains, err);
		if (n && !r)
			r = add_batch(c, b, position, g, (const uint32_t[2]){from, to}, n, err);
	}
	return r || !c->chains ? r : contour_chains_flush(c, err);
}

int contour_block(struct contour *c, const struct acut_mesh_block *b, const int32_t (*position)[3], struct err *err)
{
	struct cells g;
	int r;

	if (!b->ntriangle)
		return 0;
	g = cells_of(position, (size_t)b->nforeign + b->nnew);
	r = count_cells(c, b, position, &g, err);
	if (!r)
		r = add_cells(c, b, position, &g, err);
	release(c);
	return r;
}

struct contour *contour_free(struct contour *c)
{
	if (c) {
		release(c);
		contour_cut_done(c);
		contour_tiles_done(&c->tiles);
		contour_array_free(c->link);
		contour_array_free(c->seen);
		sort_free(c->lines);
		contour_simple_free(c->simple);
		outfile_free(c->annex);
	}
	free(c);
	return NULL;
}
