/*
 * The triangles around some positions, from the chosen points in a box around them, and in the circles of these triangles until
 * no circle has a point that was not known. A triangle in whose circle all chosen points are known, and none is, is in the mesh,
 * if no piece of a line is near.
 */
#include "simplify_near.h"

#include <stdlib.h>
#include <string.h>

#include "align.h"
#include "err.h"
#include "lineset.h"
#include "order.h"

enum { CAP = 1 << 13, TIMES = 10, SQUARES = 8, MARGIN = 8, MOST = 1 << 14 };

static int32_t clamp(double v)
{
	return v < INT32_MIN ? INT32_MIN : v > INT32_MAX ? INT32_MAX : (int32_t)v;
}

/* ---- reading ---- */

static bool is_wanted(const struct simplify_near *w, const struct point *p)
{
	if (p->x < w->limit[0] || p->y < w->limit[1] || p->x > w->limit[2] || p->y > w->limit[3])
		return false;
	for (uint32_t i = w->nseen; i < w->ndisc; i++) {
		const struct simplify_circle *c = &w->disc[i];
		double x = p->x - c->x, y = p->y - c->y;

		if (x * x + y * y <= c->r * c->r)
			return true;
	}
	return !w->begun;
}

static int add_point(void *ctx, const struct point *p, struct err *err)
{
	struct simplify_near *w = ctx;

	(void)err;
	w->full = w->full || ++w->nread > MOST;
	if (w->full || !is_wanted(w, p))
		return 0;
	w->full = w->n == w->room;
	if (!w->full)
		w->point[w->n++] = (struct mesh_vertex){p->x, p->y, p->z};
	return 0;
}

/* Reads what is wanted of the squares that were marked, which are within `box`. */
static int read_marked(struct simplify_near *w, const int32_t box[4], struct err *err)
{
	struct lineset_reader *lines = grid_reader_lines(w->reader);
	struct simplify_raster *raster = &w->c->raster;
	size_t n = simplify_raster_ranges(raster);
	uint64_t pieces = 0;
	int r = lines ? lineset_count(lines, box, 1, &pieces, err) : 0;

	w->n = 0;
	w->full = pieces > 0;
	for (size_t i = 0; !r && i < n && !w->full; i++)
		r = simplify_scan(&w->sink, w->reader, raster->range[i].lo, raster->range[i].hi, err);
	return r;
}

static int read_box(struct simplify_near *w, struct err *err)
{
	w->point = tri_input(w->memory);
	w->room = w->cap;
	simplify_raster_init(&w->c->raster, w->limit, SQUARES);
	simplify_raster_square(&w->c->raster, w->limit);
	memcpy(w->box, w->limit, sizeof w->box);
	return read_marked(w, w->limit, err);
}

/* The box of a disc within the limit. */
static void box_of(const struct simplify_near *w, const struct simplify_circle *c, int32_t ret[4])
{
	const double at[4] = {floor(c->x - c->r), floor(c->y - c->r), ceil(c->x + c->r), ceil(c->y + c->r)};

	for (unsigned k = 0; k < 2; k++) {
		ret[k] = at[k] < w->limit[k] ? w->limit[k] : clamp(at[k]);
		ret[2 + k] = at[2 + k] > w->limit[2 + k] ? w->limit[2 + k] : clamp(at[2 + k]);
	}
}

/* Reads the points in new discs, within the limit, and adds them to the triangulation. Keeps those discs that are within it. If
 * not all of the points fit, the triangulation is that of some, which is of no use. */
static int read_discs(struct simplify_near *w, struct err *err)
{
	int32_t all[4], box[4];
	uint32_t n = w->nseen;
	int r;

	for (uint32_t i = w->nseen; i < w->ndisc; i++) {
		box_of(w, &w->disc[i], box);
		if (i == w->nseen)
			memcpy(all, box, sizeof all);
		else
			point_box_join(all, box);
	}
	simplify_raster_init(&w->c->raster, all, SQUARES);
	for (uint32_t i = w->nseen; i < w->ndisc; i++) {
		box_of(w, &w->disc[i], box);
		simplify_raster_square(&w->c->raster, box);
	}
	w->point = (struct mesh_vertex *)(void *)(w->kind + CAP);
	w->room = w->cap;
	r = read_marked(w, all, err);
	if (r || w->full)
		return r;
	if (tri_add(w->memory, w->point, w->n, false)) {
		w->full = true;
		w->begun = false;
		return 0;
	}
	for (uint32_t i = w->nseen; i < w->ndisc; i++)
		if (simplify_circle_within(&w->disc[i], w->limit))
			w->disc[n++] = w->disc[i];
	w->nseen = w->ndisc = n;
	return 0;
}

/* ---- what is known ---- */

static bool is_known(const struct simplify_near *w, const struct simplify_circle *c)
{
	if (simplify_circle_within(c, w->box))
		return true;
	for (uint32_t i = 0; i < w->nseen; i++) {
		const struct simplify_circle *d = &w->disc[i];
		double x = d->x - c->x, y = d->y - c->y, more = d->r - c->r;

		if (more >= 0 && x * x + y * y <= more * more)
			return true;
	}
	return false;
}

static void find_stars(struct simplify_near *w, const int32_t box[4])
{
	for (uint32_t i = 0; i < w->tri.nvertex; i++) {
		const int32_t *at = w->tri.xy[i];
		uint64_t key = point_morton(at[0], at[1]);

		w->kind[i] = at[0] >= box[0] && at[1] >= box[1] && at[0] <= box[2] && at[1] <= box[3] &&
			     bsearch(&key, w->key, w->nkey, sizeof key, order_u64);
	}
}

/* The points in the circle of a triangle are to be read. A disc is larger than its circle, which so is within it when it comes
 * again. */
static void want(struct simplify_near *w, const struct simplify_circle *c)
{
	if (w->ndisc < SIMPLIFY_DISCS)
		w->disc[w->ndisc++] = (struct simplify_circle){c->x, c->y, c->r + 1};
}

/* A disc that has what is within the limit beyond the side of the hull from a to b (outside on its left). A disc is not a half
 * plane: if width and height of the limit are together more than 2^21 times the length of the side, it may lack points near the
 * line through a and b. That does no harm. The disc only says what to read; it is never within the limit, so a ghost is never
 * known, and its corners are doubtful as long as they are corners of the hull. */
static struct simplify_circle beyond(const struct simplify_near *w, const int32_t a[2], const int32_t b[2])
{
	double x = (double)b[0] - a[0], y = (double)b[1] - a[1], length = sqrt(x * x + y * y),
	       r = 1048576 * ((double)w->limit[2] - w->limit[0] + (double)w->limit[3] - w->limit[1] + 1);

	return (struct simplify_circle){(a[0] + (double)b[0]) / 2 - y / length * r, (a[1] + (double)b[1]) / 2 + x / length * r,
					r + length + 1};
}

static struct simplify_circle circle_of(const struct simplify_near *w, const uint32_t v[3])
{
	for (unsigned k = 0; k < 3; k++)
		if (v[k] == TRI_GHOST)
			return beyond(w, w->tri.xy[v[(k + 1) % 3]], w->tri.xy[v[(k + 2) % 3]]);
	return simplify_circle_of(w->tri.xy[v[0]], w->tri.xy[v[1]], w->tri.xy[v[2]]);
}

/* Marks vertices with a triangle whose circle is not known. */
static void find_doubtful(struct simplify_near *w)
{
	for (uint32_t i = 0; i < w->tri.ntriangle; i++) {
		const uint32_t *v = w->tri.triangle[i].corner;
		struct simplify_circle c;
		bool star = false;

		for (unsigned k = 0; k < 3; k++)
			star = star || (v[k] != TRI_GHOST && w->kind[v[k]] & SIMPLIFY_STAR);
		if (!star)
			continue;
		c = circle_of(w, v);
		if (is_known(w, &c))
			continue;
		want(w, &c);
		for (unsigned k = 0; k < 3; k++)
			if (v[k] != TRI_GHOST)
				w->kind[v[k]] |= SIMPLIFY_DOUBTFUL;
	}
}

/* ---- all ---- */

void simplify_keys_box(const uint64_t *key, size_t n, int32_t ret[4])
{
	for (size_t i = 0; i < n; i++) {
		int32_t at[4];

		point_from_morton(key[i], &at[0], &at[1]);
		at[2] = at[0];
		at[3] = at[1];
		if (i)
			point_box_join(ret, at);
		else
			memcpy(ret, at, sizeof at);
	}
}

static void set_limit(struct simplify_near *w, const int32_t stars[4], double by)
{
	for (unsigned k = 0; k < 4; k++)
		w->limit[k] = clamp(stars[k] + (k < 2 ? -by : by));
}

static int run(struct simplify_near *w, struct err *err)
{
	double by = w->side / MARGIN;
	int32_t stars[4];
	int r = 0;

	simplify_keys_box(w->key, w->nkey, stars);
	for (unsigned i = 0; !r && i < TIMES && (!w->begun || w->ndisc > w->nseen); i++, by *= 2) {
		set_limit(w, stars, by);
		r = w->begun ? read_discs(w, err) : read_box(w, err);
		if (r || w->full)
			break;
		if (!w->begun && tri_run(w->memory, w->n))
			continue;
		w->begun = true;
		tri_result(w->memory, &w->tri);
		find_stars(w, stars);
		find_doubtful(w);
	}
	return r;
}

int simplify_near(struct simplify_near *w, bool *ret_done, struct err *err)
{
	const struct grid *grid = w->c->s->chosen;
	int r = grid_reader_new(grid, w->c->domain, grid_reader_bytes(grid), &w->reader, err);

	if (r)
		return r;
	simplify_sink_init(&w->sink, w->c->s, &w->c->s->rest);
	w->sink.ctx = w;
	w->sink.point = add_point;
	w->kind = (uint8_t *)w->c->list;
	w->cap = w->c->s->near ? w->c->s->near : CAP;
	memset(w->kind, w->c->s->fill, CAP);
	w->memory = tri_init(w->c->domain + align_line(grid_reader_bytes(grid)), w->cap);
	w->begun = w->full = false;
	w->nseen = w->ndisc = w->nread = 0;
	r = run(w, err);
	*ret_done = w->begun;
	grid_reader_free(w->reader);
	return r;
}
