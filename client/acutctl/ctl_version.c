/* version: of acutctl; asks no daemon. */
#include "ctl.h"

int ctl_version_run(struct ctl *ctl)
{
	struct ctl_json j = {.out = ctl->report};

	if (ctl->args.json) {
		ctl_json_open(&j, NULL, '{');
		ctl_json_text(&j, "version", ACUT_VERSION);
		ctl_json_close(&j, '}');
		ctl_json_line(&j);
	} else {
		fprintf(ctl->report, "acutctl %s\n", ACUT_VERSION);
	}
	return CTL_DONE;
}
