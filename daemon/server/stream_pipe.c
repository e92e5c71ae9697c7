/*
 * Writing a stream into its pipe.
 *
 * The model: frames are written in order: head, changes, block, tail. The pipe does not block. If it is full, the loop waits
 * until it is writable. A block that was spooled is written from a buffer, which a worker refills.
 */
#include <errno.h>
#include <sys/epoll.h>
#include <sys/uio.h>

#include "clock.h"
#include "stream_priv.h"

void stream_wait_writable(struct stream_out *o, bool wait)
{
	if (wait && !o->blocked_ns)
		o->blocked_ns = clock_mono_ns();
	sd_event_source_set_io_events(o->io, wait ? EPOLLOUT : 0);
}

enum write_result {
	WRITE_OK,
	WRITE_FULL,   /* the pipe is full */
	WRITE_CLOSED, /* there is no reader */
	WRITE_REFILL, /* a worker must refill the buffer */
	WRITE_BLOCK,  /* the block is written; the run gives the next one, or the end */
};

static enum write_result write_bytes(struct stream_out *o, const struct iovec *iov, int n, size_t *ret_done)
{
	ssize_t done = writev(o->fd, iov, n);

	*ret_done = 0;
	if (done < 0 && errno == EINTR)
		return WRITE_OK;
	if (done < 0)
		return errno == EAGAIN ? WRITE_FULL : WRITE_CLOSED;
	o->blocked_ns = 0;
	*ret_done = (size_t)done;
	return WRITE_OK;
}

static enum write_result write_frame(struct stream_out *o, struct out_frame *f)
{
	while (f->at < f->n) {
		struct iovec iov[STREAM_PIECES];
		size_t done;
		enum write_result r;
		int n = 0;

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
	return WRITE_OK;
}

static enum write_result write_spooled(struct stream_out *o)
{
	while (o->written < o->buffered) {
		struct iovec iov = {o->buffer + o->written, o->buffered - o->written};
		size_t done;
		enum write_result r = write_bytes(o, &iov, 1, &done);

		if (r)
			return r;
		o->written += done;
	}
	return o->spool_at < o->spool_size ? WRITE_REFILL : WRITE_OK;
}

static enum write_result write_changes(struct stream_out *o)
{
	enum write_result r = WRITE_OK;

	while (o->changes && r == WRITE_OK) {
		r = write_frame(o, &o->changes->frame);
		if (r == WRITE_OK)
			o->changes = out_changes_next(o->changes);
	}
	return r;
}

static enum write_result write_ready_frames(struct stream_out *o)
{
	for (int i = 0; i < STREAM_FRAMES; i++) {
		struct out_frame *f = &o->frame[i];
		enum write_result r = i == STREAM_FRAME_CHANGES ? write_changes(o) : WRITE_OK;

		if (r == WRITE_OK && f->ready)
			r = i == STREAM_FRAME_BLOCK && o->spool >= 0 ? write_spooled(o) : write_frame(o, f);
		if (r != WRITE_OK)
			return r;
		if (f->ready && i == STREAM_FRAME_BLOCK) {
			f->ready = false;
			return WRITE_BLOCK;
		}
		f->ready = false;
	}
	return WRITE_OK;
}

void stream_pump(struct stream_out *o)
{
	enum write_result r;

	THREAD_LOOP_ONLY();
	if (o->gone || o->paused)
		return;
	r = write_ready_frames(o);
	if (r == WRITE_CLOSED || (r == WRITE_OK && o->ended)) {
		stream_drop(o);
		return;
	}
	stream_wait_writable(o, r == WRITE_FULL);
	if (r == WRITE_REFILL) {
		run_output_drained(&o->output);
	} else if (r == WRITE_BLOCK) {
		stream_spool_close(o);
		run_output_sent(&o->output);
	}
}

int stream_on_pipe(sd_event_source *source, int fd, uint32_t events, void *ctx)
{
	struct stream_out *o = ctx;

	if (events & (EPOLLERR | EPOLLHUP)) {
		if (o->paused) {
			/* A worker has the block: stream_pump finds out when it is back. */
			sd_event_source_set_enabled(o->io, SD_EVENT_OFF);
			return 0;
		}
		stream_drop(o);
	} else {
		stream_pump(o);
	}
	return 0;
}
