/*
 * A piece of a window of a view with weights (docs/design/windows.md). It begins with the positions that the piece has, or
 * depends on, without their weights, as window_area.c finds them. Their cells are read again for the records, since of several at
 * one position the weights decide. Then engine/regular adds what can matter to the triangles that meet the piece.
 */
#include "window_area.h"

#include <string.h>

#include "align.h"
#include "cut_order.h"
#include "err.h"
#include "finish.h"
#include "regular.h"

/* A piece that begins with less than this part of what the arena holds is not halved: the halves would load as much. */
enum { SMALL = 32 };

struct records {
	const struct view *view;
	const struct cut_source *src;
	struct point *pts; /* one of each position, in Morton order */
	uint32_t n;
	uint8_t *known;
	struct mesh_counts *counts;
	struct err *err;
};

/* The first position from this key on. */
static uint32_t first_from(const struct records *r, uint64_t key)
{
	uint32_t low = 0, high = r->n;

	while (low < high) {
		uint32_t middle = low + (high - low) / 2;

		if (point_morton(r->pts[middle].x, r->pts[middle].y) < key)
			low = middle + 1;
		else
			high = middle;
	}
	return low;
}

static bool has_some(void *ctx, const struct grid_cell *cell)
{
	const struct records *r = ctx;
	uint32_t i = cell->count ? first_from(r, cell->lo) : r->n;

	return i < r->n && point_morton(r->pts[i].x, r->pts[i].y) <= cell->hi;
}

static int take_records(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct records *r = ctx;

	(void)err;
	r->counts->points_read += n;
	for (size_t i = 0; i < n; i++) {
		uint32_t at = first_from(r, point_morton(pts[i].x, pts[i].y));
		struct point *best = &r->pts[at];

		if (at == r->n || best->x != pts[i].x || best->y != pts[i].y || view_judge(r->view, &pts[i]) != VIEW_KEPT)
			continue;
		if (r->known[at] && !view_prefers(r->view, &pts[i], best))
			continue;
		*best = pts[i];
		r->known[at] = 1;
	}
	return 0;
}

static int read_records(void *ctx, const struct grid_cell *cell)
{
	struct records *r = ctx;

	if (!has_some(r, cell))
		return 0;
	r->counts->cells_read++;
	return r->src->read(r->src->ctx, cell, take_records, r, r->err);
}

/* The vertices become the input, with their weights. */
static int input_again(struct window_area *a, const struct view *view, uint8_t *weight, uint32_t *ret_n, struct err *err)
{
	struct mesh_vertex *in = tri_input(a->tri);
	struct records r = {.view = view, .src = &a->src, .pts = a->pts, .known = weight, .counts = &a->counts, .err = err};
	const struct grid_visitor v = {.ctx = &r, .enter = has_some, .cell = read_records};
	struct tri_result t;
	int rc;

	tri_result(a->tri, &t);
	r.n = t.nvertex;
	/* The triangles are not needed any more. */
	for (uint32_t i = 0; i < r.n; i++)
		a->pts[i] = (struct point){.x = t.xy[i][0], .y = t.xy[i][1], .z = t.z[i]};
	point_sort(a->pts, a->pts + a->cap, r.n);
	memset(weight, 0, r.n);
	rc = a->src.walk(a->src.ctx, 0, UINT64_MAX, &v, err);
	for (uint32_t i = 0; i < r.n; i++) {
		in[i] = (struct mesh_vertex){a->pts[i].x, a->pts[i].y, a->pts[i].z};
		weight[i] = view_weight_of(view, &a->pts[i]);
	}
	*ret_n = r.n;
	return rc;
}

static bool piece_holds(void *ctx, const int32_t box[4])
{
	return window_piece_holds_box(&((const struct window_area *)ctx)->window, box);
}

static bool piece_meets(void *ctx, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	return window_piece_meets(&((const struct window_area *)ctx)->window, a, b, c);
}

static bool piece_sends(void *ctx, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	return window_piece_sends(&((const struct window_area *)ctx)->window, a, b, c);
}

static int too_far(uint32_t n, uint64_t need, struct err *err)
{
	err->need = need;
	err_set(err, ERR_LIMIT,
		"a part of %u positions depends on %llu, because of the radii of --weight; they do not fit its memory", n,
		(unsigned long long)need);
	return err_add_hint(err, "give --weight smaller radii, or the daemon more memory");
}

static bool finish(struct window_area *a, const struct regular *c, const int64_t k[3], struct mesh_domain *ret)
{
	struct finish f = {0};

	a->counts.cells_read += c->cells_read;
	a->counts.points_read += c->points_read;
	a->counts.points = a->counts.points_read;
	f.out.counts = a->counts;
	if (!c->flat) {
		finish_init(&f, a->region, k, a->tri);
		finish_chosen(&f, &(struct finish_choice){c->chosen, NULL});
		if (!finish_vertices(&f))
			return false;
		finish_numbers(&f);
	}
	*ret = f.out;
	return true;
}

int window_regular(const struct window_from *from, const int64_t k[3], struct mesh_domain *ret, uint64_t *ret_need,
		   struct err *err)
{
	struct view plain = *from->view;
	struct tri *tri = tri_init(from->memory, from->cap);
	uint8_t *at = (uint8_t *)from->memory + align_line(tri_bytes(from->cap)), *end = (uint8_t *)from->memory + from->room;
	struct regular c = {.src = from->src,
			    .view = from->view,
			    .most = from->weights.most,
			    .progress = from->weights.progress,
			    .progress_ctx = from->weights.ctx,
			    .region = from->region,
			    .tri = tri,
			    .cap = from->cap,
			    .flat = true};
	struct window_area *a;
	struct regular_area area;
	bool flat;
	int r;

	plain.nweight = 0;
	a = window_area_init(from->src, &plain, from->region, from->limits, tri, from->cap, end + (-(uintptr_t)end & 63));
	c.weight = align_carve(&at, align_line(from->cap));
	c.memory = at;
	c.size = (size_t)(end - at);
	r = window_area_run(a, &flat, ret_need, err);
	if (!r && !flat) {
		area = (struct regular_area){.ctx = a, .meets = piece_meets, .takes = piece_sends, .holds = piece_holds};
		memcpy(area.box, a->window.box, sizeof(area.box));
		c.area = &area;
		r = input_again(a, from->view, c.weight, &c.n, err);
		r = r ? r : regular_run(&c, ret_need, err);
		r = r == REGULAR_E_SPLIT ? WINDOW_E_SPLIT : r;
	}
	if (!r && !finish(a, &c, k, ret)) {
		*ret_need = (uint64_t)c.n * 2;
		r = WINDOW_E_SPLIT;
	}
	return r == WINDOW_E_SPLIT && c.n && c.n < from->cap / SMALL ? too_far(c.n, *ret_need, err) : r;
}
