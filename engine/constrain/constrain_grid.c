/* The lines of a grid, as pieces. */
#include "constrain.h"
#include "grid.h"

static int grid_find(void *ctx, const int32_t box[4], lineset_piece_fn fn, void *sink, struct err *err)
{
	return lineset_find(grid_reader_lines(ctx), box, fn, sink, err);
}

static int grid_state(void *ctx, int64_t x, int64_t y, unsigned den, unsigned *ret, struct err *err)
{
	return lineset_state(grid_reader_lines(ctx), x, y, den, ret, err);
}

bool constrain_has_out(const struct grid *grid)
{
	const struct lineset *lines = grid_lines(grid);

	return lines && (lineset_info(lines)->turns | lineset_info(lines)->far) & LINESET_OUT;
}

bool constrain_lines_of(struct grid_reader *reader, struct constrain_lines *ret)
{
	const struct grid *grid = grid_reader_grid(reader);

	*ret = (struct constrain_lines){.ctx = reader, .find = grid_find, .state = constrain_has_out(grid) ? grid_state : NULL};
	return grid_lines(grid);
}
