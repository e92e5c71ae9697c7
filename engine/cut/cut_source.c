/*
 * What follows from a source's walk alone.
 */
#include "cut_source.h"

struct box {
	int32_t b[4];
	bool any;
};

static void box_add(struct box *box, const struct grid_cell *cell)
{
	if (cell->count == 0)
		return;
	if (!box->any) {
		for (unsigned i = 0; i < 4; i++)
			box->b[i] = cell->box[i];
		box->any = true;
		return;
	}
	for (unsigned i = 0; i < 2; i++) {
		box->b[i] = cell->box[i] < box->b[i] ? cell->box[i] : box->b[i];
		box->b[2 + i] = cell->box[2 + i] > box->b[2 + i] ? cell->box[2 + i] : box->b[2 + i];
	}
}

/* The box of a subtree is all that is asked: never go down. */
static bool box_enter(void *ctx, const struct grid_cell *subtree)
{
	box_add(ctx, subtree);
	return false;
}

static int box_cell(void *ctx, const struct grid_cell *cell)
{
	box_add(ctx, cell);
	return 0;
}

int cut_source_box(const struct cut_source *src, int32_t ret_box[4], bool *ret_any, struct err *err)
{
	struct box box = { .any = false };
	const struct grid_visitor v = { .ctx = &box, .enter = box_enter, .cell = box_cell };
	int rc = src->walk(src->ctx, 0, UINT64_MAX, &v, err);

	if (rc)
		return rc;
	if (box.any)
		for (unsigned i = 0; i < 4; i++)
			ret_box[i] = box.b[i];
	*ret_any = box.any;
	return 0;
}
