/*
 * Signals that ask for an end. The handler notes the signal and makes a descriptor readable, for poll. It handles each signal
 * once: a second one has the kernel's action, for a user who does not want to wait for a good end. The spool is valid then,
 * as after a kill.
 */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "err.h"
#include "scan.h"

static _Atomic int caught; /* any thread may be the one that takes the signal */
static int stop_fd = -1;

static void note(int sig)
{
	static const uint64_t one = 1;
	int saved = errno;
	ssize_t n;

	caught = sig;
	n = write(stop_fd, &one, sizeof(one));
	(void)n; /* readable already */
	errno = saved;
}

void scan_signal_init(void)
{
	static const int list[] = {SIGINT, SIGTERM, SIGHUP};
	struct sigaction sa;

	stop_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	memset(&sa, 0, sizeof(sa));
	sigemptyset(&sa.sa_mask);
	sa.sa_flags = (int)SA_RESETHAND;
	for (unsigned i = 0; stop_fd >= 0 && i < 3; i++) {
		struct sigaction was;

		/* what was ignored when we were started stays ignored (nohup) */
		if (!sigaction(list[i], NULL, &was) && was.sa_handler == SIG_IGN)
			continue;
		sa.sa_handler = note;
		sigaction(list[i], &sa, NULL);
	}
	sa.sa_flags = 0;
	sa.sa_handler = SIG_IGN;
	sigaction(SIGPIPE, &sa, NULL);
	sigaction(SIGXFSZ, &sa, NULL);
}

bool scan_stopped(void)
{
	return caught != 0;
}

int scan_stop_fd(void)
{
	return stop_fd;
}

int scan_fail(struct program *args, const struct err *err)
{
	if (err->code != ERR_CANCELLED || !caught)
		return console_error(&args->console, err);
	console_progress_clear(&args->console);
	if (!args->console.quiet && !args->console.json)
		fputs("acut-scan: interrupted\n", stderr);
	return 128 + caught;
}
