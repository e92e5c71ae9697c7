/*
 * The spool: what came over the wire, byte for byte, with the time and number of each transfer. Written while a
 * scanner is captured, before anybody looks at the bytes; decoding reads spools only. SPOOL.md has it byte by byte.
 *
 * A spool is one file that only grows: a head, then records, each with its own checksum. What a power cut leaves is a
 * valid beginning: a reader stops before the first record that is not whole and says how many bytes follow it.
 */
#ifndef SPOOL_H
#define SPOOL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

enum { SPOOL_TEXT_SIZE = 128, SPOOL_PROFILE_MAX = 64 << 10, SPOOL_PAYLOAD_MAX = 16 << 20 };

/* Who was captured, and how. Texts are UTF-8 without control characters; "" where a device does not say. */
struct spool_head {
	uint8_t id[16]; /* random; tells one capture from all others */
	uint16_t vendor, product;
	char manufacturer[SPOOL_TEXT_SIZE], model[SPOOL_TEXT_SIZE], serial[SPOOL_TEXT_SIZE];
	char port[SPOOL_TEXT_SIZE]; /* "BUS-PORT.PORT" as the kernel names it; "file" for an imported dump */
	char profile_name[SPOOL_TEXT_SIZE];
	char *profile; /* text of the profile that captured it, so that it is decoded the same
			  wherever the profile is gone or has changed; malloced, NUL at its end */
	size_t profile_size;
	char boot_id[40];     /* monotonic times compare within one boot; "" where it cannot be known */
	int64_t utc_ns;       /* wall clock (UTC since 1970) ... */
	int64_t monotonic_ns; /* ... at this moment of CLOCK_MONOTONIC */
};
void spool_head_clear(struct spool_head *); /* frees what it holds */

enum spool_kind {
	SPOOL_DATA = 1,  /* bytes of one completed transfer */
	SPOOL_EVENT = 2, /* something happened: one line of text, its first word one of the names below */
	SPOOL_CLOCK = 3, /* where the wall clock stands: 8 bytes, UTC nanoseconds */
	SPOOL_SENT = 4,  /* bytes of a command that was sent to the device */
	SPOOL_END = 5,   /* capture ended as it should: totals; nothing follows */
};
/* First words of events: "stall", "cleared", "overflow" (babble), "timeout", "error", "parked" (nanoseconds),
 * "overrun" (the device dropped data while we were parked, as it says itself), "left", "back", "stop" (and why),
 * "continued" (and the boot's id, or -: after a crash; monotonic times begin anew where the boot is another one than
 * before. A CLOCK follows). */

enum { SPOOL_SHORT = 1, SPOOL_AFTER_GAP = 2, SPOOL_WITH_ERROR = 4 }; /* flags of a DATA record */

struct spool_record {
	enum spool_kind kind;
	unsigned flags;
	uint64_t seq;      /* of all records of the spool, from 0, without a gap */
	int64_t time_ns;   /* CLOCK_MONOTONIC when the transfer was completed */
	const uint8_t *at; /* the reader's, until its next call */
	size_t size;
	uint64_t offset; /* of the record in the file */
};

/* ---- writing: one thread ---- */

struct spool_writer;
struct spool_totals {
	uint64_t records, transfers, bytes, events; /* bytes: of DATA payloads */
	uint64_t durable;                           /* bytes of DATA payloads that outlive a power cut */
	uint64_t waits, wait_ns;                    /* times that spool_append waited for the disk, and how long */
	uint8_t sha256[32];                         /* of all DATA payloads so far, in order */
};
/* A new file; one that is there is never written over (-ERR_USAGE). head->id, boot_id and times are filled in if zero;
 * texts are made what the head says of them. The file is made durable with its folder before this returns. It is locked
 * as long as it is written (-ERR_BUSY of spool_continue). */
int spool_create(const char *path, struct spool_head *, struct spool_writer **ret, struct err *);
/* Goes on with a spool that has no END (-ERR_USAGE): what is torn at its end is cut off first, "continued" and a CLOCK
 * are appended. Reads all of it, for the totals. Whether it is the same device is for the caller to see, from the head. */
int spool_continue(const char *path, struct spool_head *ret_head, struct spool_writer **ret, struct err *);
/* Appends; written when it returns, durable after spool_sync. After an error the writer takes no more records; those
 * before it are whole, and spool_sync still makes them durable, unless it was fsync that failed. */
int spool_append(struct spool_writer *, enum spool_kind, unsigned flags, int64_t time_ns, const void *at, size_t size,
		 struct err *);
int spool_event(struct spool_writer *, int64_t time_ns, struct err *, const char *fmt, ...) __attribute__((format(printf, 4, 5)));
int spool_clock(struct spool_writer *, struct err *); /* a CLOCK of now */
int spool_sync(struct spool_writer *, struct err *);  /* an fsync that failed is never repeated: the writer is dead */
/* From here on a thread of the writer's own makes durable what was appended: `seconds` after it was, at the latest when
 * `bytes` wait for it; the disk may be slow, appending goes on meanwhile, until four times `bytes` wait. Its failure is
 * that of the next call. */
int spool_flush_start(struct spool_writer *, double seconds, uint64_t bytes, struct err *);
void spool_totals(struct spool_writer *, struct spool_totals *ret);
/* END and fsync. spool_writer_free without it leaves a spool without END, as a kill does. */
int spool_end(struct spool_writer *, struct err *);
struct spool_writer *spool_writer_free(struct spool_writer *);

/* ---- reading: constant memory, from a file or a pipe ---- */

struct spool_reader;
/* `fd` is the reader's from now on, also where this fails. `name` is what messages call it. -ERR_INPUT: no spool;
 * -ERR_TRUNCATED: its head was not written whole, so that nothing was captured; -ERR_VERSION: a newer one. */
int spool_open(int fd, const char *name, struct spool_reader **ret, struct err *);
const struct spool_head *spool_reader_head(const struct spool_reader *);
/* 1: a record; 0: the end. -ERR_INPUT: a record is damaged in the middle (bytes after it are valid records: it is no
 * torn tail); spool_skip goes on behind it. */
int spool_next(struct spool_reader *, struct spool_record *ret, struct err *);
int spool_skip(struct spool_reader *, uint64_t *ret_bytes, struct err *);
/* The totals of an END record (durable, waits: 0). -ERR_INPUT: it is none. */
int spool_totals_read(const struct spool_record *, struct spool_totals *ret, struct err *);
struct spool_tail {
	bool ended;        /* an END record stands there */
	bool head_damaged; /* the first of the two heads is; the second was read */
	uint64_t torn;     /* bytes after the last whole record */
	uint64_t whole;    /* place behind that record */
};
/* Once spool_next gave 0 (head_damaged: from the beginning). */
void spool_tail(const struct spool_reader *, struct spool_tail *ret);
struct spool_reader *spool_reader_free(struct spool_reader *);

#endif
