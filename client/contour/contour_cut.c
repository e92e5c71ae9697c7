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

	c->area = area_new();
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

/* Where a segment crosses an edge: at its ends as they are elsewhere, and exactly on an edge along an axis. */
static void place_cut(const struct contour *c, const struct contour_crossing *from, const struct contour_crossing *to,
		      const struct area_segment *s, const struct area_crossing *edge, double ret[2])
{
	double a[2], b[2];

	if (edge->part <= 0 || edge->part >= 1) {
		contour_place(c->opt.axis, edge->part <= 0 ? from : to, ret);
		return;
	}
	numbers_of(&s->a, a);
	numbers_of(&s->b, b);
	for (int i = 0; i < 2; i++)
		ret[i] = contour_between(&c->opt.axis[i], edge->low[i] == edge->high[i] ? (double)edge->low[i] :
											  a[i] + (b[i] - a[i]) * edge->part);
}

int contour_cut(struct contour *c, const int32_t *const v[3], const struct contour_crossing *from,
		const struct contour_crossing *to, int64_t level, struct err *err)
{
	const struct plane plane = plane_of(c, v, level);
	const struct area_segment s = {place_of(from), place_of(to), side, &plane};
	struct contour_end end[2] = {{.edge = from}, {.edge = from}};
	const struct area_crossing *edge;
	size_t n;
	bool in;
	int r = area_way(c->way, &s, &in, &edge, &n, err);

	for (size_t i = 0; i < n && !r; i++) {
		end[1].cut = (uint32_t)i + 1;
		place_cut(c, from, to, &s, &edge[i], end[1].at);
		if (in)
			r = contour_chains_add(c, end, level, err);
		end[0] = end[1];
		in = !in;
	}
	end[1] = (struct contour_end){.edge = to};
	return r || !in ? r : contour_chains_add(c, end, level, err);
}
