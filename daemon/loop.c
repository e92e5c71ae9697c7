/*
 * The event loop of acutd: its timer, signals, idle exit and stop.
 *
 * The model: one timer wakes the loop, ten times a second only while there is work. A round that takes long is logged. A stop
 * closes connections, with what is bound to them, and waits for the workers for a limited time.
 */
#include <malloc.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/epoll.h>
#include <systemd/sd-event.h>
#include <unistd.h>

#include "catalogue.h"
#include "clock.h"
#include "config.h"
#include "err.h"
#include "io.h"
#include "service.h"
#include "ledger.h"
#include "log.h"
#include "loop.h"
#include "notify.h"
#include "place.h"
#include "sched_pool.h"
#include "server.h"
#include "settings.h"

#define TICK_USEC 100000
#define QUIET_TICK_USEC 30000000 /* notices a disk that other programs have filled */
#define STOP_USEC 9000000
#define STOP_SPARE_USEC 20000000 /* in addition, for writes that are on their way to the disk */
#define SLOW_NS UINT64_C(1000000000)
#define HEAP_SLACK (UINT64_C(1) << 20)

static void stop_daemon(struct daemon *d);

static bool is_busy(struct daemon *d)
{
	return server_connection_count(d->server) || service_active(d->service);
}

/* While the lock of the socket is held, nobody can connect. So after one more accept nobody is left. */
static void end_if_idle(struct daemon *d)
{
	int lock = -1;

	if (d->nsockets && !d->bound && !place_lock_socket(d->sockets[0], &lock)) {
		d->idle_ns = clock_mono_ns();
		return;
	}
	if (server_accept_remaining(d->server)) {
		io_close(lock);
		return;
	}
	if (d->nsockets)
		log_event(LOG_EVENT_STOP, NULL, "acutd was idle for %.0f seconds, and stops", d->config.idle_exit);
	else
		log_event(LOG_EVENT_STOP, NULL, "the only client is gone, and acutd stops");
	for (int i = 0; i < d->nsockets; i++)
		place_unbind(d->sockets[i]);
	io_close(lock);
	stop_daemon(d);
}

/* Seconds that the daemon stays without work and clients; negative: for ever. */
static double idle_wait(const struct daemon *d)
{
	/* Without a listening socket no client can connect any more. */
	if (!server_is_listening(d->server))
		return 0;
	return d->config.idle_exit > 0 ? d->config.idle_exit : -1;
}

static void check_idle(struct daemon *d)
{
	double wait = idle_wait(d);

	if (!d->stopping && wait >= 0 && d->idle_ns && !is_busy(d) && clock_since(d->idle_ns) >= wait)
		end_if_idle(d);
}

/* How long the loop may sleep: with work a tenth of a second; otherwise until the watchdog of the service manager is due, or the
 * disk is to be checked. */
static uint64_t sleep_usec(struct daemon *d)
{
	bool soon = service_active(d->service) || service_is_deferring(d->service) || d->stopping;
	uint64_t usec = soon ? TICK_USEC : QUIET_TICK_USEC, most = notify_wait(&d->notify);
	double wait = idle_wait(d);

	if (wait < 0 || is_busy(d)) {
		d->idle_ns = 0;
	} else {
		if (!d->idle_ns)
			d->idle_ns = clock_mono_ns();
		wait -= clock_since(d->idle_ns);
		if (wait * 1e6 < (double)usec)
			usec = wait > 1e-3 ? (uint64_t)(wait * 1e6) : 1000;
	}
	return most < usec ? most : usec;
}

static void set_timer(struct daemon *d)
{
	uint64_t usec = sleep_usec(d);

	if (d->ticking && usec >= d->tick_usec)
		return;
	d->ticking = true;
	d->tick_usec = usec;
	sd_event_source_set_time_relative(d->tick, usec);
	sd_event_source_set_enabled(d->tick, SD_EVENT_ONESHOT);
}

static int on_tick(sd_event_source *source, uint64_t usec, void *ctx)
{
	struct daemon *d = ctx;

	d->ticking = false;
	service_tick(d->service);
	log_report_suppressed(false);
	check_idle(d);
	return 0;
}

/* free() returns only the end of the heap to the kernel. After many small blocks were freed, this returns the rest, so that the
 * resident size follows the ledger. */
static void heap_trim(struct daemon *d)
{
	const unsigned small = 1u << LEDGER_MESSAGE | 1u << LEDGER_JOBS | 1u << LEDGER_FILES | 1u << LEDGER_MANIFEST |
			       1u << LEDGER_PLAN | 1u << LEDGER_INDEX;
	uint64_t held = ledger_claimed(d->ledger, small);

	if (held + HEAP_SLACK < d->heaped) {
		malloc_trim(0);
		d->heaped = held;
	} else if (held > d->heaped) {
		d->heaped = held;
	}
}

/* Logs a round that took long, since all clients waited for it; at most once a minute. */
static void check_slow(struct daemon *d)
{
	uint64_t began, now = clock_mono_ns();

	if (sd_event_now(d->event, CLOCK_MONOTONIC, &began) != 0 || now < 1000 * began + SLOW_NS ||
	    (d->slow_ns && now - d->slow_ns < 60 * SLOW_NS))
		return;
	d->slow_ns = now;
	log_event(LOG_EVENT_SLOW, NULL, "clients had to wait for %.1f seconds: a round of the loop took so long",
		  (double)(now - 1000 * began) / 1e9);
}

/* After each round: what happened in it may let other work start. */
static int on_round(sd_event_source *source, void *ctx)
{
	struct daemon *d = ctx;
	struct service_work work;

	service_settle(d->service);
	server_settle(d->server);
	heap_trim(d);
	service_work(d->service, &work);
	notify_round(&d->notify, &work);
	if (d->stopping && service_is_stopped(d->service) && !server_connection_count(d->server)) {
		d->over = true;
		sd_event_exit(d->event, 0);
	}
	set_timer(d);
	check_slow(d);
	return 0;
}

int loop_on_sched(sd_event_source *source, int fd, uint32_t events, void *ctx)
{
	sched_dispatch(((struct daemon *)ctx)->sched);
	return 0;
}

int loop_on_catalogue(sd_event_source *source, int fd, uint32_t events, void *ctx)
{
	catalogue_dispatch(((struct daemon *)ctx)->catalogue);
	return 0;
}

/* Work did not end in time. Durable data is complete; temporary files are removed. */
static int on_stop_timeout(sd_event_source *source, uint64_t usec, void *ctx)
{
	struct daemon *d = ctx;

	log_event(LOG_EVENT_STOP_CUT, NULL, "work did not stop in time, and is cut off");
	service_abandon(d->service);
	_exit(0);
}

static void stop_daemon(struct daemon *d)
{
	if (d->stopping)
		return;
	d->stopping = true;
	notify_stopping(&d->notify, STOP_USEC + STOP_SPARE_USEC);
	if (d->bound)
		place_unbind(d->sockets[0]);
	server_stop(d->server);
	service_stop(d->service);
	if (sd_event_add_time_relative(d->event, &d->stop_timeout, CLOCK_MONOTONIC, STOP_USEC, 0, on_stop_timeout, d) < 0)
		log_warning("no timer: the stop takes as long as the work");
}

static int on_signal(sd_event_source *source, const struct signalfd_siginfo *si, void *ctx)
{
	log_event(LOG_EVENT_STOP, NULL, "signal %u: acutd stops", si->ssi_signo);
	stop_daemon(ctx);
	return 0;
}

static int on_hangup(sd_event_source *source, const struct signalfd_siginfo *si, void *ctx)
{
	struct daemon *d = ctx;

	if (!d->stopping)
		settings_reload(&d->config, d->service, d->server);
	return 0;
}

int loop_watch(struct daemon *d, int fd, sd_event_io_handler_t handler, struct err *err)
{
	int r = sd_event_add_io(d->event, NULL, fd, EPOLLIN, handler, d);

	return r < 0 ? err_sys(err, -r, "cannot watch a descriptor") : 0;
}

int loop_make(struct daemon *d, struct err *err)
{
	static const int signals[] = {SIGTERM, SIGINT};
	sigset_t set;
	int r;

	sigemptyset(&set);
	for (size_t i = 0; i < sizeof signals / sizeof signals[0]; i++)
		sigaddset(&set, signals[i]);
	sigaddset(&set, SIGHUP);
	sigprocmask(SIG_BLOCK, &set, NULL);
	signal(SIGPIPE, SIG_IGN);
	signal(SIGXFSZ, SIG_IGN); /* the write fails instead */
	r = sd_event_default(&d->event);
	for (size_t i = 0; r >= 0 && i < sizeof signals / sizeof signals[0]; i++)
		r = sd_event_add_signal(d->event, NULL, signals[i], on_signal, d);
	if (r >= 0)
		r = sd_event_add_signal(d->event, NULL, SIGHUP, on_hangup, d);
	if (r >= 0)
		r = sd_event_add_time_relative(d->event, &d->tick, CLOCK_MONOTONIC, TICK_USEC, TICK_USEC / 10, on_tick, d);
	if (r >= 0)
		r = sd_event_add_post(d->event, NULL, on_round, d);
	if (r < 0)
		return err_sys(err, -r, "cannot make the event loop");
	sd_event_source_set_enabled(d->tick, SD_EVENT_ONESHOT);
	d->ticking = true;
	return 0;
}
