/*
 * Replay: the records of a spool, or the buffers of a capture that runs, to telegrams and sweeps with their times. One
 * pass, constant memory, no clock: the same records are the same sweeps and times. `replay`, `probe`, `push` and the
 * telegram count of `record` are this.
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

/* Where the monotonic clock stands in UTC: of the spool's head, then of each CLOCK record. */
struct replay_clock {
	int64_t utc_ns, monotonic_ns;
};

struct replay_sweep {
	const struct sweep *sweep; /* until the sink returns */
	const struct telegram *telegram;
	double utc_s;         /* of the first shot, since 1970 */
	double device_time_s; /* of the sweep, without its wraps since the device was started; 0 */
	uint64_t lost;        /* sweeps that the device counted since the one before and that are not here */
	bool repeated;        /* the same counter and bytes as the one before: the telegram came twice */
	bool after_gap;       /* bytes were lost before it */
};

enum replay_bad { REPLAY_BAD_FRAMER, REPLAY_BAD_DECODER };
struct replay_fault {
	enum replay_bad by;
	enum framer_reason reason; /* by FRAMER */
	uint64_t offset, size;     /* in the stream of the payloads of DATA records */
	const struct err *err;     /* by DECODER: its sentence; NULL */
};

/* Each may be NULL; a non-zero answer of those that have one ends the replay with it. */
struct replay_sinks {
	void *ctx;
	int (*telegram)(void *ctx, const struct telegram *);  /* all good ones, before they are decoded */
	int (*sweep)(void *ctx, const struct replay_sweep *); /* decoders of kind SWEEP */
	int (*points)(void *ctx, const struct telegram *);    /* of kind POINTS: a line of XYZ, a piece of LAS */
	void (*fault)(void *ctx, const struct replay_fault *);
};

struct replay_counts {
	struct framer_counts framer;
	uint64_t records, transfers, bytes; /* bytes: of DATA */
	uint64_t gaps;                      /* places where bytes are missing, as the records say */
	uint64_t sweeps, shots, returns;    /* returns: shots that have a range */
	uint64_t points;                    /* telegrams given to sinks.points */
	uint64_t not_data, undecoded;       /* good telegrams without a sweep (answers), and bad ones of the decoder */
	uint64_t lost, repeated, dirty;     /* sweeps: counted by the device and not here; came twice; window dirty */
	uint64_t restarts;                  /* the device's counter or clock began anew, with no "left" to say why */
	uint64_t clock_sets; /* times that the computer's clock was set meanwhile, by more than REPLAY_CLOCK_SET_S */
	double clock_moved_s, clock_most_s; /* by all of them, onwards above 0; by the largest, either way */
	bool has_times;
	double first_utc_s, last_utc_s; /* of sweeps, else of transfers with a telegram */
	double device_span_s;           /* by the device's own clock, of the stretches without a restart; 0 */
	char device_serial[32];         /* of the last sweep; "" */
};

struct replay;
/* The profile is copied. -ERR_INPUT: there is no such decoder. */
int replay_new(const struct profile *, const struct replay_clock *, const struct replay_sinks *, struct replay **ret,
	       struct err *);
struct replay *replay_free(struct replay *);
/* The clock of a spool's head. */
struct replay_clock replay_clock_of(const struct spool_head *);
/* DATA is fed; CLOCK sets the clock; events that say that bytes are missing (overflow, overrun, left, back, continued, error) and
 * flags AFTER_GAP are gaps; SENT is not looked at. END ends as replay_end. 0, or what a sink answered. */
int replay_record(struct replay *, const struct spool_record *);
/* The same of a capture that runs. */
int replay_feed(struct replay *, const void *at, size_t size, int64_t monotonic_ns);
int replay_gap(struct replay *);
/* The stream ends; call it once, also after END (then it does nothing). */
int replay_end(struct replay *);
void replay_counts(const struct replay *, struct replay_counts *ret);

/*
 * Times of sweeps. ARRIVAL: the transfer that began the telegram, less latency_s, is the moment of the last shot; the
 * first one is the sweep's duration before that. DEVICE: the device's clock, set by the quickest telegrams: its offset is
 * the smallest difference to such a moment, let grow by REPLAY_DRIFT of the time that passes (two crystals differ), so
 * that a telegram that waited somewhere does not move its sweep. After a restart of the device it is found anew.
 */
#define REPLAY_DRIFT 200e-6
#define REPLAY_CLOCK_SET_S 0.05

#endif
