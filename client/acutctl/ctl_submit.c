/* submit: a job on a dataset; it outlives this command. */
#include <stdlib.h>

#include "ctl.h"
#include "parse.h"

static void changed(void *ctx, const struct acut_job *job)
{
	if (!job->final)
		session_progress_show(ctx, &job->progress);
}

int ctl_submit_run(struct program *ctl)
{
	const struct ctl_args *a = &ctl->args;
	struct acut_submission what = {.dataset = ctl->line.word[0], .priority = a->priority, .fresh = a->fresh};
	const struct acut_job *job;
	struct session_progress progress;
	char *view;
	struct err err = ERR_INIT;
	int status;

	if (ctl_view_text(&ctl->view, &view, &err))
		return session_error(&ctl->session, &err);
	what.generation = a->generation;
	what.view = view;
	status = session_connect(&ctl->session);
	if (!status && acut_submit_job(ctl->session.acut, &what, &job))
		status = session_error_acut(&ctl->session);
	free(view);
	if (status)
		return status;
	if (!ctl->session.console.json || !a->wait) {
		if (ctl->session.console.json)
			ctl_job_json(ctl, job);
		else
			fprintf(ctl->session.console.report, "%llu\n", (unsigned long long)job->id);
		fflush(ctl->session.console.report);
	}
	if (!a->wait)
		return SESSION_DONE;
	session_progress_init(&progress, &ctl->session);
	if (acut_job_wait(ctl->session.acut, job->id, true, changed, &progress, &job))
		return session_error_acut(&ctl->session);
	if (ctl->session.console.json) {
		ctl_job_json(ctl, job);
		return job->has_error ? job->error.exit_status : SESSION_DONE;
	}
	console_progress_clear(&ctl->session.console);
	ctl_summary_job(ctl, job);
	if (job->has_report)
		ctl_outlier_most(ctl, &job->report);
	return ctl_job_status(ctl, job);
}
