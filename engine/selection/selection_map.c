/*
 * The metric of a view (view_metric.h): the origin of the mapped positions, and the pieces of lines as they are mapped.
 *
 * The origin depends on how far the mapped positions reach. Mostly the box of all points is enough to know that they fit. Where
 * it is not, all points are read once more than otherwise: a box that is turned reaches farther than the points in it.
 *
 * Pieces of lines are mapped, too, into a line set of the selection. The map is linear, so mapped pieces meet where the pieces
 * do, and a record is on one, or in an area, if its own position is. Pieces without an end in the crop are mapped as well, since
 * areas are bounded by all of them.
 */
#include "selection_priv.h"

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "lineset.h"

/* ---- how far the mapped positions reach ---- */

struct reach {
	struct selection *s;
	bool any;
	int64_t low[2], high[2];
};

static void reach_add(struct reach *r, int32_t x, int32_t y)
{
	int64_t at[2];

	view_metric_image(&r->s->p->view->metric, x, y, at);
	for (unsigned k = 0; k < 2; k++) {
		r->low[k] = !r->any || at[k] < r->low[k] ? at[k] : r->low[k];
		r->high[k] = !r->any || at[k] > r->high[k] ? at[k] : r->high[k];
	}
	r->any = true;
}

static bool origin_of(const struct reach *r, int64_t ret[2])
{
	ret[0] = ret[1] = 0;
	return !r->any ||
	       (view_metric_origin(r->low[0], r->high[0], &ret[0]) && view_metric_origin(r->low[1], r->high[1], &ret[1]));
}

static int64_t most(int64_t a, int64_t b)
{
	return a > b ? a : b;
}

static int64_t least(int64_t a, int64_t b)
{
	return a < b ? a : b;
}

/* A side of the crop, or what is nearer than it. */
static int64_t crop_side(const struct view *v, unsigned i)
{
	__int128 at = (__int128)v->crop_box[i] - v->k[i & 1];

	return at < INT32_MIN ? INT32_MIN : at > INT32_MAX ? INT32_MAX : (int64_t)at;
}

/* A box with all positions that are mapped; false: there are none. */
static bool box_of(const struct selection *s, int64_t box[4])
{
	const struct view *v = s->p->view;
	int32_t all[4];

	if (!grid_box(s->p->grid, all))
		return false;
	for (unsigned i = 0; i < 4; i++) {
		box[i] = all[i];
		if (v->crop != VIEW_CROP_NONE)
			box[i] = i < 2 ? most(box[i], crop_side(v, i)) : least(box[i], crop_side(v, i));
	}
	if (grid_lines(s->p->grid) && lineset_info(grid_lines(s->p->grid))->pieces) {
		const int32_t *lines = lineset_info(grid_lines(s->p->grid))->box;

		for (unsigned i = 0; i < 4; i++)
			box[i] = i < 2 ? least(box[i], lines[i]) : most(box[i], lines[i]);
	}
	return box[0] <= box[2] && box[1] <= box[3];
}

static bool enter_subtree(void *ctx, const struct grid_cell *subtree)
{
	const struct reach *r = ctx;

	return view_may_hold(r->s->p->view, subtree->box);
}

static int reach_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct reach *r = ctx;

	(void)err;
	for (size_t i = 0; i < n; i++)
		if (view_judge(r->s->p->view, &pts[i]) == VIEW_KEPT)
			reach_add(r, pts[i].x, pts[i].y);
	r->s->seen += n;
	return selection_progress(r->s);
}

static int reach_cell(void *ctx, const struct grid_cell *cell)
{
	struct reach *r = ctx;

	if (!view_may_hold(r->s->p->view, cell->box))
		return 0;
	return grid_cell_read(r->s->reader, cell, reach_points, r, r->s->err);
}

static int reach_piece(void *ctx, const struct lineset_piece *piece, struct err *err)
{
	(void)err;
	reach_add(ctx, piece->a[0], piece->a[1]);
	reach_add(ctx, piece->b[0], piece->b[1]);
	return 0;
}

static int refuse(const struct reach *r, const int64_t box[4])
{
	const struct view_metric *m = &r->s->p->view->metric;
	int64_t along = r->high[0] - r->low[0], across = r->high[1] - r->low[1], k = UINT32_MAX / (across / m->k + 1);
	struct view_metric simple;
	struct err *err = r->s->err;

	err_set(err, ERR_LIMIT,
		"--metric %lld,%lld,%lld: the mapped points reach over %lld along the direction and %lld across it, and at most %lld fit",
		(long long)m->p, (long long)m->q, (long long)m->k, (long long)along, (long long)across, (long long)UINT32_MAX);
	if (along <= UINT32_MAX && k > 1)
		return err_add_hint(err, "K is too large: --metric %lld,%lld,%lld fits", (long long)m->p, (long long)m->q,
				    (long long)k);
	if (view_metric_simpler(m, box[2] - box[0], box[3] - box[1], &simple))
		return err_add_hint(err, "P and Q are too large: --metric %lld,%lld,%lld has nearly that direction, and fits",
				    (long long)simple.p, (long long)simple.q, (long long)simple.k);
	return err_add_hint(err, "mesh a part of the points (--crop), or push them with a larger --scale");
}

/* Sets the map of the selection. */
static int choose_origin(struct selection *s)
{
	const struct grid_visitor visitor = {.enter = enter_subtree, .cell = reach_cell};
	struct grid_visitor v = visitor;
	struct reach r = {.s = s}, exact = {.s = s};
	struct view view = *s->p->view;
	int64_t box[4];
	int rc = 0;

	v.ctx = &exact;
	if (box_of(s, box))
		for (unsigned i = 0; i < 4; i++)
			reach_add(&r, (int32_t)box[i & 1 ? 2 : 0], (int32_t)box[i & 2 ? 3 : 1]);
	if (!origin_of(&r, s->out.origin)) {
		rc = grid_walk(s->reader, 0, UINT64_MAX, &v, s->err);
		if (!rc && grid_lines(s->p->grid))
			rc = lineset_find(grid_reader_lines(s->reader), lineset_info(grid_lines(s->p->grid))->box, reach_piece,
					  &exact, s->err);
		if (!rc && !origin_of(&exact, s->out.origin))
			rc = refuse(&exact, box);
	}
	view_bind_map(&view, s->out.origin);
	s->map = view.map;
	return rc;
}

/* ---- lines ---- */

struct pieces {
	const struct view_map *map;
	struct lineset_piece *piece;
	size_t n;
};

static void map_end(const struct view_map *map, const int32_t at[2], int32_t ret[2])
{
	int64_t to[2];

	view_metric_image(&map->is, at[0], at[1], to);
	ret[0] = (int32_t)(to[0] - map->from[0]);
	ret[1] = (int32_t)(to[1] - map->from[1]);
}

static int map_piece(void *ctx, const struct lineset_piece *from, struct err *err)
{
	struct pieces *p = ctx;
	struct lineset_piece *to = &p->piece[p->n++];
	int32_t a[2], b[2];

	(void)err;
	map_end(p->map, from->a, a);
	map_end(p->map, from->b, b);
	bool turned = a[0] > b[0] || (a[0] == b[0] && a[1] > b[1]);

	*to = (struct lineset_piece){.turns = from->turns};
	memcpy(to->a, turned ? b : a, sizeof a);
	memcpy(to->b, turned ? a : b, sizeof b);
	return 0;
}

static size_t pieces_bytes(const struct lineset *lines)
{
	return lineset_info(lines)->pieces * sizeof(struct lineset_piece);
}

size_t selection_map_bytes(const struct grid *grid, const struct view *view)
{
	enum { WRITER = 128 << 10 };
	struct lineset *lines = grid_lines(grid);

	/* The tree of the file takes less than half a byte for each piece. */
	return view->metric.k > 1 && lines ? pieces_bytes(lines) + lineset_info(lines)->pieces / 2 + WRITER : 0;
}

static int write_lines(struct selection *s, struct lineset *lines)
{
	struct pieces p = {.map = &s->map, .piece = malloc(pieces_bytes(lines) + 1)};
	struct grid_named file[GRID_SOURCE_FILES];
	int r = 0;

	if (!p.piece)
		return err_set(s->err, ERR_NOMEM, "no memory for the pieces of lines");
	if (lineset_info(lines)->pieces)
		r = lineset_find(grid_reader_lines(s->reader), lineset_info(lines)->box, map_piece, &p, s->err);
	grid_source_files(grid_lines_source(s->p->grid), file);
	if (!r)
		r = lineset_write(s->p->dirfd, file[0].name, p.piece, p.n, lineset_info(lines)->far, s->err);
	free(p.piece);
	return r;
}

int selection_map(struct selection *s)
{
	struct lineset *lines = grid_lines(s->p->grid);
	int r;

	if (s->p->view->metric.k <= 1)
		return 0;
	s->out.mapped = true;
	r = choose_origin(s);
	return r || !lines ? r : write_lines(s, lines);
}

void selection_map_point(struct selection *s, struct point *p)
{
	const int32_t at[2] = {p->x, p->y}, box[4] = {p->x, p->y, p->x, p->y};
	int32_t to[2];

	if (!s->map.is.k)
		return;
	if (!s->any_box)
		memcpy(s->out.box, box, sizeof box);
	s->any_box = true;
	point_box_join(s->out.box, box);
	map_end(&s->map, at, to);
	p->x = to[0];
	p->y = to[1];
}
