/*
 * acutctl: reads the command line, runs one command, and sees to it that whatever happened, the daemon of its
 * own ends, standard output was taken, and the exit status tells the truth.
 */
#include <errno.h>
#include <malloc.h>
#include <stdlib.h>
#include <string.h>

#include "ctl.h"
#include "io.h"

/* Results that nobody could read are not done. */
static int flush(struct ctl *ctl, int status)
{
	struct err err = ERR_INIT;

	errno = 0;
	if (fflush(stdout) || ferror(stdout)) {
		if (errno == EPIPE || (!errno && ctl_signal_reader_gone())) /* an earlier write's error is forgotten by now */
			return CTL_PIPE;
		err_sys(&err, errno ? errno : EIO, "standard output cannot be written");
		ctl->report = stderr;
		return status ? status : ctl_error(ctl, &err);
	}
	return ctl->out_closed ? CTL_PIPE : status;
}

/* Words of a command line that is being typed are not options of this one. */
static bool completing(int argc, char **argv, struct ctl *ctl)
{
	if (argc < 3 || strcmp(argv[1], "complete"))
		return false;
	ctl->args.word = calloc((size_t)argc, sizeof(char *));
	ctl->command = ctl_command_find(argv[1]);
	for (int i = 2; i < argc && ctl->args.word; i++)
		ctl->args.word[ctl->args.nword++] = argv[i];
	return ctl->args.nword > 0;
}

int main(int argc, char **argv)
{
	struct ctl ctl = {.report = stdout};
	struct err err = ERR_INIT;
	int status;

	io_reserve_standard();
	/* Messages come and go by the thousand: the heap does not give back each at once. */
	mallopt(M_TRIM_THRESHOLD, 4 << 20);
	mallopt(M_TOP_PAD, 256 << 10);
	ctl_signal_init(&ctl);
	status = completing(argc, argv, &ctl) ? 0 : ctl_option_parse(argc, argv, &ctl, &err);
	for (unsigned i = 0; i < ctl.args.nout; i++)
		if (!strcmp(ctl.args.out[i], "-")) {
			ctl.report = stderr;
			ctl.for_reader = ctl.args.nout == 1;
		}
	if (status)
		status = ctl_error(&ctl, &err);
	else if (ctl.args.help)
		status = ctl_help_run(&ctl);
	else
		status = ctl.command->run(&ctl);
	ctl_refusals_end(&ctl, status);
	ctl_disconnect(&ctl);
	status = flush(&ctl, status);
	for (size_t i = 0; i < ctl.nwarning; i++)
		free(ctl.warning[i]);
	free(ctl.warning);
	free(ctl.args.word);
	return status;
}
