/*
 * The first round has only a strip of the chosen points: those with keys in the file "border", and those around these. A mesh
 * triangle that is not settled has three corners with keys. All mesh triangles around such a corner have their corners in the
 * strip. No chosen point is in their circles, and so none of the strip: they are triangles of the strip, too, and there are no
 * others around the corner. So a triangle of the strip is in the mesh if it has a corner with a key, and is settled if it has one
 * without, too. A triangle of the strip without a corner with a key need not be in the mesh. There the mesh has settled triangles
 * only, so nothing is to be tested.
 *
 * Vertices in the region's box are looked up together, in the order of keys. Of another one it is usually not known: a triangle
 * with a corner of each kind is in the mesh, and tested again at worst.
 */
#include <string.h>

#include "err.h"
#include "simplify_region.h"

#define NONE UINT32_MAX

enum { READ = 1024 };

/* Keys of the file from `lo` on. */
struct keys {
	const struct simplify_in *in;
	uint64_t at, key[READ];
	size_t n, next;
};

/* The first key that is not below `lo`. */
static int seek(struct keys *k, uint64_t lo, struct err *err)
{
	uint64_t from = 0, to = k->in->n, key;
	int r = 0;

	while (!r && from < to) {
		uint64_t middle = from + (to - from) / 2;

		r = simplify_in_some(k->in, &key, middle, 1, err);
		if (key < lo)
			from = middle + 1;
		else
			to = middle;
	}
	k->at = from;
	k->n = k->next = 0;
	return r;
}

/* Goes to the first key that is not below `key`. *ret: whether it is that. */
static int go(struct keys *k, uint64_t key, bool *ret, struct err *err)
{
	int r = 0;

	for (*ret = false; !r; k->next++) {
		if (k->next == k->n) {
			k->at += k->n;
			k->next = 0;
			k->n = k->in->n - k->at < READ ? (size_t)(k->in->n - k->at) : READ;
			r = k->n ? simplify_in_some(k->in, k->key, k->at, k->n, err) : 0;
			if (r || !k->n)
				return r;
		}
		if (k->key[k->next] >= key) {
			*ret = k->key[k->next] == key;
			return 0;
		}
	}
	return r;
}

static void mark(struct simplify_check *c, uint32_t v, bool there)
{
	uint64_t *bits = there ? c->keyed : c->calm;

	bits[v / 64] |= UINT64_C(1) << v % 64;
}

/* `vertex`: of each number of the input, which is in the order of keys but for vertices that were added later, the vertex. */
static int mark_range(struct simplify_check *c, struct keys *k, const struct cut_range *range, const uint32_t *vertex,
		      struct err *err)
{
	uint64_t last = 0;
	int r = seek(k, range->lo, err);

	for (uint32_t i = 0; !r && i < c->tri.nvertex; i++) {
		uint32_t v = vertex[i];
		uint64_t key = v == NONE ? 0 : point_morton(c->tri.xy[v][0], c->tri.xy[v][1]);
		bool there;

		if (v == NONE || key < range->lo || key > range->hi || key < last)
			continue;
		last = key;
		r = go(k, key, &there, err);
		mark(c, v, there);
	}
	return r;
}

int simplify_calm(struct simplify_check *c, const struct cut_region *region, struct err *err)
{
	uint32_t *vertex = c->list; /* not used yet */
	struct keys k = {.in = &c->border};
	struct cut_range range[4];
	unsigned n;
	int r = 0;

	memset(c->calm, 0, (c->budget.cap + 63) / 64 * sizeof *c->calm);
	memset(c->keyed, 0, (c->budget.cap + 63) / 64 * sizeof *c->keyed);
	memset(vertex, 0xff, c->tri.nvertex * sizeof *vertex);
	for (uint32_t v = 0; v < c->tri.nvertex; v++)
		if (c->tri.id[v] < c->tri.nvertex)
			vertex[c->tri.id[v]] = v;
	n = cut_region_ranges(region, range);
	for (unsigned i = 0; !r && i < n; i++)
		r = mark_range(c, &k, &range[i], vertex, err);
	return r;
}

static bool has(const struct simplify_check *c, const uint64_t *bits, uint32_t i)
{
	const uint32_t *v = c->tri.triangle[i].corner;

	return simplify_bit(bits, v[0]) || simplify_bit(bits, v[1]) || simplify_bit(bits, v[2]);
}

bool simplify_is_calm(const struct simplify_check *c, uint32_t i)
{
	return simplify_in_strip(c) && has(c, c->calm, i);
}

int simplify_in_mesh(struct simplify_check *c, uint32_t i, bool *ret, struct err *err)
{
	int r = 0;

	/* All corners are elsewhere, which is rare. */
	for (unsigned n = 0; !r && n < 3 && !has(c, c->keyed, i) && !has(c, c->calm, i); n++) {
		uint32_t v = c->tri.triangle[i].corner[n];
		struct keys k = {.in = &c->border};
		uint64_t key = point_morton(c->tri.xy[v][0], c->tri.xy[v][1]);
		bool there = false;

		r = seek(&k, key, err);
		if (!r)
			r = go(&k, key, &there, err);
		if (!r)
			mark(c, v, there);
	}
	*ret = has(c, c->keyed, i);
	return r;
}
