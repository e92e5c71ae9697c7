/* A hash table from strings to numbers, such as from file names to indexes of an array. */
#ifndef NAMES_H
#define NAMES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

/* Keys are borrowed and must outlive the table. A key may have several numbers. Zero-initialized: empty. */
struct names {
	struct name_slot {
		const char *key; /* NULL: an unused slot */
		uint32_t value;
	} * slot;
	size_t cap, n;
};

int names_put(struct names *, const char *key, uint32_t value, struct err *err);
/* The first number of the key if *at is NAMES_START, else the one after *at. False: there is none. */
#define NAMES_START SIZE_MAX
bool names_next(const struct names *, const char *key, size_t *at, uint32_t *ret);
void names_free(struct names *); /* empties it */
static inline size_t names_bytes(const struct names *t)
{
	return t->cap * sizeof *t->slot;
}

#endif
