/*
 * The normal form of an area (area.h): areas that differ only in where their rings begin, in their directions and in corners that
 * are repeated become the same.
 */
#include <string.h>

#include "area_priv.h"

static int corner_compare(const int64_t a[2], const int64_t b[2])
{
	if (a[0] != b[0])
		return a[0] < b[0] ? -1 : 1;
	return (a[1] > b[1]) - (a[1] < b[1]);
}

static void reverse(int64_t (*c)[2], size_t n)
{
	for (size_t i = 0; i + 1 < n - i; i++) {
		int64_t x = c[i][0], y = c[i][1];

		memcpy(c[i], c[n - 1 - i], sizeof c[i]);
		c[n - 1 - i][0] = x;
		c[n - 1 - i][1] = y;
	}
}

/* Returns the number of remaining corners; the smallest one comes first, then its smaller neighbour. */
static size_t normal_ring(int64_t (*c)[2], size_t n)
{
	size_t kept = 0, least = 0;

	for (size_t i = 0; i < n; i++)
		if (!kept || corner_compare(c[i], c[kept - 1]))
			memmove(c[kept++], c[i], sizeof c[i]);
	while (kept > 1 && !corner_compare(c[kept - 1], c[0]))
		kept--;
	for (size_t i = 1; i < kept; i++)
		if (corner_compare(c[i], c[least]) < 0)
			least = i;
	/* Rotates by three reversals. */
	reverse(c, least);
	reverse(c + least, kept - least);
	reverse(c, kept);
	for (size_t i = 1; i < kept - (kept > 0); i++) {
		int order = corner_compare(c[kept - i], c[i]);

		if (!order)
			continue; /* a spike: to a corner and back */
		if (order < 0)
			reverse(c + 1, kept - 1);
		break;
	}
	return kept;
}

void area_normal_form(struct area *a)
{
	size_t rings = 0, corners = 0;
	bool dropped = false; /* the polygon has no shell */

	for (size_t i = 0; i < a->nring; i++) {
		struct area_ring r = a->ring[i];

		if (r.n) /* an area without corners has no memory for them */
			r.n = normal_ring(a->corner + r.first, r.n);
		if (r.shell)
			dropped = !r.n;
		if (dropped || (!r.shell && r.n < 3))
			continue;
		memmove(a->corner + corners, a->corner + r.first, r.n * sizeof *a->corner);
		r.first = corners;
		corners += r.n;
		a->ring[rings++] = r;
	}
	a->nring = rings;
	a->ncorner = corners;
}

size_t area_rings(const struct area *a)
{
	return a->nring;
}

size_t area_ring_at(const struct area *a, size_t i, bool *ret_shell, const int64_t (**ret)[2])
{
	*ret_shell = a->ring[i].shell;
	*ret = (const int64_t(*)[2])(a->corner + a->ring[i].first);
	return a->ring[i].n;
}
