/* rm: forgets jobs that are over. */
#include "ctl.h"

static int rm(struct ctl *ctl, uint64_t id)
{
	struct ctl_json j = {.out = ctl->report};

	if (acut_job_remove(ctl->acut, id))
		return ctl_error_acut(ctl);
	if (ctl->args.json) {
		ctl_json_open(&j, NULL, '{');
		ctl_json_u64(&j, "job", id);
		ctl_json_bool(&j, "removed", true);
		ctl_json_close(&j, '}');
		ctl_json_line(&j);
	}
	return CTL_DONE;
}

int ctl_rm_run(struct ctl *ctl)
{
	return ctl_job_each(ctl, rm);
}
