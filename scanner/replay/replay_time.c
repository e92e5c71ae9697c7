/*
 * The model is in replay.h. Times are doubles: seconds since 1970 have a resolution of 0.2 microseconds, better than a
 * scanner's. The device's clock is compared with the monotonic clock, which does not jump; the wall clock is applied
 * last.
 */
#include "replay_time.h"

#include <math.h>

#include "decoder.h"
#include "profile.h"

void replay_time_init(struct replay_time *t, const struct replay_clock *clock)
{
	*t = (struct replay_time){.clock = *clock};
}

void replay_time_clock(struct replay_time *t, const struct replay_clock *clock)
{
	t->clock = *clock;
}

void replay_time_restart(struct replay_time *t)
{
	t->running = false;
}

static double utc_of(const struct replay_time *t, double monotonic_s)
{
	return t->clock.utc_ns / 1e9 + (monotonic_s - t->clock.monotonic_ns / 1e9);
}

double replay_time_utc(const struct replay_time *t, int64_t monotonic_ns)
{
	return utc_of(t, monotonic_ns / 1e9);
}

/* The device's time without wraps: the number of wraps that best fits the time between the arrivals. A clock that then
 * still goes back, or that deviates from the monotonic one by more than a telegram can be delayed, was restarted. */
static double unwrap(struct replay_time *t, const struct sweep *s, double arrival_s)
{
	double passed = arrival_s - t->arrival_s, late = 2;

	if (t->running) {
		double ahead = s->device_time_s - t->raw_s,
		       turns = s->device_wrap_s > 0 ? round((passed - ahead) / s->device_wrap_s) : 0;

		ahead += turns * s->device_wrap_s;
		if (fabs(ahead - passed) > late + passed * REPLAY_DRIFT) {
			t->running = false;
		} else {
			t->wraps_s += turns * s->device_wrap_s;
			if (ahead > 0)
				t->span_s += ahead;
		}
	}
	if (!t->running)
		t->wraps_s = 0;
	t->raw_s = s->device_time_s;
	t->arrival_s = arrival_s;
	return s->device_time_s + t->wraps_s;
}

double replay_time_of(struct replay_time *t, const struct profile *p, const struct sweep *s, int64_t first_ns,
		      double *ret_device_s)
{
	double arrival = first_ns / 1e9 - p->latency_s - sweep_duration(s); /* monotonic, of the first shot */
	double before = t->arrival_s, device;
	bool ran = t->running;

	*ret_device_s = 0;
	t->restarted = false;
	if (!s->has_device_time)
		return utc_of(t, arrival);
	*ret_device_s = device = unwrap(t, s, arrival);
	if (!ran || !t->running)
		t->offset_s = arrival - device;
	else
		t->offset_s = fmin(arrival - device, t->offset_s + REPLAY_DRIFT * fabs(arrival - before));
	t->restarted = ran && !t->running;
	t->running = true;
	return utc_of(t, p->time == PROFILE_TIME_DEVICE ? device + t->offset_s : arrival);
}
