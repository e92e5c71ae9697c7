/*
 * The listening sockets, and the list of connections.
 *
 * The model: a connection is closed at once for its peer, and freed in server_settle, after the round of the loop, when nothing
 * refers to it any more. A client that left while it waited in the kernel's queue is skipped before anything is made for it. That
 * queue is first come, first served, so a flood of such clients delays others only by the time that skipping takes. When
 * descriptors run out, accept is paused until a connection is closed or a second has passed; clients wait in the kernel's queue
 * meanwhile.
 */
#include "server.h"

#include <errno.h>
#include <stdlib.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "clock.h"
#include "err.h"
#include "io.h"
#include "log.h"
#include "server_priv.h"

int server_new(const struct server_params *p, struct server **ret, struct err *err)
{
	struct server *s = calloc(1, sizeof *s);

	THREAD_LOOP_ONLY();
	if (!s)
		return err_set(err, ERR_NOMEM, "no memory for the server");
	s->p = *p;
	s->started_ns = clock_mono_ns();
	*ret = s;
	return 0;
}

static void listeners_free(struct server *s)
{
	struct listener *l;

	while ((l = s->listeners)) {
		s->listeners = l->next;
		sd_event_source_disable_unref(l->io);
		io_close(l->fd);
		free(l);
	}
	s->again = sd_event_source_disable_unref(s->again);
	s->recheck = sd_event_source_disable_unref(s->recheck);
}

struct server *server_free(struct server *s)
{
	THREAD_LOOP_ONLY();
	if (!s)
		return NULL;
	listeners_free(s);
	server_stop(s);
	server_settle(s);
	refusals_flush(s);
	free(s);
	return NULL;
}

void server_set_rights(struct server *s, const struct rights *rights, unsigned user_connections)
{
	struct conn *c;

	THREAD_LOOP_ONLY();
	s->p.rights = *rights;
	s->p.user_connections = user_connections;
	for (c = s->conns; c; c = c->next) {
		struct err err = ERR_INIT;

		if (c->closed)
			continue;
		rights_set_admin(rights, &c->peer);
		if (rights_connect(rights, &c->peer, &err)) {
			refusal_log(s, &c->peer, &err);
			conn_send_error(c, 0, &err);
			conn_close(c);
		}
	}
}

void server_set_service(struct server *s, struct service *service)
{
	THREAD_LOOP_ONLY();
	s->service = service;
}

/* ---- accept ---- */

static void accept_enable(struct server *s, bool on)
{
	struct listener *l;

	for (l = s->listeners; l; l = l->next)
		sd_event_source_set_enabled(l->io, on ? SD_EVENT_ON : SD_EVENT_OFF);
}

static int on_accept_again(sd_event_source *source, uint64_t usec, void *ctx)
{
	accept_enable(ctx, true);
	return 0;
}

static void accept_pause(struct server *s, int why)
{
	static uint64_t logged_ns;

	if (!logged_ns || clock_since(logged_ns) > 60) {
		struct err err = ERR_INIT;

		err_sys(&err, why, "new clients have to wait");
		log_event_err(LOG_EVENT_CLIENTS_WAIT, NULL, "accept", &err);
		logged_ns = clock_mono_ns();
	}
	accept_enable(s, false);
	if (!s->again &&
	    sd_event_add_time_relative(s->p.event, &s->again, CLOCK_MONOTONIC, 1000000, 100000, on_accept_again, s) < 0) {
		accept_enable(s, true);
		return;
	}
	sd_event_source_set_time_relative(s->again, 1000000);
	sd_event_source_set_enabled(s->again, SD_EVENT_ONESHOT);
}

static bool is_gone(int fd)
{
	char byte;

	return recv(fd, &byte, 1, MSG_PEEK | MSG_DONTWAIT) == 0;
}

/* Accepts one client. False: none waits. Counts *taken up unless the client has already left. */
static bool accept_one(struct listener *l, unsigned *taken)
{
	struct err err = ERR_INIT;
	int fd = accept4(l->fd, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);

	if (fd < 0) {
		if (errno == EMFILE || errno == ENFILE || errno == ENOMEM || errno == ENOBUFS)
			accept_pause(l->server, errno);
		return false;
	}
	if (is_gone(fd)) {
		io_close(fd);
		return true;
	}
	(*taken)++;
	if (conn_new(l->server, fd, &err)) {
		if (!refusal_is_logged(&err) && refusal_may_log_turned_away(l->server))
			log_event_err(LOG_EVENT_CLIENT_TURNED_AWAY, NULL, "a client is turned away", &err);
		refusal_send(fd, &err);
	}
	return true;
}

static int on_listener(sd_event_source *source, int fd, uint32_t events, void *ctx)
{
	enum { SLICE_CLIENTS = 8, SLICE_NS = 200000 };
	uint64_t start = clock_mono_ns();
	unsigned taken = 0;

	/* A time slice like that of a connection. */
	while (taken < SLICE_CLIENTS && clock_mono_ns() - start < SLICE_NS && accept_one(ctx, &taken))
		;
	return 0;
}

int server_listen(struct server *s, int fd, struct err *err)
{
	struct listener *l = calloc(1, sizeof *l);
	int r;

	THREAD_LOOP_ONLY();
	if (!l)
		return err_set(err, ERR_NOMEM, "no memory for a socket");
	l->server = s;
	l->fd = fd;
	r = sd_event_add_io(s->p.event, &l->io, fd, EPOLLIN, on_listener, l);
	if (r < 0) {
		free(l);
		return err_sys(err, -r, "cannot wait for clients");
	}
	/* After the clients that are connected. Same priority as clients over their fair share, so that neither starves the
	 * other. */
	sd_event_source_set_priority(l->io, FAIR_BEHIND);
	l->next = s->listeners;
	s->listeners = l;
	return 0;
}

int server_adopt(struct server *s, int fd, struct err *err)
{
	THREAD_LOOP_ONLY();
	return conn_new(s, fd, err);
}

bool server_accept_remaining(struct server *s)
{
	struct listener *l;
	unsigned taken = 0;
	bool any = false;

	THREAD_LOOP_ONLY();
	for (l = s->listeners; l; l = l->next)
		any |= accept_one(l, &taken);
	return any;
}

bool server_is_listening(const struct server *s)
{
	return s->listeners != NULL;
}

unsigned server_connection_count(const struct server *s)
{
	return s->nconns;
}

/* ---- the list ---- */

void server_settle(struct server *s)
{
	struct conn **at = &s->conns, *c;
	bool freed = false;

	THREAD_LOOP_ONLY();
	if (!s->reap)
		return;
	s->reap = false;
	while ((c = *at)) {
		struct conn *next = c->next;

		if (c->closed && conn_reap(c)) {
			*at = next;
			freed = true;
		} else {
			s->reap |= c->closed;
			at = &c->next;
		}
	}
	if (freed && !s->stopping)
		accept_enable(s, true);
}

void server_stop(struct server *s)
{
	struct err err = ERR_INIT;
	struct conn *c, *next;

	THREAD_LOOP_ONLY();
	s->stopping = true;
	listeners_free(s);
	/* Clients get a reason: one that asks again soon reaches the next daemon, or waits in its socket. */
	err_set(&err, ERR_BUSY, "acutd is being stopped");
	err_add_hint(&err, "try again when it is back; what was acknowledged is kept, and submitted jobs go on");
	for (c = s->conns; c; c = next) {
		next = c->next;
		conn_send_error(c, 0, &err);
		conn_close(c);
	}
}

void server_job_changed(void *ctx, struct job *job)
{
	struct server *s = ctx;
	struct conn *c;

	THREAD_LOOP_ONLY();
	for (c = s->conns; c; c = c->next)
		if (!c->closed) {
			request_job_changed(c, job);
			stream_out_progress(c, job);
		}
}
