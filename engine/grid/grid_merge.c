/*
 * Merging by a tree of losers: a match a level for each record, on the Morton key, which is kept in the tree;
 * the rest of the record decides ties, the source last, as in every sort order of the cache. Inputs often lie
 * side by side for a stretch: who wins again and again is compared with the best of all others only.
 */
#include "grid_merge.h"

#include <assert.h>

#include "err.h"

enum { STRETCH = 4 };

size_t grid_merge_bytes(unsigned inputs)
{
	return (inputs + 1) * (sizeof(struct grid_merge_seat) + sizeof(struct grid_merge_input));
}

void grid_merge_init(struct grid_merge *m, unsigned inputs, void *memory)
{
	*m = (struct grid_merge){.room = inputs, .input = memory};
	m->tree = (struct grid_merge_seat *)(m->input + inputs + 1);
}

static uint64_t key_of(const struct point *p)
{
	return point_morton(p->x, p->y);
}

/* The first of n sorted records whose key is not less. */
static size_t find(const struct point *pts, size_t n, uint64_t key)
{
	size_t from = 0, to = n;

	while (from < to) {
		size_t mid = from + (to - from) / 2;

		if (key_of(&pts[mid]) < key)
			from = mid + 1;
		else
			to = mid;
	}
	return from;
}

static int refill_other(struct grid_merge_input *in, struct err *err)
{
	size_t n = 0;
	int rc = in->next(in->ctx, &in->at, &n, &in->table, err);

	if (rc)
		return rc;
	in->end = in->at + n;
	in->done = !n;
	return 0;
}

/* Blocks until one has records in lo..hi. */
static int refill(struct grid_merge_input *in, struct err *err)
{
	size_t n = 0;

	in->done = true;
	if (in->next)
		return refill_other(in, err);
	while (in->run.run) {
		int rc = grid_run_next(&in->run, &in->at, &n, &in->table, err);

		if (rc || !n)
			return rc;
		in->end = in->at + n;
		if (key_of(in->at) < in->lo)
			in->at += find(in->at, n, in->lo);
		if (in->at < in->end && key_of(in->end - 1) > in->hi)
			in->end = in->at + find(in->at, (size_t)(in->end - in->at), in->hi + 1);
		if (in->at == in->end)
			continue;
		if (in->seen)
			*in->seen += (uint64_t)(in->end - in->at);
		in->done = false;
		return 0;
	}
	return 0;
}

int grid_merge_run(struct grid_merge *m, const struct grid_run_reader *run, uint64_t lo, uint64_t hi, uint64_t *seen,
		   struct err *err)
{
	struct grid_merge_input *in = &m->input[m->n];

	assert(m->n < m->room);
	*in = (struct grid_merge_input){.run = *run, .lo = lo, .hi = hi, .seen = seen};
	int rc = refill(in, err);

	if (rc == 0 && !in->done)
		m->n++;
	return rc;
}

int grid_merge_other(struct grid_merge *m,
		     int (*next)(void *ctx, const struct point **ret_pts, size_t *ret_n, const uint32_t **ret_table,
				 struct err *err),
		     void *ctx, struct err *err)
{
	struct grid_merge_input *in = &m->input[m->n];

	assert(m->n < m->room);
	*in = (struct grid_merge_input){.next = next, .ctx = ctx, .hi = UINT64_MAX};
	int rc = refill(in, err);

	if (rc == 0 && !in->done)
		m->n++;
	return rc;
}

void grid_merge_memory(struct grid_merge *m, const struct point *pts, size_t n, const uint32_t *table, uint64_t lo, uint64_t hi)
{
	size_t from = find(pts, n, lo), to = hi == UINT64_MAX ? n : from + find(pts + from, n - from, hi + 1);

	assert(m->n < m->room);
	if (from < to)
		m->input[m->n++] = (struct grid_merge_input){.at = pts + from, .end = pts + to, .table = table};
}

static bool ties_less(const struct grid_merge_input *a, const struct grid_merge_input *b)
{
	const struct point *p = a->at, *q = b->at;

	if (a->done || b->done)
		return !a->done;
	if (p->z != q->z)
		return p->z < q->z;
	if (p->cls != q->cls)
		return p->cls < q->cls;
	if (p->ret != q->ret)
		return p->ret < q->ret;
	if (point_flags(p) != point_flags(q))
		return point_flags(p) < point_flags(q);
	return a->table[point_source(p)] < b->table[point_source(q)];
}

/* -1 stands for a seat nobody has taken yet, and wins against everybody. */
static bool even_beats(const struct grid_merge *m, int a, int b)
{
	return a < 0 || b < 0 ? a < b : ties_less(&m->input[a], &m->input[b]);
}

/* `one` plays its way up to the top. Who wins is not foreseeable: seats are exchanged without a branch. */
static inline void play(struct grid_merge *m, struct grid_merge_seat one)
{
	for (unsigned t = ((unsigned)one.who + m->n) / 2; t > 0; t /= 2) {
		struct grid_merge_seat *seat = &m->tree[t];
		uint64_t swap = seat->key < one.key;

		if (__builtin_expect(seat->key == one.key || seat->who < 0, 0))
			swap = even_beats(m, seat->who, one.who);
		uint64_t key = (seat->key ^ one.key) & -swap;
		int who = (seat->who ^ one.who) & -(int)swap;

		seat->key ^= key;
		seat->who ^= who;
		one.key ^= key;
		one.who ^= who;
		if (one.who < 0)
			return;
	}
	m->wins = one.who == m->tree[0].who ? m->wins + 1 : 0;
	m->tree[0] = one;
}

static struct grid_merge_seat seat_of(const struct grid_merge *m, int who)
{
	const struct grid_merge_input *in = &m->input[who];

	return (struct grid_merge_seat){.key = in->done ? UINT64_MAX : key_of(in->at), .who = who};
}

void grid_merge_start(struct grid_merge *m)
{
	for (unsigned i = 0; i <= m->n; i++)
		m->tree[i] = (struct grid_merge_seat){.key = 0, .who = -1};
	for (unsigned i = m->n; i-- > 0;)
		play(m, seat_of(m, (int)i));
}

/* The key that the winner must stay below to win without playing. */
static uint64_t runner_up(const struct grid_merge *m)
{
	uint64_t key = UINT64_MAX;

	for (unsigned t = ((unsigned)m->tree[0].who + m->n) / 2; t > 0; t /= 2)
		key = m->tree[t].key < key ? m->tree[t].key : key;
	return key;
}

static size_t take_one(struct grid_merge_input *in, struct point *pts, uint32_t *ids)
{
	*pts = *in->at;
	if (ids)
		*ids = in->table[point_source(in->at)];
	in->at++;
	return 1;
}

/* The first record, and those that come before everybody else's, at most max. */
static size_t take_stretch(struct grid_merge_input *in, struct point *pts, uint32_t *ids, size_t max, uint64_t below)
{
	size_t n = take_one(in, pts, ids);

	while (n < max && in->at < in->end && key_of(in->at) < below)
		n += take_one(in, pts + n, ids ? ids + n : NULL);
	return n;
}

int grid_merge_take(struct grid_merge *m, struct point *pts, uint32_t *ids, size_t max, size_t *ret_n, struct err *err)
{
	size_t n = 0;

	while (n < max && m->n) {
		int who = m->tree[0].who;
		struct grid_merge_input *in = &m->input[who];

		if (in->done)
			break;
		if (m->wins < STRETCH)
			n += take_one(in, pts + n, ids ? ids + n : NULL);
		else
			n += take_stretch(in, pts + n, ids ? ids + n : NULL, max - n, runner_up(m));
		if (in->at == in->end) {
			int rc = refill(in, err);

			if (rc)
				return rc;
		}
		play(m, seat_of(m, who));
	}
	*ret_n = n;
	return 0;
}
