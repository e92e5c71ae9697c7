/*
 * Sums of comparisons, for volumes.py, which knows what they must be. Standard input has sets:
 *
 *     set NA NB CELL LEAF DEPTH CROWD LEVEL_WHOLE LEVEL_PART POLYGONS     LEVEL_PART -1: no level
 *     NA + NB lines of nine numbers
 *     for each polygon: its number of rings, and for each ring whether it is a shell, its number of corners, and their texts
 *
 * Each gives a line a row: fill, cut, shared, filled, lowered, covered, covered, error, area error; or "refused".
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "volume_priv.h"

static struct volume_rows *rows;

static int take(void *ctx, const struct volume_triangle *a, const struct volume_triangle *b, const struct volume_polygon *p,
		struct err *err)
{
	volume_rows_add(rows, p);
	return 0;
}

static void need(bool ok, const char *what)
{
	if (!ok) {
		fprintf(stderr, "volume_sums: %s\n", what);
		exit(1);
	}
}

static void print(volume_i128 v)
{
	char text[48], *at = text + sizeof(text);
	bool negative = v < 0;
	volume_u128 u = negative ? -(volume_u128)v : (volume_u128)v;

	*--at = 0;
	do
		*--at = (char)('0' + (int)(u % 10));
	while (u /= 10);
	printf("%s%s ", negative ? "-" : "", at);
}

static struct ctl_area read_areas(unsigned n)
{
	struct ctl_area a = {.name_field = NULL};
	struct err err = ERR_INIT;

	for (unsigned i = 0; i < n; i++) {
		unsigned rings;

		need(scanf("%u", &rings) == 1 && !ctl_area_feature(&a, &err), "polygon");
		for (unsigned k = 0; k < rings; k++) {
			unsigned shell, corners;

			need(scanf("%u %u", &shell, &corners) == 2 && !ctl_area_ring(&a, shell, &err), "ring");
			for (unsigned c = 0; c < corners; c++) {
				char text[2][64];
				struct decimal d[2];

				need(scanf("%63s %63s", text[0], text[1]) == 2 && decimal_parse(text[0], &d[0]) &&
					     decimal_parse(text[1], &d[1]) && !ctl_area_corner(&a, d[0], d[1], &err),
				     "corner");
			}
		}
	}
	return a;
}

static void one_set(unsigned na, unsigned nb)
{
	struct volume_frame frame = {.step = {{1, 0}, {1, 0}}};
	const struct volume_call call = {take, NULL};
	struct volume_options opt = {.areas = NULL};
	struct volume_triangle *t = calloc(na + nb + 1, sizeof(*t));
	struct volume_join *join;
	struct err err = ERR_INIT;
	struct ctl_area areas;
	int64_t box[4] = {INT64_MAX, INT64_MAX, INT64_MIN, INT64_MIN};
	unsigned npolygon;
	long long whole;
	double part;

	need(scanf("%u %u %u %u %lld %lf %u", &volume_join_sizes.cell, &volume_join_sizes.leaf, &volume_join_sizes.depth,
		   &volume_join_sizes.crowd, &whole, &part, &npolygon) == 7,
	     "set");
	volume_join_sizes.sort = 4096;
	for (unsigned i = 0; i < na + nb; i++)
		for (int k = 0; k < 9; k++) {
			int32_t *v = &t[i].at[k / 3][k % 3];

			need(scanf("%d", v) == 1, "triangle");
			if (k % 3 < 2 && i < na) {
				box[k % 3] = *v < box[k % 3] ? *v : box[k % 3];
				box[2 + k % 3] = *v > box[2 + k % 3] ? *v : box[2 + k % 3];
			}
		}
	areas = read_areas(npolygon);
	opt.areas = npolygon ? &areas : NULL;
	if (volume_rows_new(&frame, &opt, &rows, &err)) {
		puts("refused");
		ctl_area_done(&areas);
		free(t);
		return;
	}
	if (!na)
		memset(box, 0, sizeof(box));
	need(!volume_join_new(box, na + nb, NULL, &call, NULL, NULL, &join, &err), err.message);
	for (unsigned i = 0; i < na + nb; i++) {
		struct volume_polygon p;

		if (!volume_triangle_normal(&t[i]))
			continue;
		volume_rows_cover(rows, &t[i], i >= na);
		if (part >= 0) {
			volume_above(&t[i], whole, part, &p);
			volume_rows_add(rows, &p);
		} else {
			need(!volume_join_add(join, i >= na, &t[i], &err), err.message);
		}
	}
	need(!volume_join_run(join, NULL, &err), err.message);
	volume_join_free(join);
	for (size_t i = 0; i < volume_rows_count(rows); i++) {
		const char *name;
		const struct volume_sums *s = volume_rows_sums(rows, i, &name);
		const volume_i128 all[] = {s->fill,
					   s->cut,
					   s->shared,
					   s->filled,
					   s->lowered,
					   s->covered[0],
					   s->covered[1],
					   (volume_i128)s->error,
					   (volume_i128)s->area_error};

		for (size_t k = 0; k < sizeof(all) / sizeof(*all); k++)
			print(all[k]);
		putchar('\n');
	}
	rows = volume_rows_free(rows);
	ctl_area_done(&areas);
	free(t);
}

int main(void)
{
	unsigned na, nb;

	while (scanf(" set %u %u", &na, &nb) == 2)
		one_set(na, nb);
	return 0;
}
