/*
 * A hash table from strings to numbers: open addressing, a load factor of at most a half, and doubling. No entry is
 * ever removed.
 */
#include "names.h"

#include <stdlib.h>
#include <string.h>

#include "digest.h"
#include "err.h"

static size_t place_of(const struct names *t, const char *key)
{
	return (size_t)digest_hash(key, strlen(key)).lo & (t->cap - 1);
}

static void insert(struct names *t, const char *key, uint32_t value)
{
	size_t at = place_of(t, key);

	while (t->slot[at].key)
		at = (at + 1) & (t->cap - 1);
	t->slot[at] = (struct name_slot){key, value};
	t->n++;
}

int names_put(struct names *t, const char *key, uint32_t value, struct err *err)
{
	if (2 * (t->n + 1) > t->cap) {
		struct names more = {.cap = t->cap ? 2 * t->cap : 16};

		more.slot = calloc(more.cap, sizeof *more.slot);
		if (!more.slot)
			return err_set(err, ERR_NOMEM, "no memory for a table of %zu names", t->n);
		for (size_t i = 0; i < t->cap; i++)
			if (t->slot[i].key)
				insert(&more, t->slot[i].key, t->slot[i].value);
		free(t->slot);
		*t = more;
	}
	insert(t, key, value);
	return 0;
}

bool names_next(const struct names *t, const char *key, size_t *at, uint32_t *ret)
{
	size_t i;

	if (!t->cap)
		return false;
	for (i = *at == NAMES_START ? place_of(t, key) : (*at + 1) & (t->cap - 1); t->slot[i].key; i = (i + 1) & (t->cap - 1))
		if (!strcmp(t->slot[i].key, key)) {
			*at = i;
			*ret = t->slot[i].value;
			return true;
		}
	return false;
}

void names_free(struct names *t)
{
	free(t->slot);
	*t = (struct names){0};
}
