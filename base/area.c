/*
 * Areas of polygons (area.h).
 *
 * The edges of a ring are a chain. A binary tree over it has the box of each of its parts. A ray from a point to greater x
 * crosses a part of the chain never if the box is below, above or left of the point; and if the box is right of it, an odd number
 * of times where the ends of the part are one above and one not above the point. Only parts whose box has the point are looked
 * into, so no other edge of the ring is touched, however long or crowded they are.
 *
 * The rings of polygons are in a tree of boxes, too, in the order of a space-filling curve; the holes of a polygon likewise.
 * Both trees are arrays of nodes: first the node, then its left half, then its right one.
 */
#include "area_priv.h"

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grow.h"
#include "morton.h"

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory for an area");
}

struct area *area_new(enum area_border border)
{
	struct area *a = calloc(1, sizeof(*a));

	if (a)
		a->border = border;
	return a;
}

struct area *area_free(struct area *a)
{
	if (a) {
		free(a->ring);
		free(a->corner);
		free(a->box);
		free(a->item);
		free(a);
	}
	return NULL;
}

int area_ring(struct area *a, bool shell, struct err *err)
{
	if (!grow(&a->ring, &a->rings_room, a->nring + 1, 8, sizeof(*a->ring)))
		return no_memory(err);
	a->ring[a->nring] = (struct area_ring){.first = a->ncorner, .shell = shell || !a->nring};
	a->nring++;
	return 0;
}

int area_corner(struct area *a, int64_t x, int64_t y, struct err *err)
{
	if (!grow(&a->corner, &a->corners_room, a->ncorner + 1, 64, sizeof(*a->corner)))
		return no_memory(err);
	a->corner[a->ncorner][0] = x;
	a->corner[a->ncorner++][1] = y;
	a->ring[a->nring - 1].n++;
	return 0;
}

/* ---- boxes ---- */

static void box_point(int64_t box[4], const int64_t p[2], bool first)
{
	for (int k = 0; k < 2; k++) {
		box[k] = first || p[k] < box[k] ? p[k] : box[k];
		box[2 + k] = first || p[k] > box[2 + k] ? p[k] : box[2 + k];
	}
}

static void box_join(int64_t box[4], const int64_t other[4])
{
	box_point(box, other, false);
	box_point(box, other + 2, false);
}

/* The nodes of a tree over n leaves. */
static int more_boxes(struct area *a, size_t n, size_t *ret, struct err *err)
{
	size_t need = a->nbox + 2 * n - 1;

	if (!grow(&a->box, &a->boxes_room, need, need, sizeof(*a->box)))
		return no_memory(err);
	*ret = a->nbox;
	a->nbox = need;
	return 0;
}

static void chain_boxes(struct area *a, const struct area_ring *r, struct node n)
{
	int64_t *box = a->box[n.box];

	if (is_leaf(n)) {
		for (size_t i = first_edge(n); i <= last_edge(r, n); i++)
			box_point(box, corner_of(a, r, i), i == first_edge(n));
		return;
	}
	chain_boxes(a, r, left_of(n));
	chain_boxes(a, r, right_of(n));
	memcpy(box, a->box[left_of(n).box], sizeof(*a->box));
	box_join(box, a->box[right_of(n).box]);
}

/* ---- sets of rings ---- */

/* The place of the middle of a box on a Z-order curve over the bounds of the area. */
static uint64_t curve_key(const struct area *a, const int64_t box[4])
{
	uint64_t key = 0;

	for (int k = 0; k < 2; k++) {
		uint64_t span = (uint64_t)a->bounds[2 + k] - (uint64_t)a->bounds[k];
		uint64_t at =
			((uint64_t)box[k] - (uint64_t)a->bounds[k]) / 2 + ((uint64_t)box[2 + k] - (uint64_t)a->bounds[k]) / 2;
		unsigned shift = 0;

		while (span >> shift >> 32)
			shift++;
		key |= morton_spread((uint32_t)(at >> shift)) << k;
	}
	return key;
}

static int by_key(const void *a, const void *b)
{
	const struct area_item *x = a, *y = b;

	if (x->key != y->key)
		return x->key < y->key ? -1 : 1;
	return (x->ring > y->ring) - (x->ring < y->ring);
}

/* A leaf is the ring with its holes, which may reach out of it. */
static void set_boxes(struct area *a, const struct area_set *s, struct node n)
{
	if (is_leaf(n)) {
		const struct area_ring *r = &a->ring[a->item[s->item + n.low].ring];

		memcpy(a->box[n.box], a->box[r->box], sizeof(*a->box));
		if (r->holes.n)
			box_join(a->box[n.box], a->box[r->holes.box]);
		return;
	}
	set_boxes(a, s, left_of(n));
	set_boxes(a, s, right_of(n));
	memcpy(a->box[n.box], a->box[left_of(n).box], sizeof(*a->box));
	box_join(a->box[n.box], a->box[right_of(n).box]);
}

/* The items are there, without keys. */
static int set_make(struct area *a, struct area_set *s, struct err *err)
{
	if (!s->n)
		return 0;
	for (size_t i = s->item; i < s->item + s->n; i++)
		a->item[i].key = curve_key(a, a->box[a->ring[a->item[i].ring].box]);
	qsort(a->item + s->item, s->n, sizeof(*a->item), by_key);
	if (more_boxes(a, s->n, &s->box, err))
		return -(int)err->code;
	set_boxes(a, s, (struct node){s->box, 0, s->n});
	return 0;
}

/* Rings without corners have no interior, and their polygon has none. */
static int make_sets(struct area *a, struct err *err)
{
	size_t n = 0;
	int r = 0;

	for (size_t i = 0, shell = 0; i < a->nring; i++) {
		shell = a->ring[i].shell ? i : shell;
		if (i == shell)
			a->ring[i].holes.item = n;
		if (i == shell || !a->ring[i].n || !a->ring[shell].n)
			continue;
		a->item[n++].ring = i;
		a->ring[shell].holes.n++;
	}
	a->polygons.item = n;
	for (size_t i = 0; i < a->nring; i++)
		if (a->ring[i].shell && a->ring[i].n) {
			a->item[n++].ring = i;
			a->polygons.n++;
		}
	for (size_t i = 0; i < a->nring && !r; i++)
		r = set_make(a, &a->ring[i].holes, err);
	return r ? r : set_make(a, &a->polygons, err);
}

void area_bounds(const struct area *a, int64_t ret[4])
{
	memset(ret, 0, 4 * sizeof(*ret));
	for (size_t i = 0; i < a->ncorner; i++)
		box_point(ret, a->corner[i], !i);
}

int area_end(struct area *a, struct err *err)
{
	area_bounds(a, a->bounds);
	for (int k = 0; k < 4 && a->ncorner; k++)
		if (a->bounds[k] > AREA_MOST || a->bounds[k] < -AREA_MOST)
			return err_set(err, ERR_INTERNAL, "a corner of an area is too far out");
	a->item = malloc((a->nring + 1) * sizeof(*a->item));
	if (!a->item)
		return no_memory(err);
	for (size_t i = 0; i < a->nring; i++) {
		struct area_ring *r = &a->ring[i];

		if (!r->n)
			continue;
		if (more_boxes(a, leaves(r), &r->box, err))
			return -(int)err->code;
		chain_boxes(a, r, (struct node){r->box, 0, leaves(r)});
	}
	return make_sets(a, err);
}

/* ---- points ---- */

/* Whether a ray to greater x crosses the node an odd number of times, and whether the point is on it. */
static bool chain_crosses(const struct area *a, const struct area_ring *r, struct node n, int64_t x, int64_t y, bool *on)
{
	const int64_t *box = a->box[n.box];
	bool odd = false;

	if (y < box[1] || y > box[3] || x > box[2])
		return false;
	if (x < box[0])
		return (corner_of(a, r, first_edge(n))[1] <= y) != (corner_of(a, r, last_edge(r, n))[1] <= y);
	if (!is_leaf(n))
		return chain_crosses(a, r, left_of(n), x, y, on) != chain_crosses(a, r, right_of(n), x, y, on);
	for (size_t i = first_edge(n); i < last_edge(r, n); i++) {
		const int64_t *p = corner_of(a, r, i), *q = corner_of(a, r, i + 1);

		if (p[1] <= q[1])
			*on |= area_edge_holds(p[0], p[1], q[0], q[1], x, y, &odd);
		else
			*on |= area_edge_holds(q[0], q[1], p[0], p[1], x, y, &odd);
	}
	return odd;
}

/* Whether a ring of the set has the point; one of holes without its border if the area is closed. */
static bool set_has(const struct area *a, const struct area_set *s, struct node n, int64_t x, int64_t y, bool holes)
{
	const int64_t *box = a->box[n.box];
	const struct area_ring *r;
	bool on = false, in;

	if (x < box[0] || y < box[1] || x > box[2] || y > box[3])
		return false;
	if (!is_leaf(n))
		return set_has(a, s, left_of(n), x, y, holes) || set_has(a, s, right_of(n), x, y, holes);
	r = &a->ring[a->item[s->item + n.low].ring];
	in = chain_crosses(a, r, (struct node){r->box, 0, leaves(r)}, x, y, &on);
	if (on && a->border == AREA_CLOSED)
		in = !holes;
	return in && !(r->holes.n && set_has(a, &r->holes, (struct node){r->holes.box, 0, r->holes.n}, x, y, true));
}

bool area_has(const struct area *a, int64_t x, int64_t y)
{
	return a->polygons.n && set_has(a, &a->polygons, (struct node){a->polygons.box, 0, a->polygons.n}, x, y, false);
}

/* ---- boxes and triangles of points ---- */

/* A closed shape with its bounds. */
struct shape {
	int64_t box[4];
	bool (*met_by)(const struct shape *, const int64_t p[2], const int64_t q[2]); /* the edge's box meets its bounds */
	const int64_t (*corner)[2];
};

/* The side of the line from p to q on which the point is: > 0 left, 0 on it. */
static __int128 side_of(const int64_t p[2], const int64_t q[2], int64_t x, int64_t y)
{
	return (__int128)(q[0] - p[0]) * (y - p[1]) - (__int128)(x - p[0]) * (q[1] - p[1]);
}

static bool box_met_by(const struct shape *s, const int64_t p[2], const int64_t q[2])
{
	bool left = false, right = false;

	for (int i = 0; i < 4; i++) {
		__int128 side = side_of(p, q, s->box[i & 1 ? 2 : 0], s->box[i < 2 ? 1 : 3]);

		left |= side >= 0;
		right |= side <= 0;
	}
	return left && right;
}

/* An edge and a triangle are disjoint iff a line along a side of the triangle, or along the edge, separates them. */
static bool triangle_met_by(const struct shape *s, const int64_t p[2], const int64_t q[2])
{
	unsigned left = 0, right = 0;

	for (unsigned i = 0; i < 3; i++) {
		const int64_t *a = s->corner[i], *b = s->corner[(i + 1) % 3];
		__int128 side = side_of(p, q, a[0], a[1]);

		if (side_of(a, b, p[0], p[1]) < 0 && side_of(a, b, q[0], q[1]) < 0)
			return false;
		left += side > 0;
		right += side < 0;
	}
	return left < 3 && right < 3;
}

static bool edge_meets(const int64_t p[2], const int64_t q[2], const struct shape *s)
{
	int64_t of[4];

	box_point(of, p, true);
	box_point(of, q, false);
	return boxes_meet(of, s->box) && s->met_by(s, p, q);
}

static bool chain_meets(const struct area *a, const struct area_ring *r, struct node n, const struct shape *s)
{
	if (!boxes_meet(a->box[n.box], s->box))
		return false;
	if (!is_leaf(n))
		return chain_meets(a, r, left_of(n), s) || chain_meets(a, r, right_of(n), s);
	for (size_t i = first_edge(n); i < last_edge(r, n); i++)
		if (edge_meets(corner_of(a, r, i), corner_of(a, r, i + 1), s))
			return true;
	return false;
}

static bool set_meets(const struct area *a, const struct area_set *set, struct node n, const struct shape *s)
{
	const struct area_ring *r;

	if (!boxes_meet(a->box[n.box], s->box))
		return false;
	if (!is_leaf(n))
		return set_meets(a, set, left_of(n), s) || set_meets(a, set, right_of(n), s);
	r = &a->ring[a->item[set->item + n.low].ring];
	return chain_meets(a, r, (struct node){r->box, 0, leaves(r)}, s) ||
	       (r->holes.n && set_meets(a, &r->holes, (struct node){r->holes.box, 0, r->holes.n}, s));
}

static bool meets(const struct area *a, const struct shape *s)
{
	return a->polygons.n && set_meets(a, &a->polygons, (struct node){a->polygons.box, 0, a->polygons.n}, s);
}

bool area_edge_meets(const struct area *a, const int64_t corner[3][2])
{
	struct shape s = {.met_by = triangle_met_by, .corner = corner};

	for (int i = 0; i < 3; i++)
		box_point(s.box, corner[i], !i);
	return meets(a, &s);
}

enum area_side area_box(const struct area *a, const int64_t box[4])
{
	struct shape s = {.met_by = box_met_by};

	memcpy(s.box, box, sizeof(s.box));
	if (meets(a, &s))
		return AREA_MIXED;
	return area_has(a, box[0], box[1]) ? AREA_IN : AREA_OUT;
}
