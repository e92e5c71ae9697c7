/*
 * Point sets of simple shapes, in lattice numbers: easy ones for a triangulator, and difficult ones. Point i depends on
 * the seed and i only. All points are one return of class 2.
 */
#include <string.h>

#include "err.h"
#include "synth.h"

enum { CLUSTERS = 64, GAUSSIANS = 1000, SPREADS = 20, FEW = 1000 };
static const uint64_t span_most = UINT64_C(1) << 31, range_most = UINT64_C(1) << 32;

static uint64_t side_of(uint64_t points)
{
	uint64_t w = (uint64_t)__builtin_sqrt((double)points);

	while (w * w < points)
		w++;
	return w ? w : 1;
}

/* How much longer than a square a thin shape must be to have as many positions. */
static double lengthened(const struct synth_options *o, double steps)
{
	double room = 8 * (double)o->points / (steps < 1 ? 1 : steps);

	switch (o->shape) {
	case SYNTH_CORRIDOR:
	case SYNTH_CORRIDOR_DIAGONAL:
		return 32; /* a thousand times as long as wide */
	case SYNTH_TWO_CLUSTERS:
		return 8;
	case SYNTH_CIRCLE:
		return room < 1 ? 1 : room;
	default:
		return 1;
	}
}

double synth_shape_length(enum synth_shape shape)
{
	bool pipeline = shape == SYNTH_PIPELINE || shape == SYNTH_PIPELINE_DIAGONAL || shape == SYNTH_PIPELINE_SLANTED;

	return pipeline ? 300000 : 0;
}

int synth_shape_fit(struct synth_options *o, struct err *err)
{
	double per_scale = 1 / decimal_double(o->scale);
	double widest = o->width > o->height ? o->width : o->height;

	if (!o->step && o->shape != SYNTH_FEW) {
		double step = __builtin_sqrt(1 / o->density) * per_scale;

		o->step = step < 1 ? 1 : (uint64_t)step;
	}
	if (o->shape == SYNTH_GRID || o->shape == SYNTH_COLLINEAR) {
		uint64_t many = o->shape == SYNTH_GRID ? side_of(o->points) : o->points;

		if (o->step > span_most || many > span_most / o->step)
			return err_set(err, ERR_USAGE, "a step of %llu with %llu points does not fit into 32 bits",
				       (unsigned long long)o->step, (unsigned long long)o->points);
		return 0;
	}
	if (o->shape == SYNTH_FEW && !o->step)
		o->step = FEW;
	if (o->shape == SYNTH_GAUSSIANS && !o->range)
		o->range = UINT64_C(1) << 30;
	if (!o->range) {
		widest *= lengthened(o, widest * per_scale);
		if (widest * per_scale >= (double)range_most)
			return err_set(err, ERR_USAGE, "%g metres at this scale do not fit into 32 bits; use --range", widest);
		o->range = (uint64_t)(widest * per_scale) + 1;
	}
	if (o->range > range_most)
		return err_set(err, ERR_USAGE, "--range goes up to %llu", (unsigned long long)range_most);
	if (o->shape == SYNTH_PARABOLA && o->points > span_most)
		return err_set(err, ERR_USAGE, "a parabola has up to %llu points", (unsigned long long)span_most);
	return 0;
}

/* From -range / 2 on. */
static int64_t within(uint64_t range, uint32_t bits)
{
	return (int64_t)(range * bits >> 32) - (int64_t)(range / 2);
}

/* Around 0, the sum of four numbers: bell-shaped, at most `reach`. */
static int64_t bell(uint64_t reach, uint64_t h)
{
	int64_t sum = 0;

	for (int i = 0; i < 4; i++)
		sum += (int64_t)(h >> (16 * i) & 0xffff) - 32768;
	return sum * (int64_t)reach / 131072;
}

/* A point of the unit circle by its rational parametrization, without an angle. */
static void on_circle(uint64_t h, double *ret_x, double *ret_y)
{
	double t = synth_fraction((uint32_t)h), u = (1 - t * t) / (1 + t * t), v = 2 * t / (1 + t * t);

	*ret_x = h >> 32 & 1 ? u : -u;
	*ret_y = h >> 33 & 1 ? v : -v;
}

static void clustered(const struct synth_options *o, uint64_t h, uint64_t g, int64_t xy[2])
{
	if (h % 10 == 0) {
		xy[0] = within(o->range, (uint32_t)(h >> 32));
		xy[1] = within(o->range, (uint32_t)(g >> 32));
		return;
	}
	uint64_t middle = synth_hash(o->seed + 21, h / 10 % CLUSTERS), reach = o->range / (40 + (middle & 127)) + 2;

	xy[0] = within(o->range, (uint32_t)middle) + bell(reach, h ^ h >> 7);
	xy[1] = within(o->range, (uint32_t)(middle >> 32)) + bell(reach, g);
}

/* The widest is 2^20 times as wide as the narrowest; all have the same number of points. */
static void gaussians(const struct synth_options *o, uint64_t h, uint64_t g, int64_t xy[2])
{
	uint64_t middle = synth_hash(o->seed + 22, h % GAUSSIANS), spread = synth_hash(middle, 1),
		 unit = o->range >> 26 ? o->range >> 26 : 1, reach = unit << spread % (SPREADS + 1);

	reach += reach * (spread >> 32 & 0xff) >> 8;
	xy[0] = within(o->range, (uint32_t)middle) + bell(reach, g);
	xy[1] = within(o->range, (uint32_t)(middle >> 32)) + bell(reach, synth_hash(g, 4));
}

/* Along the x axis, rotated to the rational direction `x, y`. */
static void pipeline(const struct synth_options *o, uint64_t h, double x, double y, int64_t xy[2])
{
	double per_scale = 1 / decimal_double(o->scale), along = (synth_fraction((uint32_t)h) - 0.5) * o->width * per_scale,
	       across = (synth_fraction((uint32_t)(h >> 32)) - 0.5) * o->height * per_scale;

	xy[0] = synth_floor(along * x - across * y + 0.5);
	xy[1] = synth_floor(along * y + across * x + 0.5);
}

static void parabola(const struct synth_options *o, uint64_t i, int64_t xy[2])
{
	/* y = x^2 exactly while that fits; beyond, the same curve with y in coarser units. */
	int64_t x = (int64_t)(i - o->points / 2), most = (int64_t)(o->points / 2 + 1),
		coarse = most * most / (int64_t)(span_most / 2) + 1;

	xy[0] = x;
	xy[1] = x * x / coarse;
}

static void place(const struct synth_options *o, uint64_t i, int64_t xy[2])
{
	uint64_t h = synth_hash(o->seed, i), g = synth_hash(h, 3);
	double cx, cy, radius = (double)o->range * 0.5;
	uint64_t w;

	switch (o->shape) {
	case SYNTH_GRID:
		w = side_of(o->points);
		xy[0] = (int64_t)(i % w * o->step);
		xy[1] = (int64_t)(i / w * o->step);
		break;
	case SYNTH_CLUSTERED:
		clustered(o, h, g, xy);
		break;
	case SYNTH_TWO_CLUSTERS:
		xy[0] = (int64_t)(o->range / 20 * 9) * (h & 1 ? 1 : -1) + bell(o->range / 24 + 2, h ^ h >> 5);
		xy[1] = (int64_t)(o->range / 20 * 9) * (h & 1 ? 1 : -1) + bell(o->range / 24 + 2, g);
		break;
	case SYNTH_CIRCLE:
	case SYNTH_RING:
		on_circle(h, &cx, &cy);
		if (o->shape == SYNTH_RING)
			radius *= 0.9 + 0.1 * synth_fraction((uint32_t)g);
		xy[0] = synth_floor(radius * cx + 0.5);
		xy[1] = synth_floor(radius * cy + 0.5);
		break;
	case SYNTH_PARABOLA:
		parabola(o, i, xy);
		break;
	case SYNTH_CORRIDOR:
		xy[0] = within(o->range, (uint32_t)h);
		xy[1] = within(o->range / 1000 + 2, (uint32_t)(h >> 32));
		break;
	case SYNTH_CORRIDOR_DIAGONAL:
		xy[0] = within(o->range, (uint32_t)h);
		xy[1] = xy[0] + within(o->range / 1000 + 2, (uint32_t)(h >> 32));
		break;
	case SYNTH_GAUSSIANS:
		gaussians(o, h, g, xy);
		break;
	case SYNTH_PIPELINE:
		pipeline(o, h, 1, 0, xy);
		break;
	case SYNTH_PIPELINE_DIAGONAL:
		pipeline(o, h, __builtin_sqrt(0.5), __builtin_sqrt(0.5), xy);
		break;
	case SYNTH_PIPELINE_SLANTED:
		pipeline(o, h, 0.8, 0.6, xy);
		break;
	case SYNTH_FEW:
		h = synth_hash(o->seed, h % o->step);
		xy[0] = within(o->range, (uint32_t)h);
		xy[1] = within(o->range, (uint32_t)(h >> 32));
		break;
	case SYNTH_COLLINEAR:
		xy[0] = xy[1] = ((int64_t)i - (int64_t)(o->points / 2)) * (int64_t)o->step;
		break;
	case SYNTH_DUPLICATES:
		h = synth_hash(o->seed, h % (o->points / 100 + 1));
		/* fall through */
	default:
		xy[0] = within(o->range, (uint32_t)h);
		xy[1] = within(o->range, (uint32_t)(h >> 32));
		break;
	}
}

static int32_t clamped(int64_t v)
{
	return (int32_t)(v < INT32_MIN ? INT32_MIN : v > INT32_MAX ? INT32_MAX : v);
}

void synth_shape_point(const struct synth_options *o, struct synth_noise *height, uint64_t i, struct synth_point *ret)
{
	int64_t xy[2];

	memset(ret, 0, sizeof *ret);
	place(o, i, xy);
	ret->x = clamped(xy[0]);
	ret->y = clamped(xy[1]);
	ret->z = (int32_t)synth_floor(synth_noise_at(height, (double)xy[0], (double)xy[1]) * 10000);
	if (o->shape == SYNTH_DUPLICATES || o->shape == SYNTH_FEW)
		ret->z += (int32_t)(synth_hash(o->seed + 1, i) % 1000);
	ret->intensity = (uint16_t)(i % 4096);
	ret->source = 1;
	ret->cls = 2;
	ret->number = ret->count = 1;
	ret->forward = true;
	ret->time = 100000 + (double)i * 2.5e-6;
}
