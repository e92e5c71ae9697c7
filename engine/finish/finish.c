/*
 * The kernel's triangles become a finished domain in three passes, in the memory of the triangles.
 *
 * Owned triangles are packed to the front as they are found. Their digest is computed at the same time, while the
 * positions of their corners are in the cache; fetching them again would cost more than the hash. Each vertex has a
 * one-byte mark in the memory of the kernel's ids, and later its local number in the same memory. Numbers are written
 * from the end, so that no mark is overwritten before it was read. Links and vertices follow the packed triangles. A
 * vertex is closed if all kernel triangles around it are owned. The others (at the border and on the hull) are open and
 * come first. A caller may choose the triangles itself, as domains with pieces do (engine/constrain).
 */
#include "finish.h"

#include <stdlib.h>
#include <string.h>

#include "align.h"
#include "cut_owner.h"

enum { USED = FINISH_USED, OPEN = FINISH_OPEN };
/* Triangles for each call of the digest; prefetch distance, in triangles. */
enum { BATCH = 64, AHEAD = 12, EDGE_AT = 31 };
_Static_assert(TRI_MAX_POINTS <= 1u << EDGE_AT, "a corner leaves the bit free");

void finish_init(struct finish *f, const struct cut_region *region, const int64_t k[3], const struct tri *tri)
{
	f->region = region;
	memcpy(f->k, k, sizeof f->k);
	tri_result(tri, &f->tri);
}

void finish_map(struct finish *f, const struct view *view)
{
	f->map = view->map.is.k ? &view->map : NULL;
}

/* USED and OPEN of each vertex. */
static uint8_t *marks(const struct finish *f)
{
	return (uint8_t *)f->tri.id;
}

/* The local number of each vertex; the same memory as the marks, later. */
static uint32_t *numbers(const struct finish *f)
{
	return (uint32_t *)f->tri.id;
}

static void mark_open(uint8_t *mark, const uint32_t corner[3])
{
	for (unsigned k = 0; k < 3; k++)
		if (corner[k] != TRI_GHOST)
			mark[corner[k]] |= OPEN;
}

static void ghost_count(struct finish *f, const uint32_t corner[3])
{
	const int32_t(*xy)[2] = f->tri.xy;
	unsigned k = corner[0] == TRI_GHOST ? 0 : corner[1] == TRI_GHOST ? 1 : 2;

	f->out.nhull += cut_region_owns_hull(f->region, xy[corner[(k + 1) % 3]], xy[corner[(k + 2) % 3]]);
}

static bool is_ghost(const uint32_t c[3])
{
	return c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST;
}

/* The chosen triangles, as they are packed to the front. */
struct packed {
	uint32_t (*out)[3];
	uint64_t place[BATCH][3];
	uint32_t n, batch;
};

static inline void pack(struct finish *f, struct packed *p, uint8_t *mark, const uint32_t c[3])
{
	for (unsigned k = 0; k < 3; k++) {
		mark[c[k]] |= USED;
		p->out[p->n][k] = c[k];
		p->place[p->batch][k] = finish_place(f, f->tri.xy[c[k]]);
	}
	p->n++;
	if (++p->batch == BATCH) {
		digest_add_triangles(&f->out.digest, (const uint64_t(*)[3])p->place, BATCH, f->k);
		p->batch = 0;
	}
}

static void pack_end(struct finish *f, const struct packed *p)
{
	digest_add_triangles(&f->out.digest, (const uint64_t(*)[3])p->place, p->batch, f->k);
	f->out.triangle = p->out;
	f->out.ntriangle = p->n;
}

/* Until triangles get their local numbers, the highest bit of a corner says that the side across from it is a piece. */
static inline void mark_edges(struct finish *f, uint32_t t[3], const uint32_t link[3])
{
	for (unsigned k = 0; k < 3; k++)
		t[k] |= (link[k] & 1) << EDGE_AT;
	f->edges |= (link[0] | link[1] | link[2]) & 1;
}

void finish_chosen(struct finish *f, const uint64_t *bits)
{
	struct packed p = {.out = (uint32_t(*)[3])f->tri.triangle};
	const struct tri_triangle *t = f->tri.triangle;
	uint8_t *mark = marks(f);

	f->chosen = true;
	memset(mark, 0, f->tri.nvertex);
	for (uint32_t i = 0; i < f->tri.ntriangle; i++) {
		const uint32_t c[3] = {t[i].corner[0], t[i].corner[1], t[i].corner[2]};

		if (bits[i / 64] >> i % 64 & 1) {
			const uint32_t link[3] = {t[i].link[0], t[i].link[1], t[i].link[2]};

			pack(f, &p, mark, c);
			mark_edges(f, p.out[p.n - 1], link);
			continue;
		}
		mark_open(mark, c);
		if (is_ghost(c) && f->region->inf)
			ghost_count(f, c);
	}
	pack_end(f, &p);
}

void finish_owned(struct finish *f)
{
	struct packed p = {.out = (uint32_t(*)[3])f->tri.triangle};
	const struct tri_triangle *t = f->tri.triangle;
	const int32_t(*xy)[2] = f->tri.xy;
	uint8_t *mark = marks(f);
	uint32_t count = f->tri.ntriangle;
	struct cut_owner owner;

	cut_owner_init(&owner, f->region);
	memset(mark, 0, f->tri.nvertex);
	for (uint32_t i = 0; i < count; i++) {
		const uint32_t c[3] = {t[i].corner[0], t[i].corner[1], t[i].corner[2]};
		bool ghost = is_ghost(c);

		/* The prefetch of a ghost's corner has an invalid address, which is harmless. */
		for (unsigned k = 0; k < 3 && i + AHEAD < count; k++)
			__builtin_prefetch(&xy[t[i + AHEAD].corner[k]]);
		if (ghost || !cut_owner_has(&owner, xy[c[0]], xy[c[1]], xy[c[2]])) {
			mark_open(mark, c);
			if (ghost && f->region->inf)
				ghost_count(f, c);
			continue;
		}
		pack(f, &p, mark, c);
	}
	pack_end(f, &p);
}

/* Places links, vertices and final bits behind the triangles. False: they do not fit. */
static bool lay_out(struct finish *f)
{
	uint8_t *at = (uint8_t *)f->out.triangle + align_line((size_t)f->out.ntriangle * sizeof(uint32_t[3]));
	const uint8_t *mark = marks(f), *front = (const uint8_t *)f->tri.triangle;
	/* They are written while xy, z and marks are still read, so they must not overlap these. */
	const uint8_t *end = (const uint8_t *)f->tri.xy;
	uint32_t nopen = 0, nvertex = 0;

	if ((const uint8_t *)f->tri.z > front && (const uint8_t *)f->tri.z < end)
		end = (const uint8_t *)f->tri.z;
	if (mark > front && mark < end)
		end = mark;
	for (uint32_t v = 0; v < f->tri.nvertex; v++) {
		nvertex += mark[v] & USED;
		nopen += mark[v] == (USED | OPEN);
	}
	f->out.nvertex = nvertex;
	f->out.nopen = nopen;
	f->out.link = (struct mesh_link *)at;
	at += (size_t)nopen * sizeof(struct mesh_link);
	f->out.vertex = (struct mesh_vertex *)at;
	at += align_line((size_t)nvertex * sizeof(struct mesh_vertex));
	f->out.final = at;
	at += align_line(((size_t)nvertex + 7) / 8);
	f->out.edges = f->edges ? at : NULL;
	f->out.nedges = f->edges ? f->out.ntriangle : 0;
	at += align_line(f->out.nedges);
	if (at > end)
		return false;
	memset(f->out.link, 0, (size_t)nopen * sizeof(struct mesh_link));
	return true;
}

static inline void box_add(int32_t box[6], const int32_t at[3])
{
	for (unsigned k = 0; k < 3; k++) {
		box[k] = at[k] < box[k] ? at[k] : box[k];
		box[3 + k] = at[k] > box[3 + k] ? at[k] : box[3 + k];
	}
}

bool finish_vertices(struct finish *f)
{
	const uint8_t *mark = marks(f);
	uint32_t *number = numbers(f), open_at, closed_at;
	int32_t box[6] = {INT32_MAX, INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN, INT32_MIN};

	if (!lay_out(f))
		return false;
	open_at = f->out.nopen;
	closed_at = f->out.nvertex;
	for (uint32_t v = f->tri.nvertex; v-- > 0;) {
		const int32_t *xy = f->tri.xy[v];
		int32_t at[3] = {[2] = f->tri.z[v]};
		uint8_t m = mark[v];
		uint32_t to;

		finish_position(f, xy, at);

		/* A closed vertex is in the region, because all corners of its Voronoi cell are; unless triangles were chosen. */
		if ((m != USED || f->chosen) && cut_region_holds(f->region, xy[0], xy[1]))
			digest_add_vertex(&f->out.own_digest, at[0] + f->k[0], at[1] + f->k[1], at[2] + f->k[2]);
		if (!(m & USED))
			continue;
		to = m & OPEN ? --open_at : --closed_at;
		f->out.vertex[to] = (struct mesh_vertex){at[0], at[1], at[2]};
		number[v] = to;
		box_add(box, at);
		if (!(m & OPEN))
			digest_add_vertex(&f->out.closed_digest, at[0] + f->k[0], at[1] + f->k[1], at[2] + f->k[2]);
	}
	if (!f->chosen)
		digest_add(&f->out.own_digest, f->out.closed_digest);
	if (f->out.nvertex)
		memcpy(f->out.box, box, sizeof box);
	return true;
}

/* The hash of a position for link sums. */
static struct digest place_hash(const struct mesh_vertex *v)
{
	uint64_t place = (uint64_t)(uint32_t)v->x << 32 | (uint32_t)v->y;

	return digest_hash(&place, sizeof place);
}

static void link_add(struct mesh_link *link, struct digest a, struct digest b)
{
	link->hi += a.hi - b.hi;
	link->lo += a.lo - b.lo;
	link->edges++;
}

static void link_triangle(struct mesh_domain *d, const uint32_t t[3])
{
	struct digest h[3];

	for (unsigned k = 0; k < 3; k++)
		h[k] = place_hash(&d->vertex[t[k]]);
	for (unsigned k = 0; k < 3; k++)
		if (t[k] < d->nopen)
			link_add(&d->link[t[k]], h[(k + 1) % 3], h[(k + 2) % 3]);
}

static void take_edges(struct mesh_domain *d)
{
	for (uint32_t i = 0; i < d->ntriangle; i++) {
		d->edges[i] = 0;
		for (unsigned k = 0; k < 3; k++) {
			d->edges[i] |= (uint8_t)(d->triangle[i][k] >> EDGE_AT << k);
			d->triangle[i][k] &= ~(UINT32_C(1) << EDGE_AT);
		}
	}
}

void finish_numbers(struct finish *f)
{
	const uint32_t *number = numbers(f);
	uint32_t nopen = f->out.nopen, count = f->out.ntriangle;
	uint32_t(*triangle)[3] = f->out.triangle;

	if (f->edges)
		take_edges(&f->out);
	for (uint32_t i = 0; i < count; i++) {
		uint32_t *t = triangle[i];
		uint32_t a = number[t[0]], b = number[t[1]], c = number[t[2]];
		uint32_t least = a < b ? a : b;

		t[0] = a;
		t[1] = b;
		t[2] = c;
		if (__builtin_expect((c < least ? c : least) < nopen, 0))
			link_triangle(&f->out, t);
	}
}

static int compare_on_line(const void *a, const void *b)
{
	const int32_t *p = a, *q = b;

	return p[0] != q[0] ? (p[0] > q[0]) - (p[0] < q[0]) : (p[1] > q[1]) - (p[1] < q[1]);
}

/*
 * For a region that loaded fewer than three positions, or collinear ones. Its own positions are in the mesh
 * nevertheless, in triangles of other regions. And if it sees only a side of the hull, from afar, it owns edges of the
 * hull.
 */
void finish_flat(struct finish *f)
{
	const struct cut_region *region = f->region;
	const struct tri_result *t = &f->tri;
	struct mesh_domain *d = &f->out;
	int32_t(*xy)[2], at[2];

	for (uint32_t i = 0; i < t->nvertex; i++) {
		if (!cut_region_holds(region, t->xy[i][0], t->xy[i][1]))
			continue;
		finish_position(f, t->xy[i], at);
		digest_add_vertex(&d->own_digest, at[0] + f->k[0], at[1] + f->k[1], t->z[i] + f->k[2]);
	}
	if (!region->inf)
		return;
	xy = (int32_t(*)[2])(uintptr_t)t->xy; /* in the arena, and no longer needed there */
	qsort(xy, t->nvertex, sizeof *xy, compare_on_line);
	for (uint32_t i = 1; i < t->nvertex; i++)
		d->nhull +=
			(uint32_t)cut_region_owns_hull(region, xy[i - 1], xy[i]) + cut_region_owns_hull(region, xy[i], xy[i - 1]);
}
