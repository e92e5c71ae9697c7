/* cancel: ends jobs that are not done. */
#include "ctl.h"

static int cancel(struct program *ctl, uint64_t id)
{
	const struct acut_job *job;

	if (acut_job_cancel(ctl->session.acut, id, &job))
		return session_error_acut(&ctl->session);
	if (!ctl->session.console.quiet || ctl->session.console.json)
		ctl_job_print(ctl, job);
	return SESSION_DONE;
}

int ctl_cancel_run(struct program *ctl)
{
	return ctl_job_each(ctl, cancel);
}
