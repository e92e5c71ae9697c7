/*
 * The spool: the bytes from the wire, with the time and number of each transfer. It is written while a scanner is
 * captured, before the bytes are decoded; decoding reads spools only. spool.md describes the bytes.
 *
 * A spool is one file that only grows: a head, then records, each with its own checksum. What a power cut leaves is a
 * valid prefix: a reader stops before the first incomplete record and reports how many bytes follow it.
 */
#ifndef SPOOL_H
#define SPOOL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

enum { SPOOL_TEXT_SIZE = 128, SPOOL_PROFILE_MAX = 64 << 10, SPOOL_PAYLOAD_MAX = 16 << 20 };

/* The captured device, and how. Texts are UTF-8 without control characters; "" if the device does not have them. */
struct spool_head {
	uint8_t id[16]; /* random; identifies the capture */
	uint16_t vendor, product;
	char manufacturer[SPOOL_TEXT_SIZE], model[SPOOL_TEXT_SIZE], serial[SPOOL_TEXT_SIZE];
	char port[SPOOL_TEXT_SIZE]; /* "BUS-PORT.PORT" as in the kernel; "file" for an imported dump */
	char profile_name[SPOOL_TEXT_SIZE];
	/* text of the profile that captured it, so that it can be decoded even if the profile was removed or changed;
	 * allocated, zero-terminated */
	char *profile;
	size_t profile_size;
	char boot_id[40];     /* monotonic times are comparable within one boot; "" if unknown */
	int64_t utc_ns;       /* wall clock (UTC since 1970) ... */
	int64_t monotonic_ns; /* ... at this moment of CLOCK_MONOTONIC */
};
void spool_head_clear(struct spool_head *); /* frees its members */

enum spool_kind {
	SPOOL_DATA = 1,  /* bytes of a completed transfer */
	SPOOL_EVENT = 2, /* an event: one line of text; its first word is one of those below */
	SPOOL_CLOCK = 3, /* the wall clock: 8 bytes, UTC nanoseconds */
	SPOOL_SENT = 4,  /* bytes of a command that was sent to the device */
	SPOOL_END = 5,   /* the regular end of a capture: totals; nothing follows */
};
/* First words of events: "stall", "cleared", "overflow" (babble), "timeout", "error", "parked" (nanoseconds), "overrun"
 * (the device reports that it dropped data while the host was parked), "left", "back", "stop" (and why), "continued"
 * (after a crash, with the boot's id, or -; monotonic times restart if the boot is another one, and a CLOCK follows). */

enum { SPOOL_SHORT = 1, SPOOL_AFTER_GAP = 2, SPOOL_WITH_ERROR = 4 }; /* flags of a DATA record */

struct spool_record {
	enum spool_kind kind;
	unsigned flags;
	uint64_t seq;      /* number of the record in the spool, from 0, without gaps */
	int64_t time_ns;   /* CLOCK_MONOTONIC at the completion of the transfer */
	const uint8_t *at; /* memory of the reader, until its next call */
	size_t size;
	uint64_t offset; /* of the record in the file */
};

/* ---- writing: one thread ---- */

struct spool_writer;
struct spool_totals {
	uint64_t records, transfers, bytes, events; /* bytes: of DATA payloads */
	uint64_t durable;                           /* bytes of DATA payloads that survive a power cut */
	uint64_t waits, wait_ns;                    /* how often spool_append waited for the disk, and how long */
	uint8_t sha256[32];                         /* of all DATA payloads so far, in order */
};
/* Creates a file; never overwrites an existing one (-ERR_USAGE). head->id, boot_id and times are set if they are zero;
 * texts are sanitized. File and folder are durable when this returns. The file is locked while it is written (-ERR_BUSY
 * from spool_continue). */
int spool_create(const char *path, struct spool_head *, struct spool_writer **ret, struct err *);
/* Continues a spool that has no END (-ERR_USAGE): cuts off an incomplete record at its end, and appends "continued" and
 * a CLOCK. Reads the whole file, for the totals. The caller checks from the head that it is the same device. */
int spool_continue(const char *path, struct spool_head *ret_head, struct spool_writer **ret, struct err *);
/* Appends a record: written when it returns, durable after spool_sync. After an error the writer accepts no more
 * records; those before it are complete, and spool_sync still makes them durable, unless an fsync failed. */
int spool_append(struct spool_writer *, enum spool_kind, unsigned flags, int64_t time_ns, const void *at, size_t size,
		 struct err *);
int spool_event(struct spool_writer *, int64_t time_ns, struct err *, const char *fmt, ...) __attribute__((format(printf, 4, 5)));
int spool_clock(struct spool_writer *, struct err *); /* appends a CLOCK with the current time */
int spool_sync(struct spool_writer *, struct err *);  /* a failed fsync is never repeated: the writer has failed */
/* From now on a thread makes appended records durable: after `seconds`, or when `bytes` are pending. Appending
 * continues meanwhile, until four times `bytes` are pending. A failure is returned by the next call. */
int spool_flush_start(struct spool_writer *, double seconds, uint64_t bytes, struct err *);
void spool_totals(struct spool_writer *, struct spool_totals *ret);
/* Appends END and fsyncs. Without it, spool_writer_free leaves a spool without END, like a kill. */
int spool_end(struct spool_writer *, struct err *);
struct spool_writer *spool_writer_free(struct spool_writer *);

/* ---- reading: constant memory, from a file or a pipe ---- */

struct spool_reader;
/* `fd` belongs to the reader from now on, also on failure. `name`: for messages. -ERR_INPUT: not a spool;
 * -ERR_TRUNCATED: its head is incomplete, so nothing was captured; -ERR_VERSION: a newer one. */
int spool_open(int fd, const char *name, struct spool_reader **ret, struct err *);
const struct spool_head *spool_reader_head(const struct spool_reader *);
/* 1: a record; 0: the end. -ERR_INPUT: a record in the middle is damaged (valid records follow, so it is not an
 * incomplete end); spool_skip continues behind it. */
int spool_next(struct spool_reader *, struct spool_record *ret, struct err *);
int spool_skip(struct spool_reader *, uint64_t *ret_bytes, struct err *);
/* The totals of an END record (durable, waits: 0). -ERR_INPUT: invalid. */
int spool_totals_read(const struct spool_record *, struct spool_totals *ret, struct err *);
struct spool_tail {
	bool ended;        /* it has an END record */
	bool head_damaged; /* the first of the two heads is damaged; the second was read */
	uint64_t torn;     /* bytes after the last complete record */
	uint64_t whole;    /* offset behind that record */
};
/* After spool_next returned 0 (head_damaged: at any time). */
void spool_tail(const struct spool_reader *, struct spool_tail *ret);
struct spool_reader *spool_reader_free(struct spool_reader *);

#endif
