/*
 * The log: lines to stderr, with the level prefixes of systemd ("<6>") if stderr is the journal, else "acutd: info:
 * ..."; or entries to a sink. Engine rooms never log above debug; the outermost function of the daemon logs a failure
 * once. Preserves errno.
 *
 * Messages that an administrator may filter, count or get alerts from are events: rows of log_event.def with a message id,
 * logged with their subject. All others are lines. Control characters (names from clients may have them), and bytes that
 * are not UTF-8, are shown as '?'.
 */
#ifndef LOG_H
#define LOG_H

#include <stdbool.h>
#include <stdint.h>

enum log_level { LOG_LEVEL_ERROR, LOG_LEVEL_WARNING, LOG_LEVEL_NOTICE, LOG_LEVEL_INFO, LOG_LEVEL_DEBUG };

struct err;

enum log_event {
#define EVENT(name, id, level, subject) LOG_EVENT_##name,
#include "log_event.def"
#undef EVENT
	LOG_EVENTS
};

/* The subject of an event; members that are 0 or NULL are not logged. Texts are borrowed for the call. */
struct log_about {
	uint64_t job, push, generation;
	const char *dataset;
	const char *file;  /* NULL: the file of the err, if there is one */
	const char *code;  /* wire name of an error; NULL: of the err, if there is one */
	bool has_user;     /* uid is valid */
	uint32_t uid, pid; /* pid: of the client */
};
#define ABOUT_USER(user) .has_user = true, .uid = (user)

struct log_place { /* place in the source */
	const char *file, *function;
	int line;
};
#define LOG_HERE (&(const struct log_place){__FILE__, __func__, __LINE__})

struct log_entry {
	enum log_level level;
	int event;                     /* enum log_event; -1: a line */
	const char *message;           /* sanitized, one line */
	const struct log_about *about; /* never NULL; its texts are sanitized */
	const struct log_place *place;
};
/* Called by any thread. False: it could not be written, and goes to stderr. */
typedef bool log_sink_fn(void *ctx, const struct log_entry *);

void log_init(const char *program, enum log_level level);
void log_set_level(enum log_level);
bool log_enabled(enum log_level); /* whether lines of this level are logged */
/* Call it before there are threads. NULL: stderr. */
void log_set_sink(log_sink_fn *, void *ctx);
/* Whether stderr is the stream that systemd made for the journal. */
bool log_is_journal(void);
bool log_parse_level(const char *text, enum log_level *ret);

const char *log_event_name(enum log_event);
const char *log_event_id(enum log_event); /* 32 hexadecimal digits */
const char *log_event_subject(enum log_event);
enum log_level log_event_level(enum log_event);
/* Logs how many events were suppressed in periods that are over; all: in the current one, too, before the program ends. */
void log_report_suppressed(bool all);
/* How often the event has occurred since the start, whatever the log level. */
uint64_t log_event_count(enum log_event);

#define log_line(level, ...) log_line_at(LOG_HERE, level, __VA_ARGS__)
/* "what: message (hint)" */
#define log_err(level, what, err) log_err_at(LOG_HERE, level, what, err)
/* about: a struct log_about *, or NULL */
#define log_event(event, ...) log_event_at(LOG_HERE, event, __VA_ARGS__) /* about, fmt, ... */
/* "what: message (hint)"; file and code of the error become fields */
#define log_event_err(event, ...) log_event_err_at(LOG_HERE, event, __VA_ARGS__) /* about, what, err */

void log_line_at(const struct log_place *, enum log_level, const char *fmt, ...) __attribute__((format(printf, 3, 4)));
void log_err_at(const struct log_place *, enum log_level, const char *what, const struct err *err);
void log_event_at(const struct log_place *, enum log_event, const struct log_about *, const char *fmt, ...)
	__attribute__((format(printf, 4, 5)));
void log_event_err_at(const struct log_place *, enum log_event, const struct log_about *, const char *what,
		      const struct err *err);

#define log_error(...) log_line(LOG_LEVEL_ERROR, __VA_ARGS__)
#define log_warning(...) log_line(LOG_LEVEL_WARNING, __VA_ARGS__)
#define log_notice(...) log_line(LOG_LEVEL_NOTICE, __VA_ARGS__)
#define log_info(...) log_line(LOG_LEVEL_INFO, __VA_ARGS__)
#define log_debug(...) log_line(LOG_LEVEL_DEBUG, __VA_ARGS__)

#endif
