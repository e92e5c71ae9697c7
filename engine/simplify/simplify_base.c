/*
 * The base of greedy insertion: the corners of the hull, the vertices of lines, and, where the ground is rough for the error, of
 * every few points in Morton order the one that is highest above the plane through them, and the lowest. If these are farther
 * from it than the error, greedy insertion nearly always takes them as well.
 */
#include "simplify_base.h"

#include <string.h>

#define NONE UINT32_MAX

enum { GROUP = 16 };

/* Sums of a group of points, relative to the first one. Their choice need not be exact, only always the same. */
struct sums {
	double x, y, z, xx, xy, yy, xz, yz;
};

static void add_sums(struct sums *s, double x, double y, double z)
{
	s->x += x;
	s->y += y;
	s->z += z;
	s->xx += x * x;
	s->xy += x * y;
	s->yy += y * y;
	s->xz += x * z;
	s->yz += y * z;
}

/* The plane of least squares, z = k[0] x + k[1] y + k[2]. False: there is none. */
static bool fit_plane(const struct sums *s, double k[3])
{
	double xx = s->xx - s->x * s->x / GROUP, xy = s->xy - s->x * s->y / GROUP, yy = s->yy - s->y * s->y / GROUP,
	       xz = s->xz - s->x * s->z / GROUP, yz = s->yz - s->y * s->z / GROUP, d = xx * yy - xy * xy;

	if (!(d > 0))
		return false;
	k[0] = (xz * yy - yz * xy) / d;
	k[1] = (yz * xx - xz * xy) / d;
	k[2] = (s->z - k[0] * s->x - k[1] * s->y) / GROUP;
	return true;
}

/* Marks the highest and the lowest of a group above and below its plane, if they are farther from it than the error. */
static void mark_group(const struct simplify_greedy *g, uint32_t first, uint32_t *from)
{
	double high = (double)g->least / (1 << SIMPLIFY_KEY_SHIFT), low = -high, k[3];
	uint32_t highest = first, lowest = first;
	const struct point *o = &g->pts[first];
	struct sums s = {0};
	bool any[2] = {false, false};

	for (unsigned i = 1; i < GROUP; i++)
		add_sums(&s, (double)o[i].x - o->x, (double)o[i].y - o->y, (double)o[i].z - o->z);
	if (!fit_plane(&s, k))
		return;
	for (unsigned i = 0; i < GROUP; i++) {
		double x = (double)o[i].x - o->x, y = (double)o[i].y - o->y, z = (double)o[i].z - o->z,
		       far = z - (k[0] * x + k[1] * y + k[2]);

		if (far > high) {
			high = far;
			highest = first + i;
			any[0] = true;
		} else if (far < low) {
			low = far;
			lowest = first + i;
			any[1] = true;
		}
	}
	from[highest] |= any[0] ? SIMPLIFY_ROUGH : 0;
	from[lowest] |= any[1] ? SIMPLIFY_ROUGH : 0;
}

uint32_t simplify_base(const struct simplify_greedy *g, uint32_t *from)
{
	uint32_t n = 0;

	memset(from, 0, g->n * sizeof *from);
	for (uint32_t i = 0; g->rough && i + GROUP <= g->n; i += GROUP)
		mark_group(g, i, from);
	for (uint32_t i = 0; i < g->nhull; i++)
		from[g->hull[i]] = SIMPLIFY_BASE;
	for (uint32_t i = 0; i < g->n; i++) {
		if (g->pts[i].tag & POINT_LINE)
			from[i] = SIMPLIFY_BASE;
		n += from[i] != 0;
	}
	return n;
}

static uint32_t least_corner(const struct tri_result *tri, const uint32_t *index, uint32_t t)
{
	const uint32_t *c = tri->triangle[t].corner;
	uint32_t least = NONE;

	for (unsigned k = 0; k < 3; k++) {
		if (c[k] == TRI_GHOST)
			return NONE;
		if (index[tri->id[c[k]]] < least)
			least = index[tri->id[c[k]]];
	}
	return least;
}

/* `count`: the cells of each first corner, then the number of the next one. */
uint32_t simplify_base_number(uint32_t n, const struct tri_result *tri, const uint32_t *index, uint32_t *count, uint32_t *number)
{
	uint32_t cells = 0;

	memset(count, 0, n * sizeof *count);
	for (uint32_t i = 0; i < tri->ntriangle; i++) {
		number[i] = least_corner(tri, index, i);
		if (number[i] != NONE)
			count[number[i]]++;
	}
	for (uint32_t i = 0; i < n; i++) {
		uint32_t here = count[i];

		count[i] = cells;
		cells += here;
	}
	for (uint32_t i = 0; i < tri->ntriangle; i++)
		if (number[i] != NONE)
			number[i] = count[number[i]]++;
	return cells;
}
