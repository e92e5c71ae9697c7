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
	if (!r)
		r = contour_window_init(&c->window, head, err);
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

static int make_room(struct contour *c, struct err *err)
{
	if (!contour_chains_full(c->chains))
		return 0;
	return contour_interrupted(c) ? err_set(err, ERR_CANCELLED, "interrupted") : contour_chains_flush(c, err);
}

/* The segments of one triangle: of each level that is above its lowest corner and not above its highest. */
static int triangle(struct contour *c, const int32_t *const v[3], const int64_t level[3], bool whole, struct err *err)
{
	int low = level[1] < level[0] ? 1 : 0, high = level[1] > level[0] ? 1 : 0;

	low = level[2] < level[low] ? 2 : low;
	high = level[2] > level[high] ? 2 : high;
	for (int64_t l = level[low] + 1; l <= level[high]; l++) {
		unsigned up = (level[0] >= l) + (level[1] >= l) + (level[2] >= l);
		int one = up == 1 ? high : low; /* the corner that differs from the two others */
		const int32_t *at = v[one], *next = v[(one + 1) % 3], *last = v[(one + 2) % 3];
		struct contour_crossing from = contour_cross(&c->levels, at, up == 1 ? next : last, l);
		struct contour_crossing to = contour_cross(&c->levels, at, up == 1 ? last : next, l);
		int r = make_room(c, err);

		if (!r)
			r = contour_chains_add(c, &from, &to, l, whole, err);
		if (r)
			return r;
	}
	return 0;
}

/* Whether a triangle is outside of the window, reaches out of it, or is inside: -1, 0, 1. */
static int inside(const struct contour_window *w, const int32_t *const v[3])
{
	int32_t low[2], high[2];

	if (!w->given)
		return 1;
	for (int i = 0; i < 2; i++) {
		low[i] = v[0][i] < v[1][i] ? v[0][i] : v[1][i];
		low[i] = v[2][i] < low[i] ? v[2][i] : low[i];
		high[i] = v[0][i] > v[1][i] ? v[0][i] : v[1][i];
		high[i] = v[2][i] > high[i] ? v[2][i] : high[i];
	}
	return contour_window_box(w, low, high);
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

/* The outputs of a stream have a block one after the other, so only one of them has this memory. */
static void release(struct contour *c)
{
	c->chains = contour_chains_free(c->chains);
	free(c->crossed);
	free(c->order);
	c->crossed = NULL;
	c->order = NULL;
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

/* Triangles with lines, neighbours near each other: the table of crossings then has whole lines when it is full. The stream has
 * no such order. *ret: how many. */
static int put_in_order(struct contour *c, const struct acut_mesh_block *b, const int32_t (*position)[3], uint32_t *ret,
			struct err *err)
{
	const struct cells g = cells_of(position, (size_t)b->nforeign + b->nnew);
	uint32_t sum = 0;

	c->crossed = calloc((size_t)b->ntriangle / 8 + 1, 1);
	if (!c->crossed)
		return no_memory(err);
	memset(c->cell, 0, sizeof(c->cell));
	for (uint32_t i = 0; i < b->ntriangle; i++) {
		int64_t level[3];
		bool lines = levels_of(c, b->triangle[i], position, level);
		int r = check_levels(c, level, err);

		if (r)
			return r;
		if (!lines)
			continue;
		c->crossed[i >> 3] |= (uint8_t)(1u << (i & 7));
		c->cell[cell_of(&g, position[b->triangle[i][0]])]++;
	}
	for (uint32_t i = 0; i < CONTOUR_CELLS * CONTOUR_CELLS; i++) {
		uint32_t n = c->cell[i];

		c->cell[i] = sum;
		sum += n;
	}
	c->order = malloc((sum + 1) * sizeof(*c->order));
	if (!c->order)
		return no_memory(err);
	for (uint32_t i = 0; i < b->ntriangle; i++)
		if (c->crossed[i >> 3] >> (i & 7) & 1)
			c->order[c->cell[cell_of(&g, position[b->triangle[i][0]])]++] = i;
	*ret = sum;
	return 0;
}

int contour_block(struct contour *c, const struct acut_mesh_block *b, const int32_t (*position)[3], struct err *err)
{
	uint32_t found = 0;
	int r = b->ntriangle ? put_in_order(c, b, position, &found, err) : 0;

	if (!r && found)
		r = contour_chains_new(c->opt.segments ? c->opt.segments : CONTOUR_SEGMENTS, &c->chains, err);
	for (uint32_t i = 0; i < found && !r; i++) {
		const uint32_t *t = b->triangle[c->order[i]];
		const int32_t *const v[3] = {position[t[0]], position[t[1]], position[t[2]]};
		int64_t level[3];
		int in = inside(&c->window, v);

		levels_of(c, t, position, level);
		r = in < 0 ? 0 : triangle(c, v, level, in > 0, err);
	}
	if (!r && found)
		r = contour_chains_flush(c, err);
	release(c);
	return r;
}

struct contour *contour_free(struct contour *c)
{
	if (c) {
		release(c);
		contour_array_free(c->link);
		contour_array_free(c->seen);
		sort_free(c->lines);
		contour_simple_free(c->simple);
		outfile_free(c->annex);
	}
	free(c);
	return NULL;
}
