/*
 * The blocks: the tree of keys, halved until a block has at most SIMPLIFY_BLOCK positions of the view. In one pass over the
 * positions in order: the next block begins at a key `lo`, and is the largest node of the tree that begins there and has not too
 * many positions. A larger one that contains it begins before, with a block that was not larger, so it has too many. To know how
 * many a node has, the next SIMPLIFY_BLOCK + 1 keys suffice.
 */
#include <string.h>

#include "align.h"
#include "err.h"
#include "geom.h"
#include "simplify_priv.h"

struct divide {
	struct simplify_out out, removed;
	struct simplify_sink sink;
	uint64_t key[SIMPLIFY_BLOCK + 1];
	uint32_t n, most; /* most: positions of a block */
	uint64_t lo;
	bool end; /* all keys were there */
	uint64_t points;
	int32_t first[2], second[2];
	bool flat;
};

size_t simplify_divide_bytes(const struct grid *grid)
{
	return align_line(sizeof(struct divide)) + align_line(grid_reader_bytes(grid));
}

/* The number of bits of the node, up to 64. */
static unsigned node_bits(const struct divide *d)
{
	unsigned bits = d->lo ? (unsigned)__builtin_ctzll(d->lo) : 64;

	if (d->end)
		return bits;
	while (bits && (bits == 64 || d->key[d->n - 1] - d->lo < UINT64_C(1) << bits))
		bits--;
	return bits;
}

/* Takes the next block, which may be empty. False: it was the last. */
static bool take_block(struct divide *d, struct simplify_block *ret)
{
	unsigned bits = node_bits(d);
	uint64_t hi = bits == 64 ? UINT64_MAX : d->lo + ((UINT64_C(1) << bits) - 1);
	uint32_t count = 0;

	while (count < d->n && d->key[count] <= hi)
		count++;
	*ret = (struct simplify_block){d->lo, hi, count};
	d->n -= count;
	memmove(d->key, d->key + count, d->n * sizeof *d->key);
	d->lo = hi + 1;
	return hi != UINT64_MAX;
}

static int write_block(struct divide *d, bool *ret_more, struct err *err)
{
	struct simplify_block b;

	*ret_more = take_block(d, &b);
	return b.count ? simplify_out_add(&d->out, &b, 1, err) : 0;
}

static int add_point(void *ctx, const struct point *p, struct err *err)
{
	struct divide *d = ctx;
	const int32_t at[2] = {p->x, p->y};
	bool more;
	int r = 0;

	if (d->points < 2)
		memcpy(d->points ? d->second : d->first, at, sizeof at);
	else if (d->flat && geom_orient(d->first, d->second, at))
		d->flat = false;
	d->points++;
	d->key[d->n++] = point_morton(p->x, p->y);
	while (!r && d->n == d->most + 1)
		r = write_block(d, &more, err);
	return r;
}

static int write_removed(const struct simplify *s, struct divide *d, struct err *err)
{
	int r = simplify_out_begin(&d->removed, s->p.dirfd, "removed", sizeof *d->sink.removed, err);

	if (r)
		return r;
	r = simplify_out_add(&d->removed, d->sink.removed, VIEW_RULES, err);
	if (!r)
		return simplify_out_end(&d->removed, NULL, err);
	simplify_out_abort(&d->removed);
	return r;
}

static int divide(const struct simplify *s, struct divide *d, struct grid_reader *reader, struct err *err)
{
	uint64_t info[SIMPLIFY_INFO] = {0};
	bool more = true;
	int r;

	simplify_sink_init(&d->sink, s, &s->view);
	d->sink.ctx = d;
	d->sink.point = add_point;
	r = simplify_scan(&d->sink, reader, 0, UINT64_MAX, err);
	d->end = true;
	while (!r && more)
		r = write_block(d, &more, err);
	/* The task is done when "blocks" is there, so the other file is written before. */
	if (!r)
		r = write_removed(s, d, err);
	info[0] = d->points;
	info[1] = d->flat;
	info[2] = d->sink.records;
	if (!r)
		return simplify_out_end(&d->out, info, err);
	simplify_out_abort(&d->out);
	return r;
}

int simplify_divide(const struct simplify *s, void *memory, struct err *err)
{
	struct divide *d = memory;
	struct grid_reader *reader;
	int r = grid_reader_new(s->p.grid, (uint8_t *)memory + align_line(sizeof *d), grid_reader_bytes(s->p.grid), &reader, err);

	if (r)
		return r;
	memset(d, 0, offsetof(struct divide, key));
	d->n = 0;
	d->most = s->block ? s->block : SIMPLIFY_BLOCK;
	d->lo = d->points = 0;
	d->end = false;
	d->flat = true;
	r = simplify_out_begin(&d->out, s->p.dirfd, "blocks", sizeof(struct simplify_block), err);
	if (!r)
		r = divide(s, d, reader, err);
	grid_reader_free(reader);
	return r;
}
