/*
 * Reading for an area query: which cells were read, and where their points go.
 *
 * All cells that meet the piece are read first, so they need no entry in the table of read cells. Of a rectangle only the points
 * in the inner box are taken then, a little larger than the piece; the cells that reach out of it count as not read. Until there
 * are triangles, points are collected in the arena, between the kernel's input and the part that the kernel does not use before
 * it has sorted. Later points are inserted into the triangulation directly. Records at one position are reduced to one: here
 * within a cell, when points are sorted across cells, and by the kernel.
 */
#include <math.h>
#include <string.h>

#include "geom.h"
#include "window_area.h"

/* Cells within so many spacings of points around the piece are read at once, before there are triangles. Most of them would be
 * read anyway. Without them a side of the piece that lies between cells, as one between two pieces does, is a side of the hull,
 * whose thin triangles have circles that meet cells far away. */
#define AROUND 3.0

/* ---- the table ---- */

static struct window_seen *find_seen(const struct window_area *a, const struct grid_cell *cell)
{
	uint64_t key = (cell->place + cell->segment) * UINT64_C(0x9e3779b97f4a7c15) ^ cell->segment;
	uint32_t i = (uint32_t)((key * UINT64_C(0xd6e8feb86659fd93)) >> 32) & (a->seen_size - 1);

	while (a->seen[i].used && (a->seen[i].place != cell->place || a->seen[i].segment != cell->segment))
		i = (i + 1) & (a->seen_size - 1);
	return &a->seen[i];
}

static bool is_inner(const struct window_area *a, const int32_t low[2], const int32_t high[2])
{
	return low[0] >= a->inner[0] && low[1] >= a->inner[1] && high[0] <= a->inner[2] && high[1] <= a->inner[3];
}

bool window_area_has_read(const struct window_area *a, const struct grid_cell *cell)
{
	if (cell->count == 0 || find_seen(a, cell)->used)
		return true;
	return a->clips ? is_inner(a, cell->box, cell->box + 2) : window_piece_meets_box(&a->window, cell->box);
}

/* ---- points ---- */

static int add_point(struct window_area *a, const struct point *p)
{
	struct point *last = &a->pts[a->npts - (a->npts > 0)];

	if (a->npts > 0 && last->x == p->x && last->y == p->y) {
		if (view_prefers(a->view, p, last))
			*last = *p;
		return 0;
	}
	if (a->npts == a->most)
		return WINDOW_E_SPLIT;
	a->unsorted = a->unsorted || (a->npts > 0 && point_morton(p->x, p->y) < point_morton(last->x, last->y));
	a->pts[a->npts++] = *p;
	return 0;
}

static int insert(struct window_area *a, const struct point *p)
{
	const struct mesh_vertex v = {p->x, p->y, p->z};

	return tri_add(a->tri, &v, 1, a->highest) == TRI_E_FULL ? WINDOW_E_SPLIT : 0;
}

static int take_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct window_area *a = ctx;

	(void)err;
	a->counts.points_read += n;
	for (size_t i = 0; i < n; i++) {
		const int32_t at[2] = {pts[i].x, pts[i].y};
		int r;

		/* First those of the inner box, then the others. */
		if ((a->clips && is_inner(a, at, at) == a->begun) || view_judge(a->view, &pts[i]) != VIEW_KEPT)
			continue;
		r = a->built ? insert(a, &pts[i]) : add_point(a, &pts[i]);
		if (r)
			return r;
	}
	return 0;
}

static int read_cell(struct window_area *a, const struct grid_cell *cell, struct err *err)
{
	a->counts.cells_read++;
	return a->src.read(a->src.ctx, cell, take_points, a, err);
}

/* ---- the first cells ---- */

struct begin {
	struct window_area *a;
	struct err *err;
	double ground; /* of the boxes of all cells that meet the piece */
	uint64_t records;
};

static bool begin_meets(const struct window_area *a, const int32_t box[4])
{
	if (!a->clips)
		return window_piece_meets_box(&a->window, box);
	return box[0] <= a->inner[2] && box[1] <= a->inner[3] && box[2] >= a->inner[0] && box[3] >= a->inner[1];
}

static bool piece_enter(void *ctx, const struct grid_cell *subtree)
{
	const struct begin *b = ctx;

	return subtree->count > 0 && window_piece_meets_box(&b->a->window, subtree->box);
}

static int measure_cell(void *ctx, const struct grid_cell *cell)
{
	struct begin *b = ctx;

	if (cell->count == 0 || !window_piece_meets_box(&b->a->window, cell->box))
		return 0;
	b->a->waiting += cell->distinct < cell->count ? cell->distinct : cell->count;
	b->ground += ((double)cell->box[2] - cell->box[0]) * ((double)cell->box[3] - cell->box[1]);
	b->records += cell->count;
	return 0;
}

static bool begin_enter(void *ctx, const struct grid_cell *subtree)
{
	const struct begin *b = ctx;

	return subtree->count > 0 && begin_meets(b->a, subtree->box);
}

static int begin_cell(void *ctx, const struct grid_cell *cell)
{
	struct begin *b = ctx;

	return cell->count && begin_meets(b->a, cell->box) ? read_cell(b->a, cell, b->err) : 0;
}

static int read_begin(struct begin *b)
{
	const struct grid_visitor v = {.ctx = b, .enter = begin_enter, .cell = begin_cell};
	struct window_area *a = b->a;

	a->npts = 0;
	a->begun = a->unsorted = false;
	return a->src.walk(a->src.ctx, 0, UINT64_MAX, &v, b->err);
}

int window_area_begin(struct window_area *a, struct err *err)
{
	struct begin b = {.a = a, .err = err};
	const struct grid_visitor measure = {.ctx = &b, .enter = piece_enter, .cell = measure_cell};
	uint64_t many;
	int r;

	a->waiting = 0;
	r = a->src.walk(a->src.ctx, 0, UINT64_MAX, &measure, err);
	a->spacing = b.records ? sqrt(b.ground / (double)b.records) : 0;
	for (unsigned k = 0; k < 4; k++)
		a->inner[k] = a->window.box[k] / 2 + (k < 2 ? -1 : 1) * (int64_t)ceil(a->limits.spacings * a->spacing);
	many = 2 * a->waiting + a->limits.inner;
	a->most = a->clips && many < a->cap ? (uint32_t)many : a->cap;
	r = r ? r : read_begin(&b);
	a->most = a->cap;
	/* A sparse cell beside dense ones: the inner box is large. */
	if (r == WINDOW_E_SPLIT && a->clips) {
		a->clips = false;
		r = read_begin(&b);
	}
	a->begun = true;
	return r;
}

/* The box, larger on all sides. */
static void widen(const int32_t box[4], int64_t by, int32_t ret[4])
{
	for (unsigned i = 0; i < 4; i++) {
		int64_t v = i < 2 ? box[i] - by : box[i] + by;

		ret[i] = (int32_t)(v < INT32_MIN ? INT32_MIN : v > INT32_MAX ? INT32_MAX : v);
	}
}

static bool is_close(const struct window_area *a, const int32_t box[4])
{
	int32_t wide[4];

	widen(box, (int64_t)ceil(AROUND * a->spacing), wide);
	return window_piece_meets_box(&a->window, wide);
}

static bool around_enter(void *ctx, const struct grid_cell *subtree)
{
	return subtree->count > 0 && is_close(((struct begin *)ctx)->a, subtree->box);
}

static int around_cell(void *ctx, const struct grid_cell *cell)
{
	struct begin *b = ctx;
	struct window_area *a = b->a;
	struct window_seen *seen;

	if (window_area_has_read(a, cell) || !is_close(a, cell->box))
		return 0;
	/* Points that the kernel would have to sort out by discs may need the room more. */
	if (a->npts + (uint64_t)cell->count > a->base + (uint64_t)(a->cap - a->base) / 4 || window_area_full(a))
		return a->guessed ? WINDOW_E_SPLIT : 0;
	seen = find_seen(a, cell);
	*seen = (struct window_seen){cell->place, cell->segment, 1};
	a->nseen++;
	return read_cell(a, cell, b->err);
}

int window_area_around(struct window_area *a, struct err *err)
{
	struct begin b = {.a = a, .err = err};
	const struct grid_visitor v = {.ctx = &b, .enter = around_enter, .cell = around_cell};

	return a->clips ? 0 : a->src.walk(a->src.ctx, 0, UINT64_MAX, &v, err);
}

/* ---- others ---- */

double window_area_distance(const int32_t box[4], const double at[2])
{
	double far = 0;

	for (unsigned k = 0; k < 2; k++) {
		double d = at[k] < box[k] ? box[k] - at[k] : at[k] > box[2 + k] ? at[k] - box[2 + k] : 0;

		far += d * d;
	}
	return far;
}

/* Keeps the `most` nearest cells, in order of distance; the earlier of equals. A cell is in the list once. */
void window_area_pick(struct window_area *a, uint32_t most, double far, const struct grid_cell *cell)
{
	uint32_t i;

	for (i = 0; i < a->npick; i++) {
		struct window_pick *p = &a->pick[i];

		if (p->cell.place != cell->place || p->cell.segment != cell->segment)
			continue;
		if (p->far <= far)
			return;
		memmove(p, p + 1, (a->npick - i - 1) * sizeof(*p));
		a->npick--;
		break;
	}
	if (a->npick == most && far >= a->pick[most - 1].far)
		return;
	i = a->npick < most ? a->npick++ : most - 1;
	for (; i > 0 && a->pick[i - 1].far > far; i--)
		a->pick[i] = a->pick[i - 1];
	a->pick[i] = (struct window_pick){far, *cell};
}

bool window_area_full(const struct window_area *a)
{
	return a->nseen >= a->seen_size - a->seen_size / 8;
}

int window_area_read_picked(struct window_area *a, struct err *err)
{
	for (uint32_t i = 0; i < a->npick && !window_area_full(a); i++) {
		struct window_seen *seen = find_seen(a, &a->pick[i].cell);
		int r;

		*seen = (struct window_seen){a->pick[i].cell.place, a->pick[i].cell.segment, 1};
		a->nseen++;
		r = read_cell(a, &a->pick[i].cell, err);
		if (r)
			return r;
	}
	return 0;
}

struct nearest {
	struct window_area *a;
	uint32_t n;
	double box[4]; /* of the piece */
};

static double piece_far(const struct nearest *n, const int32_t box[4])
{
	double far = 0;

	for (unsigned k = 0; k < 2; k++) {
		double d = n->box[2 + k] < box[k] ? box[k] - n->box[2 + k] : n->box[k] > box[2 + k] ? n->box[k] - box[2 + k] : 0;

		far += d * d;
	}
	return far;
}

static bool nearest_enter(void *ctx, const struct grid_cell *subtree)
{
	const struct nearest *n = ctx;

	return subtree->count > 0 && (n->a->npick < n->n || piece_far(n, subtree->box) < n->a->pick[n->n - 1].far);
}

static int nearest_cell(void *ctx, const struct grid_cell *cell)
{
	struct nearest *n = ctx;

	if (!window_area_has_read(n->a, cell))
		window_area_pick(n->a, n->n, piece_far(n, cell->box), cell);
	return 0;
}

int window_area_pick_nearest(struct window_area *a, uint32_t most, struct err *err)
{
	struct nearest n = {.a = a, .n = most};
	const struct grid_visitor v = {.ctx = &n, .enter = nearest_enter, .cell = nearest_cell};

	for (unsigned i = 0; i < 4; i++)
		n.box[i] = (double)a->window.box[i] / 2;
	a->npick = 0;
	return a->src.walk(a->src.ctx, 0, UINT64_MAX, &v, err);
}

enum { FOUND = 101 };

static int apex_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct window_area *a = ctx;

	(void)err;
	a->counts.points_read += n;
	for (size_t i = 0; i < n; i++) {
		const int32_t at[2] = {pts[i].x, pts[i].y};
		int32_t line[2][2];
		int r;

		if (view_judge(a->view, &pts[i]) != VIEW_KEPT)
			continue;
		for (uint32_t k = 0; k < 2 && k < a->npts; k++) {
			line[k][0] = a->pts[k].x;
			line[k][1] = a->pts[k].y;
		}
		if (a->npts >= 2 && !geom_orient(line[0], line[1], at))
			continue;
		r = add_point(a, &pts[i]);
		if (r || a->npts > 2)
			return r ? r : FOUND;
	}
	return 0;
}

int window_area_apex(struct window_area *a, struct err *err)
{
	int r = a->src.scan(a->src.ctx, 0, UINT64_MAX, apex_points, a, err);

	return r == FOUND ? 0 : r;
}

/* ---- to triangles ---- */

bool window_area_build(struct window_area *a)
{
	struct mesh_vertex *in = tri_input(a->tri);
	uint32_t n = 0;

	if (a->unsorted) {
		point_sort(a->pts, a->pts + a->cap, a->npts);
		for (uint32_t i = 0; i < a->npts; i++) {
			struct point *last = &a->pts[n - (n > 0)];

			if (n == 0 || last->x != a->pts[i].x || last->y != a->pts[i].y)
				a->pts[n++] = a->pts[i];
			else if (view_prefers(a->view, &a->pts[i], last))
				*last = a->pts[i];
		}
		a->npts = n;
		a->unsorted = false;
	}
	for (uint32_t i = 0; i < a->npts; i++)
		in[i] = (struct mesh_vertex){a->pts[i].x, a->pts[i].y, a->pts[i].z};
	a->built = tri_run(a->tri, a->npts) == 0;
	return a->built;
}
