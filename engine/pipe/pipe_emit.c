/*
 * The emitter: finished domains, in plan order, to numbered blocks.
 *
 * A closed vertex is in one domain only, so it is numbered and final at once. An open vertex is looked up by position
 * in the table of open vertices. If it is found, it is foreign to this block; its link sum grows by this domain's part,
 * and is zero exactly when the triangles around it have closed (algorithm.md 8: for a triangle (p, a, b) add H(a) -
 * H(b)); then no later block uses it. Vertices are numbered by first use. Nothing is copied: the open vertices are
 * ordered in place (foreign first), foreign numbers replace the link sums, and triangles with open vertices are
 * renumbered.
 *
 * If nobody reads the mesh, no numbers are needed, and each domain is five numbers that are added up: every position of
 * a region is a vertex of the mesh, counted by that region; every edge of the hull is counted by the region in which
 * its outer ray ends. Euler's formula on these independent totals shows whether the mesh is complete.
 */
#include "pipe.h"

#include <stdlib.h>
#include <string.h>

#include "decimal.h"
#include "err.h"
#include "parse.h"
#include "pipe_table.h"

struct pipe_emitter {
	struct lattice lattice;
	struct view_map map; /* is.k 0: positions are not mapped */
	struct pipe_table *table;
	struct pipe_totals totals;
	uint64_t domains, blocks, hull; /* edges of the hull, counted by the domains */
	bool any_box, part, sums;
};

int pipe_emitter_new(const struct lattice *lattice, size_t memory, int tempdirfd, struct pipe_emitter **ret, struct err *err)
{
	struct pipe_emitter *e = calloc(1, sizeof *e);
	int r;

	if (!e)
		return err_set(err, ERR_NOMEM, "no memory for an emitter");
	e->lattice = *lattice;
	r = pipe_table_new(memory, tempdirfd, &e->table, err);
	if (r) {
		free(e);
		return r;
	}
	*ret = e;
	return 0;
}

struct pipe_emitter *pipe_emitter_free(struct pipe_emitter *e)
{
	if (e) {
		pipe_table_free(e->table);
		free(e);
	}
	return NULL;
}

uint64_t pipe_emitter_spilled(const struct pipe_emitter *e)
{
	return pipe_table_spilled_pages(e->table) * PIPE_TABLE_PAGE;
}

void pipe_emitter_map(struct pipe_emitter *e, const struct view *view)
{
	e->map = view->map;
}

void pipe_region_box(const struct view_map *map, int64_t box[4])
{
	for (unsigned i = 0; i < 4 && map->is.k; i++)
		if (box[i] != INT64_MIN && box[i] != INT64_MAX)
			box[i] += 2 * map->from[i & 1];
}

/* The region as a block has it. */
static void block_box(const struct pipe_emitter *e, const struct cut_region *region, int64_t box[4])
{
	cut_region_box(region, box);
	pipe_region_box(&e->map, box);
}

static void counts_add(struct mesh_counts *sum, const struct mesh_counts *c)
{
	size_t i;

	sum->points += c->points;
	sum->used += c->used;
	mesh_most_add(&sum->most, c->most.points, c->most.x, c->most.y);
	sum->halo += c->halo;
	sum->cells_read += c->cells_read;
	sum->points_read += c->points_read;
	for (i = 0; i < MESH_RULES; i++)
		sum->removed[i] += c->removed[i];
}

static void box_add(struct pipe_emitter *e, const struct mesh_domain *d)
{
	size_t i;

	for (i = 0; i < 3; i++) {
		if (!e->any_box || d->box[i] < e->totals.box[i])
			e->totals.box[i] = d->box[i];
		if (!e->any_box || d->box[3 + i] > e->totals.box[3 + i])
			e->totals.box[3 + i] = d->box[3 + i];
	}
	e->any_box = true;
}

static void set_bit(uint8_t *bits, uint32_t i)
{
	bits[i / 8] |= (uint8_t)(1u << (i % 8));
}

/* Result of looking up an open vertex, in the memory of its link sum: `where` is the new local number, `number` the
 * number in the stream. */
struct found {
	uint64_t number;
	uint32_t where;
	uint32_t closed;
	uint64_t foreign;
};
_Static_assert(sizeof(struct found) == sizeof(struct mesh_link), "found replaces link in place");

static void vertex_count(struct pipe_emitter *e, const struct mesh_vertex *v)
{
	digest_add_vertex(&e->totals.vertex_digest, v->x + e->lattice.k[0], v->y + e->lattice.k[1], v->z + e->lattice.k[2]);
}

static uint64_t place_of(const struct mesh_vertex *v)
{
	return (uint64_t)(uint32_t)v->x << 32 | (uint32_t)v->y;
}

/* Looks up open vertex i, which gets `number` if it is new. Its place in the block is not known yet. */
static int look_up_one(struct pipe_emitter *e, struct mesh_domain *d, uint32_t i, uint64_t number, struct err *err)
{
	const struct mesh_vertex *v = &d->vertex[i];
	struct mesh_link link = d->link[i];
	struct pipe_vertex add = {.place = place_of(v), .number = number, .hi = link.hi, .lo = link.lo, .edges = link.edges},
			   got = add;
	/* Without a sum it closed inside this domain, although another triangle of the kernel touched it. */
	bool inside = !link.hi && !link.lo;
	int r = inside ? PIPE_TABLE_NEW : pipe_table_add(e->table, &add, &got, err);

	if (r < 0)
		return r;
	if (r == PIPE_TABLE_CLOSED && got.edges < 3)
		return err_set(err, ERR_INTERNAL, "the vertex at (%d, %d) closed with %u triangles", v->x, v->y, got.edges);
	((struct found *)d->link)[i] = (struct found){
		.number = got.number - 1,
		.closed = r == PIPE_TABLE_CLOSED || inside,
		.foreign = r != PIPE_TABLE_NEW,
	};
	return 0;
}

/* Counts a vertex that was looked up. */
static void place_one(struct pipe_emitter *e, struct mesh_domain *d, uint32_t i, uint32_t *nforeign, uint32_t *nnew)
{
	struct found *f = &((struct found *)d->link)[i];

	f->where = f->foreign ? (*nforeign)++ : (*nnew)++;
	if (!f->foreign)
		vertex_count(e, &d->vertex[i]);
}

/* In the order of the table. New vertices have their numbers when all are looked up, so these are written in a second pass. */
static int look_up_by_parts(struct pipe_emitter *e, struct mesh_domain *d, uint32_t *ret_foreign, struct err *err)
{
	const struct found *found = (const struct found *)d->link;
	uint32_t nforeign = 0, nnew = 0;
	unsigned parts;
	int r = pipe_table_reserve(e->table, d->nopen, err);

	parts = pipe_table_parts(e->table);
	for (unsigned part = 0; part < parts; part++)
		for (uint32_t i = 0; i < d->nopen && !r; i++)
			if (pipe_table_part(e->table, place_of(&d->vertex[i])) == part)
				r = look_up_one(e, d, i, UINT64_MAX, err);
	for (uint32_t i = 0; i < d->nopen && !r; i++)
		place_one(e, d, i, &nforeign, &nnew);
	for (unsigned part = 0; part < parts; part++)
		for (uint32_t i = 0; i < d->nopen && !r; i++) {
			uint64_t place = place_of(&d->vertex[i]);

			if (!found[i].foreign && !found[i].closed && pipe_table_part(e->table, place) == part)
				r = pipe_table_number(e->table, place, e->totals.vertices + found[i].where + 1, err);
		}
	*ret_foreign = nforeign;
	return r;
}

/* Looks up every open vertex; *ret_foreign: how many were found. */
static int look_up(struct pipe_emitter *e, struct mesh_domain *d, uint32_t *ret_foreign, struct err *err)
{
	uint32_t nforeign = 0, nnew = 0;
	int r = 0;

	/* Each of them would read a page and write one: all vertices of points in convex position stay open. */
	if (d->nopen > pipe_table_pages(e->table) / 2 && pipe_table_spills(e->table, d->nopen))
		return look_up_by_parts(e, d, ret_foreign, err);
	for (uint32_t i = 0; i < d->nopen && !r; i++) {
		r = look_up_one(e, d, i, e->totals.vertices + nnew + 1, err);
		if (!r)
			place_one(e, d, i, &nforeign, &nnew);
	}
	*ret_foreign = nforeign;
	return r;
}

/* Sets the bits [from, to). */
static void set_bits(uint8_t *bits, uint32_t from, uint32_t to)
{
	for (; from < to && from % 8; from++)
		set_bit(bits, from);
	for (; to > from && to % 8; to--)
		set_bit(bits, to - 1);
	if (from < to)
		memset(bits + from / 8, 0xff, (to - from) / 8);
}

/* Few triangles touch open vertices, so many corners are tested together, without a branch. Local numbers are far below
 * 2^31. */
static void renumber_corners(uint32_t *corner, size_t n, const struct found *found, uint32_t nopen)
{
	enum { PIECE = 48 };

	for (size_t at = 0; at < n; at += PIECE) {
		size_t end = n - at < PIECE ? n : at + PIECE;
		int32_t any = 0;

		for (size_t k = at; k < end; k++)
			any |= (int32_t)corner[k] - (int32_t)nopen;
		if (any >= 0)
			continue;
		for (size_t k = at; k < end; k++)
			if (corner[k] < nopen)
				corner[k] = found[corner[k]].where;
	}
}

/* Triangles first, because they need `where`. Foreign vertices come first, so new ones move up by their number. */
static void renumber(struct mesh_domain *d, uint32_t nforeign)
{
	struct found *found = (struct found *)d->link;
	uint32_t i, nopen = d->nopen;
	uint32_t *corner = d->triangle[0];

	for (i = 0; i < nopen; i++) {
		if (!found[i].foreign)
			found[i].where += nforeign;
		if (found[i].closed)
			set_bit(d->final, found[i].where);
	}
	renumber_corners(corner, (size_t)d->ntriangle * 3, found, nopen);
}

/* Moves new open vertices to the end of the open ones, in order: from the end, each moves up or stays. Moves foreign
 * numbers to the front of the link array, in order: each moves down or stays. */
static void order_open(struct mesh_domain *d, uint32_t nforeign)
{
	struct found *found = (struct found *)d->link;
	uint64_t *foreign = (uint64_t *)d->link;
	uint32_t i, to = d->nopen;

	for (i = d->nopen; i-- > 0;)
		if (!found[i].foreign)
			d->vertex[--to] = d->vertex[i];
	for (i = to = 0; i < d->nopen && to < nforeign; i++) {
		struct found f = found[i];

		if (f.foreign)
			foreign[to++] = f.number;
	}
}

static void number_block(struct mesh_domain *d, uint32_t nforeign)
{
	memset(d->final, 0, ((size_t)d->nvertex + 7) / 8);
	renumber(d, nforeign);
	order_open(d, nforeign);
	set_bits(d->final, d->nopen, d->nvertex);
}

void pipe_emitter_sums(struct pipe_emitter *e, bool sums)
{
	const struct lattice lattice = e->lattice;
	const struct view_map map = e->map;
	struct pipe_table *table = e->table;

	*e = (struct pipe_emitter){.lattice = lattice, .map = map, .table = table, .sums = sums};
}

static int emit_sums(struct pipe_emitter *e, const struct mesh_domain *d, const struct mesh_sink *sink, struct err *err)
{
	if (sink)
		return err_set(err, ERR_INTERNAL, "a mesh of which only sums are made has no blocks");
	e->totals.vertices += d->counts.used;
	digest_add(&e->totals.vertex_digest, d->own_digest);
	if (!d->nvertex)
		return 0;
	digest_add(&e->totals.digest, d->digest);
	box_add(e, d);
	e->totals.triangles += d->ntriangle;
	e->blocks++;
	return 0;
}

int pipe_emit(struct pipe_emitter *e, struct mesh_domain *d, const struct cut_region *region, const struct mesh_sink *sink,
	      struct err *err)
{
	struct mesh_block block = {.index = e->blocks, .first = e->totals.vertices};
	uint32_t nforeign = 0;
	int r;

	counts_add(&e->totals.counts, &d->counts);
	e->totals.domains++;
	e->hull += d->nhull;
	if (e->sums)
		return emit_sums(e, d, sink, err);
	if (!d->nvertex)
		return 0;
	if (sink && !d->triangle)
		return err_set(err, ERR_INTERNAL, "a domain of which only the front was read has no block");
	r = look_up(e, d, &nforeign, err);
	if (r)
		return r;
	if (d->triangle)
		number_block(d, nforeign);
	digest_add(&e->totals.digest, d->digest);
	digest_add(&e->totals.vertex_digest, d->closed_digest);
	box_add(e, d);
	e->totals.triangles += d->ntriangle;
	e->totals.vertices += d->nvertex - nforeign;
	e->blocks++;
	if (!sink)
		return 0;
	block_box(e, region, block.box);
	block.foreign = (const uint64_t *)d->link;
	block.vertex = d->vertex + nforeign;
	block.triangle = (const uint32_t(*)[3])d->triangle;
	block.edges = d->nedges ? d->edges : NULL;
	block.origin = d->origin;
	block.final = d->final;
	block.nforeign = nforeign;
	block.nnew = d->nvertex - nforeign;
	block.ntriangle = d->ntriangle;
	return sink->block(sink->ctx, &block, err);
}

void pipe_emit_empty(struct pipe_emitter *e, const struct mesh_counts *counts)
{
	counts_add(&e->totals.counts, counts);
}

void pipe_emitter_part(struct pipe_emitter *e)
{
	e->part = true;
}

static double coordinate(struct decimal scale, int64_t number)
{
	char text[DECIMAL_TEXT_SIZE];
	double v = 0;

	parse_double(decimal_scaled_text(scale, number, text), &v);
	return v;
}

static void find_most(struct pipe_emitter *e)
{
	const struct mesh_most *most = &e->totals.counts.most;
	const struct lattice *l = &e->lattice;
	int32_t at[2] = {most->x, most->y};

	if (!most->points)
		return;
	if (e->map.is.k)
		view_map_back(&e->map, (const int32_t[2]){most->x, most->y}, at);
	e->totals.most_at[0] = coordinate(l->scale_xy, at[0] + l->k[0]);
	e->totals.most_at[1] = coordinate(l->scale_xy, at[1] + l->k[1]);
}

int pipe_emitter_finish(struct pipe_emitter *e, struct pipe_totals *ret, struct err *err)
{
	struct pipe_totals *t = &e->totals;

	find_most(e);
	if (e->part) {
		*ret = *t;
		return 0;
	}
	t->hull = e->sums ? e->hull : pipe_table_count(e->table);
	/* Euler's formula and the point set: a mesh with a hole, or a missing or doubled triangle, fails here, and its
	 * job must not succeed. Collinear positions have neither triangles nor a hull. */
	if (t->vertices && (t->vertices != t->counts.used || t->hull != e->hull ||
			    (t->triangles && t->triangles != 2 * t->vertices - 2 - t->hull)))
		return err_set(
			err, ERR_INTERNAL,
			"the mesh is not whole: %llu positions, %llu vertices, %llu triangles, %llu on the hull (%llu counted)",
			(unsigned long long)t->counts.used, (unsigned long long)t->vertices, (unsigned long long)t->triangles,
			(unsigned long long)t->hull, (unsigned long long)e->hull);
	*ret = *t;
	return 0;
}
