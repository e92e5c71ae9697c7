/*
 * Where the domains of a pack are, as a text of at most some KiB in the record of its task: their box, and up to 64 groups of
 * domains in the order of the pack, each with its boxes, its vertices and its triangles. So a task of gather chooses what it
 * reads without opening packs, and knows by sums what comes before.
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
enum { GROUP = 3 * 21 + 8 * 12 + 1, TEXT = 24 + MESH_GROUPS * GROUP, SOME = 16 };

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

struct mesh_group mesh_group_none(void)
{
	struct mesh_group g = {.vertices = 0};

	memcpy(g.box, nowhere, sizeof nowhere);
	memcpy(g.region, nowhere, sizeof nowhere);
	return g;
}

void mesh_group_add(struct mesh_group *to, const struct mesh_group *g)
{
	to->vertices += g->vertices;
	to->triangles += g->triangles;
	to->area = sum_of(to->area, g->area);
	box_add(to->box, g->box, 2);
	box_add(to->region, g->region, 2);
}

/* The part of a domain's region that its box covers. Regions do not overlap, as the boxes of their domains do. */
static uint64_t area_of(const struct store_pack_entry *e, const int64_t box[4])
{
	unsigned __int128 area = 1;

	for (int i = 0; i < 2; i++) {
		int64_t low = box[i] > 2 * (int64_t)e->box[i] ? box[i] : 2 * (int64_t)e->box[i],
			high = box[i + 2] < 2 * (int64_t)e->box[i + 3] ? box[i + 2] : 2 * (int64_t)e->box[i + 3];

		area *= high > low ? (uint64_t)(high - low) : 0;
	}
	area /= 4; /* the numbers were doubled */
	return area > UINT64_MAX ? UINT64_MAX : (uint64_t)area;
}

/* The positions that a region holds. Its borders are between two of them, infinite ones beyond all. */
static void positions_of(const int64_t box[4], int32_t ret[4])
{
	for (int i = 0; i < 4; i++) {
		const int64_t at = box[i] == INT64_MIN || box[i] == INT64_MAX ? box[i] : (box[i] + (i < 2 ? 1 : -1)) / 2;

		ret[i] = at < INT32_MIN ? INT32_MIN : at > INT32_MAX ? INT32_MAX : (int32_t)at;
	}
}

/* Two groups become one. */
static void halve(struct mesh_extent *x)
{
	for (uint32_t i = 0; i < x->n; i += 2) {
		x->group[i / 2] = x->group[i];
		mesh_group_add(&x->group[i / 2], &x->group[i + 1]);
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
	struct mesh_group own = mesh_group_none();
	const uint64_t memory = store_pack_memory(e);
	struct cut_region region;
	int64_t box[4];

	if (x->n == MESH_GROUPS && x->domains == x->n * x->each)
		halve(x);
	if (x->domains == x->n * x->each)
		x->group[x->n++] = own;
	x->domains++;
	x->largest = memory > x->largest ? memory : x->largest;
	own.vertices = e->own;
	if (cut_region_parse(e->region, &region)) { /* another one is refused when the domain is read */
		cut_region_box(&region, box);
		positions_of(box, own.region);
		own.area = e->nvertex && e->ntriangle ? area_of(e, box) : 0;
	}
	if (e->nvertex)
		mesh_box_add(x->box, e->box);
	if (e->nvertex && e->ntriangle) {
		own.triangles = e->ntriangle;
		memcpy(own.box, (const int32_t[]){e->box[0], e->box[1], e->box[3], e->box[4]}, sizeof own.box);
	}
	mesh_group_add(&x->group[x->n - 1], &own);
}

static bool group_same(const struct mesh_group *a, const struct mesh_group *b)
{
	return a->vertices == b->vertices && a->triangles == b->triangles && a->area == b->area &&
	       !memcmp(a->box, b->box, sizeof a->box) && !memcmp(a->region, b->region, sizeof a->region);
}

bool mesh_extent_same(const struct mesh_extent *a, const struct mesh_extent *b)
{
	bool same = a->domains == b->domains && a->each == b->each && a->n == b->n && a->largest == b->largest &&
		    !memcmp(a->box, b->box, sizeof a->box);

	for (uint32_t i = 0; same && i < a->n; i++)
		same = group_same(&a->group[i], &b->group[i]);
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

int mesh_extent_record(struct work_attempt *a, const struct mesh_extent *x, struct err *err)
{
	char text[6 * 12];
	int r = work_result_u64(a, "largest", x->largest, err);

	snprintf(text, sizeof text, "%" PRId32 " %" PRId32 " %" PRId32 " %" PRId32 " %" PRId32 " %" PRId32, x->box[0], x->box[1],
		 x->box[2], x->box[3], x->box[4], x->box[5]);
	return r ? r : work_result(a, "box", text, err);
}

int mesh_extent_read(const struct work_record *record, struct mesh_extent *ret, struct err *err)
{
	const char *box = work_record_text(record, "box");
	int32_t *b = ret->box;
	int r = work_record_u64(record, "largest", &ret->largest, err);

	if (!r && (!box || sscanf(box, "%" SCNd32 " %" SCNd32 " %" SCNd32 " %" SCNd32 " %" SCNd32 " %" SCNd32, &b[0], &b[1],
				  &b[2], &b[3], &b[4], &b[5]) != 6))
		r = err_set(err, ERR_CORRUPT, "the record of %s %" PRIu32 " does not say where its domains are",
			    work_phase_text(record->phase), record->task);
	return r;
}

int extent_record(struct work_attempt *a, const struct mesh_extent *x, struct err *err)
{
	char text[TEXT];
	int n = snprintf(text, sizeof text, "%" PRIu64, x->each), r = mesh_extent_record(a, x, err);

	for (uint32_t i = 0; i < x->n; i++) {
		const struct mesh_group *g = &x->group[i];

		n += snprintf(text + n, sizeof text - (size_t)n, ",%" PRIu64 " %" PRIu64 " %" PRIu64, g->vertices, g->triangles,
			      g->area);
		for (int k = 0; k < 8; k++)
			n += snprintf(text + n, sizeof text - (size_t)n, " %" PRId32, k < 4 ? g->box[k] : g->region[k - 4]);
	}
	return r ? r : work_result(a, "groups", text, err);
}

/* A group as in the text; returns what follows, or NULL. */
static const char *group_read(const char *text, struct mesh_group *g)
{
	int n = 0;

	if (sscanf(text, ",%" SCNu64 " %" SCNu64 " %" SCNu64 "%n", &g->vertices, &g->triangles, &g->area, &n) != 3)
		return NULL;
	for (int k = 0; k < 8; k++) {
		text += n;
		if (sscanf(text, " %" SCNd32 "%n", k < 4 ? &g->box[k] : &g->region[k - 4], &n) != 1)
			return NULL;
	}
	return text + n;
}

static bool groups_read(const char *text, const struct mesh_sums *sums, struct mesh_extent *x)
{
	struct mesh_group all = mesh_group_none();
	int n = 0;

	if (sscanf(text, "%" SCNu64 "%n", &x->each, &n) != 1 || !x->each || (x->each & (x->each - 1)))
		return false;
	for (text += n; *text;) {
		if (x->n == MESH_GROUPS || !(text = group_read(text, &x->group[x->n])))
			return false;
		mesh_group_add(&all, &x->group[x->n++]);
	}
	return all.triangles == sums->triangles && all.vertices == sums->vertices &&
	       x->n == sums->domains / x->each + (sums->domains % x->each != 0);
}

int extent_read(const struct work_record *record, const struct mesh_sums *sums, struct mesh_extent *ret, struct err *err)
{
	const char *groups = work_record_text(record, "groups");
	struct mesh_extent x = {.domains = sums->domains};
	int r = mesh_extent_read(record, &x, err);

	if (!r && (!groups || !groups_read(groups, sums, &x)))
		r = err_set(err, ERR_CORRUPT, "the record of mesh %" PRIu32 " does not say where its domains are", record->task);
	if (!r)
		*ret = x;
	return r;
}
