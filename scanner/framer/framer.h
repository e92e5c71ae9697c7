/*
 * Bytes to telegrams, however the transfers cut them. A framer never fails: what is no telegram is counted and
 * skipped, and it finds its feet again; the bytes are in the spool. The same bytes are the same telegrams, counts and
 * bad ones, fed in one piece or byte by byte (but for STREAM).
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
	const uint8_t *at; /* without STX, ETX and line end, with sync and length; until the sink returns */
	size_t size;
	uint64_t number;             /* of good telegrams, from 0 */
	uint64_t offset;             /* of the first byte of its framing in the stream */
	int64_t time_ns;             /* of the transfer that completed it */
	int64_t first_ns;            /* of the transfer that began it (of those cut over more than 32 transfers: of one near) */
	uint64_t file;               /* LAS: number of the file that it is a piece of, from 0 */
	bool file_begins, file_ends; /* LAS: with this piece. A file that begins and does not end is in framer_bad. */
};
/* Non-zero ends the feed with it: what the feed had behind it is not seen. */
typedef int (*framer_sink)(void *ctx, const struct telegram *);

/* Why bytes are in no telegram. GARBAGE lies between telegrams and is not counted as a bad one. */
#define FRAMER_REASONS(R)                                                \
	R(GARBAGE, "garbage")   /* begins as no telegram does */         \
	R(LONG, "too-long")     /* longer than telegram_max */           \
	R(CUT, "cut")           /* the next one begins before its end */ \
	R(GAP, "gap")           /* bytes were lost in it */              \
	R(END, "unfinished")    /* the stream ends in it */              \
	R(LENGTH, "bad-length") /* says a length that cannot be */       \
	R(HEADER, "bad-header") /* LAS: a header that is none */         \
	R(LAZ, "compressed")    /* LAS: the header of a compressed file, which does not say how long it is */
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
	uint64_t framed;                  /* bytes of good telegrams, with their framing */
	uint64_t skipped;                 /* bytes in no telegram; bytes = framed + skipped + held, held is 0 after framer_end */
	uint64_t held;                    /* begun, not decided yet */
	uint64_t by[FRAMER_REASON_COUNT]; /* how many of each; bad is their sum without GARBAGE */
	uint64_t files;                   /* LAS: whole ones */
};

/* Memory: telegram_max of the profile and 64 KiB. STREAM: every feed is a telegram. LAS: telegrams are pieces of at
 * most 64 KiB of whole uncompressed LAS files. */
int framer_new(const struct profile *, framer_sink, void *ctx, struct framer **ret, struct err *);
struct framer *framer_free(struct framer *);
/* Told of each bad telegram and of each stretch of garbage, once it is over, in order of the stream. */
void framer_on_bad(struct framer *, void (*told)(void *ctx, enum framer_reason, uint64_t offset, uint64_t size), void *ctx);
int framer_feed(struct framer *, const void *at, size_t size, int64_t time_ns);
/* Bytes are missing here (an overflow, an unplug): what was begun is bad, and so is what a LINE goes on with. */
int framer_gap(struct framer *);
int framer_end(struct framer *); /* what was begun and has no end is bad; a last line without line end is one */
void framer_counts(const struct framer *, struct framer_counts *ret);

#endif
