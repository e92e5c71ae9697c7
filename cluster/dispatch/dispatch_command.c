/*
 * Runs a command of a scheduler: argv, a text for its standard input, what it prints. Its own process group, so that an interrupt
 * of the terminal does not end a submission halfway.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "clock.h"
#include "dispatch_priv.h"
#include "err.h"

enum { NO_PROGRAM = 127, OUT_MOST = 256 << 20 };

struct stream {
	int fd;
	char *at;
	size_t n, room;
};

struct call {
	pid_t pid;
	int in;
	const char *input;
	size_t left;
	struct stream out, err;
};

static void close_if(int *fd)
{
	if (*fd >= 0)
		close(*fd);
	*fd = -1;
}

/* What the child does; it does not come back. */
static void become(const char *const *argv, int in, int out, int err)
{
	sigset_t none;

	sigemptyset(&none);
	sigprocmask(SIG_SETMASK, &none, NULL);
	signal(SIGPIPE, SIG_DFL);
	signal(SIGINT, SIG_DFL);
	signal(SIGTERM, SIG_DFL);
	setpgid(0, 0);
	dup2(in, 0);
	dup2(out, 1);
	dup2(err, 2);
	execvp(argv[0], (char *const *)argv);
	_exit(NO_PROGRAM);
}

static int begin(const char *const *argv, const char *input, struct call *c, struct err *err)
{
	int pipes[3][2] = {{-1, -1}, {-1, -1}, {-1, -1}}, sys = 0;

	for (int i = 0; i < 3 && !sys; i++)
		sys = pipe2(pipes[i], O_CLOEXEC) ? errno : 0;
	c->pid = sys ? -1 : fork();
	if (c->pid == 0)
		become(argv, pipes[0][0], pipes[1][1], pipes[2][1]);
	if (c->pid < 0 && !sys)
		sys = errno;
	close_if(&pipes[0][0]);
	close_if(&pipes[1][1]);
	close_if(&pipes[2][1]);
	c->in = pipes[0][1];
	c->out.fd = pipes[1][0];
	c->err.fd = pipes[2][0];
	c->input = input ? input : "";
	c->left = strlen(c->input);
	if (sys) {
		close_if(&c->in);
		close_if(&c->out.fd);
		close_if(&c->err.fd);
		return err_sys(err, sys, "%s cannot be started", argv[0]);
	}
	if (!c->left)
		close_if(&c->in);
	else
		fcntl(c->in, F_SETFL, O_NONBLOCK);
	return 0;
}

/* False: no memory. */
static bool take(struct stream *s)
{
	ssize_t n;

	if (s->room - s->n < 4097) {
		size_t room = s->room ? 2 * s->room : 8192;
		char *at = room > OUT_MOST ? NULL : realloc(s->at, room);

		if (!at)
			return false;
		s->at = at;
		s->room = room;
	}
	n = read(s->fd, s->at + s->n, s->room - s->n - 1);
	if (n > 0)
		s->n += (size_t)n;
	else if (n == 0 || errno != EINTR)
		close_if(&s->fd);
	s->at[s->n] = 0;
	return true;
}

static void give(struct call *c)
{
	ssize_t n = write(c->in, c->input, c->left);

	if (n > 0) {
		c->input += n;
		c->left -= (size_t)n;
	}
	if (!c->left || (n < 0 && errno != EAGAIN && errno != EINTR))
		close_if(&c->in);
}

/* Until both of its outputs are closed. */
static int talk(struct call *c, const char *name, double seconds, struct err *err)
{
	const uint64_t from = clock_mono_ns();

	while (c->out.fd >= 0 || c->err.fd >= 0) {
		struct pollfd p[3] = {{c->out.fd, POLLIN, 0}, {c->err.fd, POLLIN, 0}, {c->in, POLLOUT, 0}};

		if (clock_since(from) > seconds) {
			kill(-c->pid, SIGKILL);
			return err_set(err, ERR_BUSY, "%s has not answered for %.0f s", name, seconds);
		}
		if (poll(p, 3, 1000) <= 0)
			continue;
		if ((p[0].revents && !take(&c->out)) || (p[1].revents && !take(&c->err))) {
			kill(-c->pid, SIGKILL);
			return err_set(err, ERR_NOMEM, "no memory for what %s prints", name);
		}
		if (p[2].revents)
			give(c);
	}
	return 0;
}

static int judge(int status, const char *name, char *said, struct err *err)
{
	size_t n = said ? strlen(said) : 0;

	while (n && (said[n - 1] == '\n' || said[n - 1] == ' '))
		said[--n] = 0;
	if (WIFEXITED(status) && !WEXITSTATUS(status))
		return 0;
	if (WIFEXITED(status) && WEXITSTATUS(status) == NO_PROGRAM && !n)
		return err_set(err, ERR_NODAEMON, "there is no program %s here", name);
	if (WIFSIGNALED(status))
		return err_set(err, ERR_IO, "%s was killed by signal %d", name, WTERMSIG(status));
	return err_set(err, ERR_IO, "%s failed with status %d: %s", name, WEXITSTATUS(status), n ? said : "it says nothing");
}

int dispatch_command(const char *const *argv, const char *input, double seconds, char **ret_out, struct err *err)
{
	struct sigaction ignore = {.sa_handler = SIG_IGN}, before;
	struct call c = {0};
	int status = 0, r;

	sigaction(SIGPIPE, &ignore, &before);
	r = begin(argv, input, &c, err);
	if (!r) {
		r = talk(&c, argv[0], seconds, err);
		close_if(&c.in);
		close_if(&c.out.fd);
		close_if(&c.err.fd);
		while (waitpid(c.pid, &status, 0) < 0 && errno == EINTR)
			;
		if (!r)
			r = judge(status, argv[0], c.err.at, err);
	}
	sigaction(SIGPIPE, &before, NULL);
	free(c.err.at);
	if (r || !ret_out)
		free(c.out.at);
	else
		*ret_out = c.out.at ? c.out.at : strdup("");
	if (!r && ret_out && !*ret_out)
		return err_set(err, ERR_NOMEM, "no memory for what %s prints", argv[0]);
	return r;
}
