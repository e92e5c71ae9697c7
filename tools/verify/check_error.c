/*
 * How far points lie above or below the surface of a mesh, exactly (check_file.h).
 *
 * A tree of boxes over the triangles, in Morton order of a corner, finds a triangle whose closed area holds the point; on an
 * edge all triangles give the same height. With weights w = the doubled areas across from the corners, D = their sum, the error
 * is N / D, N = sum of w (z of the point - z of the corner). Differences have 33 bits, so |w| < 2^67, |N| < 2^102: all is exact
 * in 128 bits. Two errors are compared as continued fractions.
 */
#include <stdlib.h>
#include <string.h>

#include "check_file.h"
#include "err.h"

/* Triangles of a leaf, and boxes below a box. */
enum { FAN = 8, LEVELS = 12 };

struct box {
	int32_t low[2], high[2];
};

struct order {
	uint64_t key;
	uint32_t triangle;
};

struct tree {
	const struct check_mesh *mesh;
	struct order *order;     /* triangles */
	struct box *box[LEVELS]; /* box[0]: of FAN triangles each; of the last level there is one */
	size_t n[LEVELS];
	unsigned levels;
};

static int order_compare(const void *a, const void *b)
{
	const struct order *p = a, *q = b;

	if (p->key != q->key)
		return p->key < q->key ? -1 : 1;
	return (p->triangle > q->triangle) - (p->triangle < q->triangle);
}

static struct box box_of(const struct tree *t, size_t i)
{
	const uint32_t *corner = t->mesh->triangle[t->order[i].triangle];
	struct box box = {{INT32_MAX, INT32_MAX}, {INT32_MIN, INT32_MIN}};

	for (unsigned c = 0; c < 3; c++)
		for (unsigned k = 0; k < 2; k++) {
			int32_t v = t->mesh->vertex[corner[c]][k];

			box.low[k] = v < box.low[k] ? v : box.low[k];
			box.high[k] = v > box.high[k] ? v : box.high[k];
		}
	return box;
}

static void box_add(struct box *box, struct box more)
{
	for (unsigned k = 0; k < 2; k++) {
		box->low[k] = more.low[k] < box->low[k] ? more.low[k] : box->low[k];
		box->high[k] = more.high[k] > box->high[k] ? more.high[k] : box->high[k];
	}
}

static void tree_free(struct tree *t)
{
	free(t->order);
	for (unsigned i = 0; i < t->levels; i++)
		free(t->box[i]);
}

static int tree_make(struct tree *t, const struct check_mesh *m, struct err *err)
{
	*t = (struct tree){.mesh = m, .order = malloc((m->ntriangle ? m->ntriangle : 1) * sizeof *t->order)};
	if (!t->order)
		return err_set(err, ERR_NOMEM, "no memory to search %zu triangles", m->ntriangle);
	for (size_t i = 0; i < m->ntriangle; i++) {
		const int32_t *at = m->vertex[m->triangle[i][0]];

		t->order[i] = (struct order){point_morton(at[0], at[1]), (uint32_t)i};
	}
	qsort(t->order, m->ntriangle, sizeof *t->order, order_compare);
	for (size_t below = m->ntriangle; below > 1 || !t->levels; below = t->n[t->levels - 1]) {
		size_t n = (below + FAN - 1) / FAN;
		struct box *box = malloc((n ? n : 1) * sizeof *box);

		if (!box)
			return err_set(err, ERR_NOMEM, "no memory to search %zu triangles", m->ntriangle);
		for (size_t i = 0; i < below; i++) {
			struct box one = t->levels ? t->box[t->levels - 1][i] : box_of(t, i);

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

/* False: the point is outside of the triangle. */
static bool error_in(const struct check_mesh *m, const uint32_t corner[3], const struct point *p, struct check_fraction *ret)
{
	const int32_t *v[3] = {m->vertex[corner[0]], m->vertex[corner[1]], m->vertex[corner[2]]};
	struct check_fraction f = {0, 0};

	for (unsigned k = 0; k < 3; k++) {
		__int128 w = doubled_area(v[(k + 1) % 3], v[(k + 2) % 3], p);

		if (w < 0)
			return false;
		f.up += w * ((int64_t)p->z - v[k][2]);
		f.down += w;
	}
	f.up = f.up < 0 ? -f.up : f.up;
	*ret = f;
	return f.down > 0;
}

static bool box_has(const struct box *box, const struct point *p)
{
	return p->x >= box->low[0] && p->x <= box->high[0] && p->y >= box->low[1] && p->y <= box->high[1];
}

/* False: no triangle has it. */
static bool error_at(const struct tree *t, const struct point *p, struct check_fraction *ret)
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
			if (error_in(t->mesh, t->mesh->triangle[t->order[j].triangle], p, ret))
				return true;
	}
}

int check_fraction_compare(struct check_fraction a, struct check_fraction b)
{
	int sign = 1;

	for (;;) {
		__int128 p = a.up / a.down, q = b.up / b.down;
		struct check_fraction c;

		if (p != q)
			return p < q ? -sign : sign;
		a.up -= p * a.down;
		b.up -= q * b.down;
		if (!a.up || !b.up)
			return a.up ? sign : b.up ? -sign : 0;
		/* Of two fractions below 1 the one whose inverse is larger is the smaller one. */
		c = a;
		a = (struct check_fraction){b.down, b.up};
		b = (struct check_fraction){c.down, c.up};
	}
}

int check_error(const struct check_mesh *m, const struct point *pts, size_t n, struct check_error *ret, struct err *err)
{
	struct tree t;
	int r = tree_make(&t, m, err);

	*ret = (struct check_error){.largest = {0, 1}};
	for (size_t i = 0; !r && i < n; i++) {
		struct check_fraction f;

		if (!error_at(&t, &pts[i], &f)) {
			if (!ret->outside++)
				ret->stray = pts[i];
			continue;
		}
		ret->inside++;
		if (check_fraction_compare(f, ret->largest) > 0) {
			ret->largest = f;
			ret->worst = pts[i];
		}
	}
	tree_free(&t);
	return r;
}
