/* acut-cluster: reads the command line and runs one command. */
#include <string.h>

#include "cluster.h"
#include "io.h"

int main(int argc, char **argv)
{
	const struct cli cli = cluster_cli();
	struct program p = {.session.console = {.program = "acut-cluster", .report = stdout}, .argc = argc, .argv = argv};
	struct err err = ERR_INIT;
	int status;

	io_reserve_standard();
	session_begin(&p.session);
	if (argc >= 3 && !strcmp(argv[1], "complete"))
		return cli_complete(&cli, argc, argv, &p, cluster_offer);
	status = cli_parse(&cli, argc, argv, &p, &p.line, &err);
	if (!status)
		status = cli_run(&cli, &p.line, &p, stdout, &err);
	if (status < 0)
		status = session_error(&p.session, &err);
	cli_done(&p.line);
	return console_end(&p.session.console, status);
}
