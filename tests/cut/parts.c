#include "parts.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "geom.h"

static int compare(const void *a, const void *b)
{
	return memcmp(a, b, 9 * sizeof(int32_t));
}

void parts_add(struct parts_mesh *m, const int32_t at[3][3])
{
	unsigned first = 0;

	for (unsigned i = 1; i < 3; i++)
		if (geom_less(at[i], at[first]))
			first = i;
	assert_true(m->n < PARTS_TRIANGLES);
	for (unsigned i = 0; i < 3; i++)
		memcpy(&m->triangle[m->n][3 * i], at[(first + i) % 3], sizeof at[0]);
	m->n++;
}

void parts_sort(struct parts_mesh *m)
{
	qsort(m->triangle, m->n, sizeof *m->triangle, compare);
}

bool parts_same(const struct parts_mesh *a, const struct parts_mesh *b)
{
	return a->n == b->n && !memcmp(a->triangle, b->triangle, a->n * sizeof *a->triangle);
}

void parts_corners(const struct mesh_domain *d, uint32_t triangle, int32_t ret[3][3])
{
	for (unsigned k = 0; k < 3; k++) {
		assert_true(d->triangle[triangle][k] < d->nvertex);
		memcpy(ret[k], &d->vertex[d->triangle[triangle][k]], sizeof ret[k]);
	}
}

unsigned parts_halve(uint64_t *seed, unsigned want, unsigned tries, struct cut_region *ret)
{
	unsigned n = 1;

	for (; n < want && tries > 0; tries--) {
		unsigned i = sets_below(seed, n);
		struct cut_region half[2];

		if (!cut_region_split(&ret[i], half))
			continue;
		ret[i] = half[0];
		ret[n++] = half[1];
	}
	return n;
}

unsigned parts_make(uint64_t *seed, const struct cut_source *src, unsigned most, struct cut_region *ret)
{
	unsigned want = 1 + sets_below(seed, sets_below(seed, 3) ? 12 : most);
	int32_t box[4];

	assert_true(src->box(src->ctx, box));
	cut_region_root(box, &ret[0]);
	return parts_halve(seed, want, 200, ret);
}
