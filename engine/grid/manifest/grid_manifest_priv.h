/* What the files of this room share. Internal. */
#ifndef GRID_MANIFEST_PRIV_H
#define GRID_MANIFEST_PRIV_H

#include "cursor.h"
#include "grid_manifest.h"

/* Sizes in the file. */
enum {
	HEAD_BYTES = 8 + 4 + 4 + 8 + 8 + 4 + 4,
	HEAD_MORE = 8 + 4 + 4, /* added by version 4 */
	HEAD_LINES = 4,        /* added by version 7; no file is smaller than all of these */
	HEAD_APART = 4 + 4,    /* added by version 9 */
	SEGMENT_LEAST = 2 + 3 * 8 + 4 * 4 + 2 * 8 + 2,
	SEGMENT_RANGE = 2 * 8,                /* added by version 8 */
	SOURCE_LEAST = 4 + 3 * 8 + 2 * 8 + 2, /* of version 1 */
	SOURCE_MORE = 2 * 8 + 2,              /* added by version 2 */
	SOURCE_SPANS = 2,                     /* added by version 4 */
	SOURCE_READ = 2 + 8 + 2,              /* added by version 5 */
	SOURCE_KIND = 1,                      /* added by version 7 */
	LINES_BYTES = (GRID_LINE_KINDS + 4 + 2) * 8,
	SPAN_BYTES = 2 * 8,
	SOURCE_LIVES = 2 * 8, /* until version 8, without earlier ones */
	SOURCE_LAST = SOURCE_LEAST - SOURCE_LIVES + SOURCE_MORE + SOURCE_READ + SOURCE_KIND, /* of this version */
	BATCH_LEAST = 2 * 4 + 1 + 2 * 8 + 2,
	FILE_LEAST = 2 + 8 + 4 + 8,
	SOURCES_HEAD = 8 + 4 + 4 + 8, /* of a file of sources */
	GENERATION_LINES = 2 * 8,     /* added by version 7 */
	GENERATION_LEAST = 2 * 8 + 4 + 1 + 8 + 2 * 4 + 2 * 8 + 2 * 8 + 2,
	TEXTS_MOST = 7 * 2 + 8 + LATTICE_TEXT_SIZE + 512 + 16 + 16 + GRID_GEOID + 256,
	SEGMENT_MOST = SEGMENT_LEAST + SEGMENT_RANGE + 64 + 256 * 9,
	CHECK_BYTES = 8,
};
#define MANIFEST_MOST ((uint64_t)1 << 32) /* bytes; enough for ten million sources */

/* Texts of a manifest that is read. */
struct pool {
	char *bytes;
	size_t used, room;
};
/* Of all sources: earlier spans, and how many are lines. */
struct limits {
	size_t spans, lines;
};
/* They read the next thing of the file; false: it is malformed. */
bool manifest_unpack_text(struct cursor *, char *ret, size_t size);
bool manifest_unpack_spans(struct cursor *, struct grid_manifest *, size_t most, const struct grid_span **ret, size_t *ret_n);
bool manifest_unpack_source(struct cursor *, struct grid_manifest *, uint32_t version, struct pool *, const struct limits *,
			    struct grid_source *ret);

/* grid_batches.c */
/* The batches of these sources; `apart`: which of them are in files of sources (NULL: none). NULL: no memory. */
struct grid_batch *manifest_batches_of(const struct grid_source *, size_t n, const bool *apart, size_t *ret_n);
/* Reads the lists of files and batches; there is memory for them. NULL, or what is wrong. */
const char *manifest_unpack_batches(struct cursor *, struct grid_manifest *, const struct limits *);
/* Gives the sources in the manifest their lives. */
const char *manifest_take_lives(struct grid_manifest *);
/* NULL, or the rule that its batches break. */
const char *manifest_batches_fault(const struct grid_manifest *, bool *ret_nomem);

/* Charges the memory for reading a manifest. `had`: what it has already. The sum is compared with half of the total: if each part
 * were, one that never fits would be -ERR_BUSY. */
int manifest_charge(struct ledger *, uint64_t bytes, uint64_t had, const char *name, struct err *err);
/* Sets the error: a damaged manifest, or file of sources. */
int manifest_damaged(const char *name, const char *what, struct err *err);

/* Where the sources of a manifest go. */
struct apart {
	bool *apart; /* each source: it is in a file of sources */
	bool *fresh; /* each source: in the new one */
	size_t nfresh;
	struct grid_sources_file files[GRID_SOURCES_FILES];
	size_t nfiles; /* with the new one, the last, which is not described yet */
};
int manifest_apart_choose(const struct grid_manifest *, struct grid_apart *, struct apart *ret, struct err *err);
void manifest_apart_done(struct apart *);
int manifest_apart_write(int dirfd, const struct grid_manifest *, struct grid_apart *, struct apart *, struct err *err);
void manifest_pack_text(struct packer *, const char *text);
void manifest_pack_source(struct packer *, const struct grid_source *);
uint64_t manifest_source_bytes(const struct grid_source *); /* in a file */

/* NULL, or what is wrong with the lives and the number of a source. */
const char *manifest_source_fault(const struct grid_manifest *, const struct grid_source *);
/* NULL, or the rule that the manifest breaks. *ret_nomem: there was no memory to check them all. */
const char *grid_manifest_check(const struct grid_manifest *, bool *ret_nomem);
/* Derives the generations of a manifest that does not list them: those that added or removed a source. False: no memory. */
bool grid_manifest_derive(struct grid_manifest *);

#endif
