/* From round to round. Internal. */
#ifndef SIMPLIFY_ROUND_H
#define SIMPLIFY_ROUND_H

#include "simplify_priv.h"

/* These fill in *next from the present step: `at`, and `chosen` for a round. If `at.step` is SIMPLIFY_DONE, the result is
 * complete in the folder. */
int simplify_end_blocks(const struct simplify *, struct simplify *next, struct err *err);
int simplify_end_round(const struct simplify *, struct simplify *next, struct err *err);

/* simplify_finish.c: the grid of a manifest becomes one segment `name`, each position once. */
int simplify_rewrite(const struct simplify *, const char *manifest, const char *name, bool temporary,
		     struct grid_segment_info *ret, struct err *err);
/* The result, from the grid of a manifest; the numbers are those of `where`. */
int simplify_finish(const struct simplify *, const char *manifest, const struct simplify_where *where, struct err *err);

#endif
