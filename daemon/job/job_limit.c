/* How many unfinished jobs and datasets one user may have. No limit holds for admins. (Bytes on the disk: limit.c of core;
 * memory: user.c of admission.) */
#include "job_priv.h"

/* ---- jobs ---- */

int limit_jobs(const struct jobs *j, const struct peer *peer, struct err *err)
{
	const struct job *job;
	unsigned own = 0;

	THREAD_LOOP_ONLY();
	if (!j->core->p.user.jobs || rights_admin(peer))
		return 0;
	for (job = j->jobs; job; job = job->next)
		own += !job->removed && !job_state_final(job->state) && job->peer.uid == peer->uid;
	if (own < j->core->p.user.jobs)
		return 0;
	err_set(err, ERR_LIMIT, "%u jobs of this user wait or run, and %u are all that one user may have (user-jobs)", own,
		j->core->p.user.jobs);
	err_add_hint(err, "submit it again when some of them are done, or cancel some");
	return err_add_place(err, ERR_NO_OFFSET, "user-jobs");
}

/* ---- datasets ---- */

static unsigned limit_datasets_of(const struct jobs *j, uint32_t uid, unsigned *ret_removed)
{
	unsigned n = 0, removed = 0;

	for (const struct dataset *d = j->datasets; d && !d->onestep; d = d->next)
		if (d->uid == uid) {
			n++;
			removed += d->removed_us != 0;
		}
	*ret_removed = removed;
	return n;
}

int limit_datasets(const struct jobs *j, const struct peer *peer, struct err *err)
{
	unsigned removed, own;

	THREAD_LOOP_ONLY();
	if (!j->core->p.user.datasets || rights_admin(peer))
		return 0;
	own = limit_datasets_of(j, peer->uid, &removed);
	if (own < j->core->p.user.datasets)
		return 0;
	if (removed)
		err_set(err, ERR_LIMIT,
			"this user has %u datasets, %u of them removed but not gone yet, and %u are all that one user may "
			"have (user-datasets)",
			own, removed, j->core->p.user.datasets);
	else
		err_set(err, ERR_LIMIT, "this user has %u datasets, and %u are all that one user may have (user-datasets)", own,
			j->core->p.user.datasets);
	err_add_hint(
		err,
		"push into one that is there, remove some (they count until keep-removed is over), or ask an administrator for more");
	return err_add_place(err, ERR_NO_OFFSET, "user-datasets");
}

void jobs_set_user_limits(struct jobs *j, const struct user_limits *user)
{
	j->core->p.user = *user;
	limit_count(j->core);
}

/* ---- what a user has of it ---- */

void jobs_own(struct jobs *j, const struct peer *peer, uint64_t state_bytes, struct jobs_own *ret)
{
	const struct user_limits *may = &j->core->p.user;
	struct jobs_own own = {.exempt = rights_admin(peer), .jobs_most = may->jobs, .datasets_most = may->datasets};

	for (const struct job *job = j->jobs; job; job = job->next)
		own.jobs += !job->removed && !job_state_final(job->state) && job->peer.uid == peer->uid;
	own.datasets = limit_datasets_of(j, peer->uid, &own.removed);
	limit_disk_of(j->core, peer->uid, state_bytes, &own.disk, &own.disk_most);
	*ret = own;
}
