/* dataset create NAME: a dataset before its first push, with what that push has to keep to. */
#include <stdlib.h>

#include "ctl.h"
#include "ctl_dataset.h"

int ctl_dataset_create(struct program *ctl)
{
	struct session *session = &ctl->session;
	const char *mode = ctl->stage.mode, *z = NULL;
	char scale[CTL_SCALE_SIZE] = "", *crs = NULL;
	struct err err = ERR_INIT;
	int status;

	if ((ctl->stage.scale && ctl_stage_scale(ctl->stage.scale, scale, &z, &err)) ||
	    (ctl->opt.crs && ctl_stage_crs(ctl->opt.crs, "--crs", &crs, &err)))
		return session_error(session, &err);
	status = session_connect(session);
	if (!status && ((mode && acut_dataset_mode(session->acut, mode)) ||
			acut_dataset_create(session->acut, ctl->line.word[0], scale, z, crs)))
		status = session_error_acut(session);
	free(crs);
	return status;
}
