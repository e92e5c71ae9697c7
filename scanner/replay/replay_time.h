/* When a sweep was: from the monotonic times of transfers, the wall clock's, and the device's own. */
#ifndef REPLAY_TIME_H
#define REPLAY_TIME_H

#include "replay.h"

struct replay_time {
	struct replay_clock clock;
	/* the device's clock; all of it since its last restart */
	bool running, restarted; /* restarted: with the last sweep, and nobody said so before */
	double raw_s, wraps_s;   /* of the last sweep; and what its wraps come to */
	double arrival_s;        /* of the last sweep, monotonic */
	double offset_s;         /* monotonic time less the device's */
	double span_s;           /* of all stretches */
};

void replay_time_init(struct replay_time *, const struct replay_clock *);
void replay_time_clock(struct replay_time *, const struct replay_clock *);
void replay_time_restart(struct replay_time *); /* the device's clock begins anew */
double replay_time_utc(const struct replay_time *, int64_t monotonic_ns);
/* UTC seconds of the sweep's first shot; *ret_device_s: the device's time of it without wraps, 0 if it has none. */
double replay_time_of(struct replay_time *, const struct profile *, const struct sweep *, int64_t first_ns, double *ret_device_s);

#endif
