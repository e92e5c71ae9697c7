/*
 * Triangles that were verified in an earlier turn. Their vertices keep their numbers as long as positions are only added, and all
 * that they depend on was loaded: pieces that are found later hide more, and show nothing.
 */
#include "constrain_priv.h"

#include <string.h>

/* Its corners from the lowest number on, which keeps their direction. */
static void corners_of(const struct constrain_work *w, uint32_t triangle, uint32_t ret[3])
{
	const uint32_t *c = w->r.triangle[triangle].corner;
	unsigned k = c[0] < c[1] ? (c[0] < c[2] ? 0 : 2) : (c[1] < c[2] ? 1 : 2);

	for (unsigned i = 0; i < 3; i++)
		ret[i] = c[(k + i) % 3];
}

static uint32_t (*place_of(const struct constrain_work *w, const uint32_t corner[3]))[3]
{
	uint64_t h = 0;

	for (unsigned i = 0; i < 3; i++)
		h = (h ^ corner[i]) * UINT64_C(0x9e3779b97f4a7c15);
	return &w->verified[(h >> 32) * w->nverified >> 32];
}

bool constrain_verified(const struct constrain_work *w, uint32_t triangle)
{
	uint32_t corner[3];

	corners_of(w, triangle, corner);
	return !memcmp(*place_of(w, corner), corner, sizeof(corner));
}

void constrain_verified_add(struct constrain_work *w, uint32_t triangle)
{
	uint32_t corner[3];

	corners_of(w, triangle, corner);
	memcpy(*place_of(w, corner), corner, sizeof(corner));
}

void constrain_verified_clear(struct constrain_work *w)
{
	memset(w->verified, 0, w->nverified * sizeof(*w->verified));
}
