/*
 * The callbacks of the run of a stream (struct run_output_calls).
 *
 * The model: the run hands over one block at a time, whose pieces point into the domain's memory. If the reader is too slow, the
 * run lets a worker write the rest of the block to a file (`paused` meanwhile: the loop does not touch the block). If an error
 * ends the stream within a block, no tail can follow: the error is sent over the socket, to the request of the Fetch, and then
 * the pipe is closed.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "io.h"
#include "ledger.h"
#include "mesh_stream.h"
#include "stream_priv.h"

static void text_copy(char *to, size_t size, const char *from)
{
	size_t n = strnlen(from, size - 1);

	memcpy(to, from, n);
	to[n] = 0;
}

/* Sends the error over the socket, before the pipe is closed. If the client is gone, the loop finds out later: nothing may be
 * closed here, since the run is iterating over its outputs. */
static void send_error(struct stream_out *o, const struct err *why)
{
	struct conn *c = o->conn;
	struct err err = ERR_INIT;

	if (c->closed || frame_conn_send_error(c->frame, o->request, why, &err))
		return;
	frame_conn_flush(c->frame, &err);
	conn_update_events(c);
}

/* A copy that the head points to. NULL: no memory. */
static char *keep_text(struct stream_out *o, const char *text)
{
	if (!ledger_take(o->conn->server->p.ledger, LEDGER_PIPE, strlen(text) + 1))
		return NULL;
	o->view_bytes += strlen(text) + 1;
	return strdup(text);
}

static void on_head(struct run_output *output, const struct run_head *in)
{
	struct stream_out *o = stream_of(output);
	struct out_frame *f = &o->frame[STREAM_FRAME_HEAD];
	struct stream_head head = {.kind = in->changes ? STREAM_CHANGES : in->window ? STREAM_AREA : STREAM_WHOLE, .id = in->id};
	struct err err = ERR_INIT;
	int r = in->changes ? out_changes_new(in->changes, o->conn->server->p.ledger, &o->view_bytes, &o->changes, &err) : 0;
	char lattice[LATTICE_TEXT_SIZE];

	text_copy(head.lattice, sizeof head.lattice, lattice_text(&in->manifest->lattice, lattice));
	text_copy(head.crs, sizeof head.crs, in->manifest->crs);
	text_copy(head.unit_xy, sizeof head.unit_xy, in->manifest->unit_xy);
	text_copy(head.unit_z, sizeof head.unit_z, in->manifest->unit_z);
	if (!r)
		o->view = keep_text(o, in->view);
	if (o->view && o->system)
		o->wkt = keep_text(o, in->wkt);
	if (!o->view || (o->system && !o->wkt)) {
		if (!r)
			err_set(&err, ERR_NOMEM, "no memory for the head of a stream");
		send_error(o, &err);
		stream_drop(o);
		return;
	}
	head.view = o->view;
	head.system = o->system;
	head.lines = o->lines && in->lines;
	head.bounded = o->lines && in->bounded;
	head.wkt = o->wkt;
	text_copy(head.geoid, sizeof head.geoid, in->geoid);
	frame_text_clean(head.geoid);
	memcpy(head.box, in->box, sizeof head.box);
	f->n = stream_put_head(&head, f->scratch, f->piece);
	f->at = 0;
	f->done = 0;
	f->ready = true;
	stream_pump(o);
}

/* Worker: the checksum takes time. */
static void on_encode(struct run_output *output, const struct mesh_block *b)
{
	struct stream_out *o = stream_of(output);
	struct out_frame *f = &o->frame[STREAM_FRAME_BLOCK];
	const struct stream_block block = mesh_stream_block(b);

	output->spooled = false;
	f->n = stream_put_block(&block, f->scratch, f->piece);
	f->at = 0;
	f->done = 0;
}

static void on_send(struct run_output *output)
{
	struct stream_out *o = stream_of(output);

	if (!o->paused) {
		o->frame[STREAM_FRAME_BLOCK].ready = true;
		o->blocks++;
	}
	o->paused = false;
	if (o->io)
		sd_event_source_set_enabled(o->io, SD_EVENT_ON);
	stream_pump(o);
}

static void on_pause(struct run_output *output)
{
	struct stream_out *o = stream_of(output);

	o->paused = true;
	stream_wait_writable(o, false);
}

static double on_stalled(struct run_output *output)
{
	struct stream_out *o = stream_of(output);

	return o->blocked_ns && !o->paused ? clock_since(o->blocked_ns) : 0;
}

static int on_spool(struct run_output *output, int dirfd, struct err *err)
{
	struct stream_out *o = stream_of(output);
	struct out_frame *f = &o->frame[STREAM_FRAME_BLOCK];
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

static int on_refill(struct run_output *output, struct err *err)
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
	struct err line = *why;

	/* A tail has no field for file and place, so they are put before the sentence. The hint has a field of its own. */
	line.hint[0] = 0;
	tail->failed = true;
	text_copy(tail->error_code, sizeof tail->error_code, err_wire_name(why->code));
	err_format(&line, tail->error_message, sizeof tail->error_message);
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

static void on_end(struct run_output *output, const struct err *why, const struct pipe_totals *totals,
		   const struct job_report *report)
{
	struct stream_out *o = stream_of(output);
	struct out_frame *f = &o->frame[STREAM_FRAME_TAIL];
	struct stream_tail tail = {0};

	o->ended = true;
	o->paused = false;
	if (o->frame[STREAM_FRAME_BLOCK].ready || o->gone) {
		/* Part of a block was sent, and the rest is gone. So no tail can follow. */
		if (why && !o->gone)
			send_error(o, why);
		stream_drop(o);
		return;
	}
	if (why)
		tail_error(&tail, why);
	else
		tail_totals(&tail, o, totals, report);
	if (why && !o->frame[STREAM_FRAME_HEAD].n) {
		/* A stream starts with its head, even if it failed before the grid was known. */
		struct stream_head head = {.kind = STREAM_WHOLE, .lattice = "1 1 0 0 0"};

		strcpy(head.crs, "unknown");
		strcpy(head.unit_xy, "unknown");
		strcpy(head.unit_z, "unknown");
		o->frame[STREAM_FRAME_HEAD].n =
			stream_put_head(&head, o->frame[STREAM_FRAME_HEAD].scratch, o->frame[STREAM_FRAME_HEAD].piece);
		o->frame[STREAM_FRAME_HEAD].ready = true;
	}
	f->n = stream_put_tail(&tail, f->scratch, f->piece);
	f->ready = true;
	stream_pump(o);
}

/* Sends what the job waits for, as progress of the Fetch. */
static void on_waits(struct run_output *output, const char *text)
{
	struct stream_out *o = stream_of(output);
	Acut__V1__Progress progress = ACUT__V1__PROGRESS__INIT;

	if (o->gone || o->ended)
		return;
	progress.phase = (char *)"mesh";
	progress.waiting = (char *)text;
	conn_send(o->conn, o->request, FRAME_MESSAGE(PROGRESS, progress, &progress), -1);
}

const struct run_output_calls stream_run_calls = {
	.waits = on_waits,
	.head = on_head,
	.send = on_send,
	.pause = on_pause,
	.stalled = on_stalled,
	.end = on_end,
	.encode = on_encode,
	.spool = on_spool,
	.refill = on_refill,
};
