/* Bits of two numbers in turn: the place of a cell on a Z-order curve. */
#ifndef MORTON_H
#define MORTON_H

#include <stdint.h>

/* Bit i to bit 2i, by halving the distances five times. */
static inline uint64_t morton_spread(uint32_t n)
{
	uint64_t v = n;

	v = (v | v << 16) & 0x0000ffff0000ffffu;
	v = (v | v << 8) & 0x00ff00ff00ff00ffu;
	v = (v | v << 4) & 0x0f0f0f0f0f0f0f0fu;
	v = (v | v << 2) & 0x3333333333333333u;
	return (v | v << 1) & 0x5555555555555555u;
}

static inline uint64_t morton_code(uint32_t x, uint32_t y)
{
	return morton_spread(x) | morton_spread(y) << 1;
}

/* Bit 2i to bit i: x of a code, and y of one that is shifted down. */
static inline uint32_t morton_gather(uint64_t code)
{
	code &= 0x5555555555555555u;
	code = (code | code >> 1) & 0x3333333333333333u;
	code = (code | code >> 2) & 0x0f0f0f0f0f0f0f0fu;
	code = (code | code >> 4) & 0x00ff00ff00ff00ffu;
	code = (code | code >> 8) & 0x0000ffff0000ffffu;
	return (uint32_t)(code | code >> 16);
}

#endif
