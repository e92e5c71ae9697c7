/*
 * The pieces of a domain: those that meet the box of one of its triangles. They are searched for many triangles at once,
 * around which one box is laid, and each piece that is found is compared with the box of each triangle.
 */
#include "constrain_priv.h"

#include <string.h>

#include "point.h"
#include "view.h"

static void piece_box(const struct lineset_piece *p, int32_t ret[4])
{
	/* a is before b by x. */
	ret[0] = p->a[0];
	ret[2] = p->b[0];
	ret[1] = p->a[1] < p->b[1] ? p->a[1] : p->b[1];
	ret[3] = p->a[1] < p->b[1] ? p->b[1] : p->a[1];
}

/* Whether the piece itself meets the box, which meets that of the piece: corners of the box are on both sides of it, or on it. */
static bool meets(const struct lineset_piece *p, const int32_t box[4])
{
	bool up = p->b[1] > p->a[1];
	const int32_t left[2] = {up ? box[0] : box[2], box[3]}, right[2] = {up ? box[2] : box[0], box[1]};

	return geom_orient(p->a, p->b, left) >= 0 && geom_orient(p->a, p->b, right) <= 0;
}

static int compare(const struct constrain_piece *p, const struct constrain_piece *q)
{
	/* Along a curve, so that neighbours in the list are neighbours in the plane. */
	uint64_t a = point_morton(p->a[0], p->a[1]), b = point_morton(q->a[0], q->a[1]);

	if (a == b) {
		a = point_morton(p->b[0], p->b[1]);
		b = point_morton(q->b[0], q->b[1]);
	}
	return (a > b) - (a < b);
}

static bool piece_less(const void *a, const void *b)
{
	return compare(a, b) < 0;
}

/* Among those that were sorted: behind the new ones. */
static bool is_known(const struct constrain_work *w, const struct constrain_piece *p)
{
	const struct constrain_piece *sorted = w->piece + w->nnew;
	uint32_t lo = 0, hi = w->npiece - w->nnew;

	while (lo < hi) {
		uint32_t mid = lo + (hi - lo) / 2;
		int order = compare(p, &sorted[mid]);

		if (!order)
			return true;
		if (order < 0)
			hi = mid;
		else
			lo = mid + 1;
	}
	return false;
}

void constrain_lines_sort(struct constrain_work *w)
{
	const struct constrain_piece *end = w->piece + w->npiece;
	struct constrain_piece *to = w->piece + w->npiece;

	if (!w->nnew)
		return;
	constrain_sort(w->piece, w->npiece, sizeof(*w->piece), piece_less);
	/* The last of equals is kept, towards the end of the memory. */
	for (const struct constrain_piece *p = end; p > w->piece;) {
		p--;
		if (to == end || compare(p, to))
			*--to = *p;
		else if (!to->in)
			*to = *p;
	}
	w->npiece = (uint32_t)(end - to);
	w->piece = to;
	w->nnew = 0;
}

static int add_piece(struct constrain_work *w, const struct constrain_piece *p)
{
	if (is_known(w, p))
		return 0;
	for (unsigned tries = 0; (uint8_t *)(w->piece - 1) < (uint8_t *)(w->point + w->npoint); tries++) {
		uint32_t before = w->npiece;

		constrain_lines_sort(w);
		if (tries || w->npiece > before - before / 8)
			return CONSTRAIN_E_SPLIT;
	}
	*--w->piece = *p;
	w->npiece++;
	w->nnew++;
	w->found++;
	return 0;
}

static struct constrain_piece made_of(const struct lineset_piece *p)
{
	return (struct constrain_piece){.a = {p->a[0], p->a[1]},
					.b = {p->b[0], p->b[1]},
					.end = {NONE, NONE},
					.at = {NONE, NONE},
					.turns = p->turns & LINESET_OUT};
}

static void find_end(struct constrain_work *w, struct constrain_piece *p, unsigned i)
{
	if (p->at[i] != NONE)
		w->near = p->at[i];
	p->end[i] = constrain_vertex(w, i ? p->b : p->a);
	p->at[i] = w->near;
}

/* A piece with an end that is no vertex is loaded only if it crosses an owned triangle. */
static bool is_far(struct constrain_work *w, struct constrain_piece *p)
{
	find_end(w, p, 0);
	find_end(w, p, 1);
	return (p->end[0] == NONE || p->end[1] == NONE) && !constrain_far_crosses(w, p);
}

static void list_far(struct constrain_work *w, const struct constrain_piece *p)
{
	if (w->nfar < FAR)
		w->far[w->nfar++] = (struct lineset_piece){
			.a = {p->a[0], p->a[1]}, .b = {p->b[0], p->b[1]}, .turns = p->turns ? LINESET_OUT : 0};
	else
		w->many = true;
}

/* Takes out of those that were found since the last time what is far. They are sorted first, so that ends follow each other. */
static void settle(struct constrain_work *w)
{
	struct constrain_piece *end = w->piece + w->nnew, *to = end;

	if (w->nnew)
		constrain_hints(w);
	constrain_sort(w->piece, w->nnew, sizeof(*w->piece), piece_less);
	for (struct constrain_piece *p = end; p > w->piece;) {
		p--;
		if (is_far(w, p))
			list_far(w, p);
		else
			*--to = *p;
	}
	w->npiece -= (uint32_t)(to - w->piece);
	w->piece = to;
	w->nnew = 0;
}

static int found_any(void *ctx, const struct lineset_piece *found, struct err *err)
{
	struct constrain_work *w = ctx;

	(void)err;
	for (unsigned tries = 0; (uint8_t *)(w->piece - 1) < (uint8_t *)w->point; tries++) {
		if (tries || !w->nnew)
			return CONSTRAIN_E_SPLIT;
		settle(w);
	}
	*--w->piece = made_of(found);
	w->npiece++;
	w->nnew++;
	return 0;
}

int constrain_lines_all(struct constrain_work *w, const int32_t box[4])
{
	int rc;

	memcpy(w->all, box, sizeof(w->all));
	rc = w->c->lines->find(w->c->lines->ctx, box, found_any, w, w->err);
	settle(w);
	/* They are sorted unless they were settled in parts. */
	w->nnew = w->npiece;
	for (uint32_t i = 1; i < w->npiece; i++)
		if (!piece_less(&w->piece[i - 1], &w->piece[i]))
			return rc;
	w->nnew = 0;
	return rc;
}

static int found_piece(void *ctx, const struct lineset_piece *found, struct err *err)
{
	const struct constrain_piece p = made_of(found);
	struct constrain_work *w = ctx;
	int32_t box[4];

	(void)err;
	piece_box(found, box);
	for (uint32_t i = 0; i < w->nbox; i++)
		if (constrain_boxes_meet(w->box[i], box) && meets(found, w->box[i]))
			return add_piece(w, &p);
	return 0;
}

/* Searches the list, from which a piece is removed when it is loaded. */
static int find_far(struct constrain_work *w)
{
	for (uint32_t i = w->nfar; i-- > 0;) {
		uint32_t before = w->found;
		int32_t box[4];
		int rc;

		piece_box(&w->far[i], box);
		if (!constrain_boxes_meet(w->around, box))
			continue;
		rc = found_piece(w, &w->far[i], w->err);
		if (rc)
			return rc;
		if (w->found > before)
			w->far[i] = w->far[--w->nfar];
	}
	return 0;
}

static bool in_all(const struct constrain_work *w)
{
	return w->around[0] >= w->all[0] && w->around[1] >= w->all[1] && w->around[2] <= w->all[2] && w->around[3] <= w->all[3];
}

int constrain_lines_flush(struct constrain_work *w)
{
	int rc = 0;

	if (w->nbox && !w->many && in_all(w))
		rc = find_far(w);
	else if (w->nbox)
		rc = w->c->lines->find(w->c->lines->ctx, w->around, found_piece, w, w->err);
	w->nbox = 0;
	return rc;
}

int constrain_lines_box(struct constrain_work *w, const int32_t box[4])
{
	if (!w->nbox)
		memcpy(w->around, box, sizeof(w->around));
	point_box_join(w->around, box);
	memcpy(w->box[w->nbox++], box, sizeof(w->around));
	return w->nbox == BOXES ? constrain_lines_flush(w) : 0;
}

/* ---- ends ---- */

struct end {
	const struct view *view;
	struct point best;
	bool any;
};

static int end_points(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct end *e = ctx;

	(void)err;
	for (size_t i = 0; i < n; i++) {
		if (view_judge(e->view, &pts[i]) != VIEW_KEPT || (e->any && !view_prefers(e->view, &pts[i], &e->best)))
			continue;
		e->best = pts[i];
		e->any = true;
	}
	return 0;
}

/* *ret_there: it is a vertex, or becomes one. */
static int load_end(struct constrain_work *w, struct constrain_piece *p, unsigned i, bool *ret_there)
{
	const struct constrain *c = w->c;
	const int32_t *at = i ? p->b : p->a;
	uint64_t key = point_morton(at[0], at[1]);
	struct end e = {.view = c->view};
	int rc;

	if (p->end[i] == NONE)
		find_end(w, p, i);
	*ret_there = p->end[i] != NONE;
	/* All kept positions of the region are vertices. */
	if (*ret_there || (!c->area && cut_region_holds(c->region, at[0], at[1])))
		return 0;
	rc = c->src->scan(c->src->ctx, key, key, end_points, &e, w->err);
	*ret_there = e.any;
	return rc || !e.any ? rc : constrain_points_add(w, &e.best);
}

int constrain_lines_ends(struct constrain_work *w)
{
	for (uint32_t i = 0; i < w->npiece; i++) {
		struct constrain_piece *p = &w->piece[i];
		bool a = false, b = false;
		int rc;

		if (p->gone || p->in)
			continue;
		rc = load_end(w, p, 0, &a);
		if (!rc && a)
			rc = load_end(w, p, 1, &b);
		if (rc)
			return rc;
		p->gone = !a || !b;
	}
	return 0;
}

void constrain_lines_known(struct constrain_work *w, struct constrain_piece *p)
{
	for (unsigned i = 0; i < 2; i++) {
		const uint32_t *corner = w->r.triangle[p->at[i]].corner;

		/* The triangle may have been replaced. */
		if (corner[0] != p->end[i] && corner[1] != p->end[i] && corner[2] != p->end[i])
			find_end(w, p, i);
		tri_piece_end(w->p, w->r.id[p->end[i]], p->at[i]);
	}
}
