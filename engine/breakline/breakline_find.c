/* Which feature of a file a piece is of: for messages. */
#include <math.h>

#include "breakline.h"

struct find {
	const int32_t *end[2];
	struct breakline_vertex first, last; /* of the line so far */
	bool any, ring;
	double nearest;
	uint32_t number;
};

/* The square of the distance of a position from a segment. Rounded, which is enough to choose by. */
static double distance(const int32_t at[2], const struct breakline_vertex *p, const struct breakline_vertex *q)
{
	double dx = (double)q->x - p->x, dy = (double)q->y - p->y, x = (double)at[0] - p->x, y = (double)at[1] - p->y;
	double length = dx * dx + dy * dy, t = length > 0 ? (x * dx + y * dy) / length : 0;

	t = t < 0 ? 0 : t > 1 ? 1 : t;
	x -= t * dx;
	y -= t * dy;
	return x * x + y * y;
}

static void segment(struct find *f, const struct breakline_vertex *p, const struct breakline_vertex *q)
{
	double a = distance(f->end[0], p, q), b = distance(f->end[1], p, q), most = a > b ? a : b;

	if (most >= f->nearest)
		return;
	f->nearest = most;
	f->number = p->number;
}

static void end_line(struct find *f)
{
	if (f->any && f->ring)
		segment(f, &f->last, &f->first);
}

static int each(void *ctx, const struct breakline_vertex *v, size_t n, struct err *err)
{
	struct find *f = ctx;

	for (size_t i = 0; i < n; i++) {
		if (v[i].bits & BREAKLINE_LINE) {
			end_line(f);
			f->first = v[i];
			f->ring = v[i].bits & BREAKLINE_RING;
		} else {
			segment(f, &f->last, &v[i]);
		}
		f->last = v[i];
		f->any = true;
	}
	return 0;
}

int breakline_find(int dirfd, const char *name, const int32_t a[2], const int32_t b[2], double *ret_distance,
		   uint32_t *ret_number, struct err *err)
{
	struct find f = {.end = {a, b}, .nearest = INFINITY};
	int r = breakline_read(dirfd, name, each, &f, err);

	if (r)
		return r;
	end_line(&f);
	*ret_distance = sqrt(f.nearest);
	*ret_number = f.number;
	return 0;
}
