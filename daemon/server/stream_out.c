/*
 * One mesh stream to one client: a pipe that the daemon made, written from the loop as the client reads.
 *
 * The model: four frames at most, in this order: head, what changes are against (several, one after the other, and
 * only of such a stream), the block that the run handed over, tail; each is pieces with its own scratch, and a position. The
 * pieces of a block point into the domain's memory. When the reader is too slow, the run lets a worker spool what is left of
 * the block (`paused` meanwhile: the loop keeps its hands off), and it is written from a small buffer that workers refill. The
 * pipe is non-blocking; a reader who closes it ends the stream and nothing else. A stream whose block was cut off by an error has
 * no tail: the error goes over the socket, on the request of the Fetch, and then the pipe ends.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/uio.h>
#include <unistd.h>

#include "clock.h"
#include "io.h"
#include "ledger.h"
#include "log.h"
#include "server_priv.h"
#include "stream_changes.h"

enum { HEAD, CHANGES, BLOCK, TAIL, FRAMES, PIPE_SIZE = 1 << 20 };

struct stream_out {
	struct run_output output; /* first: stream_of */
	struct stream_out *next;
	struct conn *conn; /* its connection, until the end */
	uint64_t job;
	uint32_t request;
	int fd;
	sd_event_source *io;
	struct out_frame frame[FRAMES]; /* that of CHANGES is not used */
	struct out_changes *changes;    /* NULL: there are none, or all are sent */
	char *view;                     /* that the head points to */
	size_t view_bytes;              /* charged for it, and for the changes */
	uint64_t blocks;                /* before `from`, and sent */
	uint64_t blocked_ns;            /* since when bytes wait; 0: none do */
	bool paused, ended, gone;

	int spool; /* -1: none */
	uint64_t spool_size, spool_at;
	uint8_t *buffer; /* RUN_OUTPUT_BUFFER, of spooled bytes */
	size_t buffered, written;
};

static struct stream_out *stream_of(struct run_output *o)
{
	return (struct stream_out *)o;
}

/* ---- the end ---- */

static void spool_close(struct stream_out *o)
{
	o->spool = io_close(o->spool);
	free(o->buffer);
	o->buffer = NULL;
	o->buffered = o->written = 0;
	o->spool_at = o->spool_size = 0;
}

static void stream_free(struct stream_out *o)
{
	struct stream_out **at;

	for (at = &o->conn->streams; *at != o; at = &(*at)->next)
		;
	*at = o->next;
	if (o->conn->closed)
		o->conn->server->reap = true;
	sd_event_source_disable_unref(o->io);
	io_close(o->fd);
	spool_close(o);
	free(o->view);
	free(o->changes);
	ledger_give(o->conn->server->p.ledger, LEDGER_PIPE, sizeof *o + o->view_bytes);
	free(o);
}

static void freed(struct run_output *output)
{
	stream_free(stream_of(output));
}

/* Nobody reads any more, or nobody may. */
static void drop(struct stream_out *o)
{
	if (o->gone)
		return;
	o->gone = true;
	o->io = sd_event_source_disable_unref(o->io);
	o->fd = io_close(o->fd);
	if (o->ended)
		stream_free(o);
	else
		run_output_close(&o->output, freed);
}

/* ---- writing ---- */

static void wait_for_room(struct stream_out *o, bool wait)
{
	if (wait && !o->blocked_ns)
		o->blocked_ns = clock_mono_ns();
	sd_event_source_set_io_events(o->io, wait ? EPOLLOUT : 0);
}

/* 0: as much as there was; 1: the pipe is full; -1: nobody reads. */
static int write_bytes(struct stream_out *o, const struct iovec *iov, int n, size_t *ret_done)
{
	ssize_t done = writev(o->fd, iov, n);

	*ret_done = 0;
	if (done < 0 && errno == EINTR)
		return 0;
	if (done < 0)
		return errno == EAGAIN ? 1 : -1;
	o->blocked_ns = 0;
	*ret_done = (size_t)done;
	return 0;
}

static int write_frame(struct stream_out *o, struct out_frame *f)
{
	while (f->at < f->n) {
		struct iovec iov[STREAM_PIECES];
		size_t done;
		int n = 0, r;

		for (unsigned i = f->at; i < f->n; i++) {
			size_t skip = i == f->at ? f->done : 0;

			iov[n++] = (struct iovec){(uint8_t *)f->piece[i].bytes + skip, f->piece[i].size - skip};
		}
		r = write_bytes(o, iov, n, &done);
		if (r)
			return r;
		for (; f->at < f->n && done >= f->piece[f->at].size - f->done; f->at++) {
			done -= f->piece[f->at].size - f->done;
			f->done = 0;
		}
		f->done += f->at < f->n ? done : 0;
	}
	return 0;
}

/* 2: a worker must refill the buffer. */
static int write_spooled(struct stream_out *o)
{
	while (o->written < o->buffered) {
		struct iovec iov = {o->buffer + o->written, o->buffered - o->written};
		size_t done;
		int r = write_bytes(o, &iov, 1, &done);

		if (r)
			return r;
		o->written += done;
	}
	return o->spool_at < o->spool_size ? 2 : 0;
}

static int write_changes(struct stream_out *o)
{
	int r = 0;

	while (o->changes && !r) {
		r = write_frame(o, &o->changes->frame);
		if (!r)
			o->changes = out_changes_next(o->changes);
	}
	return r;
}

static void pump(struct stream_out *o)
{
	int i, r = 0;

	if (o->gone || o->paused)
		return;
	for (i = 0; i < FRAMES; i++) {
		struct out_frame *f = &o->frame[i];

		if (i == CHANGES)
			r = write_changes(o);
		if (r)
			break;
		if (!f->ready)
			continue;
		r = i == BLOCK && o->spool >= 0 ? write_spooled(o) : write_frame(o, f);
		if (r)
			break;
		f->ready = false;
		if (i == BLOCK) {
			spool_close(o);
			wait_for_room(o, false);
			run_output_sent(&o->output);
			/* The next block, or the end, comes from the run. */
			return;
		}
	}
	if (r < 0) {
		drop(o);
	} else if (r == 2) {
		wait_for_room(o, false);
		run_output_drained(&o->output);
	} else if (r == 1) {
		wait_for_room(o, true);
	} else if (o->ended) {
		drop(o);
	} else {
		wait_for_room(o, false);
	}
}

static int pipe_ready(sd_event_source *source, int fd, uint32_t events, void *ctx)
{
	struct stream_out *o = ctx;

	if (events & (EPOLLERR | EPOLLHUP)) {
		if (o->paused) {
			/* A worker has it: when it is back. */
			sd_event_source_set_enabled(o->io, SD_EVENT_OFF);
			return 0;
		}
		drop(o);
	} else {
		pump(o);
	}
	return 0;
}

/* ---- what the run calls ---- */

static void text_copy(char *to, size_t size, const char *from)
{
	size_t n = strnlen(from, size - 1);

	memcpy(to, from, n);
	to[n] = 0;
}

/* On the socket, and before the pipe ends. A client that is gone shows when the loop comes to it: nothing is
 * closed here, since the run is going through its outputs. */
static void tell_why(struct stream_out *o, const struct err *why)
{
	struct conn *c = o->conn;
	struct err err = ERR_INIT;

	if (c->closed || frame_conn_send_error(c->frame, o->request, why, &err))
		return;
	frame_conn_flush(c->frame, &err);
	conn_watch(c);
}

static void out_head(struct run_output *output, const struct run_head *in)
{
	struct stream_out *o = stream_of(output);
	struct out_frame *f = &o->frame[HEAD];
	struct stream_head head = {.kind = in->changes ? STREAM_CHANGES : in->window ? STREAM_AREA : STREAM_WHOLE, .id = in->id};
	struct err err = ERR_INIT;
	int r = in->changes ? out_changes_new(in->changes, o->conn->server->p.ledger, &o->view_bytes, &o->changes, &err) : 0;
	char lattice[LATTICE_TEXT_SIZE];

	text_copy(head.lattice, sizeof head.lattice, lattice_text(&in->manifest->lattice, lattice));
	text_copy(head.crs, sizeof head.crs, in->manifest->crs);
	text_copy(head.unit_xy, sizeof head.unit_xy, in->manifest->unit_xy);
	text_copy(head.unit_z, sizeof head.unit_z, in->manifest->unit_z);
	if (!r && ledger_take(o->conn->server->p.ledger, LEDGER_PIPE, strlen(in->view) + 1)) {
		o->view_bytes += strlen(in->view) + 1;
		o->view = strdup(in->view);
	}
	if (!o->view) {
		if (!r)
			err_set(&err, ERR_NOMEM, "no memory for the head of a stream");
		tell_why(o, &err);
		drop(o);
		return;
	}
	head.view = o->view;
	memcpy(head.box, in->box, sizeof head.box);
	f->n = stream_put_head(&head, f->scratch, f->piece);
	f->at = 0;
	f->done = 0;
	f->ready = true;
	pump(o);
}

_Static_assert(sizeof(struct mesh_vertex) == sizeof(int32_t[3]), "vertices go out as they lie in memory");

/* On a worker: the checksum costs time. */
static void out_encode(struct run_output *output, const struct mesh_block *b)
{
	struct stream_out *o = stream_of(output);
	struct out_frame *f = &o->frame[BLOCK];
	struct stream_block block = {
		.index = b->index,
		.first = b->first,
		.nforeign = b->nforeign,
		.nnew = b->nnew,
		.ntriangle = b->ntriangle,
		.foreign = b->foreign,
		.vertex = (const int32_t(*)[3])b->vertex,
		.triangle = b->triangle,
		.final = b->final,
	};

	output->spooled = false;
	memcpy(block.box, b->box, sizeof block.box);
	f->n = stream_put_block(&block, f->scratch, f->piece);
	f->at = 0;
	f->done = 0;
}

static void out_send(struct run_output *output)
{
	struct stream_out *o = stream_of(output);

	if (!o->paused) {
		o->frame[BLOCK].ready = true;
		o->blocks++;
	}
	o->paused = false;
	if (o->io)
		sd_event_source_set_enabled(o->io, SD_EVENT_ON);
	pump(o);
}

static void out_pause(struct run_output *output)
{
	struct stream_out *o = stream_of(output);

	o->paused = true;
	wait_for_room(o, false);
}

static double out_stalled(struct run_output *output)
{
	struct stream_out *o = stream_of(output);

	return o->blocked_ns && !o->paused ? clock_since(o->blocked_ns) : 0;
}

static int out_spool(struct run_output *output, int dirfd, struct err *err)
{
	struct stream_out *o = stream_of(output);
	struct out_frame *f = &o->frame[BLOCK];
	uint64_t at = 0;
	int fd, r = io_open(dirfd, ".", O_TMPFILE | O_RDWR, 0600, &fd, err);

	if (r)
		return r;
	o->buffer = malloc(RUN_OUTPUT_BUFFER);
	if (!o->buffer) {
		io_close(fd);
		return err_set(err, ERR_NOMEM, "no memory for a buffer");
	}
	for (unsigned i = f->at; !r && i < f->n; i++) {
		size_t skip = i == f->at ? f->done : 0, size = f->piece[i].size - skip;

		r = io_write_at(fd, (const uint8_t *)f->piece[i].bytes + skip, size, at, "a spooled block", err);
		at += size;
	}
	if (r) {
		io_close(fd);
		free(o->buffer);
		o->buffer = NULL;
		return r;
	}
	o->spool = fd;
	o->spool_size = at;
	o->spool_at = 0;
	o->buffered = o->written = 0;
	output->spooled = true;
	return 0;
}

static int out_refill(struct run_output *output, struct err *err)
{
	struct stream_out *o = stream_of(output);
	uint64_t left = o->spool_size - o->spool_at;
	size_t n = left < RUN_OUTPUT_BUFFER ? (size_t)left : RUN_OUTPUT_BUFFER;
	int r = io_read_at(o->spool, o->buffer, n, o->spool_at, "a spooled block", err);

	if (r)
		return r;
	o->spool_at += n;
	o->buffered = n;
	o->written = 0;
	return 0;
}

static void tail_error(struct stream_tail *tail, const struct err *why)
{
	struct err told = *why;

	/* A tail has no field for the file and the place: they stand before the sentence, and the hint has a field of its own. */
	told.hint[0] = 0;
	tail->failed = true;
	text_copy(tail->error_code, sizeof tail->error_code, err_wire_name(why->code));
	err_format(&told, tail->error_message, sizeof tail->error_message);
	text_copy(tail->error_hint, sizeof tail->error_hint, why->hint);
}

static void tail_totals(struct stream_tail *tail, const struct stream_out *o, const struct pipe_totals *t,
			const struct job_report *report)
{
	tail->blocks = o->blocks;
	tail->vertices = t->vertices;
	tail->triangles = t->triangles;
	tail->hull = t->hull;
	memcpy(tail->box, t->box, sizeof tail->box);
	tail->digest = t->digest;
	tail->vertex_digest = t->vertex_digest;
	message_report_json(report, tail->report, sizeof tail->report);
}

static void out_end(struct run_output *output, const struct err *why, const struct pipe_totals *totals,
		    const struct job_report *report)
{
	struct stream_out *o = stream_of(output);
	struct out_frame *f = &o->frame[TAIL];
	struct stream_tail tail = {0};

	o->ended = true;
	o->paused = false;
	if (o->frame[BLOCK].ready || o->gone) {
		/* Half a block: its memory is gone, so no tail can follow. */
		if (why && !o->gone)
			tell_why(o, why);
		drop(o);
		return;
	}
	if (why)
		tail_error(&tail, why);
	else
		tail_totals(&tail, o, totals, report);
	if (why && !o->frame[HEAD].n) {
		/* A stream starts with its head, also one that failed before there was a grid. */
		struct stream_head head = {.kind = STREAM_WHOLE, .lattice = "1 1 0 0 0"};

		strcpy(head.crs, "unknown");
		strcpy(head.unit_xy, "unknown");
		strcpy(head.unit_z, "unknown");
		o->frame[HEAD].n = stream_put_head(&head, o->frame[HEAD].scratch, o->frame[HEAD].piece);
		o->frame[HEAD].ready = true;
	}
	f->n = stream_put_tail(&tail, f->scratch, f->piece);
	f->ready = true;
	pump(o);
}

/* What the job is at is no news to whoever reads what it made. */
static void out_waits(struct run_output *output, const char *text)
{
	struct stream_out *o = stream_of(output);
	Acut__V1__Progress progress = ACUT__V1__PROGRESS__INIT;

	if (o->gone || o->ended)
		return;
	progress.phase = (char *)"mesh";
	progress.waiting = (char *)text;
	conn_send(o->conn, o->request, FRAME_MESSAGE(PROGRESS, progress, &progress), -1);
}

static const struct run_output_calls output_calls = {
	.waits = out_waits,
	.head = out_head,
	.send = out_send,
	.pause = out_pause,
	.stalled = out_stalled,
	.end = out_end,
	.encode = out_encode,
	.spool = out_spool,
	.refill = out_refill,
};

/* ---- what the server calls ---- */

static struct stream_out *stream_make(struct conn *c, uint64_t job, uint32_t request, int ends[2], struct err *err)
{
	struct stream_out *o = calloc(1, sizeof *o);
	int r;

	if (!o) {
		err_set(err, ERR_NOMEM, "no memory for a stream");
		return NULL;
	}
	if (pipe2(ends, O_CLOEXEC | O_NONBLOCK) != 0) {
		err_sys(err, errno, "cannot make a pipe");
		free(o);
		return NULL;
	}
	/* A larger pipe saves wake-ups; users have a limit on such pipes, and then it stays small. */
	fcntl(ends[1], F_SETPIPE_SZ, PIPE_SIZE);
	r = sd_event_add_io(c->server->p.event, &o->io, ends[1], 0, pipe_ready, o);
	if (r < 0) {
		err_sys(err, -r, "cannot watch a pipe");
		close(ends[0]);
		close(ends[1]);
		free(o);
		return NULL;
	}
	/* Requests before bulk. */
	sd_event_source_set_priority(o->io, TURN_BULK);
	o->output.calls = &output_calls;
	o->conn = c;
	o->job = job;
	o->request = request;
	o->fd = ends[1];
	o->spool = -1;
	o->next = c->streams;
	c->streams = o;
	return o;
}

struct stream_out *stream_out_new(struct conn *c, uint64_t job, uint32_t request, int *ret_read_end, struct err *err)
{
	struct ledger *l = c->server->p.ledger;
	struct stream_out *o;
	unsigned n = 0;
	int ends[2];

	for (const struct stream_out *other = c->streams; other; other = other->next)
		n++;
	if (n >= CONN_STREAMS_MAX) {
		err_set(err, ERR_BUSY, "%d streams of this connection are open already", CONN_STREAMS_MAX);
		return NULL;
	}
	/* A quarter of what streams may have is for those that come back through a buffer: they must never wait for it. */
	if (ledger_held(l, LEDGER_PIPE) + sizeof *o > ledger_total(l) / 32 * 3 || !ledger_take(l, LEDGER_PIPE, sizeof *o)) {
		err_set(err, ERR_BUSY, "there is no memory left for a stream");
		err_add_hint(err, "try again when other streams are over, or give acutd more memory");
		return NULL;
	}
	o = stream_make(c, job, request, ends, err);
	if (o)
		*ret_read_end = ends[0];
	else
		ledger_give(c->server->p.ledger, LEDGER_PIPE, sizeof *o);
	return o;
}

void stream_out_from(struct stream_out *o, uint64_t from, const struct digest *want, uint64_t since)
{
	o->output.since = since;
	o->blocks = o->output.from = from;
	o->output.wants = want != NULL;
	if (want)
		o->output.want = *want;
}

void stream_out_start(struct stream_out *o, struct job *job, char *window)
{
	o->output.window = window;
	job_fetch(job, &o->output);
}

void stream_out_leave(struct conn *c)
{
	struct stream_out *o, *next;

	for (o = c->streams; o; o = next) {
		next = o->next;
		drop(o);
	}
}

uint64_t stream_out_held(const struct conn *c)
{
	const struct stream_out *o;
	uint64_t bytes = 0;

	for (o = c->streams; o; o = o->next)
		bytes += sizeof *o + o->view_bytes;
	return bytes;
}

uint64_t stream_out_pipes(const struct conn *c)
{
	const struct stream_out *o;
	uint64_t bytes = 0;

	for (o = c->streams; o; o = o->next) {
		int size = o->fd < 0 ? 0 : fcntl(o->fd, F_GETPIPE_SZ);

		bytes += size > 0 ? (uint64_t)size : 0;
	}
	return bytes;
}

void stream_out_progress(struct conn *c, struct job *job)
{
	struct stream_out *o;
	struct message_job m;

	if (!c->streams)
		return;
	message_job(job, &m);
	m.progress.waiting = m.job.waiting;
	/* A client that is cut off takes its streams with it. */
	for (o = c->streams; !c->closed && o; o = c->closed ? NULL : o->next)
		if (!o->gone && !o->ended && m.job.id == o->job && !m.job.final)
			conn_send(c, o->request, FRAME_MESSAGE(PROGRESS, progress, &m.progress), -1);
}
