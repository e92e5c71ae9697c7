/*
 * Clients and requests that are refused by who asks, and clients that are cut off: what they are told, and what the log is.
 *
 * The model: a surplus or strange client costs nothing but the answer: it is written into the socket that is closed next,
 * and nothing of it is kept. In the log each refusal, each cut and each client that there was nothing left for is an event,
 * up to a number in a while; of more than that the log gets the number when the while is over. The timer for that runs
 * only if there is something to tell.
 */
#include <fcntl.h>
#include <string.h>
#include <sys/socket.h>

#include "clock.h"
#include "io.h"
#include "log.h"
#include "server_priv.h"

enum { TOLD_MAX = 20, TURNED_AWAY_MAX = 10000 };
#define WHILE_SECONDS 30

void refusal_tell(int fd, const struct err *why)
{
	struct frame_conn *frame;
	struct err err = ERR_INIT;
	char bytes[4096];

	/* What it has asked already: of a socket that is closed over unread bytes the other side may lose the answer. */
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

void server_turn_away(int fd, const struct err *why)
{
	int flags = fcntl(fd, F_GETFL), client;

	if (flags < 0 || fcntl(fd, F_SETFL, flags | O_NONBLOCK) < 0)
		return;
	for (unsigned i = 0; i < TURNED_AWAY_MAX && (client = accept4(fd, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK)) >= 0; i++)
		refusal_tell(client, why);
}

bool refusal_worth(const struct err *why)
{
	return why->code == ERR_PERM || !strncmp(why->field, "user-", 5);
}

static void tell_hidden(struct refusals *r)
{
	const char *what = r->event == LOG_EVENT_REFUSED    ? "clients or requests were refused" :
			   r->event == LOG_EVENT_CLIENT_CUT ? "clients were cut off" :
							      "clients were turned away";

	if (r->hidden)
		log_event(r->event, NULL, "%llu more %s within %.0f seconds", (unsigned long long)r->hidden, what,
			  clock_since(r->since_ns));
	r->hidden = r->told = 0;
	r->since_ns = clock_mono_ns();
}

static int while_over(sd_event_source *source, uint64_t usec, void *ctx)
{
	tell_hidden(ctx);
	return 0;
}

static void hide(struct server *s, struct refusals *r)
{
	if (r->hidden++)
		return;
	if (!r->timer)
		sd_event_add_time_relative(s->p.event, &r->timer, CLOCK_MONOTONIC, WHILE_SECONDS * UINT64_C(1000000), 1000000,
					   while_over, r);
	else if (sd_event_source_set_time_relative(r->timer, WHILE_SECONDS * UINT64_C(1000000)) >= 0)
		sd_event_source_set_enabled(r->timer, SD_EVENT_ONESHOT);
}

/* One more: is it told, or counted until the while is over? */
static bool tellable(struct server *s, struct refusals *r, enum log_event event)
{
	r->event = event;
	r->total++;
	if (!r->since_ns || clock_since(r->since_ns) >= WHILE_SECONDS)
		tell_hidden(r);
	if (r->told >= TOLD_MAX) {
		hide(s, r);
		return false;
	}
	r->told++;
	return true;
}

void refusal_log(struct server *s, const struct peer *peer, const struct err *why)
{
	struct log_about about = {ABOUT_USER(peer->uid), .pid = peer->pid, .code = err_wire_name(why->code)};

	if (tellable(s, &s->refusals, LOG_EVENT_REFUSED))
		log_event(LOG_EVENT_REFUSED, &about, "refused to uid %u, pid %u: %s", peer->uid, peer->pid, why->message);
}

bool refusal_cut(struct server *s)
{
	return tellable(s, &s->cuts, LOG_EVENT_CLIENT_CUT);
}

bool refusal_away(struct server *s)
{
	return tellable(s, &s->aways, LOG_EVENT_CLIENT_TURNED_AWAY);
}

void refusals_end(struct server *s)
{
	tell_hidden(&s->aways);
	s->aways.timer = sd_event_source_disable_unref(s->aways.timer);
	tell_hidden(&s->refusals);
	tell_hidden(&s->cuts);
	s->refusals.timer = sd_event_source_disable_unref(s->refusals.timer);
	s->cuts.timer = sd_event_source_disable_unref(s->cuts.timer);
}
