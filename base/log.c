/*
 * The log (log.h): each line is one write to stderr, so that lines of several threads do not mix; or one call of the
 * sink. Before log_init, lines are those of "acut" at level info.
 *
 * A text is formatted once, sanitized, and passed to the sink with its subject; what the sink does not accept goes to
 * stderr. Counting an event is one atomic addition, and events below the log level are counted, too. Events that a
 * client can cause at no cost are logged only up to a number in some time, so that a client cannot displace other
 * events from the journal, whose rate limit does not look at the kind. The next such event says how many were
 * suppressed.
 */
#include "log.h"

#include <errno.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "err.h"
#include "lock.h"
#include "utf8.h"

enum { LINE = 2048, FIELD = 512 };
#define FLOOD_SECONDS 30

static const struct {
	const char *text;
	char priority; /* of syslog */
} levels[] = {
	[LOG_LEVEL_ERROR] = {"error", '3'}, [LOG_LEVEL_WARNING] = {"warning", '4'}, [LOG_LEVEL_NOTICE] = {"notice", '5'},
	[LOG_LEVEL_INFO] = {"info", '6'},   [LOG_LEVEL_DEBUG] = {"debug", '7'},
};

static const struct {
	const char *name, *id, *subject;
	enum log_level level;
} events[LOG_EVENTS] = {
#define EVENT(name, id, level, subject) {#name, id, subject, LOG_LEVEL_##level},
#include "log_event.def"
#undef EVENT
};

static const char *log_program = "acut";
static _Atomic enum log_level log_most = LOG_LEVEL_INFO;
static bool log_journal;
static log_sink_fn *log_sink;
static void *log_sink_ctx;
static atomic_uint_fast64_t log_counts[LOG_EVENTS];

/* $JOURNAL_STREAM is "device:inode" of the stream from systemd; stderr may have been redirected since. */
static bool stderr_is_journal(void)
{
	const char *stream = getenv("JOURNAL_STREAM");
	unsigned long long dev, ino;
	struct stat st;

	return stream && sscanf(stream, "%llu:%llu", &dev, &ino) == 2 && fstat(STDERR_FILENO, &st) == 0 && st.st_dev == dev &&
	       st.st_ino == ino;
}

void log_init(const char *program, enum log_level level)
{
	log_program = program;
	log_most = level;
	log_journal = stderr_is_journal();
}

void log_set_level(enum log_level level)
{
	log_most = level;
}

bool log_enabled(enum log_level level)
{
	return level <= log_most;
}

void log_set_sink(log_sink_fn *sink, void *ctx)
{
	log_sink = sink;
	log_sink_ctx = ctx;
}

bool log_is_journal(void)
{
	return log_journal;
}

bool log_parse_level(const char *text, enum log_level *ret)
{
	for (unsigned i = 0; i < sizeof levels / sizeof levels[0]; i++) {
		if (strcmp(text, levels[i].text) == 0) {
			*ret = (enum log_level)i;
			return true;
		}
	}
	return false;
}

const char *log_event_name(enum log_event event)
{
	return events[event].name;
}

const char *log_event_id(enum log_event event)
{
	return events[event].id;
}

const char *log_event_subject(enum log_event event)
{
	return events[event].subject;
}

enum log_level log_event_level(enum log_event event)
{
	return events[event].level;
}

uint64_t log_event_count(enum log_event event)
{
	return atomic_load_explicit(&log_counts[event], memory_order_relaxed);
}

/* ---- untrusted texts ---- */

static void clean(char *text)
{
	unsigned char *s = (unsigned char *)text;

	while (*s) {
		size_t n = utf8_printable(s, SIZE_MAX);

		if (!n) {
			*s = '?';
			n = 1;
		}
		s += n;
	}
}

/* NULL stays NULL. */
static const char *cleaned(const char *text, char buf[FIELD])
{
	if (!text || !*text)
		return NULL;
	snprintf(buf, FIELD, "%s", text);
	clean(buf);
	return buf;
}

/* ---- writing ---- */

static void write_line(enum log_level level, const char *message)
{
	char line[LINE + 64];
	int n;

	if (log_journal)
		n = snprintf(line, sizeof line, "<%c>%s\n", levels[level].priority, message);
	else
		n = snprintf(line, sizeof line, "%s: %s: %s\n", log_program, levels[level].text, message);
	if (n < 0)
		return;
	if ((size_t)n >= sizeof line) {
		n = sizeof line - 1;
		line[n - 1] = '\n';
	}
	/* If the log itself cannot be written, there is nowhere to report it. */
	if (write(STDERR_FILENO, line, (size_t)n) < 0)
		(void)0;
}

static void write_entry(const struct log_place *place, enum log_level level, int event, const struct log_about *about,
			const char *fmt, va_list ap)
{
	char message[LINE], texts[3][FIELD];
	struct log_about a = about ? *about : (struct log_about){0};
	int saved = errno;

	vsnprintf(message, sizeof message, fmt, ap);
	clean(message);
	if (log_sink) {
		a.dataset = cleaned(a.dataset, texts[0]);
		a.file = cleaned(a.file, texts[1]);
		a.code = cleaned(a.code, texts[2]);
		if (log_sink(log_sink_ctx, &(struct log_entry){level, event, message, &a, place})) {
			errno = saved;
			return;
		}
	}
	write_line(level, message);
	errno = saved;
}

/* ---- rate limit ---- */

/* The most events in FLOOD_SECONDS; 0: no limit. */
static unsigned flood_limit(enum log_event event)
{
	switch (event) {
	case LOG_EVENT_CLIENT_CUT:
	case LOG_EVENT_CLIENT_TURNED_AWAY:
	case LOG_EVENT_GEOID_BAD:
	case LOG_EVENT_FILE_REFUSED:
		return 100;
	case LOG_EVENT_BACKUP_DONE:
		return 1000;
	default:
		return 0;
	}
}

static struct lock flood_lock = LOCK_STATIC(LOG);
static struct flood {
	uint64_t since_ns, hidden;
	unsigned logged;
} floods[LOG_EVENTS];

static void report_hidden(const struct log_place *place, enum log_event event, uint64_t hidden, double seconds)
{
	if (hidden)
		log_line_at(place, events[event].level,
			    "%s: %llu more times within %.0f seconds, which are not logged one by one", events[event].subject,
			    (unsigned long long)hidden, seconds);
}

void log_report_suppressed(bool all)
{
	for (int i = 0; i < LOG_EVENTS; i++) {
		struct flood *f = &floods[i], was = {0};

		lock_take(&flood_lock);
		if (f->hidden && (all || clock_since(f->since_ns) >= FLOOD_SECONDS)) {
			was = *f;
			*f = (struct flood){0};
		}
		lock_give(&flood_lock);
		if (was.hidden)
			report_hidden(LOG_HERE, (enum log_event)i, was.hidden, clock_since(was.since_ns));
	}
}

static bool is_suppressed(const struct log_place *place, enum log_event event)
{
	struct flood *f = &floods[event];
	unsigned most = flood_limit(event);
	uint64_t hidden = 0;
	double seconds = 0;
	bool over;

	if (!most)
		return false;
	lock_take(&flood_lock);
	if (!f->since_ns || clock_since(f->since_ns) >= FLOOD_SECONDS) {
		hidden = f->hidden;
		seconds = f->since_ns ? clock_since(f->since_ns) : 0;
		*f = (struct flood){.since_ns = clock_mono_ns()};
	}
	over = f->logged >= most;
	f->logged += !over;
	f->hidden += over;
	lock_give(&flood_lock);
	report_hidden(place, event, hidden, seconds);
	return over;
}

void log_line_at(const struct log_place *place, enum log_level level, const char *fmt, ...)
{
	va_list ap;

	if (level > log_most)
		return;
	va_start(ap, fmt);
	write_entry(place, level, -1, NULL, fmt, ap);
	va_end(ap);
}

void log_event_at(const struct log_place *place, enum log_event event, const struct log_about *about, const char *fmt, ...)
{
	enum log_level level = events[event].level;
	va_list ap;

	atomic_fetch_add_explicit(&log_counts[event], 1, memory_order_relaxed);
	if (level > log_most || is_suppressed(place, event))
		return;
	va_start(ap, fmt);
	write_entry(place, level, (int)event, about, fmt, ap);
	va_end(ap);
}

static void raised_at(const struct log_place *place, const struct err *err)
{
	if (err->src_file)
		log_line_at(place, LOG_LEVEL_DEBUG, "raised at %s:%d, errno %d", err->src_file, err->src_line, err->sys);
}

void log_err_at(const struct log_place *place, enum log_level level, const char *what, const struct err *err)
{
	char text[1400];

	log_line_at(place, level, "%s: %s", what, err_format(err, text, sizeof text));
	raised_at(place, err);
}

void log_event_err_at(const struct log_place *place, enum log_event event, const struct log_about *about, const char *what,
		      const struct err *err)
{
	struct log_about a = about ? *about : (struct log_about){0};
	char text[1400];

	if (!a.file && err->file[0])
		a.file = err->file;
	if (!a.code && err->code)
		a.code = err_wire_name(err->code);
	log_event_at(place, event, &a, "%s: %s", what, err_format(err, text, sizeof text));
	raised_at(place, err);
}
