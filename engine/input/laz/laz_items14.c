/*
 * The layers of the items other than POINT14: colours (RGB14, RGBNIR14), wave packets, extra bytes. The coding is that of RGB12,
 * WAVEPACKET13 and BYTE, but with scanner channels, and with a separate stream for each layer and each extra byte.
 */
#include "laz_layers.h"

#include "err.h"

#define MODEL(memory) ((struct laz_model *)(memory))
#define INT(memory) ((struct laz_int *)(memory))

/*
 * The loop over n records: `s` is the state of the record's channel, `last` that whose last value counts.
 */
#define EACH_RECORD(layer, type, open, ...)                                                  \
	struct layer *l = state;                                                             \
	struct type *s = &l->channel[l->turns.now], *last = s;                               \
	struct laz_coder c = w->coder;                                                       \
	for (size_t i = 0; i < n; i++, step++, item += length) {                             \
		int rc = laz_window_ready(w, &c, err);                                       \
		if (rc)                                                                      \
			return rc;                                                           \
		last = s;                                                                    \
		if (laz_unlikely(step->item_channel != l->turns.now)) {                      \
			bool opens;                                                          \
			last = &l->channel[laz_turn(&l->turns, step->item_channel, &opens)]; \
			if (opens)                                                           \
				open(last, s);                                               \
			s = &l->channel[l->turns.now];                                       \
		}                                                                            \
		__VA_ARGS__                                                                  \
	}                                                                                    \
	w->coder = c;                                                                        \
	return 0

/* ---- colours: low and high byte of red, green, blue ---- */

struct rgb {
	uint8_t last[6];
	alignas(16) uint8_t used[LAZ_MODEL_BYTES(128)];
	alignas(16) uint8_t diff[6 * LAZ_MODEL_BYTES(256)];
};

struct rgb_layer {
	struct laz_turns turns;
	struct rgb channel[LAZ_CHANNELS];
};

static void rgb_open(struct rgb *s, const struct rgb *from)
{
	memmove(s->last, from->last, sizeof s->last);
	laz_model_reset(MODEL(s->used));
	laz_models_reset(MODEL(s->diff), 256, 6);
}

static void rgb_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	struct rgb_layer *l = state;
	struct rgb *s = &l->channel[channel];

	laz_turns_begin(&l->turns, channel, fixed);
	memcpy(s->last, first, sizeof s->last);
	rgb_open(s, s);
}

LAZ_INLINE int clamp(int v)
{
	return v < 0 ? 0 : v > 255 ? 255 : v;
}

LAZ_INLINE uint8_t corrected(struct laz_coder *c, struct rgb *s, unsigned i, int predicted)
{
	return (uint8_t)(predicted + (int)laz_symbol_lazy(c, laz_model_at(MODEL(s->diff), 256, i), 256));
}

/* Which of the bytes differ, and whether the three colours do; red's steps predict green's, both blue's. */
LAZ_INLINE void read_rgb(struct laz_coder *c, struct rgb *s, const uint8_t *last, uint8_t now[6])
{
	unsigned used = laz_symbol_lazy(c, MODEL(s->used), 128);

	for (unsigned i = 0; i < 2; i++)
		now[i] = used >> i & 1 ? corrected(c, s, i, last[i]) : last[i];
	if (!(used & 64)) {
		memcpy(now + 2, now, 2);
		memcpy(now + 4, now, 2);
		return;
	}
	for (unsigned i = 0; i < 2; i++) {
		int d = now[i] - last[i];

		now[2 + i] = used >> (2 + i) & 1 ? corrected(c, s, 2 + i, clamp(d + last[2 + i])) : last[2 + i];
		d = (d + now[2 + i] - last[2 + i]) / 2;
		now[4 + i] = used >> (4 + i) & 1 ? corrected(c, s, 4 + i, clamp(d + last[4 + i])) : last[4 + i];
	}
}

static int rgb_read(void *state, struct laz_window *w, struct laz_step *step, uint8_t *item, size_t length, size_t n,
		    struct err *err)
{
	EACH_RECORD(rgb_layer, rgb, rgb_open, {
		uint8_t now[6];

		read_rgb(&c, s, last->last, now);
		memcpy(last->last, now, sizeof now);
		memcpy(item, now, sizeof now);
	});
}

const struct laz_layer_row laz_layer_rgb = {"colours", sizeof(struct rgb_layer), false, rgb_begin, rgb_read};

/* ---- near infrared: the two bytes behind the colours ---- */

enum { AT_NIR = 6 };

struct nir {
	uint8_t last[2];
	alignas(16) uint8_t used[LAZ_MODEL_BYTES(4)];
	alignas(16) uint8_t diff[2 * LAZ_MODEL_BYTES(256)];
};

struct nir_layer {
	struct laz_turns turns;
	struct nir channel[LAZ_CHANNELS];
};

static void nir_open(struct nir *s, const struct nir *from)
{
	memmove(s->last, from->last, sizeof s->last);
	laz_model_reset(MODEL(s->used));
	laz_models_reset(MODEL(s->diff), 256, 2);
}

static void nir_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	struct nir_layer *l = state;
	struct nir *s = &l->channel[channel];

	laz_turns_begin(&l->turns, channel, fixed);
	memcpy(s->last, first + AT_NIR, sizeof s->last);
	nir_open(s, s);
}

static int nir_read(void *state, struct laz_window *w, struct laz_step *step, uint8_t *item, size_t length, size_t n,
		    struct err *err)
{
	EACH_RECORD(nir_layer, nir, nir_open, {
		unsigned used = laz_symbol_lazy(&c, MODEL(s->used), 4);

		for (unsigned k = 0; k < 2; k++)
			if (used >> k & 1)
				last->last[k] =
					(uint8_t)(last->last[k] + laz_symbol_lazy(&c, laz_model_at(MODEL(s->diff), 256, k), 256));
		memcpy(item + AT_NIR, last->last, 2);
	});
}

const struct laz_layer_row laz_layer_nir = {"near infrared", sizeof(struct nir_layer), false, nir_begin, nir_read};

/* ---- one extra byte ---- */

struct byte {
	uint8_t last;
	alignas(16) uint8_t model[LAZ_MODEL_BYTES(256)];
};
struct byte_layer {
	struct laz_turns turns;
	struct byte channel[LAZ_CHANNELS];
};

static void byte_open(struct byte *s, const struct byte *from)
{
	s->last = from->last;
	laz_model_reset(MODEL(s->model));
}

static void byte_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	struct byte_layer *l = state;
	struct byte *s = &l->channel[channel];

	laz_turns_begin(&l->turns, channel, fixed);
	s->last = first[0];
	byte_open(s, s);
}

static int byte_read(void *state, struct laz_window *w, struct laz_step *step, uint8_t *item, size_t length, size_t n,
		     struct err *err)
{
	EACH_RECORD(byte_layer, byte, byte_open, {
		last->last = (uint8_t)(last->last + laz_symbol_lazy(&c, MODEL(s->model), 256));
		item[0] = last->last;
	});
}

const struct laz_layer_row laz_layer_byte = {"extra bytes", sizeof(struct byte_layer), false, byte_begin, byte_read};

/* ---- wave packet: index, offset, size, place of the return, direction; floats are the integers of their bits ---- */

enum { AT_OFFSET = 1, AT_SIZE = 9, AT_VALUES = 13 };

struct packet {
	uint64_t offset;
	uint32_t size, value[4]; /* place of the return; x, y, z */
};

struct wave {
	struct packet last;
	uint32_t jump; /* the last difference of offsets that was neither 0 nor the packet's size */
	unsigned kind; /* last symbol of the offset */
	alignas(16) uint8_t index[LAZ_MODEL_BYTES(256)];
	alignas(16) uint8_t kinds[4 * LAZ_MODEL_BYTES(4)];
	alignas(16) uint8_t jumps[LAZ_INT_BYTES(32, 1)];
	alignas(16) uint8_t sizes[LAZ_INT_BYTES(32, 1)];
	alignas(16) uint8_t places[LAZ_INT_BYTES(32, 1)];
	alignas(16) uint8_t directions[LAZ_INT_BYTES(32, 3)];
};

struct wave_layer {
	struct laz_turns turns;
	struct wave channel[LAZ_CHANNELS];
};

static void wave_open(struct wave *s, const struct wave *from)
{
	s->last = (struct packet)from->last;
	s->jump = 0;
	s->kind = 0;
	laz_model_reset(MODEL(s->index));
	laz_models_reset(MODEL(s->kinds), 4, 4);
	laz_int_reset(INT(s->jumps), 32, 1);
	laz_int_reset(INT(s->sizes), 32, 1);
	laz_int_reset(INT(s->places), 32, 1);
	laz_int_reset(INT(s->directions), 32, 3);
}

static void wave_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	struct wave_layer *l = state;
	struct packet packet = {.offset = laz_get64(first + AT_OFFSET), .size = laz_get32(first + AT_SIZE)};
	struct wave *s = &l->channel[channel];

	for (unsigned i = 0; i < 4; i++)
		packet.value[i] = laz_get32(first + AT_VALUES + 4 * i);
	laz_turns_begin(&l->turns, channel, fixed);
	s->last = packet;
	wave_open(s, s);
}

static uint32_t read_int(struct laz_coder *c, uint8_t *ints, uint32_t predicted)
{
	unsigned k;

	return (uint32_t)laz_int_read(c, INT(ints), 32, 1, (int32_t)predicted, 0, &k);
}

static void read_packet(struct laz_coder *c, struct wave *s, struct packet *p)
{
	unsigned k;

	s->kind = laz_symbol_lazy(c, laz_model_at(MODEL(s->kinds), 4, s->kind), 4);
	switch (s->kind) {
	case 0:
		break;
	case 1:
		p->offset += p->size;
		break;
	case 2:
		s->jump = read_int(c, s->jumps, s->jump);
		p->offset += (uint64_t)(int64_t)(int32_t)s->jump;
		break;
	default:
		p->offset = laz_u64(c);
	}
	p->size = read_int(c, s->sizes, p->size);
	p->value[0] = read_int(c, s->places, p->value[0]);
	for (unsigned i = 0; i < 3; i++)
		p->value[1 + i] = (uint32_t)laz_int_read(c, INT(s->directions), 32, 3, (int32_t)p->value[1 + i], i, &k);
}

static int wave_read(void *state, struct laz_window *w, struct laz_step *step, uint8_t *item, size_t length, size_t n,
		     struct err *err)
{
	EACH_RECORD(wave_layer, wave, wave_open, {
		item[0] = (uint8_t)laz_symbol_lazy(&c, MODEL(s->index), 256);
		read_packet(&c, s, &last->last);
		laz_put64(item + AT_OFFSET, last->last.offset);
		laz_put32(item + AT_SIZE, last->last.size);
		for (unsigned k = 0; k < 4; k++)
			laz_put32(item + AT_VALUES + 4 * k, last->last.value[k]);
	});
}

const struct laz_layer_row laz_layer_wavepacket = {
	"wave packets", sizeof(struct wave_layer), false, wave_begin, wave_read,
};
