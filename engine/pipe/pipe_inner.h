/* Inner door of pipe/: where most points of an inspected input are (pipe_inner.c). */
#ifndef PIPE_INNER_H
#define PIPE_INNER_H

#include "pipe.h"

/* Of all points of the reader's grid, which are in->points, more than none: in->inner_min, inner_max, most, most_at. Reads them
 * three times, in pipe_inner_bytes of memory. */
size_t pipe_inner_bytes(void);
int pipe_inner(struct grid_reader *, const struct pipe_inspect_params *, struct pipe_inspected *in, struct err *err);

#endif
