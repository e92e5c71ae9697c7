/*
 * Checking a mesh as it streams by. Both digests are sums, so blocks need no order. All that is kept of a block are the
 * positions of vertices that later blocks may use: those not yet final. They are in a hash table by number (open addressing,
 * linear probing, deletion by shifting back), which grows with the open vertices and not with the mesh: 36 to 72 bytes each, and
 * half of that more while it grows.
 */
#include "check.h"

#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"

struct slot {
	uint64_t key; /* vertex number + 1; 0: free */
	int32_t at[3];
};

struct check {
	int64_t k[3];
	struct digest digest, vertex_digest;
	struct digest gone; /* of regions that are gone; they come before all blocks, also in a continued stream */

	struct slot *slot;
	unsigned bits; /* log2 of the slots */
	uint64_t open; /* slots in use */

	int32_t (*position)[3]; /* of all vertices of a block that has no room for those of foreign ones */
	size_t room;
};

enum { BITS_FIRST = 10, BATCH = 256 /* triangles: 6 KiB of corners */ };

static uint64_t home(const struct check *c, uint64_t key)
{
	return key * 0x9e3779b97f4a7c15u >> (64 - c->bits);
}

struct check *check_new(const int64_t k[3])
{
	struct check *c = calloc(1, sizeof *c);

	if (!c)
		return NULL;
	c->bits = BITS_FIRST;
	c->slot = calloc((size_t)1 << c->bits, sizeof *c->slot);
	if (!c->slot)
		return check_free(c);
	memcpy(c->k, k, sizeof c->k);
	return c;
}

struct check *check_free(struct check *c)
{
	if (c) {
		free(c->slot);
		free(c->position);
		free(c);
	}
	return NULL;
}

uint64_t check_open(const struct check *c)
{
	return c->open;
}

/* ---- the table ---- */

static struct slot *find(const struct check *c, uint64_t key)
{
	uint64_t mask = ((uint64_t)1 << c->bits) - 1;
	uint64_t i = home(c, key);

	while (c->slot[i].key != 0 && c->slot[i].key != key)
		i = (i + 1) & mask;
	return &c->slot[i];
}

static int grow(struct check *c, struct err *err)
{
	struct slot *old = c->slot;
	uint64_t n = (uint64_t)1 << c->bits;
	struct slot *slot = calloc(2 * n, sizeof *slot);

	if (!slot)
		return err_set(err, ERR_NOMEM, "there is no memory for more than %llu open vertices",
			       (unsigned long long)c->open);
	c->slot = slot;
	c->bits++;
	for (uint64_t i = 0; i < n; i++)
		if (old[i].key != 0)
			*find(c, old[i].key) = old[i];
	free(old);
	return 0;
}

static int insert(struct check *c, uint64_t number, const int32_t position[3], struct err *err)
{
	if ((c->open + 1) * 3 > (uint64_t)2 << c->bits) {
		int r = grow(c, err);

		if (r < 0)
			return r;
	}
	*find(c, number + 1) = (struct slot){number + 1, {position[0], position[1], position[2]}};
	c->open++;
	return 0;
}

/* Frees the slot and moves up those after it that would no longer be found. */
static void erase(struct check *c, struct slot *at)
{
	uint64_t mask = ((uint64_t)1 << c->bits) - 1;
	uint64_t hole = (uint64_t)(at - c->slot);

	for (uint64_t i = (hole + 1) & mask; c->slot[i].key != 0; i = (i + 1) & mask) {
		uint64_t want = home(c, c->slot[i].key);

		if (((i - want) & mask) >= ((i - hole) & mask)) {
			c->slot[hole] = c->slot[i];
			hole = i;
		}
	}
	c->slot[hole].key = 0;
	c->open--;
}

/* ---- a block ---- */

static bool is_final(const struct stream_block *b, uint32_t local)
{
	return b->final[local / 8] >> local % 8 & 1;
}

/* Where the positions of the block go, foreign vertices first; those of new ones are there. */
static int room_of(struct check *c, const struct stream_block *b, int32_t (**ret)[3], struct err *err)
{
	size_t n = (size_t)b->nforeign + b->nnew;

	*ret = b->local;
	if (b->local)
		return 0;
	if (n > c->room) {
		free(c->position);
		c->room = 0;
		c->position = malloc(n * sizeof *c->position);
		if (!c->position)
			return err_set(err, ERR_NOMEM, "there is no memory for a block's %zu vertices", n);
		c->room = n;
	}
	if (b->nnew)
		memcpy(c->position + b->nforeign, b->vertex, b->nnew * sizeof *c->position);
	*ret = c->position;
	return 0;
}

static int look_up_foreign(struct check *c, const struct stream_block *b, int32_t (*position)[3], struct err *err)
{
	for (uint32_t i = 0; i < b->nforeign; i++) {
		struct slot *slot = find(c, b->foreign[i] + 1);

		if (slot->key == 0)
			return err_set(err, ERR_PROTO, "block %llu uses vertex %llu, which was final in an earlier block",
				       (unsigned long long)b->index, (unsigned long long)b->foreign[i]);
		memcpy(position[i], slot->at, sizeof slot->at);
		if (is_final(b, i))
			erase(c, slot);
	}
	return 0;
}

static int take_new(struct check *c, const struct stream_block *b, struct err *err)
{
	digest_add_vertices(&c->vertex_digest, c->k, b->vertex, b->nnew);
	for (uint32_t i = 0, local = b->nforeign; i < b->nnew; i++, local++) {
		/* most vertices are final in the block that brings them */
		if (local % 8 == 0 && b->final[local / 8] == 0xff) {
			i += 7;
			local += 7;
		} else if (!is_final(b, local)) {
			int r = insert(c, b->first + i, b->vertex[i], err);

			if (r < 0)
				return r;
		}
	}
	return 0;
}

static void add_triangles(struct check *c, const struct stream_block *b, const int32_t (*position)[3])
{
	const uint32_t n = b->ntriangle;
	uint64_t corner[BATCH][3];

	for (uint32_t i = 0; i < n;) {
		uint32_t m = n - i < BATCH ? n - i : BATCH;

		for (uint32_t j = 0; j < m; j++, i++)
			for (unsigned k = 0; k < 3; k++)
				corner[j][k] = digest_place_of(position[b->triangle[i][k]]);
		digest_add_triangles(&c->digest, (const uint64_t(*)[3])corner, m, c->k);
	}
}

int check_block(struct check *c, const struct stream_block *b, const int32_t (**ret)[3], struct err *err)
{
	int32_t(*position)[3] = NULL;
	int r = room_of(c, b, &position, err);

	if (r == 0)
		r = look_up_foreign(c, b, position, err);
	if (r == 0)
		r = take_new(c, b, err);
	if (r < 0)
		return r;
	*ret = (const int32_t(*)[3])position;
	add_triangles(c, b, *ret);
	return 0;
}

static int compare(const char *what, struct digest came, struct digest said, struct err *err)
{
	char a[DIGEST_HEX_SIZE], b[DIGEST_HEX_SIZE];

	if (digest_equal(came, said))
		return 0;
	err_set(err, ERR_DIGEST, "the mesh has the %s %s, but the daemon's is %s", what, digest_hex(came, a),
		digest_hex(said, b));
	return err_add_hint(err, "fetch it again; if it stays so, the daemon or its machine is at fault: please report it");
}

int check_tail(const struct check *c, const struct stream_tail *tail, bool whole, struct err *err)
{
	int r = compare("digest", c->digest, tail->digest, err);

	if (r == 0)
		r = compare("vertex digest", c->vertex_digest, tail->vertex_digest, err);
	if (r == 0 && whole && tail->triangles > 0 && c->open != tail->hull)
		r = err_set(err, ERR_PROTO, "%llu vertices never became final, but the hull has %llu",
			    (unsigned long long)c->open, (unsigned long long)tail->hull);
	return r;
}

/* ---- changes ---- */

void check_gone(struct check *c, const struct stream_region *region, size_t n)
{
	for (size_t i = 0; i < n; i++)
		digest_add(&c->gone, region[i].digest);
}

int check_changes(const struct check *c, const struct stream_base *base, const struct stream_tail *tail, struct err *err)
{
	struct digest sum = base->old_digest;
	char a[DIGEST_HEX_SIZE], b[DIGEST_HEX_SIZE];

	digest_sub(&sum, c->gone);
	digest_add(&sum, c->digest);
	if (digest_equal(sum, base->digest))
		return 0;
	err_set(err, ERR_DIGEST, "the mesh of generation %llu with these changes has the digest %s, but the daemon's is %s",
		(unsigned long long)base->generation, digest_hex(sum, a), digest_hex(base->digest, b));
	return err_add_hint(err, "fetch the whole mesh; the daemon or its machine is at fault: please report it");
}

/* ---- as bytes ---- */

enum { PACKED_HEAD = 40, PACKED_SLOT = 20 };

size_t check_packed_size(const struct check *c)
{
	return PACKED_HEAD + c->open * PACKED_SLOT;
}

void check_pack(const struct check *c, struct packer *p)
{
	packer_u64(p, c->digest.hi);
	packer_u64(p, c->digest.lo);
	packer_u64(p, c->vertex_digest.hi);
	packer_u64(p, c->vertex_digest.lo);
	packer_u64(p, c->open);
	for (uint64_t i = 0; i < (uint64_t)1 << c->bits; i++) {
		const struct slot *s = &c->slot[i];

		if (s->key == 0)
			continue;
		packer_u64(p, s->key - 1);
		for (unsigned k = 0; k < 3; k++)
			packer_i32(p, s->at[k]);
	}
}

int check_unpack(struct check *c, struct cursor *in, struct err *err)
{
	uint64_t open;
	int r = 0;

	c->digest.hi = cursor_u64(in);
	c->digest.lo = cursor_u64(in);
	c->vertex_digest.hi = cursor_u64(in);
	c->vertex_digest.lo = cursor_u64(in);
	open = cursor_u64(in);
	if (in->bad || open > cursor_left(in) / PACKED_SLOT)
		return err_set(err, ERR_CORRUPT, "the state of a fetch is damaged");
	for (uint64_t i = 0; r == 0 && i < open; i++) {
		uint64_t number = cursor_u64(in);
		int32_t at[3];

		for (unsigned k = 0; k < 3; k++)
			at[k] = cursor_i32(in);
		if (number == UINT64_MAX || find(c, number + 1)->key != 0)
			r = err_set(err, ERR_CORRUPT, "the state of a fetch is damaged");
		else
			r = insert(c, number, at, err);
	}
	return r;
}
