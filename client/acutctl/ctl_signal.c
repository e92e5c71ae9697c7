/*
 * Signals and the deadline. A handler only notes the signal; whoever waits asks about ten times a second and
 * ends in good order, so that no temporary file and no job of ours stays behind.
 */
#include <signal.h>
#include <string.h>

#include "clock.h"
#include "ctl.h"

static volatile sig_atomic_t caught;

static void note(int sig)
{
	caught = sig;
}

void ctl_signal_init(struct ctl *ctl)
{
	static const int list[] = { SIGINT, SIGTERM, SIGHUP };
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

bool ctl_signal_late(const struct ctl *ctl)
{
	return ctl->deadline_ns && clock_mono_ns() >= ctl->deadline_ns;
}

int ctl_signal_interrupted(void *ctx)
{
	return caught || ctl_signal_late(ctx);
}
