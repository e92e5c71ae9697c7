/*
 * The survey of acut-synth. An aircraft flies swaths up and down the area, each overlapping the next by a fifth; an
 * oscillating mirror draws a zig-zag below it; every pulse has a jitter and, in the woods, several returns. The spacing
 * of pulses is chosen so that the requested points cover the area with one per cent to spare, which the last swath
 * lacks; if they do not, a second round is flown.
 *
 * Irregularities: 1 in 3000 pulses is noise (a bird, or a false echo below ground), 1 in 700 points is withheld, 1 in
 * 900 pulses is recorded twice at one position with another height, 1 in 60 ground points is unclassified and 1 in 300
 * is a model key-point. Over water two of three pulses are lost.
 */
#include <string.h>

#include "point.h"
#include "synth.h"

enum {
	CLASS_NONE = 1,
	CLASS_GROUND = 2,
	CLASS_LOW = 3,
	CLASS_MEDIUM = 4,
	CLASS_HIGH = 5,
	CLASS_BUILDING = 6,
	CLASS_NOISE = 7,
	CLASS_WATER = 9,
	CLASS_NOISE_HIGH = 18,
	SAMPLES = 20000,
};

static const double half_angle = 20; /* degrees, of the mirror */
static const double slope = 0.364;   /* its tangent */

static unsigned pulse_at(struct synth_survey *s, double x, double y, double across, struct synth_point *ret);

/* Mean number of returns of a pulse over the area. */
static double mean_returns(struct synth_survey *s)
{
	struct synth_point ret[SYNTH_RETURNS];
	uint64_t sum = 0;

	for (uint64_t i = 0; i < SAMPLES; i++) {
		uint64_t h = synth_hash(s->options->seed + 5, i);

		s->counter = h;
		sum += pulse_at(s, synth_fraction((uint32_t)h) * s->options->width,
				synth_fraction((uint32_t)(h >> 32)) * s->options->height, 0, ret);
	}
	s->counter = 0;
	return sum ? (double)sum / SAMPLES : 1;
}

static double square_root(double v)
{
	return __builtin_sqrt(v); /* one instruction, correctly rounded */
}

void synth_survey_init(struct synth_survey *s, const struct synth_options *o)
{
	memset(s, 0, sizeof *s);
	s->options = o;
	s->per_scale = 1 / decimal_double(o->scale);
	synth_land_init(&s->land, o);
	s->sway = synth_noise_of(synth_hash(o->seed, 2000), 1.0 / 130);
	s->swath = o->shape == SYNTH_SWATH ? o->width : o->width * 0.45 < 640 ? o->width * 0.45 : 640;
	double step = s->swath * 0.8, pulses = (double)o->points / mean_returns(s) * 1.01;

	s->swaths = o->width <= s->swath ? 1 : (uint64_t)((o->width - s->swath) / step) + 2;
	s->advance = s->swaths > 1 ? (o->width - s->swath) / (double)(s->swaths - 1) : 0;
	double area = (double)s->swaths * s->swath * o->height;

	s->spacing = square_root(area / (pulses < 1 ? 1 : pulses));
	s->pulses = (uint64_t)(s->swath / s->spacing) + 1;
	double lines = pulses / ((double)s->swaths * (double)s->pulses);

	s->lines = lines < 1 ? 1 : (uint64_t)lines + 1;
	s->reach = o->height / (double)s->lines;
}

static uint8_t plant_class(double above)
{
	return above < 0.5 ? CLASS_LOW : above < 2.5 ? CLASS_MEDIUM : CLASS_HIGH;
}

static int32_t quantised(const struct synth_survey *s, double v)
{
	return (int32_t)synth_floor(v * s->per_scale + 0.5);
}

static void add_return(const struct synth_survey *s, struct synth_point *p, double x, double y, double z, double side,
		       double above, unsigned cls)
{
	double reach = side * slope * above; /* a slanted ray meets high objects nearer to the middle */

	x -= reach;
	x = x < 0 ? 0 : x > s->options->width ? s->options->width : x;
	p->x = quantised(s, x);
	p->y = quantised(s, y);
	p->z = quantised(s, z + above);
	p->cls = (uint8_t)cls;
}

/* A crown: the hits of the ray from the top down; three of four rays reach the ground. */
static unsigned forest_returns(const struct synth_survey *s, double x, double y, double z, double top, double side, uint64_t h,
			       struct synth_point *ret)
{
	unsigned n = 1 + (unsigned)((h >> 40 & 7) * 3 >> 3) + (unsigned)(h >> 43 & 1);
	bool grounded = (h >> 44 & 3) != 0;

	if (top < 2)
		n = 1 + (unsigned)(h >> 40 & 1);
	for (unsigned i = 0; i < n; i++) {
		double above = top * (1 - (double)i / (n + 0.5)) * (0.85 + 0.15 * synth_fraction((uint32_t)(h >> (i * 5))));

		if (i + 1 == n && grounded)
			add_return(s, &ret[i], x, y, z, side, 0, CLASS_GROUND);
		else
			add_return(s, &ret[i], x, y, z, side, above, plant_class(above));
	}
	return n;
}

static unsigned surface_return(const struct synth_survey *s, double x, double y, double z, double top, double side,
			       enum synth_cover cover, uint64_t h, struct synth_point *ret)
{
	double error = (synth_fraction((uint32_t)(h >> 8)) - 0.5) * 0.08;

	switch (cover) {
	case SYNTH_WATER:
		if (h % 3)
			return 0;
		add_return(s, ret, x, y, z + error * 0.25, side, 0, CLASS_WATER);
		return 1;
	case SYNTH_HOUSE:
		add_return(s, ret, x, y, z + error, side, top, CLASS_BUILDING);
		return 1;
	case SYNTH_FOREST:
		return forest_returns(s, x, y, z + error, top, side, h, ret);
	default:
		if (cover == SYNTH_FIELD && (h >> 50 & 7) == 0)
			add_return(s, ret, x, y, z + error, side, 0.05 + 0.4 * synth_fraction((uint32_t)(h >> 20)), CLASS_LOW);
		else
			add_return(s, ret, x, y, z + error, side, 0, h % 60 == 7 ? CLASS_NONE : CLASS_GROUND);
		return 1;
	}
}

/* The returns of the pulse that would reach flat ground at x, y; `side`: -1 to 1 across the swath. */
static unsigned pulse_at(struct synth_survey *s, double x, double y, double side, struct synth_point *ret)
{
	uint64_t h = synth_hash(s->options->seed ^ UINT64_C(0x5bd1e995), s->counter), g = h * UINT64_C(0x9fb21c651e98df25);
	enum synth_cover cover;
	double top, z = synth_land_at(&s->land, x, y, &cover, &top);
	unsigned n;

	g ^= g >> 32;
	if (g % 3000 == 1) {
		bool high = g >> 40 & 1;
		double above = high ? 40 + 90 * synth_fraction((uint32_t)h) : -4 - 25 * synth_fraction((uint32_t)h);

		add_return(s, ret, x, y, z, 0, above, high && s->options->format == 6 ? CLASS_NOISE_HIGH : CLASS_NOISE);
		n = 1;
	} else {
		n = surface_return(s, x, y, z, top, side, cover, h, ret);
	}
	for (unsigned i = 0; i < n; i++) {
		ret[i].number = (uint8_t)(i + 1);
		ret[i].count = (uint8_t)n;
		ret[i].flags = ret[i].cls == CLASS_GROUND && (h >> 13) % 300 == 3 ? POINT_KEY : 0;
		if ((g >> 20) % 700 == i + 5)
			ret[i].flags |= POINT_WITHHELD;
		ret[i].intensity = (uint16_t)(200 + (h >> (16 + i)) % 900 + (ret[i].cls == CLASS_WATER ? 0 : 1500 / n));
	}
	if (n == 1 && (g >> 8) % 900 == 4) { /* recorded twice */
		ret[1] = ret[0];
		ret[1].z += 1 + (int32_t)(h >> 60);
		n = 2;
	}
	return n;
}

/* Moves to the next pulse: along the line, to the next line, the next swath, another round. */
static void next_pulse(struct synth_survey *s)
{
	s->counter++;
	if (++s->at_pulse < s->pulses)
		return;
	s->at_pulse = 0;
	if (++s->at_line < s->lines)
		return;
	s->at_line = 0;
	if (++s->at_swath < s->swaths)
		return;
	s->at_swath = 0;
	s->round++;
}

unsigned synth_survey_next(struct synth_survey *s, struct synth_point ret[SYNTH_RETURNS])
{
	const struct synth_options *o = s->options;
	uint64_t h = synth_hash(o->seed + 9, s->counter), line = s->at_line;
	double part = ((double)s->at_pulse + 0.5) / (double)s->pulses;
	bool forward = line % 2 == 0, up = s->at_swath % 2 == 0;
	double side = forward ? 2 * part - 1 : 1 - 2 * part;
	double along = ((double)line + part) * s->reach, y = up ? along : o->height - along;
	double sway = (synth_noise_at(&s->sway, (double)s->at_swath * 1000 + (double)s->round * 7, y) - 0.5) * 0.02 * s->swath;
	double x = (double)s->at_swath * s->advance + s->swath * 0.5 * (1 + side) + sway;

	x += (synth_fraction((uint32_t)h) - 0.5) * 0.7 * s->spacing;
	y += (synth_fraction((uint32_t)(h >> 32)) - 0.5) * 0.7 * s->reach;
	x = x < 0 ? 0 : x > o->width ? o->width : x;
	y = y < 0 ? 0 : y > o->height ? o->height : y;
	unsigned n = pulse_at(s, x, y, side, ret);
	double into = x - (double)s->at_swath * s->advance, back = s->advance;
	bool overlap = (s->at_swath > 0 && into < s->swath - back) || (s->at_swath + 1 < s->swaths && into > back);

	for (unsigned i = 0; i < n; i++) {
		ret[i].source = (uint16_t)(s->at_swath % 60000 + 1);
		ret[i].forward = forward;
		ret[i].edge = s->at_pulse + 1 == s->pulses;
		ret[i].angle = (float)(side * half_angle);
		ret[i].time = 100000 + (double)s->counter * 2.5e-6;
		if (overlap)
			ret[i].flags |= POINT_OVERLAP;
	}
	next_pulse(s);
	return n;
}
