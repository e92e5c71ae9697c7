/* version: of acutctl; asks no daemon. */
#include "ctl.h"

int ctl_version_run(struct program *ctl)
{
	struct term_json j = {.out = ctl->session.console.report};

	if (ctl->session.console.json) {
		term_json_open(&j, NULL, '{');
		term_json_text(&j, "version", ACUT_VERSION);
		term_json_close(&j, '}');
		term_json_line(&j);
	} else {
		fprintf(ctl->session.console.report, "acutctl %s\n", ACUT_VERSION);
	}
	return SESSION_DONE;
}
