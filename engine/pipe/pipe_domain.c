/*
 * One region to one finished domain, in memory of the caller: load exactly the points that the region needs,
 * triangulate them, keep the triangles that it owns.
 *
 * The memory is [trace | block buffers of the reader | arena of the kernel]. While points are loaded, the rest of the
 * arena is scratch for the halo. Then the owned triangles are packed in place, and links, vertices and final bits
 * follow, still in the memory of the triangles (finish.c).
 *
 * A region that is far smaller than the budget touches only memory of its size: arrays are close to each other, and the
 * halo's scratch is small at first. The kernel clears every page that is touched, and a huge page costs as much as a
 * thousand points.
 */
#include "pipe.h"

#include <string.h>

#include "cut_valid.h"
#include "err.h"
#include "finish.h"
#include "pipe_priv.h"
#include "window.h"

/* With so many positions, a halo usually has fewer than a third of them. */
enum { HALO_MANY = 1 << 15 };

void *pipe_domain_arena(const struct grid *grid, void *memory)
{
	return (uint8_t *)memory + PIPE_TRACE + align_line(grid_reader_bytes(grid));
}

/* The capacity of the kernel's arena for n positions: large enough that a finished domain fits the memory of the
 * triangles (48 bytes) even if all of its vertices are open (24 bytes of triangles, 24 of links, 12 of vertex for each
 * position). */
static uint32_t kernel_cap(uint64_t n, uint32_t cap)
{
	n += n / 3 + 64;
	return n < cap ? (uint32_t)n : cap;
}

/* The capacity that the kernel will probably need, if the halo has a usual size. */
static uint32_t kernel_guess(uint64_t own, uint32_t cap)
{
	return kernel_cap(own + 1024, cap);
}

void pipe_domain_room(const struct grid *grid, const struct pipe_budget *budget, uint64_t own, bool whole, void *memory,
		      struct cut_load *ret)
{
	uint8_t *arena = pipe_domain_arena(grid, memory);
	struct mesh_vertex *input = tri_input(tri_init(arena, kernel_guess(own, budget->cap)));
	size_t before = align_line((size_t)((uint8_t *)input - arena) + (size_t)budget->cap * sizeof *input);
	size_t room = (tri_bytes(budget->cap) - before) & ~(size_t)(ALIGN_LINE - 1);
	size_t some = cut_load_scratch_bytes((own < budget->cap ? (uint32_t)own : budget->cap) + HALO_MANY);

	*ret = (struct cut_load){
		.out = input,
		.cap = budget->cap,
		.scratch = arena + before,
		.scratch_size = whole || room < some ? room : some,
	};
}

struct tri *pipe_domain_tri(const struct grid *grid, const struct pipe_budget *budget, uint64_t own, void *memory,
			    const struct cut_load *load, uint32_t more, uint32_t *ret_cap)
{
	uint32_t guess = kernel_guess(own, budget->cap), cap = kernel_cap((uint64_t)load->n + more, budget->cap);
	struct tri *tri;

	*ret_cap = cap > guess ? cap : guess;
	tri = tri_init(pipe_domain_arena(grid, memory), *ret_cap);

	if (tri_input(tri) != load->out)
		memmove(tri_input(tri), load->out, load->n * sizeof *load->out);
	return tri;
}

int pipe_domain_load(const struct grid *grid, const struct view *view, const struct cut_region *region,
		     const struct pipe_known *known, const struct pipe_budget *budget, void *memory, uint8_t *weight,
		     struct cut_load *load, uint64_t *ret_own, uint64_t *ret_need, struct err *err)
{
	struct pipe_trace *trace = memory;
	struct grid_reader *reader = NULL;
	int r = grid_reader_new(grid, (uint8_t *)memory + PIPE_TRACE, grid_reader_bytes(grid), &reader, err);

	if (r)
		return r;
	r = cut_count(reader, region, ret_own, err);
	for (unsigned whole = 0; !r && whole < 2; whole++) {
		pipe_domain_room(grid, budget, *ret_own, whole, memory, load);
		load->sites = known ? known->sites : NULL;
		load->flat = known && known->flat;
		load->before = known && known->before ? &known->before->trace : NULL;
		load->weight = weight;
		load->trace = &trace->trace;
		cut_trace_init(&trace->trace, trace + 1);
		r = cut_load(reader, view, region, load, ret_need, err);
		/* The reported need must not depend on the store. */
		if (r == CUT_E_FULL && load->before) {
			load->before = NULL;
			cut_trace_init(&trace->trace, trace + 1);
			r = cut_load(reader, view, region, load, ret_need, err);
		}
		if (r != CUT_E_FULL)
			break;
		r = whole ? PIPE_E_SPLIT : 0;
	}
	grid_reader_free(reader);
	return r;
}

/* The kernel of a region: its triangles, and the pieces of lines. A flat leaf has its points in *load instead. */
static int run_kernel(const struct grid *grid, const struct view *view, const struct cut_region *region,
		      const struct pipe_known *known, const struct pipe_budget *budget, void *memory, struct cut_load *load,
		      struct pipe_kernel *k, uint64_t *ret_need, struct err *err)
{
	struct finish_choice choice = {NULL, NULL};
	uint64_t own = 0;
	uint32_t cap;
	int r = pipe_domain_load(grid, view, region, known, budget, memory, NULL, load, &own, ret_need, err);

	*k = (struct pipe_kernel){0};
	if (r)
		return r;
	k->counts = load->counts;
	k->flat = load->flat;
	if (k->flat)
		return 0;
	k->tri = pipe_domain_tri(grid, budget, own, memory, load, 0, &cap);
	k->flat = tri_run(k->tri, load->n) == TRI_E_FLAT;
	if (k->flat || !grid_lines(grid))
		return 0;
	r = pipe_constrain(grid, view, region, budget, memory, &k->tri, cap, &k->counts, &choice, &k->pieces, ret_need, err);
	k->chosen = choice.chosen;
	k->special = choice.special;
	return r;
}

int pipe_kernel(const struct grid *grid, const struct view *view, const struct cut_region *region, const struct pipe_known *known,
		const struct pipe_budget *budget, void *memory, struct pipe_kernel *ret, uint64_t *ret_need, struct err *err)
{
	struct cut_load load;

	return run_kernel(grid, view, region, known, budget, memory, &load, ret, ret_need, err);
}

static struct window_weights window_weights(const struct grid *grid, const struct view *view, const struct pipe_known *known)
{
	return (struct window_weights){.most = view->nweight ? pipe_weight_most(grid, view) : 0,
				       .progress = known ? known->progress : NULL,
				       .ctx = known ? known->ctx : NULL};
}

int pipe_domain(const struct grid *grid, const struct view *view, const struct cut_region *region, const struct pipe_known *known,
		const struct pipe_budget *budget, void *memory, struct mesh_domain *ret, uint64_t *ret_need, struct err *err)
{
	const int64_t *k = grid_manifest(grid)->lattice.k;
	struct pipe_kernel kernel;
	struct finish f = {0};
	struct cut_load load;
	int r;

	if (view->window) {
		struct pipe_trace *trace = memory;

		/* Without a trace, because a piece is not stored for later generations. */
		cut_trace_init(&trace->trace, trace + 1);
		r = window_domain(grid, view, window_weights(grid, view, known), region, budget->cap,
				  (uint8_t *)memory + PIPE_TRACE, pipe_domain_arena(grid, memory), ret, ret_need, err);
		return r == WINDOW_E_SPLIT ? PIPE_E_SPLIT : r;
	}
	if (view->nweight)
		return pipe_weight(grid, view, region, known, budget, memory, ret, ret_need, err);
	r = run_kernel(grid, view, region, known, budget, memory, &load, &kernel, ret_need, err);
	if (r)
		return r;
	if (load.flat) {
		*ret = pipe_flat_domain(&load, view, k);
		return 0;
	}
	f.out.counts = kernel.counts;
	finish_map(&f, view);
	if (kernel.flat) {
		finish_init(&f, region, k, kernel.tri);
		finish_flat(&f);
		*ret = f.out;
		return 0;
	}
	finish_init(&f, region, k, kernel.tri);
	if (kernel.chosen)
		finish_chosen(&f, &(struct finish_choice){kernel.chosen, kernel.special});
	else
		finish_owned(&f);
	if (!finish_vertices(&f)) {
		/* Nearly all vertices are open: points in convex position. Smaller regions will fit. */
		*ret_need = (uint64_t)load.n * 2;
		return PIPE_E_SPLIT;
	}
	finish_numbers(&f);
	*ret = f.out;
	return 0;
}

size_t pipe_domain_held(const struct mesh_domain *domain, const void *memory)
{
	const uint8_t *end = domain->final;

	if (!domain->nvertex)
		return PIPE_TRACE;
	if (domain->nedges)
		return align_line((size_t)(domain->edges + domain->nedges - (const uint8_t *)memory));
	return (size_t)(end - (const uint8_t *)memory) + align_line(((size_t)domain->nvertex + 7) / 8);
}
