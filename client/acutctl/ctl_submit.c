/* submit: a job on a dataset; it outlives this command. */
#include <stdlib.h>

#include "ctl.h"
#include "parse.h"

static void changed(void *ctx, const struct acut_job *job)
{
	if (!job->final)
		ctl_progress_show(ctx, &job->progress);
}

int ctl_submit_run(struct program *ctl)
{
	const struct ctl_args *a = &ctl->args;
	struct acut_submission what = {.dataset = ctl->line.word[0], .priority = a->priority, .fresh = a->fresh};
	const struct acut_job *job;
	struct ctl_progress progress;
	char *view;
	struct err err = ERR_INIT;
	int status;

	if (ctl_view_text(a, &view, &err))
		return ctl_error(ctl, &err);
	what.generation = a->generation;
	what.view = view;
	status = ctl_connect(ctl);
	if (!status && acut_submit_job(ctl->acut, &what, &job))
		status = ctl_error_acut(ctl);
	free(view);
	if (status)
		return status;
	if (!ctl->console.json || !a->wait) {
		if (ctl->console.json)
			ctl_job_json(ctl, job);
		else
			fprintf(ctl->console.report, "%llu\n", (unsigned long long)job->id);
		fflush(ctl->console.report);
	}
	if (!a->wait)
		return CTL_DONE;
	ctl_progress_init(&progress, ctl);
	if (acut_job_wait(ctl->acut, job->id, true, changed, &progress, &job))
		return ctl_error_acut(ctl);
	if (ctl->console.json) {
		ctl_job_json(ctl, job);
		return job->has_error ? job->error.exit_status : CTL_DONE;
	}
	console_progress_clear(&ctl->console);
	ctl_summary_job(ctl, job);
	if (job->has_report)
		ctl_outlier_most(ctl, &job->report);
	return ctl_job_status(ctl, job);
}
