/* wait: until each of the jobs is over. The first status, in the order of the arguments, that is not 0. */
#include "ctl.h"

static int wait_one(struct session *session, uint64_t id)
{
	struct session_progress progress;
	const struct acut_job *job;

	session_progress_init(&progress, session);
	if (acut_job_wait(session->acut, id, true, session_progress_job, &progress, &job))
		return session_error_acut(session);
	console_progress_clear(&session->console);
	if (!session->console.quiet || session->console.json)
		ctl_report_job(&session->console, job);
	if (session->console.json)
		return job->has_error ? job->error.exit_status : SESSION_DONE;
	if (job->has_report)
		ctl_report_warn_crowded(&session->console, &job->report);
	return ctl_report_job_status(session, job);
}

int ctl_wait_run(struct program *ctl)
{
	ctl->session.for_reader = true;
	return ctl_job_each(ctl, wait_one);
}
