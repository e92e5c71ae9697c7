/*
 * One region to one finished domain, in memory that was handed in: load exactly the points that the region
 * needs, triangulate them, keep the triangles that it owns.
 *
 * The memory is [trace | block buffers of the reader | arena of the kernel]. While points are loaded, what is left of
 * the arena is scratch for the halo; when the triangles are there, the owned ones are packed over them in
 * place, and links, vertices and final bits follow behind, still in the place of triangles (pipe_finish.c).
 */
#include "pipe.h"

#include <stdlib.h>
#include <string.h>

#include "cut_valid.h"
#include "err.h"
#include "pipe_finish.h"
#include "pipe_priv.h"

void *pipe_domain_arena(const struct grid *grid, void *memory)
{
	return (uint8_t *)memory + PIPE_TRACE + pipe_round(grid_reader_bytes(grid));
}

/* What of the arena is not the kernel's input is scratch while loading. */
void pipe_domain_room(const struct grid *grid, const struct pipe_budget *budget, void *memory, struct tri *tri,
		      struct cut_load *ret)
{
	uint8_t *arena = pipe_domain_arena(grid, memory), *input = (uint8_t *)tri_input(tri);
	size_t input_size = (size_t)budget->cap * sizeof(struct mesh_vertex);
	uint8_t *behind = arena + pipe_round((size_t)(input - arena) + input_size);
	size_t front_size = (size_t)(input - arena) & ~(size_t)(PIPE_ALIGN - 1);
	size_t behind_size = (size_t)(arena + tri_bytes(budget->cap) - behind);
	/* The head of the arena is the kernel's own. */
	size_t head = 4096;

	*ret = (struct cut_load){ .out = tri_input(tri), .cap = budget->cap };
	if (behind_size >= front_size) {
		ret->scratch = behind;
		ret->scratch_size = behind_size;
	} else {
		ret->scratch = arena + head;
		ret->scratch_size = front_size - head;
	}
}

static int load_points(const struct grid *grid, const struct view *view, const struct cut_region *region,
		       void *memory, struct cut_load *load, uint64_t *ret_need, struct err *err)
{
	struct grid_reader *reader = NULL;
	int r = grid_reader_new(grid, (uint8_t *)memory + PIPE_TRACE, grid_reader_bytes(grid), &reader, err);

	if (r)
		return r;
	r = cut_load(reader, view, region, load, ret_need, err);
	grid_reader_free(reader);
	return r == CUT_E_FULL ? PIPE_E_SPLIT : r;
}

static int along_line(const void *a, const void *b)
{
	const int32_t *p = a, *q = b;

	return p[0] != q[0] ? (p[0] > q[0]) - (p[0] < q[0]) : (p[1] > q[1]) - (p[1] < q[1]);
}

/*
 * Of a region that loaded fewer than three positions, or collinear ones. Its own are in the mesh all the same, with triangles
 * of others; and where it sees a side of the hull from afar, and nothing else, it owns the edges of that.
 */
static void finish_flat(const struct tri *tri, const struct cut_region *region, const int64_t k[3], struct mesh_domain *d)
{
	int32_t (*xy)[2];
	struct tri_result t;

	tri_result(tri, &t);
	for (uint32_t i = 0; i < t.nvertex; i++)
		if (cut_region_holds(region, t.xy[i][0], t.xy[i][1]))
			digest_add_vertex(&d->own_digest, t.xy[i][0] + k[0], t.xy[i][1] + k[1], t.z[i] + k[2]);
	if (!region->inf)
		return;
	xy = (int32_t (*)[2])(uintptr_t)t.xy; /* in the arena, and of no more use there */
	qsort(xy, t.nvertex, sizeof *xy, along_line);
	for (uint32_t i = 1; i < t.nvertex; i++)
		d->nhull += (uint32_t)cut_region_owns_hull(region, xy[i - 1], xy[i]) + cut_region_owns_hull(region, xy[i], xy[i - 1]);
}

int pipe_domain(const struct grid *grid, const struct view *view, const struct cut_region *region,
		const struct cut_sites *sites, const struct pipe_budget *budget, void *memory, struct mesh_domain *ret, uint64_t *ret_need,
		struct err *err)
{
	struct tri *tri = tri_init(pipe_domain_arena(grid, memory), budget->cap);
	struct pipe_trace *trace = memory;
	struct pipe_finish f = { 0 };
	struct cut_load load;
	int r;

	if (view->window) {
		r = pipe_area(grid, view, region, budget, memory, ret, ret_need, err);
		/* Of what it read there is no trace: it is known again in its own generation. */
		cut_trace_init(&trace->trace, trace + 1);
		return r;
	}
	pipe_domain_room(grid, budget, memory, tri, &load);
	load.sites = sites;
	load.trace = &trace->trace;
	cut_trace_init(load.trace, trace + 1);
	r = load_points(grid, view, region, memory, &load, ret_need, err);
	if (r)
		return r;
	f.out.counts = load.counts;
	if (tri_run(tri, load.n) == TRI_E_FLAT) {
		finish_flat(tri, region, grid_manifest(grid)->lattice.k, &f.out);
		*ret = f.out;
		return 0;
	}
	pipe_finish_init(&f, region, grid_manifest(grid)->lattice.k, tri);
	pipe_finish_owned(&f);
	if (!pipe_finish_vertices(&f)) {
		/* Nearly all vertices are open: points in convex position. Smaller regions have room. */
		*ret_need = (uint64_t)load.n * 2;
		return PIPE_E_SPLIT;
	}
	pipe_finish_numbers(&f);
	*ret = f.out;
	return 0;
}

size_t pipe_domain_held(const struct mesh_domain *domain, const void *memory)
{
	const uint8_t *end = domain->final;

	if (!domain->ntriangle)
		return PIPE_TRACE;
	return (size_t)(end - (const uint8_t *)memory) + pipe_round(((size_t)domain->nvertex + 7) / 8);
}
