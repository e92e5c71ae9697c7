/*
 * Sorting by bytes, the lowest first. A byte that is the same in all records costs one look.
 */
#include <string.h>

#include "snap_priv.h"

static void sort_byte(const uint64_t *from, uint64_t *to, size_t n, unsigned words, unsigned by, unsigned shift,
		      size_t count[256])
{
	size_t sum = 0;

	for (unsigned b = 0; b < 256; b++) {
		size_t here = count[b];

		count[b] = sum;
		sum += here;
	}
	for (size_t i = 0; i < n; i++)
		memcpy(to + words * count[from[words * i + by] >> shift & 255]++, from + words * i, words * sizeof(*to));
}

int snap_sort(struct snap_memory *m, uint64_t *record, size_t n, unsigned words, unsigned by)
{
	struct snap_array scratch = {.size = words * sizeof(*record)};
	uint64_t *from = record, *to;
	int wrong = snap_array_room(m, &scratch, n);

	if (wrong)
		return wrong;
	to = scratch.at;
	for (unsigned shift = 0; shift < 64; shift += 8) {
		size_t count[256] = {0};
		uint64_t *swap = from;

		for (size_t i = 0; i < n; i++)
			count[from[words * i + by] >> shift & 255]++;
		if (n == 0 || count[from[by] >> shift & 255] == n)
			continue;
		sort_byte(from, to, n, words, by, shift, count);
		from = to;
		to = swap;
	}
	if (from != record)
		memcpy(record, from, n * words * sizeof(*record));
	snap_array_done(m, &scratch);
	return 0;
}

int snap_sort_unique(struct snap_memory *m, struct snap_array *word)
{
	uint64_t *w = word->at;
	size_t left = 0;
	int wrong = snap_sort(m, w, word->n, 1, 0);

	if (wrong)
		return wrong;
	for (size_t i = 0; i < word->n; i++)
		if (i == 0 || w[i] != w[left - 1])
			w[left++] = w[i];
	word->n = left;
	return 0;
}
