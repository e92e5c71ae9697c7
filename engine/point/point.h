/*
 * The point record of the cache: 16 bytes, and its sort order.
 */
#ifndef POINT_H
#define POINT_H

#include <stddef.h>
#include <stdint.h>

struct point {
	int32_t x, y, z; /* lattice numbers */
	uint8_t cls;     /* class */
	uint8_t ret;     /* return number (low nibble), number of returns (high nibble) */
	uint16_t tag;    /* flags (low 4 bits); index into the block's table of sources (high 12 bits) */
};

_Static_assert(sizeof(struct point) == 16, "the record of format.md");

enum {
	POINT_WITHHELD = 1,
	POINT_SYNTHETIC = 2,
	POINT_KEY = 4, /* model key-point */
	POINT_OVERLAP = 8,
	POINT_FLAGS = 15,
	POINT_SOURCE_SHIFT = 4,
	POINT_SOURCES = 4096,
	/* Instead of the index of a source, in records that a reader of a generation gives (grid.h): */
	POINT_LINE = 1 << POINT_SOURCE_SHIFT,      /* a vertex of a line, not a survey point */
	POINT_NEAR_LINE = 2 << POINT_SOURCE_SHIFT, /* on a line, or too near to it: removed */
	POINT_IN_AREA = 4 << POINT_SOURCE_SHIFT,   /* in a lake, in a hole, or outside of the boundary: removed */
	/* Of such a record, too: the slot of its source (slots.h), five bits. */
	POINT_SLOT_SHIFT = POINT_SOURCE_SHIFT + 3,
	POINT_SLOT = 31 << POINT_SLOT_SHIFT,
};

static inline unsigned point_return(const struct point *p)
{
	return p->ret & 15u;
}
static inline unsigned point_returns(const struct point *p)
{
	return p->ret >> 4;
}
static inline unsigned point_flags(const struct point *p)
{
	return p->tag & POINT_FLAGS;
}
static inline unsigned point_source(const struct point *p)
{
	return p->tag >> POINT_SOURCE_SHIFT;
}
static inline unsigned point_slot(const struct point *p)
{
	return (unsigned)(p->tag & POINT_SLOT) >> POINT_SLOT_SHIFT;
}

/* Extends a box (min x, min y, max x, max y) so that it contains another one. */
static inline void point_box_join(int32_t box[4], const int32_t other[4])
{
	box[0] = other[0] < box[0] ? other[0] : box[0];
	box[1] = other[1] < box[1] ? other[1] : box[1];
	box[2] = other[2] > box[2] ? other[2] : box[2];
	box[3] = other[3] > box[3] ? other[3] : box[3];
}

/* Two words at once, in a register of any processor with vectors. */
typedef uint64_t point_words __attribute__((vector_size(16)));

/* Morton key of x + 2^31 and y + 2^31: bit i of x at 2i + 1, of y at 2i (algorithm.md 3). Bits are moved by halving their
 * distances five times. */
static inline uint64_t point_morton(int32_t x, int32_t y)
{
	point_words s = {(uint32_t)y ^ 0x80000000u, (uint32_t)x ^ 0x80000000u};

	s = (s | s << 16) & UINT64_C(0x0000ffff0000ffff);
	s = (s | s << 8) & UINT64_C(0x00ff00ff00ff00ff);
	s = (s | s << 4) & UINT64_C(0x0f0f0f0f0f0f0f0f);
	s = (s | s << 2) & UINT64_C(0x3333333333333333);
	s = (s | s << 1) & UINT64_C(0x5555555555555555);
	return s[0] | s[1] << 1;
}

static inline void point_from_morton(uint64_t key, int32_t *ret_x, int32_t *ret_y)
{
	point_words s = {key, key >> 1};

	s &= UINT64_C(0x5555555555555555);
	s = (s | s >> 1) & UINT64_C(0x3333333333333333);
	s = (s | s >> 2) & UINT64_C(0x0f0f0f0f0f0f0f0f);
	s = (s | s >> 4) & UINT64_C(0x00ff00ff00ff00ff);
	s = (s | s >> 8) & UINT64_C(0x0000ffff0000ffff);
	s |= s >> 16;
	*ret_x = (int32_t)((uint32_t)s[1] ^ 0x80000000u);
	*ret_y = (int32_t)((uint32_t)s[0] ^ 0x80000000u);
}

/* The sort order of runs and segments: Morton key, z, class, returns, flags; source last. <0, 0, >0. */
int point_compare(const struct point *a, const struct point *b);

/* Sorts by point_compare with a radix sort; `scratch` has room for n records. The result is in `pts`.
 * Takes at most 48 KiB of stack. */
void point_sort(struct point *pts, struct point *scratch, size_t n);

#endif
