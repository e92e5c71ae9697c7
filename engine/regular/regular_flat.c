/*
 * A region may load positions that are all on one line, though those of the view are not. They have no triangle, so nothing could
 * be verified. The position nearest to the region that is not on their line is added, or the nearest one if there are fewer than
 * two; what is then wrong is found by the turns.
 */
#include "err.h"
#include "regular_priv.h"

struct nearest {
	struct regular_work *w;
	const int32_t *a, *b; /* of the line; NULL */
	double x, y, best;    /* `best`: square of a distance; INFINITY: none is found */
	struct point point;
};

static double gap(double at, double low, double high)
{
	return at < low ? low - at : at > high ? at - high : 0;
}

static double distance(const struct nearest *n, const int32_t box[4])
{
	double dx = gap(n->x, box[0], box[2]), dy = gap(n->y, box[1], box[3]);

	return dx * dx + dy * dy;
}

static bool enter(void *ctx, const struct grid_cell *cell)
{
	const struct nearest *n = ctx;

	return cell->count && distance(n, cell->box) <= n->best;
}

static bool is_candidate(const struct nearest *n, const int32_t at[2])
{
	if (n->a && !memcmp(n->a, at, sizeof(int32_t[2])))
		return false;
	return !n->b || geom_orient(n->a, n->b, at);
}

/* Among equally near ones the first in rank, of its records the one that the view prefers. */
static int near_points(void *ctx, const struct point *pts, size_t count, struct err *err)
{
	struct nearest *n = ctx;
	const struct view *view = n->w->c->view;

	(void)err;
	n->w->c->points_read += count;
	for (size_t i = 0; i < count; i++) {
		const struct point *p = &pts[i];
		const int32_t at[2] = {p->x, p->y}, best[2] = {n->point.x, n->point.y};
		double d = distance(n, (const int32_t[4]){p->x, p->y, p->x, p->y});

		if (d > n->best || !is_candidate(n, at) || cut_judge(&n->w->judge, p) != VIEW_KEPT)
			continue;
		if (d == n->best && (memcmp(at, best, sizeof at) ? !geom_less(at, best) : !view_prefers(view, p, &n->point)))
			continue;
		n->best = d;
		n->point = *p;
	}
	return 0;
}

static int near_cell(void *ctx, const struct grid_cell *cell)
{
	struct nearest *n = ctx;

	if (!enter(n, cell))
		return 0;
	n->w->c->cells_read++;
	return n->w->c->src->read(n->w->c->src->ctx, cell, near_points, n, n->w->err);
}

/* The middle of the region, or a side of it, or zero. */
static double middle(int64_t low, int64_t high)
{
	if (low == INT64_MIN)
		return high == INT64_MAX ? 0 : (double)high / 2;
	return high == INT64_MAX ? (double)low / 2 : ((double)low + (double)high) / 4;
}

static int find_nearest(struct nearest *n)
{
	const struct grid_visitor v = {.ctx = n, .segment = enter, .enter = enter, .cell = near_cell};
	const int64_t *box = n->w->box;

	n->x = middle(box[0], box[2]);
	n->y = middle(box[1], box[3]);
	n->best = INFINITY;
	return n->w->c->src->walk(n->w->c->src->ctx, 0, UINT64_MAX, &v, n->w->err);
}

/* The vertices become the input again, in their new order, with the point behind them. */
static void input_again(struct regular_work *w, const struct point *p)
{
	struct mesh_vertex *in = tri_input(w->c->tri);
	uint32_t n = w->r.nvertex;

	for (uint32_t i = 0; i < n; i++) {
		in[i] = (struct mesh_vertex){w->r.xy[i][0], w->r.xy[i][1], w->r.z[i]};
		w->c->weight[i] = (uint8_t)(w->r.id[i] >> TRI_WEIGHT_AT);
	}
	in[n] = (struct mesh_vertex){p->x, p->y, p->z};
	w->c->weight[n] = view_weight_of(w->c->view, p);
}

int regular_flat_run(struct regular_work *w, uint64_t *ret_need)
{
	uint32_t n = w->c->n;

	w->c->flat = false;
	for (;;) {
		struct nearest near = {.w = w};
		int rc = tri_regular_run(&w->tri, n, w->c->weight);

		if (rc != TRI_E_FLAT)
			return rc ? regular_cancelled(w) : 0;

		tri_result(w->c->tri, &w->r);
		near.a = n > 0 ? w->r.xy[0] : NULL;
		near.b = n > 1 ? w->r.xy[1] : NULL;
		w->c->flat = w->c->not_verified || w->c->no_hull;
		rc = w->c->flat ? 0 : find_nearest(&near);
		if (rc)
			return rc;
		w->c->flat |= near.best == INFINITY;
		if (w->c->flat)
			return 0;
		if (n == w->c->cap) {
			*ret_need = (uint64_t)n + 1;
			return REGULAR_E_SPLIT;
		}
		regular_trace_nearest(w, near.x, near.y, sqrt(near.best));
		input_again(w, &near.point);
		w->c->added++;
		n++;
	}
}
