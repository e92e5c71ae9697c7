/*
 * Vertices of lines of a view with the thin rule. They are not thinned. They are kept by a walk of their own, because a rectangle
 * of selection_thin.c may be read several times. Only cells are read whose box a piece meets, as each vertex is the end of a
 * piece.
 */
#include "selection_priv.h"

#include "err.h"
#include "lineset.h"

static int keep_lines(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct selection *s = ctx;
	int r = 0;

	(void)err;
	s->seen += n;
	for (size_t i = 0; !r && i < n; i++)
		if ((pts[i].tag & POINT_LINE) && view_judge(s->p->view, &pts[i]) == VIEW_KEPT)
			r = selection_keep(s, &pts[i]);
	return r ? r : selection_progress(s);
}

/* Sets *ret to whether the cell or subtree may hold some. */
static int may_hold_lines(struct selection *s, const struct grid_cell *cell, bool *ret, struct err *err)
{
	uint64_t n = 0;
	int r = 0;

	*ret = view_may_hold(s->p->view, cell->box) && (!cell->source || cell->source == grid_lines_source(s->p->grid)->id);
	if (*ret)
		r = lineset_count(grid_reader_lines(s->reader), cell->box, 1, &n, err);
	*ret = n > 0;
	return r;
}

/* If that cannot be read, a cell of the subtree says so. */
static bool enter_lines(void *ctx, const struct grid_cell *subtree)
{
	struct err ignored = ERR_INIT;
	bool may;

	return may_hold_lines(ctx, subtree, &may, &ignored) || may;
}

static int read_lines(void *ctx, const struct grid_cell *cell)
{
	struct selection *s = ctx;
	bool may;
	int r = may_hold_lines(s, cell, &may, s->err);

	return r || !may ? r : grid_cell_read(s->reader, cell, keep_lines, s, s->err);
}

int selection_lines(struct selection *s)
{
	const struct grid_visitor visitor = {s, enter_lines, read_lines};

	return grid_lines(s->p->grid) ? grid_walk(s->reader, 0, UINT64_MAX, &visitor, s->err) : 0;
}
