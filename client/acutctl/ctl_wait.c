/* wait: until each of the jobs is over; ends with the first status, in the order of the arguments, that is
 * not 0. */
#include "ctl.h"

static void changed(void *ctx, const struct acut_job *job)
{
	if (!job->final)
		ctl_progress_show(ctx, &job->progress);
}

static int wait_one(struct program *ctl, uint64_t id)
{
	struct ctl_progress progress;
	const struct acut_job *job;

	ctl_progress_init(&progress, ctl);
	if (acut_job_wait(ctl->acut, id, true, changed, &progress, &job))
		return ctl_error_acut(ctl);
	console_progress_clear(&ctl->console);
	if (!ctl->console.quiet || ctl->console.json)
		ctl_job_print(ctl, job);
	if (ctl->console.json)
		return job->has_error ? job->error.exit_status : CTL_DONE;
	if (job->has_report)
		ctl_outlier_most(ctl, &job->report);
	return ctl_job_status(ctl, job);
}

int ctl_wait_run(struct program *ctl)
{
	ctl->for_reader = true;
	return ctl_job_each(ctl, wait_one);
}
