#include "sets.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "cut_order.h"
#include "err.h"

unsigned sets_below(uint64_t *seed, unsigned n)
{
	return (unsigned)(random_next(seed) % n);
}

static int32_t corner(uint64_t *seed)
{
	static const int32_t at[5] = {INT32_MIN, INT32_MIN + 1, 0, INT32_MAX - 1, INT32_MAX};

	return at[sets_below(seed, 5)];
}

static void place(uint64_t *seed, unsigned family, unsigned i, int32_t range, const int32_t base[2], int32_t ret[2])
{
	static const int32_t circle[12][2] = {{5, 0},  {4, 3},   {3, 4},   {0, 5},  {-3, 4}, {-4, 3},
					      {-5, 0}, {-4, -3}, {-3, -4}, {0, -5}, {3, -4}, {4, -3}};
	int32_t r = (int32_t)sets_below(seed, (unsigned)range + 1), s = (int32_t)sets_below(seed, (unsigned)range + 1);

	switch (family) {
	case 0: /* full range */
		ret[0] = (int32_t)random_next(seed);
		ret[1] = (int32_t)random_next(seed);
		return;
	case 1:
		ret[0] = corner(seed);
		ret[1] = corner(seed);
		return;
	case 2: /* on a line, sometimes one beside it */
		ret[0] = base[0] + 7 * r;
		ret[1] = base[1] + (base[0] & 1 ? 7 : base[0] & 2 ? -3 : 0) * r + (sets_below(seed, 40) == 0);
		return;
	case 3: /* two clusters */
		ret[0] = base[0] + r + (i & 1 ? 1000000 : 0);
		ret[1] = base[1] + s + (i & 1 ? 700000 : 0);
		return;
	case 4: /* cocircular */
		ret[0] = base[0] + circle[i % 12][0] * (1 + (base[1] & 1023)) * (i < 24 ? 1 : 3);
		ret[1] = base[1] + circle[i % 12][1] * (1 + (base[1] & 1023)) * (i < 24 ? 1 : 3);
		return;
	case 5: /* a grid with an odd step: circumcentres on possible cuts */
		ret[0] = base[0] + 3 * (int32_t)(i % 7);
		ret[1] = base[1] + 3 * (int32_t)(i / 7);
		return;
	case 6: /* the far ends of the lattice */
		ret[0] = (i & 1) ? INT32_MAX - r : INT32_MIN + r;
		ret[1] = (i & 2) ? INT32_MAX - s : INT32_MIN + s;
		return;
	default:
		ret[0] = base[0] + r;
		ret[1] = base[1] + s;
	}
}

static struct point record_at(uint64_t *seed, const int32_t at[2])
{
	struct point p = {.x = at[0],
			  .y = at[1],
			  .z = (int32_t)sets_below(seed, 4),
			  .cls = (uint8_t)(1 + sets_below(seed, 2)),
			  .ret = 0x11};

	if (sets_below(seed, 12) == 0)
		p.cls = 7;
	if (sets_below(seed, 12) == 0)
		p.tag = POINT_WITHHELD;
	return p;
}

static bool point_less(const void *ctx, const struct point *a, const struct point *b)
{
	return point_compare(a, b) < 0;
}

void sets_reduce(struct sets *set, const struct view *view)
{
	struct point kept[TILING_SEGMENTS * SETS_MAX_RECORDS];
	size_t n = 0;

	for (unsigned s = 0; s < set->segments; s++)
		for (size_t i = 0; i < set->nrecord[s]; i++)
			if (view_judge(view, &set->record[s][i]) == VIEW_KEPT)
				kept[n++] = set->record[s][i];
	set->n = 0;
	set->all_kept = true;
	for (unsigned s = 0; s < set->segments; s++)
		for (size_t i = 0; i < set->nrecord[s]; i++)
			set->all_kept = set->all_kept && view_judge(view, &set->record[s][i]) == VIEW_KEPT;
	for (size_t i = 0; i < n; i++) {
		bool best = true;

		for (size_t k = 0; k < n && best; k++)
			if (k != i && kept[k].x == kept[i].x && kept[k].y == kept[i].y &&
			    (view_prefers(view, &kept[k], &kept[i]) || (k < i && !view_prefers(view, &kept[i], &kept[k]))))
				best = false;
		if (best)
			set->pos[set->n++] = (struct mesh_vertex){kept[i].x, kept[i].y, kept[i].z};
	}
	for (unsigned i = 1; i < set->n; i++)
		for (unsigned j = i;
		     j > 0 && point_morton(set->pos[j].x, set->pos[j].y) < point_morton(set->pos[j - 1].x, set->pos[j - 1].y);
		     j--) {
			struct mesh_vertex t = set->pos[j];

			set->pos[j] = set->pos[j - 1];
			set->pos[j - 1] = t;
		}
}

void sets_make(uint64_t *seed, struct sets *set, struct view *view)
{
	unsigned family = sets_below(seed, 16), n = 3 + sets_below(seed, sets_below(seed, 4) ? 20 : SETS_MAX_N - 2);
	int32_t range = sets_below(seed, 3) ? (int32_t)sets_below(seed, 6) : (int32_t)sets_below(seed, 200);
	int32_t base[2] = {(int32_t)sets_below(seed, 100000) - 50000, (int32_t)sets_below(seed, 100000) - 50000};

	if (sets_below(seed, 3) == 0)
		base[0] = base[1] = -(int32_t)sets_below(seed, 4); /* across the highest cut */
	*view = VIEW_INIT;
	view->duplicates = sets_below(seed, 2) ? VIEW_LOWEST : VIEW_HIGHEST;
	view->keep_withheld = sets_below(seed, 2);
	view->keep_noise = sets_below(seed, 2);
	view->has_zmax = sets_below(seed, 8) == 0;
	view->zmax = sets_below(seed, 3);
	set->segments = 1 + sets_below(seed, 2) * sets_below(seed, TILING_SEGMENTS);
	memset(set->nrecord, 0, sizeof(set->nrecord));
	for (unsigned i = 0; i < n; i++) {
		int32_t at[2];

		place(seed, family, i, range, base, at);
		for (unsigned k = sets_below(seed, 6) ? 1 : 1 + sets_below(seed, 4); k > 0; k--) {
			unsigned s = sets_below(seed, set->segments);

			set->record[s][set->nrecord[s]++] = record_at(seed, at);
		}
	}
	for (unsigned s = 0; s < set->segments; s++)
		cut_order_sort(set->record[s], set->nrecord[s], point_less, NULL);
	sets_reduce(set, view);
}

/* Sources with weights: what a record is of does not depend on its class, position or segment. Slots and weights as the text of a
 * view gives them. */
static void draw_sources(uint64_t *seed, struct sets *set, struct view *view)
{
	const struct slots *slots;
	struct slots_list list = {NULL, 0, 0};
	unsigned sources = 1 + sets_below(seed, 5), size = sets_below(seed, 4);
	struct err err = ERR_INIT;

	for (uint32_t i = 1; i <= sources; i++)
		if (sets_below(seed, 3))
			assert_true(slots_list_add(
				&list, i, i,
				(int32_t)sets_below(seed, size < 3 ? 3 + 5 * size : 1u << (10 + sets_below(seed, 21)))));
	assert_int_equal(view_weight_sources(view, &list, &err), 0);
	slots_list_free(&list);
	slots = view->slots;
	for (unsigned s = 0; slots && s < set->segments; s++)
		for (size_t i = 0; i < set->nrecord[s]; i++) {
			uint8_t slot = slots_of(slots, 1 + sets_below(seed, sources));

			set->record[s][i].tag |= (uint16_t)((unsigned)slot << POINT_SLOT_SHIFT);
		}
}

void sets_weights(uint64_t *seed, struct sets *set, struct view *view)
{
	static const uint8_t classes[] = {1, 2, 7};
	unsigned size = sets_below(seed, 5);

	for (unsigned i = 0; i < 3; i++) {
		uint32_t most = size < 3 ? 3 + 4 * size : size == 3 ? 1000 : 1u << (10 + sets_below(seed, 21));

		if (sets_below(seed, 4))
			view_weight_set(view, classes[i], (int32_t)sets_below(seed, most + 1));
	}
	view->slots = NULL;
	if (sets_below(seed, 2))
		draw_sources(seed, set, view);
	sets_reduce(set, view);
}

uint8_t sets_weight_of(const struct sets *set, const struct view *view, const struct mesh_vertex *v)
{
	const struct point *best = NULL;

	for (unsigned s = 0; s < set->segments; s++)
		for (size_t i = 0; i < set->nrecord[s]; i++) {
			const struct point *p = &set->record[s][i];

			if (p->x == v->x && p->y == v->y && view_judge(view, p) == VIEW_KEPT &&
			    (!best || view_prefers(view, p, best)))
				best = p;
		}
	assert_non_null(best);
	assert_int_equal(best->z, v->z);
	return view_weight_of(view, best);
}

void sets_tiling(uint64_t *seed, struct sets *set, struct tiling *t)
{
	*t = (struct tiling){.segments = set->segments, .salt = random_next(seed)};
	t->cell_records = sets_below(seed, 4) ? 1 + sets_below(seed, 6) : 1000;
	for (unsigned s = 0; s < set->segments; s++) {
		t->pts[s] = set->record[s];
		t->n[s] = set->nrecord[s];
	}
}
