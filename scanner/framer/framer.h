/*
 * Bytes to telegrams, independent of the boundaries of transfers. A framer never fails: what is not a telegram is
 * counted and skipped, and the framer resynchronizes; the bytes are in the spool. The same bytes give the same
 * telegrams, counts and bad telegrams, whether fed in one piece or byte by byte (except for STREAM).
 */
#ifndef FRAMER_H
#define FRAMER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct profile;
struct err;

struct framer;

struct telegram {
	const uint8_t *at; /* without STX, ETX and line end, with sync and length; valid until the sink returns */
	size_t size;
	uint64_t number;             /* of valid telegrams, from 0 */
	uint64_t offset;             /* offset of its frame in the stream */
	int64_t time_ns;             /* of the transfer that completed it */
	int64_t first_ns;            /* of the transfer that began it (or of one nearby, if it came in more than 32 transfers) */
	uint64_t file;               /* LAS: number of the file to which the piece belongs, from 0 */
	bool file_begins, file_ends; /* LAS: with this piece. A file that begins and does not end is reported as bad. */
};
/* Non-zero ends the feed with that result; the rest of the feed is not seen. */
typedef int (*framer_sink)(void *ctx, const struct telegram *);

/* Why bytes are in no telegram. GARBAGE is between telegrams and does not count as a bad one. */
#define FRAMER_REASONS(R)                                                \
	R(GARBAGE, "garbage")   /* does not begin like a telegram */     \
	R(LONG, "too-long")     /* longer than telegram_max */           \
	R(CUT, "cut")           /* the next one begins before its end */ \
	R(GAP, "gap")           /* bytes were lost in it */              \
	R(END, "unfinished")    /* the stream ends in it */              \
	R(LENGTH, "bad-length") /* has an impossible length */           \
	R(HEADER, "bad-header") /* LAS: an invalid header */             \
	R(LAZ, "compressed")    /* LAS: the header of a compressed file, which does not have its length */
enum framer_reason {
#define R(name, text) FRAMER_##name,
	FRAMER_REASONS(R)
#undef R
		FRAMER_REASON_COUNT
};
const char *framer_reason_name(enum framer_reason);

struct framer_counts {
	uint64_t bytes; /* fed */
	uint64_t telegrams, bad;
	uint64_t framed;                  /* bytes of valid telegrams, with their frames */
	uint64_t skipped;                 /* bytes in no telegram; bytes = framed + skipped + held, held is 0 after framer_end */
	uint64_t held;                    /* incomplete so far */
	uint64_t by[FRAMER_REASON_COUNT]; /* number of each; bad is their sum without GARBAGE */
	uint64_t files;                   /* LAS: complete ones */
};

/* Memory: telegram_max of the profile and 64 KiB. STREAM: every feed is a telegram. LAS: telegrams are pieces of at
 * most 64 KiB of complete uncompressed LAS files. */
int framer_new(const struct profile *, framer_sink, void *ctx, struct framer **ret, struct err *);
struct framer *framer_free(struct framer *);
/* Called for each bad telegram and each stretch of garbage, once it has ended, in the order of the stream. */
void framer_on_bad(struct framer *, void (*on_bad)(void *ctx, enum framer_reason, uint64_t offset, uint64_t size), void *ctx);
int framer_feed(struct framer *, const void *at, size_t size, int64_t time_ns);
/* Bytes are missing here (an overflow, an unplug): the incomplete telegram is bad, and so is the rest of a LINE. */
int framer_gap(struct framer *);
int framer_end(struct framer *); /* an incomplete telegram is bad; a last line without line end is valid */
void framer_counts(const struct framer *, struct framer_counts *ret);

#endif
