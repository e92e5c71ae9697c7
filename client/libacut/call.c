/*
 * A call: one request with a number of its own, and the wait for its answers. Other messages are sorted here: progress of the
 * call goes to its callback, news of a push to that push, and late answers to abandoned calls are dropped, their descriptors
 * closed.
 *
 * Errors are of two kinds. Those of one call (refused, timeout, interrupted) leave the connection whole. Those of the
 * connection (the daemon is gone, the protocol is broken) are kept in acut->dead and fail every later call.
 */
#include "call.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <stdlib.h>
#include <unistd.h>

#include "clock.h"

enum { ASK_EVERY_MS = 100 };

/* The call that is running failed for good; so will the next ones. */
static int die(struct acut *a)
{
	if (!a->dead.code)
		a->dead = a->err;
	return -(int)a->err.code;
}

static int die_gone(struct acut *a)
{
	err_set(&a->err, ERR_NODAEMON, "the daemon closed the connection");
	err_add_hint(&a->err, "see the daemon's log; all that was acknowledged is kept");
	return die(a);
}

int call_begin(struct acut *a)
{
	a->fetch = fetch_free(a->fetch);
	a->answer = frame_message_free(a->answer);
	free(a->rows);
	a->rows = NULL;
	a->progress = NULL;
	err_clear(&a->err);
	if (a->dead.code) {
		a->err = a->dead;
		return -(int)a->err.code;
	}
	return 0;
}

int call_send(struct acut *a, const Acut__V1__Message *message, int fd, uint32_t *ret_id)
{
	uint32_t id = a->last_id == UINT32_MAX ? 1 : a->last_id + 1;
	int copy = -1, r;

	if (fd >= 0) {
		copy = fcntl(fd, F_DUPFD_CLOEXEC, 3);
		if (copy < 0)
			return err_sys(&a->err, errno, "cannot duplicate a descriptor");
	}
	r = frame_conn_send(a->conn, id, message, copy, &a->err);
	if (r == FRAME_E_FULL)
		return err_set(&a->err, ERR_BUSY, "the daemon does not read its requests");
	if (r < 0)
		return r;
	a->last_id = id;
	*ret_id = id;
	return 0;
}

static struct acut_push *find_push(struct acut *a, uint32_t id)
{
	struct acut_push *push = a->pushes;

	while (push && push->request_id != id)
		push = push->next;
	return push;
}

/* Nobody waits for this message. */
static int stray(struct acut *a, uint32_t id, const Acut__V1__Message *m)
{
	struct acut_push *push = find_push(a, id);
	struct acut_progress progress;

	if (m->body_case == ACUT__V1__MESSAGE__BODY_ERROR && id == 0) {
		frame_error_to_err(m->error, &a->err);
		return die(a);
	}
	if (!push)
		return 0;
	if (m->body_case == ACUT__V1__MESSAGE__BODY_DURABLE) {
		push->durable = m->durable->files;
	} else if (m->body_case == ACUT__V1__MESSAGE__BODY_PROGRESS && push->progress) {
		call_progress(m->progress, &progress);
		push->progress(push->ctx, &progress);
	} else if (m->body_case == ACUT__V1__MESSAGE__BODY_ERROR) {
		frame_error_to_err(m->error, &push->failed);
	}
	return 0;
}

/* An answer to a request of the window, which takes it over; false: it is none. */
static bool window_take(struct acut *a, uint32_t id, Acut__V1__Message *m)
{
	struct acut_progress progress;

	for (unsigned i = 0; id && a->window && i < CALL_WINDOW; i++) {
		struct call_slot *s = &a->window->slot[i];

		if (s->id != id || s->answer)
			continue;
		if (m->body_case != ACUT__V1__MESSAGE__BODY_PROGRESS) {
			s->answer = m;
			return true;
		}
		if (a->progress) {
			call_progress(m->progress, &progress);
			a->progress(a->progress_ctx, &progress);
		}
		frame_message_free(m);
		return true;
	}
	return false;
}

int call_pump(struct acut *a, uint32_t id, Acut__V1__Message **ret, int *ret_fd)
{
	Acut__V1__Message *m;
	struct acut_progress progress;
	uint32_t got;
	int fd, r;

	*ret = NULL;
	r = frame_conn_flush(a->conn, &a->err);
	if (r < 0)
		return die(a);
	/* If the daemon is gone, it may have sent the reason before: read on. */
	r = frame_conn_recv(a->conn, &got, &m, &fd, &a->err);
	if (r == FRAME_E_AGAIN)
		return r;
	if (r == FRAME_E_EOF)
		return die_gone(a);
	if (r < 0)
		return die(a);
	if (got == id && id != 0 && m->body_case != ACUT__V1__MESSAGE__BODY_PROGRESS) {
		*ret = m;
		*ret_fd = fd;
		return 0;
	}
	if (window_take(a, got, m)) {
		if (fd >= 0)
			close(fd);
		return 0;
	}
	if (got == id && id != 0 && a->progress) {
		call_progress(m->progress, &progress);
		a->progress(a->progress_ctx, &progress);
	} else {
		r = stray(a, got, m);
	}
	if (fd >= 0)
		close(fd);
	frame_message_free(m);
	return r;
}

int call_pause(struct acut *a, uint64_t since, struct pollfd *other)
{
	double left = a->options.timeout - clock_since(since);
	struct pollfd fds[2] = {{.fd = frame_conn_fd(a->conn), .events = frame_conn_events(a->conn)}};
	int wait = -1;

	if (a->options.interrupted && a->options.interrupted(a->options.ctx))
		return err_set(&a->err, ERR_CANCELLED, "interrupted");
	if (a->options.timeout > 0 && left <= 0) {
		err_set(&a->err, ERR_TIMEOUT, "the daemon gave no answer within %g s", a->options.timeout);
		return err_add_hint(&a->err, "it may be busy; ask for its status, or allow more time");
	}
	if (a->options.timeout > 0)
		wait = left > 3600 ? 3600000 : (int)(left * 1000) + 1;
	if (a->options.interrupted && (wait < 0 || wait > ASK_EVERY_MS))
		wait = ASK_EVERY_MS;
	if (other)
		fds[1] = *other;
	if (poll(fds, other ? 2 : 1, wait) < 0 && errno != EINTR)
		return err_sys(&a->err, errno, "cannot wait for the daemon");
	return 0;
}

int call_next(struct acut *a, uint32_t id, Acut__V1__Message **ret, int *ret_fd)
{
	uint64_t since = clock_mono_ns();
	Acut__V1__Message *m = NULL;
	int fd = -1, r = 0;

	while (!m) {
		r = call_pump(a, id, &m, &fd);
		if (r == FRAME_E_AGAIN)
			r = call_pause(a, since, NULL);
		else
			since = clock_mono_ns();
		if (r < 0)
			return r;
	}
	if (m->body_case == ACUT__V1__MESSAGE__BODY_ERROR) {
		r = frame_error_to_err(m->error, &a->err);
		frame_message_free(m);
		m = NULL;
	}
	if (ret_fd && m)
		*ret_fd = fd;
	else if (fd >= 0)
		close(fd);
	if (!m)
		return r;
	*ret = m;
	return 0;
}

int call_window_wait(struct acut *a)
{
	const struct call_window *w = a->window;
	uint64_t since = clock_mono_ns();

	while (!w->slot[w->first].answer) {
		Acut__V1__Message *m;
		int fd, r = call_pump(a, 0, &m, &fd);

		if (r == FRAME_E_AGAIN)
			r = call_pause(a, since, NULL);
		else
			since = clock_mono_ns();
		if (r < 0)
			return r;
	}
	return 0;
}

int call_unexpected(struct acut *a, const Acut__V1__Message *m)
{
	return err_set(&a->err, ERR_PROTO, "the daemon answered with a message of kind %d, which was not asked for",
		       (int)m->body_case);
}

int call_again(struct acut *a, const Acut__V1__Message *req, int fd, Acut__V1__Message__BodyCase want, uint32_t *ret_id,
	       Acut__V1__Message **ret)
{
	Acut__V1__Message *m;
	uint32_t id;
	int r;

	r = call_send(a, req, fd, &id);
	if (r == 0)
		r = call_next(a, id, &m, NULL);
	if (r < 0)
		return r;
	if (m->body_case != want) {
		r = call_unexpected(a, m);
		frame_message_free(m);
		return r;
	}
	*ret_id = id;
	*ret = m;
	return 0;
}

int call_ask(struct acut *a, const Acut__V1__Message *req, int fd, Acut__V1__Message__BodyCase want)
{
	uint32_t id;
	int r = call_begin(a);

	return r < 0 ? r : call_again(a, req, fd, want, &id, &a->answer);
}
