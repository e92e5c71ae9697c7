/*
 * How the decoder of a chunk plugs into laz_reader.c. There are two: laz_pointwise.c (compressors 1 and 2) and
 * laz_layered.c (compressor 3), with the same five functions.
 *
 * X_bytes: memory, by format and fields alone. X_new: makes the decoder in it; nothing is read yet. X_begin:
 * from now on the chunk of `points` (at least 1) records that begins at byte `at`; it ends at byte `end`, or
 * `end` is LAZ_OPEN. All state of the chunk before is gone. X_read: the next n records, never more than are
 * left of the chunk (the reader counts); on failure the records have any value. What it gives is checked by
 * laz_window_check first: no record that was made of bytes behind a stream's end is given away as good.
 * X_end: after the last record; *ret_end is the byte at which the chunk really ended; where that is not `end`
 * (unless LAZ_OPEN), or a layer does not end where its size says, it fails with ERR_INPUT.
 * All add to *counter the bytes that they read. Errors name the byte (offset) and the field, not the file.
 */
#ifndef LAZ_PARTS_H
#define LAZ_PARTS_H

#include "laz.h"
#include "laz_window.h"

/* Windows of one stream in a pointwise chunk, of each layer in a layered chunk. */
enum { LAZ_STREAM_WINDOW = 16384, LAZ_LAYER_WINDOW = 4096 };
/* Extra bytes of a record that are decoded at most. BYTE has them in the stream of all others, so that a file with
 * more cannot be read; layers of BYTE14 are stepped over unless LAZ_ALL asks for them. */
enum { LAZ_EXTRA_MAX = 1024 };

struct laz_pointwise;
size_t laz_pointwise_bytes(const struct laz_format *);
struct laz_pointwise *laz_pointwise_new(void *memory, const struct laz_format *, const struct laz_source *, uint64_t *counter);
int laz_pointwise_begin(struct laz_pointwise *, uint64_t at, uint64_t end, uint64_t points, struct err *err);
int laz_pointwise_read(struct laz_pointwise *, uint8_t *records, size_t n, struct err *err);
/* Whether all bytes of the chunk were taken. */
bool laz_pointwise_used(const struct laz_pointwise *);
/* After laz_pointwise_read failed because the file ended: how many of its records are good. */
size_t laz_pointwise_good(const struct laz_pointwise *);
int laz_pointwise_end(struct laz_pointwise *, uint64_t *ret_end, struct err *err);

struct laz_layered;
size_t laz_layered_bytes(const struct laz_format *, enum laz_fields);
struct laz_layered *laz_layered_new(void *memory, const struct laz_format *, enum laz_fields, const struct laz_source *,
				    uint64_t *counter);
int laz_layered_begin(struct laz_layered *, uint64_t at, uint64_t end, bool at_most, uint64_t *points, struct err *err);
int laz_layered_read(struct laz_layered *, uint8_t *records, size_t n, struct err *err);
int laz_layered_end(struct laz_layered *, uint64_t *ret_end, struct err *err);

#endif
