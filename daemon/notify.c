/*
 * sd_notify, from the loop's thread only.
 *
 * The watchdog is fed by rounds of the loop and by steps within one, not by a clock: a loop that hangs is not alive, whatever
 * other threads do. Work that may take longer than a watchdog interval (fsync above all) is on other threads. A start gets more
 * time for each step of progress (base/progress.h); one that hangs makes none, and is ended.
 */
#include "notify.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <systemd/sd-daemon.h>

#include "clock.h"
#include "service.h"
#include "progress.h"

#define SECOND_NS UINT64_C(1000000000)
/* The longest time for one step of a start. */
#define STEP_USEC UINT64_C(90000000)
/* Seconds between two texts of status. A start sends none in its first second, since most have ended by then. */
#define STATUS_SECONDS 1.0

static void on_step(void *ctx)
{
	struct notify *n = ctx;

	if (clock_since(n->extended_ns) < STATUS_SECONDS)
		return;
	n->extended_ns = clock_mono_ns();
	sd_notifyf(0, "EXTEND_TIMEOUT_USEC=%" PRIu64 "\nSTATUS=Starting: reading the catalogue, and what was interrupted",
		   STEP_USEC);
}

void notify_start(struct notify *n)
{
	*n = (struct notify){.extended_ns = clock_mono_ns()};
	if (sd_watchdog_enabled(0, &n->watchdog_usec) <= 0)
		n->watchdog_usec = 0;
	progress_listen(on_step, n);
}

static void feed_watchdog(struct notify *n)
{
	if (!n->watchdog_usec || clock_since(n->pinged_ns) * 4e6 < (double)n->watchdog_usec)
		return;
	n->pinged_ns = clock_mono_ns();
	sd_notify(0, "WATCHDOG=1");
}

/* A round may wait repeatedly for the queue of the catalogue, if many jobs meet a slow disk. */
static void on_step_serving(void *ctx)
{
	feed_watchdog(ctx);
}

/* Appends as much as fits. */
static void append(char text[NOTIFY_TEXT], const char *fmt, ...) __attribute__((format(printf, 2, 3)));
static void append(char text[NOTIFY_TEXT], const char *fmt, ...)
{
	size_t n = strlen(text);
	va_list args;

	va_start(args, fmt);
	vsnprintf(text + n, NOTIFY_TEXT - n, fmt, args);
	va_end(args);
}

/* "Serving", and what work there is. */
static void status_text(const struct service_work *work, char text[NOTIFY_TEXT])
{
	strcpy(text, "Serving");
	if (work->running || work->waiting)
		append(text, "; jobs: %" PRIu32 " running, %" PRIu32 " waiting", work->running, work->waiting);
	if (work->domains_total)
		append(text, "; domains: %" PRIu64 " of %" PRIu64, work->domains_done, work->domains_total);
	if (work->pushes)
		append(text, "; pushes: %" PRIu32, work->pushes);
}

void notify_ready(struct notify *n)
{
	progress_listen(on_step_serving, n);
	status_text(&(struct service_work){0}, n->status);
	n->serving = true;
	n->status_ns = n->pinged_ns = clock_mono_ns();
	sd_notifyf(0, "READY=1\nSTATUS=%s", n->status);
}

void notify_stopping(struct notify *n, uint64_t usec)
{
	n->serving = false;
	n->stale = false;
	sd_notifyf(0, "STOPPING=1\nSTATUS=Stopping\nEXTEND_TIMEOUT_USEC=%" PRIu64, usec);
}

void notify_round(struct notify *n, const struct service_work *work)
{
	char text[NOTIFY_TEXT];

	feed_watchdog(n);
	if (!n->serving)
		return;
	status_text(work, text);
	n->stale = strcmp(text, n->status) != 0;
	if (!n->stale || clock_since(n->status_ns) < STATUS_SECONDS)
		return;
	n->stale = false;
	n->status_ns = clock_mono_ns();
	memcpy(n->status, text, sizeof text);
	sd_notifyf(0, "STATUS=%s", text);
}

uint64_t notify_wait(const struct notify *n)
{
	uint64_t usec = n->watchdog_usec ? n->watchdog_usec / 2 : UINT64_MAX;

	return n->stale && usec > SECOND_NS / 1000 ? SECOND_NS / 1000 : usec;
}
