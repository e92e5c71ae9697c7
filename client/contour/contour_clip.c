/*
 * The window of a view, "box:X1,Y1,X2,Y2": triangles reach out of it, lines end at it.
 *
 * Whether a crossing is inside is decided in whole numbers, so both triangles of its edge agree. Where a segment leaves the
 * window is a double: a segment is in one triangle, and nothing is joined there.
 */
#include <stdio.h>
#include <string.h>

#include "contour_priv.h"
#include "err.h"

int contour_window_init(struct contour_window *w, const struct acut_mesh_head *head, struct err *err)
{
	const char *at = strstr(head->view ? head->view : "", " window=");
	long long b[4];

	*w = (struct contour_window){.given = at != NULL};
	if (!at)
		return 0;
	if (sscanf(at, " window=box:%lld,%lld,%lld,%lld", &b[0], &b[1], &b[2], &b[3]) != 4) {
		err_set(err, ERR_USAGE, "contours cannot be cut by --polygon");
		return err_add_hint(err, "give the window as --bbox X1,Y1,X2,Y2");
	}
	for (int i = 0; i < 2; i++) {
		if (__builtin_sub_overflow((int64_t)b[i], head->k[i], &w->low[i]))
			w->low[i] = b[i] < 0 ? INT64_MIN : INT64_MAX;
		if (__builtin_sub_overflow((int64_t)b[i + 2], head->k[i], &w->high[i]))
			w->high[i] = b[i + 2] < 0 ? INT64_MIN : INT64_MAX;
	}
	return 0;
}

int contour_window_box(const struct contour_window *w, const int32_t low[2], const int32_t high[2])
{
	int all = 1;

	for (int i = 0; i < 2 && w->given; i++) {
		if (high[i] < w->low[i] || low[i] >= w->high[i])
			return -1;
		if (low[i] < w->low[i] || high[i] >= w->high[i])
			all = 0;
	}
	return all;
}

bool contour_window_has(const struct contour_window *w, const struct contour_crossing *c)
{
	const int32_t from[2] = {contour_key_x(c->end[0]), contour_key_y(c->end[0])};
	const int32_t to[2] = {contour_key_x(c->end[1]), contour_key_y(c->end[1])};

	for (int i = 0; i < 2 && w->given; i++) {
		contour_i128 at = (contour_i128)from[i] * c->d + (contour_i128)((int64_t)to[i] - from[i]) * c->n;

		if (at < (contour_i128)w->low[i] * c->d || at >= (contour_i128)w->high[i] * c->d)
			return false;
	}
	return true;
}

static void number_of(const struct contour_crossing *c, double ret[2])
{
	const double part = (double)c->n / (double)c->d;
	const int32_t x[2] = {contour_key_x(c->end[0]), contour_key_x(c->end[1])};
	const int32_t y[2] = {contour_key_y(c->end[0]), contour_key_y(c->end[1])};

	ret[0] = x[0] + ((double)x[1] - x[0]) * part;
	ret[1] = y[0] + ((double)y[1] - y[0]) * part;
}

bool contour_window_cut(const struct contour_window *w, const struct contour_crossing *a, const struct contour_crossing *b,
			const bool has[2], double ret[2][2])
{
	double p[2], q[2], part[2] = {0, 1};
	int at[2] = {-1, -1}; /* the axis on whose border the end is */

	number_of(a, p);
	number_of(b, q);
	for (int i = 0; i < 2; i++) {
		const double border[2] = {(double)w->low[i], (double)w->high[i]};

		for (int high = 0; high < 2; high++) {
			double d = high ? p[i] - q[i] : q[i] - p[i], to = high ? p[i] - border[1] : border[0] - p[i];
			double t = d ? to / d : 0;

			if (!d && (to > 0 || (high && to == 0)))
				return false;
			if (d > 0 && !has[0] && t > part[0]) { /* comes in */
				part[0] = t;
				at[0] = 2 * i + high;
			} else if (d < 0 && !has[1] && t < part[1]) {
				part[1] = t;
				at[1] = 2 * i + high;
			}
		}
	}
	if (part[0] > part[1])
		return false;
	for (int end = 0; end < 2; end++) {
		for (int i = 0; i < 2; i++)
			ret[end][i] = p[i] + (q[i] - p[i]) * part[end];
		if (at[end] >= 0)
			ret[end][at[end] / 2] = (double)(at[end] % 2 ? w->high[at[end] / 2] : w->low[at[end] / 2]);
	}
	return true;
}
