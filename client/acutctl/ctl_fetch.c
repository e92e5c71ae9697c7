/* fetch: the triangles of a job, made or being made, into files. */
#include <stdlib.h>
#include <string.h>

#include "ctl.h"

/* The job is asked for again: its texts are valid until the next call. */
static int report_hidden(struct session *session, uint64_t id, struct outfile *out)
{
	const struct acut_job *job;
	char *dataset, *view;
	uint64_t generation;
	struct err err = ERR_INIT;
	int status;

	if (acut_job_wait(session->acut, id, false, NULL, NULL, &job))
		return session_error_acut(session);
	dataset = strdup(job->dataset);
	view = strdup(job->view);
	generation = job->generation;
	if (dataset && view) {
		status = ctl_report_hidden(session, dataset, generation, view, out);
	} else {
		err_set(&err, ERR_NOMEM, "no memory for a view");
		status = session_error(session, &err);
	}
	free(dataset);
	free(view);
	return status;
}

/* Before the mesh is fetched, which takes long. */
static int open_hidden(const struct program *ctl, const char *view, struct outfile **ret, struct err *err)
{
	const char *path[CTL_FETCH_OUTPUTS + 1];
	int r;

	if (!ctl->opt.weight_report)
		return 0;
	r = ctl_report_hidden_check(view, err);
	return r ? r :
		   ctl_report_hidden_open(ctl->opt.weight_report, ctl->fetch.no_clobber, ctl_fetch_paths(&ctl->fetch, path), ret,
					  err);
}

int ctl_fetch_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct ctl_fetch_options *opt = &ctl->fetch;
	struct outputs *run = NULL;
	struct outfile *hidden = NULL;
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
	if (open_hidden(ctl, job->view, &hidden, &err) || ctl_fetch_open(session, opt, &run, &err) ||
	    outputs_keep(run, id, ctl->opt.resume, &err))
		status = session_error(session, &err);
	else
		status = ctl_fetch(session, opt, id, run, NULL);
	outputs_free(run);
	if (!status && hidden)
		status = report_hidden(session, id, hidden);
	ctl_report_hidden_close(hidden);
	return status;
}
