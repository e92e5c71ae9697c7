/*
 * Triangles that are out of the mesh (LINESET_OUT at the centroid) are not chosen. What is out changes at pieces only, and these
 * are edges: so triangles that are linked across other edges are all out, or none, and one of them is asked. An exception are
 * pieces that the view has taken away (`gone`): triangles that they may cross are asked one by one, and nothing is followed
 * through them. With many such pieces all triangles are asked.
 *
 * The triangles to follow are kept in a list of limited length. One that is dropped from it is asked later as the first of
 * others.
 */
#include "constrain_priv.h"

#include <string.h>

enum { LIST = 2048, GONE = 16 };

struct out {
	struct constrain_work *w;
	uint64_t *chosen, *waiting; /* bits; waiting: chosen triangles that were not reached */
	uint32_t *list, nlist;
	const struct constrain_piece *gone[GONE];
	unsigned ngone;
	bool each; /* ask all of them */
	bool any;
};

static int is_out(const struct out *o, uint32_t triangle, bool *ret)
{
	const struct constrain_lines *lines = o->w->c->lines;
	const uint32_t *corner = o->w->r.triangle[triangle].corner;
	int64_t sum[2] = {0, 0};
	unsigned state = 0;
	int rc;

	for (unsigned i = 0; i < 3; i++)
		for (unsigned k = 0; k < 2; k++)
			sum[k] += o->w->r.xy[corner[i]][k];
	rc = lines->state(lines->ctx, sum[0], sum[1], 3, &state, o->w->err);
	*ret = state & LINESET_OUT;
	return rc;
}

static bool is_alone(const struct out *o, uint32_t triangle)
{
	int32_t box[4];

	if (o->each)
		return true;
	if (!o->ngone)
		return false;
	constrain_triangle_box(&o->w->r, o->w->r.triangle[triangle].corner, box);
	for (unsigned i = 0; i < o->ngone; i++) {
		const struct constrain_piece *p = o->gone[i];
		const int32_t at[4] = {p->a[0], p->a[1] < p->b[1] ? p->a[1] : p->b[1], p->b[0],
				       p->a[1] < p->b[1] ? p->b[1] : p->a[1]};

		if (constrain_boxes_meet(box, at))
			return true;
	}
	return false;
}

/* Takes a triangle that waits; follows its links later if it is not alone. */
static void reach(struct out *o, uint32_t triangle, bool out)
{
	o->waiting[triangle / 64] &= ~(UINT64_C(1) << triangle % 64);
	if (out)
		o->chosen[triangle / 64] &= ~(UINT64_C(1) << triangle % 64);
	o->any |= out;
	o->list[o->nlist++] = triangle;
}

static int part(struct out *o, uint32_t first)
{
	bool out = false;
	int rc = is_out(o, first, &out);

	o->nlist = 0;
	reach(o, first, out);
	if (is_alone(o, first))
		o->nlist = 0;
	while (o->nlist > 0 && !rc) {
		const struct tri_triangle *t = &o->w->r.triangle[o->list[--o->nlist]];

		for (unsigned k = 0; k < 3; k++) {
			uint32_t next = t->link[k] >> 3;

			if (t->link[k] & 1 || o->nlist == LIST || !constrain_bit(o->waiting, next) || is_alone(o, next))
				continue;
			reach(o, next, out);
		}
	}
	return rc;
}

static void find_gone(struct out *o)
{
	for (uint32_t i = 0; i < o->w->npiece; i++) {
		const struct constrain_piece *p = &o->w->piece[i];

		if (!p->gone || !p->turns)
			continue;
		if (o->ngone == GONE)
			o->each = true;
		else
			o->gone[o->ngone++] = p;
	}
}

int constrain_out(struct constrain_work *w, uint64_t *chosen, bool *ret_any)
{
	size_t bytes = ((size_t)w->r.ntriangle + 63) / 64 * sizeof(uint64_t);
	struct out o = {.w = w,
			.chosen = chosen,
			.waiting = constrain_take(w, bytes),
			.list = constrain_take(w, LIST * sizeof(uint32_t))};

	if (!o.waiting || !o.list)
		return CONSTRAIN_E_SPLIT;
	memcpy(o.waiting, chosen, bytes);
	find_gone(&o);
	for (uint32_t i = 0; i < w->r.ntriangle; i++) {
		int rc = constrain_bit(o.waiting, i) ? part(&o, i) : 0;

		if (rc)
			return rc;
	}
	*ret_any = o.any;
	return 0;
}
