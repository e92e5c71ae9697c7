/*
 * The item RGB12: three colours of 16 bits, versions 1 and 2. A symbol gives the bytes, of six, that differ from the previous
 * record. Version 2 predicts the change of green from that of red, and that of blue from both; one more bit means that the three
 * are equal.
 */
#ifndef LAZ_RGB12_H
#define LAZ_RGB12_H

#include "laz_items.h"

#include <stdalign.h>

struct rgb12 {
	uint8_t last[6]; /* low and high byte of red, green, blue */
	alignas(16) uint8_t used[LAZ_MODEL_BYTES(128)];
	alignas(16) uint8_t diff[6 * LAZ_MODEL_BYTES(256)];
	alignas(16) uint8_t ints[LAZ_INT_BYTES(8, 6)];
};

static size_t rgb12_bytes(unsigned size)
{
	return sizeof(struct rgb12);
}

static void laz_rgb12_begin(void *state, const uint8_t *first, unsigned size)
{
	struct rgb12 *s = state;

	memcpy(s->last, first, sizeof s->last);
	laz_model_reset((struct laz_model *)s->used);
	laz_models_reset((struct laz_model *)s->diff, 256, 6);
	laz_int_reset((struct laz_int *)s->ints, 8, 6);
}

LAZ_INLINE int laz_rgb12_read_v1(void *state, struct laz_window *w, struct laz_coder *coder, uint8_t *item, unsigned size,
				 struct err *err)
{
	struct rgb12 *s = state;
	struct laz_coder c = laz_coder_copy(coder);
	unsigned used = laz_symbol_lazy(&c, (struct laz_model *)s->used, 64), k;

	for (unsigned i = 0; i < 6; i++)
		if (used >> i & 1)
			s->last[i] = (uint8_t)laz_int_read(&c, (struct laz_int *)s->ints, 8, 6, s->last[i], i, &k);
	memcpy(item, s->last, 6);
	*coder = c;
	return 0;
}

LAZ_INLINE int laz_rgb12_clamp(int v)
{
	return v < 0 ? 0 : v > 255 ? 255 : v;
}

/* Byte i: what the correction makes of the prediction. */
LAZ_INLINE int laz_rgb12_correct(struct laz_coder *c, struct rgb12 *s, unsigned i, int predicted)
{
	return (predicted + (int)laz_symbol_lazy(c, laz_model_at((struct laz_model *)s->diff, 256, i), 256)) & 255;
}

LAZ_INLINE int laz_rgb12_read_v2(void *state, struct laz_window *w, struct laz_coder *coder, uint8_t *item, unsigned size,
				 struct err *err)
{
	struct rgb12 *s = state;
	struct laz_coder c = laz_coder_copy(coder);
	unsigned used = laz_symbol_lazy(&c, (struct laz_model *)s->used, 128);
	uint8_t now[6];

	memcpy(now, s->last, sizeof now);
	for (unsigned i = 0; i < 2; i++)
		if (used >> i & 1)
			now[i] = (uint8_t)laz_rgb12_correct(&c, s, i, now[i]);
	if (!(used & 64)) {
		memcpy(now + 2, now, 2);
		memcpy(now + 4, now, 2);
	}
	for (unsigned i = 0; used & 64 && i < 2; i++) { /* low bytes, then high ones */
		int d = now[i] - s->last[i];

		if (used >> (2 + i) & 1)
			now[2 + i] = (uint8_t)laz_rgb12_correct(&c, s, 2 + i, laz_rgb12_clamp(d + s->last[2 + i]));
		d = (d + now[2 + i] - s->last[2 + i]) / 2;
		if (used >> (4 + i) & 1)
			now[4 + i] = (uint8_t)laz_rgb12_correct(&c, s, 4 + i, laz_rgb12_clamp(d + s->last[4 + i]));
	}
	memcpy(s->last, now, sizeof now);
	memcpy(item, now, sizeof now);
	*coder = c;
	return 0;
}

static const struct laz_item_row laz_rgb12_v1 = {LAZ_RGB12, 1, rgb12_bytes, laz_rgb12_begin, laz_rgb12_read_v1};
static const struct laz_item_row laz_rgb12_v2 = {LAZ_RGB12, 2, rgb12_bytes, laz_rgb12_begin, laz_rgb12_read_v2};

#endif
