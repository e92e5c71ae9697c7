/* Jobs that are named on the command line. */
#include "ctl.h"
#include "parse.h"

int ctl_job_id(const char *text, uint64_t *ret, struct err *err)
{
	if (!parse_u64(text, ret) || !*ret)
		return err_set(err, ERR_USAGE, "\"%s\" is not the number of a job", text);
	return 0;
}

int ctl_job_each(struct program *ctl, int (*each)(struct session *, uint64_t id))
{
	int first = 0, status;

	for (unsigned i = 0; i < ctl->line.nword; i++) {
		struct err err = ERR_INIT;
		uint64_t id;

		if (ctl_job_id(ctl->line.word[i], &id, &err))
			return session_error(&ctl->session, &err);
	}
	status = session_connect(&ctl->session);
	if (status)
		return status;
	for (unsigned i = 0; i < ctl->line.nword; i++) {
		uint64_t id = 0;

		parse_u64(ctl->line.word[i], &id);
		status = each(&ctl->session, id);
		first = first ? first : status;
		if (session_interrupted(&ctl->session))
			break;
	}
	return first;
}
