/*
 * The item WAVEPACKET13: 29 bytes that say where the waveform of a record lies (index of its descriptor, byte
 * offset, size, place of the return, direction), version 1. Floats are taken as integers of the same bits.
 */
#include "laz_items.h"

#include <stdalign.h>

struct wavepacket {
	uint64_t offset;
	uint32_t size, value[4]; /* of the packet; place of the return, x, y, z */
	int32_t step;            /* last difference of offsets that was neither nothing nor the packet's size */
	unsigned kind;           /* last symbol of the offset */
	alignas(16) uint8_t index[LAZ_MODEL_BYTES(256)];
	alignas(16) uint8_t kinds[4 * LAZ_MODEL_BYTES(4)];
	alignas(16) uint8_t steps[LAZ_INT_BYTES(32, 1)];
	alignas(16) uint8_t sizes[LAZ_INT_BYTES(32, 1)];
	alignas(16) uint8_t places[LAZ_INT_BYTES(32, 1)];
	alignas(16) uint8_t directions[LAZ_INT_BYTES(32, 3)];
};

static size_t wavepacket_bytes(unsigned size)
{
	return sizeof(struct wavepacket);
}

static void begin_v1(void *state, const uint8_t *first, unsigned size)
{
	struct wavepacket *s = state;

	s->offset = laz_get64(first + 1);
	s->size = laz_get32(first + 9);
	for (unsigned i = 0; i < 4; i++)
		s->value[i] = laz_get32(first + 13 + 4 * i);
	s->step = 0;
	s->kind = 0;
	laz_model_reset((struct laz_model *)s->index);
	laz_models_reset((struct laz_model *)s->kinds, 4, 4);
	laz_int_reset((struct laz_int *)s->steps, 32, 1);
	laz_int_reset((struct laz_int *)s->sizes, 32, 1);
	laz_int_reset((struct laz_int *)s->places, 32, 1);
	laz_int_reset((struct laz_int *)s->directions, 32, 3);
}

static uint32_t read_int(struct laz_coder *c, uint8_t *in, uint32_t predicted)
{
	unsigned k;

	return (uint32_t)laz_int_read(c, (struct laz_int *)in, 32, 1, (int32_t)predicted, 0, &k);
}

static int read_v1(void *state, struct laz_window *w, struct laz_coder *c, uint8_t *item, unsigned size, struct err *err)
{
	struct wavepacket *s = state;
	unsigned k;

	item[0] = (uint8_t)laz_symbol_lazy(c, (struct laz_model *)s->index, 256);
	s->kind = laz_symbol_lazy(c, laz_model_at((struct laz_model *)s->kinds, 4, s->kind), 4);
	switch (s->kind) {
	case 0:
		break;
	case 1:
		s->offset += s->size;
		break;
	case 2:
		s->step = (int32_t)read_int(c, s->steps, (uint32_t)s->step);
		s->offset += (uint64_t)(int64_t)s->step;
		break;
	default:
		s->offset = laz_u64(c);
	}
	s->size = read_int(c, s->sizes, s->size);
	s->value[0] = read_int(c, s->places, s->value[0]);
	for (unsigned i = 0; i < 3; i++)
		s->value[1 + i] =
			(uint32_t)laz_int_read(c, (struct laz_int *)s->directions, 32, 3, (int32_t)s->value[1 + i], i, &k);
	laz_put64(item + 1, s->offset);
	laz_put32(item + 9, s->size);
	for (unsigned i = 0; i < 4; i++)
		laz_put32(item + 13 + 4 * i, s->value[i]);
	return 0;
}

const struct laz_item_row laz_wavepacket13_v1 = {LAZ_WAVEPACKET13, 1, wavepacket_bytes, begin_v1, read_v1};
