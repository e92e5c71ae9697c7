/*
 * mesh: the one step from files to files. What can be refused without a daemon is refused first; then a
 * one-step dataset is staged, a job bound to this connection is submitted, and its triangles stream into the
 * outputs while they are made. If this command ends, so does the job.
 */
#include <stdlib.h>

#include "ctl.h"

static int mesh(struct program *ctl, struct ctl_inputs *in, const char *view, struct format_run *run)
{
	struct ctl_staged staged;
	struct acut_submission what = {.view = view, .priority = ctl->args.priority, .bound = true, .fresh = true};
	const struct acut_job *job;
	int status = session_connect(&ctl->session), staging;

	if (status)
		return status;
	staging = ctl_stage(ctl, NULL, in, &staged);
	if (staging == 0 || staging == SESSION_SOME_REFUSED) {
		what.dataset = staged.dataset;
		what.generation = staged.generation;
		if (acut_submit_job(ctl->session.acut, &what, &job))
			status = session_error_acut(&ctl->session);
		else
			status = ctl_output_fetch(ctl, job->id, run, &staged);
	}
	ctl_stage_done(&staged);
	return status ? status : staging;
}

int ctl_mesh_run(struct program *ctl)
{
	struct ctl_inputs in = {0};
	struct format_run *run = NULL;
	char *view = NULL;
	double box[4];
	bool cropped = false;
	struct err err = ERR_INIT;
	int r = ctl_view_box(&ctl->view, &view, &cropped, box, &err), status;

	if (!r)
		r = ctl_input_gather(ctl, ctl->line.word, ctl->line.nword, &in, &err);
	in.crop = cropped ? box : NULL;
	if (!r)
		r = ctl_input_not_output(&in, &ctl->args, &err);
	if (!r)
		r = ctl_output_open(ctl, &run, &err);
	status = r ? session_error(&ctl->session, &err) : mesh(ctl, &in, view, run);
	format_run_free(run);
	ctl_input_done(&in);
	free(view);
	return status;
}
