/*
 * Areas of a crop or a window (view_area.h). Edges are in two indexes over the bounds of the area, with steps of a
 * power of two. Horizontal strips list the edges that reach into them, in the order of their rings, so that one pass
 * over a strip's list decides ring after ring. A table of cells decides most positions at once: cells that no edge
 * touches are entirely inside or outside. Only the other positions need the list of their strip.
 *
 * All arithmetic is in integers of up to 128 bits. An area is read-only after view_area_end.
 */
#include "view_area.h"

#include <stdlib.h>
#include <string.h>

#include "area.h"
#include "err.h"

enum { CELLS = 128, STRIPS = 2048 };
enum { CELL_OUT, CELL_IN, CELL_MIXED };

/* from its lower end to its upper end: ay <= by */
struct edge {
	int64_t ax, ay, bx, by;
	uint32_t ring;
};

struct ring {
	size_t first, n; /* corners */
	uint32_t polygon;
	bool shell;
};

struct view_area {
	struct ring *ring;
	int64_t (*corner)[2];
	size_t nring, rings_room, ncorner, corners_room;

	int64_t bounds[4];
	struct edge *edge;
	uint32_t *strip, *list; /* edges of strip s: list[strip[s]] up to list[strip[s + 1]] */
	unsigned strip_shift, nstrip;
	unsigned cell_shift[2];
	uint8_t (*cell)[CELLS]; /* by y, by x */
};

/* ---- construction ---- */

struct view_area *view_area_new(void)
{
	return calloc(1, sizeof(struct view_area));
}

void view_area_free(struct view_area *a)
{
	if (!a)
		return;
	free(a->ring);
	free(a->corner);
	free(a->edge);
	free(a->strip);
	free(a->list);
	free(a->cell);
	free(a);
}

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory for the area of a view");
}

int view_area_ring(struct view_area *a, bool shell, struct err *err)
{
	if (a->nring == a->rings_room) {
		size_t room = a->rings_room ? a->rings_room * 2 : 8;
		void *more = realloc(a->ring, room * sizeof *a->ring);

		if (!more)
			return no_memory(err);
		a->ring = more;
		a->rings_room = room;
	}
	struct ring r = {.first = a->ncorner, .shell = shell || !a->nring};

	r.polygon = !a->nring ? 0 : a->ring[a->nring - 1].polygon + r.shell;
	a->ring[a->nring++] = r;
	return 0;
}

int view_area_corner(struct view_area *a, int64_t x, int64_t y, struct err *err)
{
	if (a->ncorner == a->corners_room) {
		size_t room = a->corners_room ? a->corners_room * 2 : 64;
		void *more = realloc(a->corner, room * sizeof *a->corner);

		if (!more)
			return no_memory(err);
		a->corner = more;
		a->corners_room = room;
	}
	a->corner[a->ncorner][0] = x;
	a->corner[a->ncorner++][1] = y;
	a->ring[a->nring - 1].n++;
	return 0;
}

/* ---- the normal form ---- */

static int corner_compare(const int64_t a[2], const int64_t b[2])
{
	if (a[0] != b[0])
		return a[0] < b[0] ? -1 : 1;
	return (a[1] > b[1]) - (a[1] < b[1]);
}

static void reverse(int64_t (*c)[2], size_t n)
{
	for (size_t i = 0; i + 1 < n - i; i++) {
		int64_t x = c[i][0], y = c[i][1];

		memcpy(c[i], c[n - 1 - i], sizeof c[i]);
		c[n - 1 - i][0] = x;
		c[n - 1 - i][1] = y;
	}
}

/* Returns the number of remaining corners; the smallest one comes first, then its smaller neighbour. */
static size_t normal_ring(int64_t (*c)[2], size_t n)
{
	size_t kept = 0, least = 0;

	for (size_t i = 0; i < n; i++)
		if (!kept || corner_compare(c[i], c[kept - 1]))
			memmove(c[kept++], c[i], sizeof c[i]);
	while (kept > 1 && !corner_compare(c[kept - 1], c[0]))
		kept--;
	for (size_t i = 1; i < kept; i++)
		if (corner_compare(c[i], c[least]) < 0)
			least = i;
	/* Rotates by three reversals. */
	reverse(c, least);
	reverse(c + least, kept - least);
	reverse(c, kept);
	for (size_t i = 1; i < kept - (kept > 0); i++) {
		int order = corner_compare(c[kept - i], c[i]);

		if (!order)
			continue; /* a spike: to a corner and back */
		if (order < 0)
			reverse(c + 1, kept - 1);
		break;
	}
	return kept;
}

static void normal_form(struct view_area *a)
{
	size_t rings = 0, corners = 0;
	bool dropped = false; /* the polygon has no shell */

	for (size_t i = 0; i < a->nring; i++) {
		struct ring r = a->ring[i];

		if (r.n) /* an area without corners has no memory for them */
			r.n = normal_ring(a->corner + r.first, r.n);
		if (r.shell)
			dropped = !r.n;
		if (dropped || (!r.shell && r.n < 3))
			continue;
		memmove(a->corner + corners, a->corner + r.first, r.n * sizeof *a->corner);
		r.first = corners;
		corners += r.n;
		a->ring[rings++] = r;
	}
	a->nring = rings;
	a->ncorner = corners;
}

static void find_bounds(struct view_area *a)
{
	for (size_t i = 0; i < a->ncorner; i++) {
		for (unsigned k = 0; k < 2; k++) {
			int64_t v = a->corner[i][k];

			if (!i || v < a->bounds[k])
				a->bounds[k] = v;
			if (!i || v > a->bounds[2 + k])
				a->bounds[2 + k] = v;
		}
	}
}

/* ---- the strips ---- */

/* The smallest shift that brings span below n. */
static unsigned shift_for(uint64_t span, uint64_t n)
{
	unsigned shift = 0;

	while (span >> shift >= n)
		shift++;
	return shift;
}

static void make_edges(struct view_area *a)
{
	size_t n = 0;

	for (size_t r = 0; r < a->nring; r++) {
		const struct ring *ring = &a->ring[r];

		for (size_t i = 0; i < ring->n; i++) {
			const int64_t *p = a->corner[ring->first + i], *q = a->corner[ring->first + (i + 1) % ring->n];

			if (p[1] > q[1]) {
				const int64_t *t = p;

				p = q;
				q = t;
			}
			a->edge[n++] = (struct edge){p[0], p[1], q[0], q[1], (uint32_t)r};
		}
	}
}

static unsigned strip_of(const struct view_area *a, int64_t y)
{
	return (unsigned)((uint64_t)(y - a->bounds[1]) >> a->strip_shift);
}

/* Halves their number until the lists are not much longer than the number of edges. */
static uint64_t choose_strips(struct view_area *a)
{
	uint64_t span = (uint64_t)(a->bounds[3] - a->bounds[1]), entries;

	for (unsigned strips = STRIPS;; strips /= 2) {
		a->strip_shift = shift_for(span, strips);
		a->nstrip = (unsigned)(span >> a->strip_shift) + 1;
		entries = 0;
		for (size_t i = 0; i < a->ncorner; i++)
			entries += strip_of(a, a->edge[i].by) - strip_of(a, a->edge[i].ay) + 1;
		if (strips == 1 || entries <= 4 * a->ncorner + STRIPS)
			return entries;
	}
}

static int make_strips(struct view_area *a, struct err *err)
{
	uint64_t entries = choose_strips(a);
	uint32_t sum = 0;

	a->strip = calloc(a->nstrip + 1, sizeof *a->strip);
	a->list = malloc(entries * sizeof *a->list);
	if (!a->strip || !a->list)
		return no_memory(err);
	for (size_t i = 0; i < a->ncorner; i++)
		for (unsigned s = strip_of(a, a->edge[i].ay); s <= strip_of(a, a->edge[i].by); s++)
			a->strip[s]++;
	for (unsigned s = 0; s <= a->nstrip; s++) {
		uint32_t n = a->strip[s];

		a->strip[s] = sum;
		sum += n;
	}
	/* Filling moves each start to the next one. */
	for (size_t i = 0; i < a->ncorner; i++)
		for (unsigned s = strip_of(a, a->edge[i].ay); s <= strip_of(a, a->edge[i].by); s++)
			a->list[a->strip[s]++] = (uint32_t)i;
	memmove(a->strip + 1, a->strip, a->nstrip * sizeof *a->strip);
	a->strip[0] = 0;
	return 0;
}

static bool strip_has(const struct view_area *a, int64_t x, int64_t y)
{
	unsigned s = strip_of(a, y);
	const uint32_t *at = a->list + a->strip[s], *end = a->list + a->strip[s + 1];
	uint32_t polygon = UINT32_MAX;
	bool in = false; /* inside this polygon, by the rings so far */

	while (at < end) {
		uint32_t number = a->edge[*at].ring;
		const struct ring *ring = &a->ring[number];
		bool on = false, crosses = false;

		if (ring->polygon != polygon) {
			if (in)
				return true;
			polygon = ring->polygon;
		}
		for (; at < end && a->edge[*at].ring == number; at++)
			on |= area_edge_holds(a->edge[*at].ax, a->edge[*at].ay, a->edge[*at].bx, a->edge[*at].by, x, y, &crosses);
		in = ring->shell ? on || crosses : in && (on || !crosses);
	}
	return in;
}

/* ---- the cells ---- */

static int64_t floor_div(__int128 a, int64_t b)
{
	__int128 q = a / b;

	return (int64_t)(a % b < 0 ? q - 1 : q);
}

/* The x interval of the edge between y1 and y2, both within it, rounded outwards. */
static void edge_reach(const struct edge *e, int64_t y1, int64_t y2, int64_t ret[2])
{
	int64_t at[2] = {y1, y2};

	for (unsigned i = 0; i < 2; i++) {
		__int128 up = (__int128)(e->bx - e->ax) * (at[i] - e->ay);
		int64_t x = e->ax + floor_div(up, e->by - e->ay);

		if (!i || x < ret[0])
			ret[0] = x;
		if (!i || x + 1 > ret[1])
			ret[1] = x + 1;
	}
}

static int64_t cell_of(const struct view_area *a, unsigned axis, int64_t v)
{
	int64_t d = v - a->bounds[axis];

	if (d < 0)
		return 0;
	d >>= a->cell_shift[axis];
	return d < CELLS ? d : CELLS - 1;
}

/* Cells are closed and extended by one lattice step on every side, so an edge that passes between two cells touches both. */
static void mark_edge(struct view_area *a, const struct edge *e)
{
	int64_t row = cell_of(a, 1, e->ay - 1), last = cell_of(a, 1, e->by + 1);

	for (; row <= last; row++) {
		int64_t low = a->bounds[1] + (row << a->cell_shift[1]) - 1,
			high = a->bounds[1] + ((row + 1) << a->cell_shift[1]) + 1, reach[2];

		if (e->ay == e->by) {
			reach[0] = e->ax < e->bx ? e->ax : e->bx;
			reach[1] = e->ax < e->bx ? e->bx : e->ax;
		} else {
			low = low < e->ay ? e->ay : low > e->by ? e->by : low;
			high = high > e->by ? e->by : high < e->ay ? e->ay : high;
			edge_reach(e, low, high, reach);
		}
		int64_t c = cell_of(a, 0, reach[0] - 1), end = cell_of(a, 0, reach[1] + 1);

		memset(&a->cell[row][c], CELL_MIXED, (size_t)(end - c + 1));
	}
}

static int make_cells(struct view_area *a, struct err *err)
{
	a->cell = calloc(CELLS, sizeof *a->cell);
	if (!a->cell)
		return no_memory(err);
	for (unsigned k = 0; k < 2; k++)
		a->cell_shift[k] = shift_for((uint64_t)(a->bounds[2 + k] - a->bounds[k]), CELLS);
	for (size_t i = 0; i < a->ncorner; i++)
		mark_edge(a, &a->edge[i]);
	for (int64_t row = 0; row < CELLS; row++) {
		int64_t y = a->bounds[1] + (row << a->cell_shift[1]);

		for (int64_t c = 0; c < CELLS && y <= a->bounds[3]; c++) {
			int64_t x = a->bounds[0] + (c << a->cell_shift[0]);

			if (a->cell[row][c] == CELL_MIXED)
				continue;
			/* No edge runs between two adjacent cells that no edge touches. */
			if (c && a->cell[row][c - 1] != CELL_MIXED)
				a->cell[row][c] = a->cell[row][c - 1];
			else
				a->cell[row][c] = strip_has(a, x, y) ? CELL_IN : CELL_OUT;
		}
	}
	return 0;
}

int view_area_end(struct view_area *a, struct err *err)
{
	int r;

	normal_form(a);
	if (!a->ncorner)
		return err_set(err, ERR_USAGE, "the area has no corners");
	find_bounds(a);
	for (unsigned k = 0; k < 2; k++) {
		if (a->bounds[k] < -VIEW_AREA_MOST || a->bounds[2 + k] > VIEW_AREA_MOST) {
			err_set(err, ERR_USAGE, "the area reaches too far out for the lattice of the dataset");
			return err_add_hint(err, "give its corners in the coordinates of the dataset");
		}
	}
	a->edge = malloc(a->ncorner * sizeof *a->edge);
	if (!a->edge)
		return no_memory(err);
	make_edges(a);
	r = make_strips(a, err);
	return r ? r : make_cells(a, err);
}

/* ---- queries ---- */

bool view_area_has(const struct view_area *a, int64_t x, int64_t y)
{
	if (x < a->bounds[0] || y < a->bounds[1] || x > a->bounds[2] || y > a->bounds[3])
		return false;
	switch (a->cell[(y - a->bounds[1]) >> a->cell_shift[1]][(x - a->bounds[0]) >> a->cell_shift[0]]) {
	case CELL_OUT:
		return false;
	case CELL_IN:
		return true;
	default:
		return strip_has(a, x, y);
	}
}

bool view_area_meets(const struct view_area *a, const int64_t box[4])
{
	const int64_t *b = a->bounds;

	if (box[0] > b[2] || box[1] > b[3] || box[2] < b[0] || box[3] < b[1])
		return false;
	int64_t c1 = cell_of(a, 0, box[0]), c2 = cell_of(a, 0, box[2]);

	for (int64_t row = cell_of(a, 1, box[1]); row <= cell_of(a, 1, box[3]); row++)
		for (int64_t c = c1; c <= c2; c++)
			if (a->cell[row][c] != CELL_OUT)
				return true;
	return false;
}

/* The side of the line from a to b on which p is: > 0 left, 0 on it. */
static __int128 side_of(const int64_t a[2], const int64_t b[2], const int64_t p[2])
{
	return (__int128)(b[0] - a[0]) * (p[1] - a[1]) - (__int128)(b[1] - a[1]) * (p[0] - a[0]);
}

/* A closed edge and a closed triangle are disjoint iff a line along a side of the triangle, or along the edge,
 * separates them. The triangle is counter-clockwise. */
static bool edge_meets(const struct edge *e, const int64_t t[3][2])
{
	const int64_t p[2] = {e->ax, e->ay}, q[2] = {e->bx, e->by};
	unsigned left = 0, right = 0;

	for (unsigned i = 0; i < 3; i++) {
		const int64_t *a = t[i], *b = t[(i + 1) % 3];
		__int128 side = side_of(p, q, a);

		if (side_of(a, b, p) < 0 && side_of(a, b, q) < 0)
			return false;
		left += side > 0;
		right += side < 0;
	}
	return left < 3 && right < 3;
}

bool view_area_meets_triangle(const struct view_area *a, const int64_t corner[3][2])
{
	int64_t t[3][2], box[4];
	int64_t first, last;

	memcpy(t, corner, sizeof t);
	for (unsigned k = 0; k < 2; k++) {
		box[k] = box[2 + k] = t[0][k];
		for (unsigned i = 1; i < 3; i++) {
			box[k] = t[i][k] < box[k] ? t[i][k] : box[k];
			box[2 + k] = t[i][k] > box[2 + k] ? t[i][k] : box[2 + k];
		}
	}
	if (!view_area_meets(a, box))
		return false;
	for (unsigned i = 0; i < 3; i++)
		if (view_area_has(a, t[i][0], t[i][1]))
			return true;
	if (side_of(t[0], t[1], t[2]) < 0) {
		memcpy(t[1], corner[2], sizeof t[1]);
		memcpy(t[2], corner[1], sizeof t[2]);
	}
	/* No corner is in the area, so the part of the triangle that is in the area ends at an edge. */
	first = strip_of(a, box[1] > a->bounds[1] ? box[1] : a->bounds[1]);
	last = strip_of(a, box[3] < a->bounds[3] ? box[3] : a->bounds[3]);
	for (uint32_t i = a->strip[first]; i < a->strip[last + 1]; i++) {
		const struct edge *e = &a->edge[a->list[i]];

		if (e->by >= box[1] && e->ay <= box[3] && edge_meets(e, (const int64_t(*)[2])t))
			return true;
	}
	return false;
}

void view_area_bounds(const struct view_area *a, int64_t ret[4])
{
	memcpy(ret, a->bounds, sizeof a->bounds);
}

bool view_area_is_box(const struct view_area *a)
{
	const int64_t(*c)[2] = (const int64_t(*)[2])a->corner;

	/* In normal form: the lower left corner is first, then the upper left. */
	return a->nring == 1 && a->ncorner == 4 && c[0][0] == c[1][0] && c[1][1] == c[2][1] && c[2][0] == c[3][0] &&
	       c[3][1] == c[0][1];
}

size_t view_area_rings(const struct view_area *a)
{
	return a->nring;
}

size_t view_area_ring_at(const struct view_area *a, size_t i, bool *ret_shell, const int64_t (**ret)[2])
{
	*ret_shell = a->ring[i].shell;
	*ret = (const int64_t(*)[2])(a->corner + a->ring[i].first);
	return a->ring[i].n;
}
