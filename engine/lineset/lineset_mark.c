/*
 * States of positions, and the marks of records (lineset.h). A state is far's with the turns of all pieces that a ray to greater
 * x crosses. The position counts as moved to greater x and, much less, to greater y, as in base/area.h: so a piece is crossed
 * if its lower end is at the height of the ray or below and its upper end above, and it is right of the position. No position
 * is then on a piece, and no ray goes through a vertex.
 *
 * In a box one ray is enough: from the state of its lower left corner a path leads to each record, up along the left side of the
 * box and then right, and only pieces that meet the box cross it. Each of these is compared with each record, so no memory
 * depends on their number.
 */
#include <math.h>

#include "err.h"
#include "geom.h"
#include "lineset_file.h"

static int64_t floor_div(int64_t n, int64_t d)
{
	return n / d - (n % d < 0);
}

static int32_t clamp(int64_t v)
{
	return (int32_t)(v < INT32_MIN ? INT32_MIN : v > INT32_MAX ? INT32_MAX : v);
}

/* ---- the state of a position ---- */

struct ray {
	int64_t x, y; /* times den */
	int64_t den;
	unsigned state;
};

static int cross_ray(void *ctx, const struct lineset_piece *p, struct err *err)
{
	struct ray *r = ctx;
	bool up = p->b[1] > p->a[1];
	const int32_t *low = up ? p->a : p->b, *high = up ? p->b : p->a;
	int64_t dx = (int64_t)high[0] - low[0], dy = (int64_t)high[1] - low[1];

	if (r->y < r->den * low[1] || r->y >= r->den * high[1])
		return 0;
	/* Left of the piece as it is directed upwards; on it is not. */
	if ((geom_i128)dx * (r->y - r->den * low[1]) - (geom_i128)dy * (r->x - r->den * low[0]) > 0)
		r->state ^= p->turns;
	return 0;
}

int lineset_state(struct lineset_reader *r, int64_t x, int64_t y, unsigned den, unsigned *ret, struct err *err)
{
	const struct lineset_info *info = &r->set->info;
	struct ray ray = {x, y, den, info->far};
	int64_t left = floor_div(x, den), low = floor_div(y, den);
	struct lineset_visit v = {.turns = LINESET_LAKE | LINESET_OUT, .piece = cross_ray, .ctx = &ray};
	int rc = 0;

	v.box[0] = clamp(left);
	v.box[1] = clamp(low);
	v.box[2] = INT32_MAX;
	v.box[3] = clamp(low + (low * den != y));
	if (info->areas && left <= INT32_MAX && low <= INT32_MAX && low >= INT32_MIN)
		rc = lineset_visit(r, &v, err);
	if (rc == 0)
		*ret = ray.state;
	return rc;
}

/* ---- marks ---- */

/* States of records while they are made: in bits of the tag that are free until then. */
enum { STATE_SHIFT = POINT_SOURCE_SHIFT + 8, STATE = (LINESET_LAKE | LINESET_OUT) << STATE_SHIFT };
_Static_assert(POINT_LINE << 8 == 1 << STATE_SHIFT && (POINT_IN_AREA << 4) < 1 << STATE_SHIFT, "the bits are free");

struct mark {
	int32_t box[4];
	double clear;
	struct point *pts;
	size_t n;
	bool met; /* a piece meets the widened box */
};

/* Distances in doubles: differences of lattice numbers are exact, products are rounded once each, so the result is the
 * same on all machines. */
static bool is_near(const struct lineset_piece *p, const struct point *at, double clear)
{
	double dx = (double)((int64_t)p->b[0] - p->a[0]), dy = (double)((int64_t)p->b[1] - p->a[1]);
	double x = (double)((int64_t)at->x - p->a[0]), y = (double)((int64_t)at->y - p->a[1]);
	double along = x * dx + y * dy, length = dx * dx + dy * dy, across;

	if (along <= 0)
		return x * x + y * y <= clear * clear;
	if (along >= length) {
		x = (double)((int64_t)at->x - p->b[0]);
		y = (double)((int64_t)at->y - p->b[1]);
		return x * x + y * y <= clear * clear;
	}
	across = x * dy - y * dx;
	return across * across <= clear * clear * length;
}

static void mark_near(struct mark *m, const struct lineset_piece *p)
{
	int64_t wide = (int64_t)ceil(m->clear), low = p->a[1] < p->b[1] ? p->a[1] : p->b[1];
	int64_t high = p->a[1] < p->b[1] ? p->b[1] : p->a[1];

	for (size_t i = 0; i < m->n; i++) {
		struct point *at = &m->pts[i];
		const int32_t xy[2] = {at->x, at->y};

		if (at->x < p->a[0] - wide || at->x > p->b[0] + wide || at->y < low - wide || at->y > high + wide)
			continue;
		if (at->tag & (POINT_LINE | POINT_NEAR_LINE))
			continue;
		/* The box of the piece alone decides of a position on its line whether it is on the piece. */
		if ((at->x >= p->a[0] && at->x <= p->b[0] && at->y >= low && at->y <= high && geom_orient(p->a, p->b, xy) == 0) ||
		    (m->clear > 0 && is_near(p, at, m->clear)))
			at->tag |= POINT_NEAR_LINE;
	}
}

/* Whether the moved position is above the piece, which spans its moved x. */
static bool is_above(const struct lineset_piece *p, int32_t x, int32_t y)
{
	const int32_t at[2] = {x, y};
	int side = geom_orient(p->a, p->b, at);

	return side ? side > 0 : p->b[1] <= p->a[1];
}

/* Whether the moved position is right of the piece, which spans its moved y. */
static bool is_right(const struct lineset_piece *p, int32_t x, int32_t y)
{
	const int32_t at[2] = {x, y};
	int side = geom_orient(p->a, p->b, at);

	return p->b[1] > p->a[1] ? side <= 0 : side >= 0;
}

/* Turns the states of the records whose path from the corner crosses the piece. */
static void turn_states(struct mark *m, const struct lineset_piece *p)
{
	int32_t low = p->a[1] < p->b[1] ? p->a[1] : p->b[1], high = p->a[1] < p->b[1] ? p->b[1] : p->a[1];
	bool spans = p->a[0] <= m->box[0] && m->box[0] < p->b[0];
	bool corner = spans && is_above(p, m->box[0], m->box[1]);

	for (size_t i = 0; i < m->n; i++) {
		struct point *at = &m->pts[i];
		bool turn = spans && is_above(p, m->box[0], at->y) != corner;

		/* A piece that is right of the record crosses no more of its path. */
		if (at->y >= low && at->y < high && at->x >= p->a[0])
			turn ^= is_right(p, at->x, at->y) && !is_right(p, m->box[0], at->y);
		at->tag ^= (uint16_t)(turn ? p->turns << STATE_SHIFT : 0);
	}
}

static int mark_piece(void *ctx, const struct lineset_piece *p, struct err *err)
{
	struct mark *m = ctx;

	m->met = true;
	mark_near(m, p);
	if (p->turns)
		turn_states(m, p);
	return 0;
}

int lineset_mark(struct lineset_reader *r, const int32_t box[4], double clear, struct point *pts, size_t n, struct err *err)
{
	const struct lineset_info *info = &r->set->info;
	struct mark m = {.box = {box[0], box[1], box[2], box[3]}, .clear = clear, .pts = pts, .n = n};
	int64_t wide = (int64_t)ceil(clear);
	const int32_t near[4] = {clamp(box[0] - wide), clamp(box[1] - wide), clamp(box[2] + wide), clamp(box[3] + wide)};
	unsigned state = 0;
	uint64_t pieces;
	int rc = lineset_count(r, near, 1, &pieces, err);

	if (rc == 0 && info->areas)
		rc = lineset_state(r, box[0], box[1], 1, &state, err);
	if (rc || (!pieces && !state))
		return rc;
	for (size_t i = 0; i < n; i++)
		pts[i].tag = (uint16_t)((pts[i].tag & ~STATE) | state << STATE_SHIFT);
	if (pieces)
		rc = lineset_find(r, near, mark_piece, &m, err);
	for (size_t i = 0; i < n; i++) {
		unsigned tag = pts[i].tag;

		if ((tag & STATE) && !(tag & (POINT_LINE | POINT_NEAR_LINE)))
			tag |= POINT_IN_AREA;
		pts[i].tag = (uint16_t)(tag & ~STATE);
	}
	return rc;
}
