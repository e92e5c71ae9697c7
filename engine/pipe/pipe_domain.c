/*
 * One region to one finished domain, in memory that was handed in: load exactly the points that the region
 * needs, triangulate them, keep the triangles that it owns.
 *
 * The memory is [block buffers of the reader | arena of the kernel]. While points are loaded, what is left of
 * the arena is scratch for the halo; when the triangles are there, the owned ones are packed over them in
 * place, and links, vertices and final bits follow behind, still in the place of triangles. Vertices that every
 * kernel triangle around them is owned of are closed; all others (border and hull) are open and get link sums.
 */
#include "pipe.h"

#include <string.h>
#define XXH_STATIC_LINKING_ONLY /* the state on the stack */
#include <xxhash.h>

#include "err.h"
#include "pipe_priv.h"
#include "tri.h"

/* Bump it when the same points give other blocks: stored domains of the old kernel are then not found. */
static const char KERNEL[] = "kernel 2";

enum { USED = 1, OPEN = 2 };

struct domain {
	const struct cut_region *region;
	int64_t k[3];
	struct tri_result tri;
	uint32_t *mark;              /* a vertex: USED, OPEN; later its local number. In the place of tri.id */
	uint8_t *arena_end;
	struct mesh_domain out;
};

static const int32_t *xy_of(const struct domain *d, uint32_t v)
{
	return d->tri.xy[v];
}

/* The position's hash for link sums. */
static struct digest place_hash(const int32_t xy[2])
{
	uint64_t place = (uint64_t)(uint32_t)xy[0] << 32 | (uint32_t)xy[1];

	return digest_hash(&place, sizeof place);
}

/* Keep owned triangles (packed in place), mark their vertices; vertices of all others are open. */
static void select_owned(struct domain *d)
{
	const struct tri_triangle *t = d->tri.triangle;
	uint32_t (*out)[3] = (uint32_t (*)[3])d->tri.triangle;
	uint32_t i, k, n = 0;

	memset(d->mark, 0, (size_t)d->tri.nvertex * sizeof *d->mark);
	for (i = 0; i < d->tri.ntriangle; i++) {
		uint32_t c[3] = { t[i].corner[0], t[i].corner[1], t[i].corner[2] };
		bool ghost = c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST;

		if (!ghost && cut_region_owns(d->region, xy_of(d, c[0]), xy_of(d, c[1]), xy_of(d, c[2]))) {
			for (k = 0; k < 3; k++) {
				d->mark[c[k]] |= USED;
				out[n][k] = c[k];
			}
			n++;
		} else {
			for (k = 0; k < 3; k++)
				if (c[k] != TRI_GHOST)
					d->mark[c[k]] |= OPEN;
		}
	}
	d->out.triangle = out;
	d->out.ntriangle = n;
}

/* Local numbers: open vertices first. False: the result does not fit behind the triangles. */
static bool number_vertices(struct domain *d)
{
	uint32_t v, nopen = 0, nvertex = 0, open_at = 0, closed_at;
	uint8_t *at = (uint8_t *)d->out.triangle + pipe_round((size_t)d->out.ntriangle * sizeof(uint32_t[3]));
	/* Triangles, links and vertices are written while xy, z and marks are still read: they must end before. */
	const uint8_t *end = (const uint8_t *)d->tri.xy;

	if ((const uint8_t *)d->tri.z > (const uint8_t *)d->tri.triangle && (const uint8_t *)d->tri.z < end)
		end = (const uint8_t *)d->tri.z;
	if ((const uint8_t *)d->mark > (const uint8_t *)d->tri.triangle && (const uint8_t *)d->mark < end)
		end = (const uint8_t *)d->mark;
	for (v = 0; v < d->tri.nvertex; v++) {
		nvertex += d->mark[v] & USED;
		nopen += d->mark[v] == (USED | OPEN);
	}
	d->out.nvertex = nvertex;
	d->out.nopen = nopen;
	d->out.link = (struct mesh_link *)at;
	at += (size_t)nopen * sizeof(struct mesh_link);
	d->out.vertex = (struct mesh_vertex *)at;
	at += pipe_round((size_t)nvertex * sizeof(struct mesh_vertex));
	d->out.final = at;
	at += pipe_round(((size_t)nvertex + 7) / 8);
	if (at > end)
		return false;
	memset(d->out.link, 0, (size_t)nopen * sizeof(struct mesh_link));
	closed_at = nopen;
	for (v = 0; v < d->tri.nvertex; v++) {
		uint8_t m = (uint8_t)d->mark[v];
		uint32_t to;

		if (!(m & USED))
			continue;
		to = m & OPEN ? open_at++ : closed_at++;
		d->out.vertex[to] = (struct mesh_vertex){ d->tri.xy[v][0], d->tri.xy[v][1], d->tri.z[v] };
		d->mark[v] = to;
	}
	return true;
}

static void link_add(struct mesh_link *link, struct digest a, struct digest b)
{
	link->hi += a.hi - b.hi;
	link->lo += a.lo - b.lo;
	link->edges++;
}

/* Local numbers into the triangles, digest over them, link sums of the open vertices. */
static void finish_triangles(struct domain *d)
{
	const struct mesh_vertex *vertex = d->out.vertex;
	uint32_t i, k, nopen = d->out.nopen;

	for (i = 0; i < d->out.ntriangle; i++) {
		uint32_t *t = d->out.triangle[i];
		int64_t corner[3][2];
		bool open = false;

		for (k = 0; k < 3; k++) {
			t[k] = d->mark[t[k]];
			corner[k][0] = vertex[t[k]].x + d->k[0];
			corner[k][1] = vertex[t[k]].y + d->k[1];
			open |= t[k] < nopen;
		}
		digest_add_triangle(&d->out.digest, (const int64_t (*)[2])corner);
		if (!open)
			continue;
		struct digest h[3];

		for (k = 0; k < 3; k++)
			h[k] = place_hash((const int32_t[2]){ vertex[t[k]].x, vertex[t[k]].y });
		for (k = 0; k < 3; k++)
			if (t[k] < nopen)
				link_add(&d->out.link[t[k]], h[(k + 1) % 3], h[(k + 2) % 3]);
	}
}

static void finish_vertices(struct domain *d)
{
	const struct mesh_vertex *v = d->out.vertex;
	int32_t *box = d->out.box;
	uint32_t i, k;

	for (i = 0; i < d->out.nvertex; i++) {
		int32_t at[3] = { v[i].x, v[i].y, v[i].z };

		for (k = 0; k < 3; k++) {
			if (!i || at[k] < box[k])
				box[k] = at[k];
			if (!i || at[k] > box[3 + k])
				box[3 + k] = at[k];
		}
		if (i >= d->out.nopen)
			digest_add_vertex(&d->out.closed_digest, v[i].x + d->k[0], v[i].y + d->k[1], v[i].z + d->k[2]);
	}
}

/* What of the arena is not the kernel's input: scratch while loading. */
static void spare_of(struct tri *tri, uint8_t *arena, size_t size, uint32_t cap, struct cut_load *load)
{
	uint8_t *input = (uint8_t *)tri_input(tri);
	uint8_t *behind = arena + pipe_round((size_t)(input - arena) + (size_t)cap * sizeof(struct mesh_vertex));
	size_t front_size = (size_t)(input - arena) & ~(size_t)(PIPE_ALIGN - 1);
	size_t behind_size = (size_t)(arena + size - behind);
	/* The head of the arena is the kernel's own. */
	size_t head = 4096;

	if (behind_size >= front_size) {
		load->scratch = behind;
		load->scratch_size = behind_size;
	} else {
		load->scratch = arena + head;
		load->scratch_size = front_size - head;
	}
}

static int load_points(const struct grid *grid, const struct view *view, const struct cut_region *region,
		       uint32_t cap, uint8_t *memory, size_t reader_size, uint8_t *arena, struct tri *tri,
		       struct cut_load *load, uint64_t *ret_need, struct err *err)
{
	struct grid_reader *reader = NULL;
	int r;

	r = grid_reader_new(grid, memory, reader_size, &reader, err);
	if (r)
		return r;
	load->out = tri_input(tri);
	load->cap = cap;
	spare_of(tri, arena, tri_bytes(cap), cap, load);
	r = cut_load(reader, view, region, load, ret_need, err);
	grid_reader_free(reader);
	return r == CUT_E_FULL ? PIPE_E_SPLIT : r;
}

int pipe_domain(const struct grid *grid, const struct view *view, const struct cut_region *region,
		const struct pipe_budget *budget, void *memory, struct mesh_domain *ret, uint64_t *ret_need,
		struct err *err)
{
	size_t reader_size = grid_reader_bytes(grid);
	uint8_t *arena = (uint8_t *)memory + pipe_round(reader_size);
	struct domain d = { .region = region };
	struct cut_load load = { 0 };
	struct tri *tri;
	int r;

	memcpy(d.k, grid_manifest(grid)->lattice.k, sizeof d.k);
	tri = tri_init(arena, budget->cap);
	r = load_points(grid, view, region, budget->cap, memory, reader_size, arena, tri, &load, ret_need, err);
	if (r)
		return r;
	d.out.counts = load.counts;
	r = tri_run(tri, load.n);
	if (r == TRI_E_FLAT) {
		*ret = d.out;
		return 0;
	}
	tri_result(tri, &d.tri);
	d.mark = (uint32_t *)d.tri.id;
	select_owned(&d);
	if (!number_vertices(&d)) {
		/* Nearly all vertices are open: points in convex position. Smaller regions have room. */
		*ret_need = (uint64_t)load.n * 2;
		return PIPE_E_SPLIT;
	}
	finish_triangles(&d);
	finish_vertices(&d);
	*ret = d.out;
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
		uint64_t live = s->added <= generation && (!s->removed || s->removed > generation);
		uint64_t row[3] = { s->id, live, s->points };

		/* The segments' sums hold dead records too: which of them live is told by their sources. */
		XXH3_128bits_update(&state, row, sizeof row);
		XXH3_128bits_update(&state, s->name, strlen(s->name) + 1);
		XXH3_128bits_update(&state, &s->hash, sizeof s->hash);
	}
	content = XXH3_128bits_digest(&state);
	return (struct digest){ content.high64, content.low64 };
}

struct digest pipe_domain_key(const struct grid *grid, const struct view *view, const struct cut_region *region)
{
	char region_text[CUT_REGION_TEXT_SIZE], lattice[LATTICE_TEXT_SIZE];
	struct digest parts[4];
	XXH128_hash_t key;
	XXH3_state_t state;

	lattice_text(&grid_manifest(grid)->lattice, lattice);
	cut_region_text(region, region_text);
	parts[0] = pipe_content(grid);
	parts[1] = digest_hash(lattice, strlen(lattice));
	parts[2] = view_hash(view);
	parts[3] = digest_hash(region_text, strlen(region_text));
	XXH3_128bits_reset(&state);
	XXH3_128bits_update(&state, KERNEL, sizeof KERNEL);
	XXH3_128bits_update(&state, parts, sizeof parts);
	key = XXH3_128bits_digest(&state);
	return (struct digest){ key.high64, key.low64 };
}
