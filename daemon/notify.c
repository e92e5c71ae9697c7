/*
 * sd_notify, from the loop's thread alone.
 *
 * The watchdog is fed by rounds of the loop and by steps within one, not by a clock of its own: a loop that hangs is not alive,
 * whatever its threads do. What can take longer than a watchdog waits (fsync above all) is on other threads. A start is given
 * more time by steps that it has made (base/progress.h): one that hangs makes none, and is ended.
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
/* What a single step of a start may take. */
#define STEP_USEC UINT64_C(90000000)
/* A start tells nothing in its first second: most are over then. */
#define TOLD_EVERY 1.0

static void on_step(void *ctx)
{
	struct notify *n = ctx;

	if (clock_since(n->extended_ns) < TOLD_EVERY)
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

static void ping(struct notify *n)
{
	if (!n->watchdog_usec || clock_since(n->pinged_ns) * 4e6 < (double)n->watchdog_usec)
		return;
	n->pinged_ns = clock_mono_ns();
	sd_notify(0, "WATCHDOG=1");
}

/* Within a round that waits for room in the catalogue again and again, as a flood of jobs before a slow disk makes it. */
static void on_step_serving(void *ctx)
{
	ping(ctx);
}

/* Appends, as far as there is room. */
static void add(char text[NOTIFY_TEXT], const char *fmt, ...) __attribute__((format(printf, 2, 3)));
static void add(char text[NOTIFY_TEXT], const char *fmt, ...)
{
	size_t n = strlen(text);
	va_list args;

	va_start(args, fmt);
	vsnprintf(text + n, NOTIFY_TEXT - n, fmt, args);
	va_end(args);
}

/* Without work it says only that acutd serves. */
static void text_of(const struct service_work *work, char text[NOTIFY_TEXT])
{
	strcpy(text, "Serving");
	if (work->running || work->waiting)
		add(text, "; jobs: %" PRIu32 " running, %" PRIu32 " waiting", work->running, work->waiting);
	if (work->domains_total)
		add(text, "; domains: %" PRIu64 " of %" PRIu64, work->domains_done, work->domains_total);
	if (work->pushes)
		add(text, "; pushes: %" PRIu32, work->pushes);
}

void notify_ready(struct notify *n)
{
	progress_listen(on_step_serving, n);
	text_of(&(struct service_work){0}, n->told);
	n->serving = true;
	n->told_ns = n->pinged_ns = clock_mono_ns();
	sd_notifyf(0, "READY=1\nSTATUS=%s", n->told);
}

void notify_stopping(struct notify *n, uint64_t usec)
{
	n->serving = false;
	n->behind = false;
	sd_notifyf(0, "STOPPING=1\nSTATUS=Stopping\nEXTEND_TIMEOUT_USEC=%" PRIu64, usec);
}

void notify_round(struct notify *n, const struct service_work *work)
{
	char text[NOTIFY_TEXT];

	ping(n);
	if (!n->serving)
		return;
	text_of(work, text);
	n->behind = strcmp(text, n->told) != 0;
	if (!n->behind || clock_since(n->told_ns) < TOLD_EVERY)
		return;
	n->behind = false;
	n->told_ns = clock_mono_ns();
	memcpy(n->told, text, sizeof text);
	sd_notifyf(0, "STATUS=%s", text);
}

uint64_t notify_wait(const struct notify *n)
{
	uint64_t usec = n->watchdog_usec ? n->watchdog_usec / 2 : UINT64_MAX;

	return n->behind && usec > SECOND_NS / 1000 ? SECOND_NS / 1000 : usec;
}
