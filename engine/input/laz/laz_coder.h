/*
 * The arithmetic decoder of LASzip, its adaptive models and its coding of integers (A. Said, "Introduction to
 * Arithmetic Coding", HPL-2004-76; M. Isenburg, "LASzip", PE&RS 79(2), 2013). Total: any bytes give symbols,
 * at most 3 bytes are taken for each call of a laz_* function here (laz_int_read: 10, laz_u32: 4).
 *
 * Models lie in memory of the caller. Their size, and the way they are searched, follows from `n`, the number
 * of symbols, which is given again with every call: where it is a constant, so is the layout. A model that was
 * laz_model_reset gives itself its first state when laz_symbol_lazy meets it; laz_symbol needs laz_model_init.
 *
 * Use: `struct laz_coder c = w->coder;`, for each record laz_window_ready(w, &c, err) and then symbols from &c,
 * at last `w->coder = c` and laz_window_check. All hot functions are inlined so that c stays in registers.
 */
#ifndef LAZ_CODER_H
#define LAZ_CODER_H

#include <string.h>

#include "laz_window.h"

/* With sanitizers what is inlined takes minutes to compile. */
#if defined __has_feature
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define LAZ_INLINE static inline
#endif
#elif defined __SANITIZE_ADDRESS__ || defined __SANITIZE_THREAD__
#define LAZ_INLINE static inline
#endif
#ifndef LAZ_INLINE
#define LAZ_INLINE static inline __attribute__((always_inline))
#endif

/* The first four bytes of an entropy-coded stream, after laz_window_begin or laz_window_take. */
int laz_coder_begin(struct laz_window *, struct err *err);

/* Back to a length of at least 2^24: 0 to 3 bytes of the stream. */
LAZ_INLINE void laz_renorm(struct laz_coder *c)
{
	unsigned shift = (unsigned)__builtin_clz(c->length) & 24;
	uint32_t next;

	memcpy(&next, c->at, 4);
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
	next = __builtin_bswap32(next);
#endif
	c->value = (uint32_t)((((uint64_t)c->value << 32 | next) << shift) >> 32);
	c->length <<= shift;
	c->at += shift >> 3;
}

/* 1 to 19 raw bits. */
LAZ_INLINE uint32_t laz_bits19(struct laz_coder *c, unsigned n)
{
	uint32_t v;

	c->length >>= n;
	v = c->value / c->length;
	c->value -= v * c->length;
	c->bad |= v >> n;
	laz_renorm(c);
	return v & ((UINT32_C(1) << n) - 1);
}

LAZ_INLINE uint32_t laz_u16(struct laz_coder *c)
{
	return laz_bits19(c, 16);
}

LAZ_INLINE uint32_t laz_u32(struct laz_coder *c)
{
	uint32_t low = laz_u16(c);

	return low | laz_u16(c) << 16;
}

LAZ_INLINE uint64_t laz_u64(struct laz_coder *c)
{
	uint64_t low = laz_u32(c);

	return low | (uint64_t)laz_u32(c) << 32;
}

/* 1 to 32 raw bits. */
LAZ_INLINE uint32_t laz_bits(struct laz_coder *c, unsigned n)
{
	uint32_t low;

	if (n <= 19)
		return laz_bits19(c, n);
	low = laz_u16(c);
	return low | laz_bits19(c, n - 16) << 16;
}

/* A model of one bit. */
struct laz_bit_model {
	uint32_t p0;          /* probability of 0, times 2^13 */
	uint16_t zeros, bits; /* counts */
	uint16_t left, cycle; /* bits until the next update, between updates */
};

void laz_bit_update(struct laz_bit_model *);

LAZ_INLINE unsigned laz_bit(struct laz_coder *c, struct laz_bit_model *m)
{
	uint32_t x = m->p0 * (c->length >> 13);
	unsigned bit = c->value >= x;

	m->zeros = (uint16_t)(m->zeros + !bit);
	c->value -= x & -bit;
	c->length = x + ((c->length - 2 * x) & -bit);
	laz_renorm(c);
	if (laz_unlikely(--m->left == 0))
		laz_bit_update(m);
	return bit;
}

/*
 * A model of n symbols, 2 to 1024. Behind the head lie a table, the borders of the symbols in an interval of 2^15,
 * and their counts. Where the value lies in that interval, its upper bits choose an entry of the table: the symbol
 * in which the part of the interval with these bits begins. From there it is mostly one of the next few.
 */
struct laz_model {
	uint16_t last;  /* the largest symbol */
	uint16_t left;  /* symbols until the next update */
	uint16_t cycle; /* symbols between updates; 0: no state yet */
	uint16_t guess; /* the most frequent symbol at the last update, or LAZ_NO_GUESS */
	uint32_t total;
	uint32_t pad2;
};

#define LAZ_UP16(n) (((n) + 15u) & ~15u)
/* Entries of the table are one for each 2^LAZ_SHIFT of the interval, of one byte or two. */
#define LAZ_SHIFT(n) ((n) > 64 ? 7 : 9)
#define LAZ_WIDE(n) ((n) > 256)
/* Places in 16-bit numbers behind the head. */
#define LAZ_BORDERS(n) (((n) > 64 ? 136u : 40u) * (1 + LAZ_WIDE(n)))
#define LAZ_COUNTS(n) (LAZ_BORDERS(n) + LAZ_UP16((n) + LAZ_STEPS))
/* Bytes of a model of n symbols, as a constant; a multiple of 16. */
#define LAZ_MODEL_BYTES(n) (sizeof(struct laz_model) + 2 * (LAZ_COUNTS(n) + LAZ_UP16(n)))

enum { LAZ_STEPS = 4, LAZ_BEYOND = UINT16_MAX, LAZ_NO_GUESS = UINT16_MAX }; /* symbols looked at; border of what is no symbol */

/* `layout` is the n that is given to laz_symbol, and may be more than the number of symbols. */
void laz_model_init(struct laz_model *, unsigned layout, unsigned symbols);
void laz_model_update(struct laz_model *, unsigned layout);
/* No state: see laz_symbol_lazy. */
static inline void laz_model_reset(struct laz_model *m)
{
	m->cycle = 0;
}
/* The symbol of v, from `sym` up to `last`. */
unsigned laz_search_far(uint32_t v, const uint16_t *border, unsigned sym, unsigned last);
/* `count` models of n symbols, one behind the other. */
void laz_models_reset(struct laz_model *, unsigned n, unsigned count);

LAZ_INLINE struct laz_model *laz_model_at(struct laz_model *m, unsigned n, unsigned i)
{
	return (struct laz_model *)((uint8_t *)m + i * LAZ_MODEL_BYTES(n));
}

/* Borders of a symbol, and the symbol. */
struct laz_found {
	uint32_t low, high, sym;
};

/* To the next symbol, with the borders `high` and `next`, if v is in it or beyond. Compilers make a branch of it, which is
 * guessed wrongly all the time. */
LAZ_INLINE void laz_step_up(struct laz_found *f, uint32_t v, uint32_t high, uint32_t next)
{
#ifdef __x86_64__
	__asm__("cmp %[high], %[v]\n\tcmovae %[high], %[low]\n\tcmovae %[next], %[up]\n\tsbb $-1, %[sym]"
		: [low] "+r"(f->low), [up] "+r"(f->high), [sym] "+r"(f->sym)
		: [high] "r"(high), [next] "r"(next), [v] "r"(v)
		: "cc");
#else
	f->low = v >= high ? high : f->low;
	f->high = v >= high ? next : f->high;
	f->sym += v >= high;
#endif
}

/* The symbol in whose part of the interval the value lies. The borders come with it, since the next symbol waits for them: to
 * choose among those that were compared is faster than to load them by the symbol. */
LAZ_INLINE struct laz_found laz_search(uint32_t v, const uint16_t *words, unsigned n)
{
	const uint16_t *border = words + LAZ_BORDERS(n), *at;
	unsigned t = v >> LAZ_SHIFT(n), sym = LAZ_WIDE(n) ? words[t] : ((const uint8_t *)words)[t];
	struct laz_found f;

	at = border + sym;
	if (laz_unlikely(v >= at[LAZ_STEPS])) {
		sym = laz_search_far(v, border, sym + LAZ_STEPS, LAZ_WIDE(n) ? words[t + 1] : ((const uint8_t *)words)[t + 1]);
		return (struct laz_found){border[sym], border[sym + 1], sym};
	}
	f = (struct laz_found){at[0], at[1], sym};
	laz_step_up(&f, v, at[1], at[2]);
	laz_step_up(&f, v, at[2], at[3]);
	laz_step_up(&f, v, at[3], at[4]);
	return f;
}

/* The upper border of a symbol of the interval; that of the last one is the length. */
LAZ_INLINE uint32_t laz_upper(const struct laz_coder *c, const struct laz_model *m, uint32_t high, unsigned sym, uint32_t unit)
{
	uint32_t y = high * unit;

	return __builtin_expect_with_probability(sym == m->last, 1, 0.5) ? c->length : y;
}

/* A symbol of a model of layout n. `guess`: it is worth looking at the most frequent symbol first, which needs
 * no division and, guessed well, lets the processor go ahead. */
LAZ_INLINE unsigned laz_symbol_of(struct laz_coder *c, struct laz_model *m, unsigned n, bool guess)
{
	uint16_t *words = (uint16_t *)(m + 1), *border = words + LAZ_BORDERS(n), *count = words + LAZ_COUNTS(n);
	uint32_t unit = c->length >> 15, x, y;
	unsigned sym = m->guess;
	struct laz_found f;

	if (guess && sym != LAZ_NO_GUESS) {
		x = border[sym] * unit;
		y = laz_upper(c, m, border[sym + 1], sym, unit);
		if (laz_likely(c->value - x < y - x))
			goto found;
	}
	f = laz_search(c->value / unit, words, n);
	sym = f.sym;
	x = f.low * unit;
	y = laz_upper(c, m, f.high, sym, unit);
found:
	c->value -= x;
	c->length = y - x;
	laz_renorm(c);
	count[sym]++;
	if (laz_unlikely(--m->left == 0))
		laz_model_update(m, n);
	return sym;
}

LAZ_INLINE unsigned laz_symbol(struct laz_coder *c, struct laz_model *m, unsigned n)
{
	return laz_symbol_of(c, m, n, false);
}

LAZ_INLINE unsigned laz_symbol_lazy(struct laz_coder *c, struct laz_model *m, unsigned n)
{
	if (laz_unlikely(!m->cycle))
		laz_model_init(m, n, n);
	return laz_symbol_of(c, m, n, true);
}

/*
 * Integers of `bits` (8, 16 or 32) as corrections of a prediction, in `contexts` contexts. In memory: a model of
 * bits + 1 symbols for each context (how many bits the correction has), the model of the correction of no bits,
 * then one of layout 256 for each number of bits, of its upper 8 bits.
 */
struct laz_int;
#define LAZ_INT_BITS_AT(contexts, bits) ((contexts)*LAZ_MODEL_BYTES((bits) + 1))
#define LAZ_INT_BYTES(bits, contexts) (LAZ_INT_BITS_AT(contexts, bits) + 16 + (bits)*LAZ_MODEL_BYTES(256))

/* At the beginning of every chunk. */
void laz_int_reset(struct laz_int *, unsigned bits, unsigned contexts);

/* How many bits the correction has, 0 to `bits`. */
LAZ_INLINE unsigned laz_int_bits(struct laz_coder *c, struct laz_int *in, unsigned bits, unsigned context)
{
	return laz_symbol_lazy(c, laz_model_at((struct laz_model *)in, bits + 1, context), bits + 1);
}

/* The integer, of which the correction has k bits. */
LAZ_INLINE int32_t laz_int_value(struct laz_coder *c, struct laz_int *in, unsigned bits, unsigned contexts, int32_t predicted,
				 unsigned k)
{
	uint8_t *zero = (uint8_t *)in + LAZ_INT_BITS_AT(contexts, bits);
	struct laz_model *m;
	uint32_t v;

	if (k == 0) {
		v = laz_bit(c, (struct laz_bit_model *)zero);
	} else if (k < 32) {
		m = laz_model_at((struct laz_model *)(zero + 16), 256, k - 1);
		if (laz_unlikely(!m->cycle))
			laz_model_init(m, 256, k < 8 ? 1u << k : 256);
		v = laz_symbol(c, m, 256);
		if (k > 8)
			v = v << (k - 8) | laz_bits(c, k - 8);
		/* 0 to 2^k - 1, of which the lower half are -(2^k - 1) to -2^(k-1), the upper 2^(k-1) + 1 to 2^k */
		v += 1 - ((UINT32_C(1) << k) & ((v >> (k - 1)) - 1));
	} else {
		v = UINT32_C(1) << 31;
	}
	v += (uint32_t)predicted;
	return (int32_t)(bits < 32 ? v & ((UINT32_C(1) << (bits & 31)) - 1) : v);
}

/* Both. */
LAZ_INLINE int32_t laz_int_read(struct laz_coder *c, struct laz_int *in, unsigned bits, unsigned contexts, int32_t predicted,
				unsigned context, unsigned *ret_k)
{
	*ret_k = laz_int_bits(c, in, bits, context);
	return laz_int_value(c, in, bits, contexts, predicted, *ret_k);
}

#endif
