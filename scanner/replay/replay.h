/*
 * Replay: the records of a spool, or the buffers of a running capture, to telegrams and sweeps with their times. One
 * pass, constant memory, no clock: the same records give the same sweeps and times. `replay`, `probe`, `push` and the
 * telegram count of `record` use this.
 */
#ifndef REPLAY_H
#define REPLAY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "framer.h"

struct err;
struct profile;
struct spool_head;
struct spool_record;
struct sweep;

/* The UTC time at a moment of the monotonic clock: from the spool's head, then from each CLOCK record. */
struct replay_clock {
	int64_t utc_ns, monotonic_ns;
};

struct replay_sweep {
	const struct sweep *sweep; /* valid until the sink returns */
	const struct telegram *telegram;
	double utc_s;         /* of the first shot, since 1970 */
	double device_time_s; /* of the sweep, without wraps since the device was started; or 0 */
	uint64_t lost;        /* sweeps since the previous one that the device counted and that are missing */
	bool repeated;        /* same counter and bytes as the previous one: the telegram came twice */
	bool after_gap;       /* bytes were lost before it */
};

enum replay_bad { REPLAY_BAD_FRAMER, REPLAY_BAD_DECODER };
struct replay_fault {
	enum replay_bad by;
	enum framer_reason reason; /* for FRAMER */
	uint64_t offset, size;     /* in the stream of the payloads of DATA records */
	const struct err *err;     /* for DECODER: its error; else NULL */
};

/* Each may be NULL; a non-zero result ends the replay with it. */
struct replay_sinks {
	void *ctx;
	int (*telegram)(void *ctx, const struct telegram *);  /* all valid ones, before they are decoded */
	int (*sweep)(void *ctx, const struct replay_sweep *); /* decoders of kind SWEEP */
	int (*points)(void *ctx, const struct telegram *);    /* of kind POINTS: a line of XYZ, a piece of LAS */
	void (*fault)(void *ctx, const struct replay_fault *);
};

struct replay_counts {
	struct framer_counts framer;
	uint64_t records, transfers, bytes; /* bytes: of DATA */
	uint64_t gaps;                      /* places where bytes are missing, according to the records */
	uint64_t sweeps, shots, returns;    /* returns: shots with a range */
	uint64_t points;                    /* telegrams passed to sinks.points */
	uint64_t not_data, undecoded;       /* valid telegrams without a sweep (answers), and those that the decoder rejected */
	uint64_t lost, repeated, dirty;     /* sweeps: counted by the device and missing; repeated; with a dirty window */
	uint64_t restarts;                  /* restarts of the device's counter or clock without a "left" event */
	uint64_t clock_sets; /* how often the computer's clock was set meanwhile, by more than REPLAY_CLOCK_SET_S */
	double clock_moved_s, clock_most_s; /* by all of them, positive if forwards; by the largest, in either direction */
	bool has_times;
	double first_utc_s, last_utc_s; /* of sweeps, or else of transfers with a telegram */
	double device_span_s;           /* by the device's clock, of the intervals without a restart; or 0 */
	char device_serial[32];         /* of the last sweep; or "" */
};

struct replay;
/* The profile is copied. -ERR_INPUT: there is no such decoder. */
int replay_new(const struct profile *, const struct replay_clock *, const struct replay_sinks *, struct replay **ret,
	       struct err *);
struct replay *replay_free(struct replay *);
/* The clock of a spool's head. */
struct replay_clock replay_clock_of(const struct spool_head *);
/* Feeds DATA; sets the clock for CLOCK; treats events that report missing bytes (overflow, overrun, left, back,
 * continued, error) and the flag AFTER_GAP as gaps; ignores SENT. END is like replay_end. 0, or the result of a sink. */
int replay_record(struct replay *, const struct spool_record *);
/* The same for a running capture. */
int replay_feed(struct replay *, const void *at, size_t size, int64_t monotonic_ns);
int replay_gap(struct replay *);
/* Ends the stream; call it once, also after END (then it does nothing). */
int replay_end(struct replay *);
void replay_counts(const struct replay *, struct replay_counts *ret);

/*
 * Times of sweeps. ARRIVAL: the last shot is at the time of the transfer that began the telegram, minus latency_s; the
 * first shot is the sweep's duration before that. DEVICE: the device's clock, synchronized by the fastest telegrams:
 * its offset is the smallest difference to such a moment, which may grow by REPLAY_DRIFT of the elapsed time (two
 * oscillators differ), so that a delayed telegram does not shift its sweep. After a restart of the device the offset is
 * determined again.
 */
#define REPLAY_DRIFT 200e-6
#define REPLAY_CLOCK_SET_S 0.05

#endif
