/* Time: monotonic for durations, real for timestamps. The only code that asks the system for the time. */
#ifndef CLOCK_H
#define CLOCK_H

#include <stdint.h>

uint64_t clock_mono_ns(void);
int64_t clock_real_us(void);          /* since 1970, UTC */
double clock_since(uint64_t mono_ns); /* seconds */

#endif
