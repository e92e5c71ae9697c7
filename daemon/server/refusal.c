/*
 * Refusals: how a client learns that it is not served, and how often the log reports refusals and disconnections.
 *
 * The model: a client over its quota, or without permission, costs one answer: the error is written into its socket, which is
 * closed, and nothing is kept. Each refusal, each disconnection and each client for which a resource was missing is an event of
 * the log, up to LOGGED_MAX in a period. Further ones are only counted, and one event reports their number when the period is
 * over. The timer for that runs only if there is a number to report.
 */
#include <fcntl.h>
#include <string.h>
#include <sys/socket.h>

#include "clock.h"
#include "io.h"
#include "log.h"
#include "server_priv.h"

enum { LOGGED_MAX = 20, REFUSED_MAX = 10000 };
#define PERIOD_SECONDS 30

void refusal_send(int fd, const struct err *why)
{
	struct frame_conn *frame;
	struct err err = ERR_INIT;
	char bytes[4096];

	/* If a socket is closed while it has unread bytes, its peer may lose the answer. So what was sent is read first. */
	while (recv(fd, bytes, sizeof bytes, MSG_DONTWAIT) == (ssize_t)sizeof bytes)
		;
	if (frame_conn_new(fd, NULL, &frame, &err)) {
		io_close(fd);
		return;
	}
	if (!frame_conn_send_error(frame, 0, why, &err))
		frame_conn_flush(frame, &err);
	frame_conn_free(frame);
}

void server_refuse_waiting(int fd, const struct err *why)
{
	int flags = fcntl(fd, F_GETFL), client;

	if (flags < 0 || fcntl(fd, F_SETFL, flags | O_NONBLOCK) < 0)
		return;
	for (unsigned i = 0; i < REFUSED_MAX && (client = accept4(fd, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK)) >= 0; i++)
		refusal_send(client, why);
}

bool refusal_is_logged(const struct err *why)
{
	return why->code == ERR_PERM || !strncmp(why->field, "user-", 5);
}

static void log_suppressed(struct log_limit *r)
{
	const char *what = r->event == LOG_EVENT_REFUSED    ? "clients or requests were refused" :
			   r->event == LOG_EVENT_CLIENT_CUT ? "clients were cut off" :
							      "clients were turned away";

	if (r->suppressed)
		log_event(r->event, NULL, "%llu more %s within %.0f seconds", (unsigned long long)r->suppressed, what,
			  clock_since(r->since_ns));
	r->suppressed = r->logged = 0;
	r->since_ns = clock_mono_ns();
}

static int on_period_end(sd_event_source *source, uint64_t usec, void *ctx)
{
	log_suppressed(ctx);
	return 0;
}

static void suppress(struct server *s, struct log_limit *r)
{
	THREAD_LOOP_ONLY();
	if (r->suppressed++)
		return;
	if (!r->timer)
		sd_event_add_time_relative(s->p.event, &r->timer, CLOCK_MONOTONIC, PERIOD_SECONDS * UINT64_C(1000000), 1000000,
					   on_period_end, r);
	else if (sd_event_source_set_time_relative(r->timer, PERIOD_SECONDS * UINT64_C(1000000)) >= 0)
		sd_event_source_set_enabled(r->timer, SD_EVENT_ONESHOT);
}

/* Counts one. False: the limit of this period is reached, and it is only counted. */
static bool is_within_limit(struct server *s, struct log_limit *r, enum log_event event)
{
	THREAD_LOOP_ONLY();
	r->event = event;
	r->total++;
	if (!r->since_ns || clock_since(r->since_ns) >= PERIOD_SECONDS)
		log_suppressed(r);
	if (r->logged >= LOGGED_MAX) {
		suppress(s, r);
		return false;
	}
	r->logged++;
	return true;
}

void refusal_log(struct server *s, const struct peer *peer, const struct err *why)
{
	struct log_about about = {ABOUT_USER(peer->uid), .pid = peer->pid, .code = err_wire_name(why->code)};

	if (is_within_limit(s, &s->refused, LOG_EVENT_REFUSED))
		log_event(LOG_EVENT_REFUSED, &about, "refused to uid %u, pid %u: %s", peer->uid, peer->pid, why->message);
}

bool refusal_may_log_cut(struct server *s)
{
	return is_within_limit(s, &s->cut, LOG_EVENT_CLIENT_CUT);
}

bool refusal_may_log_turned_away(struct server *s)
{
	return is_within_limit(s, &s->turned_away, LOG_EVENT_CLIENT_TURNED_AWAY);
}

void refusals_flush(struct server *s)
{
	log_suppressed(&s->turned_away);
	s->turned_away.timer = sd_event_source_disable_unref(s->turned_away.timer);
	log_suppressed(&s->refused);
	log_suppressed(&s->cut);
	s->refused.timer = sd_event_source_disable_unref(s->refused.timer);
	s->cut.timer = sd_event_source_disable_unref(s->cut.timer);
}
