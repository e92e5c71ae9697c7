/*
 * The loop of acutd: its tick, its signals, when it is idle, when it stops.
 *
 * The model: the tick runs only while there is something to look at; a round that took long is told in the log. A stop ends
 * connections and what is bound to them, and waits for the workers for as long as main.c says.
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
#define QUIET_TICK_USEC 30000000 /* whether others have filled the disk */
#define PARK_USEC 9000000
#define STOP_SPARE_USEC 20000000 /* beyond that, for what was on its way to the disk */
#define SLOW_NS UINT64_C(1000000000)
#define HEAP_SLACK (UINT64_C(1) << 20)

static void stop(struct daemon *d);

static bool busy(struct daemon *d)
{
	return server_connection_count(d->server) || service_active(d->service);
}

/* Nobody can connect while the lock of the socket is held, so a last look is the last. */
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
		log_event(LOG_EVENT_STOP, NULL, "idle for %.0f seconds: the end", d->config.idle_exit);
	else
		log_event(LOG_EVENT_STOP, NULL, "the only client is gone: the end");
	for (int i = 0; i < d->nsockets; i++)
		place_unbind(d->sockets[i]);
	io_close(lock);
	stop(d);
}

/* Seconds that a private daemon stays without work and clients; less than 0: for ever. */
static double idle_wait(const struct daemon *d)
{
	/* Without a listening socket nobody can come any more. */
	if (!server_is_listening(d->server))
		return 0;
	return d->config.idle_exit > 0 ? d->config.idle_exit : -1;
}

static void look_idle(struct daemon *d)
{
	double wait = idle_wait(d);

	if (!d->stopping && wait >= 0 && d->idle_ns && !busy(d) && clock_since(d->idle_ns) >= wait)
		end_if_idle(d);
}

/* Until when the loop may sleep: while there is work ten times a second, else until the service manager wants a sign of life,
 * and to see whether others have filled the disk; both at once. */
static uint64_t sleep_usec(struct daemon *d)
{
	bool soon = service_active(d->service) || service_is_deferring(d->service) || d->stopping;
	uint64_t usec = soon ? TICK_USEC : QUIET_TICK_USEC, most = notify_wait(&d->notify);
	double wait = idle_wait(d);

	if (wait < 0 || busy(d)) {
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

static void tick_wanted(struct daemon *d)
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
	log_floods(false);
	look_idle(d);
	return 0;
}

/* Small things are freed in any order, and the heap gives back its end only: what lies free between goes back to the
 * kernel here, so that nobody has what the ledger gives to others. */
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

/* After each round: what was freed, finished or asked in it may let something else start. */
/* Everybody waited meanwhile; told at most once a minute. */
static void look_slow(struct daemon *d)
{
	uint64_t began, now = clock_mono_ns();

	if (sd_event_now(d->event, CLOCK_MONOTONIC, &began) != 0 || now < 1000 * began + SLOW_NS ||
	    (d->slow_ns && now - d->slow_ns < 60 * SLOW_NS))
		return;
	d->slow_ns = now;
	log_event(LOG_EVENT_SLOW, NULL, "clients had to wait for %.1f seconds: a round of the loop took so long",
		  (double)(now - 1000 * began) / 1e9);
}

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
	tick_wanted(d);
	look_slow(d);
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

/* Work did not end in time. What is durable is so already; the rest is removed by name. */
static int on_last(sd_event_source *source, uint64_t usec, void *ctx)
{
	struct daemon *d = ctx;

	log_event(LOG_EVENT_STOP_CUT, NULL, "work did not stop in time: it is cut off");
	service_abandon(d->service);
	_exit(0);
}

static void stop(struct daemon *d)
{
	if (d->stopping)
		return;
	d->stopping = true;
	notify_stopping(&d->notify, PARK_USEC + STOP_SPARE_USEC);
	if (d->bound)
		place_unbind(d->sockets[0]);
	server_stop(d->server);
	service_stop(d->service);
	if (sd_event_add_time_relative(d->event, &d->last, CLOCK_MONOTONIC, PARK_USEC, 0, on_last, d) < 0)
		log_warning("no timer: the stop takes as long as the work");
}

static int on_signal(sd_event_source *source, const struct signalfd_siginfo *si, void *ctx)
{
	log_event(LOG_EVENT_STOP, NULL, "signal %u: the end", si->ssi_signo);
	stop(ctx);
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

	return r < 0 ? err_sys(err, -r, "cannot loop_watch a descriptor") : 0;
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
	signal(SIGXFSZ, SIG_IGN); /* a limit of file sizes is an error of who meets it */
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
