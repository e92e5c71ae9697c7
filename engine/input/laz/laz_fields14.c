/*
 * The layers of POINT14 that follow laz_xyz14.c, but for the GPS time: class, flags, scan angle, user data,
 * source. All use the same loop over the records of a batch; they differ in how they predict the next value.
 */
#include "laz_layers.h"

#include "err.h"

#define MODEL(memory) ((struct laz_model *)(memory))
#define INT(memory) ((struct laz_int *)(memory))

/*
 * The loop over n records: `s` is the state of the record's channel, `c` the coder in registers, `at` the field.
 * A channel that opens does so by `open(state, state of the channel before)`.
 */
#define EACH_RECORD(layer, type, open, ...)                          \
	struct layer *l = state;                                     \
	struct type *s = &l->channel[l->now];                        \
	struct laz_coder c = w->coder;                               \
	for (size_t i = 0; i < n; i++, step++, item += length) {     \
		int rc = laz_window_ready(w, &c, err);               \
		if (rc)                                              \
			return rc;                                   \
		if (laz_unlikely(step->channel != l->now)) {         \
			if (step->changes & LAZ_OPENS)               \
				open(&l->channel[step->channel], s); \
			l->now = step->channel;                      \
			s = &l->channel[l->now];                     \
		}                                                    \
		__VA_ARGS__                                          \
	}                                                            \
	w->coder = c;                                                \
	return 0

/* ---- a byte by one of 64 models ---- */

struct bytes {
	unsigned now;
	alignas(16) uint8_t models[64 * LAZ_MODEL_BYTES(256)];
};
struct bytes_layer {
	unsigned now;
	struct bytes channel[LAZ_CHANNELS];
};

static void bytes_open(struct bytes *s, const struct bytes *from)
{
	s->now = from->now;
	laz_models_reset(MODEL(s->models), 256, 64);
}

static void bytes_begin(struct bytes_layer *l, unsigned first, unsigned channel)
{
	struct bytes *s = &l->channel[channel];

	l->now = channel;
	s->now = first;
	bytes_open(s, s);
}

/* ---- class: from the last class, and whether the return is the only one ---- */

static void class_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	bytes_begin(state, first[LAZ_AT_CLASS], channel);
}

static int class_read(void *state, struct laz_window *w, struct laz_step *step, uint8_t *item, size_t length, size_t n,
		      struct err *err)
{
	EACH_RECORD(bytes_layer, bytes, bytes_open, {
		unsigned which = (s->now & 31) * 2 + (step->place == 3);

		s->now = laz_symbol_lazy(&c, laz_model_at(MODEL(s->models), 256, which), 256);
		item[LAZ_AT_CLASS] = (uint8_t)s->now;
	});
}

const struct laz_layer_row laz_layer_class = {"class", sizeof(struct bytes_layer), true, class_begin, class_read};

/* ---- flags: 4 bits of class flags, direction, edge; from the last ones ---- */

struct flags {
	unsigned now;
	alignas(16) uint8_t models[64 * LAZ_MODEL_BYTES(64)];
};
struct flags_layer {
	unsigned now;
	struct flags channel[LAZ_CHANNELS];
};

static void flags_open(struct flags *s, const struct flags *from)
{
	s->now = from->now;
	laz_models_reset(MODEL(s->models), 64, 64);
}

static void flags_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	struct flags_layer *l = state;
	struct flags *s = &l->channel[channel];
	unsigned byte = first[LAZ_AT_FLAGS];

	l->now = channel;
	s->now = (byte & 15) | (byte >> 6) << 4;
	flags_open(s, s);
}

static int flags_read(void *state, struct laz_window *w, struct laz_step *step, uint8_t *item, size_t length, size_t n,
		      struct err *err)
{
	EACH_RECORD(flags_layer, flags, flags_open, {
		s->now = laz_symbol_lazy(&c, laz_model_at(MODEL(s->models), 64, s->now), 64);
		item[LAZ_AT_FLAGS] = (uint8_t)((s->now & 15) | step->channel << 4 | (s->now >> 4) << 6);
	});
}

const struct laz_layer_row laz_layer_flags = {"flags", sizeof(struct flags_layer), true, flags_begin, flags_read};

/* ---- scan angle and source: from the last, where they change ---- */

struct angle {
	uint16_t now;
	alignas(16) uint8_t ints[LAZ_INT_BYTES(16, 2)];
};
struct angle_layer {
	unsigned now;
	struct angle channel[LAZ_CHANNELS];
};

static void angle_open(struct angle *s, const struct angle *from)
{
	s->now = from->now;
	laz_int_reset(INT(s->ints), 16, 2);
}

static void angle_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	struct angle_layer *l = state;
	struct angle *s = &l->channel[channel];

	l->now = channel;
	s->now = laz_get16(first + LAZ_AT_ANGLE);
	angle_open(s, s);
}

static int angle_read(void *state, struct laz_window *w, struct laz_step *step, uint8_t *item, size_t length, size_t n,
		      struct err *err)
{
	EACH_RECORD(angle_layer, angle, angle_open, {
		unsigned k;

		if (step->changes & LAZ_NEW_ANGLE)
			s->now = (uint16_t)laz_int_read(&c, INT(s->ints), 16, 2, s->now,
							(step->changes & LAZ_NEW_TIME) / LAZ_NEW_TIME, &k);
		laz_put16(item + LAZ_AT_ANGLE, s->now);
	});
}

const struct laz_layer_row laz_layer_angle = {
	"scan angle", sizeof(struct angle_layer), false, angle_begin, angle_read,
};

struct source {
	uint16_t now;
	alignas(16) uint8_t ints[LAZ_INT_BYTES(16, 1)];
};
struct source_layer {
	unsigned now;
	struct source channel[LAZ_CHANNELS];
};

static void source_open(struct source *s, const struct source *from)
{
	s->now = from->now;
	laz_int_reset(INT(s->ints), 16, 1);
}

static void source_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	struct source_layer *l = state;
	struct source *s = &l->channel[channel];

	l->now = channel;
	s->now = laz_get16(first + LAZ_AT_SOURCE);
	source_open(s, s);
}

static int source_read(void *state, struct laz_window *w, struct laz_step *step, uint8_t *item, size_t length, size_t n,
		       struct err *err)
{
	EACH_RECORD(source_layer, source, source_open, {
		unsigned k;

		if (step->changes & LAZ_NEW_SOURCE)
			s->now = (uint16_t)laz_int_read(&c, INT(s->ints), 16, 1, s->now, 0, &k);
		laz_put16(item + LAZ_AT_SOURCE, s->now);
	});
}

const struct laz_layer_row laz_layer_source = {
	"point source", sizeof(struct source_layer), false, source_begin, source_read,
};

/* ---- user data: from the upper six bits of the last ---- */

static void user_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	bytes_begin(state, first[LAZ_AT_USER], channel);
}

static int user_read(void *state, struct laz_window *w, struct laz_step *step, uint8_t *item, size_t length, size_t n,
		     struct err *err)
{
	EACH_RECORD(bytes_layer, bytes, bytes_open, {
		s->now = laz_symbol_lazy(&c, laz_model_at(MODEL(s->models), 256, s->now / 4), 256);
		item[LAZ_AT_USER] = (uint8_t)s->now;
	});
}

const struct laz_layer_row laz_layer_user = {"user data", sizeof(struct bytes_layer), false, user_begin, user_read};
