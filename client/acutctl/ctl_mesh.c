/*
 * mesh: from files to files in one step. What can be refused without a daemon is refused first; then a dataset of its own is
 * staged, a job bound to this connection is submitted, and its triangles stream into the outputs while they are made. The job
 * ends with this command.
 */
#include <stdlib.h>

#include "ctl.h"

static int fetch(struct program *ctl, const struct acut_job *job, struct outputs *run, const struct ctl_staged *staged)
{
	struct err err = ERR_INIT;

	/* Radii can be less than a step of the lattice. */
	if (ctl->opt.weight_report && ctl_report_hidden_check(job->view, &err))
		return session_error(&ctl->session, &err);
	return ctl_fetch(&ctl->session, &ctl->fetch, job->id, run, staged);
}

static int mesh(struct program *ctl, struct ctl_inputs *in, const char *view, struct outputs *run, struct outfile *hidden)
{
	struct session *session = &ctl->session;
	struct ctl_staged staged;
	struct acut_submission what = {.view = view, .priority = ctl->opt.priority, .bound = true, .fresh = true};
	const struct acut_job *job;
	int status = session_connect(session), staging;

	if (status)
		return status;
	staging = ctl_stage(in, &ctl->stage, NULL, &staged);
	if (staging == 0 || staging == SESSION_SOME_REFUSED) {
		what.dataset = staged.dataset;
		what.generation = staged.generation;
		if (ctl->opt.line_report)
			status = ctl_report_line_places(session, &staged, ctl->opt.line_report);
		if (status)
			staging = status;
		else if (acut_submit_job(session->acut, &what, &job))
			status = session_error_acut(session);
		else
			status = fetch(ctl, job, run, &staged);
		if (!status && hidden)
			status = ctl_report_hidden(session, staged.dataset, staged.generation, view, hidden);
	}
	ctl_stage_done(&staged);
	return status ? status : staging;
}

/* The report of what weights hide: what it is of, where it goes. *ret stays NULL if none is asked for. */
static int open_hidden(const struct program *ctl, const struct ctl_inputs *in, const char *view, struct outfile **ret,
		       struct err *err)
{
	const char *to = ctl->opt.weight_report, *path[CTL_FETCH_OUTPUTS + 1];
	int r;

	if (!to)
		return 0;
	if ((r = ctl_report_hidden_check(view, err)) || (r = ctl_inputs_not_outputs(in, (const char *[]){to, NULL}, err)))
		return r;
	return ctl_report_hidden_open(to, ctl->fetch.no_clobber, ctl_fetch_paths(&ctl->fetch, path), ret, err);
}

int ctl_mesh_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct ctl_inputs in = ctl_inputs_of(session, &ctl->input);
	struct outputs *run = NULL;
	struct outfile *hidden = NULL;
	const char *path[CTL_FETCH_OUTPUTS + 1];
	struct lines_export_options options[LINES_KINDS];
	char *view = NULL;
	double box[4];
	bool cropped = false;
	struct err err = ERR_INIT;
	int r = ctl_view_box(&ctl->view, &view, &cropped, box, &err), status;

	ctl->fetch.max_error = ctl->view.max_error;
	ctl->fetch.gaps = ctl->view.ground || ctl->view.surface;
	if (!r)
		r = ctl_inputs_gather(&in, ctl->line.word, ctl->line.nword, &err);
	if (!r)
		r = ctl_lines_beside(ctl, &in, options, &err);
	in.crop = cropped ? box : NULL;
	if (!r)
		r = ctl_inputs_not_outputs(&in, ctl_fetch_paths(&ctl->fetch, path), &err);
	if (!r)
		r = ctl_fetch_open(session, &ctl->fetch, &run, &err);
	if (!r)
		r = open_hidden(ctl, &in, view, &hidden, &err);
	status = r ? session_error(session, &err) : mesh(ctl, &in, view, run, hidden);
	outputs_free(run);
	ctl_report_hidden_close(hidden);
	ctl_inputs_done(&in);
	free(view);
	return status;
}
