/* Strict parsing: true only if the whole text is valid. */
#ifndef PARSE_H
#define PARSE_H

#include <stdbool.h>
#include <stdint.h>

bool parse_u64(const char *text, uint64_t *ret);
bool parse_i64(const char *text, int64_t *ret);
bool parse_double(const char *text, double *ret);  /* finite */
bool parse_size(const char *text, uint64_t *ret);  /* 24M, 1G, 512K, 1.5G; powers of 1024 */
bool parse_many(const char *text, uint64_t *ret);  /* 12, 12k, 12M, 1.5G; powers of 1000 */
bool parse_seconds(const char *text, double *ret); /* 90, 90s, 5m, 2h, 7d; up to 10^10 s, whose nanoseconds fit uint64_t */

/* "1.2 GB", "340 MB": for people. Returns buf (at least 32 bytes). */
char *parse_size_text(uint64_t bytes, char *buf);

#endif
