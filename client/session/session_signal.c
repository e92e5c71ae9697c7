/*
 * Signals and the deadline. A handler only records the signal; loops that wait check it about ten times a second and end in
 * good order, so no temporary file and no job is left behind.
 */
#include <signal.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "session.h"

static volatile sig_atomic_t caught;

static void note(int sig)
{
	caught = sig;
}

void session_begin(struct session *session)
{
	static const int list[] = {SIGINT, SIGTERM, SIGHUP};
	struct sigaction sa;

	memset(&sa, 0, sizeof(sa));
	sigemptyset(&sa.sa_mask);
	for (unsigned i = 0; i < 3; i++) {
		struct sigaction was;

		/* what was ignored when we were started stays ignored (nohup, background) */
		if (!sigaction(list[i], NULL, &was) && was.sa_handler == SIG_IGN)
			continue;
		sa.sa_handler = note;
		sigaction(list[i], &sa, NULL);
	}
	sa.sa_handler = SIG_IGN;
	sigaction(SIGPIPE, &sa, NULL);
	sigaction(SIGXFSZ, &sa, NULL);
	session->begun_ns = clock_mono_ns();
}

int session_caught(void)
{
	return caught;
}

bool session_late(const struct session *session)
{
	return session->opt.timeout > 0 && clock_since(session->begun_ns) >= session->opt.timeout;
}

bool session_cut_off(struct session *session)
{
	struct stat st;
	bool other, gone;

	if (fstat(STDIN_FILENO, &st))
		return false;
	if (S_ISSOCK(st.st_mode))
		return console_is_gone(STDIN_FILENO, 0, &other);
	if (!S_ISFIFO(st.st_mode) || !console_is_gone(STDOUT_FILENO, 0, &other))
		return false;
	/* sshd closes standard output, input and error in this order, and other programs may run between. Where only standard
	 * output was closed, by somebody else, this costs the time. */
	gone = false;
	for (int i = 0; i < 50 && !gone && !session_interrupted(session); i++)
		gone = console_is_gone(STDERR_FILENO, 100, &other) || other;
	return gone;
}

int session_interrupted(void *ctx)
{
	struct session *session = ctx;

	if (session->for_reader && !session->out_closed && console_reader_gone())
		session->out_closed = true;
	return caught || session_late(session) || (session->for_reader && session->out_closed);
}
