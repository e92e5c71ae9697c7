/* A run, for the two files that work on it: format_run.c and format_keep.c. */
#ifndef FORMAT_RUN_H
#define FORMAT_RUN_H

#include "err.h"
#include "format_change.h"
#include "format_priv.h"
#include "format_tile.h"

struct format_target {
	const struct format *format;
	struct format_options opt;
	struct format_output *out;
	void *writer;
	struct format_canonical *canonical;
	struct format_target *next;
};

struct format_run {
	struct format_run_options opt;
	struct format_target *target, **end;
	bool positions;               /* somebody needs them, beside the gathering of edges */
	struct format_change *change; /* NULL: the stream is of a mesh */
	struct format_tiles *tiles;   /* NULL: one file an output */
	bool finished;
	struct format_open open;
	struct format_edge edge;
	struct err err;
	uint64_t bytes;
	struct format_kept *kept; /* NULL: nothing is */
};

/* format_keep.c: in place of the heads of the writers, when a run goes on. */
bool format_keep_goes_on(const struct format_run *);
int format_keep_head(struct format_run *, const struct acut_mesh_head *, struct err *err);
/* All outputs have their names. */
void format_keep_done(struct format_run *);
void format_keep_discard(struct format_run *); /* a run that ends with nothing to go on with leaves nothing */
struct format_kept *format_keep_free(struct format_kept *);

#endif
