/*
 * Inputs that are pipes: standard input and named pipes. The daemon makes a pipe for each, and a process copies into it, so
 * that calls can wait for answers meanwhile. If the process cannot read its input to the end, the push must fail: the part
 * that came could look complete.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "ctl_input_priv.h"
#include "io.h"

enum { PIECE = 256 << 10, PIPE = 1 << 20, HEAD = 4096 };

/* From pipe to pipe the kernel moves pages. 0: the end, or the daemon has closed its; ENOSYS: not from here. */
static int move(int from, int to)
{
	struct pollfd wait = {.fd = from, .events = POLLIN};

	fcntl(from, F_SETPIPE_SZ, PIPE); /* to no avail: smaller pieces */
	for (bool any = false;;) {
		ssize_t n;

		poll(&wait, 1, -1);
		n = splice(from, NULL, to, NULL, PIPE, 0);
		if (n > 0)
			any = true;
		else if (n == 0 || errno == EPIPE)
			return any || n < 0 ? 0 : ENOSYS;
		else if (errno != EINTR && errno != EAGAIN)
			return any ? errno : ENOSYS;
	}
}

/* Exit status: 0, or the errno of the reading. If the daemon closed its end, its answer has the reason. */
static int copy(int from, int to, void *piece)
{
	struct pollfd wait = {.fd = from, .events = POLLIN};

	for (;;) {
		ssize_t n, done = 0;

		/* a named pipe without a writer yet looks ended to a read, not to a poll */
		poll(&wait, 1, -1);
		n = read(from, piece, PIECE);
		if (n < 0 && (errno == EINTR || errno == EAGAIN))
			continue;
		if (n <= 0)
			return n < 0 ? errno : 0;
		while (done < n) {
			ssize_t k = write(to, (char *)piece + done, (size_t)(n - done));

			if (k < 0 && errno != EINTR)
				return 0;
			done += k > 0 ? k : 0;
		}
	}
}

static void child(const struct ctl_input *in, int to, pid_t parent)
{
	static const int list[] = {SIGINT, SIGTERM, SIGHUP, SIGPIPE};
	void *piece = malloc(PIECE);
	int from = in->fd;

	for (unsigned i = 0; i < 4; i++)
		signal(list[i], SIG_DFL);
	prctl(PR_SET_PDEATHSIG, SIGKILL);
	if (getppid() != parent || !piece)
		_exit(ENOMEM);
	if (in->nhead && write(to, in->head, in->nhead) != (ssize_t)in->nhead)
		_exit(0); /* the daemon has closed its end, and its answer has the reason */
	int r = move(from, to);

	_exit((r == ENOSYS ? copy(from, to, piece) : r) & 0xff);
}

int ctl_pipe_peek(struct ctl_inputs *inputs, struct ctl_input *in, struct err *err)
{
	struct pollfd from = {.fd = in->fd, .events = POLLIN};
	ssize_t n = 1;

	in->head = malloc(HEAD);
	if (!in->head)
		return err_set(err, ERR_NOMEM, "no memory to read a pipe");
	while (n && in->nhead < 4) {
		if (session_interrupted(inputs->session))
			return err_set(err, ERR_CANCELLED, "interrupted");
		if (poll(&from, 1, 100) <= 0)
			continue;
		n = read(in->fd, in->head + in->nhead, HEAD - in->nhead);
		if (n < 0 && errno != EINTR && errno != EAGAIN) {
			err_sys(err, errno, "it cannot be read");
			return err_add_file(err, in->name);
		}
		in->nhead += n > 0 ? (unsigned)n : 0;
	}
	return 0;
}

/* A text up to its last complete line; a part of one could look wrong. */
static size_t whole_lines(const struct ctl_input *in)
{
	const uint8_t *end = in->nhead == HEAD ? memrchr(in->head, '\n', in->nhead) : NULL;

	return end ? (size_t)(end + 1 - in->head) : in->nhead;
}

int ctl_pipe_check(struct ctl_inputs *inputs, const struct ctl_input *in, struct err *err)
{
	const struct acut_probe *probe;
	struct err why = ERR_INIT;
	int fd = memfd_create("head", MFD_CLOEXEC);

	if (fd < 0 || io_write_at(fd, in->head, whole_lines(in), 0, in->name, &why) ||
	    (!inputs->session->acut && session_connect_try(inputs->session, &why))) {
		io_close(fd);
		return 0;
	}
	if (acut_info(inputs->session->acut, fd, in->name, NULL, inputs->opt->columns, &probe))
		session_failure(inputs->session, in->name, &why);
	close(fd);
	if (why.code != ERR_INPUT)
		return 0;
	*err = why;
	return -(int)err->code;
}

int ctl_input_start_pipe(struct ctl_inputs *inputs, struct ctl_input *in, struct acut_push *push)
{
	struct err err = ERR_INIT;
	pid_t self = getpid();
	int to;

	if (acut_push_stream(push, in->name, &to))
		return session_error_acut(inputs->session);
	fflush(NULL);
	in->copier = fork();
	if (in->copier == 0)
		child(in, to, self);
	close(to);
	if (in->copier > 0)
		return 0;
	err_sys(&err, errno, "no process to copy %s", in->name);
	return session_error(inputs->session, &err);
}

int ctl_input_finish_pipe(struct ctl_input *in, struct err *err)
{
	int status = 0;

	if (in->copier <= 0)
		return 0;
	while (waitpid(in->copier, &status, 0) < 0 && errno == EINTR)
		;
	in->copier = 0;
	if (WIFEXITED(status) && !WEXITSTATUS(status))
		return 0;
	/* The daemon has all that it wanted, and closed its end. */
	if (WIFSIGNALED(status) && WTERMSIG(status) == SIGPIPE)
		return 0;
	if (WIFEXITED(status))
		err_sys(err, WEXITSTATUS(status), "it cannot be read");
	else
		err_set(err, ERR_IO, "the process that read it was ended by signal %d", WTERMSIG(status));
	return err_add_file(err, in->name);
}

/* ---- kept here, for commands that only inspect an input ---- */

static int keep(struct session *session, const struct ctl_input *in, int to, struct err *err)
{
	struct pollfd from = {.fd = in->fd, .events = POLLIN};
	char *piece = malloc(PIECE);
	uint64_t at = in->nhead;
	ssize_t n = 1;

	if (!piece)
		err_set(err, ERR_NOMEM, "no memory to read a pipe");
	else
		io_write_at(to, in->head, in->nhead, 0, "a temporary file", err);
	while (n && !err->code) {
		if (session_interrupted(session)) {
			err_set(err, ERR_CANCELLED, "interrupted");
		} else if (poll(&from, 1, 100) > 0) {
			n = read(in->fd, piece, PIECE);
			if (n < 0 && errno != EINTR && errno != EAGAIN)
				err_sys(err, errno, "it cannot be read");
			else if (n > 0 && !io_write_at(to, piece, (size_t)n, at, "a temporary file", err))
				at += (uint64_t)n;
		}
	}
	free(piece);
	return -(int)err->code;
}

int ctl_input_keep_pipe(struct ctl_inputs *inputs, const struct ctl_input *in, int *ret_fd, struct err *err)
{
	const char *folder;
	int fd;

	if (ctl_temp_open(&folder, &fd, err))
		return err_add_file(err, in->name);
	if (keep(inputs->session, in, fd, err)) {
		close(fd);
		return err_add_file(err, in->name);
	}
	*ret_fd = fd;
	return 0;
}

void ctl_pipe_stop(struct ctl_input *in)
{
	if (in->copier > 0) {
		kill(in->copier, SIGKILL);
		while (waitpid(in->copier, NULL, 0) < 0 && errno == EINTR)
			;
	}
	in->copier = 0;
}
