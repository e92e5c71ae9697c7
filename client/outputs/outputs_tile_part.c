/*
 * Tiles that several processes make: which tiles and triangles are whose, and what the process that joins them knows of each.
 *
 * Tiles are divided by their codes (outputs_tile_code), so that those of a part lie close to each other. Whose a tile is follows
 * from its place alone.
 */
#include <stdlib.h>

#include "cursor.h"
#include "digest_pack.h"
#include "err.h"
#include "morton.h"
#include "outputs_tile.h"

uint64_t outputs_tile_code(uint32_t column, uint32_t row)
{
	return morton_code(column, row);
}

/* Whether a square of 2^b tiles, whose codes are base to base + 4^b - 1, has one of both. The halves are tried in turn. */
static bool square_meets(uint64_t base, unsigned b, uint32_t x, uint32_t y, const uint32_t low[2], const uint32_t high[2],
			 const uint64_t share[2])
{
	const uint64_t last = b == 32 ? UINT64_MAX : base + (((uint64_t)1 << 2 * b) - 1);
	const uint32_t side = b == 32 ? UINT32_MAX : (uint32_t)(((uint64_t)1 << b) - 1);
	bool found = false;

	if (last < share[0] || base > share[1] || x > high[0] || x + side < low[0] || y > high[1] || y + side < low[1])
		return false;
	if (!b || (base >= share[0] && last <= share[1]) ||
	    (x >= low[0] && x + side <= high[0] && y >= low[1] && y + side <= high[1]))
		return true;
	b--;
	for (unsigned i = 0; i < 4 && !found; i++)
		found = square_meets(base + ((uint64_t)i << 2 * b), b, x + ((i & 1) << b), y + ((i >> 1) << b), low, high, share);
	return found;
}

bool outputs_grid_meets(const uint32_t low[2], const uint32_t high[2], const uint64_t share[2])
{
	return square_meets(0, 32, 0, 0, low, high, share);
}

int outputs_tiles_share(struct outputs_tiles *t, const struct acut_mesh_block *b, const int32_t (*position)[3],
			struct acut_mesh_block *ret, struct err *err)
{
	uint64_t code, at[2];

	if (outputs_passed_begin(&t->passed, b, err))
		return -(int)err->code;
	for (uint32_t i = 0; i < b->ntriangle; i++) {
		const uint32_t *v = b->triangle[i];
		const int32_t *corner[3] = {position[v[0]], position[v[1]], position[v[2]]};

		if (!outputs_tiles_at(t, corner, at))
			return err_set(err, ERR_PROTO, "a triangle is outside of the box that the stream announced");
		code = morton_code((uint32_t)at[0], (uint32_t)at[1]);
		if (code >= t->run.share[0] && code <= t->run.share[1])
			outputs_passed_add(&t->passed, b, i);
	}
	outputs_passed_end(&t->passed, b, ret);
	return 0;
}

enum { SAVED_TILE = 8 * 7 + 8 * 4 + 4 * 6 + 16 * 2, SAVED_HEAD = 8 * 4 };

size_t outputs_tiles_saved(const struct outputs_tiles *t)
{
	return SAVED_HEAD + t->ntile * SAVED_TILE;
}

void outputs_tiles_save(const struct outputs_tiles *t, struct packer *p)
{
	packer_u64(p, t->ntile);
	packer_u64(p, t->beside_bytes);
	for (size_t i = 0; i < t->ntile; i++) {
		const struct outputs_tile *tile = &t->tile[i];
		const uint64_t number[7] = {tile->number,    tile->triangles, tile->vertices, tile->bytes,
					    tile->pixels[0], tile->pixels[1], tile->lines};

		for (unsigned k = 0; k < 7; k++)
			packer_u64(p, number[k]);
		for (unsigned k = 0; k < 4; k++)
			packer_f64(p, tile->edge[k]);
		for (unsigned k = 0; k < 6; k++)
			packer_i32(p, tile->box[k]);
		digest_pack(p, tile->digest);
		digest_pack(p, tile->vertex_digest);
	}
}

static void load_tile(struct outputs_tile *tile, struct cursor *c)
{
	uint64_t *const number[7] = {&tile->number,    &tile->triangles, &tile->vertices, &tile->bytes,
				     &tile->pixels[0], &tile->pixels[1], &tile->lines};

	for (unsigned k = 0; k < 7; k++)
		*number[k] = cursor_u64(c);
	for (unsigned k = 0; k < 4; k++)
		tile->edge[k] = cursor_f64(c);
	for (unsigned k = 0; k < 6; k++)
		tile->box[k] = cursor_i32(c);
	tile->digest = digest_unpack(c);
	tile->vertex_digest = digest_unpack(c);
}

int outputs_tiles_load(struct outputs_tiles *t, struct cursor *c, struct err *err)
{
	uint64_t n = cursor_u64(c);
	struct outputs_tile *more;

	t->beside_bytes += cursor_u64(c);
	if (c->bad || n > cursor_left(c) / SAVED_TILE)
		return err_set(err, ERR_CORRUPT, "the list of tiles is damaged");
	if (n > outputs_tiles_most(t) - t->ntile)
		return outputs_tiles_too_many(t, err);
	more = realloc(t->tile, (t->ntile + n + 1) * sizeof(*more));
	if (!more)
		return err_set(err, ERR_NOMEM, "no memory for %zu tiles", t->ntile + (size_t)n);
	t->tile = more;
	for (; n; n--)
		load_tile(&t->tile[t->ntile++], c);
	return 0;
}
