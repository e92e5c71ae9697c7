/*
 * A connection: it receives requests, sends answers, and owns what ends with it.
 *
 * The model: everything that a client began is in lists of its connection: unanswered requests, pushes, bound jobs, one-step
 * datasets, streams. conn_close releases all of them at once. A request that a worker is processing keeps the connection in
 * memory until it is answered; the answer is then discarded. A client that does not read is disconnected when its queued answers
 * reach their limit, or when others need the memory that it holds (quota.c). The socket buffers little. Everything else is
 * charged: partial frames, queued answers, and requests with what is kept for them.
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
	CONN_BYTES = 2 << 10,    /* of a connection and its event source, without its frames */
	REQUEST_BYTES = 4 << 10, /* of a request and what is kept until it is answered, without its texts */
	SOCKET_BYTES = 16 << 10, /* the send buffer of the socket (the kernel doubles it for its own needs): it counts in the
				    control group but in no account of the ledger, so many clients that do not read must not have
				    much. Large data goes through pipes. */
	RECEIVE_BYTES = 2 * FRAME_MAX, /* a frame that is being received, and its message */
	FIELDS_MAX = 1000,             /* of a request: the largest has 30, and each costs some ten nanoseconds of the loop */
	SLICE_REQUESTS = 16,           /* of one time slice, at most */
	SLICE_NS = 200000,             /* after which no further request is processed */
};

void conn_update_events(struct conn *c)
{
	uint32_t ignored = c->paused ? EPOLLIN : 0;

	THREAD_LOOP_ONLY();
	if (c->io && c->frame)
		sd_event_source_set_io_events(c->io, (uint32_t)frame_conn_events(c->frame) & ~ignored);
}

static void flush_answers(struct conn *c)
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
		conn_update_events(c);
}

static void after_send(struct conn *c, int r, const struct err *err)
{
	if (r == FRAME_E_FULL) {
		if (refusal_may_log_cut(c->server))
			log_event(LOG_EVENT_CLIENT_CUT, ABOUT_CONN(c),
				  "a client (pid %u) does not read its answers and is cut off", c->peer.pid);
		conn_close(c);
	} else if (r < 0) {
		if (refusal_may_log_cut(c->server))
			log_event_err(LOG_EVENT_CLIENT_CUT, ABOUT_CONN(c), "an answer cannot be sent", err);
		conn_close(c);
	} else {
		flush_answers(c);
	}
}

void conn_send(struct conn *c, uint32_t id, const Acut__V1__Message *m, int fd)
{
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (c->closed) {
		io_close(fd);
		return;
	}
	/* Usually there is memory for the largest message. */
	if (ledger_available(c->server->p.ledger, LEDGER_MESSAGE) < FRAME_MAX + RECEIVE_BYTES / 16)
		quota_reclaim(c->server, frame_message_size(m) + RECEIVE_BYTES / 16, c->peer.uid, c);
	after_send(c, frame_conn_send(c->frame, id, m, fd, &err), &err);
}

void conn_send_error(struct conn *c, uint32_t id, const struct err *why)
{
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (c->closed)
		return;
	quota_reclaim(c->server, RECEIVE_BYTES / 16, c->peer.uid, c);
	after_send(c, frame_conn_send_error(c->frame, id, why, &err), &err);
}

void conn_fail(struct conn *c, const struct err *why)
{
	if (refusal_may_log_cut(c->server))
		log_event_err(LOG_EVENT_CLIENT_CUT, ABOUT_CONN(c), "a client is cut off", why);
	conn_send_error(c, 0, why);
	conn_close(c);
}

/* ---- requests ---- */

struct request *request_new(struct conn *c, uint32_t id, size_t bytes, struct err *err)
{
	struct ledger *ledger = c->server->p.ledger;
	struct request *q;

	THREAD_LOOP_ONLY();
	bytes += REQUEST_BYTES;
	quota_reclaim(c->server, bytes, c->peer.uid, c);
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

	THREAD_LOOP_ONLY();
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

void request_finish(struct request *q, const struct err *why)
{
	if (why)
		request_refuse(q, why);
	else
		request_answer_done(q);
}

void request_answer_done(struct request *q)
{
	Acut__V1__Done done = ACUT__V1__DONE__INIT;

	request_answer(q, FRAME_MESSAGE(DONE, done, &done));
}

void request_progress(struct request *q, const char *phase, uint64_t done, uint64_t total, const char *waiting)
{
	Acut__V1__Progress m = ACUT__V1__PROGRESS__INIT;

	m.phase = (char *)phase;
	m.points = done;
	m.points_total = total;
	m.waiting = (char *)waiting;
	conn_send(q->conn, q->id, FRAME_MESSAGE(PROGRESS, progress, &m), -1);
}

void request_answer_page(struct request *q, Acut__V1__Message__BodyCase list, const struct frame_page *page, bool more)
{
	struct conn *c = q->conn;
	struct err err = ERR_INIT;
	uint32_t id = q->id;

	request_free(q);
	if (c->closed)
		return;
	quota_reclaim(c->server, page->n + RECEIVE_BYTES / 16, c->peer.uid, c);
	after_send(c, frame_conn_send_page(c->frame, id, list, page, more, &err), &err);
}

void request_refuse(struct request *q, const struct err *why)
{
	struct conn *c = q->conn;
	uint32_t id = q->id;

	if (refusal_is_logged(why))
		refusal_log(c->server, &c->peer, why);
	request_free(q);
	conn_send_error(c, id, why);
}

uint64_t conn_held(const struct conn *c)
{
	return c->charged + (c->frame ? frame_conn_held(c->frame) : 0);
}

/* ---- reading ---- */

static void receive_message(struct conn *c)
{
	struct err err = ERR_INIT;
	Acut__V1__Message *m = NULL;
	uint32_t id = 0;
	int got = -1, r;
	bool pause = false;

	if (!c->cut && (quota_closing_files(&c->peer, &pause, &err) || (pause && quota_pause(c, &err)))) {
		conn_fail(c, &err);
		return;
	}
	if (pause)
		return;
	quota_reclaim(c->server, RECEIVE_BYTES, c->peer.uid, c);
	r = frame_conn_recv(c->frame, &id, &m, &got, &err);
	if (r == FRAME_E_AGAIN) {
		c->dry = true;
	} else if (r == FRAME_E_EOF) {
		conn_close(c);
	} else if (r < 0) {
		conn_fail(c, &err);
	} else {
		io_close_assign(got, quota_owner(&c->peer));
		request_handle(c, id, m, got);
		frame_message_free(m);
	}
}

/* True: its user is over the fair share. */
static bool update_priority(struct conn *c, uint64_t now)
{
	bool behind = fair_is_behind(c->server, c->peer.uid, now);

	if (behind != c->behind)
		sd_event_source_set_priority(c->io, behind ? FAIR_BEHIND : FAIR_REQUESTS);
	c->behind = behind;
	return behind;
}

/* One time slice: a few requests, or a short time. If messages are left, the source stays ready. */
static int on_socket(sd_event_source *source, int fd, uint32_t events, void *ctx)
{
	struct conn *c = ctx;
	uint64_t start = clock_mono_ns(), now = start;
	uint64_t slice_ns = SLICE_NS;
	bool was_behind = c->behind;

	if (c->closed)
		return 0;
	/* The last request of the client is paused with the connection, and would not notice that the client has left. */
	if (c->paused && events & (EPOLLHUP | EPOLLERR)) {
		conn_close(c);
		return 0;
	}
	if (update_priority(c, start)) {
		/* A client that is gone is closed at once, which frees its memory. */
		if (!was_behind && !(events & (EPOLLHUP | EPOLLERR)))
			return 0;
		slice_ns /= 4;
	}
	io_close_owner(quota_owner(&c->peer));
	if (events & EPOLLOUT)
		flush_answers(c);
	c->dry = false;
	for (int i = 0; i < SLICE_REQUESTS && now - start < slice_ns && !c->closed && !c->dry && !c->paused; i++) {
		receive_message(c);
		now = clock_mono_ns();
	}
	io_close_owner(0);
	fair_charge(c->server, c->peer.uid, start);
	if (!c->closed)
		conn_update_events(c);
	return 0;
}

/* Takes over the peer's groups if it succeeds. */
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
	r = sd_event_add_io(s->p.event, &c->io, frame_conn_fd(c->frame), EPOLLIN, on_socket, c);
	if (r < 0) {
		/* The frame_conn has taken the descriptor over, and closes it. */
		if (refusal_may_log_turned_away(s))
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

unsigned conn_count(const struct server *s, uint32_t uid)
{
	unsigned n = 0;

	for (const struct conn *c = s->conns; c; c = c->next)
		n += !c->closed && c->peer.uid == uid;
	return n;
}

/* Identifies the client and checks its permission and quota, before anything is kept for it. */
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
	rights_set_admin(&s->p.rights, ret);
	r = rights_connect(&s->p.rights, ret, err);
	if (!r)
		r = quota_connection(s, ret, err);
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

	THREAD_LOOP_ONLY();
	if (r)
		return r;
	quota_reclaim(s, CONN_BYTES + RECEIVE_BYTES, peer.uid, NULL);
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

/* Cancelling a prune answers its request, which frees the request. */
static void leave_work(struct conn *c)
{
	struct request *q, *next;

	for (q = c->requests; q; q = next) {
		next = q->next;
		if (q->prune)
			dataset_prune_cancel(q->prune);
		else if (q->named)
			request_named_leave(q->named);
	}
}

void conn_close(struct conn *c)
{
	struct push_ref *p;
	uint32_t before;

	THREAD_LOOP_ONLY();
	if (c->closed)
		return;
	c->closed = true;
	c->server->reap = true;
	c->server->nconns--;
	log_debug("client gone: pid %u", c->peer.pid);
	c->io = sd_event_source_disable_unref(c->io);
	/* Closing a socket with unread messages may wait for the files in them. The peer must not wait for that. */
	shutdown(frame_conn_fd(c->frame), SHUT_RDWR);
	before = io_close_owner(quota_owner(&c->peer));
	c->frame = frame_conn_free(c->frame);
	io_close_owner(before);
	stream_out_leave(c);
	for (p = c->pushes; p; p = p->next)
		push_ref_leave(p);
	conn_copies_end(c);
	leave_jobs(c);
	if (c->verify)
		cache_verify_end(c->verify);
	if (c->adopt)
		cache_adopt_end(c->adopt);
	leave_work(c);
}

bool conn_reap(struct conn *c)
{
	struct request *q, *next;
	struct push_ref *p;

	THREAD_LOOP_ONLY();
	/* Only the connection refers to a request of Wait. */
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
