/*
 * The item POINT10: the first 20 bytes of the point formats 0 to 5, versions 1 and 2.
 *
 * Model of version 2: one symbol gives the fields, of six, that differ from the previous record. x and y are corrections of a
 * median of earlier differences, z is a correction of the last height; each kind of return has its own. The number of bits of x
 * chooses the context of y, both together that of z.
 *
 * The tables of contexts are part of the format (LASzip, laszip_common_v2.hpp).
 */
#ifndef LAZ_POINT10_H
#define LAZ_POINT10_H

#include "laz_items.h"

#include <stdalign.h>

enum { FLAGS = 14, CLASS = 15, ANGLE = 16, USER = 17, SOURCE = 18 }; /* places in the item */

/* Contexts by number of returns and return number. */
static const uint8_t return_map[8][8] = {
	{15, 14, 13, 12, 11, 10, 9, 8},  {14, 0, 1, 3, 6, 10, 10, 9},    {13, 1, 2, 4, 7, 11, 11, 10},
	{12, 3, 4, 5, 8, 12, 12, 11},    {11, 6, 7, 8, 9, 13, 13, 12},   {10, 10, 11, 12, 13, 14, 14, 13},
	{9, 10, 11, 12, 13, 14, 15, 14}, {8, 9, 10, 11, 12, 13, 14, 15},
};

/* Fields whose value is coded by the value before: a model for each value. */
#define BY_VALUE (256 * LAZ_MODEL_BYTES(256))

struct point10 {
	uint32_t x, y, z;
	uint8_t last[20];
	uint16_t intensity[16];
	int32_t height[8];
	struct laz_median dx_median[16], dy_median[16];
	int32_t last_dx[3], last_dy[3]; /* version 1: the last three */
	unsigned turn;
	alignas(16) uint8_t changed[LAZ_MODEL_BYTES(64)];
	alignas(16) uint8_t dx[LAZ_INT_BYTES(32, 2)];
	alignas(16) uint8_t dy[LAZ_INT_BYTES(32, 22)];
	alignas(16) uint8_t dz[LAZ_INT_BYTES(32, 20)];
	alignas(16) uint8_t ints[LAZ_INT_BYTES(16, 4)];
	alignas(16) uint8_t source[LAZ_INT_BYTES(16, 1)];
	alignas(16) uint8_t angle[2 * LAZ_MODEL_BYTES(256) + LAZ_INT_BYTES(8, 2)];
	alignas(16) uint8_t flags[BY_VALUE];
	alignas(16) uint8_t classes[BY_VALUE];
	alignas(16) uint8_t user[BY_VALUE];
};

static size_t point10_bytes(unsigned size)
{
	return sizeof(struct point10);
}

static struct laz_model *laz_point10_model(uint8_t *at)
{
	return (struct laz_model *)at;
}

static struct laz_int *laz_point10_integer(uint8_t *at)
{
	return (struct laz_int *)at;
}

static void laz_point10_begin(struct point10 *p, const uint8_t *first)
{
	memcpy(p->last, first, 20);
	p->x = laz_get32(first);
	p->y = laz_get32(first + 4);
	p->z = laz_get32(first + 8);
	laz_model_reset(laz_point10_model(p->changed));
	laz_models_reset(laz_point10_model(p->flags), 256, 256);
	laz_models_reset(laz_point10_model(p->classes), 256, 256);
	laz_models_reset(laz_point10_model(p->user), 256, 256);
	laz_int_reset(laz_point10_integer(p->source), 16, 1);
}

LAZ_INLINE void laz_point10_give(struct point10 *p, uint8_t *item)
{
	laz_put32(p->last, p->x);
	laz_put32(p->last + 4, p->y);
	laz_put32(p->last + 8, p->z);
	memcpy(item, p->last, 20);
}

LAZ_INLINE void laz_point10_by_value(struct laz_coder *c, uint8_t *models, uint8_t *value)
{
	*value = (uint8_t)laz_symbol_lazy(c, laz_model_at(laz_point10_model(models), 256, *value), 256);
}

LAZ_INLINE void laz_point10_read_source(struct laz_coder *c, struct point10 *p)
{
	unsigned k;

	laz_put16(p->last + SOURCE,
		  (uint32_t)laz_int_read(c, laz_point10_integer(p->source), 16, 1, laz_get16(p->last + SOURCE), 0, &k));
}

/* --- version 1 --- */

static void laz_point10_begin_v1(void *state, const uint8_t *first, unsigned size)
{
	struct point10 *p = state;

	laz_point10_begin(p, first);
	memset(p->last_dx, 0, sizeof p->last_dx);
	memset(p->last_dy, 0, sizeof p->last_dy);
	p->turn = 0;
	laz_int_reset(laz_point10_integer(p->dx), 32, 1);
	laz_int_reset(laz_point10_integer(p->dy), 32, 20);
	laz_int_reset(laz_point10_integer(p->dz), 32, 20);
	laz_int_reset(laz_point10_integer(p->ints), 16, 1);
	laz_int_reset(laz_point10_integer(p->angle), 8, 2);
}

LAZ_INLINE int32_t laz_point10_median3(const int32_t v[3])
{
	int32_t low = v[0] < v[1] ? v[0] : v[1], high = v[0] < v[1] ? v[1] : v[0];

	return v[2] < low ? low : v[2] > high ? high : v[2];
}

LAZ_INLINE int laz_point10_read_v1(void *state, struct laz_window *w, struct laz_coder *coder, uint8_t *item, unsigned size,
				   struct err *err)
{
	struct point10 *p = state;
	struct laz_coder c = laz_coder_copy(coder);
	unsigned kx, ky, k, changed;
	int32_t dx, dy;

	dx = laz_int_read(&c, laz_point10_integer(p->dx), 32, 1, laz_point10_median3(p->last_dx), 0, &kx);
	dy = laz_int_read(&c, laz_point10_integer(p->dy), 32, 20, laz_point10_median3(p->last_dy), kx < 19 ? kx : 19, &ky);
	p->x += (uint32_t)dx;
	p->y += (uint32_t)dy;
	kx = (kx + ky) / 2;
	p->z = (uint32_t)laz_int_read(&c, laz_point10_integer(p->dz), 32, 20, (int32_t)p->z, kx < 19 ? kx : 19, &k);
	changed = laz_symbol_lazy(&c, laz_point10_model(p->changed), 64);
	if (changed & 32)
		laz_put16(p->last + 12,
			  (uint32_t)laz_int_read(&c, laz_point10_integer(p->ints), 16, 1, laz_get16(p->last + 12), 0, &k));
	if (changed & 16)
		laz_point10_by_value(&c, p->flags, &p->last[FLAGS]);
	if (changed & 8)
		laz_point10_by_value(&c, p->classes, &p->last[CLASS]);
	if (changed & 4)
		p->last[ANGLE] = (uint8_t)laz_int_read(&c, laz_point10_integer(p->angle), 8, 2, p->last[ANGLE], kx < 3, &k);
	if (changed & 2)
		laz_point10_by_value(&c, p->user, &p->last[USER]);
	if (changed & 1)
		laz_point10_read_source(&c, p);
	p->last_dx[p->turn] = dx;
	p->last_dy[p->turn] = dy;
	p->turn = p->turn == 2 ? 0 : p->turn + 1;
	laz_point10_give(p, item);
	*coder = c;
	return 0;
}

/* --- version 2 --- */

static void laz_point10_begin_v2(void *state, const uint8_t *first, unsigned size)
{
	struct point10 *p = state;

	laz_point10_begin(p, first);
	laz_put16(p->last + 12, 0); /* as the encoder does */
	memset(p->intensity, 0, sizeof p->intensity);
	memset(p->height, 0, sizeof p->height);
	for (unsigned i = 0; i < 16; i++) {
		laz_median_init(&p->dx_median[i]);
		laz_median_init(&p->dy_median[i]);
	}
	laz_int_reset(laz_point10_integer(p->dx), 32, 2);
	laz_int_reset(laz_point10_integer(p->dy), 32, 22);
	laz_int_reset(laz_point10_integer(p->dz), 32, 20);
	laz_int_reset(laz_point10_integer(p->ints), 16, 4);
	laz_models_reset(laz_point10_model(p->angle), 256, 2);
}

/* The fields named by the symbol `changed`, except flags and intensity. */
LAZ_INLINE void laz_point10_read_changed(struct laz_coder *c, struct point10 *p, unsigned changed)
{
	if (changed & 8)
		laz_point10_by_value(c, p->classes, &p->last[CLASS]);
	if (changed & 4)
		p->last[ANGLE] =
			(uint8_t)(p->last[ANGLE] +
				  laz_symbol_lazy(c, laz_model_at(laz_point10_model(p->angle), 256, p->last[FLAGS] >> 6 & 1),
						  256));
	if (changed & 2)
		laz_point10_by_value(c, p->user, &p->last[USER]);
	if (changed & 1)
		laz_point10_read_source(c, p);
}

LAZ_INLINE int laz_point10_read_v2(void *state, struct laz_window *w, struct laz_coder *coder, uint8_t *item, unsigned size,
				   struct err *err)
{
	struct point10 *p = state;
	struct laz_coder c = laz_coder_copy(coder);
	unsigned changed = laz_symbol_lazy(&c, laz_point10_model(p->changed), 64), r, n, map, level, single, k, kx, ky;
	int32_t d;

	if (changed & 32)
		laz_point10_by_value(&c, p->flags, &p->last[FLAGS]);
	r = p->last[FLAGS] & 7;
	n = p->last[FLAGS] >> 3 & 7;
	map = return_map[n][r];
	level = n > r ? n - r : r - n;
	single = n == 1;
	if (changed & 16)
		p->intensity[map] =
			(uint16_t)laz_int_read(&c, laz_point10_integer(p->ints), 16, 4, p->intensity[map], map < 3 ? map : 3, &k);
	if (changed)
		laz_put16(p->last + 12, p->intensity[map]);
	if (changed & 15)
		laz_point10_read_changed(&c, p, changed);

	d = laz_int_read(&c, laz_point10_integer(p->dx), 32, 2, p->dx_median[map].v[2], single, &kx);
	p->x += (uint32_t)d;
	laz_median_add(&p->dx_median[map], d);
	d = laz_int_read(&c, laz_point10_integer(p->dy), 32, 22, p->dy_median[map].v[2], single + (kx < 20 ? kx & ~1u : 20), &ky);
	p->y += (uint32_t)d;
	laz_median_add(&p->dy_median[map], d);
	k = (kx + ky) / 2;
	p->height[level] =
		laz_int_read(&c, laz_point10_integer(p->dz), 32, 20, p->height[level], single + (k < 18 ? k & ~1u : 18), &k);
	p->z = (uint32_t)p->height[level];
	laz_point10_give(p, item);
	*coder = c;
	return 0;
}

static const struct laz_item_row laz_point10_v1 = {LAZ_POINT10, 1, point10_bytes, laz_point10_begin_v1, laz_point10_read_v1};
static const struct laz_item_row laz_point10_v2 = {LAZ_POINT10, 2, point10_bytes, laz_point10_begin_v2, laz_point10_read_v2};

#endif
