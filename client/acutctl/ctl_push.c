/* push: files into a named dataset, which the first push creates. */
#include "ctl.h"

int ctl_push_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct ctl_inputs in = ctl_inputs_of(session, &ctl->input);
	struct ctl_staged staged = {.nfile = 0};
	struct err err = ERR_INIT;
	int status, reported;

	if (ctl_stage_check(&ctl->stage, &ctl->input, &err) || ctl_lines_as(ctl, &in, &err) ||
	    ctl_inputs_gather(&in, ctl->line.word + 1, ctl->line.nword - 1, &err))
		return session_error(session, &err);
	if (ctl->stage.replaces && in.n != 1) {
		err_set(&err, ERR_USAGE, "--replaces is about one input, there are %zu", in.n);
		ctl_inputs_done(&in);
		return session_error(session, &err);
	}
	status = session_connect(session);
	if (!status)
		status = ctl_stage(&in, &ctl->stage, ctl->line.word[0], &staged);
	if (staged.committed && (status == 0 || status == SESSION_SOME_REFUSED)) {
		reported = ctl_report_push(session, &staged, NULL);
		if (!reported && ctl->opt.line_report)
			reported = ctl_report_line_places(session, &staged, ctl->opt.line_report);
		status = reported ? reported : status;
	}
	ctl_stage_done(&staged);
	ctl_inputs_done(&in);
	return status;
}
