/*
 * The log (log.h): each line is one write to stderr, so that lines of several threads do not mix. Control
 * characters (a file name may hold them) are shown as '?'. Before log_init it writes as "acut", info.
 */
#include "log.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"

static const struct {
	const char *text;
	char priority; /* of syslog */
} levels[] = {
	[LOG_LEVEL_ERROR] = {"error", '3'},   [LOG_LEVEL_WARNING] = {"warning", '4'},
	[LOG_LEVEL_NOTICE] = {"notice", '5'}, [LOG_LEVEL_INFO] = {"info", '6'},
	[LOG_LEVEL_DEBUG] = {"debug", '7'},
};

static const char *log_program = "acut";
static enum log_level log_most = LOG_LEVEL_INFO;
static bool log_journal;

/* $JOURNAL_STREAM is "device:inode" of the stream that systemd made; stderr may have been redirected since.
 */
static bool stderr_is_journal(void)
{
	const char *stream = getenv("JOURNAL_STREAM");
	unsigned long long dev, ino;
	struct stat st;

	return stream && sscanf(stream, "%llu:%llu", &dev, &ino) == 2 && fstat(STDERR_FILENO, &st) == 0 &&
	       st.st_dev == dev && st.st_ino == ino;
}

void log_init(const char *program, enum log_level level)
{
	log_program = program;
	log_most = level;
	log_journal = stderr_is_journal();
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

void log_line(enum log_level level, const char *fmt, ...)
{
	int saved = errno;
	char line[2048];
	va_list ap;
	int n;

	if (level > log_most)
		return;
	if (log_journal)
		n = snprintf(line, sizeof line, "<%c>", levels[level].priority);
	else
		n = snprintf(line, sizeof line, "%s: %s: ", log_program, levels[level].text);
	size_t at = n < 0 ? 0 : (size_t)n;

	va_start(ap, fmt);
	vsnprintf(line + at, sizeof line - at - 1, fmt, ap);
	va_end(ap);
	at = strlen(line);
	for (size_t i = 0; i < at; i++)
		if ((unsigned char)line[i] < 0x20 || line[i] == 0x7f)
			line[i] = '?';
	line[at++] = '\n';
	/* Nowhere to tell that the log itself cannot be written. */
	if (write(STDERR_FILENO, line, at) < 0)
		(void)0;
	errno = saved;
}

void log_err(enum log_level level, const char *what, const struct err *err)
{
	char text[1400];

	log_line(level, "%s: %s", what, err_format(err, text, sizeof text));
	if (err->src_file)
		log_debug("raised at %s:%d, errno %d", err->src_file, err->src_line, err->sys);
}
