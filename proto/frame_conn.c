/*
 * A connection: frames in, frames out, never waiting.
 *
 * Reading takes exactly the header, then exactly the message, and never a byte of the next frame. The kernel ends a
 * read at bytes that were sent with descriptors, so every descriptor belongs to the current frame. Writing keeps a list
 * of packed frames up to a limit; a descriptor is sent with the first byte of its frame and closed as soon as the
 * kernel has it.
 *
 * After a violation the connection stays broken, because frame boundaries are no longer known.
 */
#include "frame.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "err.h"
#include "io.h"

enum {
	QUEUE_DEFAULT = 256 << 10,
	MESSAGE_DEFAULT = 1 << 20,
	/* The most that one sendmsg can carry (SCM_MAX_FD), so that no surplus descriptor is lost. */
	DESCRIPTORS_MAX = 253,
};

struct queued {
	struct queued *next;
	size_t size, sent, room; /* room: bytes charged, this struct included */
	int fd;                  /* -1: none, or already sent */
	uint8_t bytes[];
};

struct frame_conn {
	int fd;
	struct frame_limits limits;

	struct frame_header header; /* of the current frame, once `got` is beyond it */
	uint8_t head[FRAME_HEADER_SIZE];
	uint8_t *body; /* allocated when the header is complete */
	size_t body_size;
	size_t got; /* bytes of the current frame, header included */
	int in_fd;  /* descriptor of the current frame, or -1 */
	bool broken;
	struct err why; /* if broken */

	struct queued *first, **last;
	size_t queued; /* bytes not yet sent */
	size_t held;   /* charged */
};

/* ---- memory ---- */

static void *conn_alloc(struct frame_conn *conn, size_t size)
{
	void *bytes;

	if (conn->limits.ledger && !ledger_take(conn->limits.ledger, LEDGER_MESSAGE, size))
		return NULL;
	bytes = malloc(size);
	if (!bytes && conn->limits.ledger)
		ledger_give(conn->limits.ledger, LEDGER_MESSAGE, size);
	conn->held += bytes ? size : 0;
	return bytes;
}

static void conn_free_bytes(struct frame_conn *conn, void *bytes, size_t size)
{
	if (!bytes)
		return;
	free(bytes);
	conn->held -= size;
	if (conn->limits.ledger)
		ledger_give(conn->limits.ledger, LEDGER_MESSAGE, size);
}

int frame_conn_new(int fd, const struct frame_limits *limits, struct frame_conn **ret, struct err *err)
{
	struct frame_conn *conn;
	int flags = fcntl(fd, F_GETFL);

	if (flags < 0 || fcntl(fd, F_SETFL, flags | O_NONBLOCK) < 0 || fcntl(fd, F_SETFD, FD_CLOEXEC) < 0)
		return err_sys(err, errno, "cannot set up a connection");
	conn = calloc(1, sizeof *conn);
	if (!conn)
		return err_set(err, ERR_NOMEM, "there is no memory for a connection");
	conn->fd = fd;
	conn->in_fd = -1;
	conn->last = &conn->first;
	if (limits)
		conn->limits = *limits;
	if (conn->limits.queue == 0)
		conn->limits.queue = QUEUE_DEFAULT;
	if (conn->limits.message == 0)
		conn->limits.message = MESSAGE_DEFAULT;
	if (conn->limits.ledger && !ledger_take(conn->limits.ledger, LEDGER_MESSAGE, sizeof *conn)) {
		free(conn);
		return err_set(err, ERR_BUSY, "there is no memory left for a connection");
	}
	conn->held = sizeof *conn;
	*ret = conn;
	return 0;
}

size_t frame_conn_held(const struct frame_conn *conn)
{
	return conn->held;
}

static void conn_close_fd(int *fd)
{
	*fd = io_close(*fd);
}

/* Drops the current frame. */
static void conn_reset(struct frame_conn *conn)
{
	conn_free_bytes(conn, conn->body, conn->body_size);
	conn->body = NULL;
	conn->got = 0;
	conn_close_fd(&conn->in_fd);
}

static void conn_drop_sent(struct frame_conn *conn)
{
	struct queued *q = conn->first;

	conn->first = q->next;
	if (!conn->first)
		conn->last = &conn->first;
	conn_close_fd(&q->fd);
	conn_free_bytes(conn, q, q->room);
}

void frame_conn_cut(struct frame_conn *conn, const struct err *why)
{
	conn_reset(conn);
	while (conn->first)
		conn_drop_sent(conn);
	conn->queued = 0;
	conn->broken = true;
	conn->why = *why;
	shutdown(conn->fd, SHUT_RDWR);
}

struct frame_conn *frame_conn_free(struct frame_conn *conn)
{
	struct ledger *ledger;

	if (!conn)
		return NULL;
	ledger = conn->limits.ledger;
	conn_reset(conn);
	while (conn->first)
		conn_drop_sent(conn);
	conn_close_fd(&conn->fd);
	free(conn);
	if (ledger)
		ledger_give(ledger, LEDGER_MESSAGE, sizeof *conn);
	return NULL;
}

int frame_conn_fd(const struct frame_conn *conn)
{
	return conn->fd;
}

short frame_conn_events(const struct frame_conn *conn)
{
	return conn->first ? POLLIN | POLLOUT : POLLIN;
}

size_t frame_conn_queued(const struct frame_conn *conn)
{
	return conn->queued;
}

/* ---- receiving ---- */

static int conn_break(struct frame_conn *conn, struct err *err)
{
	conn_reset(conn);
	conn->broken = true;
	conn->why = *err;
	return -(int)err->code;
}

/* Keeps one descriptor and closes the others; returns how many came. */
static unsigned conn_take_descriptors(struct frame_conn *conn, struct msghdr *msg)
{
	unsigned count = 0;

	for (struct cmsghdr *c = CMSG_FIRSTHDR(msg); c; c = CMSG_NXTHDR(msg, c)) {
		size_t n;

		if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_RIGHTS)
			continue;
		n = (c->cmsg_len - CMSG_LEN(0)) / sizeof(int);
		for (size_t i = 0; i < n; i++) {
			int fd;

			memcpy(&fd, CMSG_DATA(c) + i * sizeof fd, sizeof fd);
			count++;
			if (conn->in_fd < 0)
				conn->in_fd = fd;
			else
				conn_close_fd(&fd);
		}
	}
	return count;
}

/* Reads up to n bytes of the current frame. 0: *ret_n bytes; AGAIN, EOF, negative. */
static int conn_read(struct frame_conn *conn, uint8_t *bytes, size_t n, size_t *ret_n, struct err *err)
{
	union {
		struct cmsghdr align;
		char bytes[CMSG_SPACE(DESCRIPTORS_MAX * sizeof(int))];
	} control;
	struct iovec iov = {.iov_base = bytes, .iov_len = n};
	struct msghdr msg = {.msg_iov = &iov, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
	bool had = conn->in_fd >= 0;
	unsigned count;
	ssize_t r;

	do {
		r = recvmsg(conn->fd, &msg, MSG_DONTWAIT | MSG_CMSG_CLOEXEC);
	} while (r < 0 && errno == EINTR);
	if (r < 0 && (errno == EAGAIN || errno == EWOULDBLOCK))
		return FRAME_E_AGAIN;
	if (r < 0 && errno == ECONNRESET)
		r = 0;
	else if (r < 0)
		return err_sys(err, errno, "cannot read from a connection");
	if (r == 0 && conn->got == 0)
		return FRAME_E_EOF;
	if (r == 0)
		return err_set(err, ERR_PROTO, "the other side went away in the middle of a frame (%zu bytes of it had come)",
			       conn->got);
	count = conn_take_descriptors(conn, &msg);
	if (count + had > 1)
		return err_set(err, ERR_PROTO, "a frame came with %u descriptors; at most 1 is allowed", count + had);
	/* The buffer was large enough, so the process has no free descriptor. */
	if (msg.msg_flags & MSG_CTRUNC) {
		err_set(err, ERR_BUSY, "there is no room for one more descriptor");
		return err_add_hint(err, "try again when other clients are done");
	}
	*ret_n = (size_t)r;
	return 0;
}

/* Reads until `want` bytes of the frame are there, to at[0..], which is frame byte `base`. */
static int conn_fill(struct frame_conn *conn, uint8_t *at, size_t base, size_t want, struct err *err)
{
	while (conn->got < want) {
		size_t n;
		int r = conn_read(conn, at + (conn->got - base), want - conn->got, &n, err);

		if (r != 0)
			return r;
		conn->got += n;
	}
	return 0;
}

static int conn_header(struct frame_conn *conn, struct err *err)
{
	struct frame_header header;
	int r = frame_header_get(conn->head, &header, err);

	if (r < 0)
		return r;
	conn->body_size = header.length > 0 ? header.length : 1;
	conn->body = conn_alloc(conn, conn->body_size);
	if (!conn->body) {
		err_set(err, ERR_BUSY, "there is no memory left for a frame of %u bytes", header.length);
		return err_add_hint(err, "try again when other clients are done, or set a larger --memory");
	}
	conn->header = header;
	return 0;
}

static int conn_frame(struct frame_conn *conn, struct err *err)
{
	int r;

	if (conn->got < FRAME_HEADER_SIZE) {
		r = conn_fill(conn, conn->head, 0, FRAME_HEADER_SIZE, err);
		if (r == 0)
			r = conn_header(conn, err);
		if (r != 0)
			return r;
	}
	r = conn_fill(conn, conn->body, FRAME_HEADER_SIZE, FRAME_HEADER_SIZE + conn->header.length, err);
	if (r != 0)
		return r;
	if (conn->header.descriptors == 0 && conn->in_fd >= 0)
		return err_set(err, ERR_PROTO, "a descriptor came with a frame that announces none");
	if (conn->header.descriptors == 1 && conn->in_fd < 0)
		return err_set(err, ERR_PROTO, "a frame announces a descriptor and came without");
	return 0;
}

int frame_conn_recv(struct frame_conn *conn, uint32_t *ret_id, Acut__V1__Message **ret_message, int *ret_fd, struct err *err)
{
	Acut__V1__Message *message;
	int r;

	if (conn->broken) {
		*err = conn->why;
		return -(int)err->code;
	}
	r = conn_frame(conn, err);
	if (r < 0)
		return conn_break(conn, err);
	if (r > 0)
		return r;
	if (conn->limits.fields && !frame_message_fields(conn->body, conn->header.length, conn->limits.fields)) {
		err_set(err, ERR_PROTO, "a message has more than %u fields", conn->limits.fields);
		return conn_break(conn, err);
	}
	r = frame_message_unpack(conn->body, conn->header.length, conn->limits.message, conn->limits.ledger, &message, err);
	if (r < 0)
		return conn_break(conn, err);
	*ret_id = conn->header.request_id;
	*ret_message = message;
	*ret_fd = conn->in_fd;
	conn->in_fd = -1;
	conn_reset(conn);
	return 0;
}

/* ---- sending ---- */

/* Allocates a message of `length` bytes that is not queued yet; NULL: *ret_r is the result. */
static struct queued *conn_alloc_message(struct frame_conn *conn, size_t length, int *ret_r, struct err *err)
{
	struct queued *q = NULL;

	if (length > FRAME_BODY_MAX) {
		*ret_r = err_set(err, ERR_LIMIT, "a message of %zu bytes does not fit into a frame of %u", length, FRAME_MAX);
		return NULL;
	}
	length += FRAME_HEADER_SIZE;
	if (length <= conn->limits.queue && conn->queued <= conn->limits.queue - length)
		q = conn_alloc(conn, sizeof *q + length);
	*ret_r = q ? 0 : FRAME_E_FULL;
	if (q)
		*q = (struct queued){.room = sizeof *q + length, .fd = -1};
	return q;
}

/* Queues an allocated message of `length` bytes. */
static void conn_queue(struct frame_conn *conn, uint32_t id, size_t length, int fd, struct queued *q)
{
	struct frame_header header = {.length = (uint32_t)length, .request_id = id, .descriptors = fd >= 0};

	frame_header_put(&header, q->bytes);
	q->fd = fd;
	q->size = FRAME_HEADER_SIZE + length;
	*conn->last = q;
	conn->last = &q->next;
	conn->queued += q->size;
}

int frame_conn_send(struct frame_conn *conn, uint32_t id, const Acut__V1__Message *message, int fd, struct err *err)
{
	int r;
	struct queued *q = conn_alloc_message(conn, acut__v1__message__get_packed_size(message), &r, err);

	if (!q)
		conn_close_fd(&fd);
	else
		conn_queue(conn, id, acut__v1__message__pack(message, q->bytes + FRAME_HEADER_SIZE), fd, q);
	return r;
}

int frame_conn_send_page(struct frame_conn *conn, uint32_t id, Acut__V1__Message__BodyCase list, const struct frame_page *page,
			 bool more, struct err *err)
{
	int r;
	struct queued *q = conn_alloc_message(conn, page->n + FRAME_PAGE_AROUND, &r, err);

	if (q)
		conn_queue(conn, id, frame_page_pack(page, list, more, q->bytes + FRAME_HEADER_SIZE), -1, q);
	return r;
}

int frame_conn_send_error(struct frame_conn *conn, uint32_t id, const struct err *why, struct err *err)
{
	struct frame_error error;

	frame_error_from_err(why, &error);
	return frame_conn_send(conn, id, FRAME_MESSAGE(ERROR, error, &error.body), -1, err);
}

static ssize_t conn_write(struct frame_conn *conn, struct queued *q)
{
	union {
		struct cmsghdr align;
		char bytes[CMSG_SPACE(sizeof(int))];
	} control = {0};
	struct iovec iov = {.iov_base = q->bytes + q->sent, .iov_len = q->size - q->sent};
	struct msghdr msg = {.msg_iov = &iov, .msg_iovlen = 1};
	ssize_t r;

	if (q->fd >= 0) {
		struct cmsghdr *c;

		msg.msg_control = &control;
		msg.msg_controllen = sizeof control.bytes;
		c = CMSG_FIRSTHDR(&msg);
		*c = (struct cmsghdr){.cmsg_level = SOL_SOCKET, .cmsg_type = SCM_RIGHTS, .cmsg_len = CMSG_LEN(sizeof(int))};
		memcpy(CMSG_DATA(c), &q->fd, sizeof q->fd);
	}
	do {
		r = sendmsg(conn->fd, &msg, MSG_DONTWAIT | MSG_NOSIGNAL);
	} while (r < 0 && errno == EINTR);
	return r;
}

int frame_conn_flush(struct frame_conn *conn, struct err *err)
{
	while (conn->first) {
		struct queued *q = conn->first;
		ssize_t n = conn_write(conn, q);

		if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK))
			return FRAME_E_AGAIN;
		if (n < 0 && (errno == EPIPE || errno == ECONNRESET))
			return FRAME_E_EOF;
		if (n < 0)
			return err_sys(err, errno, "cannot write to a connection");
		conn_close_fd(&q->fd);
		q->sent += (size_t)n;
		conn->queued -= (size_t)n;
		if (q->sent == q->size)
			conn_drop_sent(conn);
	}
	return 0;
}
