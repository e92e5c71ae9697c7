/* rm: forgets jobs that are over. */
#include "ctl.h"

static int rm(struct session *session, uint64_t id)
{
	struct term_json j = {.out = session->console.report};

	if (acut_job_remove(session->acut, id))
		return session_error_acut(session);
	if (session->console.json) {
		term_json_open(&j, NULL, '{');
		term_json_u64(&j, "job", id);
		term_json_bool(&j, "removed", true);
		term_json_end(&j);
	}
	return SESSION_DONE;
}

int ctl_rm_run(struct program *ctl)
{
	return ctl_job_each(ctl, rm);
}
