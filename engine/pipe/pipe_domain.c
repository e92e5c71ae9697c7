/*
 * One region to one finished domain, in memory that was handed in: load exactly the points that the region
 * needs, triangulate them, keep the triangles that it owns.
 *
 * The memory is [block buffers of the reader | arena of the kernel]. While points are loaded, what is left of
 * the arena is scratch for the halo; when the triangles are there, the owned ones are packed over them in
 * place, and links, vertices and final bits follow behind, still in the place of triangles (pipe_finish.c).
 */
#include "pipe.h"

#include <string.h>
#define XXH_STATIC_LINKING_ONLY /* the state on the stack */
#include <xxhash.h>

#include "err.h"
#include "pipe_finish.h"
#include "pipe_priv.h"

/* Bump it when the same points give other blocks: stored domains of the old kernel are then not found. */
static const char KERNEL[] = "kernel 3";

void *pipe_domain_arena(const struct grid *grid, void *memory)
{
	return (uint8_t *)memory + pipe_round(grid_reader_bytes(grid));
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
	int r = grid_reader_new(grid, memory, grid_reader_bytes(grid), &reader, err);

	if (r)
		return r;
	r = cut_load(reader, view, region, load, ret_need, err);
	grid_reader_free(reader);
	return r == CUT_E_FULL ? PIPE_E_SPLIT : r;
}

int pipe_domain(const struct grid *grid, const struct view *view, const struct cut_region *region,
		const struct cut_sites *sites, const struct pipe_budget *budget, void *memory, struct mesh_domain *ret, uint64_t *ret_need,
		struct err *err)
{
	struct tri *tri = tri_init(pipe_domain_arena(grid, memory), budget->cap);
	struct pipe_finish f = { 0 };
	struct cut_load load;
	int r;

	if (view->window)
		return pipe_area(grid, view, region, budget, memory, ret, ret_need, err);
	pipe_domain_room(grid, budget, memory, tri, &load);
	load.sites = sites;
	r = load_points(grid, view, region, memory, &load, ret_need, err);
	if (r)
		return r;
	f.out.counts = load.counts;
	if (tri_run(tri, load.n) == TRI_E_FLAT) {
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
		return 0;
	return (size_t)(end - (const uint8_t *)memory) + pipe_round(((size_t)domain->nvertex + 7) / 8);
}

struct digest pipe_content(const struct grid *grid)
{
	const struct grid_manifest *m = grid_manifest(grid);
	uint64_t generation = grid_generation(grid);
	XXH128_hash_t content;
	XXH3_state_t state;
	size_t i;

	XXH3_128bits_reset(&state);
	for (i = 0; i < m->nsegments; i++) {
		XXH3_128bits_update(&state, &m->segments[i].sum, sizeof m->segments[i].sum);
		XXH3_128bits_update(&state, &m->segments[i].points, sizeof m->segments[i].points);
	}
	for (i = 0; i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];
		uint64_t live = grid_source_live(s, generation);
		uint64_t row[3] = { s->id, live, s->points };

		/* The segments' sums hold dead records too: which of them live is told by their sources. */
		XXH3_128bits_update(&state, row, sizeof row);
		XXH3_128bits_update(&state, s->name, strlen(s->name) + 1);
		XXH3_128bits_update(&state, &s->hash, sizeof s->hash);
	}
	content = XXH3_128bits_digest(&state);
	return (struct digest){ content.high64, content.low64 };
}

void pipe_key_init(struct pipe_key *key, const struct grid *grid, const struct view *view)
{
	char lattice[LATTICE_TEXT_SIZE];

	lattice_text(&grid_manifest(grid)->lattice, lattice);
	key->part[0] = pipe_content(grid);
	key->part[1] = digest_hash(lattice, strlen(lattice));
	key->part[2] = view_hash(view);
}

struct digest pipe_key_of(const struct pipe_key *whole, const struct cut_region *region)
{
	char region_text[CUT_REGION_TEXT_SIZE];
	struct digest parts[4];
	XXH128_hash_t key;
	XXH3_state_t state;

	memcpy(parts, whole->part, sizeof whole->part);
	cut_region_text(region, region_text);
	parts[3] = digest_hash(region_text, strlen(region_text));
	XXH3_128bits_reset(&state);
	XXH3_128bits_update(&state, KERNEL, sizeof KERNEL);
	XXH3_128bits_update(&state, parts, sizeof parts);
	key = XXH3_128bits_digest(&state);
	return (struct digest){ key.high64, key.low64 };
}

struct digest pipe_domain_key(const struct grid *grid, const struct view *view, const struct cut_region *region)
{
	struct pipe_key key;

	pipe_key_init(&key, grid, view);
	return pipe_key_of(&key, region);
}
