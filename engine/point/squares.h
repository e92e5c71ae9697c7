/*
 * Which of up to 64 boxes a position may be in, for many positions in one box: that is divided into columns and rows, and each of
 * these has the bits of the boxes that meet it. A strip along a line, in doubles, tells more about what is long and thin.
 */
#ifndef SQUARES_H
#define SQUARES_H

#include <math.h>
#include <stdbool.h>
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

/* What is at least `low` and at most `high` left of a line; a whole unit more on either side, which is more than all rounding. */
struct squares_strip {
	double x, y, ex, ey, low, high;
};

static inline struct squares_strip squares_strip(const int32_t from[2], const int32_t to[2], double low, double high)
{
	struct squares_strip s = {from[0], from[1], (double)to[0] - from[0], (double)to[1] - from[1], 0, 0};
	double length = sqrt(s.ex * s.ex + s.ey * s.ey);

	s.low = (low - 1) * length;
	s.high = (high + 1) * length;
	return s;
}

static inline bool squares_in_strip(const struct squares_strip *s, int32_t x, int32_t y)
{
	double side = s->ex * (y - s->y) - s->ey * (x - s->x);

	return side >= s->low && side <= s->high;
}

#endif
