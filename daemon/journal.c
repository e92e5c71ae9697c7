/*
 * The journal (journal.h): each entry of the log becomes an entry of the journal, with fields that journalctl can filter by.
 *
 * The model: only if stderr is the journal ($JOURNAL_STREAM), so that redirecting stderr redirects the whole log. If the
 * journal's socket cannot be reached (a chroot, a journald that does not run), the entry goes to stderr with its level. Fields
 * are on the stack: no memory is allocated.
 */
#include "journal.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/uio.h>
#define SD_JOURNAL_SUPPRESS_LOCATION /* the caller gives the location */
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

static void add_field(struct fields *f, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
static void add_field(struct fields *f, const char *fmt, ...)
{
	size_t left = sizeof f->texts - f->used;
	char *at = f->texts + f->used;
	va_list ap;
	int n;

	if (f->n == FIELDS || left < 2)
		return;
	va_start(ap, fmt);
	n = vsnprintf(at, left, fmt, ap);
	va_end(ap);
	if (n < 0)
		return;
	if ((size_t)n >= left)
		n = (int)left - 1;
	f->iov[f->n++] = (struct iovec){.iov_base = at, .iov_len = (size_t)n};
	f->used += (size_t)n;
}

static void add_about(struct fields *f, const struct log_about *a)
{
	if (a->job)
		add_field(f, "ACUT_JOB=%" PRIu64, a->job);
	if (a->push)
		add_field(f, "ACUT_PUSH=%" PRIu64, a->push);
	if (a->dataset)
		add_field(f, "ACUT_DATASET=%s", a->dataset);
	if (a->generation)
		add_field(f, "ACUT_GENERATION=%" PRIu64, a->generation);
	if (a->has_user)
		add_field(f, "ACUT_USER=%" PRIu32, a->uid);
	if (a->pid)
		add_field(f, "ACUT_PID=%" PRIu32, a->pid);
	if (a->file)
		add_field(f, "ACUT_FILE=%s", a->file);
	if (a->code)
		add_field(f, "ACUT_CODE=%s", a->code);
}

/* Paths are relative to the build folder; those of entries to the root of the tree. */
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

	/* libsystemd reports success if there is no socket. */
	if (access(journal_socket, W_OK) != 0)
		return false;
	f.n = 0;
	f.used = 0;
	add_field(&f, "MESSAGE=%s", e->message);
	add_field(&f, "PRIORITY=%d", priorities[e->level]);
	add_field(&f, "SYSLOG_IDENTIFIER=%s", (const char *)name);
	add_field(&f, "CODE_FILE=%s", from_root(e->place->file));
	add_field(&f, "CODE_LINE=%d", e->place->line);
	add_field(&f, "CODE_FUNC=%s", e->place->function);
	if (e->event >= 0) {
		add_field(&f, "MESSAGE_ID=%s", log_event_id((enum log_event)e->event));
		add_field(&f, "ACUT_EVENT=%s", log_event_name((enum log_event)e->event));
	}
	add_about(&f, e->about);
	return sd_journal_sendv(f.iov, f.n) >= 0;
}

void journal_open(const char *name)
{
	if (log_is_journal())
		log_set_sink(journal_send, (void *)name);
}
