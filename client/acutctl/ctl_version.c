/* version: of acutctl; asks no daemon. */
#include "ctl.h"

int ctl_version_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct term_json j = {.out = session->console.report};

	if (session->console.json) {
		term_json_open(&j, NULL, '{');
		term_json_text(&j, "version", ACUT_VERSION);
		term_json_end(&j);
	} else {
		fprintf(session->console.report, "acutctl %s\n", ACUT_VERSION);
	}
	return SESSION_DONE;
}
