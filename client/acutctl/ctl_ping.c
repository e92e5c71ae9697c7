/* ping: a sign of life from the daemon, and how long it took. */
#include "ctl.h"

int ctl_ping_run(struct program *ctl)
{
	struct term_json j = {.out = ctl->session.console.report};
	double seconds;
	int status = session_connect(&ctl->session);

	if (status)
		return status;
	if (acut_ping(ctl->session.acut, &seconds))
		return session_error_acut(&ctl->session);
	if (ctl->session.console.json) {
		term_json_open(&j, NULL, '{');
		term_json_text(&j, "build", acut_daemon_build(ctl->session.acut));
		term_json_number(&j, "seconds", seconds);
		term_json_close(&j, '}');
		term_json_line(&j);
	} else {
		console_line(&ctl->session.console, "acutd %s answered in %.3f ms", acut_daemon_build(ctl->session.acut),
			     1e3 * seconds);
	}
	return SESSION_DONE;
}
