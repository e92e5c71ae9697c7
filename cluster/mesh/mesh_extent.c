/*
 * Where the domains of a pack are, as a text of at most some KiB in the record of its task: their box, and up to 64 groups of
 * domains in the order of the pack, each with its box and its triangles. So a task of gather chooses what it reads without
 * opening packs.
 *
 * All groups have the same number of domains, a power of two, but the last one, which may have fewer.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cut.h"
#include "err.h"
#include "mesh_priv.h"
#include "store_pack.h"

/* Of a group with its separator; of the whole text. */
enum { GROUP = 2 * 21 + 4 * 12 + 1, TEXT = 24 + MESH_GROUPS * GROUP, SOME = 16 };

static const int32_t nowhere[4] = {INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN};

static void box_add(int32_t *box, const int32_t *more, int axes)
{
	for (int i = 0; i < axes; i++) {
		box[i] = more[i] < box[i] ? more[i] : box[i];
		box[i + axes] = more[i + axes] > box[i + axes] ? more[i + axes] : box[i + axes];
	}
}

void mesh_box_begin(int32_t box[6])
{
	for (int i = 0; i < 6; i++)
		box[i] = i < 3 ? INT32_MAX : INT32_MIN;
}

void mesh_box_add(int32_t box[6], const int32_t more[6])
{
	box_add(box, more, 3);
}

static uint64_t sum_of(uint64_t a, uint64_t b)
{
	return a + b < a ? UINT64_MAX : a + b;
}

static void group_add(struct mesh_group *to, const struct mesh_group *g)
{
	to->triangles += g->triangles;
	to->area = sum_of(to->area, g->area);
	box_add(to->box, g->box, 2);
}

/* The part of a domain's region that its box covers. Regions do not overlap, as the boxes of their domains do. */
static uint64_t area_of(const struct store_pack_entry *e)
{
	unsigned __int128 area = 1;
	struct cut_region region;
	int64_t box[4];

	if (!cut_region_parse(e->region, &region))
		return 0; /* it is refused when the domain is read */
	cut_region_box(&region, box);
	for (int i = 0; i < 2; i++) {
		int64_t low = box[i] > 2 * (int64_t)e->box[i] ? box[i] : 2 * (int64_t)e->box[i],
			high = box[i + 2] < 2 * (int64_t)e->box[i + 3] ? box[i + 2] : 2 * (int64_t)e->box[i + 3];

		area *= high > low ? (uint64_t)(high - low) : 0;
	}
	area /= 4; /* the numbers were doubled */
	return area > UINT64_MAX ? UINT64_MAX : (uint64_t)area;
}

/* Two groups become one. */
static void halve(struct mesh_extent *x)
{
	for (uint32_t i = 0; i < x->n; i += 2) {
		x->group[i / 2] = x->group[i];
		group_add(&x->group[i / 2], &x->group[i + 1]);
	}
	x->n /= 2;
	x->each *= 2;
}

void mesh_extent_begin(struct mesh_extent *x)
{
	*x = (struct mesh_extent){.each = 1};
	mesh_box_begin(x->box);
}

void mesh_extent_add(struct mesh_extent *x, const struct store_pack_entry *e)
{
	struct mesh_group own = {.triangles = 0};
	const uint64_t memory = store_pack_memory(e);

	if (x->n == MESH_GROUPS && x->domains == x->n * x->each)
		halve(x);
	memcpy(own.box, nowhere, sizeof nowhere);
	if (x->domains == x->n * x->each)
		x->group[x->n++] = own;
	x->domains++;
	x->largest = memory > x->largest ? memory : x->largest;
	if (!e->nvertex)
		return;
	mesh_box_add(x->box, e->box);
	if (!e->ntriangle)
		return;
	own = (struct mesh_group){
		.triangles = e->ntriangle, .area = area_of(e), .box = {e->box[0], e->box[1], e->box[3], e->box[4]}};
	group_add(&x->group[x->n - 1], &own);
}

bool mesh_extent_same(const struct mesh_extent *a, const struct mesh_extent *b)
{
	bool same = a->domains == b->domains && a->each == b->each && a->n == b->n && a->largest == b->largest &&
		    !memcmp(a->box, b->box, sizeof a->box);

	for (uint32_t i = 0; same && i < a->n; i++)
		same = a->group[i].triangles == b->group[i].triangles && a->group[i].area == b->group[i].area &&
		       !memcmp(a->group[i].box, b->group[i].box, sizeof a->group[i].box);
	return same;
}

/* ---- records ---- */

int extent_of_pack(int fd, const char *name, struct mesh_extent *ret, struct err *err)
{
	struct store_pack_entry entry[SOME];
	struct store_pack pack;
	int r = store_pack_open(fd, name, &pack, err);

	mesh_extent_begin(ret);
	for (uint64_t first = 0; !r && first < pack.n; first += SOME) {
		const size_t n = pack.n - first < SOME ? (size_t)(pack.n - first) : SOME;

		r = store_pack_entries(&pack, first, n, entry, err);
		for (size_t i = 0; !r && i < n; i++)
			mesh_extent_add(ret, &entry[i]);
	}
	return r;
}

int extent_record(struct work_attempt *a, const struct mesh_extent *x, struct err *err)
{
	char text[TEXT];
	int n, r = work_result_u64(a, "largest", x->largest, err);

	snprintf(text, sizeof text, "%" PRId32 " %" PRId32 " %" PRId32 " %" PRId32 " %" PRId32 " %" PRId32, x->box[0], x->box[1],
		 x->box[2], x->box[3], x->box[4], x->box[5]);
	if (!r)
		r = work_result(a, "box", text, err);
	n = snprintf(text, sizeof text, "%" PRIu64, x->each);
	for (uint32_t i = 0; i < x->n; i++) {
		const struct mesh_group *g = &x->group[i];

		n += snprintf(text + n, sizeof text - (size_t)n,
			      ",%" PRIu64 " %" PRIu64 " %" PRId32 " %" PRId32 " %" PRId32 " %" PRId32, g->triangles, g->area,
			      g->box[0], g->box[1], g->box[2], g->box[3]);
	}
	return r ? r : work_result(a, "groups", text, err);
}

static bool groups_read(const char *text, const struct mesh_sums *sums, struct mesh_extent *x)
{
	uint64_t triangles = 0;
	int n = 0;

	if (sscanf(text, "%" SCNu64 "%n", &x->each, &n) != 1 || !x->each || (x->each & (x->each - 1)))
		return false;
	for (text += n; *text; text += n) {
		struct mesh_group *g = &x->group[x->n];

		if (x->n == MESH_GROUPS ||
		    sscanf(text, ",%" SCNu64 " %" SCNu64 " %" SCNd32 " %" SCNd32 " %" SCNd32 " %" SCNd32 "%n", &g->triangles,
			   &g->area, &g->box[0], &g->box[1], &g->box[2], &g->box[3], &n) != 6)
			return false;
		triangles += g->triangles;
		x->n++;
	}
	return triangles == sums->triangles && x->n == sums->domains / x->each + (sums->domains % x->each != 0);
}

int extent_read(const struct work_record *record, const struct mesh_sums *sums, struct mesh_extent *ret, struct err *err)
{
	const char *box = work_record_text(record, "box"), *groups = work_record_text(record, "groups");
	struct mesh_extent x = {.domains = sums->domains};
	int r = work_record_u64(record, "largest", &x.largest, err);

	if (r)
		return r;
	if (!box || !groups || !groups_read(groups, sums, &x) ||
	    sscanf(box, "%" SCNd32 " %" SCNd32 " %" SCNd32 " %" SCNd32 " %" SCNd32 " %" SCNd32, &x.box[0], &x.box[1], &x.box[2],
		   &x.box[3], &x.box[4], &x.box[5]) != 6)
		return err_set(err, ERR_CORRUPT, "the record of mesh %" PRIu32 " does not say where its domains are",
			       record->task);
	*ret = x;
	return 0;
}
