/*
 * Which segments cross, and which pixels they meet: the plane is halved again and again until a box has few
 * of them, and these are compared each with each (docs/design/constraints.md, "Finding what meets").
 *
 * A list is not copied. The items that meet a half are moved to its front, the half is searched, then the same for the
 * other half. So the memory is 4 bytes for each segment and point.
 */
#include "geom.h"
#include "snap_priv.h"

enum {
	FEW = 12,             /* segments that are compared each with each */
	FEW_COMPARISONS = 64, /* of segments with points */
	HALVINGS = 4,         /* after which it is looked at whether they pay */
};

/* Pixels, both ends included. */
struct box {
	int32_t min[2], max[2];
};

struct join {
	const struct snap_set *set;
	snap_pair_fn pair;
	const int32_t (*point)[2];
	snap_point_fn found;
	void *ctx;
};

static struct box box_of(const int32_t (*xy)[2], uint32_t n)
{
	struct box b = {{INT32_MAX, INT32_MAX}, {INT32_MIN, INT32_MIN}};

	for (uint32_t i = 0; i < n; i++)
		for (unsigned k = 0; k < 2; k++) {
			b.min[k] = xy[i][k] < b.min[k] ? xy[i][k] : b.min[k];
			b.max[k] = xy[i][k] > b.max[k] ? xy[i][k] : b.max[k];
		}
	return b;
}

static bool box_has(const struct box *b, const int32_t at[2])
{
	return b->min[0] <= at[0] && at[0] <= b->max[0] && b->min[1] <= at[1] && at[1] <= b->max[1];
}

static bool box_is_pixel(const struct box *b)
{
	return b->min[0] == b->max[0] && b->min[1] == b->max[1];
}

/* One half of the box across its longer side. */
static struct box box_half(const struct box *b, unsigned upper)
{
	struct box half = *b;
	unsigned k = (int64_t)b->max[1] - b->min[1] > (int64_t)b->max[0] - b->min[0];
	int32_t middle = (int32_t)(b->min[k] + ((int64_t)b->max[k] - b->min[k]) / 2);

	if (upper)
		half.min[k] = middle + 1;
	else
		half.max[k] = middle;
	return half;
}

static struct box box_of_segment(const struct snap_segment *s)
{
	struct box b;

	for (unsigned k = 0; k < 2; k++) {
		b.min[k] = s->a[k] < s->b[k] ? s->a[k] : s->b[k];
		b.max[k] = s->a[k] < s->b[k] ? s->b[k] : s->a[k];
	}
	return b;
}

/* False only if the segment does not meet the pixels of the box: their boxes are apart, or the box is on one side. */
static bool box_meets(const struct box *b, const struct snap_segment *s)
{
	int64_t dx = (int64_t)s->b[0] - s->a[0], dy = (int64_t)s->b[1] - s->a[1];
	int64_t x[2], y[2];
	geom_i128 low, high;

	for (unsigned k = 0; k < 2; k++)
		if ((s->a[k] < b->min[k] && s->b[k] < b->min[k]) || (s->a[k] > b->max[k] && s->b[k] > b->max[k]))
			return false;
	/* The corners that are farthest to either side of the line, doubled. */
	x[0] = 2 * ((int64_t)b->min[0] - s->a[0]) - 1;
	x[1] = 2 * ((int64_t)b->max[0] - s->a[0]) + 1;
	y[0] = 2 * ((int64_t)b->min[1] - s->a[1]) - 1;
	y[1] = 2 * ((int64_t)b->max[1] - s->a[1]) + 1;
	low = (geom_i128)dx * y[dx < 0] - (geom_i128)dy * x[dy > 0];
	high = (geom_i128)dx * y[dx > 0] - (geom_i128)dy * x[dy < 0];
	return low <= 0 && high >= 0;
}

static void swap(uint32_t *a, uint32_t *b)
{
	uint32_t t = *a;

	*a = *b;
	*b = t;
}

/* Moves the segments that meet the box to the front. Returns how many they are. */
static uint32_t gather_segments(const struct join *j, uint32_t *list, uint32_t n, const struct box *b)
{
	uint32_t front = 0;

	for (uint32_t i = 0; i < n; i++) {
		struct snap_segment s = snap_segment_of(j->set, list[i]);

		if (box_meets(b, &s))
			swap(&list[front++], &list[i]);
	}
	return front;
}

static uint32_t gather_points(const struct join *j, uint32_t *list, uint32_t n, const struct box *b)
{
	uint32_t front = 0;

	for (uint32_t i = 0; i < n; i++)
		if (box_has(b, j->point[list[i]]))
			swap(&list[front++], &list[i]);
	return front;
}

/* A crossing is of the box that has the position that it is rounded to, so it is found once. */
static int compare_pairs(const struct join *j, const uint32_t *list, uint32_t n, const struct box *b)
{
	int wrong = 0;

	for (uint32_t i = 0; i < n && !wrong; i++) {
		struct snap_segment s = snap_segment_of(j->set, list[i]);
		struct box around = box_of_segment(&s);

		for (uint32_t k = i + 1; k < n && !wrong; k++) {
			struct snap_segment t = snap_segment_of(j->set, list[k]);
			int32_t at[2];

			if (box_meets(&around, &t) && snap_cross(&s, &t, at) && box_has(b, at))
				wrong = j->pair(j->ctx, list[i], list[k], at);
		}
	}
	return wrong;
}

/* How many times as many the segments of a box became in the halvings since the last count, in 1/256. */
struct growth {
	uint64_t times;
	unsigned halvings;
};

/* In 16 equal boxes g times as many segments make g^2 / 16 as many comparisons as in one: halving does not pay from 4
 * on. That is so for long segments that cross or run side by side. */
static bool growth_pays(struct growth *g, uint32_t n, uint64_t in_halves)
{
	g->times = g->times * in_halves / n;
	if (++g->halvings < HALVINGS)
		return true;
	if (g->times >= 4 * 256)
		return false;
	*g = (struct growth){256, 0};
	return true;
}

static int pairs_in(const struct join *j, uint32_t *list, uint32_t n, const struct box *b, struct growth g)
{
	uint64_t in_halves = 0;
	int wrong = 0;

	if (n <= FEW || box_is_pixel(b))
		return compare_pairs(j, list, n, b);
	for (unsigned k = 0; k < 2; k++) {
		struct box half = box_half(b, k);

		in_halves += gather_segments(j, list, n, &half);
	}
	if (!growth_pays(&g, n, in_halves))
		return compare_pairs(j, list, n, b);
	for (unsigned k = 0; k < 2 && !wrong; k++) {
		struct box half = box_half(b, k);

		wrong = pairs_in(j, list, gather_segments(j, list, n, &half), &half, g);
	}
	return wrong;
}

static int points_in(const struct join *j, uint32_t *list, uint32_t n, uint32_t *points, uint32_t npoint, const struct box *b)
{
	int wrong = 0;

	if (n == 0 || npoint == 0)
		return 0;
	if (npoint == 1 || (uint64_t)n * npoint <= FEW_COMPARISONS) {
		for (uint32_t i = 0; i < n && !wrong; i++) {
			struct snap_segment s = snap_segment_of(j->set, list[i]);

			for (uint32_t k = 0; k < npoint && !wrong; k++)
				if (snap_meet_pixel(&s, j->point[points[k]]))
					wrong = j->found(j->ctx, list[i], points[k]);
		}
		return wrong;
	}
	for (unsigned k = 0; k < 2 && !wrong; k++) {
		struct box half = box_half(b, k);
		uint32_t here = gather_points(j, points, npoint, &half);

		wrong = points_in(j, list, here ? gather_segments(j, list, n, &half) : 0, points, here, &half);
	}
	return wrong;
}

static int list_all(struct snap_memory *m, uint32_t n, struct snap_array *ret)
{
	int wrong = snap_array_room(m, ret, n);

	for (uint32_t i = 0; !wrong && i < n; i++)
		((uint32_t *)ret->at)[i] = i;
	return wrong;
}

int snap_join_pairs(struct snap_memory *m, const struct snap_set *set, snap_pair_fn found, void *ctx)
{
	struct join j = {.set = set, .pair = found, .ctx = ctx};
	struct snap_array list = {.size = sizeof(uint32_t)};
	struct box all = {{INT32_MIN, INT32_MIN}, {INT32_MAX, INT32_MAX}};
	int wrong = list_all(m, set->n, &list);

	if (!wrong)
		wrong = pairs_in(&j, list.at, set->n, &all, (struct growth){256, 0});
	snap_array_done(m, &list);
	return wrong;
}

int snap_join_pixels(struct snap_memory *m, const struct snap_set *set, const int32_t (*point)[2], uint32_t npoint,
		     snap_point_fn found, void *ctx)
{
	struct join j = {.set = set, .point = point, .found = found, .ctx = ctx};
	struct snap_array list = {.size = sizeof(uint32_t)}, points = {.size = sizeof(uint32_t)};
	struct box all = box_of(point, npoint);
	int wrong = list_all(m, set->n, &list);

	if (!wrong)
		wrong = list_all(m, npoint, &points);
	if (!wrong)
		wrong = points_in(&j, list.at, set->n, points.at, npoint, &all);
	snap_array_done(m, &points);
	snap_array_done(m, &list);
	return wrong;
}
