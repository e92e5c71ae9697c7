/*
 * Metrics: distances along a direction and across it that count differently. A metric is an integer matrix, by which positions
 * are mapped before they are triangulated; the triangles are mapped back.
 *
 *     u = P x + Q y              along (P, Q)
 *     v = K (P y - Q x)          across it, K times as long
 *
 * Distances of the mapped positions are those of the metric, times the length of (P, Q). So the Delaunay triangulation of the
 * mapped positions has the empty ellipses of the metric. The map is linear and its determinant is positive: lines stay lines,
 * and triangles keep their orientation. Equal positions stay equal, different ones different.
 *
 * In normal form P and Q have no common divisor, and P > 0, or P = 0 and Q > 0: the opposite direction has the same metric. With
 * K = 1 all directions have the same metric, that of the plain plane, so there is none. Two metrics in normal form differ.
 */
#ifndef VIEW_METRIC_H
#define VIEW_METRIC_H

#include <stdbool.h>
#include <stdint.h>

struct err;

struct view_metric {
	int64_t p, q, k; /* k 0: no metric */
};

/* The largest P, Q (in either direction) and K of a normal form: mapped numbers fit 61 bits. */
#define VIEW_METRIC_MOST 10000

/* P and Q must not both be 0, and K is at least 1. */
struct view_metric view_metric_normal(struct view_metric);
/* -ERR_USAGE: it is no metric, or one of its numbers is too large. */
int view_metric_check(struct view_metric, struct err *err);

/* A metric with the origin of the mapped positions, so that these fit int32. `is.k` 0: positions are not mapped. */
struct view_map {
	struct view_metric is; /* normal */
	int64_t from[2];
	/* x = (a[0] u + a[1] v + a[2]) >> shift, y likewise with b, modulo 2^64: the division by the determinant, which leaves no
	 * rest, is a multiplication by the inverse of its odd part. */
	uint64_t a[3], b[3];
	unsigned shift;
};

void view_map_init(struct view_map *, struct view_metric normal, const int64_t from[2]);

/* x and y within 2^33; without the origin. */
static inline void view_metric_image(const struct view_metric *m, int64_t x, int64_t y, int64_t ret[2])
{
	ret[0] = m->p * x + m->q * y;
	ret[1] = m->k * (m->p * y - m->q * x);
}

/* The position of the mapped one. It must be mapped: others give rubbish. */
static inline void view_map_back(const struct view_map *m, const int32_t at[2], int32_t ret[2])
{
	uint64_t u = (uint64_t)(int64_t)at[0], v = (uint64_t)(int64_t)at[1];

	ret[0] = (int32_t)((int64_t)(m->a[0] * u + m->a[1] * v + m->a[2]) >> m->shift);
	ret[1] = (int32_t)((int64_t)(m->b[0] * u + m->b[1] * v + m->b[2]) >> m->shift);
}

/* Boxes (x1 y1 x2 y2) that contain the image of a box within 2^33, and what is mapped into a box within 2^41, rounded
 * outwards. */
void view_map_box(const struct view_map *, const int64_t box[4], int64_t ret[4]);
void view_map_box_back(const struct view_map *, const int64_t box[4], int64_t ret[4]);

/* The origin for numbers from `low` to `high`: such that they fit int32, and the least power of two more do not change it. False:
 * there is none. */
bool view_metric_origin(int64_t low, int64_t high, int64_t *ret);
/* Of the directions that are ever nearer to that of the metric, the last one with which a box of this width and height fits: in
 * *ret, with the same K. False: none that is within three degrees fits. */
bool view_metric_simpler(const struct view_metric *, int64_t width, int64_t height, struct view_metric *ret);

#endif
