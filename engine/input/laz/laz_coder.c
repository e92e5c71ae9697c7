/*
 * The parts of the arithmetic decoder that run rarely: first states and updates of models.
 *
 * The arithmetic is exactly that of LASzip, since decoder and encoder must have the same states. Only the layout differs: borders
 * and counts are 16-bit numbers. That is enough, because the counts of a model are halved when their sum exceeds 2^15, and at
 * most 8 * (1024 + 6) symbols come between updates.
 */
#include "laz_coder.h"

#include "err.h"

enum { COUNT_MAX = 1 << 15, BIT_COUNT_MAX = 1 << 13, BIT_CYCLE_MAX = 64 };
/* The most frequent symbol is looked at first if it is at least one in so many. */
enum { GUESS_WORTH = 3 };

_Static_assert(sizeof(struct laz_model) == 16 && sizeof(struct laz_bit_model) <= 16, "multiples of 16");

int laz_coder_begin(struct laz_window *w, struct err *err)
{
	uint8_t b[4];
	int rc = laz_window_take(w, b, sizeof b, err);

	if (rc)
		return rc;
	w->coder.value = (uint32_t)b[0] << 24 | (uint32_t)b[1] << 16 | (uint32_t)b[2] << 8 | b[3];
	w->coder.length = UINT32_MAX;
	w->coder.bad = w->coder.value == UINT32_MAX;
	/* The value is in [0, length) from the first symbol on. If it were not, the difference would grow with each symbol, and
	 * the search for symbols would leave the models. So nothing may be decoded from such a stream. */
	return laz_window_check(w, err);
}

static void bit_init(struct laz_bit_model *m)
{
	*m = (struct laz_bit_model){.p0 = 1u << 12, .zeros = 1, .bits = 2, .left = 4, .cycle = 4};
}

void laz_bit_update(struct laz_bit_model *m)
{
	unsigned bits = m->bits + m->cycle, zeros = m->zeros, cycle = 5u * m->cycle >> 2;

	if (bits > BIT_COUNT_MAX) {
		bits = (bits + 1) >> 1;
		zeros = (zeros + 1) >> 1;
		bits += zeros == bits;
	}
	m->bits = (uint16_t)bits;
	m->zeros = (uint16_t)zeros;
	m->p0 = zeros * (UINT32_C(0x80000000) / bits) >> 18;
	m->left = m->cycle = (uint16_t)(cycle < BIT_CYCLE_MAX ? cycle : BIT_CYCLE_MAX);
}

/* The entries [t, end) of the table; `end` is returned. At least 16 are written, without a look at the end: what is too many
 * belongs to the next symbols, which are written later, or to the padding behind the table. */
LAZ_INLINE unsigned fill(uint16_t *words, unsigned layout, unsigned t, unsigned end, unsigned symbol)
{
	unsigned step = LAZ_WIDE(layout) ? 4 : 8;
	uint64_t eight = symbol * (LAZ_WIDE(layout) ? UINT64_C(0x0001000100010001) : UINT64_C(0x0101010101010101));
	uint8_t *at = (uint8_t *)words + t * (8 / step);

	memcpy(at, &eight, 8);
	memcpy(at + 8, &eight, 8);
	for (unsigned i = t + 2 * step; laz_unlikely(i < end); i += step)
		memcpy((uint8_t *)words + i * (8 / step), &eight, 8);
	return end;
}

/* Borders, table and guess from the counts, whose sum is m->total. */
LAZ_INLINE void settle_layout(struct laz_model *m, unsigned layout)
{
	uint16_t *words = (uint16_t *)(m + 1), *border = words + LAZ_BORDERS(layout);
	const uint16_t *count = words + LAZ_COUNTS(layout);
	uint32_t scale = UINT32_C(0x80000000) / m->total, sum = 0;
	unsigned n = m->last + 1u, guess = 0, most = 0, shift = LAZ_SHIFT(layout), t = 0;

	for (unsigned i = 0; i < n; i++) {
		unsigned times = count[i];

		border[i] = (uint16_t)(sum >> 16);
		sum += scale * times;
		guess = __builtin_expect_with_probability(times > most, 1, 0.5) ? i : guess;
		most = times > most ? times : most;
		t = fill(words, layout, t, ((sum >> 16) + (1u << shift) - 1) >> shift, i);
	}
	fill(words, layout, t, (1u << (15 - shift)) + 1, n - 1);
	m->guess = (uint16_t)(most * GUESS_WORTH >= m->total ? guess : LAZ_NO_GUESS);
}

/* The layouts that are updated most, as constants. */
static void settle(struct laz_model *m, unsigned layout)
{
	if (layout == 256)
		settle_layout(m, 256);
	else if (layout == 33)
		settle_layout(m, 33);
	else
		settle_layout(m, layout);
}

void laz_model_init(struct laz_model *m, unsigned layout, unsigned symbols)
{
	uint16_t *words = (uint16_t *)(m + 1), *border = words + LAZ_BORDERS(layout), *count = words + LAZ_COUNTS(layout);

	for (unsigned i = symbols; i < LAZ_UP16(layout + LAZ_STEPS); i++)
		border[i] = LAZ_BEYOND;
	for (unsigned i = 0; i < symbols; i++)
		count[i] = 1;
	m->last = (uint16_t)(symbols - 1);
	m->total = symbols;
	m->left = m->cycle = (uint16_t)((symbols + 6) >> 1);
	settle(m, layout);
}

unsigned laz_search_far(uint32_t v, const uint16_t *border, unsigned sym, unsigned last)
{
	while (sym < last) {
		unsigned middle = (sym + last + 1) / 2;

		if (v >= border[middle])
			sym = middle;
		else
			last = middle - 1;
	}
	return sym;
}

void laz_model_update(struct laz_model *m, unsigned layout)
{
	uint16_t *count = (uint16_t *)(m + 1) + LAZ_COUNTS(layout);
	unsigned n = m->last + 1u, cycle = 5u * m->cycle >> 2, max = (n + 6) << 3;

	m->total += m->cycle;
	if (m->total > COUNT_MAX) {
		m->total = 0;
		for (unsigned i = 0; i < n; i++)
			m->total += count[i] = (uint16_t)((count[i] + 1) >> 1);
	}
	settle(m, layout);
	m->left = m->cycle = (uint16_t)(cycle < max ? cycle : max);
}

void laz_models_reset(struct laz_model *m, unsigned n, unsigned count)
{
	for (unsigned i = 0; i < count; i++)
		laz_model_reset(laz_model_at(m, n, i));
}

void laz_int_reset(struct laz_int *in, unsigned bits, unsigned contexts)
{
	uint8_t *zero = (uint8_t *)in + LAZ_INT_BITS_AT(contexts, bits);

	laz_models_reset((struct laz_model *)in, bits + 1, contexts);
	bit_init((struct laz_bit_model *)zero);
	laz_models_reset((struct laz_model *)(zero + 16), 256, bits);
}
