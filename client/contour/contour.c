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

struct contour *contour_free(struct contour *c)
{
	if (c) {
		contour_chains_free(c->chains);
		contour_array_free(c->link);
		sort_free(c->lines);
		outfile_free(c->annex);
		free(c->level);
	}
	free(c);
	return NULL;
}

int contour_head(struct contour *c, const struct acut_mesh_head *head, const struct contour_options *opt, struct err *err)
{
	int r = contour_levels_init(&c->levels, head, opt, err);

	c->opt = *opt;
	if (!r)
		r = contour_window_init(&c->window, head, err);
	if (!r)
		r = contour_chains_new(opt->segments ? opt->segments : CONTOUR_SEGMENTS, &c->chains, err);
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
	int low = level[1] < level[0] ? 1 : 0, high = level[1] > level[0] ? 1 : 0;

	low = level[2] < level[low] ? 2 : low;
	high = level[2] > level[high] ? 2 : high;
	for (int64_t l = level[low] + 1; l <= level[high]; l++) {
		unsigned up = (level[0] >= l) + (level[1] >= l) + (level[2] >= l);
		int one = up == 1 ? high : low; /* the corner that differs from the two others */
		const int32_t *at = v[one], *next = v[(one + 1) % 3], *last = v[(one + 2) % 3];
		struct contour_crossing from = contour_cross(&c->levels, at, up == 1 ? next : last, l);
		struct contour_crossing to = contour_cross(&c->levels, at, up == 1 ? last : next, l);
		int r = contour_chains_full(c->chains) ? contour_chains_flush(c, err) : 0;

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

int contour_block(struct contour *c, const struct acut_mesh_block *b, const int32_t (*position)[3], struct err *err)
{
	size_t n = (size_t)b->nforeign + b->nnew;

	if (!b->ntriangle)
		return 0;
	if (n > c->room) {
		void *grown = realloc(c->level, n * sizeof(*c->level));

		if (!grown)
			return err_set(err, ERR_NOMEM, "no memory for a block of %zu vertices", n);
		c->level = grown;
		c->room = n;
	}
	for (size_t i = 0; i < n; i++)
		c->level[i] = contour_levels_of(&c->levels, position[i][2]);
	for (uint32_t i = 0; i < b->ntriangle; i++) {
		const uint32_t *t = b->triangle[i];
		const int64_t level[3] = {c->level[t[0]], c->level[t[1]], c->level[t[2]]};
		const int32_t *const v[3] = {position[t[0]], position[t[1]], position[t[2]]};
		int in, r;

		if (level[0] == level[1] && level[0] == level[2])
			continue;
		in = inside(&c->window, v);
		r = in < 0 ? 0 : triangle(c, v, level, in > 0, err);
		if (r)
			return r;
	}
	return contour_chains_flush(c, err);
}
