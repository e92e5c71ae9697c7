/* dataset create NAME: a dataset before its first push, with what that push has to keep to. */
#include <string.h>

#include "ctl.h"
#include "ctl_dataset.h"

int ctl_dataset_create(struct program *ctl, const char *name)
{
	const struct ctl_args *a = &ctl->args;
	struct ctl_assume crs = {0};
	char scale[2 * DECIMAL_TEXT_SIZE + 2] = "", *comma = NULL;
	struct decimal d;
	struct err err = ERR_INIT;
	int status;

	if (a->scale) {
		snprintf(scale, sizeof(scale), "%s", a->scale);
		comma = strchr(scale, ',');
		if (comma)
			*comma++ = 0;
		if (strlen(a->scale) >= sizeof(scale) || !decimal_parse(scale, &d) || d.mantissa <= 0 ||
		    (comma && (!decimal_parse(comma, &d) || d.mantissa <= 0))) {
			err_set(&err, ERR_USAGE, "--scale is not XY or XY,Z, numbers above zero: \"%s\"", a->scale);
			return session_error(&ctl->session, &err);
		}
	}
	if (a->crs && ctl_assume_crs(a->crs, "--crs", &crs.crs, &err))
		return session_error(&ctl->session, &err);
	status = session_connect(&ctl->session);
	if (!status && a->mode && acut_dataset_mode(ctl->session.acut, a->mode))
		status = session_error_acut(&ctl->session);
	if (!status && acut_dataset_create(ctl->session.acut, name, scale, comma, crs.crs))
		status = session_error_acut(&ctl->session);
	ctl_assume_done(&crs);
	return status;
}
