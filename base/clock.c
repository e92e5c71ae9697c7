/*
 * Time (clock.h). CLOCK_MONOTONIC for durations, so that setting the clock does not move a deadline; CLOCK_REALTIME
 * only for timestamps that people read.
 */
#include "clock.h"

#include <time.h>

uint64_t clock_mono_ns(void)
{
	struct timespec t;

	clock_gettime(CLOCK_MONOTONIC, &t);
	return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

int64_t clock_real_us(void)
{
	struct timespec t;

	clock_gettime(CLOCK_REALTIME, &t);
	return (int64_t)t.tv_sec * 1000000 + t.tv_nsec / 1000;
}

double clock_since(uint64_t mono_ns)
{
	uint64_t now = clock_mono_ns();

	return now > mono_ns ? (double)(now - mono_ns) / 1e9 : 0;
}
