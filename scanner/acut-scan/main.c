/* acut-scan: reads the command line, runs one command, and sees to it that standard output was taken. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "io.h"
#include "scan.h"

enum { PIPE = 141 };

/* Results that nobody could read are not done. */
static int flush(const struct scan_args *args, int status)
{
	struct err err = ERR_INIT;

	errno = 0;
	if (!fflush(stdout) && !ferror(stdout))
		return status;
	if (errno == EPIPE)
		return status ? status : PIPE;
	err_sys(&err, errno ? errno : EIO, "standard output cannot be written");
	return status ? status : scan_fail(args, &err);
}

int main(int argc, char **argv)
{
	const struct scan_command *command = NULL;
	struct scan_args args;
	struct err err = ERR_INIT;
	const char **words;
	int status;

	io_reserve_standard();
	if (argc >= 3 && !strcmp(argv[1], "complete"))
		return scan_complete(argc, argv);
	scan_signal_init();
	words = calloc((size_t)argc + 1, sizeof(*words));
	if (!words)
		return err_exit_status(ERR_NOMEM);
	if (scan_option_parse(argc, argv, words, &args, &command, &err))
		status = scan_fail(&args, &err);
	else if (args.help)
		status = scan_help(&args);
	else
		status = command->run(&args);
	scan_progress_clear();
	status = flush(&args, status);
	free(words);
	return status;
}
