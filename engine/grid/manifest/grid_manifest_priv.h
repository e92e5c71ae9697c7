/* What the files of this room share. Internal. */
#ifndef GRID_MANIFEST_PRIV_H
#define GRID_MANIFEST_PRIV_H

#include "grid_manifest.h"

/* Sizes in the file. */
enum {
	HEAD_BYTES = 8 + 4 + 4 + 8 + 8 + 4 + 4,
	HEAD_MORE = 8 + 4 + 4, /* added by version 4 */
	HEAD_LINES = 4,        /* added by version 7; no file is smaller than all of these */
	SEGMENT_LEAST = 2 + 3 * 8 + 4 * 4 + 2 * 8 + 2,
	SEGMENT_RANGE = 2 * 8,                /* added by version 8 */
	SOURCE_LEAST = 4 + 3 * 8 + 2 * 8 + 2, /* of version 1 */
	SOURCE_MORE = 2 * 8 + 2,              /* added by version 2 */
	SOURCE_SPANS = 2,                     /* added by version 4 */
	SOURCE_READ = 2 + 8 + 2,              /* added by version 5 */
	SOURCE_KIND = 1,                      /* added by version 7 */
	LINES_BYTES = (GRID_LINE_KINDS + 4 + 2) * 8,
	SPAN_BYTES = 2 * 8,
	GENERATION_LINES = 2 * 8, /* added by version 7 */
	GENERATION_LEAST = 2 * 8 + 4 + 1 + 8 + 2 * 4 + 2 * 8 + 2 * 8 + 2,
	TEXTS_MOST = 7 * 2 + 8 + LATTICE_TEXT_SIZE + 512 + 16 + 16 + GRID_GEOID + 256,
	SEGMENT_MOST = SEGMENT_LEAST + SEGMENT_RANGE + 64 + 256 * 9,
	CHECK_BYTES = 8,
};
#define MANIFEST_MOST ((uint64_t)1 << 32) /* bytes; enough for ten million sources */

/* NULL, or the rule that the manifest breaks. *ret_nomem: there was no memory to check them all. */
const char *grid_manifest_check(const struct grid_manifest *, bool *ret_nomem);
/* Derives the generations of a manifest that does not list them: those that added or removed a source. False: no memory. */
bool grid_manifest_derive(struct grid_manifest *);

#endif
