/* ping: a sign of life from the daemon, and how long it took. */
#include "ctl.h"

int ctl_ping_run(struct ctl *ctl)
{
	struct ctl_json j = {.out = ctl->report};
	double seconds;
	int status = ctl_connect(ctl);

	if (status)
		return status;
	if (acut_ping(ctl->acut, &seconds))
		return ctl_error_acut(ctl);
	if (ctl->args.json) {
		ctl_json_open(&j, NULL, '{');
		ctl_json_text(&j, "build", acut_daemon_build(ctl->acut));
		ctl_json_number(&j, "seconds", seconds);
		ctl_json_close(&j, '}');
		ctl_json_line(&j);
	} else {
		ctl_note(ctl, "acutd %s answered in %.3f ms", acut_daemon_build(ctl->acut), 1e3 * seconds);
	}
	return CTL_DONE;
}
