/* Limits that change while the service is at work: they hold from the next time somebody looks at them, what is removed for too
 * long by then goes at once. */
#include "job_priv.h"

void jobs_set_limits(struct jobs *j, const struct jobs_limits *limits)
{
	j->core->p.disk = limits->disk;
	j->core->p.keep_free = limits->keep_free;
	j->core->p.keep_removed = limits->keep_removed;
	j->core->p.space_wait = limits->space_wait;
	space_set_limits(j->core->space, limits->disk, limits->keep_free);
	datasets_expire(j);
}
