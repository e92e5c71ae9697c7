/*
 * Borders between slices (grid_slices.h).
 *
 * Let k1 < k2 be two keys with more than GRID_CELL_RECORDS records from k1 to k2, and h the highest bit in which they
 * differ. Let b be k2 with the bits below h cleared. Then k1 < b <= k2, and the smallest aligned range that contains
 * b - 1 and b contains both keys, hence more records than a cell may have. So b is a border of cells, whatever other
 * records there are. Such pairs are found among the first keys of blocks of a run that are far enough apart, and in
 * sorted memory. After a source was dropped the number of records between two keys is unknown, so there is one slice.
 */
#include "grid_slices.h"

#include <stdlib.h>

#include "err.h"
#include "order.h"

enum {
	SAMPLES = 24, /* for each slice, about */
	BLOCKS_APART = GRID_CELL_RECORDS / DISK_RUN_LEAST + 1,
};

struct samples {
	uint64_t *key;
	size_t n, cap;
};

static void add_sample(struct samples *s, uint64_t k1, uint64_t k2)
{
	if (k1 >= k2 || s->n == s->cap)
		return;
	unsigned h = 63u - (unsigned)__builtin_clzll(k1 ^ k2);

	s->key[s->n++] = k2 >> h << h;
}

static int sample_run(struct samples *s, const struct grid_run *run, uint64_t stride, struct err *err)
{
	uint64_t step = stride / DISK_RUN_RECORDS, k1, k2;
	int rc = 0;

	step = step < 1 ? 1 : step;
	for (uint64_t i = 0; rc == 0 && i + BLOCKS_APART < run->blocks; i += step) {
		rc = grid_run_key(run, i, &k1, err);
		if (rc == 0)
			rc = grid_run_key(run, i + BLOCKS_APART, &k2, err);
		if (rc == 0)
			add_sample(s, k1, k2);
	}
	return rc;
}

static void sample_piece(struct samples *s, const struct grid_piece *p, uint64_t stride)
{
	for (size_t i = 0; i + GRID_CELL_RECORDS < p->n; i += stride) {
		const struct point *a = &p->pts[i], *b = a + GRID_CELL_RECORDS;

		add_sample(s, point_morton(a->x, a->y), point_morton(b->x, b->y));
	}
}

/* Takes every `each`-th sample as a border, but no key twice. */
static void choose_borders(struct grid_slices *s, const struct samples *from, size_t each)
{
	qsort(from->key, from->n, sizeof *from->key, order_u64);
	for (size_t i = each; i < from->n && s->n < GRID_SLICES; i += each)
		if (s->n == 1 || s->border[s->n - 2] < from->key[i])
			s->border[s->n++ - 1] = from->key[i];
}

int grid_slices_plan(struct grid_slices *s, size_t target, bool whole, void *memory, size_t bytes, struct err *err)
{
	struct samples found = {.key = memory, .cap = bytes / sizeof *found.key};
	uint64_t stride;
	size_t slices;
	int rc = 0;

	s->n = 1;
	s->next = 0;
	if (whole || s->records <= target)
		return 0;
	if (target < s->records / (GRID_SLICES / 2))
		target = (size_t)(s->records / (GRID_SLICES / 2));
	slices = (size_t)(s->records / target + 1);
	stride = target / SAMPLES;
	stride = stride < GRID_CELL_RECORDS ? GRID_CELL_RECORDS : stride;
	/* Each run gives at least one sample, and a stride is rounded down to whole blocks. */
	if (found.cap < 2 * (s->records / stride) + s->nruns + s->npieces)
		stride = 2 * s->records / (found.cap / 2);
	for (size_t i = 0; rc == 0 && i < s->nruns; i++)
		rc = sample_run(&found, &s->run[i], stride, err);
	for (unsigned i = 0; rc == 0 && i < s->npieces; i++)
		sample_piece(&found, &s->piece[i], stride);
	if (rc == 0)
		choose_borders(s, &found, found.n / slices ? found.n / slices : 1);
	return rc;
}

int grid_slices_next(struct grid_slices *s, struct grid_slice *ret, struct err *err)
{
	bool last = s->next + 1 == s->n;
	int rc = 0;

	ret->number = s->next;
	ret->lo = s->next ? s->border[s->next - 1] : 0;
	ret->hi = last ? UINT64_MAX : s->border[s->next] - 1;
	for (size_t i = 0; rc == 0 && i < s->nruns; i++) {
		ret->first[i] = s->from[i];
		ret->end[i] = s->run[i].blocks;
		if (!last)
			rc = grid_run_find(&s->run[i], s->from[i], s->border[s->next], &ret->end[i], err);
		/* The last block of this slice may reach into the next. */
		if (rc == 0 && ret->end[i] > s->from[i])
			s->from[i] = ret->end[i] - 1;
	}
	s->next += rc == 0;
	return rc;
}
