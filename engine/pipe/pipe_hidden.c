/*
 * Domains of a view with `hidden`: in place of triangles the positions of the region that are hidden, as vertices, each with the
 * class of its record and its source.
 *
 * The record is the one that the view prefers (view_prefers); of equal ones that of the source with the least number. They are
 * looked up after the kernel has run, in the cells of the region, and kept where the triangles were, which are not needed.
 *
 * A selection has the record, but not its source. That is looked up in what the selection was made from: the equal record that
 * the rules for points keep. Of equal ones a rule that takes some (every, thin) can have taken any, so the least number is as
 * good.
 */
#include "pipe.h"

#include <string.h>

#include "cut_judge.h"
#include "cut_order.h"
#include "err.h"
#include "grid_segment.h"
#include "pipe_priv.h"
#include "regular.h"

struct hidden {
	const struct view *view;
	const struct cut_region *region;
	struct cut_judge judge;
	struct grid_reader *reader;
	struct err *err;
	struct point *best; /* n of them, in Morton order */
	struct mesh_origin *origin;
	uint32_t n;
	const uint32_t *id; /* of the records that are read */
	const struct pipe_origin *from;
};

static bool before(const void *ctx, const struct point *a, const struct point *b)
{
	(void)ctx;
	return cut_order_before(a->x, a->y, b->x, b->y);
}

static uint32_t find(const struct hidden *h, const struct point *p)
{
	uint32_t lo = 0, hi = h->n;

	while (lo < hi) {
		uint32_t mid = lo + (hi - lo) / 2;

		if (before(NULL, &h->best[mid], p))
			lo = mid + 1;
		else
			hi = mid;
	}
	return lo < h->n && h->best[lo].x == p->x && h->best[lo].y == p->y ? lo : h->n;
}

static int look_up(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct hidden *h = ctx;

	(void)err;
	for (size_t i = 0; i < n; i++) {
		const struct point *p = &pts[i];
		uint32_t at = find(h, p);
		bool any, better;

		if (at == h->n || cut_judge(&h->judge, p) != VIEW_KEPT)
			continue;
		any = h->origin[at].source != 0;
		better = !any || view_prefers(h->view, p, &h->best[at]);
		if (better || (!view_prefers(h->view, &h->best[at], p) && h->id[i] < h->origin[at].source)) {
			h->best[at] = *p;
			h->origin[at] = (struct mesh_origin){.source = h->id[i], .cls = p->cls};
		}
	}
	return 0;
}

/* The records that were found have no source yet. */
static int look_up_source(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct hidden *h = ctx;

	(void)err;
	for (size_t i = 0; i < n; i++) {
		uint32_t at = find(h, &pts[i]);
		uint32_t *source = at < h->n ? &h->origin[at].source : NULL;

		if (!source || memcmp(&pts[i], &h->best[at], sizeof pts[i]) || (*source && *source <= h->id[i]))
			continue;
		if (view_judge(h->from->view, &pts[i]) == VIEW_KEPT)
			*source = h->id[i];
	}
	return 0;
}

static int read_cell(void *ctx, const struct grid_cell *cell)
{
	struct hidden *h = ctx;

	return cell->count ? grid_cell_read(h->reader, cell, h->from ? look_up_source : look_up, h, h->err) : 0;
}

static int read_region(struct hidden *h, const struct grid *grid, void *memory, struct err *err)
{
	const struct grid_visitor visitor = {.ctx = h, .cell = read_cell};
	uint32_t id[GRID_CELL_RECORDS];
	struct cut_range range[4];
	unsigned n = cut_region_ranges(h->region, range);
	int r = grid_reader_new(grid, memory, grid_reader_bytes(grid), &h->reader, err);

	if (r)
		return r;
	h->id = id;
	h->err = err;
	grid_reader_ids(h->reader, id);
	for (unsigned i = 0; !r && i < n; i++)
		r = grid_walk(h->reader, range[i].lo, range[i].hi, &visitor, err);
	grid_reader_free(h->reader);
	return r;
}

/* `memory`: of the reader of the domain; `rest`: what else is free, up to `end`. */
static int find_origins(struct hidden *h, const struct grid *grid, const struct pipe_origin *from, void *memory, uint8_t *rest,
			const uint8_t *end, struct err *err)
{
	int r;

	cut_judge_init(&h->judge, h->view);
	r = read_region(h, grid, (uint8_t *)memory + PIPE_TRACE, err);
	for (uint32_t i = 0; h->view->selected && i < h->n; i++)
		h->origin[i].source = 0;
	if (r || !h->view->selected || !from)
		return r;
	rest += -(uintptr_t)rest & (ALIGN_LINE - 1);
	if (rest > end || (size_t)(end - rest) < grid_reader_bytes(from->grid))
		return err_set(err, ERR_LIMIT, "the files of %u hidden positions cannot be looked up in the memory of a region",
			       h->n);
	h->from = from;
	return read_region(h, from->grid, rest, err);
}

/* Hidden positions of the region, before their records are known. */
static void collect(struct hidden *h, const struct regular *w, const struct tri_result *t)
{
	for (uint32_t v = 0; v < t->nvertex; v++)
		if (!(w->visible[v / 64] >> v % 64 & 1) && cut_region_holds(h->region, t->xy[v][0], t->xy[v][1]))
			h->best[h->n++] = (struct point){.x = t->xy[v][0], .y = t->xy[v][1], .z = t->z[v]};
	cut_order_sort(h->best, h->n, before, NULL);
}

static void make_domain(const struct hidden *h, const int64_t k[3], struct mesh_vertex *vertex, uint8_t *end,
			struct mesh_domain *d)
{
	*d = (struct mesh_domain){
		.vertex = vertex,
		.origin = h->origin,
		.nvertex = h->n,
		.link = (struct mesh_link *)(void *)end, /* no links, and no triangle */
		.triangle = (uint32_t(*)[3])(void *)end,
		.final = end,
		.box = {INT32_MAX, INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN, INT32_MIN},
		.counts = d->counts,
	};
	for (uint32_t i = 0; i < h->n; i++) {
		const int32_t at[3] = {h->best[i].x, h->best[i].y, h->best[i].z};

		vertex[i] = (struct mesh_vertex){at[0], at[1], at[2]};
		for (unsigned a = 0; a < 3; a++) {
			d->box[a] = at[a] < d->box[a] ? at[a] : d->box[a];
			d->box[3 + a] = at[a] > d->box[3 + a] ? at[a] : d->box[3 + a];
		}
		digest_add_vertex(&d->closed_digest, at[0] + k[0], at[1] + k[1], at[2] + k[2]);
	}
	d->own_digest = d->closed_digest;
}

int pipe_hidden(const struct grid *grid, const struct regular *w, const struct pipe_origin *from, void *memory,
		struct mesh_domain *d, struct err *err)
{
	struct hidden h = {.view = w->view, .region = w->region};
	struct mesh_vertex *vertex;
	struct tri_result t;
	uint8_t *at, *end;
	int r;

	d->counts.used = w->flat ? 0 : w->hidden;
	d->counts.removed[VIEW_BY_WEIGHT] = w->own - d->counts.used;
	if (!d->counts.used)
		return 0;
	tri_result(w->tri, &t);
	/* Two triangles a position are 48 bytes; these are less than 37. */
	at = (uint8_t *)t.triangle;
	at += -(uintptr_t)at & (ALIGN_LINE - 1);
	vertex = align_carve(&at, align_line(w->hidden * sizeof *vertex));
	h.origin = align_carve(&at, align_line(w->hidden * sizeof *h.origin));
	end = align_carve(&at, align_line((w->hidden + 7) / 8));
	h.best = align_carve(&at, w->hidden * sizeof *h.best);
	if (at > (uint8_t *)(t.triangle + 2 * (size_t)w->cap))
		return err_set(err, ERR_INTERNAL, "%u hidden positions do not fit the memory of %u", w->hidden, w->cap);
	collect(&h, w, &t);
	if (h.n != w->hidden)
		return err_set(err, ERR_INTERNAL, "%u hidden positions are there, %u were counted", h.n, w->hidden);
	memset(h.origin, 0, h.n * sizeof *h.origin);
	/* The tables of the kernel are behind its arena. */
	r = find_origins(&h, grid, from, memory, at, (const uint8_t *)w->memory + w->size, err);
	if (!r)
		make_domain(&h, grid_manifest(grid)->lattice.k, vertex, end, d);
	return r;
}
