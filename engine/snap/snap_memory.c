/*
 * Arrays whose bytes are counted before they are taken.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "snap_priv.h"

int snap_array_room(struct snap_memory *m, struct snap_array *a, size_t n)
{
	size_t cap = a->cap ? a->cap : 64, fits = m->left / a->size;
	void *at;

	if (n <= a->cap)
		return 0;
	while (cap < n)
		cap *= 2;
	/* Near the limit it grows in smaller steps, but never item by item, which would copy all for each. */
	if (cap > fits)
		cap = n + n / 8;
	if (cap > fits)
		cap = fits;
	if (cap < n)
		return err_set(m->err, ERR_LIMIT, "the lines need more than %llu MiB of memory to be rounded",
			       (unsigned long long)(m->most >> 20));
	at = malloc(cap * a->size);
	if (!at)
		return err_set(m->err, ERR_NOMEM, "no memory for lines");
	if (a->n)
		memcpy(at, a->at, a->n * a->size);
	m->left -= cap * a->size;
	m->left += a->cap * a->size;
	free(a->at);
	a->at = at;
	a->cap = cap;
	return 0;
}

int snap_array_add(struct snap_memory *m, struct snap_array *a, const void *item)
{
	int wrong = snap_array_room(m, a, a->n + 1);

	if (!wrong)
		memcpy((unsigned char *)a->at + a->n++ * a->size, item, a->size);
	return wrong;
}

void snap_array_done(struct snap_memory *m, struct snap_array *a)
{
	m->left += a->cap * a->size;
	free(a->at);
	a->at = NULL;
	a->n = a->cap = 0;
}
