/*
 * Results: one of everything, or one of each polygon. Boxes of polygons are in a tree over their order in the file, so that a
 * pair looks at few of them.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "volume_priv.h"

struct row {
	struct volume_sums sums;
	struct volume_area *area; /* NULL: everything */
	const char *name;
};

struct volume_rows {
	struct row *row;
	size_t n;
	int64_t (*box)[4]; /* nodes of the tree in the order of a walk */
	bool all;
};

static void make_boxes(struct volume_rows *rows, struct volume_node n)
{
	int64_t *box = rows->box[n.box];

	if (n.high - n.low == 1) {
		volume_area_box(rows->row[n.low].area, box);
		return;
	}
	for (int i = 0; i < 2; i++) {
		const int64_t *part = rows->box[volume_half(n, i).box];

		make_boxes(rows, volume_half(n, i));
		for (int k = 0; k < 2; k++) {
			box[k] = !i || part[k] < box[k] ? part[k] : box[k];
			box[2 + k] = !i || part[2 + k] > box[2 + k] ? part[2 + k] : box[2 + k];
		}
	}
}

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory for the results of polygons");
}

static int add_areas(struct volume_rows *rows, const struct volume_frame *f, const struct volume_options *opt, struct err *err)
{
	for (size_t i = 0; i < opt->areas->nfeature; i++) {
		struct row *row = &rows->row[rows->n];

		if (volume_area_new(f, opt->areas, i, &row->area, err))
			return err_add_file(err, opt->areas_file);
		row->name = ctl_area_name(opt->areas, i);
		rows->n++;
	}
	rows->box = calloc(2 * rows->n, sizeof(*rows->box));
	if (!rows->box)
		return no_memory(err);
	make_boxes(rows, (struct volume_node){0, 0, rows->n});
	return 0;
}

int volume_rows_new(const struct volume_frame *f, const struct volume_options *opt, struct volume_rows **ret, struct err *err)
{
	struct volume_rows *rows = calloc(1, sizeof(*rows));
	size_t n = opt->areas ? opt->areas->nfeature : 1;
	int r = 0;

	if (!rows || !(rows->row = calloc(n, sizeof(*rows->row)))) {
		free(rows);
		return no_memory(err);
	}
	if (opt->areas) {
		r = add_areas(rows, f, opt, err);
	} else {
		rows->all = true;
		rows->row[rows->n++].name = "";
	}
	if (r)
		volume_rows_free(rows);
	else
		*ret = rows;
	return r;
}

struct volume_rows *volume_rows_free(struct volume_rows *rows)
{
	if (rows) {
		for (size_t i = 0; i < rows->n; i++)
			volume_area_free(rows->row[i].area);
		free(rows->row);
		free(rows->box);
	}
	free(rows);
	return NULL;
}

size_t volume_rows_count(const struct volume_rows *rows)
{
	return rows->n;
}

const struct volume_sums *volume_rows_sums(const struct volume_rows *rows, size_t i, const char **ret_name)
{
	*ret_name = rows->row[i].name;
	return &rows->row[i].sums;
}

/* ---- what comes ---- */

/* Returns what is inside. */
static volume_i128 add(struct volume_rows *rows, struct volume_node n, const struct volume_polygon *p, int cover)
{
	const int64_t *box = rows->box[n.box];
	struct row *row = &rows->row[n.low];
	struct volume_sums sums = {0};
	volume_i128 before;

	if (box[0] > p->box[2] || p->box[0] > box[2] || box[1] > p->box[3] || p->box[1] > box[3])
		return 0;
	if (n.high - n.low > 1)
		return add(rows, volume_half(n, false), p, cover) + add(rows, volume_half(n, true), p, cover);
	if (cover < 0) {
		before = row->sums.shared;
		volume_area_add(row->area, p, &row->sums);
		return row->sums.shared - before;
	}
	volume_area_add(row->area, p, &sums);
	row->sums.covered[cover] += sums.shared;
	row->sums.area_error += sums.area_error;
	return sums.shared;
}

volume_i128 volume_rows_add(struct volume_rows *rows, const struct volume_polygon *p)
{
	volume_i128 before = rows->row[0].sums.shared;

	if (!rows->all)
		return add(rows, (struct volume_node){0, 0, rows->n}, p, -1);
	volume_add(p, NULL, &rows->row[0].sums);
	return rows->row[0].sums.shared - before;
}

void volume_rows_kept(struct volume_rows *rows, volume_i128 area)
{
	struct volume_sums *s = &rows->row[0].sums;
	volume_i128 kept = (area << (VOLUME_PART - 1)) - s->covered[1];

	s->covered[0] += kept;
	s->covered[1] += kept;
	s->shared += kept;
}

void volume_rows_cover(struct volume_rows *rows, const struct volume_triangle *t, unsigned side)
{
	struct volume_polygon p;

	if (rows->all) {
		rows->row[0].sums.covered[side] += volume_triangle_area(t) << (VOLUME_PART - 1);
		return;
	}
	volume_above(t, 0, 0, &p);
	memset(p.f, 0, sizeof(p.f));
	p.range = 0;
	add(rows, (struct volume_node){0, 0, rows->n}, &p, (int)side);
}
