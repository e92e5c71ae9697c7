/* The time of a sweep, from the monotonic times of transfers, the wall clock, and the device's own clock. */
#ifndef REPLAY_TIME_H
#define REPLAY_TIME_H

#include "replay.h"

struct replay_time {
	struct replay_clock clock;
	/* the device's clock, since its last restart */
	bool running, restarted; /* restarted: detected with the last sweep, not reported before */
	double raw_s, wraps_s;   /* of the last sweep; sum of its wraps */
	double arrival_s;        /* of the last sweep, monotonic */
	double offset_s;         /* monotonic time minus the device's */
	double span_s;           /* of all intervals */
};

void replay_time_init(struct replay_time *, const struct replay_clock *);
void replay_time_clock(struct replay_time *, const struct replay_clock *);
void replay_time_restart(struct replay_time *); /* the device's clock is restarted */
double replay_time_utc(const struct replay_time *, int64_t monotonic_ns);
/* UTC seconds of the sweep's first shot; *ret_device_s: its device time without wraps, or 0. */
double replay_time_of(struct replay_time *, const struct profile *, const struct sweep *, int64_t first_ns, double *ret_device_s);

#endif
