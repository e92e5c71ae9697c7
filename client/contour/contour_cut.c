/*
 * The window of a view, and tiles: triangles reach out of them, lines end at their borders.
 *
 * A window is an area (base/area.h), of a box or of polygons, and a tile a square, low <= c < high. Both treat a line as moved to
 * greater x and, much less, to greater y: so it passes through no corner and runs along no border, and of windows or tiles side
 * by side each part of it is in exactly one. Where a crossing is, and which borders a segment crosses, is exact, so both
 * triangles of an edge agree. Where a segment crosses a border is a double: it is in one triangle, and nothing is joined there.
 */
#include <stdio.h>
#include <string.h>

#include "area.h"
#include "area_code.h"
#include "area_way.h"
#include "contour_priv.h"
#include "err.h"
#include "wide.h"

typedef contour_i128 i128;

#define FAR (INT64_C(1) << 40) /* further out than any vertex */

/* ---- the window ---- */

static int64_t local(i128 number, int64_t k, int64_t most)
{
	number -= k;
	return (int64_t)(number < -most ? -most : number > most ? most : number);
}

static int add_box(struct contour *c, const struct acut_mesh_head *head, const char *text, struct err *err)
{
	static const int corner[4][2] = {{0, 1}, {2, 1}, {2, 3}, {0, 3}};
	long long b[4];
	int r;

	if (sscanf(text, "box:%lld,%lld,%lld,%lld", &b[0], &b[1], &b[2], &b[3]) != 4)
		return err_set(err, ERR_PROTO, "the window of the stream's view is none");
	r = area_ring(c->area, true, err);
	for (int i = 0; i < 4 && !r; i++)
		r = area_corner(c->area, local(b[corner[i][0]], head->k[0], FAR), local(b[corner[i][1]], head->k[1], FAR), err);
	return r;
}

/* Polygons: "+" or "-", and the differences of corners (area_code.h), of absolute lattice numbers. */
static int add_rings(struct contour *c, const struct acut_mesh_head *head, const char *text, struct err *err)
{
	const char *end = text + strcspn(text, " ");
	i128 at[2] = {0, 0}, step[2];
	bool any = false;
	int r = 0;

	while (text < end && !r) {
		if (*text == '+' || *text == '-') {
			r = area_ring(c->area, *text++ == '+', err);
			any = true;
			continue;
		}
		if (!any || !area_code_get(&text, end, &step[0]) || !area_code_get(&text, end, &step[1]))
			return err_set(err, ERR_PROTO, "the window of the stream's view is none");
		for (int i = 0; i < 2; i++) {
			at[i] += step[i];
			if (at[i] - head->k[i] > AREA_MOST || at[i] - head->k[i] < -AREA_MOST) {
				err_set(err, ERR_USAGE, "the polygon reaches too far out");
				return err_add_hint(err, "give a polygon that ends nearer to the survey");
			}
		}
		r = area_corner(c->area, (int64_t)(at[0] - head->k[0]), (int64_t)(at[1] - head->k[1]), err);
	}
	return r || any ? r : err_set(err, ERR_PROTO, "the window of the stream's view is none");
}

int contour_cut_init(struct contour *c, const struct acut_mesh_head *head, struct err *err)
{
	const char *box = strstr(head->view ? head->view : "", " window=box:");
	const char *rings = strstr(head->view ? head->view : "", " window=area:");
	int r = 0;

	if (!box && !rings)
		return 0;

	c->area = area_new(AREA_HALF_OPEN);
	if (!c->area)
		return err_set(err, ERR_NOMEM, "no memory for a polygon");
	r = box ? add_box(c, head, box + strlen(" window="), err) : add_rings(c, head, rings + strlen(" window=area:"), err);
	if (!r)
		r = area_end(c->area, err);
	return r ? r : area_way_new(c->area, &c->way, err);
}

void contour_cut_done(struct contour *c)
{
	area_way_free(c->way);
	area_free(c->area);
	c->way = NULL;
	c->area = NULL;
}

enum contour_inside contour_cut_inside(const struct contour *c, const int32_t *const v[3])
{
	int64_t box[4];
	enum area_side side;

	if (!c->area)
		return CONTOUR_INSIDE;
	for (int i = 0; i < 2; i++) {
		box[i] = v[0][i] < v[1][i] ? v[0][i] : v[1][i];
		box[i] = v[2][i] < box[i] ? v[2][i] : box[i];
		box[2 + i] = v[0][i] > v[1][i] ? v[0][i] : v[1][i];
		box[2 + i] = v[2][i] > box[2 + i] ? v[2][i] : box[2 + i];
	}
	side = area_box(c->area, box);
	return side == AREA_OUT ? CONTOUR_OUTSIDE : side == AREA_IN ? CONTOUR_INSIDE : CONTOUR_ACROSS;
}

/* ---- the side of a line ---- */

/* The plane of a triangle, less the height of a level: above zero where it is higher, which is left of the line. */
struct plane {
	const int32_t *at;
	i128 normal[3]; /* upwards */
	i128 high;      /* of `at`, times q */
	int64_t q;
};

static struct plane plane_of(const struct contour *c, const int32_t *const v[3], int64_t level)
{
	const struct contour_levels *l = &c->levels;
	int64_t a[3], b[3];

	for (int i = 0; i < 3; i++) {
		a[i] = (int64_t)v[1][i] - v[0][i];
		b[i] = (int64_t)v[2][i] - v[0][i];
	}
	return (struct plane){.at = v[0],
			      .normal = {(i128)a[1] * b[2] - (i128)a[2] * b[1], (i128)a[2] * b[0] - (i128)a[0] * b[2],
					 (i128)a[0] * b[1] - (i128)a[1] * b[0]},
			      .high = (i128)v[0][2] * l->q - level * l->p - l->r,
			      .q = l->q};
}

/* Of a point moved to lesser x and, much less, to lesser y. */
static int side(const void *ctx, const int64_t p[2])
{
	const struct plane *f = ctx;
	struct wide way = wide_sum(wide_product(f->normal[0], (i128)f->q * (p[0] - f->at[0])),
				   wide_product(f->normal[1], (i128)f->q * (p[1] - f->at[1])));
	int sign = wide_sign(wide_sum(wide_product(f->high, f->normal[2]), wide_negative(way)));

	return sign ? sign : f->normal[0] ? (f->normal[0] > 0 ? 1 : -1) : f->normal[1] > 0 ? 1 : -1;
}

/* ---- segments ---- */

static struct area_place place_of(const struct contour_crossing *c)
{
	return (struct area_place){{contour_key_x(c->end[0]), contour_key_y(c->end[0])},
				   {contour_key_x(c->end[1]), contour_key_y(c->end[1])},
				   c->n,
				   c->d};
}

static void numbers_of(const struct area_place *p, double ret[2])
{
	for (int i = 0; i < 2; i++)
		ret[i] = (double)p->from[i] + (double)(p->to[i] - p->from[i]) * ((double)p->n / (double)p->d);
}

/* A border of a tile where it is crossed. */
struct border {
	int axis, way;
	int64_t line;
	double part, place[2];
	bool corner; /* it passes through a corner there: the other border has the same place, and is the next one */
};

/* A segment that is followed from border to border. */
struct walk {
	struct contour *c;
	const struct contour_crossing *from, *to;
	struct plane plane;
	struct area_segment s;
	double a[2], b[2]; /* its ends, as numbers */
	int64_t level;
	bool in;               /* the window */
	int64_t tile[2];       /* where it is */
	int64_t last[2];       /* where it ends */
	struct contour_end at; /* the beginning of this part */
	struct border corner;  /* that was passed last, if it is at a corner */
	uint32_t cuts;
};

static double between(const struct walk *w, int axis, double part)
{
	return contour_between(&w->c->opt.axis[axis], w->a[axis] + (w->b[axis] - w->a[axis]) * part);
}

/* Where it crosses an edge of the window: at its ends as they are elsewhere, and exactly on an edge along an axis. */
static void edge_place(const struct walk *w, const struct area_crossing *edge, double ret[2])
{
	if (edge->part <= 0 || edge->part >= 1) {
		contour_place(w->c->opt.axis, edge->part <= 0 ? w->from : w->to, ret);
		return;
	}
	for (int i = 0; i < 2; i++)
		ret[i] = edge->low[i] == edge->high[i] ? contour_between(&w->c->opt.axis[i], (double)edge->low[i]) :
							 between(w, i, edge->part);
}

/* Of a corner of tiles: 1: left of the line. *ret_on: it is on it, and counts as moved to lesser x and y. */
static int corner_side(const struct walk *w, const int64_t line[2], bool *ret_on)
{
	const struct contour_tiles *t = &w->c->tiles;
	const struct plane *f = &w->plane;
	struct wide sum = wide_product(f->high * (i128)t->q, f->normal[2]);
	int sign;

	for (int i = 0; i < 2; i++) {
		i128 way = contour_tiles_border(t, i, line[i]) - (i128)f->at[i] * (i128)t->q;

		sum = wide_sum(sum, wide_negative(wide_product(f->normal[i], way * f->q)));
	}
	sign = wide_sign(sum);
	*ret_on = !sign;
	return sign ? sign : f->normal[0] ? (f->normal[0] > 0 ? 1 : -1) : f->normal[1] > 0 ? 1 : -1;
}

static double border_place(const struct walk *w, int axis, int64_t line)
{
	const struct contour_tiles *t = &w->c->tiles;

	return contour_border(&w->c->opt.axis[axis], contour_tiles_border(t, axis, line), (int64_t)t->q);
}

/* False: it is in its last tile. */
static bool next_border(const struct walk *w, struct border *ret)
{
	const struct contour_tiles *t = &w->c->tiles;
	int64_t line[2];
	int way[2], axis, other;
	bool on = false;
	double at;

	for (int i = 0; i < 2; i++) {
		way[i] = w->last[i] == w->tile[i] ? 0 : w->last[i] > w->tile[i] ? 1 : -1;
		line[i] = w->tile[i] + (way[i] > 0);
	}
	if (!t->p || (!way[0] && !way[1]))
		return false;
	axis = way[0] && way[1] ? corner_side(w, line, &on) != way[0] * way[1] : !way[0];
	other = !axis;
	*ret = (struct border){.axis = axis, .way = way[axis], .line = line[axis], .corner = on};
	if (w->corner.corner) {
		ret->part = w->corner.part;
		memcpy(ret->place, w->corner.place, sizeof(ret->place));
		ret->corner = false;
		return true;
	}
	for (int end = 0; end < 2; end++)
		if (!contour_tiles_beside(t, axis, end ? w->to : w->from, line[axis])) {
			ret->part = end;
			contour_place(w->c->opt.axis, end ? w->to : w->from, ret->place);
			return true;
		}
	at = contour_nearest(contour_tiles_border(t, axis, line[axis]), (i128)t->q);
	ret->part = (at - w->a[axis]) / (w->b[axis] - w->a[axis]);
	ret->place[axis] = border_place(w, axis, line[axis]);
	ret->place[other] = on ? border_place(w, other, line[other]) : between(w, other, ret->part);
	return true;
}

/* Whether an edge of the window lies on a border of tiles: they are crossed together. */
static bool along(const struct walk *w, const struct border *b, const struct area_crossing *edge)
{
	return edge->low[b->axis] == edge->high[b->axis] &&
	       contour_tiles_border(&w->c->tiles, b->axis, b->line) == (i128)edge->low[b->axis] * (i128)w->c->tiles.q;
}

static int part_ends(struct walk *w, const struct contour_end *end, struct err *err)
{
	const struct contour_end both[2] = {w->at, *end};
	int64_t key = w->level;
	int r = w->in && w->c->tiles.p ? contour_tiles_key(&w->c->tiles, w->tile, w->level, &key, err) : 0;

	if (!r && w->in)
		r = contour_chains_add(w->c, both, key, err);
	w->at = *end;
	return r;
}

/* Past the next edge or border. Of two at one place the one comes first behind which the part between them is not in the window.
 */
static int pass(struct walk *w, const struct area_crossing **edge, const struct border *border, struct err *err)
{
	bool same = *edge && border && along(w, border, *edge);
	bool window =
		*edge && (!border || (same ? w->in : (*edge)->part < border->part || (w->in && (*edge)->part == border->part)));
	struct contour_end end = {.edge = w->from, .cut = ++w->cuts};
	int r;

	if (window && !same)
		edge_place(w, *edge, end.at);
	else
		memcpy(end.at, border->place, sizeof(end.at));
	r = part_ends(w, &end, err);
	if (window) {
		w->in = !w->in;
		++*edge;
	} else {
		w->tile[border->axis] += border->way;
		w->corner = *border;
	}
	return r;
}

int contour_cut(struct contour *c, const int32_t *const v[3], const struct contour_crossing *from,
		const struct contour_crossing *to, int64_t level, struct err *err)
{
	struct walk w = {.c = c,
			 .from = from,
			 .to = to,
			 .plane = plane_of(c, v, level),
			 .s = {place_of(from), place_of(to), side, &w.plane},
			 .level = level,
			 .in = true,
			 .at = {.edge = from}};
	const struct area_crossing *edge = NULL, *end;
	struct border border;
	size_t n = 0;
	int r = c->area ? area_way(c->way, &w.s, &w.in, &edge, &n, err) : 0;

	end = n ? edge + n : edge;
	numbers_of(&w.s.a, w.a);
	numbers_of(&w.s.b, w.b);
	for (int i = 0; i < 2 && c->tiles.p; i++) {
		w.tile[i] = contour_tiles_of(&c->tiles, i, from);
		w.last[i] = contour_tiles_of(&c->tiles, i, to);
	}
	while (!r) {
		bool more = next_border(&w, &border);
		const struct area_crossing *next = edge != end ? edge : NULL, *before = next;

		if (!more && !next)
			return part_ends(&w, &(struct contour_end){.edge = to}, err);
		r = pass(&w, &next, more ? &border : NULL, err);
		edge += next != before;
	}
	return r;
}
