/*
 * Merging by a loser tree: one match on each level for each record. Matches compare the Morton keys in the tree; the
 * rest of the record decides ties, the source last, as in every sort order of the cache. Often many records in a row
 * come from the same input. After STRETCH wins in a row, an input is compared only with the best of all others.
 */
#include "grid_merge.h"

#include <assert.h>

#include "err.h"

enum { STRETCH = 4 };

/* The leaves of the tree: the next power of two, so that all matches have as many levels, which the processor predicts. */
static unsigned leaves_of(unsigned inputs)
{
	return inputs > 1 ? 2u << (31 - __builtin_clz(inputs - 1)) : 1;
}

size_t grid_merge_bytes(unsigned inputs)
{
	return (inputs + 1) * sizeof(struct grid_merge_input) + leaves_of(inputs) * sizeof(struct grid_merge_node);
}

void grid_merge_init(struct grid_merge *m, unsigned inputs, void *memory)
{
	*m = (struct grid_merge){.cap = inputs, .input = memory};
	m->tree = (struct grid_merge_node *)(m->input + inputs + 1);
}

static uint64_t key_of(const struct point *p)
{
	return point_morton(p->x, p->y);
}

/* The first of n sorted records whose key is not less. */
static size_t find_key(const struct point *pts, size_t n, uint64_t key)
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

static int refill_stream(struct grid_merge_input *in, struct err *err)
{
	size_t n = 0;
	int rc = in->next(in->ctx, &in->at, &n, &in->table, err);

	if (rc)
		return rc;
	in->end = in->at + n;
	in->done = !n;
	return 0;
}

/* Reads blocks until one has records in lo..hi. */
static int refill(struct grid_merge_input *in, struct err *err)
{
	size_t n = 0;

	in->done = true;
	if (in->next)
		return refill_stream(in, err);
	while (in->run.run) {
		int rc = grid_run_next(&in->run, &in->at, &n, &in->table, err);

		if (rc || !n)
			return rc;
		in->end = in->at + n;
		if (key_of(in->at) < in->lo)
			in->at += find_key(in->at, n, in->lo);
		if (in->at < in->end && key_of(in->end - 1) > in->hi)
			in->end = in->at + find_key(in->at, (size_t)(in->end - in->at), in->hi + 1);
		if (in->at == in->end)
			continue;
		if (in->seen)
			*in->seen += (uint64_t)(in->end - in->at);
		in->done = false;
		return 0;
	}
	return 0;
}

/* Counts the new input at the end of the list if it has records. */
static int add_input(struct grid_merge *m, struct grid_merge_input in, struct err *err)
{
	assert(m->n < m->cap);
	m->input[m->n] = in;
	int rc = refill(&m->input[m->n], err);

	if (rc == 0 && !m->input[m->n].done)
		m->n++;
	return rc;
}

int grid_merge_run(struct grid_merge *m, const struct grid_run_reader *run, uint64_t lo, uint64_t hi, uint64_t *seen,
		   struct err *err)
{
	return add_input(m, (struct grid_merge_input){.run = *run, .lo = lo, .hi = hi, .seen = seen}, err);
}

int grid_merge_stream(struct grid_merge *m,
		      int (*next)(void *ctx, const struct point **ret_pts, size_t *ret_n, const uint32_t **ret_table,
				  struct err *err),
		      void *ctx, struct err *err)
{
	return add_input(m, (struct grid_merge_input){.next = next, .ctx = ctx, .hi = UINT64_MAX}, err);
}

void grid_merge_memory(struct grid_merge *m, const struct point *pts, size_t n, const uint32_t *table, uint64_t lo, uint64_t hi)
{
	size_t from = find_key(pts, n, lo), to = hi == UINT64_MAX ? n : from + find_key(pts + from, n - from, hi + 1);

	assert(m->n < m->cap);
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

/* Decides a match of equal keys. Input -1 means an empty node, and wins against all; a leaf without input loses. */
static bool tie_beats(const struct grid_merge *m, int a, int b)
{
	return a < 0 || b < 0 || a >= (int)m->n || b >= (int)m->n ? a < b : ties_less(&m->input[a], &m->input[b]);
}

/* Plays `one` up to the root. The winner is unpredictable, so nodes are exchanged without a branch. */
static inline void play(struct grid_merge *m, struct grid_merge_node one)
{
	for (unsigned t = ((unsigned)one.input + m->leaves) / 2; t > 0; t /= 2) {
		struct grid_merge_node *node = &m->tree[t];
		uint64_t swap = node->key < one.key;

		if (__builtin_expect(node->key == one.key || node->input < 0, 0))
			swap = tie_beats(m, node->input, one.input);
		uint64_t key = (node->key ^ one.key) & -swap;
		int input = (node->input ^ one.input) & -(int)swap;

		node->key ^= key;
		node->input ^= input;
		one.key ^= key;
		one.input ^= input;
		if (one.input < 0)
			return;
	}
	m->wins = one.input == m->tree[0].input ? m->wins + 1 : 0;
	m->tree[0] = one;
}

/* The node of an input. The key of the record behind its next one is made now: it is at hand when that has won, and the matches
 * need not wait for it. `fresh`: it went on by more than one record. */
static inline struct grid_merge_node node_of(struct grid_merge *m, int input, bool fresh)
{
	struct grid_merge_input *in = &m->input[input];
	uint64_t key = in->done ? UINT64_MAX : fresh ? key_of(in->at) : in->key;

	if (!in->done && in->at + 1 < in->end)
		in->key = key_of(in->at + 1);
	return (struct grid_merge_node){.key = key, .input = input};
}

void grid_merge_start(struct grid_merge *m)
{
	m->leaves = leaves_of(m->n);
	for (unsigned i = 0; i < m->leaves; i++)
		m->tree[i] = (struct grid_merge_node){.key = 0, .input = -1};
	for (unsigned i = m->leaves; i-- > 0;)
		play(m, i < m->n ? node_of(m, (int)i, true) : (struct grid_merge_node){.key = UINT64_MAX, .input = (int)i});
}

/* The best key of all other inputs: below it, the winner wins without a match. */
static uint64_t runner_up(const struct grid_merge *m)
{
	uint64_t key = UINT64_MAX;

	for (unsigned t = ((unsigned)m->tree[0].input + m->leaves) / 2; t > 0; t /= 2)
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

/* Takes the first record, and then those before the key `below`; at most max. */
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
		int input = m->tree[0].input;
		struct grid_merge_input *in = &m->input[input];
		bool fresh = m->wins >= STRETCH;

		if (in->done)
			break;
		if (fresh)
			n += take_stretch(in, pts + n, ids ? ids + n : NULL, max - n, runner_up(m));
		else
			n += take_one(in, pts + n, ids ? ids + n : NULL);
		if (in->at == in->end) {
			int rc = refill(in, err);

			if (rc)
				return rc;
			fresh = true;
		}
		play(m, node_of(m, input, fresh));
	}
	*ret_n = n;
	return 0;
}
