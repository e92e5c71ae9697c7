/* submit: a job on a dataset; it outlives this command. */
#include <stdlib.h>

#include "ctl.h"

int ctl_submit_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	const struct ctl_options *a = &ctl->opt;
	struct acut_submission what = {
		.dataset = ctl->line.word[0], .generation = a->generation, .priority = a->priority, .fresh = a->fresh};
	const struct acut_job *job;
	struct session_progress progress;
	char *view, note[CTL_MESH_NOTE];
	struct err err = ERR_INIT;
	int status;

	if (ctl_view_text(&ctl->view, &view, &err))
		return session_error(session, &err);
	what.view = view;
	status = session_connect(session);
	if (!status && acut_submit_job(session->acut, &what, &job))
		status = session_error_acut(session);
	free(view);
	if (status)
		return status;
	console_note(&session->console, "%s", ctl_fetch_bound(job, ctl->view.max_error, note));
	if (!session->console.json || !a->wait) {
		if (session->console.json)
			ctl_report_job_json(&session->console, job, note);
		else
			fprintf(session->console.report, "%llu\n", (unsigned long long)job->id);
		fflush(session->console.report);
	}
	if (!a->wait)
		return SESSION_DONE;
	session_progress_init(&progress, session);
	if (acut_job_wait(session->acut, job->id, true, session_progress_job, &progress, &job))
		return session_error_acut(session);
	if (session->console.json) {
		ctl_report_job_json(&session->console, job, note);
		return job->has_error ? job->error.exit_status : SESSION_DONE;
	}
	console_progress_clear(&session->console);
	ctl_fetch_summary(&session->console, job);
	if (job->has_report)
		ctl_report_warn_crowded(&session->console, &job->report);
	return ctl_report_job_status(session, job);
}
