/* Information of the kernel about this process. Thread-safe. */
#ifndef PROCESS_H
#define PROCESS_H

#include <stdint.h>

uint64_t process_peak_rss(void); /* VmHWM, bytes; 0: unknown */
uint64_t process_rss(void);      /* VmRSS */
unsigned process_threads(void);
unsigned process_open_files(void);

#endif
