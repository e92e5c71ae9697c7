/*
 * Bytes to telegrams, however the transfers cut them. A framer never fails: what is no telegram is counted and
 * skipped, and it finds its feet again; the bytes are in the spool.
 */
#ifndef FRAMER_H
#define FRAMER_H

#include <stddef.h>
#include <stdint.h>

struct profile;
struct err;

struct framer;

struct telegram {
	const uint8_t *at; /* without its framing (STX, ETX, line end); until the sink returns */
	size_t size;
	uint64_t number;   /* of good telegrams, from 0 */
	uint64_t offset;   /* of its first byte in the stream */
	int64_t time_ns;   /* of the transfer that completed it */
	int64_t first_ns;  /* of the transfer that began it */
};
/* Non-zero ends the feed with it. */
typedef int (*framer_sink)(void *ctx, const struct telegram *);

struct framer_counts {
	uint64_t bytes, telegrams, bad, skipped; /* skipped: bytes in no telegram, without framing */
};

/* Memory: telegram_max of the profile and a little. STREAM: every feed is a telegram. LAS: telegrams are pieces of
 * at most 64 KiB of whole LAS files; `number` of the file is in framer_las_file. */
int framer_new(const struct profile *, framer_sink, void *ctx, struct framer **ret, struct err *);
struct framer *framer_free(struct framer *);
int framer_feed(struct framer *, const void *at, size_t size, int64_t time_ns);
/* Bytes are missing here (an overflow, an unplug): what was begun is bad. */
int framer_gap(struct framer *);
int framer_end(struct framer *); /* what was begun and has no end is bad; a last line without line end is one */
void framer_counts(const struct framer *, struct framer_counts *ret);

#endif
