/*
 * The entry of the kernel: the layout of the arena, and a run from positions to triangles.
 *
 * The arena is a struct tri and 64 bytes for each point. Until the order of insertion is known, the memory of the
 * triangles holds the input (12 bytes a point), which is not needed afterwards. Positions must be distinct. Nothing is allocated.
 */
#include "tri_priv.h"

#include <string.h>

#include "geom.h"

enum {
	TRI_HEAD_BYTES = 64,
	TRI_TRIANGLE_BYTES = 48, /* n points make 2n - 2 triangles, ghosts included */
};

_Static_assert(sizeof(struct tri) <= TRI_HEAD_BYTES, "the head of the arena");
_Static_assert(2 * sizeof(struct tri_triangle) == TRI_TRIANGLE_BYTES, "two triangles a point");
_Static_assert(TRI_TRIANGLE_BYTES + 8 + 4 + 4 == TRI_BYTES_PER_POINT, "all of the arena");
_Static_assert(sizeof(struct mesh_vertex) <= TRI_TRIANGLE_BYTES, "the input");

size_t tri_bytes(uint32_t cap)
{
	return TRI_HEAD_BYTES + (size_t)cap * TRI_BYTES_PER_POINT;
}

struct tri *tri_init(void *memory, uint32_t cap)
{
	struct tri *t = memory;
	unsigned char *at = (unsigned char *)memory + TRI_HEAD_BYTES;

	memset(t, 0, sizeof(*t));
	t->cap = cap;
	t->triangle = (struct tri_triangle *)at;
	at += (size_t)cap * TRI_TRIANGLE_BYTES;
	t->xy = (int32_t(*)[2])at;
	at += (size_t)cap * sizeof(*t->xy);
	t->z = (int32_t *)at;
	at += (size_t)cap * sizeof(*t->z);
	t->id = (uint32_t *)at;
	return t;
}

struct mesh_vertex *tri_input(struct tri *t)
{
	return (struct mesh_vertex *)t->triangle;
}

static void swap_vertices(struct tri *t, uint32_t a, uint32_t b)
{
	int32_t x = t->xy[a][0], y = t->xy[a][1], z = t->z[a];
	uint32_t id = t->id[a];

	memcpy(t->xy[a], t->xy[b], sizeof(t->xy[a]));
	t->z[a] = t->z[b];
	t->id[a] = t->id[b];
	t->xy[b][0] = x;
	t->xy[b][1] = y;
	t->z[b] = z;
	t->id[b] = id;
}

/* Moves three vertices that form a counter-clockwise triangle to the front. False: all are collinear. */
static bool seed_find(struct tri *t)
{
	uint32_t third = 2;
	int turn = 0;

	while (third < t->nvertex && !(turn = geom_orient(t->xy[0], t->xy[1], t->xy[third])))
		third++;
	if (!turn)
		return false;
	swap_vertices(t, 2, third);
	if (turn < 0)
		swap_vertices(t, 0, 1);
	return true;
}

/* Makes the triangle 0, 1, 2 and a ghost across each of its sides. */
static void seed_place(struct tri *t)
{
	struct tri_triangle *first = &t->triangle[0];

	for (uint32_t i = 0; i < 3; i++) {
		uint32_t next = (i + 1) % 3, last = (i + 2) % 3;
		struct tri_triangle *ghost = &t->triangle[1 + i];

		first->corner[i] = i;
		first->link[i] = (1 + i) << 3 | 2 << 1;
		ghost->corner[0] = last;
		ghost->corner[1] = next;
		ghost->corner[2] = TRI_GHOST;
		ghost->link[0] = (1 + last) << 3 | 1 << 1;
		ghost->link[1] = (1 + next) << 3 | 0 << 1;
		ghost->link[2] = i << 1;
	}
	t->ntriangle = 4;
}

bool tri_seed(struct tri *t)
{
	t->ntriangle = 0;
	if (!seed_find(t))
		return false;
	seed_place(t);
	return true;
}

int tri_build(struct tri *t, bool narrow)
{
	if (!tri_seed(t))
		return TRI_E_FLAT;
	tri_insert_all(t, narrow);
	return 0;
}

int tri_run(struct tri *t, uint32_t n)
{
	t->nvertex = n;
	t->ntriangle = 0;
	if (n == 0)
		return TRI_E_FLAT;
	tri_order(t, tri_input(t), n);
	return tri_build(t, tri_narrow(&t->extent));
}

int tri_add(struct tri *t, const struct mesh_vertex *v, uint32_t n, bool highest)
{
	for (uint32_t i = 0; i < n; i++) {
		const int32_t at[2] = {v[i].x, v[i].y};
		uint32_t p = t->nvertex, same;

		for (unsigned k = 0; k < 2; k++) {
			t->extent.min[k] = at[k] < t->extent.min[k] ? at[k] : t->extent.min[k];
			t->extent.max[k] = at[k] > t->extent.max[k] ? at[k] : t->extent.max[k];
		}
		if (p == t->cap)
			return TRI_E_FULL;
		memcpy(t->xy[p], at, sizeof at);
		t->z[p] = v[i].z;
		t->id[p] = p;
		t->nvertex = p + 1;
		if (tri_insert_one(t, tri_narrow(&t->extent), &same))
			continue;
		t->nvertex = p;
		if (highest ? v[i].z > t->z[same] : v[i].z < t->z[same])
			t->z[same] = v[i].z;
	}
	return 0;
}

uint32_t tri_count(const struct tri *t)
{
	return t->nvertex;
}

void tri_result(const struct tri *t, struct tri_result *ret)
{
	ret->nvertex = t->nvertex;
	ret->ntriangle = t->ntriangle;
	ret->xy = (const int32_t(*)[2])t->xy;
	ret->z = t->z;
	ret->id = t->id;
	ret->triangle = t->triangle;
}
