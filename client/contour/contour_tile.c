/*
 * Tiles: lines are cut at the borders of squares, low <= c < high, and each square has lines of its own.
 *
 * Tiles are numbered as lines come. A level of a tile is one number, tile and level, which takes the place of the level in pieces
 * and sorts; so the lines of a tile come together, by level. In which tile a crossing is, is exact.
 */
#include <math.h>
#include <stdlib.h>

#include "contour_priv.h"
#include "err.h"
#include "wide.h"

typedef contour_i128 i128;

enum { LEVEL_BITS = 22, LEVEL_MIDDLE = 1 << 20, SLOTS_LEAST = 64 };

_Static_assert((int)CONTOUR_LEVELS < (int)LEVEL_MIDDLE, "levels of a tile");

void contour_tiles_init(struct contour_tiles *t, const struct acut_mesh_head *head, const struct contour_options *opt)
{
	*t = (struct contour_tiles){.p = opt->tile_p, .q = opt->tile_q, .k = {head->k[0], head->k[1]}, .most = opt->tiles};
}

void contour_tiles_done(struct contour_tiles *t)
{
	free(t->tile);
	free(t->slot);
	t->tile = NULL;
	t->slot = NULL;
}

/* ---- where ---- */

/* The absolute number of a place times its divisor. */
static i128 number_of(const struct contour_tiles *t, int axis, const struct contour_crossing *c)
{
	int32_t from = axis ? contour_key_y(c->end[0]) : contour_key_x(c->end[0]);
	int32_t to = axis ? contour_key_y(c->end[1]) : contour_key_x(c->end[1]);

	return ((i128)from + t->k[axis]) * c->d + (i128)((int64_t)to - from) * c->n;
}

static int beside(const struct contour_tiles *t, i128 number, int64_t d, int64_t line)
{
	return wide_sign(wide_sum(wide_product(number, t->q), wide_negative(wide_product(line, (i128)t->p * d))));
}

int contour_tiles_beside(const struct contour_tiles *t, int axis, const struct contour_crossing *c, int64_t line)
{
	return beside(t, number_of(t, axis, c), c->d, line);
}

int64_t contour_tiles_of(const struct contour_tiles *t, int axis, const struct contour_crossing *c)
{
	i128 number = number_of(t, axis, c);
	int64_t i = (int64_t)floor((double)number / (double)c->d * (double)t->q / (double)t->p);

	while (beside(t, number, c->d, i) < 0)
		i--;
	while (beside(t, number, c->d, i + 1) >= 0)
		i++;
	return i;
}

static int64_t tile_of(const struct contour_tiles *t, int axis, int32_t at)
{
	i128 n = ((i128)at + t->k[axis]) * (i128)t->q, i = n / (i128)t->p;

	return (int64_t)(i * (i128)t->p > n ? i - 1 : i);
}

bool contour_tiles_same(const struct contour_tiles *t, const int32_t *const v[3], int64_t ret[2])
{
	for (int axis = 0; axis < 2; axis++) {
		ret[axis] = tile_of(t, axis, v[0][axis]);
		for (int i = 1; i < 3; i++)
			if (tile_of(t, axis, v[i][axis]) != ret[axis])
				return false;
	}
	return true;
}

i128 contour_tiles_border(const struct contour_tiles *t, int axis, int64_t line)
{
	return (i128)line * (i128)t->p - (i128)t->k[axis] * (i128)t->q;
}

/* ---- tiles with lines ---- */

static size_t slot_of(const struct contour_tiles *t, const int64_t at[2])
{
	size_t i =
		(size_t)(((uint64_t)at[0] * 0x9e3779b97f4a7c15u ^ (uint64_t)at[1]) * 0xc2b2ae3d27d4eb4fu >> 32) & (t->nslot - 1);

	while (t->slot[i] && (t->tile[t->slot[i] - 1].at[0] != at[0] || t->tile[t->slot[i] - 1].at[1] != at[1]))
		i = (i + 1) & (t->nslot - 1);
	return i;
}

static int grow(struct contour_tiles *t, struct err *err)
{
	size_t room = t->nslot ? t->nslot : SLOTS_LEAST / 2; /* half of the slots to be */
	struct contour_tile *tile = realloc(t->tile, room * sizeof(*tile));
	uint32_t *slot;

	if (tile)
		t->tile = tile;
	slot = tile ? calloc(2 * room, sizeof(*slot)) : NULL;
	if (!slot)
		return err_set(err, ERR_NOMEM, "no memory for %zu tiles", room);
	free(t->slot);
	t->slot = slot;
	t->nslot = 2 * room;
	for (size_t i = 0; i < t->n; i++)
		t->slot[slot_of(t, t->tile[i].at)] = (uint32_t)i + 1;
	return 0;
}

int contour_tiles_key(struct contour_tiles *t, const int64_t at[2], int64_t level, int64_t *ret, struct err *err)
{
	int r = t->n < t->nslot / 2 ? 0 : grow(t, err);
	size_t i = r ? 0 : slot_of(t, at);

	if (r)
		return r;
	if (!t->slot[i]) {
		if (t->n == t->most) {
			err_set(err, ERR_USAGE, "the lines are in more than %u tiles", t->most);
			return err_add_hint(err, "give a larger --tile");
		}
		if (!t->n)
			t->middle = level;
		t->tile[t->n] = (struct contour_tile){.at = {at[0], at[1]}};
		t->slot[i] = (uint32_t)++t->n;
	}
	*ret = (int64_t)(t->slot[i] - 1) << LEVEL_BITS | (level - t->middle + LEVEL_MIDDLE);
	return 0;
}

int64_t contour_tiles_level(const struct contour_tiles *t, int64_t key)
{
	return t->p ? (key & ((1 << LEVEL_BITS) - 1)) - LEVEL_MIDDLE + t->middle : key;
}

struct contour_tile *contour_tiles_tile(const struct contour_tiles *t, int64_t key)
{
	return t->p ? &t->tile[key >> LEVEL_BITS] : NULL;
}
