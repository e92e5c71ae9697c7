/* A table from texts to numbers, for thousands of files: which of them has this name? */
#ifndef NAMES_H
#define NAMES_H

#include <stddef.h>
#include <stdint.h>

struct err;

/* Keys are borrowed and must stay as long as the table. One key may have several numbers. All zero: empty. */
struct names {
	struct name_slot {
		const char *key; /* NULL: free */
		uint32_t value;
	} * slot;
	size_t cap, n;
};

int names_put(struct names *, const char *key, uint32_t value, struct err *err);
/* The first of the key's numbers if `*at` is NAMES_START, else the one after; false: no more. */
#define NAMES_START SIZE_MAX
_Bool names_next(const struct names *, const char *key, size_t *at, uint32_t *ret);
void names_free(struct names *); /* empty again */
static inline size_t names_bytes(const struct names *t)
{
	return t->cap * sizeof *t->slot;
}

#endif
