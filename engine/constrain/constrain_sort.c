/* A sort in place (heap sort), without allocation, for the few points and pieces of a turn. */
#include "constrain_priv.h"

#include <string.h>

enum { ELEMENT_MOST = 40 };

static void sift(uint8_t *base, size_t at, size_t n, size_t size, constrain_less_fn less)
{
	uint8_t moved[ELEMENT_MOST];

	memcpy(moved, base + at * size, size);
	for (size_t child; (child = 2 * at + 1) < n; at = child) {
		if (child + 1 < n && less(base + child * size, base + (child + 1) * size))
			child++;
		if (!less(moved, base + child * size))
			break;
		memcpy(base + at * size, base + child * size, size);
	}
	memcpy(base + at * size, moved, size);
}

void constrain_sort(void *array, size_t n, size_t size, constrain_less_fn less)
{
	uint8_t swap[ELEMENT_MOST], *base = array;

	for (size_t i = n / 2; i-- > 0;)
		sift(base, i, n, size, less);
	for (size_t last = n; last-- > 1;) {
		memcpy(swap, base, size);
		memcpy(base, base + last * size, size);
		memcpy(base + last * size, swap, size);
		sift(base, 0, last, size, less);
	}
}
