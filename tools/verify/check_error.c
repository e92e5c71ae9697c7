/*
 * How far points lie above or below the surface of a mesh, exactly (check_file.h).
 *
 * On an edge all triangles give the same height. With weights w = the doubled areas across from the corners, D = their sum, the
 * error is N / D, N = sum of w (z of the point - z of the corner). Differences have 33 bits, so |w| < 2^67, |N| < 2^102: all is
 * exact in 128 bits. Two errors are compared as continued fractions.
 */

#include "check_file.h"
#include "err.h"

/* By the areas across from the corners. */
static struct check_fraction error_in(const struct check_mesh *m, uint32_t triangle, const __int128 area[3],
				      const struct point *p)
{
	struct check_fraction f = {0, 0};

	for (unsigned k = 0; k < 3; k++) {
		f.up += area[k] * ((int64_t)p->z - m->vertex[m->triangle[triangle][k]][2]);
		f.down += area[k];
	}
	f.up = f.up < 0 ? -f.up : f.up;
	return f;
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
	struct check_tree t;
	int r = check_tree_make(&t, m, err);

	*ret = (struct check_error){.largest = {0, 1}};
	for (size_t i = 0; !r && i < n; i++) {
		struct check_fraction f;
		__int128 area[3];
		uint32_t at;

		if (!check_tree_find(&t, &pts[i], &at, area)) {
			if (!ret->outside++)
				ret->stray = pts[i];
			continue;
		}
		ret->inside++;
		f = error_in(m, at, area, &pts[i]);
		if (check_fraction_compare(f, ret->largest) > 0) {
			ret->largest = f;
			ret->worst = pts[i];
		}
	}
	check_tree_free(&t);
	return r;
}
