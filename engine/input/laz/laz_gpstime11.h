/*
 * The item GPSTIME11: 8 bytes, versions 1 and 2. The bits of the double are taken as a 64-bit integer.
 *
 * Model: a time is the previous one plus a multiple of the usual difference, plus a correction. The symbol gives the multiple, or
 * means that nothing changed, or that the time is stored in full. Version 2 has four sequences of times and can switch between
 * them.
 */
#ifndef LAZ_GPSTIME11_H
#define LAZ_GPSTIME11_H

#include "laz_items.h"

#include <stdalign.h>

enum { MULTIPLE_MAX_V1 = 512 };
enum { MULTIPLE = 500, MINUS = 10, UNCHANGED = MULTIPLE + MINUS + 1, FULL = UNCHANGED + 1, SYMBOLS = FULL + 4 };

/* A multiple that is beyond the range becomes the usual difference when it comes this often. */
enum { EXTREME_MAX = 3 };

struct sequence {
	uint64_t time;
	int32_t diff, extremes;
};

struct gpstime {
	struct sequence seq[4];
	unsigned last, next;
	alignas(16) uint8_t multiple[LAZ_MODEL_BYTES(SYMBOLS)];
	alignas(16) uint8_t still[LAZ_MODEL_BYTES(6)]; /* instead, while the difference is 0 */
	alignas(16) uint8_t ints[LAZ_INT_BYTES(32, 9)];
};

static size_t gpstime_bytes(unsigned size)
{
	return sizeof(struct gpstime);
}

static void laz_gpstime11_begin(struct gpstime *g, const uint8_t *first, unsigned contexts)
{
	memset(g->seq, 0, sizeof g->seq);
	g->seq[0].time = laz_get64(first);
	g->last = g->next = 0;
	laz_model_reset((struct laz_model *)g->multiple);
	laz_model_reset((struct laz_model *)g->still);
	laz_int_reset((struct laz_int *)g->ints, 32, contexts);
}

/* An extreme multiple came. */
LAZ_INLINE void laz_gpstime11_extreme(struct sequence *s, int32_t diff)
{
	if (++s->extremes > EXTREME_MAX) {
		s->diff = diff;
		s->extremes = 0;
	}
}

LAZ_INLINE int32_t laz_gpstime11_times(int32_t diff, int32_t by)
{
	return (int32_t)((uint32_t)diff * (uint32_t)by);
}

/* --- version 1 --- */

static void laz_gpstime11_begin_v1(void *state, const uint8_t *first, unsigned size)
{
	laz_gpstime11_begin(state, first, 6);
}

LAZ_INLINE int32_t laz_gpstime11_read_int_v1(struct laz_coder *c, struct gpstime *g, int32_t predicted, unsigned context)
{
	unsigned k;

	return laz_int_read(c, (struct laz_int *)g->ints, 32, 6, predicted, context, &k);
}

LAZ_INLINE void laz_gpstime11_step_v1(struct laz_coder *c, struct gpstime *g, struct sequence *s, int32_t m)
{
	int32_t d;

	if (m == 0) {
		d = laz_gpstime11_read_int_v1(c, g, s->diff / 4, 2);
		laz_gpstime11_extreme(s, d);
	} else if (m == 1) {
		d = laz_gpstime11_read_int_v1(c, g, s->diff, 1);
		s->diff = d;
		s->extremes = 0;
	} else {
		d = laz_gpstime11_read_int_v1(c, g, laz_gpstime11_times(s->diff, m), m < 10 ? 3 : m < 50 ? 4 : 5);
		if (m == MULTIPLE_MAX_V1 - 3)
			laz_gpstime11_extreme(s, d);
	}
	s->time += (uint64_t)(int64_t)d;
}

LAZ_INLINE int laz_gpstime11_read_v1(void *state, struct laz_window *w, struct laz_coder *coder, uint8_t *item, unsigned size,
				     struct err *err)
{
	struct gpstime *g = state;
	struct sequence *s = &g->seq[0];
	struct laz_coder c = laz_coder_copy(coder);

	if (s->diff == 0) {
		unsigned m = laz_symbol_lazy(&c, (struct laz_model *)g->still, 3);

		if (m == 1) {
			s->diff = laz_gpstime11_read_int_v1(&c, g, 0, 0);
			s->time += (uint64_t)(int64_t)s->diff;
		} else if (m == 2) {
			s->time = laz_u64(&c);
		}
	} else {
		unsigned m = laz_symbol_lazy(&c, (struct laz_model *)g->multiple, MULTIPLE_MAX_V1);

		if (m < MULTIPLE_MAX_V1 - 2)
			laz_gpstime11_step_v1(&c, g, s, (int32_t)m);
		else if (m == MULTIPLE_MAX_V1 - 2)
			s->time = laz_u64(&c);
	}
	laz_put64(item, s->time);
	*coder = c;
	return 0;
}

/* --- version 2 --- */

static void laz_gpstime11_begin_v2(void *state, const uint8_t *first, unsigned size)
{
	laz_gpstime11_begin(state, first, 9);
}

LAZ_INLINE int32_t laz_gpstime11_read_int(struct laz_coder *c, struct gpstime *g, int32_t predicted, unsigned context)
{
	unsigned k;

	return laz_int_read(c, (struct laz_int *)g->ints, 32, 9, predicted, context, &k);
}

static __attribute__((noinline)) void laz_gpstime11_full(struct laz_coder *c, struct gpstime *g)
{
	uint64_t high = (uint32_t)laz_gpstime11_read_int(c, g, (int32_t)(g->seq[g->last].time >> 32), 8);

	g->next = (g->next + 1) & 3;
	g->last = g->next;
	g->seq[g->last] = (struct sequence){.time = high << 32 | laz_u32(c)};
}

/* A time in full, in the next sequence. It is rare: a copy of the coder, so that the caller's can stay in registers. */
LAZ_INLINE void laz_gpstime11_read_full(struct laz_coder *coder, struct gpstime *g)
{
	struct laz_coder c = *coder;

	laz_gpstime11_full(&c, g);
	*coder = laz_coder_copy(&c);
}

/* The multiple m of the difference, 0 and 2 to 510. */
LAZ_INLINE void laz_gpstime11_step(struct laz_coder *c, struct gpstime *g, struct sequence *s, int32_t m)
{
	int32_t by = m <= MULTIPLE ? m : MULTIPLE - m, d;
	unsigned context = m == 0 ? 7 : m < 10 ? 2 : m < MULTIPLE ? 3 : m == MULTIPLE ? 4 : by > -MINUS ? 5 : 6;

	d = laz_gpstime11_read_int(c, g, laz_gpstime11_times(s->diff, by), context);
	if (m == 0 || by == MULTIPLE || by == -MINUS)
		laz_gpstime11_extreme(s, d);
	s->time += (uint64_t)(int64_t)d;
}

/* True: another sequence was chosen, and the time is still to come. */
LAZ_INLINE bool laz_gpstime11_read_time(struct laz_coder *c, struct gpstime *g)
{
	struct sequence *s = &g->seq[g->last];
	unsigned m;

	if (s->diff == 0) {
		m = laz_symbol_lazy(c, (struct laz_model *)g->still, 6);
		if (m == 1) {
			s->diff = laz_gpstime11_read_int(c, g, 0, 0);
			s->time += (uint64_t)(int64_t)s->diff;
			s->extremes = 0;
		} else if (m == 2) {
			laz_gpstime11_read_full(c, g);
		} else if (m > 2) {
			g->last = (g->last + m - 2) & 3;
			return true;
		}
		return false;
	}
	m = laz_symbol_lazy(c, (struct laz_model *)g->multiple, SYMBOLS);
	if (m == 1) {
		s->time += (uint64_t)(int64_t)laz_gpstime11_read_int(c, g, s->diff, 1);
		s->extremes = 0;
	} else if (m < UNCHANGED) {
		laz_gpstime11_step(c, g, s, (int32_t)m);
	} else if (m == FULL) {
		laz_gpstime11_read_full(c, g);
	} else if (m > FULL) {
		g->last = (g->last + m - FULL) & 3;
		return true;
	}
	return false;
}

LAZ_INLINE int laz_gpstime11_read_v2(void *state, struct laz_window *w, struct laz_coder *coder, uint8_t *item, unsigned size,
				     struct err *err)
{
	struct gpstime *g = state;
	struct laz_coder c = laz_coder_copy(coder);
	unsigned turns = 0;

	/* an encoder switches sequences at most once for each time */
	while (laz_gpstime11_read_time(&c, g)) {
		if (++turns == 4) {
			c.bad = 1;
			break;
		}
	}
	laz_put64(item, g->seq[g->last].time);
	*coder = c;
	return 0;
}

static const struct laz_item_row laz_gpstime11_v1 = {LAZ_GPSTIME11, 1, gpstime_bytes, laz_gpstime11_begin_v1,
						     laz_gpstime11_read_v1};
static const struct laz_item_row laz_gpstime11_v2 = {LAZ_GPSTIME11, 2, gpstime_bytes, laz_gpstime11_begin_v2,
						     laz_gpstime11_read_v2};

#endif
