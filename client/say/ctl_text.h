/* Numbers and times as people read them; each returns buf. */
#ifndef CTL_TEXT_H
#define CTL_TEXT_H

#include <stdint.h>

char *ctl_text_count(uint64_t n, char buf[32]); /* 1,234,567 */
char *ctl_text_time(int64_t us, char buf[32]);  /* since 1970: 2026-02-01T10:00:00Z; 0 and less: - */

#endif
