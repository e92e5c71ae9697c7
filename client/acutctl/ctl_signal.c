/*
 * Signals and the deadline. A handler only notes the signal; whoever waits asks about ten times a second and
 * ends in good order, so that no temporary file and no job of ours stays behind.
 */
#include <signal.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "ctl.h"

static volatile sig_atomic_t caught;

static void note(int sig)
{
	caught = sig;
}

void ctl_signal_init(struct program *ctl)
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
}

int ctl_signal_caught(void)
{
	return caught;
}

bool ctl_signal_late(const struct program *ctl)
{
	return ctl->deadline_ns && clock_mono_ns() >= ctl->deadline_ns;
}

bool ctl_signal_cut_off(void)
{
	struct stat st;
	bool other, gone;

	if (fstat(STDIN_FILENO, &st))
		return false;
	if (S_ISSOCK(st.st_mode))
		return console_is_gone(STDIN_FILENO, &other);
	gone = S_ISFIFO(st.st_mode) && console_is_gone(STDOUT_FILENO, &other);
	return gone && (console_is_gone(STDERR_FILENO, &other) || other);
}

int ctl_signal_interrupted(void *ctx)
{
	struct program *ctl = ctx;

	if (ctl->for_reader && !ctl->out_closed && console_reader_gone())
		ctl->out_closed = true;
	return caught || ctl_signal_late(ctl) || (ctl->for_reader && ctl->out_closed);
}
