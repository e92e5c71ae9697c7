/*
 * Inputs that come through a pipe: the head, which is in a file, then the bytes of the pipe, forwards.
 *
 * Model: the caller has written the first bytes of the pipe to a file, so that header and variable length records are read as
 * those of a file. Points are read as they come. If the pipe has no bytes now, the reader returns without points (input_dry) and
 * does not wait: a slow client must not block a worker.
 */
#include "input_reader.h"

#include <errno.h>
#include <unistd.h>

#include "io.h"

int input_pipe_read(struct input *in, uint64_t at, void *buf, size_t n, size_t *ret_n, struct err *err)
{
	ssize_t got;

	in->dry = false;
	if (at < in->head)
		return io_read_some(in->fd, buf, n < in->head - at ? n : (size_t)(in->head - at), at, in->name, ret_n, err);
	do {
		got = io->read(in->pipe, buf, n);
	} while (got < 0 && errno == EINTR);
	*ret_n = got > 0 ? (size_t)got : 0;
	if (got > 0 && in->pipe_seen)
		in->pipe_seen(in->pipe_ctx, buf, (size_t)got);
	if (got < 0 && errno == EAGAIN) {
		in->dry = true;
	} else if (got < 0) {
		err_sys(err, errno, "the pipe cannot be read");
		return err_add_file(err, in->name);
	}
	return 0;
}

bool input_dry(const struct input *in)
{
	return in->has_pipe && in->dry;
}
