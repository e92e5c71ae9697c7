/* wait: until each of the jobs is over; ends with the first status, in the order of the arguments, that is
 * not 0. */
#include "ctl.h"

static void changed(void *ctx, const struct acut_job *job)
{
	if (!job->final)
		session_progress_show(ctx, &job->progress);
}

static int wait_one(struct program *ctl, uint64_t id)
{
	struct session_progress progress;
	const struct acut_job *job;

	session_progress_init(&progress, &ctl->session);
	if (acut_job_wait(ctl->session.acut, id, true, changed, &progress, &job))
		return session_error_acut(&ctl->session);
	console_progress_clear(&ctl->session.console);
	if (!ctl->session.console.quiet || ctl->session.console.json)
		ctl_job_print(ctl, job);
	if (ctl->session.console.json)
		return job->has_error ? job->error.exit_status : SESSION_DONE;
	if (job->has_report)
		ctl_outlier_most(ctl, &job->report);
	return ctl_job_status(ctl, job);
}

int ctl_wait_run(struct program *ctl)
{
	ctl->session.for_reader = true;
	return ctl_job_each(ctl, wait_one);
}
