/*
 * Which of up to 64 boxes a position may be in, for many positions in one box: that is divided into columns and rows, and each of
 * these has the bits of the boxes that meet it.
 */
#ifndef SQUARES_H
#define SQUARES_H

#include <stdint.h>
#include <string.h>

enum { SQUARES = 32, SQUARES_BOXES = 64 };

struct squares {
	int32_t low[2], high[2];
	unsigned shift[2];
	uint64_t bits[2][SQUARES];
};

static inline void squares_init(struct squares *s, const int32_t box[4])
{
	memset(s, 0, sizeof(*s));
	for (unsigned k = 0; k < 2; k++) {
		s->low[k] = box[k];
		s->high[k] = box[k + 2];
		while (((int64_t)box[k + 2] - box[k]) >> s->shift[k] >= SQUARES)
			s->shift[k]++;
	}
}

/* Box i, from `low` to `high`; it may be larger than the box of all. */
static inline void squares_add(struct squares *s, unsigned i, const int64_t low[2], const int64_t high[2])
{
	for (unsigned k = 0; k < 2; k++) {
		int64_t from = (low[k] > s->low[k] ? low[k] : s->low[k]) - s->low[k];
		int64_t to = (high[k] < s->high[k] ? high[k] : s->high[k]) - s->low[k];

		for (int64_t at = from >> s->shift[k]; at <= to >> s->shift[k]; at++)
			s->bits[k][at] |= UINT64_C(1) << i;
	}
}

/* Bits of the boxes that a position in the box of all may be in. */
static inline uint64_t squares_at(const struct squares *s, int32_t x, int32_t y)
{
	uint32_t column = ((uint32_t)x - (uint32_t)s->low[0]) >> s->shift[0];
	uint32_t row = ((uint32_t)y - (uint32_t)s->low[1]) >> s->shift[1];

	return s->bits[0][column % SQUARES] & s->bits[1][row % SQUARES];
}

#endif
