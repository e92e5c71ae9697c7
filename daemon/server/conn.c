/*
 * A connection: frames in, answers out, and what ends with it.
 *
 * The model: everything that a client began lives in lists here: requests not answered, pushes, bound jobs,
 * one-step datasets, streams. conn_close lets go of all of them at once; requests that a worker is busy with
 * keep the memory of the connection until they are answered (into nothing). A client that does not read is
 * cut off when its answers reach the cap of its queue, or when others lack the memory that it has (room.c). The socket keeps
 * little of them. All else is charged: frames as they come and wait, requests with what is kept until they are answered.
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>

#include "clock.h"
#include "io.h"
#include "ledger.h"
#include "log.h"
#include "rights.h"
#include "server_priv.h"

enum {
	CONN_BYTES = 2 << 10,    /* of a connection, beside its frames: itself, its event source */
	REQUEST_BYTES = 4 << 10, /* of a request, beside its texts: what is kept until it is answered */
	SOCKET_BYTES = 16 << 10, /* of answers that the kernel keeps for a client (it doubles them for its own needs): they count
				    with the control group and stand in no ledger, so a crowd that does not read must not
				    have much. What is large goes through pipes. */
	COMFORT = 2 * FRAME_MAX, /* room for a frame that comes and its message */
	FIELDS_MAX = 1000,       /* of a request: the largest has 30, and each costs some ten nanoseconds of the loop */
	TURN_REQUESTS = 16,      /* at most, one after the other, */
	TURN_NS = 200000,        /* and no further one after so long */
};

void conn_watch(struct conn *c)
{
	uint32_t but = c->waits ? EPOLLIN : 0;

	if (c->io && c->frame)
		sd_event_source_set_io_events(c->io, (uint32_t)frame_conn_events(c->frame) & ~but);
}

static void flush(struct conn *c)
{
	struct err err = ERR_INIT;
	size_t before = frame_conn_queued(c->frame);
	int r = frame_conn_flush(c->frame, &err);
	size_t left = frame_conn_queued(c->frame);

	if (!left)
		c->blocked_ns = 0;
	else if (left < before || !c->blocked_ns)
		c->blocked_ns = clock_mono_ns();
	if (r == FRAME_E_EOF || r < 0)
		conn_close(c);
	else
		conn_watch(c);
}

static void sent(struct conn *c, int r, const struct err *err)
{
	if (r == FRAME_E_FULL) {
		if (refusal_cut(c->server))
			log_event(LOG_EVENT_CLIENT_CUT, ABOUT_CONN(c),
				  "a client (pid %u) does not read its answers and is cut off", c->peer.pid);
		conn_close(c);
	} else if (r < 0) {
		if (refusal_cut(c->server))
			log_event_err(LOG_EVENT_CLIENT_CUT, ABOUT_CONN(c), "an answer cannot be sent", err);
		conn_close(c);
	} else {
		flush(c);
	}
}

void conn_send(struct conn *c, uint32_t id, const Acut__V1__Message *m, int fd)
{
	struct err err = ERR_INIT;

	if (c->closed) {
		io_close(fd);
		return;
	}
	/* As a rule there is room for the largest. */
	if (ledger_available(c->server->p.ledger, LEDGER_MESSAGE) < FRAME_MAX + COMFORT / 16)
		room_make(c->server, frame_message_size(m) + COMFORT / 16, c->peer.uid, c);
	sent(c, frame_conn_send(c->frame, id, m, fd, &err), &err);
}

void conn_send_error(struct conn *c, uint32_t id, const struct err *why)
{
	struct err err = ERR_INIT;

	if (c->closed)
		return;
	room_make(c->server, COMFORT / 16, c->peer.uid, c);
	sent(c, frame_conn_send_error(c->frame, id, why, &err), &err);
}

void conn_fail(struct conn *c, const struct err *why)
{
	if (refusal_cut(c->server))
		log_event_err(LOG_EVENT_CLIENT_CUT, ABOUT_CONN(c), "a client is cut off", why);
	conn_send_error(c, 0, why);
	conn_close(c);
}

/* ---- requests ---- */

struct request *request_new(struct conn *c, uint32_t id, size_t bytes, struct err *err)
{
	struct ledger *ledger = c->server->p.ledger;
	struct request *q;

	bytes += REQUEST_BYTES;
	room_make(c->server, bytes, c->peer.uid, c);
	if (!ledger_take(ledger, LEDGER_MESSAGE, bytes)) {
		err_set(err, ERR_BUSY, "there is no memory left for a request");
		err_add_hint(err, "try again when other clients are done, or give acutd more memory");
		return NULL;
	}
	q = calloc(1, sizeof *q);
	if (!q) {
		ledger_give(ledger, LEDGER_MESSAGE, bytes);
		err_set(err, ERR_NOMEM, "no memory for a request");
		return NULL;
	}
	q->charged = bytes;
	c->charged += bytes;
	q->conn = c;
	q->id = id;
	q->next = c->requests;
	c->requests = q;
	c->nrequests++;
	return q;
}

struct request *request_free(struct request *q)
{
	struct conn *c;
	struct request **at;

	if (!q)
		return NULL;
	c = q->conn;
	for (at = &c->requests; *at != q; at = &(*at)->next)
		;
	*at = q->next;
	c->nrequests--;
	c->nfiles -= q->files;
	c->charged -= q->charged;
	ledger_give(c->server->p.ledger, LEDGER_MESSAGE, q->charged);
	if (c->closed)
		c->server->reap = true;
	free(q);
	return NULL;
}

void request_answer(struct request *q, const Acut__V1__Message *m)
{
	struct conn *c = q->conn;
	uint32_t id = q->id;

	request_free(q);
	conn_send(c, id, m, -1);
}

void request_answer_page(struct request *q, Acut__V1__Message__BodyCase list, const struct frame_page *page, bool more)
{
	struct conn *c = q->conn;
	struct err err = ERR_INIT;
	uint32_t id = q->id;

	request_free(q);
	if (c->closed)
		return;
	room_make(c->server, page->n + COMFORT / 16, c->peer.uid, c);
	sent(c, frame_conn_send_page(c->frame, id, list, page, more, &err), &err);
}

void request_refuse(struct request *q, const struct err *why)
{
	struct conn *c = q->conn;
	uint32_t id = q->id;

	if (refusal_worth(why))
		refusal_log(c->server, &c->peer, why);
	request_free(q);
	conn_send_error(c, id, why);
}

uint64_t conn_held(const struct conn *c)
{
	return c->charged + (c->frame ? frame_conn_held(c->frame) : 0);
}

/* ---- reading ---- */

static void receive(struct conn *c)
{
	struct err err = ERR_INIT;
	Acut__V1__Message *m = NULL;
	uint32_t id = 0;
	int got = -1, r;
	bool later = false;

	if (!c->cut && (room_files(&c->peer, &later, &err) || (later && room_wait(c, &err)))) {
		conn_fail(c, &err);
		return;
	}
	if (later)
		return;
	room_make(c->server, COMFORT, c->peer.uid, c);
	r = frame_conn_recv(c->frame, &id, &m, &got, &err);
	if (r == FRAME_E_AGAIN) {
		c->dry = true;
	} else if (r == FRAME_E_EOF) {
		conn_close(c);
	} else if (r < 0) {
		conn_fail(c, &err);
	} else {
		io_close_assign(got, room_owner(&c->peer));
		request_handle(c, id, m, got);
		frame_message_free(m);
	}
}

/* Whether its user had so much of the loop that others come first. */
static bool comes_later(struct conn *c, uint64_t now)
{
	bool later = turn_later(c->server, c->peer.uid, now);

	if (later != c->later)
		sd_event_source_set_priority(c->io, later ? TURN_LATER : TURN_NOW);
	c->later = later;
	return later;
}

/* A turn: a few requests, or a short time. What is left keeps the source ready. */
static int conn_ready(sd_event_source *source, int fd, uint32_t events, void *ctx)
{
	struct conn *c = ctx;
	uint64_t start = clock_mono_ns(), now = start;
	uint64_t most = TURN_NS;
	bool was_later = c->later;

	if (c->closed)
		return 0;
	/* What it asked for last waits with it. */
	if (c->waits && events & (EPOLLHUP | EPOLLERR)) {
		conn_close(c);
		return 0;
	}
	if (comes_later(c, start)) {
		/* Who is gone makes room at once. */
		if (!was_later && !(events & (EPOLLHUP | EPOLLERR)))
			return 0;
		most /= 4;
	}
	io_close_owner(room_owner(&c->peer));
	if (events & EPOLLOUT)
		flush(c);
	c->dry = false;
	for (int i = 0; i < TURN_REQUESTS && now - start < most && !c->closed && !c->dry && !c->waits; i++) {
		receive(c);
		now = clock_mono_ns();
	}
	io_close_owner(0);
	turn_used(c->server, c->peer.uid, start);
	if (!c->closed)
		conn_watch(c);
	return 0;
}

/* Takes over the peer's groups, if it succeeds. */
static int conn_make(struct server *s, int fd, const struct peer *peer, struct err *err)
{
	struct conn *c = calloc(1, sizeof *c);
	struct frame_limits limits = {.fields = FIELDS_MAX, .ledger = s->p.ledger};
	const int kept = SOCKET_BYTES;
	int r;

	if (!c)
		return err_set(err, ERR_NOMEM, "no memory for a client");
	if (setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &kept, sizeof kept) != 0) {
		free(c);
		return err_sys(err, errno, "the socket of a client cannot be set up");
	}
	c->server = s;
	c->charged = CONN_BYTES + peer->ngroups * sizeof *peer->groups;
	c->peer = *peer;
	r = frame_conn_new(fd, &limits, &c->frame, err);
	if (r) {
		free(c);
		return r;
	}
	r = sd_event_add_io(s->p.event, &c->io, frame_conn_fd(c->frame), EPOLLIN, conn_ready, c);
	if (r < 0) {
		/* The descriptor went to the frame_conn, and goes with it. */
		if (refusal_away(s))
			log_event(LOG_EVENT_CLIENT_TURNED_AWAY, ABOUT_CONN(c), "cannot wait for a client: %s", strerror(-r));
		frame_conn_free(c->frame);
		rights_groups_free(s->p.ledger, &c->peer);
		free(c);
		ledger_give(s->p.ledger, LEDGER_MESSAGE, CONN_BYTES);
		return 0;
	}
	c->number = ++s->last_conn;
	c->next = s->conns;
	s->conns = c;
	s->nconns++;
	log_debug("client: pid %u, uid %u", c->peer.pid, c->peer.uid);
	return 0;
}

unsigned conns_of(const struct server *s, uint32_t uid)
{
	unsigned n = 0;

	for (const struct conn *c = s->conns; c; c = c->next)
		n += !c->closed && c->peer.uid == uid;
	return n;
}

/* Who it is, and whether he is served: before anything is kept for him. */
static int conn_peer(struct server *s, int fd, struct peer *ret, struct err *err)
{
	struct ucred cred;
	socklen_t size = sizeof cred;
	int r;

	if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &cred, &size) != 0)
		return err_sys(err, errno, "the client's user cannot be found out");
	*ret = (struct peer){.uid = cred.uid, .pid = (uint32_t)cred.pid, .gid = cred.gid};
	r = rights_groups(fd, s->p.ledger, ret, err);
	if (r)
		return r;
	rights_look(&s->p.rights, ret);
	r = rights_connect(&s->p.rights, ret, err);
	if (!r)
		r = room_place(s, ret, err);
	if (!r)
		return 0;
	refusal_log(s, ret, err);
	rights_groups_free(s->p.ledger, ret);
	return r;
}

int conn_new(struct server *s, int fd, struct err *err)
{
	struct peer peer;
	int r = conn_peer(s, fd, &peer, err);

	if (r)
		return r;
	room_make(s, CONN_BYTES + COMFORT, peer.uid, NULL);
	if (ledger_take(s->p.ledger, LEDGER_MESSAGE, CONN_BYTES)) {
		r = conn_make(s, fd, &peer, err);
		if (r)
			ledger_give(s->p.ledger, LEDGER_MESSAGE, CONN_BYTES);
	} else {
		r = err_set(err, ERR_BUSY, "there is no memory left for a client");
	}
	if (r)
		rights_groups_free(s->p.ledger, &peer);
	return r;
}

/* ---- the end ---- */

static void leave_jobs(struct conn *c)
{
	struct conn_job *b;
	struct conn_dataset *d;

	while ((b = c->bound)) {
		struct job *job = job_find(c->server->service->jobs, b->id, &c->peer);

		c->bound = b->next;
		if (job)
			job_leave(job);
		free(b);
	}
	while ((d = c->held)) {
		c->held = d->next;
		dataset_release(d->dataset);
		free(d);
	}
}

/* Each is answered, and so freed, before it is over. */
static void leave_prunes(struct conn *c)
{
	struct request *q, *next;

	for (q = c->requests; q; q = next) {
		next = q->next;
		if (q->prune)
			dataset_prune_cancel(q->prune);
	}
}

void conn_close(struct conn *c)
{
	struct push_ref *p;
	uint32_t before;

	if (c->closed)
		return;
	c->closed = true;
	c->server->reap = true;
	c->server->nconns--;
	log_debug("client gone: pid %u", c->peer.pid);
	c->io = sd_event_source_disable_unref(c->io);
	/* Where messages lie unread the close may wait for the files in them: its peer is not to. */
	shutdown(frame_conn_fd(c->frame), SHUT_RDWR);
	before = io_close_owner(room_owner(&c->peer));
	c->frame = frame_conn_free(c->frame);
	io_close_owner(before);
	stream_out_leave(c);
	for (p = c->pushes; p; p = p->next)
		push_ref_leave(p);
	conn_copies_end(c);
	leave_jobs(c);
	if (c->verify)
		cache_verify_end(c->verify);
	leave_prunes(c);
}

bool conn_reap(struct conn *c)
{
	struct request *q, *next;
	struct push_ref *p;

	/* Waits are nobody's but ours. */
	for (q = c->requests; q; q = next) {
		next = q->next;
		if (q->wait)
			request_free(q);
	}
	if (c->requests || c->streams)
		return false;
	while ((p = c->pushes)) {
		c->pushes = p->next;
		free(p);
	}
	rights_groups_free(c->server->p.ledger, &c->peer);
	ledger_give(c->server->p.ledger, LEDGER_MESSAGE, CONN_BYTES);
	free(c);
	return true;
}
