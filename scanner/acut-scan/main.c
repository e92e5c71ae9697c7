/* acut-scan: reads the command line, runs one command, and sees to it that standard output was written. */
#include <string.h>

#include "err.h"
#include "io.h"
#include "scan.h"

int main(int argc, char **argv)
{
	const struct cli cli = scan_cli();
	struct program args = {.console = {.program = "acut-scan", .report = stdout}, .sync_s = 1, .pose_clock = "utc"};
	struct err err = ERR_INIT;
	int status;

	io_reserve_standard();
	if (argc >= 3 && !strcmp(argv[1], "complete"))
		return cli_complete(&cli, argc, argv, &args, scan_offer);
	scan_signal_init();
	/* An error is printed as JSON if --json is among the arguments, even if others are wrong. */
	for (int i = 1; i < argc && strcmp(argv[i], "--"); i++)
		args.console.json |= !strcmp(argv[i], "--json");
	status = cli_parse(&cli, argc, argv, &args, &args.line, &err);
	if (args.output && !strcmp(args.output, "-"))
		args.console.report = stderr;
	if (!status)
		status = cli_run(&cli, &args.line, &args, stdout, &err);
	if (status < 0)
		status = scan_fail(&args, &err);
	cli_done(&args.line);
	return console_end(&args.console, status);
}
