/*
 * Which triangle of a mesh has a position (check_file.h): a tree of boxes over the triangles, in Morton order of a corner.
 */
#include <stdlib.h>
#include <string.h>

#include "check_file.h"
#include "err.h"

/* Triangles of a leaf, and boxes below a box. */
enum { FAN = 8, LEVELS = CHECK_LEVELS };

struct check_box {
	int32_t low[2], high[2];
};

struct check_order {
	uint64_t key;
	uint32_t triangle;
};

static int order_compare(const void *a, const void *b)
{
	const struct check_order *p = a, *q = b;

	if (p->key != q->key)
		return p->key < q->key ? -1 : 1;
	return (p->triangle > q->triangle) - (p->triangle < q->triangle);
}

static struct check_box box_of(const struct check_tree *t, size_t i)
{
	const uint32_t *corner = t->mesh->triangle[t->order[i].triangle];
	struct check_box box = {{INT32_MAX, INT32_MAX}, {INT32_MIN, INT32_MIN}};

	for (unsigned c = 0; c < 3; c++)
		for (unsigned k = 0; k < 2; k++) {
			int32_t v = t->mesh->vertex[corner[c]][k];

			box.low[k] = v < box.low[k] ? v : box.low[k];
			box.high[k] = v > box.high[k] ? v : box.high[k];
		}
	return box;
}

static void box_add(struct check_box *box, struct check_box more)
{
	for (unsigned k = 0; k < 2; k++) {
		box->low[k] = more.low[k] < box->low[k] ? more.low[k] : box->low[k];
		box->high[k] = more.high[k] > box->high[k] ? more.high[k] : box->high[k];
	}
}

void check_tree_free(struct check_tree *t)
{
	free(t->order);
	for (unsigned i = 0; i < t->levels; i++)
		free(t->box[i]);
}

int check_tree_make(struct check_tree *t, const struct check_mesh *m, struct err *err)
{
	*t = (struct check_tree){.mesh = m, .order = malloc((m->ntriangle ? m->ntriangle : 1) * sizeof *t->order)};
	if (!t->order)
		return err_set(err, ERR_NOMEM, "no memory to search %zu triangles", m->ntriangle);
	for (size_t i = 0; i < m->ntriangle; i++) {
		const int32_t *at = m->vertex[m->triangle[i][0]];

		t->order[i] = (struct check_order){point_morton(at[0], at[1]), (uint32_t)i};
	}
	qsort(t->order, m->ntriangle, sizeof *t->order, order_compare);
	for (size_t below = m->ntriangle; below > 1 || !t->levels; below = t->n[t->levels - 1]) {
		size_t n = (below + FAN - 1) / FAN;
		struct check_box *box = malloc((n ? n : 1) * sizeof *box);

		if (!box)
			return err_set(err, ERR_NOMEM, "no memory to search %zu triangles", m->ntriangle);
		for (size_t i = 0; i < below; i++) {
			struct check_box one = t->levels ? t->box[t->levels - 1][i] : box_of(t, i);

			if (i % FAN)
				box_add(&box[i / FAN], one);
			else
				box[i / FAN] = one;
		}
		t->n[t->levels] = n;
		t->box[t->levels++] = box;
	}
	return 0;
}

static __int128 doubled_area(const int32_t a[3], const int32_t b[3], const struct point *p)
{
	return (__int128)((int64_t)b[0] - a[0]) * ((int64_t)p->y - a[1]) -
	       (__int128)((int64_t)b[1] - a[1]) * ((int64_t)p->x - a[0]);
}

static bool box_has(const struct check_box *box, const struct point *p)
{
	return p->x >= box->low[0] && p->x <= box->high[0] && p->y >= box->low[1] && p->y <= box->high[1];
}

/* False: the position is outside of the triangle. */
static bool triangle_has(const struct check_mesh *m, uint32_t triangle, const struct point *p, __int128 ret_area[3])
{
	const uint32_t *corner = m->triangle[triangle];

	for (unsigned k = 0; k < 3; k++) {
		ret_area[k] = doubled_area(m->vertex[corner[(k + 1) % 3]], m->vertex[corner[(k + 2) % 3]], p);
		if (ret_area[k] < 0)
			return false;
	}
	return ret_area[0] + ret_area[1] + ret_area[2] > 0;
}

bool check_tree_find(const struct check_tree *t, const struct point *p, uint32_t *ret, __int128 ret_area[3])
{
	size_t at[LEVELS] = {0};
	unsigned level = t->levels - 1;

	/* at[level]: the next box of this level, within its parent */
	for (;;) {
		size_t i = at[level], end = level + 1 < t->levels ? at[level + 1] * FAN : 1;

		end = end < t->n[level] ? end : t->n[level];
		if (i >= end) {
			if (++level == t->levels)
				return false;
			continue;
		}
		at[level]++;
		if (!box_has(&t->box[level][i], p))
			continue;
		if (level) {
			at[--level] = i * FAN;
			continue;
		}
		for (size_t j = i * FAN; j < (i + 1) * FAN && j < t->mesh->ntriangle; j++)
			if (triangle_has(t->mesh, t->order[j].triangle, p, ret_area)) {
				*ret = t->order[j].triangle;
				return true;
			}
	}
}
