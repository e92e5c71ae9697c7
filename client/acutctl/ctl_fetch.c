/* fetch: the triangles of a job, made or being made, into files. */
#include <stdlib.h>
#include <string.h>

#include "ctl.h"

int ctl_fetch_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct ctl_fetch_options *opt = &ctl->fetch;
	struct outputs *run = NULL;
	const struct acut_job *job;
	struct err err = ERR_INIT;
	char *window = NULL;
	uint64_t id;
	int status;

	opt->window = ctl->view.bbox ? "bbox" : ctl->view.polygon ? "polygon" : NULL;
	if (ctl_job_id(ctl->line.word[0], &id, &err))
		return session_error(session, &err);
	if (!ctl_fetch_count(opt) && !ctl_fetch_nothing(opt)) { /* refused before a daemon is looked for */
		ctl_fetch_open(session, opt, &run, &err);
		return session_error(session, &err);
	}
	if (ctl_view_window(&ctl->view, &window, &err))
		return session_error(session, &err);
	status = session_connect(session);
	if (!status && acut_fetch_window(session->acut, window))
		status = session_error_acut(session);
	free(window);
	if (status)
		return status;
	if (acut_job_wait(session->acut, id, false, NULL, NULL, &job))
		return session_error_acut(session);
	opt->gaps =
		strstr(job->view, " ground") || (strstr(job->view, " returns=first") && strstr(job->view, " duplicates=highest"));
	if (ctl_fetch_open(session, opt, &run, &err) || outputs_keep(run, id, ctl->opt.resume, &err))
		status = session_error(session, &err);
	else
		status = ctl_fetch(session, opt, id, run, NULL);
	outputs_free(run);
	return status;
}
