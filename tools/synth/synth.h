/*
 * The parts of acut-synth: a landscape, a survey of it, point sets of simple shapes, and LAS.
 *
 * Everything depends on the options only: numbers are integer hashes of counters; positions use + - * / and sqrt of
 * doubles, which IEEE 754 defines to the last bit (the build disables contraction), and no function of libm. So a file
 * has the same bytes at every optimization level.
 */
#ifndef SYNTH_H
#define SYNTH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "decimal.h"

struct err;

enum synth_shape {
	SYNTH_SURVEY,
	SYNTH_UNIFORM,
	SYNTH_GRID,
	SYNTH_CLUSTERED,
	SYNTH_TWO_CLUSTERS,
	SYNTH_CIRCLE,
	SYNTH_RING,
	SYNTH_PARABOLA,
	SYNTH_CORRIDOR,
	SYNTH_CORRIDOR_DIAGONAL,
	SYNTH_COLLINEAR,
	SYNTH_DUPLICATES,
	SYNTH_SWATH,
	SYNTH_GAUSSIANS,
	SYNTH_PIPELINE,
	SYNTH_PIPELINE_DIAGONAL,
	SYNTH_PIPELINE_SLANTED,
	SYNTH_FEW,
	SYNTH_SHAPES
};

struct synth_options {
	enum synth_shape shape;
	uint64_t points, seed;
	double density;       /* points a square metre */
	double width, height; /* metres */
	struct decimal scale;
	struct decimal origin[3];
	uint64_t step, range; /* lattice units; 0: from density and area. step of SYNTH_FEW: positions */
	unsigned format;      /* 1 or 6 */
	bool no_crs;
};

struct synth_point {
	int32_t x, y, z; /* raw numbers of the file */
	uint16_t intensity, source;
	uint8_t cls, number, count;
	uint8_t flags;      /* POINT_WITHHELD ... */
	bool forward, edge; /* direction of the scan, last pulse of its line */
	float angle;        /* degrees */
	double time;
};

enum { SYNTH_RETURNS = 5 };

/* Hash of a counter; and a fraction of 1 from 32 of its bits. */
static inline uint64_t synth_hash(uint64_t seed, uint64_t counter)
{
	uint64_t z = seed + counter * UINT64_C(0x9e3779b97f4a7c15);

	z = (z ^ z >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
	z = (z ^ z >> 27) * UINT64_C(0x94d049bb133111eb);
	return z ^ z >> 31;
}

static inline double synth_fraction(uint32_t bits)
{
	return (double)bits * 0x1p-32;
}

/* floor without libm; |v| below 2^62. */
static inline int64_t synth_floor(double v)
{
	int64_t i = (int64_t)v;

	return i - ((double)i > v);
}

/* Value noise over cells of one size, 0 to 1. The last cell is cached, because neighbours use it again. The pair of a
 * vector is x and y, or low and high: IEEE 754 operations in each lane, the same as sequentially. */
typedef double synth_pair __attribute__((vector_size(16)));

struct synth_noise {
	synth_pair cell;         /* its lower corner, in cells; NaN: none yet */
	synth_pair corner, rise; /* at the left edge, low and high; difference to the right edge */
	uint64_t seed;
	double per_metre;
};

struct synth_noise synth_noise_of(uint64_t seed, double per_metre);
void synth_noise_find(struct synth_noise *, double u, double v);

static inline double synth_noise_at(struct synth_noise *n, double x, double y)
{
	const synth_pair at = (synth_pair){x, y} * n->per_metre;
	synth_pair in = at - n->cell;

	if (!((in[0] >= 0) & (in[0] < 1) & (in[1] >= 0) & (in[1] < 1))) {
		synth_noise_find(n, at[0], at[1]);
		in = at - n->cell;
	}
	in = in * in * (3 - 2 * in);
	const synth_pair edge = n->corner + n->rise * in[0];

	return edge[0] + (edge[1] - edge[0]) * in[1];
}

/* The landscape (synth_land.c). */
struct synth_land {
	struct synth_noise ridge, hill, bump, rough, forest, tree, town, bend;
	double width, height;
	uint64_t seed;
	struct { /* the block of houses that was used last */
		int64_t bx, by;
		bool known, built, gabled;
		double x0, x1, y0, y1, eaves;
	} block;
};

enum synth_cover { SYNTH_FIELD, SYNTH_FOREST, SYNTH_WATER, SYNTH_STREET, SYNTH_HOUSE };

void synth_land_init(struct synth_land *, const struct synth_options *);
/* Height of the ground (or the water's surface), in metres, and its cover; *ret_top: height of the cover above it. */
double synth_land_at(struct synth_land *, double x, double y, enum synth_cover *ret, double *ret_top);

/* The survey (synth_survey.c): the returns of the next pulse, 0 to SYNTH_RETURNS. It never ends. */
struct synth_survey {
	const struct synth_options *options;
	struct synth_land land;
	double per_scale, advance, spacing, swath, reach, roll;
	uint64_t swaths, lines, pulses; /* in total; in a swath; in a line */
	uint64_t at_swath, at_line, at_pulse, round, counter;
	struct synth_noise sway;
};

void synth_survey_init(struct synth_survey *, const struct synth_options *);
unsigned synth_survey_next(struct synth_survey *, struct synth_point ret[SYNTH_RETURNS]);

/* Whether it is a survey; otherwise it is a shape. */
static inline bool synth_flown(enum synth_shape shape)
{
	return shape == SYNTH_SURVEY || shape == SYNTH_SWATH;
}

/* Shapes (synth_shape.c): point number i. Range and step must be set (synth_shape_fit). */
/* Length, in metres, of a shape whose --area is length x width; 0 for other shapes. */
double synth_shape_length(enum synth_shape);
int synth_shape_fit(struct synth_options *, struct err *err);
void synth_shape_point(const struct synth_options *, struct synth_noise *height, uint64_t i, struct synth_point *ret);

/* LAS (synth_las.c). */
struct synth_las {
	const struct synth_options *options;
	int fd;
	const char *name;
	bool dry; /* only counts and measures */
	uint64_t count, by_return[15];
	int32_t min[3], max[3];
	uint8_t *buffer;
	size_t used, cap;
	unsigned record;
};

/* Bytes before the first point. */
size_t synth_las_head_size(const struct synth_options *);
/* Makes the header from the counts of `las`; `bytes` has that size. */
void synth_las_head(const struct synth_las *, uint8_t *bytes);
int synth_las_open(struct synth_las *, const struct synth_options *, int fd, const char *name, struct err *err);
int synth_las_put(struct synth_las *, const struct synth_point *, unsigned n, struct err *err);
int synth_las_flush(struct synth_las *, struct err *err);
/* Writes all bytes with write(2). A closed pipe is -ERR_IO with sys EPIPE. */
int synth_write(int fd, const void *bytes, size_t n, const char *name, struct err *err);

/* A saved header (synth_head.c): `head` has the size of the header. Load: SYNTH_E_NONE if there is no file. */
enum { SYNTH_KEPT_MAX = 4096, SYNTH_E_NONE = 1 };

int synth_head_load(const struct synth_options *, const char *path, uint8_t *head, struct err *err);
int synth_head_save(const struct synth_options *, const char *path, const uint8_t *head, struct err *err);

#endif
