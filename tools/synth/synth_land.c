/*
 * The landscape of acut-synth: ridges and hills of value noise, a winding river, woods, and built-up areas of blocks
 * with houses. In metres; x and y from 0 to the size of the area.
 */
#include <string.h>

#include "synth.h"

struct synth_noise synth_noise_of(uint64_t seed, double per_metre)
{
	const double none = __builtin_nan("");

	return (struct synth_noise){.cell = {none, none}, .seed = seed, .per_metre = per_metre};
}

void synth_noise_find(struct synth_noise *n, double u, double v)
{
	int64_t ix = synth_floor(u), iy = synth_floor(v);
	double corner[4];

	for (unsigned i = 0; i < 4; i++) {
		uint64_t cell = (uint64_t)(ix + (i & 1)) * UINT64_C(0x1000000000000061) + (uint64_t)(iy + (i >> 1));

		corner[i] = synth_fraction((uint32_t)(synth_hash(n->seed, cell) >> 32));
	}
	n->cell = (synth_pair){(double)ix, (double)iy};
	n->corner = (synth_pair){corner[0], corner[2]};
	n->rise = (synth_pair){corner[1] - corner[0], corner[3] - corner[2]};
}

static struct synth_noise noise(uint64_t seed, unsigned which, double size)
{
	return synth_noise_of(synth_hash(seed, 1000 + which), 1 / size);
}

/* Sizes are those of a real landscape, but smaller in a small area, so that it has everything. */
static double at_most(double size, double part)
{
	return size < part ? size : part;
}

void synth_land_init(struct synth_land *l, const struct synth_options *o)
{
	memset(l, 0, sizeof *l);
	l->width = o->width;
	l->height = o->height;
	l->seed = synth_hash(o->seed, 77);
	l->ridge = noise(o->seed, 0, at_most(1700, o->width));
	l->hill = noise(o->seed, 1, at_most(430, o->width / 2));
	l->bump = noise(o->seed, 2, 60);
	l->rough = noise(o->seed, 3, 3);
	l->forest = noise(o->seed, 4, at_most(260, o->width / 4));
	l->tree = noise(o->seed, 5, 5);
	l->town = noise(o->seed, 6, at_most(600, o->width / 4));
	l->bend = noise(o->seed, 7, at_most(500, o->height / 2));
}

static double distance(double a, double b)
{
	return a > b ? a - b : b - a;
}

/* Distance from the middle of the river, in metres. */
static double from_river(struct synth_land *l, double x, double y)
{
	double swing = l->width * 0.5 < 700 ? l->width * 0.5 : 700;

	return distance(x, l->width * 0.55 + (synth_noise_at(&l->bend, 0, y) - 0.5) * swing);
}

static double river_half(const struct synth_land *l)
{
	return l->width / 40 < 22 ? l->width / 40 : 22;
}

static double ground(struct synth_land *l, double x, double y, double river)
{
	double n = 2 * synth_noise_at(&l->ridge, x, y) - 1, ridge = 1 - (n < 0 ? -n : n);
	double bank = river - river_half(l), level = 180 + 0.0015 * y;
	double z = 140 * ridge * ridge + 45 * synth_noise_at(&l->hill, x, y) + 5 * synth_noise_at(&l->bump, x, y) +
		   0.25 * synth_noise_at(&l->rough, x, y);

	return bank <= 0 ? level : level + 0.4 + z * (bank / (bank + 160));
}

enum { BLOCK_X = 34, BLOCK_Y = 26 };

static void find_block(struct synth_land *l, int64_t bx, int64_t by)
{
	uint64_t h = synth_hash(l->seed, (uint64_t)bx * UINT64_C(0x100000001b3) + (uint64_t)by);
	double middle_x = ((double)bx + 0.5) * BLOCK_X, middle_y = ((double)by + 0.5) * BLOCK_Y;
	double half_x = 5 + (double)(h & 7), half_y = 4 + (double)(h >> 3 & 3);
	double tall = (h >> 8 & 31) == 0 ? 34 : 3.2 + (double)(h >> 5 & 7);

	l->block.bx = bx;
	l->block.by = by;
	l->block.known = true;
	l->block.built = (h >> 16 & 3) != 0;
	l->block.gabled = (h >> 18 & 1) != 0;
	l->block.x0 = middle_x - half_x;
	l->block.x1 = middle_x + half_x;
	l->block.y0 = middle_y - half_y;
	l->block.y1 = middle_y + half_y;
	l->block.eaves = ground(l, middle_x, middle_y, from_river(l, middle_x, middle_y)) + tall;
}

/* The height of the roof if there is a house; else false. */
static bool roof_at(struct synth_land *l, double x, double y, double *ret)
{
	int64_t bx = synth_floor(x / BLOCK_X), by = synth_floor(y / BLOCK_Y);

	if (!l->block.known || bx != l->block.bx || by != l->block.by)
		find_block(l, bx, by);
	if (!l->block.built || x < l->block.x0 || x > l->block.x1 || y < l->block.y0 || y > l->block.y1)
		return false;
	*ret = l->block.eaves;
	if (l->block.gabled)
		*ret += 0.6 * (y - l->block.y0 < l->block.y1 - y ? y - l->block.y0 : l->block.y1 - y);
	return true;
}

double synth_land_at(struct synth_land *l, double x, double y, enum synth_cover *ret, double *ret_top)
{
	double river = from_river(l, x, y), z = ground(l, x, y, river), roof, wood;

	*ret = SYNTH_FIELD;
	*ret_top = 0;
	if (river <= river_half(l)) {
		*ret = SYNTH_WATER;
		return z;
	}
	if (river > 2 * river_half(l) && synth_noise_at(&l->town, x, y) > 0.62) {
		*ret = SYNTH_STREET;
		if (roof_at(l, x, y, &roof) && roof > z) {
			*ret = SYNTH_HOUSE;
			*ret_top = roof - z;
		}
		return z;
	}
	wood = synth_noise_at(&l->forest, x, y);
	if (wood > 0.5) {
		double crown = synth_noise_at(&l->tree, x, y);

		*ret = SYNTH_FOREST;
		*ret_top = (6 + 40 * (wood - 0.5)) * (0.35 + 0.65 * crown);
	}
	return z;
}
