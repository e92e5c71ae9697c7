/* fetch: the triangles of a job, made or being made, into files. */
#include <stdlib.h>
#include <string.h>

#include "ctl.h"

int ctl_fetch_run(struct program *ctl)
{
	struct format_run *run = NULL;
	const struct acut_job *job;
	struct err err = ERR_INIT;
	char *window = NULL;
	uint64_t id;
	int r = ctl_job_id(ctl->line.word[0], &id, &err), status;

	if (r)
		return session_error(&ctl->session, &err);
	if (!ctl->args.out.n && !ctl_output_nothing(&ctl->args)) { /* said before a daemon is looked for */
		ctl_output_open(ctl, &run, &err);
		return session_error(&ctl->session, &err);
	}
	if (ctl_view_window(&ctl->view, &window, &err))
		return session_error(&ctl->session, &err);
	status = session_connect(&ctl->session);
	if (!status && acut_fetch_window(ctl->session.acut, window))
		status = session_error_acut(&ctl->session);
	free(window);
	if (status)
		return status;
	if (acut_job_wait(ctl->session.acut, id, false, NULL, NULL, &job))
		return session_error_acut(&ctl->session);
	/* the view says whether gaps are to be expected */
	ctl->view.ground = strstr(job->view, " ground") != NULL;
	ctl->view.surface = strstr(job->view, " returns=first") && strstr(job->view, " duplicates=highest");
	r = ctl_output_open(ctl, &run, &err);
	if (!r)
		r = format_run_keep(run, id, ctl->args.resume, &err);
	status = r ? session_error(&ctl->session, &err) : ctl_output_fetch(ctl, id, run, NULL);
	format_run_free(run);
	return status;
}
