/* Lines of an input: vertices on the lattice into a file of lines. Internal. */
#ifndef PIPE_LINES_H
#define PIPE_LINES_H

#include "pipe.h"

struct pipe_lines;

/* Memory beside that of the input (input_info.read_bytes has the ring of a lake). */
size_t pipe_lines_bytes(void);
int pipe_lines_new(const struct pipe_ingest_params *, const struct input_info *, struct pipe_lines **ret, struct err *err);
struct pipe_lines *pipe_lines_free(struct pipe_lines *); /* NULL is fine; returns NULL */
/* The next vertices. -ERR_INPUT names the feature. */
int pipe_lines_add(struct pipe_lines *, const int32_t (*at)[3], const struct input_vertex *, size_t n, struct err *err);
/* After the last one. */
int pipe_lines_end(struct pipe_lines *, struct err *err);
void pipe_lines_counts(const struct pipe_lines *, struct pipe_ingested *);

#endif
