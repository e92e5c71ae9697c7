/*
 * A bump arena over memory that the caller owns: pieces are taken from the front, given back by rolling
 * back to a mark. After the first piece that does not fit every take gives NULL and `overflow` stays set
 * (a rollback to a mark taken before it clears it): take many, check once.
 */
#ifndef ARENA_H
#define ARENA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct arena {
	uint8_t *start;
	size_t size, used;
	size_t peak; /* largest `used` so far */
	bool overflow;
};

struct arena_mark {
	size_t used;
	bool overflow;
};

/* `memory` of `size` bytes stays the caller's. */
struct arena arena_of(void *memory, size_t size);
/* `n` objects of `size` bytes, aligned to `align` (a power of two). NULL: does not fit. Not zeroed. */
void *arena_take(struct arena *, size_t n, size_t size, size_t align);
struct arena_mark arena_mark(const struct arena *);
/* Everything taken since the mark is given back. Marks taken after it are void. */
void arena_rollback(struct arena *, struct arena_mark);
size_t arena_left(const struct arena *);

#define arena_array(arena, type, n) ((type *)arena_take((arena), (n), sizeof(type), _Alignof(type)))

#endif
