/* cancel: ends jobs that are not done. */
#include "ctl.h"

static int cancel(struct session *session, uint64_t id)
{
	const struct acut_job *job;

	if (acut_job_cancel(session->acut, id, &job))
		return session_error_acut(session);
	if (!session->console.quiet || session->console.json)
		ctl_report_job(&session->console, job);
	return SESSION_DONE;
}

int ctl_cancel_run(struct program *ctl)
{
	return ctl_job_each(ctl, cancel);
}
