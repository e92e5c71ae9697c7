/*
 * Merging by a tree of losers: a match a level for each record, on the Morton key, which is kept with the
 * input; the rest of the record decides ties, the source last, as in every sort order of the cache.
 */
#include "grid_merge.h"

#include <assert.h>

#include "err.h"

void grid_merge_init(struct grid_merge *m)
{
	m->n = 0;
}

static int refill(struct grid_merge_input *in, struct err *err)
{
	size_t n = 0;
	int rc = 0;

	if (in->run.fd >= 0)
		rc = grid_run_next(&in->run, &in->at, &n, &in->table, err);
	if (rc)
		return rc;
	in->done = n == 0;
	in->end = in->at + n;
	if (n)
		in->key = point_morton(in->at->x, in->at->y);
	return 0;
}

int grid_merge_run(struct grid_merge *m, int dirfd, const char *name, void *buffer, struct err *err)
{
	struct grid_merge_input *in = &m->input[m->n];

	assert(m->n <= GRID_MERGE_INPUTS);
	*in = (struct grid_merge_input){.run = GRID_RUN_READER_INIT};
	int rc = grid_run_open(&in->run, dirfd, name, buffer, err);

	if (rc)
		return rc;
	m->n++;
	return refill(in, err);
}

void grid_merge_memory(struct grid_merge *m, const struct point *pts, size_t n, const uint32_t *table)
{
	struct grid_merge_input *in = &m->input[m->n];

	assert(m->n <= GRID_MERGE_INPUTS);
	*in = (struct grid_merge_input){
	    .at = pts, .end = pts + n, .table = table, .done = n == 0, .run = GRID_RUN_READER_INIT};
	if (n)
		in->key = point_morton(pts->x, pts->y);
	m->n++;
}

static bool ties_less(const struct grid_merge_input *a, const struct grid_merge_input *b)
{
	const struct point *p = a->at, *q = b->at;

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
static inline bool beats(const struct grid_merge *m, int a, int b)
{
	if (a < 0 || b < 0)
		return a < b;
	const struct grid_merge_input *p = &m->input[a], *q = &m->input[b];

	if (p->done || q->done)
		return !p->done;
	return p->key < q->key || (p->key == q->key && ties_less(p, q));
}

/* Input `who` plays its way up to the top. */
static inline void play(struct grid_merge *m, int who)
{
	for (unsigned t = ((unsigned)who + m->n) / 2; t > 0; t /= 2) {
		if (beats(m, m->tree[t], who)) {
			int other = m->tree[t];

			m->tree[t] = who;
			who = other;
			if (who < 0)
				return;
		}
	}
	m->tree[0] = who;
}

void grid_merge_start(struct grid_merge *m)
{
	for (unsigned i = 0; i < m->n; i++)
		m->tree[i] = -1;
	for (unsigned i = m->n; i-- > 0;)
		play(m, (int)i);
}

int grid_merge_take(struct grid_merge *m, struct point *pts, uint32_t *ids, size_t max, size_t *ret_n,
		    struct err *err)
{
	size_t n = 0;

	while (n < max && m->n) {
		struct grid_merge_input *in = &m->input[m->tree[0]];

		if (in->done)
			break;
		pts[n] = *in->at;
		if (ids)
			ids[n] = in->table[point_source(in->at)];
		n++;
		if (++in->at < in->end) {
			in->key = point_morton(in->at->x, in->at->y);
		} else {
			int rc = refill(in, err);

			if (rc)
				return rc;
		}
		play(m, m->tree[0]);
	}
	*ret_n = n;
	return 0;
}

void grid_merge_close(struct grid_merge *m)
{
	for (unsigned i = 0; i < m->n; i++)
		grid_run_close(&m->input[i].run);
	m->n = 0;
}
