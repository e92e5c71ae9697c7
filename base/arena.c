/*
 * The bump arena (arena.h). Alignment is that of the address, not of the offset, so the caller's memory
 * may start anywhere. It never allocates, and never moves a piece.
 */
#include "arena.h"

struct arena arena_of(void *memory, size_t size)
{
	return (struct arena){.start = memory, .size = size};
}

void *arena_take(struct arena *a, size_t n, size_t size, size_t align)
{
	size_t bytes, pad = -((uintptr_t)a->start + a->used) & (align - 1);

	if (a->overflow)
		return NULL;
	if (__builtin_mul_overflow(n, size, &bytes) || pad > a->size - a->used ||
	    bytes > a->size - a->used - pad) {
		a->overflow = true;
		return NULL;
	}
	void *piece = a->start + a->used + pad;

	a->used += pad + bytes;
	if (a->used > a->peak)
		a->peak = a->used;
	return piece;
}

struct arena_mark arena_mark(const struct arena *a)
{
	return (struct arena_mark){a->used, a->overflow};
}

void arena_rollback(struct arena *a, struct arena_mark mark)
{
	a->used = mark.used;
	a->overflow = mark.overflow;
}

size_t arena_left(const struct arena *a)
{
	return a->overflow ? 0 : a->size - a->used;
}
