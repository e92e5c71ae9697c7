/*
 * Domains of a view with weights, by engine/regular. A twelfth of the kernel's arena is for its tables, so the kernel is smaller;
 * what does not fit is split, as other regions are.
 */
#include "pipe.h"

#include "err.h"
#include "finish.h"
#include "pipe_priv.h"
#include "regular.h"

/* P(B) of a region that is halved no further is at most this part of what its arena holds; a region is expected to load so many
 * more positions, or as many as it has. */
enum { TABLES = 12, SMALL = 32, MORE = 16384 };

uint32_t pipe_weight_cap(const struct view *view, uint32_t cap)
{
	return view->nweight ? cap - cap / TABLES : cap;
}

uint64_t pipe_weight_need(const struct view *view, uint64_t need)
{
	return view->nweight ? need + need / (TABLES - 1) + 1 : need;
}

int pipe_weight_check(const struct grid *grid, const struct view *view, struct err *err)
{
	if (!view->nweight || !grid_lines(grid))
		return 0;
	err_set(err, ERR_UNSUPPORTED, "the dataset has breaklines, and a mesh with weights cannot have them as edges");
	return err_add_hint(err, "leave out --weight, or the lines with --no-breaklines");
}

/* The greatest weights of what there may be of the slots, as bits, in a segment; bit 0: of classes that it has. One that did not
 * count its classes may have all. */
static int64_t of_slots(const struct grid *grid, const struct view *view, size_t segment, uint32_t slots)
{
	const struct grid_segment_info *s = &grid_manifest(grid)->segments[segment];
	uint64_t counted = 0;
	int64_t most = 0;

	for (unsigned c = 0; c < 256 && (slots & 1); c++)
		counted += s->classes[c];
	for (unsigned k = 0; k < view->nweight; k++) {
		const struct view_weight *w = &view->weight[k];
		int64_t weight = (int64_t)w->radius * w->radius;
		bool there = w->slot ? slots >> w->slot & 1 : (slots & 1) && (s->classes[w->cls] || counted < s->points);

		if (there && weight > most)
			most = weight;
	}
	return most;
}

static int64_t of_segment(const struct grid *grid, const struct view *view, size_t segment)
{
	return of_slots(grid, view, segment, grid_segment_slots(grid, segment));
}

/* Weights of one segment after the other, of which `whole` and `classes` (bit 0 of its slots) are known for the last one. */
struct most_of {
	const struct grid *grid;
	const struct view *view;
	uint32_t segment;
	int64_t whole, classes;
};

/* A cell of one source has its slot alone. */
static int64_t most_of_cell(void *ctx, const struct grid_cell *cell)
{
	struct most_of *m = ctx;
	uint8_t slot;

	if (cell->segment != m->segment) {
		m->segment = cell->segment;
		m->whole = of_segment(m->grid, m->view, cell->segment);
		m->classes = of_slots(m->grid, m->view, cell->segment, 1);
	}
	if (!cell->source)
		return m->whole;
	slot = grid_source_slot(m->grid, cell->source);
	return slot ? of_slots(m->grid, m->view, cell->segment, UINT32_C(1) << slot) : m->classes;
}

static int64_t greatest(const struct grid *grid, const struct view *view)
{
	int64_t most = 0;

	for (size_t i = 0; i < grid_manifest(grid)->nsegments; i++) {
		int64_t one = of_segment(grid, view, i);

		most = one > most ? one : most;
	}
	return most;
}

int64_t pipe_weight_most(const struct grid *grid, const struct view *view)
{
	return greatest(grid, view);
}

static int verify(struct regular *w, const struct grid *grid, void *memory, uint64_t *ret_need, struct err *err)
{
	struct most_of most = {.grid = grid, .view = w->view, .segment = UINT32_MAX};
	struct grid_reader *reader;
	struct cut_source src;
	int r = grid_reader_new(grid, (uint8_t *)memory + PIPE_TRACE, grid_reader_bytes(grid), &reader, err);

	if (r)
		return r;
	cut_source_grid(reader, &src);
	w->src = &src;
	w->most_of = most_of_cell;
	w->most_ctx = &most;
	r = regular_run(w, ret_need, err);
	grid_reader_free(reader);
	return r == REGULAR_E_SPLIT ? PIPE_E_SPLIT : r;
}

static struct mesh_counts counts_of(const struct regular *w, const struct cut_load *load)
{
	struct mesh_counts counts = load->counts;

	counts.halo += w->added;
	counts.cells_read += w->cells_read;
	counts.points_read += w->points_read;
	return counts;
}

static int no_hidden(const struct regular *w, const struct cut_load *load, const struct grid *grid, void *memory,
		     struct mesh_domain *ret, struct err *err)
{
	*ret = (struct mesh_domain){.counts = load->counts};
	return pipe_hidden(grid, w, NULL, memory, ret, err);
}

/* The kernel's triangles become the domain. False: they do not fit. */
static bool finish(const struct regular *w, const struct cut_load *load, const int64_t k[3], struct mesh_domain *ret)
{
	struct finish f = {.out = {.counts = counts_of(w, load)}};
	struct mesh_counts *counts = &f.out.counts;

	if (w->flat) {
		finish_init(&f, w->region, k, w->tri);
		finish_flat(&f);
		*ret = f.out;
		return true;
	}
	counts->used -= w->hidden;
	counts->removed[VIEW_BY_WEIGHT] = w->hidden;
	finish_init(&f, w->region, k, w->tri);
	finish_chosen(&f, &(struct finish_choice){w->chosen, NULL});
	if (!finish_vertices(&f))
		return false;
	finish_numbers(&f);
	/* It places the rays of hull edges without weights. */
	f.out.nhull = w->nhull;
	*ret = f.out;
	return true;
}

/* Halves of such a region would load as much. */
static int too_far(uint32_t n, uint64_t need, struct err *err)
{
	err->need = need;
	err_set(err, ERR_LIMIT,
		"a region of %u positions depends on %llu more, because of the radii of --weight; they do not fit its memory", n,
		(unsigned long long)need);
	return err_add_hint(err, "give --weight smaller radii, or the daemon more memory");
}

/* One attempt, in which `more` positions beyond P(B) can be loaded. *w: the room, then P(B). */
static int attempt(const struct grid *grid, const struct view *view, const struct cut_region *region,
		   const struct pipe_known *known, const struct pipe_budget *less, uint32_t more, void *memory, struct regular *w,
		   struct mesh_domain *ret, uint64_t *ret_need, struct err *err)
{
	const int64_t *k = grid_manifest(grid)->lattice.k;
	struct cut_load load;
	uint64_t own = 0;
	int r = pipe_domain_load(grid, view, region, known, less, memory, w->weight, &load, &own, ret_need, err);

	w->n = load.n;
	w->own = load.own;
	w->flat = load.flat;
	if (r)
		return r;
	if (load.flat && view->hidden)
		return no_hidden(w, &load, grid, memory, ret, err);
	if (load.flat) {
		*ret = pipe_flat_domain(&load, view, k);
		return 0;
	}
	w->tri = pipe_domain_tri(grid, less, own, memory, &load, load.n > more ? load.n : more, &w->cap);
	r = verify(w, grid, memory, ret_need, err);
	if (!r && view->hidden) {
		*ret = (struct mesh_domain){.counts = counts_of(w, &load)};
		return pipe_hidden(grid, w, known ? known->origin : NULL, memory, ret, err);
	}
	if (!r && !finish(w, &load, k, ret)) {
		*ret_need = (uint64_t)w->n * 2;
		r = PIPE_E_SPLIT;
	}
	return r;
}

int pipe_weight(const struct grid *grid, const struct view *view, const struct cut_region *region, const struct pipe_known *known,
		const struct pipe_budget *budget, void *memory, struct mesh_domain *ret, uint64_t *ret_need, struct err *err)
{
	struct pipe_budget less = *budget;
	struct regular w = {.view = view,
			    .most = greatest(grid, view),
			    .region = region,
			    .progress = known ? known->progress : NULL,
			    .progress_ctx = known ? known->ctx : NULL};
	struct cut_trace *trace = &((struct pipe_trace *)memory)->trace;
	uint8_t *tables, *end;
	int r;

	less.cap = pipe_weight_cap(view, budget->cap);
	tables = (uint8_t *)pipe_domain_arena(grid, memory) + align_line(tri_bytes(less.cap));
	end = (uint8_t *)pipe_domain_arena(grid, memory) + tri_bytes(budget->cap);
	w.weight = align_carve(&tables, less.cap);
	w.memory = tables;
	w.size = (size_t)(end - tables);
	w.trace = trace;
	r = attempt(grid, view, region, known, &less, MORE, memory, &w, ret, ret_need, err);
	/* Before it is too far, all the memory is tried. */
	if (r == PIPE_E_SPLIT && w.n < less.cap / SMALL && w.tri)
		r = attempt(grid, view, region, known, &less, less.cap, memory, &w, ret, ret_need, err);
	/* The error names what the whole arena would need. */
	if (r == PIPE_E_SPLIT)
		*ret_need = pipe_weight_need(view, *ret_need);
	if (r == PIPE_E_SPLIT && w.n < less.cap / SMALL && w.tri)
		return too_far(w.n, *ret_need, err);
	/* It needs more than its positions say. */
	if (!r && trace->nrange)
		trace->lines.cap = budget->cap;
	if (r == PIPE_E_SPLIT && *ret_need <= budget->cap)
		*ret_need = (uint64_t)budget->cap + 1;
	return r;
}
