/*
 * One mesh stream to one client: a pipe that the daemon makes, and writes from the loop as the client reads (stream_pipe.c). The
 * blocks come from a run (stream_run.c). A reader that closes the pipe ends the stream and nothing else.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

#include "io.h"
#include "ledger.h"
#include "stream_priv.h"

enum { PIPE_SIZE = 1 << 20 };

/* ---- the end ---- */

void stream_spool_close(struct stream_out *o)
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

	THREAD_LOOP_ONLY();
	for (at = &o->conn->streams; *at != o; at = &(*at)->next)
		;
	*at = o->next;
	if (o->conn->closed)
		o->conn->server->reap = true;
	sd_event_source_disable_unref(o->io);
	io_close(o->fd);
	stream_spool_close(o);
	free(o->view);
	free(o->wkt);
	free(o->changes);
	ledger_give(o->conn->server->p.ledger, LEDGER_PIPE, sizeof *o + o->view_bytes);
	free(o);
}

static void on_output_gone(struct run_output *output)
{
	stream_free(stream_of(output));
}

/* The reader closed the pipe, or must not get more. */
void stream_drop(struct stream_out *o)
{
	THREAD_LOOP_ONLY();
	if (o->gone)
		return;
	o->gone = true;
	o->io = sd_event_source_disable_unref(o->io);
	o->fd = io_close(o->fd);
	if (o->ended)
		stream_free(o);
	else
		run_output_close(&o->output, on_output_gone);
}

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
	/* A larger pipe saves wake-ups. Users have a limit on larger pipes; beyond it the pipe stays small. */
	fcntl(ends[1], F_SETPIPE_SZ, PIPE_SIZE);
	r = sd_event_add_io(c->server->p.event, &o->io, ends[1], 0, stream_on_pipe, o);
	if (r < 0) {
		err_sys(err, -r, "cannot watch a pipe");
		close(ends[0]);
		close(ends[1]);
		free(o);
		return NULL;
	}
	sd_event_source_set_priority(o->io, FAIR_STREAMS);
	o->output.calls = &stream_run_calls;
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

	THREAD_LOOP_ONLY();
	for (const struct stream_out *other = c->streams; other; other = other->next)
		n++;
	if (n >= CONN_STREAMS_MAX) {
		err_set(err, ERR_BUSY, "%d streams of this connection are open already", CONN_STREAMS_MAX);
		return NULL;
	}
	/* A quarter of the memory of streams is kept for blocks that were spooled: reading them back must never wait for
	 * memory. */
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

void stream_out_asks(struct stream_out *o, bool system, bool lines)
{
	o->system = system;
	o->lines = lines;
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
	THREAD_LOOP_ONLY();
	o->output.window = window;
	job_fetch(job, &o->output);
}

void stream_out_leave(struct conn *c)
{
	struct stream_out *o, *next;

	for (o = c->streams; o; o = next) {
		next = o->next;
		stream_drop(o);
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
	/* A client that is disconnected takes its streams with it. */
	for (o = c->streams; !c->closed && o; o = c->closed ? NULL : o->next)
		if (!o->gone && !o->ended && m.job.id == o->job && !m.job.final)
			conn_send(c, o->request, FRAME_MESSAGE(PROGRESS, progress, &m.progress), -1);
}
