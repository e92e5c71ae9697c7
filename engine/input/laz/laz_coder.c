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

/*
 * The entries [t, end) of the table, `end` is returned. The first 16 bytes are written at once, without a look at the end: what
 * is too many belongs to the next symbols, which are written later, or to the padding behind the table.
 */
static unsigned fill(uint8_t *table, unsigned t, unsigned end, unsigned symbol)
{
	memset(table + t, (int)symbol, 16);
	if (end > t + 16)
		memset(table + t + 16, (int)symbol, end - t - 16);
	return end;
}

static unsigned fill_wide(uint16_t *table, unsigned t, unsigned end, unsigned symbol)
{
	for (unsigned i = 0; i < 8; i++)
		table[t + i] = (uint16_t)symbol;
	for (t += 8; t < end; t++)
		table[t] = (uint16_t)symbol;
	return end;
}

/* Borders, table and guess from the counts, whose sum is m->total. */
static void settle(struct laz_model *m, unsigned layout)
{
	uint16_t *words = (uint16_t *)(m + 1), *border = words + LAZ_BORDERS(layout);
	const uint16_t *count = words + LAZ_COUNTS(layout);
	uint32_t scale = UINT32_C(0x80000000) / m->total, sum = 0;
	unsigned n = m->last + 1u, guess = 0, shift = LAZ_SHIFT(layout), entries = (1u << (15 - shift)) + 1, t = 0;

	for (unsigned i = 0; i < n; i++) {
		border[i] = (uint16_t)(sum >> 16);
		sum += scale * count[i];
		guess = count[i] > count[guess] ? i : guess;
	}
	m->guess = (uint16_t)(count[guess] * GUESS_WORTH >= m->total ? guess : LAZ_NO_GUESS);
	for (unsigned i = 0; i < n; i++) {
		unsigned end = i + 1 < n ? (border[i + 1] + (1u << shift) - 1) >> shift : entries;

		t = LAZ_WIDE(layout) ? fill_wide(words, t, end, i) : fill((uint8_t *)words, t, end, i);
	}
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
