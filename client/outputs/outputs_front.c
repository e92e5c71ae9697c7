/*
 * Positions of the vertices that later blocks may still use.
 *
 * Blocks name earlier vertices by number. Who needs their positions (pictures, lengths of edges, canonical
 * order) keeps the open ones here, a hash table with linear probing; a vertex leaves it in the block that
 * marks it final, so that the table is as large as the front of the mesh, not as the mesh.
 */
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "outputs_priv.h"

static size_t slot_of(const struct outputs_front *t, uint64_t number)
{
	return (size_t)(number * 0x9e3779b97f4a7c15u >> 20) & (t->size - 1);
}

static struct outputs_front_slot *open_find(const struct outputs_front *t, uint64_t number)
{
	if (!t->size)
		return NULL;
	for (size_t i = slot_of(t, number);; i = (i + 1) & (t->size - 1)) {
		if (!t->slot[i].used)
			return NULL;
		if (t->slot[i].number == number)
			return &t->slot[i];
	}
}

/* The slot must be free and the table not full. */
static void open_put(struct outputs_front *t, uint64_t number, const int32_t at[3])
{
	size_t i = slot_of(t, number);

	while (t->slot[i].used)
		i = (i + 1) & (t->size - 1);
	t->slot[i] = (struct outputs_front_slot){number, {at[0], at[1], at[2]}, 1};
	t->used++;
}

static int open_grow(struct outputs_front *t, struct err *err)
{
	struct outputs_front old = *t;

	t->size = old.size ? 2 * old.size : 1024;
	t->slot = calloc(t->size, sizeof(*t->slot));
	if (!t->slot) {
		*t = old;
		return err_set(err, ERR_NOMEM, "no memory for %zu open vertices", old.used);
	}
	t->used = 0;
	for (size_t i = 0; i < old.size; i++)
		if (old.slot[i].used)
			open_put(t, old.slot[i].number, old.slot[i].at);
	free(old.slot);
	return 0;
}

/* Takes the slot out and closes the gap, so that no probe chain is cut. */
static void open_drop(struct outputs_front *t, struct outputs_front_slot *slot)
{
	size_t mask = t->size - 1, hole = (size_t)(slot - t->slot);

	for (size_t i = (hole + 1) & mask; t->slot[i].used; i = (i + 1) & mask) {
		size_t home = slot_of(t, t->slot[i].number);
		if (((i - home) & mask) >= ((i - hole) & mask)) {
			t->slot[hole] = t->slot[i];
			hole = i;
		}
	}
	t->slot[hole].used = 0;
	t->used--;
}

static bool is_final(const struct acut_mesh_block *b, uint32_t local)
{
	return b->final && (b->final[local >> 3] >> (local & 7) & 1);
}

/* Where the positions of the block go; those of new vertices are there already if the block has room for the others. */
static int room_of(struct outputs_front *t, const struct acut_mesh_block *b, int32_t (**ret)[3], struct err *err)
{
	size_t n = (size_t)b->nforeign + b->nnew;

	*ret = b->local;
	if (b->local)
		return 0;
	if (n > t->room) {
		void *grown = realloc(t->position, n * sizeof(*t->position));
		if (!grown)
			return err_set(err, ERR_NOMEM, "no memory for a block of %zu vertices", n);
		t->position = grown;
		t->room = n;
	}
	if (b->nnew)
		memcpy(t->position + b->nforeign, b->vertex, b->nnew * sizeof(*t->position));
	*ret = t->position;
	return 0;
}

int outputs_front_block(struct outputs_front *t, const struct acut_mesh_block *b, const int32_t (**ret)[3], struct err *err)
{
	int32_t(*position)[3] = NULL;

	if (room_of(t, b, &position, err))
		return -err->code;
	for (uint32_t i = 0; i < b->nforeign; i++) {
		struct outputs_front_slot *s = open_find(t, b->foreign[i]);
		if (!s)
			return err_set(err, ERR_PROTO, "the stream uses vertex %llu after it was finished",
				       (unsigned long long)b->foreign[i]);
		memcpy(position[i], s->at, sizeof(s->at));
		if (is_final(b, i))
			open_drop(t, s);
	}
	for (uint32_t i = 0; i < b->nnew; i++) {
		if (is_final(b, b->nforeign + i))
			continue;
		if (2 * (t->used + 1) > t->size && open_grow(t, err))
			return -err->code;
		open_put(t, b->first + i, b->vertex[i]);
	}
	*ret = (const int32_t(*)[3])position;
	return 0;
}

void outputs_front_done(struct outputs_front *t)
{
	free(t->slot);
	free(t->position);
	memset(t, 0, sizeof(*t));
}

void outputs_front_save(const struct outputs_front *t, struct packer *p)
{
	packer_u64(p, t->used);
	for (size_t i = 0; i < t->size; i++) {
		const struct outputs_front_slot *s = &t->slot[i];

		if (!s->used)
			continue;
		packer_u64(p, s->number);
		for (int k = 0; k < 3; k++)
			packer_i32(p, s->at[k]);
	}
}

int outputs_front_load(struct outputs_front *t, struct cursor *c, struct err *err)
{
	uint64_t n = cursor_u64(c);

	if (n > cursor_left(c) / OUTPUTS_FRONT_SAVED)
		c->bad = true;
	while (n-- && !c->bad) {
		uint64_t number = cursor_u64(c);
		int32_t at[3];

		for (int k = 0; k < 3; k++)
			at[k] = cursor_i32(c);
		if (2 * (t->used + 1) > t->size && open_grow(t, err))
			return -err->code;
		open_put(t, number, at);
	}
	return 0;
}
