/*
 * The items of point-wise chunks (compressors 1 and 2): each knows its memory, its state at the beginning of a
 * chunk, and how to decode the next one. All items of a record share one stream. The frequent ones are headers, so that
 * laz_pointwise.c can decode all items of a record in one function.
 */
#ifndef LAZ_ITEMS_H
#define LAZ_ITEMS_H

#include "laz.h"
#include "laz_coder.h"

struct laz_item_row {
	uint16_t type, version;
	size_t (*bytes)(unsigned size);
	/* A new chunk, whose first record has the item `first` of `size` bytes. */
	void (*begin)(void *state, const uint8_t *first, unsigned size);
	/* The next item; takes at most LAZ_GUARD / 2 bytes before or without laz_window_ready. */
	int (*read)(void *state, struct laz_window *, struct laz_coder *, uint8_t *item, unsigned size, struct err *err);
};

extern const struct laz_item_row laz_wavepacket13_v1, laz_byte_v1, laz_byte_v2;

/* NULL: no such item in this version. */
const struct laz_item_row *laz_item_find(unsigned type, unsigned version);

/* Little-endian numbers in records, at any place. */
LAZ_INLINE uint16_t laz_get16(const uint8_t *at)
{
	return (uint16_t)(at[0] | at[1] << 8);
}

LAZ_INLINE uint32_t laz_get32(const uint8_t *at)
{
	return at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

LAZ_INLINE uint64_t laz_get64(const uint8_t *at)
{
	return laz_get32(at) | (uint64_t)laz_get32(at + 4) << 32;
}

LAZ_INLINE void laz_put16(uint8_t *at, uint32_t v)
{
	at[0] = (uint8_t)v;
	at[1] = (uint8_t)(v >> 8);
}

LAZ_INLINE void laz_put32(uint8_t *at, uint32_t v)
{
	laz_put16(at, v);
	laz_put16(at + 2, v >> 16);
}

LAZ_INLINE void laz_put64(uint8_t *at, uint64_t v)
{
	laz_put32(at, (uint32_t)v);
	laz_put32(at + 4, (uint32_t)(v >> 32));
}

/* The median of the last five values, near enough: LASzip's streaming median. A new value replaces in turn the
 * largest and the smallest of five, the turn changing when it lies on the side of those that stay. */
struct laz_median {
	int32_t v[5]; /* sorted; v[2] is the prediction */
	uint32_t low; /* 0: the largest goes next, 1: the smallest */
};

static inline void laz_median_init(struct laz_median *m)
{
	*m = (struct laz_median){0};
}

/* Without branches: what is added is noise. */
LAZ_INLINE void laz_median_add(struct laz_median *m, int32_t v)
{
	const int32_t *old = m->v + m->low;
	int32_t a = old[0], b = old[1], c = old[2], d = old[3], middle = m->v[2];

#define LESS(p, q) ((p) < (q) ? (p) : (q))
#define MORE(p, q) ((p) < (q) ? (q) : (p))
	m->v[0] = LESS(a, v);
	m->v[1] = MORE(a, LESS(b, v));
	m->v[2] = MORE(b, LESS(c, v));
	m->v[3] = MORE(c, LESS(d, v));
	m->v[4] = MORE(d, v);
#undef LESS
#undef MORE
	m->low = (uint32_t)(v > middle) | (~m->low & (uint32_t)(v == middle));
}

#endif
