/* jobs: one line a job. */
#include "ctl.h"

static void each(void *ctx, const struct acut_job *job)
{
	ctl_job_print(ctx, job);
}

int ctl_jobs_run(struct ctl *ctl)
{
	int status = ctl_connect(ctl);

	ctl->list = true;
	if (!status && acut_jobs(ctl->acut, each, ctl))
		status = ctl_error_acut(ctl);
	return status;
}
