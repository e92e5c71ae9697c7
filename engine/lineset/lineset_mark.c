/*
 * States of positions, and the marks of records (lineset.h). A position counts as moved to greater x and, much less, to greater
 * y, as in base/area.h. So no position is on a piece, no straight path goes through a vertex, and the state changes where a path
 * crosses a piece.
 *
 * The tree has the state of a position near each of its leaves, so a path to any position is short. In a box one state is
 * enough: from its lower left corner a path leads to each record, up along the left side of the box and then right, and only
 * pieces that meet the box cross it. Each of these is compared with each record, so no memory depends on their number.
 */
#include <math.h>
#include <string.h>

#include "err.h"
#include "geom.h"
#include "lineset_file.h"
#include "squares.h"

static int64_t floor_div(int64_t n, int64_t d)
{
	return n / d - (n % d < 0);
}

static int32_t clamp(int64_t v)
{
	return (int32_t)(v < INT32_MIN ? INT32_MIN : v > INT32_MAX ? INT32_MAX : v);
}

/* ---- the state of a position ---- */

/* The sign of the side of the piece on which (x / den, y / den) is: 1 left of it, as it is directed from a to b. */
static int side_of(const struct lineset_piece *p, int64_t x, int64_t y, int64_t den)
{
	int64_t dx = (int64_t)p->b[0] - p->a[0], dy = (int64_t)p->b[1] - p->a[1];

	return geom_sign128((geom_i128)dx * (y - den * p->a[1]) - (geom_i128)dy * (x - den * p->a[0]));
}

/* Whether the moved position is above the piece, which spans its moved x. */
static bool above(const struct lineset_piece *p, int side)
{
	return side ? side > 0 : p->b[1] <= p->a[1];
}

/* Whether the moved position is right of the piece, which spans its moved y. */
static bool right_of(const struct lineset_piece *p, int side)
{
	return p->b[1] > p->a[1] ? side <= 0 : side >= 0;
}

void lineset_path_turn(struct lineset_path *t, const struct lineset_piece *p)
{
	int64_t den = t->den, x = den * t->from[0], low = p->a[1] < p->b[1] ? p->a[1] : p->b[1];
	int64_t high = p->a[1] < p->b[1] ? p->b[1] : p->a[1];
	bool turn = false;

	if (p->a[0] <= t->from[0] && t->from[0] < p->b[0])
		turn = above(p, side_of(p, x, t->to[1], den)) != above(p, side_of(p, x, den * t->from[1], den));
	if (den * low <= t->to[1] && t->to[1] < den * high)
		turn ^= right_of(p, side_of(p, x, t->to[1], den)) != right_of(p, side_of(p, t->to[0], t->to[1], den));
	t->state ^= turn ? p->turns : 0;
}

bool lineset_path_box(const struct lineset_path *t, int32_t ret[4])
{
	for (unsigned k = 0; k < 2; k++) {
		int64_t low = floor_div(t->to[k], t->den), high = low + (low * t->den != t->to[k]);

		low = t->from[k] < low ? t->from[k] : low;
		high = t->from[k] > high ? t->from[k] : high;
		if (low > INT32_MAX || high < INT32_MIN)
			return false;
		ret[k] = clamp(low);
		ret[k + 2] = clamp(high);
	}
	return true;
}

static int turn_path(void *ctx, const struct lineset_piece *p, struct err *err)
{
	lineset_path_turn(ctx, p);
	return 0;
}

/* How far the box is from the position, and if it has it, how large it is: the less the better. */
struct nearness {
	int64_t away, size;
};

static struct nearness nearness_of(const int32_t box[4], const int64_t at[2])
{
	struct nearness n = {0, 0};

	for (unsigned k = 0; k < 2; k++) {
		int64_t away = at[k] < box[k] ? box[k] - at[k] : at[k] > box[k + 2] ? at[k] - box[k + 2] : 0;

		n.away = away > n.away ? away : n.away;
		n.size += (int64_t)box[k + 2] - box[k];
	}
	return n;
}

/* Begins the path at the corner of a leaf near its end. */
static int begin_near(struct lineset_reader *r, struct lineset_path *t, struct err *err)
{
	const struct lineset *s = r->set;
	const int64_t at[2] = {floor_div(t->to[0], t->den), floor_div(t->to[1], t->den)};
	uint64_t i = 0, check = s->root_check;

	for (unsigned level = s->shape.height - 1; level > 0; level--) {
		const struct lineset_page *p;
		const struct lineset_inner *e;
		struct nearness best = {INT64_MAX, 0};
		unsigned found = 0;
		int rc = lineset_page(r, level, i, check, &p, err);

		if (rc)
			return rc;
		e = lineset_page_inner(p);
		for (unsigned k = 0; k < p->entries; k++) {
			struct nearness n = nearness_of(e[k].box, at);

			if (n.away > best.away || (n.away == best.away && n.size >= best.size))
				continue;
			best = n;
			found = k;
		}
		i = i * LINESET_ENTRIES + found;
		check = e[found].check;
		t->from[0] = e[found].box[0];
		t->from[1] = e[found].box[1];
		t->state = e[found].state;
	}
	return 0;
}

int lineset_state(struct lineset_reader *r, int64_t x, int64_t y, unsigned den, unsigned *ret, struct err *err)
{
	const struct lineset_info *info = &r->set->info;
	/* Left of all pieces, where the state is that of what is far away. */
	struct lineset_path t = {{(int64_t)info->box[0] - 1, info->box[1]}, {x, y}, den, info->far};
	struct lineset_visit v = {.turns = LINESET_LAKE | LINESET_OUT, .piece = turn_path, .ctx = &t};
	int64_t left = floor_div(x, den), low = floor_div(y, den);
	int rc = 0;

	if (!r->set->turns || left < info->box[0] || left > info->box[2] || low < info->box[1] || low > info->box[3]) {
		*ret = info->far;
		return 0;
	}
	if (r->set->shape.height > 1)
		rc = begin_near(r, &t, err);
	if (rc == 0 && lineset_path_box(&t, v.box))
		rc = lineset_visit(r, &v, err);
	if (rc == 0)
		*ret = t.state;
	return rc;
}

/* ---- marks ---- */

/* States of records while they are made: in bits of the tag that are free until then. */
enum { STATE_SHIFT = POINT_SOURCE_SHIFT + 8, STATE = (LINESET_LAKE | LINESET_OUT) << STATE_SHIFT };
_Static_assert(POINT_LINE << 8 == 1 << STATE_SHIFT && (POINT_IN_AREA << 4) < 1 << STATE_SHIFT, "the bits are free");

enum { GROUP = 64, GROUPS = 16, RECORDS = GROUP * GROUPS };

/* Records that follow each other; the state of the lower left corner of their box. */
struct group {
	int32_t box[4];
	struct point *pts;
	size_t n;
	unsigned state;
};

struct mark {
	int32_t box[4]; /* of all */
	double clear;
	int64_t wide; /* clear, rounded up */
	struct group group[GROUPS];
	size_t groups;
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

static void mark_record(const struct lineset_piece *p, struct point *at, int64_t wide, double clear)
{
	int64_t low = p->a[1] < p->b[1] ? p->a[1] : p->b[1], high = p->a[1] < p->b[1] ? p->b[1] : p->a[1];
	const int32_t xy[2] = {at->x, at->y};

	if (at->x < p->a[0] - wide || at->x > p->b[0] + wide || at->y < low - wide || at->y > high + wide)
		return;
	if (at->tag & (POINT_LINE | POINT_NEAR_LINE))
		return;
	/* The box of the piece alone decides of a position on its line whether it is on the piece. */
	if ((at->x >= p->a[0] && at->x <= p->b[0] && at->y >= low && at->y <= high && geom_orient(p->a, p->b, xy) == 0) ||
	    (clear > 0 && is_near(p, at, clear)))
		at->tag |= POINT_NEAR_LINE;
}

static void mark_near(const struct mark *m, struct group *g, const struct lineset_piece *p)
{
	int64_t low = p->a[1] < p->b[1] ? p->a[1] : p->b[1], high = p->a[1] < p->b[1] ? p->b[1] : p->a[1], wide = m->wide;

	if (g->box[0] > p->b[0] + wide || g->box[2] < p->a[0] - wide || g->box[1] > high + wide || g->box[3] < low - wide)
		return;
	for (size_t i = 0; i < g->n; i++)
		mark_record(p, &g->pts[i], wide, m->clear);
}

static bool is_above(const struct lineset_piece *p, int32_t x, int32_t y)
{
	const int32_t at[2] = {x, y};

	return above(p, geom_orient(p->a, p->b, at));
}

static bool is_right(const struct lineset_piece *p, int32_t x, int32_t y)
{
	const int32_t at[2] = {x, y};

	return right_of(p, geom_orient(p->a, p->b, at));
}

/* Whether a path from that corner to the right of it and above crosses the piece. */
static bool crosses(const struct lineset_piece *p, const int32_t corner[2], int32_t x, int32_t y)
{
	int32_t low = p->a[1] < p->b[1] ? p->a[1] : p->b[1], high = p->a[1] < p->b[1] ? p->b[1] : p->a[1];
	bool turn = false;

	if (p->a[0] <= corner[0] && corner[0] < p->b[0])
		turn = is_above(p, corner[0], y) != is_above(p, corner[0], corner[1]);
	/* A piece that is right of the end crosses no more of the path. */
	if (y >= low && y < high && x >= p->a[0])
		turn ^= is_right(p, x, y) && !is_right(p, corner[0], y);
	return turn;
}

static void turn_states(const struct mark *m, struct group *g, const struct lineset_piece *p)
{
	const int32_t *box = g->box;
	int32_t low = p->a[1] < p->b[1] ? p->a[1] : p->b[1], high = p->a[1] < p->b[1] ? p->b[1] : p->a[1];

	if (crosses(p, m->box, box[0], box[1]))
		g->state ^= p->turns;
	if (box[0] > p->b[0] || box[2] < p->a[0] || box[1] > high || box[3] < low)
		return;
	for (size_t i = 0; i < g->n; i++)
		if (crosses(p, box, g->pts[i].x, g->pts[i].y))
			g->pts[i].tag ^= (uint16_t)(p->turns << STATE_SHIFT);
}

static int mark_piece(void *ctx, const struct lineset_piece *p, struct err *err)
{
	struct mark *m = ctx;

	for (size_t i = 0; i < m->groups; i++) {
		mark_near(m, &m->group[i], p);
		if (p->turns)
			turn_states(m, &m->group[i], p);
	}
	return 0;
}

static void make_groups(struct mark *m, struct point *pts, size_t n, unsigned state)
{
	m->groups = 0;
	for (size_t at = 0; at < n; at += GROUP) {
		struct group *g = &m->group[m->groups++];

		*g = (struct group){
			{INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN}, pts + at, n - at < GROUP ? n - at : GROUP, state};
		for (size_t i = 0; i < g->n; i++) {
			const int32_t box[4] = {g->pts[i].x, g->pts[i].y, g->pts[i].x, g->pts[i].y};

			point_box_join(g->box, box);
			g->pts[i].tag &= (uint16_t)~STATE;
		}
	}
}

/* From states to marks. */
static void end_groups(struct mark *m)
{
	for (size_t k = 0; k < m->groups; k++)
		for (size_t i = 0; i < m->group[k].n; i++) {
			struct point *p = &m->group[k].pts[i];
			unsigned tag = p->tag ^ m->group[k].state << STATE_SHIFT;

			if ((tag & STATE) && !(tag & (POINT_LINE | POINT_NEAR_LINE)))
				tag |= POINT_IN_AREA;
			p->tag = (uint16_t)(tag & ~STATE);
		}
}

/* ---- without areas ---- */

struct near {
	int32_t box[4];
	double clear;
	int64_t wide;
	struct point *pts;
	size_t n;
	struct lineset_piece piece[SQUARES_BOXES];
	unsigned npiece;
};

/* Compares the pieces that were collected with the records in their columns and rows. */
static void mark_together(struct near *m)
{
	struct squares_strip strip[SQUARES_BOXES];
	struct squares s;

	squares_init(&s, m->box);
	for (unsigned i = 0; i < m->npiece; i++) {
		int64_t low[2], high[2];

		for (unsigned k = 0; k < 2; k++) {
			int64_t a = m->piece[i].a[k], b = m->piece[i].b[k];

			low[k] = (a < b ? a : b) - m->wide;
			high[k] = (a < b ? b : a) + m->wide;
		}
		squares_add(&s, i, low, high);
		strip[i] = squares_strip(m->piece[i].a, m->piece[i].b, -m->clear, m->clear);
	}
	for (size_t i = 0; i < m->n; i++) {
		const int32_t x = m->pts[i].x, y = m->pts[i].y;

		for (uint64_t bits = squares_at(&s, x, y); bits; bits &= bits - 1)
			if (squares_in_strip(&strip[__builtin_ctzll(bits)], x, y))
				mark_record(&m->piece[__builtin_ctzll(bits)], &m->pts[i], m->wide, m->clear);
	}
	m->npiece = 0;
}

static int near_piece(void *ctx, const struct lineset_piece *p, struct err *err)
{
	struct near *m = ctx;

	m->piece[m->npiece++] = *p;
	if (m->npiece == SQUARES_BOXES)
		mark_together(m);
	return 0;
}

static int mark_lines(struct lineset_reader *r, const struct mark *from, const int32_t box[4], struct point *pts, size_t n,
		      struct err *err)
{
	struct near m;
	int rc;

	memcpy(m.box, from->box, sizeof(m.box));
	m.clear = from->clear;
	m.wide = from->wide;
	m.pts = pts;
	m.n = n;
	m.npiece = 0;
	rc = lineset_find(r, box, near_piece, &m, err);
	if (m.npiece)
		mark_together(&m);
	return rc;
}

int lineset_mark(struct lineset_reader *r, const int32_t box[4], double clear, struct point *pts, size_t n, struct err *err)
{
	const struct lineset_info *info = &r->set->info;
	struct mark m = {.box = {box[0], box[1], box[2], box[3]}, .clear = clear, .wide = (int64_t)ceil(clear)};
	const int32_t near[4] = {clamp(box[0] - m.wide), clamp(box[1] - m.wide), clamp(box[2] + m.wide), clamp(box[3] + m.wide)};
	unsigned state = 0;
	uint64_t pieces;
	int rc;

	if (!info->areas)
		return mark_lines(r, &m, near, pts, n, err);
	rc = lineset_count(r, near, 1, &pieces, err);
	if (rc == 0)
		rc = lineset_state(r, box[0], box[1], 1, &state, err);
	if (rc || (!pieces && !state))
		return rc;
	for (size_t at = 0; rc == 0 && at < n; at += RECORDS) {
		make_groups(&m, pts + at, n - at < RECORDS ? n - at : RECORDS, state);
		if (pieces)
			rc = lineset_find(r, near, mark_piece, &m, err);
		end_groups(&m);
	}
	return rc;
}
