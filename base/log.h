/*
 * The log: lines to stderr with level prefixes as systemd reads them ("<6>") when stderr is the journal,
 * "acutd: info: ..." otherwise; or entries to a sink that was handed in. Engine rooms never log above debug; the
 * outermost function of the daemon logs a failure once. Saves errno.
 *
 * What an administrator may want to filter, count or be woken by is an event: a row of log_event.def with a message
 * id, told with what it is about. All else is a line. Control characters (names of strangers may hold them) are
 * shown as '?' in texts and fields, and so are bytes that are no UTF-8.
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

/* What an event is about; what is 0 or NULL is not told. Texts are borrowed for the call. */
struct log_about {
	uint64_t job, push, generation;
	const char *dataset;
	const char *file;  /* NULL: that of the err, if there is one */
	const char *code;  /* wire name of an error; NULL: likewise */
	bool has_user;     /* uid counts */
	uint32_t uid, pid; /* pid: of the client */
};
#define ABOUT_USER(user) .has_user = true, .uid = (user)

struct log_place { /* in the source */
	const char *file, *function;
	int line;
};
#define LOG_HERE (&(const struct log_place){__FILE__, __func__, __LINE__})

struct log_entry {
	enum log_level level;
	int event;                     /* enum log_event; -1: a line */
	const char *message;           /* clean, one line */
	const struct log_about *about; /* never NULL; its texts are clean */
	const struct log_place *place;
};
/* Any thread. False: it cannot be written there, and goes to stderr. */
typedef bool log_sink_fn(void *ctx, const struct log_entry *);

void log_init(const char *program, enum log_level level);
void log_set_level(enum log_level);
bool log_shows(enum log_level); /* whether lines of this level are told */
/* Before threads. NULL: stderr. */
void log_set_sink(log_sink_fn *, void *ctx);
/* Whether stderr is the stream that systemd made for its journal. */
bool log_is_journal(void);
bool log_parse_level(const char *text, enum log_level *ret);

const char *log_event_name(enum log_event);
const char *log_event_id(enum log_event); /* 32 hexadecimal digits */
const char *log_event_subject(enum log_event);
enum log_level log_event_level(enum log_event);
/* Of events that come too often only some are told: this tells how many more there were, of whiles that are over; all: of the
 * present ones too, at an end. */
void log_floods(bool all);
/* How often it was told since the start, whether or not the level let it through. */
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
