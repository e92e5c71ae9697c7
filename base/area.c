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
#include "area.h"

#include <stdlib.h>
#include <string.h>

#include "area_priv.h"
#include "err.h"

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory for an area");
}

struct area *area_new(void)
{
	return calloc(1, sizeof(struct area));
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
	if (a->nring == a->rings_room) {
		size_t room = a->rings_room ? 2 * a->rings_room : 8;
		void *more = realloc(a->ring, room * sizeof(*a->ring));

		if (!more)
			return no_memory(err);
		a->ring = more;
		a->rings_room = room;
	}
	a->ring[a->nring] = (struct ring){.first = a->ncorner, .shell = shell || !a->nring};
	a->nring++;
	return 0;
}

int area_corner(struct area *a, int64_t x, int64_t y, struct err *err)
{
	if (a->ncorner == a->corners_room) {
		size_t room = a->corners_room ? 2 * a->corners_room : 64;
		void *more = realloc(a->corner, room * sizeof(*a->corner));

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

	if (need > a->boxes_room) {
		size_t room = need > 2 * a->boxes_room ? need : 2 * a->boxes_room;
		void *more = realloc(a->box, room * sizeof(*a->box));

		if (!more)
			return no_memory(err);
		a->box = more;
		a->boxes_room = room;
	}
	*ret = a->nbox;
	a->nbox = need;
	return 0;
}

static void chain_boxes(struct area *a, const struct ring *r, struct node n)
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

/* The bits of v at the even places. */
static uint64_t spread(uint64_t v)
{
	v = (v | v << 16) & 0x0000ffff0000ffff;
	v = (v | v << 8) & 0x00ff00ff00ff00ff;
	v = (v | v << 4) & 0x0f0f0f0f0f0f0f0f;
	v = (v | v << 2) & 0x3333333333333333;
	return (v | v << 1) & 0x5555555555555555;
}

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
		key |= spread(at >> shift) << k;
	}
	return key;
}

static int by_key(const void *a, const void *b)
{
	const struct item *x = a, *y = b;

	if (x->key != y->key)
		return x->key < y->key ? -1 : 1;
	return (x->ring > y->ring) - (x->ring < y->ring);
}

static void set_boxes(struct area *a, const struct set *s, struct node n)
{
	if (is_leaf(n)) {
		memcpy(a->box[n.box], a->box[a->ring[a->item[s->item + n.low].ring].box], sizeof(*a->box));
		return;
	}
	set_boxes(a, s, left_of(n));
	set_boxes(a, s, right_of(n));
	memcpy(a->box[n.box], a->box[left_of(n).box], sizeof(*a->box));
	box_join(a->box[n.box], a->box[right_of(n).box]);
}

/* The items are there, without keys. */
static int set_make(struct area *a, struct set *s, struct err *err)
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

int area_end(struct area *a, struct err *err)
{
	for (size_t i = 0; i < a->ncorner; i++)
		box_point(a->bounds, a->corner[i], !i);
	for (int k = 0; k < 4 && a->ncorner; k++)
		if (a->bounds[k] > AREA_MOST || a->bounds[k] < -AREA_MOST)
			return err_set(err, ERR_INTERNAL, "a corner of an area is too far out");
	a->item = malloc((a->nring + 1) * sizeof(*a->item));
	if (!a->item)
		return no_memory(err);
	for (size_t i = 0; i < a->nring; i++) {
		struct ring *r = &a->ring[i];

		if (!r->n)
			continue;
		if (more_boxes(a, leaves(r), &r->box, err))
			return -(int)err->code;
		chain_boxes(a, r, (struct node){r->box, 0, leaves(r)});
	}
	return make_sets(a, err);
}

/* ---- points ---- */

static bool chain_crosses(const struct area *a, const struct ring *r, struct node n, int64_t x, int64_t y)
{
	const int64_t *box = a->box[n.box];
	bool odd = false;

	if (y < box[1] || y >= box[3] || x >= box[2])
		return false;
	if (x < box[0])
		return (corner_of(a, r, first_edge(n))[1] <= y) != (corner_of(a, r, last_edge(r, n))[1] <= y);
	if (!is_leaf(n))
		return chain_crosses(a, r, left_of(n), x, y) != chain_crosses(a, r, right_of(n), x, y);
	for (size_t i = first_edge(n); i < last_edge(r, n); i++) {
		const int64_t *p = corner_of(a, r, i), *q = corner_of(a, r, i + 1);

		if (p[1] <= q[1])
			area_edge_holds(p[0], p[1], q[0], q[1], x, y, &odd);
		else
			area_edge_holds(q[0], q[1], p[0], p[1], x, y, &odd);
	}
	return odd;
}

static bool set_has(const struct area *a, const struct set *s, struct node n, int64_t x, int64_t y)
{
	const int64_t *box = a->box[n.box];
	const struct ring *r;

	if (x < box[0] || y < box[1] || x >= box[2] || y >= box[3])
		return false;
	if (!is_leaf(n))
		return set_has(a, s, left_of(n), x, y) || set_has(a, s, right_of(n), x, y);
	r = &a->ring[a->item[s->item + n.low].ring];
	return chain_crosses(a, r, (struct node){r->box, 0, leaves(r)}, x, y) &&
	       !(r->holes.n && set_has(a, &r->holes, (struct node){r->holes.box, 0, r->holes.n}, x, y));
}

bool area_has(const struct area *a, int64_t x, int64_t y)
{
	return a->polygons.n && set_has(a, &a->polygons, (struct node){a->polygons.box, 0, a->polygons.n}, x, y);
}

/* ---- boxes of points ---- */

static bool edge_meets(const int64_t p[2], const int64_t q[2], const int64_t box[4])
{
	int64_t of[4];
	bool left = false, right = false;

	box_point(of, p, true);
	box_point(of, q, false);
	if (!boxes_meet(of, box))
		return false;
	for (int i = 0; i < 4; i++) {
		__int128 turn = (__int128)(q[0] - p[0]) * (box[i < 2 ? 1 : 3] - p[1]) -
				(__int128)(box[i & 1 ? 2 : 0] - p[0]) * (q[1] - p[1]);

		left |= turn >= 0;
		right |= turn <= 0;
	}
	return left && right;
}

static bool chain_meets(const struct area *a, const struct ring *r, struct node n, const int64_t box[4])
{
	if (!boxes_meet(a->box[n.box], box))
		return false;
	if (!is_leaf(n))
		return chain_meets(a, r, left_of(n), box) || chain_meets(a, r, right_of(n), box);
	for (size_t i = first_edge(n); i < last_edge(r, n); i++)
		if (edge_meets(corner_of(a, r, i), corner_of(a, r, i + 1), box))
			return true;
	return false;
}

static bool set_meets(const struct area *a, const struct set *s, struct node n, const int64_t box[4])
{
	const struct ring *r;

	if (!boxes_meet(a->box[n.box], box))
		return false;
	if (!is_leaf(n))
		return set_meets(a, s, left_of(n), box) || set_meets(a, s, right_of(n), box);
	r = &a->ring[a->item[s->item + n.low].ring];
	return chain_meets(a, r, (struct node){r->box, 0, leaves(r)}, box) ||
	       (r->holes.n && set_meets(a, &r->holes, (struct node){r->holes.box, 0, r->holes.n}, box));
}

enum area_side area_box(const struct area *a, const int64_t box[4])
{
	if (a->polygons.n && set_meets(a, &a->polygons, (struct node){a->polygons.box, 0, a->polygons.n}, box))
		return AREA_MIXED;
	return area_has(a, box[0], box[1]) ? AREA_IN : AREA_OUT;
}
