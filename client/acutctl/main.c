/*
 * acutctl: reads the command line and runs one command. Whatever happens, a daemon of the command's own ends, standard output was
 * written, and the exit status is true.
 */
#include <malloc.h>
#include <string.h>

#include "ctl.h"
#include "io.h"

int main(int argc, char **argv)
{
	const struct cli cli = ctl_cli();
	struct program ctl = {.session.console = {.program = "acutctl", .report = stdout, .keeps_warnings = true}};
	const struct ctl_input_format *format;
	struct err err = ERR_INIT;
	int status;

	io_reserve_standard();
	/* Messages come and go by the thousand: the heap does not give back each at once. */
	mallopt(M_TRIM_THRESHOLD, 4 << 20);
	mallopt(M_TOP_PAD, 256 << 10);
	session_begin(&ctl.session);
	if (argc >= 3 && !strcmp(argv[1], "complete")) {
		status = ctl_complete(&cli, argc, argv, &ctl);
		session_disconnect(&ctl.session);
		return status;
	}
	status = cli_parse(&cli, argc, argv, &ctl, &ctl.line, &err);
	if (!status)
		status = session_check(&ctl.session, &err);
	if (ctl_fetch_to_standard(&ctl.fetch)) {
		ctl.session.console.report = stderr;
		ctl.session.for_reader = ctl_fetch_count(&ctl.fetch) == 1;
	}
	if (ctl.opt.weight_report && ctl_fetch_is_standard(ctl.opt.weight_report)) {
		ctl.opt.weight_report = "-";
		ctl.session.console.report = stderr;
	}
	if (ctl.input.format && (format = ctl_input_format_of(ctl.input.format)))
		ctl.input.format = format->name; /* laz is read as las */
	ctl.session.writes = ctl_fetch_count(&ctl.fetch) > 0;
	ctl.session.starts = ctl.line.command && ctl.line.command->groups & CTL_OWN;
	if (!status)
		status = cli_run(&cli, &ctl.line, &ctl, stdout, &err);
	if (status < 0)
		status = session_error(&ctl.session, &err);
	session_refusals_end(&ctl.session, status);
	session_disconnect(&ctl.session);
	cli_done(&ctl.line);
	return console_end(&ctl.session.console, ctl.session.out_closed ? CONSOLE_PIPE : status);
}
