/* ping: a sign of life from the daemon, and how long it took. */
#include "ctl.h"

int ctl_ping_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct term_json j = {.out = session->console.report};
	double seconds;
	int status = session_connect(session);

	if (status)
		return status;
	if (acut_ping(session->acut, &seconds))
		return session_error_acut(session);
	if (session->console.json) {
		term_json_open(&j, NULL, '{');
		term_json_text(&j, "build", acut_daemon_build(session->acut));
		term_json_number(&j, "seconds", seconds);
		term_json_end(&j);
	} else {
		console_line(&session->console, "acutd %s answered in %.3f ms", acut_daemon_build(session->acut), 1e3 * seconds);
	}
	return SESSION_DONE;
}
