/*
 * The layer of the GPS time of POINT14.
 *
 * Model: times, as 64-bit integers of the same bits, come from up to four interleaved sequences, each with its
 * last time and last difference. A difference is coded as a multiple of the last one and a correction, or a
 * symbol changes to another sequence, or a new one begins.
 */
#include "laz_layers.h"

#include "err.h"

enum {
	MULTIPLE_MAX = 500,
	MULTIPLE_MIN = 10, /* the latter below zero */
	NEW = MULTIPLE_MAX + MULTIPLE_MIN + 1,
	MULTIPLES = NEW + 4,
	PATIENCE = 3,    /* so many bad predictions are borne */
	CHANGES_MAX = 4, /* of sequence, for one time; encoders need 1 */
};

struct channel {
	uint64_t time[4];
	int32_t step[4];
	uint8_t bad[4];
	unsigned now, newest; /* sequence */
	alignas(16) uint8_t multiples[LAZ_MODEL_BYTES(MULTIPLES)];
	alignas(16) uint8_t zero[LAZ_MODEL_BYTES(5)];
	alignas(16) uint8_t ints[LAZ_INT_BYTES(32, 9)];
};

struct time_layer {
	unsigned now;
	struct channel channel[LAZ_CHANNELS];
};

#define MODEL(memory) ((struct laz_model *)(memory))

static void open_channel(struct channel *s, uint64_t time)
{
	memset(s, 0, offsetof(struct channel, multiples));
	s->time[0] = time;
	laz_model_reset(MODEL(s->multiples));
	laz_model_reset(MODEL(s->zero));
	laz_int_reset((struct laz_int *)s->ints, 32, 9);
}

static void time_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	struct time_layer *l = state;

	l->now = channel;
	open_channel(&l->channel[channel], laz_get64(first + LAZ_AT_TIME));
}

LAZ_INLINE int32_t read_int(struct channel *s, struct laz_coder *c, int32_t predicted, unsigned context)
{
	unsigned k;

	return laz_int_read(c, (struct laz_int *)s->ints, 32, 9, predicted, context, &k);
}

/* A time too far from all sequences: replaces the oldest. */
static __attribute__((noinline)) void read_new(struct channel *s, struct laz_coder *c)
{
	uint32_t high = (uint32_t)read_int(s, c, (int32_t)(s->time[s->now] >> 32), 8);

	s->newest = s->now = (s->newest + 1) & 3;
	s->time[s->now] = (uint64_t)high << 32 | laz_u32(c);
	s->step[s->now] = 0;
	s->bad[s->now] = 0;
}

/* The symbol says which multiple of the last difference is near. */
LAZ_INLINE void read_multiple(struct channel *s, struct laz_coder *c, unsigned symbol)
{
	unsigned now = s->now, context;
	int32_t times = (int32_t)symbol, d;
	bool bad = symbol == 0 || symbol == MULTIPLE_MAX || symbol == NEW - 1;

	if (symbol > MULTIPLE_MAX)
		times = MULTIPLE_MAX - times;
	if (symbol == 1)
		context = 1;
	else if (symbol == 0)
		context = 7;
	else if (symbol <= MULTIPLE_MAX)
		context = symbol < 10 ? 2 : symbol < MULTIPLE_MAX ? 3 : 4;
	else
		context = symbol < NEW - 1 ? 5 : 6;
	d = read_int(s, c, (int32_t)((uint32_t)times * (uint32_t)s->step[now]), context);
	s->time[now] += (uint64_t)(int64_t)d;
	if (symbol == 1) {
		s->bad[now] = 0;
	} else if (bad && ++s->bad[now] > PATIENCE) {
		s->step[now] = d;
		s->bad[now] = 0;
	}
}

LAZ_INLINE void read_time(struct channel *s, struct laz_coder *coder)
{
	struct laz_coder c = *coder;
	unsigned symbol;

	for (unsigned changes = 0;; changes++) {
		bool zero = s->step[s->now] == 0;

		if (zero) {
			symbol = laz_symbol_lazy(&c, MODEL(s->zero), 5);
			if (symbol == 0) {
				s->step[s->now] = read_int(s, &c, 0, 0);
				s->time[s->now] += (uint64_t)(int64_t)s->step[s->now];
				s->bad[s->now] = 0;
				break;
			}
			symbol += NEW - 1;
		} else {
			symbol = laz_symbol_lazy(&c, MODEL(s->multiples), MULTIPLES);
			if (symbol < NEW) {
				read_multiple(s, &c, symbol);
				break;
			}
		}
		if (symbol == NEW) {
			struct laz_coder copy = c;

			read_new(s, &copy);
			c = laz_coder_copy(&copy);
			break;
		}
		s->now = (s->now + symbol - NEW) & 3;
		if (changes == CHANGES_MAX) {
			c.bad |= 1;
			break;
		}
	}
	*coder = c;
}

static int time_read(void *state, struct laz_window *w, struct laz_step *step, uint8_t *item, size_t length, size_t n,
		     struct err *err)
{
	struct time_layer *l = state;
	struct channel *s = &l->channel[l->now];
	struct laz_coder c = w->coder;

	for (size_t i = 0; i < n; i++, step++, item += length) {
		int rc = laz_window_ready(w, &c, err);

		if (rc)
			return rc;
		if (laz_unlikely(step->channel != l->now)) {
			l->now = step->channel;
			if (step->changes & LAZ_OPENS)
				open_channel(&l->channel[l->now], s->time[s->now]);
			s = &l->channel[l->now];
		}
		if (step->changes & LAZ_NEW_TIME)
			read_time(s, &c);
		laz_put64(item + LAZ_AT_TIME, s->time[s->now]);
	}
	w->coder = c;
	return 0;
}

const struct laz_layer_row laz_layer_time = {"GPS time", sizeof(struct time_layer), false, time_begin, time_read};
