/* The lines of a grid, as pieces. */
#include <math.h>
#include <stdio.h>

#include "breakline.h"
#include "constrain.h"
#include "err.h"
#include "grid.h"

static int grid_find(void *ctx, const int32_t box[4], lineset_piece_fn fn, void *sink, struct err *err)
{
	return lineset_find(grid_reader_lines(ctx), box, fn, sink, err);
}

static int grid_state(void *ctx, int64_t x, int64_t y, unsigned den, unsigned *ret, struct err *err)
{
	return lineset_state(grid_reader_lines(ctx), x, y, den, ret, err);
}

/* Reads all files of lines: for the one error of a job. If one cannot be read, the error is without a name. */
static void grid_name(void *ctx, const int32_t a[2], const int32_t b[2], struct err *err)
{
	const struct grid *grid = grid_reader_grid(ctx);
	const struct grid_manifest *m = grid_manifest(grid);
	struct grid_named file[GRID_SOURCE_FILES];
	const struct grid_source *found = NULL;
	double nearest = INFINITY, distance;
	struct err ignored = ERR_INIT;
	uint32_t number, feature = 0;
	char text[32];

	for (size_t i = 0; grid_folder(grid) >= 0 && i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];

		if (s->kind != GRID_LINES || !grid_source_live(s, grid_generation(grid)) || !grid_source_files(s, file) ||
		    breakline_find(grid_folder(grid), file[0].name, a, b, &distance, &number, &ignored) || distance >= nearest)
			continue;
		nearest = distance;
		found = s;
		feature = number;
	}
	if (!found)
		return;
	snprintf(text, sizeof text, "feature %u", feature);
	err_add_file(err, found->name);
	err_add_place(err, ERR_NO_OFFSET, text);
}

bool constrain_has_out(const struct grid *grid)
{
	const struct lineset *lines = grid_lines(grid);

	return lines && (lineset_info(lines)->turns | lineset_info(lines)->far) & LINESET_OUT;
}

bool constrain_lines_of(struct grid_reader *reader, struct constrain_lines *ret)
{
	const struct grid *grid = grid_reader_grid(reader);

	*ret = (struct constrain_lines){
		.ctx = reader, .find = grid_find, .state = constrain_has_out(grid) ? grid_state : NULL, .name = grid_name};
	return grid_lines(grid);
}
