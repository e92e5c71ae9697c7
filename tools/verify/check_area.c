/*
 * Lakes, boundaries and holes for acut-verify: the state of a position by counting, for each feature, the edges to the right of
 * it; what pieces turn, from the states beside their middles; and what becomes of survey points.
 */
#include <math.h>
#include <stdlib.h>

#include "check_lines.h"
#include "err.h"

/* How many areas of each kind a position is in. */
struct inside {
	uint64_t of[LINES_KINDS];
	size_t touched;
};

static void turn(struct check_lines *l, struct inside *in, uint32_t area)
{
	uint8_t *parity = &l->parity[area - 1];

	*parity ^= 1;
	in->of[l->area[area - 1]] += *parity ? 1 : UINT64_MAX;
	l->touched[in->touched++] = area - 1;
}

static unsigned state_of(const struct check_lines *l, const struct inside *in)
{
	if ((l->boundaries && !in->of[LINES_BOUNDARY]) || in->of[LINES_HOLE])
		return CHECK_OUT;
	return in->of[LINES_LAKE] ? CHECK_LAKE : 0;
}

static void forget(struct check_lines *l, const struct inside *in)
{
	for (size_t i = 0; i < in->touched; i++)
		l->parity[l->touched[i]] = 0;
}

/* Rows are of one column. */
static uint64_t row_key(const struct check_lines *l, int64_t y)
{
	return check_grid_key(l->band.shift, 0, y);
}

static int64_t floor_div(int64_t n, int64_t d)
{
	return n / d - (n % d < 0);
}

/* The position is moved: right of what it is on, and above a horizontal edge. So an edge counts that has a point strictly to the
 * right of it, and whose upper end does not count. */
static void count_edges(struct check_lines *l, struct inside *in, int64_t x, int64_t y, int64_t den)
{
	const struct check_grid *g = &l->band;
	uint64_t key = row_key(l, floor_div(y, den));

	for (size_t i = check_grid_find(g, key); i < g->n && g->cell[i].key == key; i++) {
		const struct check_edge *e = &l->edge[g->cell[i].item];
		const struct check_vertex *a = &l->vertex[l->piece[e->piece].end[0]], *b = &l->vertex[l->piece[e->piece].end[1]];
		const struct check_vertex *low = a->y < b->y ? a : b, *high = a->y < b->y ? b : a;

		if (den * low->y > y || den * high->y <= y)
			continue;
		if ((__int128)((int64_t)high->x - low->x) * (y - den * low->y) -
			    (__int128)((int64_t)high->y - low->y) * (x - den * low->x) >
		    0)
			turn(l, in, e->area);
	}
}

unsigned check_state(struct check_lines *l, int64_t x, int64_t y, int64_t den)
{
	struct inside in = {.touched = 0};
	unsigned state;

	if (!l->nareas)
		return 0;
	if (y >= den * INT32_MIN && y <= den * INT32_MAX)
		count_edges(l, &in, x, y, den);
	state = state_of(l, &in);
	forget(l, &in);
	return state;
}

static int make_bands(struct check_lines *l, struct err *err)
{
	double sum = 0;

	for (size_t i = 0; i < l->nareas; i++)
		l->boundaries += l->area[i] == LINES_BOUNDARY;
	l->parity = calloc(l->nareas ? l->nareas : 1, 1);
	l->touched = calloc(2 * l->nedge + 1, sizeof *l->touched);
	if (!l->parity || !l->touched)
		return check_no_memory(err);
	for (size_t i = 0; i < l->nedge; i++) {
		const uint32_t *end = l->piece[l->edge[i].piece].end;

		sum += fabs((double)l->vertex[end[1]].y - l->vertex[end[0]].y);
	}
	l->band.shift = check_grid_shift(sum, l->nedge);
	for (size_t i = 0; i < l->nedge; i++) {
		const uint32_t *end = l->piece[l->edge[i].piece].end;
		const int32_t a[2] = {0, l->vertex[end[0]].y}, b[2] = {0, l->vertex[end[1]].y};
		int rc = check_grid_add(&l->band, (uint32_t)i, a, b, 0, err);

		if (rc)
			return rc;
	}
	check_grid_sort(&l->band);
	return 0;
}

/* Beside the middle of a piece: moved to greater x (above it, if it is horizontal), and on the other side. `edge`: the first edge
 * of an area along it, if there is one. */
static void states_beside(struct check_lines *l, uint32_t piece, size_t edge, unsigned ret[2])
{
	const struct check_vertex *a = &l->vertex[l->piece[piece].end[0]], *b = &l->vertex[l->piece[piece].end[1]];
	struct inside in = {.touched = 0};

	count_edges(l, &in, (int64_t)a->x + b->x, (int64_t)a->y + b->y, 2);
	ret[0] = state_of(l, &in);
	for (; edge < l->nedge && l->edge[edge].piece == piece; edge++)
		turn(l, &in, l->edge[edge].area);
	ret[1] = state_of(l, &in);
	forget(l, &in);
}

/* Pieces that are out on both sides go; the others keep their order. */
static void turn_pieces(struct check_lines *l)
{
	size_t kept = 0, edge = 0;

	for (uint32_t i = 0; i < l->npiece; i++) {
		unsigned side[2];

		while (edge < l->nedge && l->edge[edge].piece < i)
			edge++;
		states_beside(l, i, edge, side);
		l->piece[i].turns = (uint8_t)(side[0] ^ side[1]);
		l->piece[i].absent = side[0] & side[1] & CHECK_OUT;
	}
	for (size_t i = 0; i < l->npiece; i++)
		kept += !l->piece[i].absent;
	l->left_out = l->npiece - kept;
}

/* Edges of areas stay with all pieces, because these tell the states. */
int check_areas(struct check_lines *l, struct err *err)
{
	int rc = make_bands(l, err);

	if (rc)
		return rc;
	if (l->nareas)
		turn_pieces(l);
	for (size_t i = 0; i < l->npiece; i++)
		for (unsigned k = 0; k < 2 && !l->piece[i].absent; k++)
			l->vertex[l->piece[i].end[k]].used = true;
	return 0;
}

/* ---- survey points ---- */

/* Numbers and roundings as docs/design/constraints.md has them: differences are exact, and each product of doubles is rounded
 * once. */
static bool is_near(const int32_t *a, const int32_t *b, const int32_t *p, double clear)
{
	double d[2], from_a[2], from_b[2], along, length, away;

	for (unsigned k = 0; k < 2; k++) {
		d[k] = (double)b[k] - a[k];
		from_a[k] = (double)p[k] - a[k];
		from_b[k] = (double)p[k] - b[k];
	}
	along = from_a[0] * d[0] + from_a[1] * d[1];
	length = d[0] * d[0] + d[1] * d[1];
	if (along <= 0)
		return from_a[0] * from_a[0] + from_a[1] * from_a[1] <= clear * clear;
	if (along >= length)
		return from_b[0] * from_b[0] + from_b[1] * from_b[1] <= clear * clear;
	away = from_a[0] * d[1] - from_a[1] * d[0];
	return away * away <= clear * clear * length;
}

static bool is_on(const int32_t *a, const int32_t *b, const int32_t *p)
{
	for (unsigned k = 0; k < 2; k++)
		if (p[k] < (a[k] < b[k] ? a[k] : b[k]) || p[k] > (a[k] < b[k] ? b[k] : a[k]))
			return false;
	return check_side(a, b, p) == 0;
}

unsigned check_lines_mark(struct check_lines *l, int32_t x, int32_t y)
{
	const int32_t p[2] = {x, y};
	uint64_t key = check_grid_key(l->near.shift, x, y);

	for (size_t i = check_grid_find(&l->near, key); i < l->near.n && l->near.cell[i].key == key; i++) {
		const struct check_piece *piece = &l->piece[l->near.cell[i].item];
		int32_t a[2], b[2];

		check_place(l, piece->end[0], a);
		check_place(l, piece->end[1], b);
		if (is_on(a, b, p) || (l->clear > 0 && is_near(a, b, p, l->clear)))
			return POINT_NEAR_LINE;
	}
	return check_state(l, x, y, 1) ? POINT_IN_AREA : 0;
}

static int make_near(struct check_lines *l, struct err *err)
{
	double sum = 0;
	int rc = 0;

	for (size_t i = 0; i < l->npiece; i++) {
		const struct check_vertex *a = &l->vertex[l->piece[i].end[0]], *b = &l->vertex[l->piece[i].end[1]];

		sum += fmax(fabs((double)b->x - a->x), fabs((double)b->y - a->y)) + l->clear;
	}
	l->near.shift = check_grid_shift(sum, l->npiece);
	for (size_t i = 0; rc == 0 && i < l->npiece; i++) {
		int32_t a[2], b[2];

		if (l->piece[i].absent)
			continue;
		check_place(l, l->piece[i].end[0], a);
		check_place(l, l->piece[i].end[1], b);
		rc = check_grid_add(&l->near, (uint32_t)i, a, b, (int64_t)ceil(l->clear), err);
	}
	check_grid_sort(&l->near);
	return rc;
}

int check_lines_round(struct check_lines *l, double clear, struct err *err)
{
	int rc = check_snap(l, err);

	l->clear = clear;
	if (rc == 0)
		rc = check_areas(l, err);
	return rc ? rc : make_near(l, err);
}
