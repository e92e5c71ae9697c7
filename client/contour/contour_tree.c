/*
 * Whether a triangle has a vertex of a cell in it.
 *
 * Vertices come by their keys, so eight of them in a row are near each other. They have a box, eight of these boxes have one, and
 * so on: no distribution of vertices is bad for it. A byte a box has a bit for each part that has vertices left.
 *
 * A vertex is outside if a line along a side of the triangle has all of the triangle on one side of it and the vertex on the
 * other. The doubles that decide it have bounds of their rounding: a vertex that is not certainly outside counts as inside.
 */
#include <math.h>
#include <stdlib.h>

#include "contour_simplify.h"
#include "err.h"

enum { EACH = 8, LEVELS = 12 };

struct box {
	double low[2], high[2];
};

struct contour_tree {
	const struct contour_vertex *vertex;
	size_t n;
	struct box *box;
	uint8_t *left;
	size_t first[LEVELS]; /* box of each level; level 0 has vertices */
	unsigned levels;
};

struct triangle {
	const double *const *corner;
	const uint32_t *but;
	struct box box;
	double area, error; /* twice its signed area, and the bound of the error */
};

int contour_tree_new(unsigned vertices, struct contour_tree **ret, struct err *err)
{
	struct contour_tree *t = calloc(1, sizeof(*t));
	size_t boxes = vertices / (EACH - 1) + 2 * LEVELS;

	if (t) {
		t->box = malloc(boxes * sizeof(*t->box));
		t->left = malloc(boxes);
	}
	if (!t || !t->box || !t->left) {
		contour_tree_free(t);
		return err_set(err, ERR_NOMEM, "no memory to simplify contours");
	}
	*ret = t;
	return 0;
}

struct contour_tree *contour_tree_free(struct contour_tree *t)
{
	if (t) {
		free(t->box);
		free(t->left);
	}
	free(t);
	return NULL;
}

/* ---- boxes ---- */

static void widen(struct box *b, const struct box *by)
{
	for (int i = 0; i < 2; i++) {
		b->low[i] = by->low[i] < b->low[i] ? by->low[i] : b->low[i];
		b->high[i] = by->high[i] > b->high[i] ? by->high[i] : b->high[i];
	}
}

static struct box box_of(const struct contour_tree *t, unsigned level, size_t i)
{
	const double *at = t->vertex[i].at;

	return level ? t->box[t->first[level - 1] + i] : (struct box){{at[0], at[1]}, {at[0], at[1]}};
}

void contour_tree_fill(struct contour_tree *t, const struct contour_vertex *vertex, size_t n)
{
	size_t parts = n, used = 0;

	t->vertex = vertex;
	t->n = n;
	t->levels = 0;
	do {
		t->first[t->levels] = used;
		for (size_t i = 0; i < parts; i++) {
			struct box b = box_of(t, t->levels, i);

			if (i % EACH == 0) {
				t->box[used] = b;
				t->left[used++] = 0;
			}
			widen(&t->box[used - 1], &b);
			t->left[used - 1] |= (uint8_t)(1u << i % EACH);
		}
		parts = used - t->first[t->levels++];
	} while (parts > 1);
}

void contour_tree_remove(struct contour_tree *t, uint32_t vertex)
{
	size_t i = vertex;

	for (unsigned level = 0; level < t->levels; level++, i /= EACH) {
		uint8_t *left = &t->left[t->first[level] + i / EACH];

		*left &= (uint8_t) ~(1u << i % EACH);
		if (*left)
			return;
	}
}

/* ---- the triangle ---- */

/* Twice the signed area of a, b, q, and a bound of its error: that of Shewchuk's first filter, made larger, and room for what is
 * too small for a double. */
static double turn(const double *a, const double *b, const double *q, double *ret_error)
{
	double l = (a[0] - q[0]) * (b[1] - q[1]), r = (a[1] - q[1]) * (b[0] - q[0]);

	*ret_error = 0x1p-50 * (fabs(l) + fabs(r)) + 0x1p-1000;
	return l - r;
}

static bool beyond(const struct triangle *t, double low, double high)
{
	double least = t->area - t->error, most = t->area + t->error;

	return low > (most > 0 ? most : 0) || high < (least < 0 ? least : 0);
}

static bool apart(const struct box *a, const struct box *b)
{
	return a->low[0] > b->high[0] || a->high[0] < b->low[0] || a->low[1] > b->high[1] || a->high[1] < b->low[1];
}

static bool is_outside(const struct triangle *t, const double *q)
{
	const struct box at = {{q[0], q[1]}, {q[0], q[1]}};

	if (apart(&t->box, &at))
		return true;
	for (int i = 0; i < 3; i++) {
		double error, side = turn(t->corner[i], t->corner[(i + 1) % 3], q, &error);

		if (beyond(t, side - error, side + error))
			return true;
	}
	return false;
}

/* All of the box is beyond the side between the ends of the new segment, or of the triangle's other side there. */
static bool is_beside(const struct triangle *t, const struct box *b)
{
	const double *from = t->corner[2], *to = t->corner[0];
	const double middle[2] = {(b->low[0] + b->high[0]) / 2, (b->low[1] + b->high[1]) / 2};
	double half[2] = {b->high[0] - b->low[0], b->high[1] - b->low[1]}; /* more than half: this need not be tight */
	double error, side = turn(from, to, middle, &error);
	double reach = fabs(to[1] - from[1]) * half[0] + fabs(to[0] - from[0]) * half[1];

	reach += error + 0x1p-40 * reach;
	return beyond(t, side - reach, side + reach);
}

static bool counts(const struct triangle *t, size_t vertex)
{
	for (int i = 0; i < CONTOUR_BUT; i++)
		if (t->but[i] == vertex)
			return false;
	return true;
}

static bool is_in(const struct contour_tree *t, const struct triangle *g, size_t vertex)
{
	return counts(g, vertex) && !is_outside(g, t->vertex[vertex].at);
}

static bool meets(const struct contour_tree *t, const struct triangle *g, unsigned level, size_t node, uint32_t *found)
{
	const struct box *b = &t->box[t->first[level] + node];

	if (apart(b, &g->box) || is_beside(g, b))
		return false;
	for (unsigned bits = t->left[t->first[level] + node]; bits; bits &= bits - 1) {
		size_t part = node * EACH + (unsigned)__builtin_ctz(bits);

		if (level ? meets(t, g, level - 1, part, found) : is_in(t, g, part)) {
			*found = level ? *found : (uint32_t)part;
			return true;
		}
	}
	return false;
}

bool contour_tree_meets(const struct contour_tree *t, const double *const corner[3], const uint32_t but[CONTOUR_BUT],
			uint32_t *found)
{
	struct triangle g = {.corner = corner, .but = but};

	for (int i = 0; i < 3; i++) {
		const struct box at = {{corner[i][0], corner[i][1]}, {corner[i][0], corner[i][1]}};

		if (!i)
			g.box = at;
		widen(&g.box, &at);
	}
	g.area = turn(corner[0], corner[1], corner[2], &g.error);
	if (*found != CONTOUR_NONE && t->left[*found / EACH] >> *found % EACH & 1 && is_in(t, &g, *found))
		return true;
	return meets(t, &g, t->levels - 1, 0, found);
}
