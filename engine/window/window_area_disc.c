/*
 * The test of an area query: which triangles may be wrong, because a cell that was not read may contain points in their
 * circle.
 *
 * A raster of the surroundings clears most triangles: it marks every square that the box of an unread cell touches. A
 * triangle with a corner a is cleared if no mark lies in a square around a that contains any circle of its radius through
 * a, or in a square around its circle. For nearly all, the distance from a's square to the nearest mark decides that, which is
 * measured once for all squares. The discs of the others are collected in a batch and tested against the index in one walk.
 *
 * Discs are computed in doubles, and rounding errs towards reading more (cut_disc.h). Half planes of ghosts are exact.
 *
 * A sifted cell (window_area.c) gives each disc that it meets the point that is deepest in it, the farthest below the plane
 * of the lifted triangle. So the hull of distant clusters, or the edge of a long strip, is found in a few rounds, as by
 * quickhull. It also gives all points that may lie on the circle, because ties are decided among known points.
 */
#include <math.h>
#include <string.h>

#include "geom.h"
#include "window_area.h"

/* ---- the raster ---- */

static int64_t larger(int64_t a, int64_t b)
{
	return a > b ? a : b;
}

static int64_t smaller(int64_t a, int64_t b)
{
	return a < b ? a : b;
}

/* The piece and an eighth of its size around it on every side. */
static void set_zone(struct window_area *a)
{
	const int64_t *b = a->window.box;
	int64_t size = larger(b[2] - b[0], b[3] - b[1]) / 16 + 64;
	int64_t squares = smaller(a->limits.squares + a->base / 8, WINDOW_RASTER); /* on each axis */

	a->shift = 0;
	for (unsigned k = 0; k < 2; k++) {
		a->zone[k] = b[k] / 2 - size;
		a->zone[2 + k] = b[2 + k] / 2 + size;
	}
	while (larger(a->zone[2] - a->zone[0], a->zone[3] - a->zone[1]) >> a->shift >= squares)
		a->shift++;
}

/* Bits from..to of a row, both included. */
static uint64_t row_mask(unsigned word, int64_t from, int64_t to)
{
	int64_t first = (int64_t)word * 64, lo = from > first ? from - first : 0, hi = to < first + 63 ? to - first : 63;

	return lo > hi ? 0 : (UINT64_MAX >> (63 - (hi - lo))) << lo;
}

static bool zone_enter(void *ctx, const struct grid_cell *subtree)
{
	const struct window_area *a = ctx;
	const int32_t *b = subtree->box;

	return subtree->count > 0 && b[0] <= a->zone[2] && b[1] <= a->zone[3] && b[2] >= a->zone[0] && b[3] >= a->zone[1];
}

static int zone_cell(void *ctx, const struct grid_cell *cell)
{
	struct window_area *a = ctx;
	int64_t at[4];

	if (!zone_enter(a, cell) || window_area_has_read(a, cell))
		return 0;
	for (unsigned i = 0; i < 4; i++) {
		int64_t v = cell->box[i], low = a->zone[i & 1], high = a->zone[2 + (i & 1)];

		at[i] = ((v < low ? low : v > high ? high : v) - low) >> a->shift;
	}
	for (int64_t y = at[1]; y <= at[3]; y++)
		for (int64_t word = at[0] / 64; word <= at[2] / 64; word++)
			a->dirty[y][word] |= row_mask((unsigned)word, at[0], at[2]);
	return 0;
}

static uint8_t least(uint8_t a, uint8_t b)
{
	return a < b ? a : b;
}

/* The number of squares, on the longer axis, to the nearest one that is dirty, or not entirely in the zone: two passes, with the
 * neighbours before and behind (Rosenfeld and Pfaltz, Distance functions on digital pictures, 1968). */
static void measure_clear(struct window_area *a)
{
	const unsigned nx = (unsigned)((a->zone[2] - a->zone[0]) >> a->shift),
		       ny = (unsigned)((a->zone[3] - a->zone[1]) >> a->shift);

	memset(a->clear, 0, sizeof(a->clear));
	for (unsigned y = 1; y <= ny; y++)
		for (unsigned x = 1; x <= nx; x++) {
			const uint8_t *up = &a->clear[y - 1][x];

			if (!(a->dirty[y - 1][(x - 1) / 64] >> (x - 1) % 64 & 1))
				a->clear[y][x] = least(least(a->clear[y][x - 1], up[-1]), least(up[0], up[1])) + 1;
		}
	for (unsigned y = ny; y >= 1; y--)
		for (unsigned x = nx; x >= 1; x--) {
			const uint8_t *down = &a->clear[y + 1][x];
			uint8_t near = least(least(a->clear[y][x + 1], down[1]), least(down[0], down[-1]));

			a->clear[y][x] = least(a->clear[y][x], near + 1);
		}
}

/* Squares in the inner box have no unread points. */
static void clear_inner(struct window_area *a)
{
	int64_t from[2], to[2];

	for (unsigned k = 0; k < 2; k++) {
		int64_t low = larger(a->inner[k] - a->zone[k], 0), high = a->inner[2 + k] + 1 - a->zone[k];

		from[k] = (low + ((int64_t)1 << a->shift) - 1) >> a->shift;
		to[k] = smaller(high >> a->shift, WINDOW_RASTER) - 1;
	}
	for (int64_t y = from[1]; a->clips && y <= to[1]; y++)
		for (int64_t word = from[0] / 64; word <= to[0] / 64; word++)
			a->dirty[y][word] &= ~row_mask((unsigned)word, from[0], to[0]);
}

static int make_raster(struct window_area *a, struct err *err)
{
	const struct grid_visitor v = {.ctx = a, .enter = zone_enter, .cell = zone_cell};
	int r;

	set_zone(a);
	memset(a->dirty, 0, sizeof(a->dirty));
	r = a->src.walk(a->src.ctx, 0, UINT64_MAX, &v, err);
	clear_inner(a);
	measure_clear(a);
	return r;
}

/* Every point of an unread cell is farther from the position than this, on one axis. */
static double clear_around(const struct window_area *a, const int32_t at[2])
{
	uint64_t x = (uint64_t)(at[0] - a->zone[0]) >> a->shift, y = (uint64_t)(at[1] - a->zone[1]) >> a->shift;

	if (x >= WINDOW_RASTER || y >= WINDOW_RASTER || a->clear[y + 1][x + 1] < 2)
		return 0;
	return (double)((int64_t)(a->clear[y + 1][x + 1] - 1) << a->shift);
}

/* A square with this centre is in the box. */
static bool is_in(const int64_t box[4], double x, double y, double size)
{
	return x - size >= (double)box[0] && y - size >= (double)box[1] && x + size <= (double)box[2] &&
	       y + size <= (double)box[3];
}

/* No unread cell has a point within `size` of the centre on both axes. */
static bool is_clean(const struct window_area *a, double x, double y, double size)
{
	double from[2] = {x - size, y - size}, to[2] = {x + size, y + size};
	int64_t lo[2], hi[2];

	for (unsigned k = 0; k < 2; k++) {
		if (!(from[k] >= (double)a->zone[k] && to[k] <= (double)a->zone[2 + k]))
			return false;
		lo[k] = ((int64_t)floor(from[k]) - a->zone[k]) >> a->shift;
		hi[k] = ((int64_t)ceil(to[k]) - a->zone[k]) >> a->shift;
	}
	for (int64_t row = lo[1]; row <= hi[1]; row++)
		for (int64_t word = lo[0] / 64; word <= hi[0] / 64; word++)
			if (a->dirty[row][word] & row_mask((unsigned)word, lo[0], hi[0]))
				return false;
	return true;
}

/* ---- discs ---- */

/* Cells nearest to (x, y), clamped to the piece, are read first. */
static void set_target(const struct window_area *a, struct window_disc *d, double x, double y)
{
	const double at[2] = {x, y};

	for (unsigned k = 0; k < 2; k++) {
		double low = (double)a->window.box[k] / 2, high = (double)a->window.box[2 + k] / 2;

		d->at[k] = at[k] < low ? low : at[k] > high ? high : at[k];
	}
	d->best = INFINITY;
}

/* The corner of a box that is farthest to the left of the line a, b. */
static void leftmost(const int32_t a[2], const int32_t b[2], const int64_t box[4], int64_t ret[2])
{
	ret[0] = b[1] > a[1] ? box[0] : box[2];
	ret[1] = b[0] > a[0] ? box[3] : box[1];
}

static bool ghost_disc(struct window_area *a, const int32_t p[2], const int32_t q[2], struct window_disc *ret)
{
	int64_t far[2];
	geom_i128 turn;

	leftmost(p, q, a->window.box, far);
	turn = (geom_i128)((int64_t)q[0] - p[0]) * (far[1] - 2 * (int64_t)p[1]) -
	       (geom_i128)((int64_t)q[1] - p[1]) * (far[0] - 2 * (int64_t)p[0]);
	if (turn < 0)
		return false;
	ret->a = p;
	ret->b = q;
	ret->ghost = true;
	set_target(a, ret, ((double)p[0] + q[0]) / 2, ((double)p[1] + q[1]) / 2);
	return true;
}

static bool true_disc(struct window_area *area, const int32_t a[2], const int32_t b[2], const int32_t c[2],
		      struct window_disc *ret)
{
	int64_t bx = (int64_t)b[0] - a[0], by = (int64_t)b[1] - a[1], cx = (int64_t)c[0] - a[0], cy = (int64_t)c[1] - a[1];
	double ex = (double)(cx - bx), ey = (double)(cy - by), twice = 2 * (double)geom_area(a, b, c), radius;
	double sides = ((double)bx * (double)bx + (double)by * (double)by) * ((double)cx * (double)cx + (double)cy * (double)cy) *
		       (ex * ex + ey * ey);
	double most = twice / 2 * (clear_around(area, a) - 1) * (1 - CUT_DISC_SLACK);

	/* The radius is l1 l2 l3 / 2D; every point of the circle is within two radii of a. */
	if (most > 0 && sides < most * most)
		return false;
	radius = sqrt(sides) / twice * (1 + CUT_DISC_SLACK);
	if (is_clean(area, a[0], a[1], 2 * radius + 1))
		return false;
	cut_disc_init(&ret->disc, a, b, c);
	if (is_clean(area, a[0] + ret->disc.ux, a[1] + ret->disc.uy,
		     radius + CUT_DISC_SLACK * (fabs(ret->disc.ux) + fabs(ret->disc.uy)) + 1))
		return false;
	if (area->clips && is_in(area->inner, a[0] + ret->disc.ux, a[1] + ret->disc.uy,
				 radius + CUT_DISC_SLACK * (fabs(ret->disc.ux) + fabs(ret->disc.uy)) + 1))
		return false;
	ret->ghost = false;
	set_target(area, ret, ((double)a[0] + b[0] + c[0]) / 3, ((double)a[1] + b[1] + c[1]) / 3);
	return true;
}

static bool make_disc(struct window_area *a, const struct tri_result *t, uint32_t i, struct window_disc *ret)
{
	const uint32_t *corner = t->triangle[i].corner;

	for (unsigned k = 0; k < 3; k++)
		if (corner[k] == TRI_GHOST)
			return ghost_disc(a, t->xy[corner[(k + 1) % 3]], t->xy[corner[(k + 2) % 3]], ret);
	if (!window_piece_meets(&a->window, t->xy[corner[0]], t->xy[corner[1]], t->xy[corner[2]]))
		return false;
	return true_disc(a, t->xy[corner[0]], t->xy[corner[1]], t->xy[corner[2]], ret);
}

/* Points on the line of a side, but beyond its ends, do not affect the ghost. */
static bool is_beside(const struct window_disc *d, const int32_t box[4])
{
	for (unsigned k = 0; k < 2; k++)
		if ((box[2 + k] < d->a[k] && box[2 + k] < d->b[k]) || (box[k] > d->a[k] && box[k] > d->b[k]))
			return false;
	return true;
}

static bool ghost_meets(const struct window_disc *d, const int32_t box[4])
{
	const int64_t wide[4] = {box[0], box[1], box[2], box[3]};
	int64_t at[2];
	int32_t far[2];
	int turn;

	leftmost(d->a, d->b, wide, at);
	far[0] = (int32_t)at[0];
	far[1] = (int32_t)at[1];
	turn = geom_orient(d->a, d->b, far);
	return turn > 0 || (turn == 0 && is_beside(d, box));
}

static bool disc_meets(const struct window_disc *d, const int32_t box[4])
{
	return d->ghost ? ghost_meets(d, box) : cut_disc_meets(&d->disc, box);
}

/* ---- sifting ---- */

/* > 0: depth of a point inside the disc; 0: it may be on the circle; < 0: it is outside. */
static double depth_of(const struct window_disc *d, int32_t x, int32_t y)
{
	const int32_t at[2] = {x, y}, box[4] = {x, y, x, y};
	double slack, value;

	if (d->ghost) {
		geom_i128 turn = geom_area(d->a, d->b, at);

		return turn ? (double)turn : is_beside(d, box) ? 0 : -1;
	}
	value = cut_disc_value(&d->disc, box, &slack);
	return value < -CUT_DISC_SLACK * slack ? -value : value <= CUT_DISC_SLACK * slack ? 0 : -1;
}

static int add(struct window_area *a, const struct mesh_vertex *v)
{
	return tri_add(a->tri, v, 1, a->highest) == TRI_E_FULL ? WINDOW_E_SPLIT : 0;
}

static int sift_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct window_area *a = ctx;

	(void)err;
	a->counts.points_read += n;
	for (size_t i = 0; i < n; i++) {
		const struct mesh_vertex v = {pts[i].x, pts[i].y, pts[i].z};
		bool on = false;

		if (view_judge(a->view, &pts[i]) != VIEW_KEPT)
			continue;
		for (uint32_t k = 0; k < a->nhit; k++) {
			struct window_disc *d = &a->disc[a->hit[k]];
			double depth = depth_of(d, v.x, v.y);

			on |= depth == 0;
			if (depth > d->depth) {
				d->depth = depth;
				d->deepest = v;
			}
		}
		if (on && add(a, &v))
			return WINDOW_E_SPLIT;
	}
	return 0;
}

struct sift {
	struct window_area *a;
	struct err *err;
};

static int sift_cell(void *ctx, const struct grid_cell *cell)
{
	const struct sift *s = ctx;
	struct window_area *a = s->a;
	int r;

	if (window_area_has_read(a, cell))
		return 0;
	a->nhit = 0;
	for (uint32_t i = 0; i < a->ndisc; i++)
		if (disc_meets(&a->disc[i], cell->box)) {
			a->disc[i].depth = 0;
			a->hit[a->nhit++] = i;
		}
	if (!a->nhit)
		return 0;
	a->counts.cells_read++;
	r = a->src.read(a->src.ctx, cell, sift_points, a, s->err);
	for (uint32_t k = 0; k < a->nhit && !r; k++) {
		const struct window_disc *d = &a->disc[a->hit[k]];

		/* The view may prefer another record at its position: that is found when the position lies on a circle. */
		if (d->depth > 0)
			r = add(a, &d->deepest);
	}
	return r;
}

/* ---- the walk ---- */

static bool any_meets(const struct window_area *a, const struct grid_cell *subtree)
{
	for (uint32_t i = 0; i < a->ndisc && subtree->count; i++)
		if (disc_meets(&a->disc[i], subtree->box))
			return true;
	return false;
}

static bool batch_enter(void *ctx, const struct grid_cell *subtree)
{
	return any_meets(ctx, subtree);
}

static bool sift_enter(void *ctx, const struct grid_cell *subtree)
{
	return any_meets(((struct sift *)ctx)->a, subtree);
}

static int batch_cell(void *ctx, const struct grid_cell *cell)
{
	struct window_area *a = ctx;

	if (window_area_has_read(a, cell))
		return 0;
	for (uint32_t i = 0; i < a->ndisc; i++) {
		struct window_disc *d = &a->disc[i];
		double far;

		far = window_area_distance(cell->box, d->at);
		if ((!a->thorough && far >= d->best) || !disc_meets(d, cell->box))
			continue;
		if (a->thorough) {
			window_area_pick(a, a->limits.round, far, cell);
		} else {
			d->best = far;
			d->cell = *cell;
		}
	}
	return 0;
}

/* Picks the nearest cells among the nearest cell of each disc; if cells gave few points, among all cells that meet a disc. */
static int test_batch(struct window_area *a, struct err *err)
{
	const struct grid_visitor v = {.ctx = a, .enter = batch_enter, .cell = batch_cell};
	struct sift s = {a, err};
	const struct grid_visitor sift = {.ctx = &s, .enter = sift_enter, .cell = sift_cell};
	uint32_t before = tri_count(a->tri);
	int r = a->ndisc ? a->src.walk(a->src.ctx, 0, UINT64_MAX, a->sift ? &sift : &v, err) : 0;

	if (a->sift) {
		a->ndisc = 0;
		return r ? r : tri_count(a->tri) != before ? WINDOW_AGAIN : 0;
	}

	for (uint32_t i = 0; i < a->ndisc && !r; i++)
		if (a->disc[i].best < INFINITY)
			window_area_pick(a, a->limits.round, a->disc[i].best, &a->disc[i].cell);
	a->ndisc = 0;
	return r ? r : a->npick > 0 ? WINDOW_AGAIN : 0;
}

int window_area_test(struct window_area *a, struct err *err)
{
	struct tri_result t;
	int r = make_raster(a, err);

	tri_result(a->tri, &t);
	a->npick = a->ndisc = 0;
	for (uint32_t i = 0; i < t.ntriangle && !r; i++) {
		a->ndisc += make_disc(a, &t, i, &a->disc[a->ndisc]);
		if (a->ndisc == a->disc_room)
			r = test_batch(a, err);
	}
	return r ? r : test_batch(a, err);
}
