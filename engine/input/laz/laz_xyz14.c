/*
 * The layer of POINT14 that all others hang on: scanner channel, returns, x and y, and which of scan angle, GPS
 * time and source change; and the layers of z and intensity.
 *
 * Model: a symbol says what changed since the channel's last record; x and y are corrections of the median of
 * five recent steps, in twelve groups by kind of return and whether the time is new; y also goes by how many
 * bits the correction of x had. z is a correction of the last z of as many returns left, intensity of the last one of the same
 * place and newness of time.
 *
 * Decoding is bound by latency: in a stream each symbol waits for the one before. So where the three streams are there, they are
 * decoded in one loop, symbol by symbol in turn: those of x and y of a record beside those of z and intensity of the record
 * before, whose contexts are known by then.
 */
#include "laz_layers.h"

#include "err.h"

enum { GROUPS = 12 };
enum { CHANGED_CHANNEL = 64, CHANGED_COUNT = 4 };

struct channel {
	uint32_t x, y;
	uint8_t number, count; /* of returns */
	bool new_time;
	struct laz_median dx[GROUPS], dy[GROUPS];
	alignas(16) uint8_t changed[8 * LAZ_MODEL_BYTES(128)];
	alignas(16) uint8_t other[LAZ_MODEL_BYTES(3)]; /* channel */
	alignas(16) uint8_t counts[16 * LAZ_MODEL_BYTES(16)];
	alignas(16) uint8_t numbers[16 * LAZ_MODEL_BYTES(16)];
	alignas(16) uint8_t skips[LAZ_MODEL_BYTES(13)];
	alignas(16) uint8_t step_x[LAZ_INT_BYTES(32, 2)];
	alignas(16) uint8_t step_y[LAZ_INT_BYTES(32, 22)];
};

struct xy_layer {
	unsigned now, known; /* channel; bit i: channel i is open */
	bool fixed;
	struct channel channel[LAZ_CHANNELS];
};

/* The group of a return, by count (row) and number; also for those that make no sense. */
static const char group_of[16][17] = {
	"0123453445555555", "1013333333333333", "2124444444433333", "3345444444444444", "4344544444444444", "5344454444444444",
	"3344445444444444", "4344444544444444", "4344444454444444", "5344444445444444", "5344444444544444", "5334444444455444",
	"5334444444455544", "5334444444445554", "5334444444444555", "5334444444444455",
};

#define MODEL(memory) ((struct laz_model *)(memory))

static void reset(struct channel *s)
{
	s->new_time = false;
	for (unsigned i = 0; i < GROUPS; i++) {
		laz_median_init(&s->dx[i]);
		laz_median_init(&s->dy[i]);
	}
	laz_models_reset(MODEL(s->changed), 128, 8);
	laz_model_reset(MODEL(s->other));
	laz_models_reset(MODEL(s->counts), 16, 16);
	laz_models_reset(MODEL(s->numbers), 16, 16);
	laz_model_reset(MODEL(s->skips));
	laz_int_reset((struct laz_int *)s->step_x, 32, 2);
	laz_int_reset((struct laz_int *)s->step_y, 32, 22);
}

static void xy_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	struct xy_layer *l = state;
	struct channel *s = &l->channel[channel];

	l->now = channel;
	l->known = 1u << channel;
	l->fixed = fixed;
	s->x = laz_get32(first + LAZ_AT_X);
	s->y = laz_get32(first + LAZ_AT_Y);
	s->number = first[LAZ_AT_RETURNS] & 15;
	s->count = first[LAZ_AT_RETURNS] >> 4;
	reset(s);
}

/* `c` is a copy, so that the caller's can stay in registers. */
static __attribute__((noinline)) void change_channel(struct xy_layer *l, struct laz_coder *c, struct laz_step *step)
{
	struct channel *old = &l->channel[l->now], *s;

	l->now = (l->now + 1 + laz_symbol_lazy(c, MODEL(old->other), 3)) & 3;
	s = &l->channel[l->now];
	if (!(l->known >> l->now & 1)) {
		l->known |= 1u << l->now;
		s->x = old->x;
		s->y = old->y;
		s->number = old->number;
		s->count = old->count;
		reset(s);
		step->changes |= LAZ_OPENS;
	}
}

/* The number of a return that is neither the last one's nor next to it. */
static __attribute__((noinline)) unsigned other_number(struct channel *s, struct laz_coder *c)
{
	if (s->new_time)
		return laz_symbol_lazy(c, laz_model_at(MODEL(s->numbers), 16, s->number), 16);
	return (s->number + 2 + laz_symbol_lazy(c, MODEL(s->skips), 13)) & 15;
}

static __attribute__((noinline)) unsigned other_count(struct channel *s, struct laz_coder *c)
{
	return laz_symbol_lazy(c, laz_model_at(MODEL(s->counts), 16, s->count), 16);
}

LAZ_INLINE void read_returns(struct channel *s, struct laz_coder *coder, unsigned changed)
{
	struct laz_coder c;

	if (changed & CHANGED_COUNT) {
		c = *coder;
		s->count = (uint8_t)other_count(s, &c);
		*coder = laz_coder_copy(&c);
	}
	if ((changed & 3) == 3) {
		c = *coder;
		s->number = (uint8_t)other_number(s, &c);
		*coder = laz_coder_copy(&c);
	} else {
		/* 1: one more, 2: one less */
		s->number = (uint8_t)((s->number + (changed & 1) - (changed >> 1 & 1)) & 15);
	}
}

/* Bits of a correction as a context: even, up to `most`. */
LAZ_INLINE unsigned bits_context(unsigned bits, unsigned most)
{
	return bits < most ? bits & ~1u : most;
}

struct z {
	int32_t last[8], now;
	alignas(16) uint8_t ints[LAZ_INT_BYTES(32, 20)];
};

struct intensity {
	uint16_t last[8], now;
	alignas(16) uint8_t ints[LAZ_INT_BYTES(16, 4)];
};

/* What is decoded of the record before, while that of x and y waits: its height, and its intensity if `light` has a state. */
struct before {
	struct laz_coder zc, lc;
	struct z *z;
	struct intensity *light;
	const struct laz_step *step;
	uint8_t *item;
};

LAZ_INLINE unsigned z_bits(struct before *b)
{
	return laz_int_bits(&b->zc, (struct laz_int *)b->z->ints, 32, b->step->z_context);
}

LAZ_INLINE void z_value(struct before *b, unsigned k)
{
	struct z *s = b->z;
	int32_t *last = &s->last[b->step->level];

	*last = s->now = laz_int_value(&b->zc, (struct laz_int *)s->ints, 32, 20, *last, k);
	laz_put32(b->item + LAZ_AT_Z, (uint32_t)s->now);
}

LAZ_INLINE unsigned light_bits(struct before *b)
{
	return laz_int_bits(&b->lc, (struct laz_int *)b->light->ints, 16, b->step->place);
}

LAZ_INLINE void light_value(struct before *b, unsigned k)
{
	struct intensity *s = b->light;
	uint16_t *last = &s->last[b->step->place << 1 | (b->step->changes & LAZ_NEW_TIME) / LAZ_NEW_TIME];

	*last = s->now = (uint16_t)laz_int_value(&b->lc, (struct laz_int *)s->ints, 16, 4, *last, k);
	laz_put16(b->item + LAZ_AT_INTENSITY, s->now);
}

/* x and y of a record, and symbol by symbol beside them what is left of the one before (NULL: nothing). */
LAZ_INLINE void read_xy(struct channel *s, struct laz_coder *c, struct laz_step *step, struct before *b, bool light)
{
	unsigned group = (unsigned)(group_of[s->count][s->number] - '0') * 2 + s->new_time;
	unsigned single = s->count == 1, kx, ky, kz = 0, kl = 0;
	struct laz_int *x = (struct laz_int *)s->step_x, *y = (struct laz_int *)s->step_y;
	struct laz_median *m = &s->dx[group];
	int32_t d;

	if (b)
		kz = z_bits(b);
	kx = laz_int_bits(c, x, 32, single);
	if (b)
		z_value(b, kz);
	d = laz_int_value(c, x, 32, 2, m->v[2], kx);
	s->x += (uint32_t)d;
	laz_median_add(m, d);
	m = &s->dy[group];
	if (b && light)
		kl = light_bits(b);
	ky = laz_int_bits(c, y, 32, single + bits_context(kx, 20));
	if (b && light)
		light_value(b, kl);
	d = laz_int_value(c, y, 32, 22, m->v[2], ky);
	s->y += (uint32_t)d;
	laz_median_add(m, d);
	step->z_context = (uint8_t)(single + bits_context((kx + ky) / 2, 18));
}

LAZ_INLINE void put(const struct channel *s, struct laz_step *step, uint8_t *item)
{
	int later = (int)s->count - (int)s->number;

	later = later < 0 ? -later : later;
	step->place = (uint8_t)((s->number == 1) << 1 | (s->number >= s->count));
	step->level = (uint8_t)(later < 7 ? later : 7);
	laz_put32(item + LAZ_AT_X, s->x);
	laz_put32(item + LAZ_AT_Y, s->y);
	item[LAZ_AT_RETURNS] = (uint8_t)(s->number | s->count << 4);
	item[LAZ_AT_FLAGS] = (uint8_t)((item[LAZ_AT_FLAGS] & 0xcf) | step->channel << 4);
}

/* One record; `s` is the state of its channel, which may become another. */
LAZ_INLINE struct channel *read_one(struct xy_layer *l, struct channel *s, struct laz_coder *coder, struct laz_step *step,
				    uint8_t *item, struct before *b, bool light)
{
	struct laz_coder c = *coder;
	unsigned before = (s->number == 1) + (s->number >= s->count ? 2u : 0) + (s->new_time ? 4u : 0);
	unsigned changed = laz_symbol_lazy(&c, laz_model_at(MODEL(s->changed), 128, before), 128);

	step->changes = (uint8_t)(changed >> 3 & 7);
	if (laz_unlikely(changed & CHANGED_CHANNEL)) {
		struct laz_coder copy = c;

		change_channel(l, &copy, step);
		c = laz_coder_copy(&copy);
		s = &l->channel[l->now];
	}
	step->channel = (uint8_t)l->now;
	step->item_channel = l->fixed || changed & CHANGED_CHANNEL ? (uint8_t)l->now : 0;
	s->new_time = step->changes & LAZ_NEW_TIME;
	read_returns(s, &c, changed);
	read_xy(s, &c, step, b, light);
	put(s, step, item);
	*coder = c;
	return s;
}

static int xy_read(void *state, struct laz_window *w, struct laz_step *step, uint8_t *item, size_t length, size_t n,
		   struct err *err)
{
	struct xy_layer *l = state;
	struct laz_coder c = w->coder;
	struct channel *s = &l->channel[l->now];

	for (size_t i = 0; i < n; i++, step++, item += length) {
		int rc = laz_window_ready(w, &c, err);

		if (rc)
			return rc;
		s = read_one(l, s, &c, step, item, NULL, false);
	}
	w->coder = c;
	return 0;
}

const struct laz_layer_row laz_layer_xy = {"x and y", sizeof(struct xy_layer), true, xy_begin, xy_read};

/* ---- z ---- */

struct z_layer {
	unsigned now;
	struct z channel[LAZ_CHANNELS];
};

static void z_open(struct z *s, const struct z *from)
{
	s->now = from->now;
	for (unsigned i = 0; i < 8; i++)
		s->last[i] = s->now;
	laz_int_reset((struct laz_int *)s->ints, 32, 20);
}

static void z_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	struct z_layer *l = state;
	struct z *s = &l->channel[channel];

	l->now = channel;
	s->now = (int32_t)laz_get32(first + LAZ_AT_Z);
	z_open(s, s);
}

/* The state of the record's channel. */
LAZ_INLINE struct z *z_turn(struct z_layer *l, struct z *s, const struct laz_step *step)
{
	if (laz_likely(step->channel == l->now))
		return s;
	if (step->changes & LAZ_OPENS)
		z_open(&l->channel[step->channel], s);
	l->now = step->channel;
	return &l->channel[l->now];
}

const struct laz_layer_row laz_layer_z = {"z", sizeof(struct z_layer), true, z_begin, NULL};

/* ---- intensity: from the last of the same place and newness of time ---- */

struct intensity_layer {
	unsigned now;
	struct intensity channel[LAZ_CHANNELS];
};

static void intensity_open(struct intensity *s, const struct intensity *from)
{
	s->now = from->now;
	for (unsigned i = 0; i < 8; i++)
		s->last[i] = s->now;
	laz_int_reset((struct laz_int *)s->ints, 16, 4);
}

static void intensity_begin(void *state, const uint8_t *first, unsigned channel, bool fixed)
{
	struct intensity_layer *l = state;
	struct intensity *s = &l->channel[channel];

	l->now = channel;
	s->now = laz_get16(first + LAZ_AT_INTENSITY);
	intensity_open(s, s);
}

LAZ_INLINE struct intensity *intensity_turn(struct intensity_layer *l, struct intensity *s, const struct laz_step *step)
{
	if (laz_likely(step->channel == l->now))
		return s;
	if (step->changes & LAZ_OPENS)
		intensity_open(&l->channel[step->channel], s);
	l->now = step->channel;
	return &l->channel[l->now];
}

static int intensity_read(void *state, struct laz_window *w, struct laz_step *step, uint8_t *item, size_t length, size_t n,
			  struct err *err)
{
	struct intensity_layer *l = state;
	struct before b = {.lc = w->coder, .light = &l->channel[l->now]};

	for (size_t i = 0; i < n; i++, step++, item += length) {
		int rc = laz_window_ready(w, &b.lc, err);

		if (rc)
			return rc;
		b.light = intensity_turn(l, b.light, step);
		b.step = step;
		b.item = item;
		light_value(&b, light_bits(&b));
	}
	w->coder = b.lc;
	return 0;
}

const struct laz_layer_row laz_layer_intensity = {
	"intensity", sizeof(struct intensity_layer), false, intensity_begin, intensity_read,
};

/* ---- the layers beside each other ---- */

/* The record before becomes `step` and `item`. */
LAZ_INLINE int begin_before(struct before *b, const struct laz_stream *z, const struct laz_stream *light, struct laz_step *step,
			    uint8_t *item, struct err *err)
{
	int rc = laz_window_ready(z->window, &b->zc, err);

	if (!rc && light)
		rc = laz_window_ready(light->window, &b->lc, err);
	b->z = z_turn(z->state, b->z, step);
	if (light)
		b->light = intensity_turn(light->state, b->light, step);
	b->step = step;
	b->item = item;
	return rc;
}

LAZ_INLINE int read_beside(const struct laz_stream *xy, const struct laz_stream *z, const struct laz_stream *light,
			   struct laz_step *step, uint8_t *item, size_t length, size_t n, struct err *err)
{
	struct xy_layer *l = xy->state;
	struct z_layer *zl = z->state;
	struct intensity_layer *il = light ? light->state : NULL;
	struct laz_coder c = xy->window->coder;
	struct channel *s = &l->channel[l->now];
	struct before b = {.zc = z->window->coder, .z = &zl->channel[zl->now]};

	if (light) {
		b.lc = light->window->coder;
		b.light = &il->channel[il->now];
	}
	for (size_t i = 0; i < n; i++, step++, item += length) {
		int rc = i > 0 ? begin_before(&b, z, light, step - 1, item - length, err) : 0;

		if (!rc)
			rc = laz_window_ready(xy->window, &c, err);
		if (rc)
			return rc;
		s = i > 0 ? read_one(l, s, &c, step, item, &b, light != NULL) : read_one(l, s, &c, step, item, NULL, false);
	}
	if (n > 0) {
		int rc = begin_before(&b, z, light, step - 1, item - length, err);

		if (rc)
			return rc;
		z_value(&b, z_bits(&b));
		if (light)
			light_value(&b, light_bits(&b));
	}
	xy->window->coder = c;
	z->window->coder = b.zc;
	if (light)
		light->window->coder = b.lc;
	return 0;
}

int laz_xyz_read(const struct laz_stream *xy, const struct laz_stream *z, const struct laz_stream *light, struct laz_step *step,
		 uint8_t *item, size_t length, size_t n, struct err *err)
{
	return light ? read_beside(xy, z, light, step, item, length, n, err) :
		       read_beside(xy, z, NULL, step, item, length, n, err);
}
