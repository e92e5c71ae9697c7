/* Sizes and offsets of things in one piece of memory, as multiples of a cache line. */
#ifndef ALIGN_H
#define ALIGN_H

#include <stddef.h>
#include <stdint.h>

enum { ALIGN_LINE = 64 };

/* Rounds up. */
static inline size_t align_line(size_t n)
{
	return (n + ALIGN_LINE - 1) & ~(size_t)(ALIGN_LINE - 1);
}

/* Takes n bytes from the memory at *at, which it advances. */
static inline void *align_carve(uint8_t **at, size_t n)
{
	void *piece = *at;

	*at += align_line(n);
	return piece;
}

#endif
