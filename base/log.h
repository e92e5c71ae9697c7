/*
 * The log: lines to stderr with level prefixes as systemd reads them ("<6>") when stderr is the journal,
 * "acutd: info: ..." otherwise. Engine rooms never log above debug; the outermost function of the daemon
 * logs a failure once. Saves errno.
 */
#ifndef LOG_H
#define LOG_H

#include <stdbool.h>

enum log_level { LOG_LEVEL_ERROR, LOG_LEVEL_WARNING, LOG_LEVEL_NOTICE, LOG_LEVEL_INFO, LOG_LEVEL_DEBUG };

struct err;

void log_init(const char *program, enum log_level level);
bool log_parse_level(const char *text, enum log_level *ret);
void log_line(enum log_level, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
void log_err(enum log_level, const char *what, const struct err *err); /* "what: message (hint)" */

#define log_error(...) log_line(LOG_LEVEL_ERROR, __VA_ARGS__)
#define log_warning(...) log_line(LOG_LEVEL_WARNING, __VA_ARGS__)
#define log_notice(...) log_line(LOG_LEVEL_NOTICE, __VA_ARGS__)
#define log_info(...) log_line(LOG_LEVEL_INFO, __VA_ARGS__)
#define log_debug(...) log_line(LOG_LEVEL_DEBUG, __VA_ARGS__)

#endif
