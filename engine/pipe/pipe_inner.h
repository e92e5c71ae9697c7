/* Where most points of an inspected input are (pipe_inner.c). Internal. */
#ifndef PIPE_INNER_H
#define PIPE_INNER_H

#include "pipe.h"

/* Sets in->inner_min, inner_max, most and most_at, from all points of the reader's grid (in->points of them, at least
 * one). Reads them three times, in pipe_inner_bytes of memory. */
size_t pipe_inner_bytes(void);
int pipe_inner(struct grid_reader *, const struct pipe_inspect_params *, struct pipe_inspected *in, struct err *err);

#endif
