/* Numbers and times as people read them; each returns buf. */
#ifndef TERM_TEXT_H
#define TERM_TEXT_H

#include <stdint.h>

char *term_count(uint64_t n, char buf[32]); /* 1,234,567 */
char *term_time(int64_t us, char buf[32]);  /* since 1970: 2026-02-01T10:00:00Z; 0 and less: - */

#endif
