/*
 * The reason why a job waits, as a text, and its priority. As with nice, every user may lower a priority, but only administrators
 * may raise it above normal.
 */
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "job_priv.h"

static const char *const priorities[JOB_PRIORITIES] = {
	[JOB_PRIORITY_NORMAL] = "normal",
	[JOB_PRIORITY_LOW] = "low",
	[JOB_PRIORITY_HIGH] = "high",
};

_Static_assert((int)JOB_PRIORITY_NORMAL == (int)SCHED_RANK_NORMAL && (int)JOB_PRIORITY_LOW == (int)SCHED_RANK_LOW &&
		       (int)JOB_PRIORITY_HIGH == (int)SCHED_RANK_HIGH,
	       "a priority is the rank of its tasks");

const char *job_priority_text(enum job_priority priority)
{
	return priorities[priority];
}

int job_priority_read(const char *text, const struct peer *peer, enum job_priority *ret, struct err *err)
{
	int p;

	if (!text || !*text)
		return 0;
	for (p = 0; p < JOB_PRIORITIES && strcmp(priorities[p], text); p++)
		;
	if (p == JOB_PRIORITIES) {
		err_set(err, ERR_USAGE, "\"%.40s\" is not a priority: low, normal or high", text);
		return err_add_place(err, ERR_NO_OFFSET, "priority");
	}
	if (p == JOB_PRIORITY_HIGH && !rights_admin(peer)) {
		err_set(err, ERR_PERM, "only administrators may give a job a high priority");
		return err_add_hint(err, "normal and low are for everybody");
	}
	*ret = (enum job_priority)p;
	return 0;
}

void job_set_priority(struct job *job, enum job_priority priority)
{
	job->priority = priority;
	job->slot.owner.rank = (enum sched_rank)priority;
	if (job->run)
		run_set_rank(job->run, job->slot.owner.rank);
}

void job_waiting(const struct job *job, struct job_info *ret)
{
	ret->priority = job->priority;
	ret->position = slot_position(job->jobs->admission, &job->slot);
	if (job->slot.requested)
		slot_wait_text(job->jobs->admission, &job->slot, ret->waiting, sizeof ret->waiting);
	else if (job->run && !job->run_ended)
		run_waiting(job->run, ret->waiting, sizeof ret->waiting);
	ret->space_missing = job->run ? run_space_missing(job->run) : 0;
	if (job->run)
		ret->seconds_left = run_seconds_left(job->run);
}
