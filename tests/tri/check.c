#include "check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "geom.h"

static uint64_t mix(uint64_t h, uint64_t v)
{
	h = (h ^ v) * UINT64_C(0xbf58476d1ce4e5b9);
	h ^= h >> 29;
	h *= UINT64_C(0x94d049bb133111eb);
	return h ^ h >> 32;
}

void check_sum_add(struct check_sum *sum, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	const int32_t *v[3] = {a, b, c};
	unsigned first = 0;
	uint64_t lo = 1, hi = 2;

	for (unsigned i = 1; i < 3; i++)
		if (geom_less(v[i], v[first]))
			first = i;
	for (unsigned i = 0; i < 3; i++) {
		const int32_t *p = v[(first + i) % 3];
		uint64_t word = (uint64_t)(uint32_t)p[0] << 32 | (uint32_t)p[1];

		lo = mix(lo, word);
		hi = mix(hi, ~word);
	}
	sum->lo += lo;
	sum->hi += hi;
	sum->n++;
}

static bool is_ghost(const struct tri_triangle *t)
{
	return t->corner[0] == TRI_GHOST || t->corner[1] == TRI_GHOST || t->corner[2] == TRI_GHOST;
}

struct check_sum check_sum_of(const struct tri_result *r)
{
	struct check_sum sum = {0};

	for (uint32_t i = 0; i < r->ntriangle; i++) {
		const uint32_t *c = r->triangle[i].corner;

		if (!is_ghost(&r->triangle[i]))
			check_sum_add(&sum, r->xy[c[0]], r->xy[c[1]], r->xy[c[2]]);
	}
	return sum;
}

static const char *check_vertices(const struct tri_result *r, const struct mesh_vertex *in, uint32_t n)
{
	unsigned char *seen = calloc(n, 1);
	const char *wrong = seen ? NULL : "no memory";

	if (r->nvertex != n)
		wrong = "the number of vertices";
	for (uint32_t i = 0; !wrong && i < n; i++) {
		uint32_t id = r->id[i];

		if (id >= n || seen[id]++)
			wrong = "id is no permutation";
		else if (in[id].x != r->xy[i][0] || in[id].y != r->xy[i][1] || in[id].z != r->z[i])
			wrong = "a vertex is not the input's";
	}
	free(seen);
	return wrong;
}

/* Triangle t, side i: the edge from corner i + 1 to corner i + 2. */
static const char *check_side(const struct tri_result *r, uint32_t at, unsigned i, bool pieces)
{
	const struct tri_triangle *t = &r->triangle[at], *o;
	uint32_t link = t->link[i], side = link >> 1 & 3, a = t->corner[(i + 1) % 3], b = t->corner[(i + 2) % 3];

	if (link & 1 && !pieces)
		return "a link is marked constrained";
	if (link >> 3 >= r->ntriangle || side > 2)
		return "a link leads nowhere";
	o = &r->triangle[link >> 3];
	if (o->link[side] != (at << 3 | i << 1 | (link & 1)))
		return "a link is not mutual";
	if (o->corner[(side + 1) % 3] != b || o->corner[(side + 2) % 3] != a)
		return "two linked triangles do not share the edge";
	if (is_ghost(t) || is_ghost(o) || link & 1)
		return NULL;
	if (geom_incircle(r->xy[t->corner[0]], r->xy[t->corner[1]], r->xy[t->corner[2]], r->xy[o->corner[side]]) > 0)
		return "a circle is not empty";
	return NULL;
}

/* Ghost (a, b, infinite): the next hull edge starts where this one ends, and does not turn outwards. */
static const char *check_hull(const struct tri_result *r, const struct tri_triangle *ghost)
{
	unsigned g = ghost->corner[0] == TRI_GHOST ? 0 : ghost->corner[1] == TRI_GHOST ? 1 : 2;
	uint32_t a = ghost->corner[(g + 1) % 3], b = ghost->corner[(g + 2) % 3];
	uint32_t link = ghost->link[(g + 1) % 3]; /* across from a: the edge from b to infinity */
	const struct tri_triangle *next = &r->triangle[link >> 3];
	uint32_t c = next->corner[link >> 1 & 3];

	if (a == TRI_GHOST || b == TRI_GHOST || c == TRI_GHOST)
		return "a triangle has two infinite corners";
	if (geom_orient(r->xy[a], r->xy[b], r->xy[c]) > 0)
		return "the hull is not convex";
	return NULL;
}

static const char *check_triangles(const struct tri_result *r, const struct mesh_vertex *in, uint32_t n, bool pieces)
{
	const char *wrong = check_vertices(r, in, n);

	if (wrong)
		return wrong;
	if (r->ntriangle != 2 * n - 2)
		return "the number of triangles is not 2 n - 2";
	for (uint32_t i = 0; i < r->ntriangle; i++) {
		const struct tri_triangle *t = &r->triangle[i];

		for (unsigned k = 0; k < 3; k++) {
			if (t->corner[k] != TRI_GHOST && t->corner[k] >= n)
				return "a corner is no vertex";
			if ((wrong = check_side(r, i, k, pieces)))
				return wrong;
		}
		if (is_ghost(t))
			wrong = check_hull(r, t);
		else if (geom_orient(r->xy[t->corner[0]], r->xy[t->corner[1]], r->xy[t->corner[2]]) <= 0)
			wrong = "a triangle is not counter-clockwise";
		if (wrong)
			return wrong;
	}
	return NULL;
}

const char *check_result(const struct tri_result *r, const struct mesh_vertex *in, uint32_t n)
{
	return check_triangles(r, in, n, false);
}

static int compare_words(const void *a, const void *b)
{
	uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;

	return (x > y) - (x < y);
}

static uint64_t edge_word(uint32_t a, uint32_t b)
{
	return a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
}

static uint32_t sort_unique(uint64_t *word, uint32_t n)
{
	uint32_t left = 0;

	qsort(word, n, sizeof(*word), compare_words);
	for (uint32_t i = 0; i < n; i++)
		if (!i || word[i] != word[i - 1])
			word[left++] = word[i];
	return left;
}

/* The edges that are marked constrained are the pieces. */
static const char *check_marks(const struct tri_result *r, const uint32_t (*piece)[2], uint32_t npiece)
{
	uint64_t *want = malloc(npiece * sizeof(*want) + 1), *have = malloc(3 * (size_t)r->ntriangle * sizeof(*have));
	uint32_t nhave = 0, nwant;
	const char *wrong = NULL;

	for (uint32_t i = 0; i < r->ntriangle; i++)
		for (unsigned k = 0; k < 3; k++) {
			const uint32_t *c = r->triangle[i].corner, a = c[(k + 1) % 3], b = c[(k + 2) % 3];

			if (r->triangle[i].link[k] & 1 && (a == TRI_GHOST || b == TRI_GHOST))
				wrong = "an edge to infinity is marked constrained";
			else if (r->triangle[i].link[k] & 1)
				have[nhave++] = edge_word(r->id[a], r->id[b]);
		}
	for (uint32_t i = 0; i < npiece; i++)
		want[i] = edge_word(piece[i][0], piece[i][1]);
	nwant = sort_unique(want, npiece);
	nhave = sort_unique(have, nhave);
	if (!wrong && (nwant != nhave || memcmp(want, have, nwant * sizeof(*want))))
		wrong = "the constrained edges are not the pieces";
	free(want);
	free(have);
	return wrong;
}

const char *check_constrained(const struct tri_result *r, const struct mesh_vertex *in, uint32_t n, const uint32_t (*piece)[2],
			      uint32_t npiece)
{
	const char *wrong = check_triangles(r, in, n, true);

	return wrong ? wrong : check_marks(r, piece, npiece);
}

struct tri *check_tri(const struct mesh_vertex *v, uint32_t n)
{
	struct tri_result unused;
	void *arena;

	if (check_run(v, n, &arena, &unused) == 0)
		return arena;
	free(arena);
	return NULL;
}

struct tri *check_tri_room(const struct mesh_vertex *v, uint32_t n, uint32_t cap)
{
	struct tri *t = aligned_alloc(64, (tri_bytes(cap) + 63) / 64 * 64);

	if (!t) {
		fprintf(stderr, "no memory for an arena of %u positions\n", cap);
		exit(1);
	}
	tri_init(t, cap);
	memcpy(tri_input(t), v, n * sizeof(*v));
	if (!tri_run(t, n))
		return t;
	free(t);
	return NULL;
}

static void *pieces_memory(uint32_t cap, uint32_t most)
{
	size_t bytes = (tri_pieces_bytes(cap, most) + 63) / 64 * 64;
	void *memory = aligned_alloc(64, bytes);

	if (!memory) {
		fprintf(stderr, "no memory for pieces, %zu bytes\n", bytes);
		exit(1);
	}
	memset(memory, 0xa5, bytes);
	return memory;
}

struct tri_pieces *check_pieces(struct tri *t, uint32_t most)
{
	return tri_pieces_init(pieces_memory(tri_count(t), most), t, most);
}

struct tri_pieces *check_pieces_room(struct tri *t, uint32_t cap, uint32_t most)
{
	return tri_pieces_open(pieces_memory(cap, most), t, cap, most);
}

int check_run(const struct mesh_vertex *v, uint32_t n, void **ret_arena, struct tri_result *ret)
{
	size_t bytes = (tri_bytes(n) + 63) / 64 * 64;
	void *arena = aligned_alloc(64, bytes);
	struct tri *t;
	int status;

	if (!arena) {
		fprintf(stderr, "no memory for an arena of %zu bytes\n", bytes);
		exit(1);
	}
	memset(arena, 0xa5, bytes);
	t = tri_init(arena, n);
	if (n)
		memcpy(tri_input(t), v, n * sizeof(*v));
	status = tri_run(t, n);
	tri_result(t, ret);
	*ret_arena = arena;
	return status;
}
