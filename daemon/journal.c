/*
 * The journal (journal.h): each entry of the log becomes one of the journal, with the fields that journalctl can
 * filter by.
 *
 * The model: only where stderr is the journal already ($JOURNAL_STREAM), so that whoever redirects the log gets all
 * of it. Where the journal's socket cannot be reached (a root of its own, a journald that is gone) the entry goes to
 * stderr with its level, and the journal has its text at least. It takes no memory of its own: fields lie on the stack.
 */
#include "journal.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/uio.h>
#define SD_JOURNAL_SUPPRESS_LOCATION /* the place is that of who told it */
#include <systemd/sd-journal.h>
#include <unistd.h>

#include "log.h"

enum { FIELDS = 20, TEXTS = 5120 };

static const char *const journal_socket = "/run/systemd/journal/socket";

struct fields {
	struct iovec iov[FIELDS];
	int n;
	size_t used;
	char texts[TEXTS];
};

static void add(struct fields *f, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
static void add(struct fields *f, const char *fmt, ...)
{
	size_t room = sizeof f->texts - f->used;
	char *at = f->texts + f->used;
	va_list ap;
	int n;

	if (f->n == FIELDS || room < 2)
		return;
	va_start(ap, fmt);
	n = vsnprintf(at, room, fmt, ap);
	va_end(ap);
	if (n < 0)
		return;
	if ((size_t)n >= room)
		n = (int)room - 1;
	f->iov[f->n++] = (struct iovec){.iov_base = at, .iov_len = (size_t)n};
	f->used += (size_t)n;
}

static void add_about(struct fields *f, const struct log_about *a)
{
	if (a->job)
		add(f, "ACUT_JOB=%" PRIu64, a->job);
	if (a->push)
		add(f, "ACUT_PUSH=%" PRIu64, a->push);
	if (a->dataset)
		add(f, "ACUT_DATASET=%s", a->dataset);
	if (a->generation)
		add(f, "ACUT_GENERATION=%" PRIu64, a->generation);
	if (a->has_user)
		add(f, "ACUT_USER=%" PRIu32, a->uid);
	if (a->pid)
		add(f, "ACUT_PID=%" PRIu32, a->pid);
	if (a->file)
		add(f, "ACUT_FILE=%s", a->file);
	if (a->code)
		add(f, "ACUT_CODE=%s", a->code);
}

/* The compiler is called in the build folder. */
static const char *from_root(const char *file)
{
	while (strncmp(file, "../", 3) == 0)
		file += 3;
	return file;
}

static bool journal_send(void *name, const struct log_entry *e)
{
	static const int priorities[] = {
		[LOG_LEVEL_ERROR] = 3, [LOG_LEVEL_WARNING] = 4, [LOG_LEVEL_NOTICE] = 5,
		[LOG_LEVEL_INFO] = 6,  [LOG_LEVEL_DEBUG] = 7,
	};
	struct fields f;

	/* libsystemd calls an entry sent where there is no socket. */
	if (access(journal_socket, W_OK) != 0)
		return false;
	f.n = 0;
	f.used = 0;
	add(&f, "MESSAGE=%s", e->message);
	add(&f, "PRIORITY=%d", priorities[e->level]);
	add(&f, "SYSLOG_IDENTIFIER=%s", (const char *)name);
	add(&f, "CODE_FILE=%s", from_root(e->place->file));
	add(&f, "CODE_LINE=%d", e->place->line);
	add(&f, "CODE_FUNC=%s", e->place->function);
	if (e->event >= 0) {
		add(&f, "MESSAGE_ID=%s", log_event_id((enum log_event)e->event));
		add(&f, "ACUT_EVENT=%s", log_event_name((enum log_event)e->event));
	}
	add_about(&f, e->about);
	return sd_journal_sendv(f.iov, f.n) >= 0;
}

void journal_open(const char *name)
{
	if (log_is_journal())
		log_set_sink(journal_send, (void *)name);
}
